//! What the hands hold, as the renderer draws it.

use super::hands::{HandsOutput, Held, Tool};
use crate::gpu::{self, Instrument};
use glam::{DAffine3, DMat3, DVec3};

/// Between the tips of open forceps. Metres in the room.
const OPEN: f64 = 0.016;
/// Radius of the ball at the fingertips of a bare hand, open and closed. Metres in the room.
const FINGERTIPS: [f64; 2] = [0.012, 0.007];
/// Half a side of the plane that would be cut. Metres in the room.
const PLANE: f64 = 0.16;
const GLASS: [f32; 4] = [0.75, 0.85, 1.0, 0.5];
const SHEET: [f32; 4] = [0.35, 0.8, 1.0, 0.55];

/// Instruments and plane of a frame, model space. `room` is a metre of the room.
pub fn instruments(output: &HandsOutput, room: f64, out: &mut Vec<Instrument>) {
    out.clear();
    out.extend(output.held.iter().flatten().map(|held| instrument(held, room)));
    if let Some((point, normal)) = output.plane {
        let u = normal.any_orthonormal_vector();
        let axes = DMat3::from_cols(u, normal.cross(u), normal) * (PLANE * room);
        out.push(Instrument {
            tool: gpu::Tool::Plane,
            world_from_tool: DAffine3::from_mat3_translation(axes, point),
            colour: SHEET,
        });
    }
}

fn instrument(held: &Held, room: f64) -> Instrument {
    let closed = held.closed.clamp(0.0, 1.0);
    match held.tool {
        _ if held.bare => {
            let radius = FINGERTIPS[0] + (FINGERTIPS[1] - FINGERTIPS[0]) * closed;
            Instrument {
                tool: gpu::Tool::Sphere,
                world_from_tool: DAffine3::from_scale_rotation_translation(
                    DVec3::splat(radius * room),
                    glam::DQuat::IDENTITY,
                    held.tip,
                ),
                colour: GLASS,
            }
        }
        Tool::Scalpel => Instrument::scalpel(held.tip, held.base, held.edge, room),
        Tool::Forceps => {
            // Jaws open across the hand, which is at a right angle to where a scalpel's edge would be.
            let up = (held.base - held.tip).normalize_or(DVec3::Y);
            let front = held.edge.reject_from_normalized(up).normalize_or(up.any_orthonormal_vector());
            let axes = DMat3::from_cols(up.cross(front), up, front) * room;
            Instrument {
                tool: gpu::Tool::Forceps { opening: OPEN * (1.0 - closed) },
                world_from_tool: DAffine3::from_mat3_translation(axes, held.tip),
                colour: [1.0; 4],
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HELD: Held = Held {
        tool: Tool::Scalpel,
        tip: DVec3::new(0.1, 0.2, 0.3),
        base: DVec3::new(0.1, 0.2, 0.4),
        edge: DVec3::NEG_Y,
        closed: 0.0,
        bare: false,
    };

    fn drawn(held: [Option<Held>; 2], plane: Option<(DVec3, DVec3)>) -> Vec<Instrument> {
        let mut out = vec![Instrument::scalpel(DVec3::ZERO, DVec3::Y, DVec3::X, 1.0)];
        instruments(&HandsOutput { held, plane, ..HandsOutput::default() }, 2.0, &mut out);
        out
    }

    #[test]
    fn instruments_have_their_tips_where_the_hands_have_them_and_the_size_of_the_room() {
        let forceps = Held { tool: Tool::Forceps, closed: 0.25, ..HELD };
        let shown = drawn([Some(forceps), Some(HELD)], None);
        assert_eq!(shown.len(), 2, "what was there before is gone");
        for instrument in &shown {
            let place = instrument.world_from_tool;
            assert!(place.translation.distance(HELD.tip) < 1e-12);
            let up = place.transform_vector3(DVec3::Y);
            assert!(up.distance(DVec3::Z * 2.0) < 1e-12, "the handle points to the hand: {up}");
            let m = place.matrix3;
            assert!((m.determinant() - 8.0).abs() < 1e-9, "no mirror image");
        }
        let edge = shown[1].world_from_tool.transform_vector3(DVec3::X);
        assert!(edge.normalize().distance(DVec3::NEG_Y) < 1e-12, "the edge is down");
        let jaws = shown[0].world_from_tool.transform_vector3(DVec3::X).normalize();
        assert!(jaws.dot(DVec3::X).abs() > 0.999, "the jaws open sideways: {jaws}");
        assert_eq!(shown[0].tool, gpu::Tool::Forceps { opening: 0.75 * OPEN });
    }

    #[test]
    fn a_bare_hand_has_a_ball_that_closes() {
        let radius = |closed| drawn([Some(Held { bare: true, closed, ..HELD }), None], None)[0].world_from_tool.matrix3.x_axis.x;
        assert!((radius(0.0) - 2.0 * FINGERTIPS[0]).abs() < 1e-12 && radius(1.0) < radius(0.0));
    }

    #[test]
    fn the_plane_stands_where_it_would_cut() {
        let normal = DVec3::new(1.0, 2.0, -1.0).normalize();
        let shown = drawn([None; 2], Some((DVec3::X, normal)));
        let [Instrument { tool: gpu::Tool::Plane, world_from_tool, .. }] = shown[..] else { panic!("{shown:?}") };
        assert!(world_from_tool.translation == DVec3::X);
        assert!(world_from_tool.transform_vector3(DVec3::Z).normalize().distance(normal) < 1e-12);
    }
}
