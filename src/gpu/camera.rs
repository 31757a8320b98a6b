//! The camera and the light of a picture, and the record they make.

use super::error::GpuError;
use super::types::Frame;
use super::views::ViewPose;
use glam::dcamera::rh::{proj::directx::orthographic, view::look_at_mat4};
use glam::{DMat4, DVec3};

/// Where a picture is taken from. World space, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The eye.
    pub eye: DVec3,
    /// What it looks at.
    pub target: DVec3,
    /// Upwards in the picture; need be neither unit nor perpendicular.
    pub up: DVec3,
    /// Full vertical angle of view, radians.
    pub fov_y: f64,
}

impl Camera {
    /// Looks at a box from `direction` (from its centre towards the eye), as near as shows all of it in a picture of the
    /// given width over height.
    pub fn framing(bounds: Bounds, direction: DVec3, up: DVec3, fov_y: f64, aspect: f64) -> Self {
        let bounds = if bounds.is_empty() { Bounds { min: DVec3::splat(-0.5), max: DVec3::splat(0.5) } } else { bounds };
        let target = 0.5 * (bounds.min + bounds.max);
        let back = direction.normalize_or(DVec3::Z);
        let right = up.cross(back).normalize_or(back.any_orthonormal_vector());
        let upward = back.cross(right);
        let tan = (0.5 * fov_y).tan();
        let reach = |corner: DVec3| {
            let p = corner - target;
            p.dot(back) + (p.dot(right).abs() / (tan * aspect)).max(p.dot(upward).abs() / tan)
        };
        let distance = bounds.corners().into_iter().map(reach).fold(1e-6, f64::max);
        Self { eye: target + back * (1.06 * distance), target, up, fov_y }
    }

    pub(super) fn check(&self) -> Result<(), GpuError> {
        let finite = [self.eye, self.target, self.up].iter().all(|v| v.is_finite());
        if !finite || !self.fov_y.is_finite() {
            return Err(GpuError::BadCamera("a number is not finite"));
        }
        if !(1e-3..std::f64::consts::PI - 1e-3).contains(&self.fov_y) {
            return Err(GpuError::BadCamera("fov_y must be at least 0.001 and below 3.14 radians"));
        }
        if self.eye == self.target || (self.target - self.eye).cross(self.up).length_squared() == 0.0 {
            return Err(GpuError::BadCamera("eye and target coincide, or up points along the line of sight"));
        }
        Ok(())
    }
}

/// What stands around the tissue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scenery {
    /// Which way is up; the lamp hangs there, the tray lies below.
    pub up: DVec3,
    /// The draped tray under the tissue.
    pub tray: bool,
    /// The lamp's shadow.
    pub shadow: bool,
    /// What the tray lies under, world space; left out, everything that is drawn, at rest.
    pub ground: Option<Bounds>,
}

impl Default for Scenery {
    fn default() -> Self {
        Self { up: DVec3::Y, tray: true, shadow: true, ground: None }
    }
}

/// An axis-aligned box in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least corner.
    pub min: DVec3,
    /// Greatest corner.
    pub max: DVec3,
}

impl Bounds {
    /// Holds nothing.
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// True if it holds nothing.
    pub fn is_empty(&self) -> bool {
        !(self.min.cmple(self.max).all() && self.min.is_finite() && self.max.is_finite())
    }

    /// The smallest box around this one and `p`.
    pub fn with(self, p: DVec3) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    /// The smallest box around both.
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// What this box and `other` share; this box where they share nothing.
    pub fn within(self, other: &Self) -> Self {
        let shared = Self { min: self.min.max(other.min), max: self.max.min(other.max) };
        if shared.is_empty() { self } else { shared }
    }

    /// The eight corners.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |bit: usize, axis: usize| if i >> bit & 1 == 0 { self.min[axis] } else { self.max[axis] };
            DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2))
        })
    }
}

/// Side of the shadow map, texels.
pub const SHADOW_SIZE: u32 = 1024;
const KEY_RADIANCE: f32 = 1.7;
const HEADLAMP_RADIANCE: f32 = 0.4;

/// What the lamp shines on.
#[derive(Clone, Copy, Debug)]
pub struct Lit {
    /// Bounds of the scene at rest: the tray lies under it and does not bob as the model moves.
    pub rest: Bounds,
    /// As it is now: the lamp's shadow map covers it, but for pieces that have fallen far away.
    pub posed: Bounds,
    /// Instruments throw shadows too.
    pub instruments: bool,
}

/// The shadow map's radius, in radii of what is lit; its rim is where shadows fade out.
const SHADOW_REACH: f64 = 1.08;
/// The same with instruments, which are longer than what they work on.
const SHADOW_REACH_WITH_INSTRUMENTS: f64 = 1.6;
/// What lies farther from the middle than so many radii of the scene at rest is lit without shadows, so that those near stay sharp.
const SHADOW_FARTHEST: f64 = 4.0;

/// The record of one call's views, each `size` pixels large. Errors: the scene's up is zero.
pub fn frame_record(views: &[ViewPose], size: (u32, u32), scenery: &Scenery, lit: &Lit) -> Result<Frame, GpuError> {
    let Lit { rest, posed, instruments } = *lit;
    let up = scenery.up.try_normalize().ok_or(GpuError::BadCamera("the scene's up is zero"))?;
    let side = up.any_orthonormal_vector();
    let front = if up == DVec3::Y { DVec3::Z } else { up.cross(side) };
    let lamp = (0.80 * up + 0.50 * up.cross(front) + 0.36 * front).normalize();
    let somewhere = views.first().map_or(DVec3::ZERO, |v| v.position + v.forward());
    let posed = if posed.is_empty() { Bounds { min: somewhere - 1e-3, max: somewhere + 1e-3 } } else { posed };
    let rest = if rest.is_empty() { posed } else { rest };
    let radius = 0.5 * (rest.max - rest.min).length();
    let centre = 0.5 * (rest.min + rest.max);
    let reach = if instruments { SHADOW_REACH_WITH_INSTRUMENTS } else { SHADOW_REACH };
    let near = posed.within(&Bounds { min: centre - SHADOW_FARTHEST * radius, max: centre + SHADOW_FARTHEST * radius });
    let (light_from_world, world_per_texel) = light_frame(lamp, up, near, reach);
    let lowest = rest.corners().iter().map(|c| c.dot(up)).fold(f64::INFINITY, f64::min) - 0.015 * radius;
    let tray_centre = centre + up * (lowest - centre.dot(up));
    // One headlamp between the eyes: a highlight that differed from eye to eye would not fuse.
    let headlamp = -views.iter().map(ViewPose::forward).sum::<DVec3>().normalize_or(DVec3::NEG_Z);
    let mut record = Frame {
        light_from_world: light_from_world.as_mat4().to_cols_array_2d(),
        scene_up: with_w(up, lowest as f32),
        key_light: with_w(lamp, KEY_RADIANCE),
        fill_light: with_w(headlamp, HEADLAMP_RADIANCE),
        tray_centre: with_w(tray_centre, if scenery.tray { radius as f32 } else { 0.0 }),
        shadow: [1.0 / SHADOW_SIZE as f32, 1e-3, world_per_texel as f32, f32::from(u8::from(scenery.shadow))],
        ..Frame::default()
    };
    for (slot, view) in record.views.iter_mut().zip(views) {
        *slot = view.record(size);
    }
    Ok(record)
}

/// Orthographic, around the sphere of `bounds` grown by `reach`; depth 1 nearest the lamp. Second: metres a texel.
fn light_frame(lamp: DVec3, up: DVec3, bounds: Bounds, reach: f64) -> (DMat4, f64) {
    let centre = 0.5 * (bounds.min + bounds.max);
    let radius = (0.5 * reach * (bounds.max - bounds.min).length()).max(1e-9);
    let steady_up = if lamp.cross(up).length_squared() > 1e-6 { up } else { lamp.any_orthonormal_vector() };
    let view = look_at_mat4(centre + lamp * (2.0 * radius), centre, steady_up);
    // Near and far swapped: reverse depth here too.
    let projection = orthographic(-radius, radius, -radius, radius, 6.0 * radius, 0.5 * radius);
    (projection * view, 2.0 * radius / f64::from(SHADOW_SIZE))
}

fn with_w(v: DVec3, w: f32) -> [f32; 4] {
    [v.x as f32, v.y as f32, v.z as f32, w]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera { eye: DVec3::new(0.0, 0.0, 3.0), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.9 }
    }

    fn record(camera: &Camera) -> Result<Frame, GpuError> {
        let bounds = Bounds { min: DVec3::splat(-1.0), max: DVec3::splat(1.0) };
        record_in(camera, 4.0 / 3.0, bounds)
    }

    fn record_in(camera: &Camera, aspect: f64, bounds: Bounds) -> Result<Frame, GpuError> {
        record_lit(camera, aspect, &Lit { rest: bounds, posed: bounds, instruments: false })
    }

    fn record_lit(camera: &Camera, aspect: f64, lit: &Lit) -> Result<Frame, GpuError> {
        frame_record(&[ViewPose::from_camera(camera, aspect)?], (400, 300), &Scenery::default(), lit)
    }

    #[test]
    fn reverse_depth_falls_from_one_at_the_near_plane_to_zero_far_out() -> Result<(), GpuError> {
        let frame = record(&camera())?;
        let clip = DMat4::from_cols_array_2d(&frame.views[0].clip_from_world.map(|c| c.map(f64::from)));
        let depth = |z: f64| {
            let p = clip * DVec3::new(0.0, 0.0, z).extend(1.0);
            p.z / p.w
        };
        assert!((depth(3.0 - 3e-3) - 1.0).abs() < 1e-3);
        assert!(depth(0.0) > depth(-1.0) && depth(-1e9) < 1e-6 && depth(-1e9) > 0.0);
        Ok(())
    }

    #[test]
    fn the_whole_box_lies_in_the_picture_and_in_the_shadow_map() -> Result<(), GpuError> {
        let bounds = Bounds { min: DVec3::new(-1.0, -2.0, -3.0), max: DVec3::new(1.0, 2.0, 3.0) };
        let camera = Camera::framing(bounds, DVec3::new(1.0, 1.0, 1.0), DVec3::Y, 0.7, 1.0);
        let frame = record_in(&camera, 1.0, bounds)?;
        for matrix in [frame.views[0].clip_from_world, frame.light_from_world] {
            let clip = DMat4::from_cols_array_2d(&matrix.map(|c| c.map(f64::from)));
            for corner in bounds.corners() {
                let p = clip * corner.extend(1.0);
                assert!(p.x.abs() <= p.w * 1.000_001 && p.y.abs() <= p.w * 1.000_001 && p.z > 0.0 && p.z < p.w, "{p}");
            }
        }
        Ok(())
    }

    #[test]
    fn a_piece_that_fell_far_leaves_the_shadows_sharp() -> Result<(), GpuError> {
        let rest = Bounds { min: DVec3::splat(-1.0), max: DVec3::splat(1.0) };
        let texel = |down: f64| {
            let posed = rest.with(DVec3::new(0.0, -down, 0.0));
            record_lit(&camera(), 1.0, &Lit { rest, posed, instruments: false }).map(|frame| frame.shadow[2])
        };
        let (near, far, farther) = (texel(0.5)?, texel(100.0)?, texel(1e6)?);
        assert!(far < 4.0 * near && far > near && far == farther, "{near} {far} {farther}");
        Ok(())
    }

    #[test]
    fn degenerate_cameras_are_told_so() {
        let good = camera();
        assert!(record(&good).is_ok());
        for bad in [
            Camera { eye: good.target, ..good },
            Camera { up: DVec3::Z, ..good },
            Camera { fov_y: 0.0, ..good },
            Camera { fov_y: f64::NAN, ..good },
            Camera { eye: DVec3::NAN, ..good },
        ] {
            assert!(record(&bad).is_err(), "{bad:?}");
        }
    }
}
