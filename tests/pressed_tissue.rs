//! Bodies that press on tissue and stand still: what they hold comes to rest, slides to and fro no more, and sleeps (MATHS 4.4, 4.5).

mod common;

use common::models::{model, users_scene_with};
use glam::DVec3;
use incise::physics::{NetworkSettings, RigidPose, RigidShape};
use incise::scene::{EditCommand, Scene};

/// Seconds until what is pressed has to sleep.
const SETTLED_S: f64 = 20.0;

/// One way to press.
#[derive(Debug)]
struct Press {
    model: &'static str,
    network: NetworkSettings,
    step: f64,
    /// Ball and where it comes to, in diagonals from the middle; with another on the other side.
    radius: f64,
    way: DVec3,
    from_both_sides: bool,
}

/// Fractions that fill the unit cube evenly.
fn even(k: u32, dimension: usize) -> f64 {
    const STEPS: [f64; 6] = [0.858, 0.736_4, 0.632, 0.542_5, 0.465_6, 0.399_6];
    (0.5 + f64::from(k) * STEPS[dimension]).fract()
}

impl Press {
    fn new(k: u32) -> Self {
        let pick = |dimension, count: usize| (even(k, dimension) * count as f64) as usize;
        let (angle, y) = (std::f64::consts::TAU * even(k, 2), 2.0 * even(k, 3) - 1.0);
        let side = (1.0 - y * y).sqrt();
        Self {
            model: ["sphere", "heart", "beam"][k as usize % 3],
            network: [NetworkSettings::FIRM, NetworkSettings::SOFT, NetworkSettings::SPONGE][pick(0, 3)],
            step: [1.0 / 90.0, 1.0 / 60.0, 1.0 / 30.0, 0.07, 0.2, 1.0][pick(1, 6)],
            radius: 0.03 + 0.17 * even(k, 4),
            way: DVec3::new(side * angle.cos(), y, side * angle.sin()),
            from_both_sides: even(k, 5) < 0.4,
        }
    }

    fn scene(&self) -> Scene {
        let faces = if self.model == "sphere" { 768 } else { 3_000 };
        users_scene_with(model(self.model, faces), self.network, 0.1)
    }

    /// Presses, waits, and gives how many particles are awake at the end and how many are held.
    fn settle(&self, k: u32) -> [usize; 2] {
        let mut scene = self.scene();
        let (low, high) = scene.tissues().next().unwrap().1.bounds();
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let radius = self.radius * (high - low).length();
        // as far as the box around the model reaches, and a little into it, askew
        let reach = radius + 1.0 / (self.way / half).abs().max_element();
        let beside = 0.3 * even(k, 4) * radius * self.way.any_orthonormal_vector();
        let deep = (0.05 + 0.45 * even(k, 2)) * half.min_element();
        let (far, near) = (self.way * (reach + 0.2 * half.length()), self.way * (reach - deep) + beside);
        for n in 0..(SETTLED_S / self.step) as u32 {
            let t = f64::from(n) * self.step;
            scene.pose(t, 0.0);
            let by = far.lerp(near, ((t - 0.2) / 0.4).clamp(0.0, 1.0));
            let sides = if self.from_both_sides { 2 } else { 1 };
            for (id, by) in [(1, by), (2, -by)].into_iter().take(sides) {
                let (shape, pose) = (RigidShape::Sphere { radius }, RigidPose::at(middle + by));
                scene.edit(EditCommand::PlaceCollider { id, shape, pose });
            }
            scene.step(self.step);
        }
        let tissue = scene.tissues().next().unwrap().1;
        [tissue.layer().unwrap().network.awake_particles(), tissue.contact_count()]
    }
}

#[test]
fn what_a_still_body_presses_comes_to_rest() {
    let mut pressed = 0;
    for k in 0..120 {
        let press = Press::new(k);
        let [awake, held] = press.settle(k);
        assert_eq!(awake, 0, "{k}: {press:?}, {held} held");
        pressed += usize::from(held > 2);
    }
    assert!(pressed > 60, "{pressed} of 120 were pressed");
}
