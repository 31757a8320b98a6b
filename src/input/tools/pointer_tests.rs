//! Gestures of a pointer against a real scene.

use super::test_scene::sphere;
use super::*;
use crate::input::CameraPose;
use crate::scene::{EditCommand, EditReport, Outcome, Scene};
use glam::DVec3;

const SIZE: [f64; 2] = [800.0, 600.0];
const NONE: Modifiers = Modifiers { shift: false, ctrl: false, alt: false };
const SHIFT: Modifiers = Modifiers { shift: true, ..NONE };
const CTRL: Modifiers = Modifiers { ctrl: true, ..NONE };

/// A user who does what tests say, and a scene that follows.
struct Desk {
    scene: Scene,
    tools: PointerTools,
    time_s: f64,
    reports: Vec<EditReport>,
    commands: Vec<EditCommand>,
}

impl Desk {
    fn new() -> Self {
        let scene = sphere();
        let pose = CameraPose { eye: DVec3::new(0.0, 0.0, 2.0), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.9 };
        let diagonal = scene.tissues().next().expect("one tissue").1.diagonal();
        let settings = ToolSettings::for_diagonal(diagonal, 0.01 * diagonal);
        let tools = PointerTools::new(OrbitCamera::new(&pose, diagonal), settings, SIZE);
        Self { scene, tools, time_s: 0.0, reports: Vec::new(), commands: Vec::new() }
    }

    /// What the tools said since the last call goes to the scene.
    fn follow(&mut self) {
        for command in self.commands.drain(..) {
            self.reports.extend(self.scene.edit(command));
        }
        self.time_s += 0.02;
        self.scene.pose(self.time_s, 0.0);
        self.scene.step(0.02);
    }

    fn press(&mut self, button: Button, keys: Modifiers) {
        self.tools.press(button, keys, self.time_s, &self.scene, &mut self.commands);
        self.follow();
    }

    fn to(&mut self, x: f64, y: f64) {
        self.tools.moved([x, y], self.time_s, &self.scene, &mut self.commands);
        self.follow();
    }

    fn release(&mut self, button: Button) {
        self.tools.release(button, &mut self.commands);
        self.follow();
    }

    fn wheel(&mut self, notches: f64, keys: Modifiers) {
        self.tools.wheel(notches, keys, self.time_s, &self.scene, &mut self.commands);
        self.follow();
    }

    fn drag(&mut self, button: Button, keys: Modifiers, from: [f64; 2], to: [f64; 2]) {
        self.to(from[0], from[1]);
        self.press(button, keys);
        for i in 1..=20 {
            let u = f64::from(i) / 20.0;
            self.to(from[0] + (to[0] - from[0]) * u, from[1] + (to[1] - from[1]) * u);
        }
        self.release(button);
    }
}

/// Largest distance of the trace's places from the nearest vertex that an edit has inserted, at rest.
fn farthest_from_a_lip(scene: &Scene, trace: &StrokeTrace) -> f64 {
    let far = |s: &TraceSample| {
        let tissue = scene.tissue(s.tissue).expect("still there");
        let inserted = tissue.mesh().live_vertices().filter(|v| !tissue.rows().rows.row(v.index()).is_empty());
        inserted.map(|v| tissue.rest_positions()[v.index()].distance(s.rest)).fold(f64::INFINITY, f64::min)
    };
    trace.samples.iter().map(far).fold(0.0, f64::max)
}

#[test]
fn a_drag_tears_where_the_pointer_went() {
    let mut desk = Desk::new();
    desk.drag(Button::Left, NONE, [330.0, 280.0], [460.0, 320.0]);
    assert_eq!(desk.reports.len(), 1);
    assert_eq!(desk.reports[0].outcome, Outcome::Torn);
    let traces = desk.tools.take_traces();
    assert_eq!(traces.len(), 1);
    assert!(traces[0].samples.len() > 15);
    let width = desk.tools.settings.width;
    let off = farthest_from_a_lip(&desk.scene, &traces[0]);
    assert!(off < 3.0 * width, "{off} of {width}");
    // the same law catches a wound elsewhere
    let mut elsewhere = traces[0].clone();
    elsewhere.samples.iter_mut().for_each(|s| s.rest += DVec3::Y * 0.1);
    assert!(farthest_from_a_lip(&desk.scene, &elsewhere) > 3.0 * width);
    assert!(!desk.tools.is_busy() && desk.tools.preview(&desk.scene) == Preview::default());
}

#[test]
fn a_pointer_that_goes_back_over_its_wound_stays_on_the_surface() {
    let mut desk = Desk::new();
    desk.to(340.0, 300.0);
    desk.press(Button::Left, NONE);
    for x in (340..460).chain((340..460).rev()).step_by(4) {
        desk.to(f64::from(x), 300.0);
        let [tip, _] = desk.tools.preview(&desk.scene).blade.expect("the blade is shown");
        assert!(tip.z > 0.3, "never at the far wall: {tip}");
    }
    desk.release(Button::Left);
    assert_eq!(desk.reports[0].outcome, Outcome::Torn);
}

#[test]
fn the_wheel_sets_depth_and_lean_while_tearing_and_zooms_otherwise() {
    let mut desk = Desk::new();
    let settings = desk.tools.settings;
    let eye = desk.tools.camera.eye();
    desk.to(400.0, 300.0);
    desk.press(Button::Left, NONE);
    desk.wheel(-3.0, NONE);
    assert!(desk.tools.settings.depth > 1.4 * settings.depth, "towards the user: deeper");
    desk.wheel(2.0, SHIFT);
    assert!(desk.tools.settings.tilt > 0.1);
    desk.wheel(1000.0, NONE);
    desk.wheel(1e9, SHIFT);
    assert_eq!(desk.tools.settings.depth, settings.depth_range()[0]);
    assert_eq!(desk.tools.settings.tilt, ToolSettings::MOST_TILT);
    assert_eq!(desk.tools.camera.eye(), eye);
    desk.release(Button::Left);
    desk.wheel(2.0, NONE);
    assert!(desk.tools.camera.eye().z < eye.z - 0.1, "nearer");
}

#[test]
fn a_shift_drag_shows_its_plane_and_cuts() {
    let mut desk = Desk::new();
    desk.to(100.0, 250.0);
    desk.press(Button::Left, SHIFT);
    assert!(desk.tools.preview(&desk.scene).plane.is_none(), "a point is no line");
    desk.to(700.0, 260.0);
    let plane = desk.tools.preview(&desk.scene).plane.expect("a preview");
    assert!(plane.contour.len() > 20);
    assert!(plane.outline.iter().all(|p| p.is_finite()));
    assert!(desk.reports.is_empty(), "nothing is cut yet");
    desk.release(Button::Left);
    assert_eq!(desk.reports[0].outcome, Outcome::Cut);
    assert_eq!(desk.reports[0].pieces.len(), 2);
    assert_eq!(desk.reports[0].caps.loops, 2, "one on each side");
    assert!(desk.reports[0].pieces.iter().all(|p| p.closed), "no piece is hollow");
    // the line was a little above the middle, so the upper piece is the smaller one
    assert!(desk.reports[0].pieces[0].side == 1 && desk.reports[0].pieces[0].area < desk.reports[0].pieces[1].area);
}

#[test]
fn a_cancelled_plane_does_not_cut_and_a_cancelled_stroke_ends() {
    let mut desk = Desk::new();
    desk.to(100.0, 250.0);
    desk.press(Button::Left, SHIFT);
    desk.to(700.0, 260.0);
    desk.tools.cancel(&mut desk.commands);
    desk.release(Button::Left);
    assert!(desk.reports.is_empty());
    desk.to(350.0, 300.0);
    desk.press(Button::Left, NONE);
    desk.to(400.0, 300.0);
    desk.to(450.0, 300.0);
    desk.tools.cancel(&mut desk.commands);
    desk.follow();
    assert_eq!(desk.reports.len(), 1);
    desk.release(Button::Left);
    desk.to(500.0, 300.0);
    assert_eq!(desk.reports.len(), 1, "the stroke is over");
}

#[test]
fn a_ctrl_drag_pulls_the_tissue_along() {
    let mut desk = Desk::new();
    let front = |scene: &Scene| {
        let tissue = scene.tissues().next().expect("one").1;
        let nearest = tissue
            .mesh()
            .live_vertices()
            .max_by(|a, b| tissue.rest_positions()[a.index()].z.total_cmp(&tissue.rest_positions()[b.index()].z));
        tissue.position(nearest.expect("vertices"))
    };
    let before = front(&desk.scene);
    desk.to(400.0, 300.0);
    desk.press(Button::Left, CTRL);
    desk.to(500.0, 300.0);
    assert!(desk.tools.preview(&desk.scene).held.is_some());
    for _ in 0..30 {
        desk.follow();
    }
    assert!(front(&desk.scene).x > before.x + 0.05, "{}", front(&desk.scene));
    desk.release(Button::Left);
    for _ in 0..500 {
        desk.follow();
    }
    assert!((front(&desk.scene) - before).length() < 1e-3 && desk.scene.is_asleep(), "it comes back");
}

#[test]
fn a_squeeze_narrows_the_tissue_and_lets_it_go() {
    let mut desk = Desk::new();
    let width = |scene: &Scene| {
        let tissue = scene.tissues().next().expect("one").1;
        let rest = tissue.rest_positions();
        let at = |side: f64| {
            let outermost =
                tissue.mesh().live_vertices().max_by(|a, b| (side * rest[a.index()].x).total_cmp(&(side * rest[b.index()].x)));
            tissue.position(outermost.expect("vertices")).x
        };
        at(1.0) - at(-1.0)
    };
    let before = width(&desk.scene);
    desk.to(400.0, 300.0);
    desk.tools.squeeze(true, desk.time_s, &desk.scene, &mut desk.commands);
    assert!(desk.tools.is_busy());
    let mut closing = true;
    for _ in 0..40 {
        closing = desk.tools.tick(desk.time_s, &mut desk.commands);
        desk.follow();
    }
    assert!(!closing && width(&desk.scene) < 0.9 * before, "{} of {before}", width(&desk.scene));
    desk.tools.squeeze(false, desk.time_s, &desk.scene, &mut desk.commands);
    for _ in 0..500 {
        desk.follow();
    }
    assert!((width(&desk.scene) - before).abs() < 1e-3 && !desk.tools.is_busy() && desk.scene.is_asleep());
}

#[test]
fn drags_beside_the_tissue_and_of_other_buttons_move_the_camera_only() {
    let mut desk = Desk::new();
    let hash = desk.scene.edit_hash();
    let target = desk.tools.camera.target();
    let mut eye = desk.tools.camera.eye();
    for (button, keys, from) in [
        (Button::Left, NONE, [30.0, 30.0]),
        (Button::Right, NONE, [400.0, 300.0]),
        (Button::Left, Modifiers { alt: true, ..NONE }, [400.0, 300.0]),
    ] {
        desk.drag(button, keys, from, [from[0] + 90.0, from[1]]);
        assert!((desk.tools.camera.eye() - eye).length() > 0.5);
        assert_eq!(desk.tools.camera.target(), target);
        eye = desk.tools.camera.eye();
    }
    desk.drag(Button::Middle, NONE, [400.0, 300.0], [500.0, 300.0]);
    assert!((desk.tools.camera.target() - target).length() > 0.1);
    assert!(desk.reports.is_empty() && desk.scene.edit_hash() == hash);
}

#[test]
fn one_gesture_at_a_time() {
    let mut desk = Desk::new();
    desk.to(380.0, 300.0);
    desk.press(Button::Left, NONE);
    let eye = desk.tools.camera.eye();
    desk.press(Button::Right, NONE);
    desk.to(420.0, 300.0);
    desk.release(Button::Right);
    assert_eq!(desk.tools.camera.eye(), eye);
    assert!(desk.tools.is_busy(), "the left button still tears");
    desk.to(440.0, 300.0);
    desk.release(Button::Left);
    assert_eq!(desk.reports.len(), 1);
}
