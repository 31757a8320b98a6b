//! Hands over a sphere of 1 m, shown at 0.4 m: what they ask for and what comes of it.

use super::*;
use crate::config::Dexterity;
use crate::formats::load;
use crate::scene::{EditReport, SceneSettings};
use crate::surgery::SamplingSettings;
use crate::tissue::{Tissue, TissueSettings};
use glam::DQuat;

const STEP: f64 = 1.0 / 90.0;
const HEAD: Pose = Pose { position: DVec3::new(0.0, 1.6, 0.0), rotation: DQuat::IDENTITY };

struct Desk {
    scene: Scene,
    hands: Hands,
    input: HandsInput,
    output: HandsOutput,
    reports: Vec<EditReport>,
    on_panel: [bool; 2],
}

impl Desk {
    fn new(settings: VrSettings) -> Self {
        let model = load("sphere").expect("a bundled name");
        let rest: Vec<_> = model.mesh.live_vertices().map(|v| model.rows.rest(v)).collect();
        let settings_of_tissue = TissueSettings {
            particles: Some(crate::particles::ParticleSettings::for_count(&model.mesh, &rest, 60)),
            network: Default::default(),
            opening_s: 0.5,
            section_faces: 128,
            fade_s: 0.25,
        };
        let tissue = Tissue::new(model, &settings_of_tissue).expect("sound settings");
        let sampling = SamplingSettings::default();
        let scene = Scene::new(tissue, SceneSettings { sampling, sample_distance: None, sample_time: None });
        let (low, high) = scene.ground_bounds();
        let placement = Placement::within_reach(low, high, &HEAD);
        let away = Pose { position: DVec3::new(0.0, 1.0, 1.0), ..Pose::IDENTITY };
        let hand = Hand { grip: Some(away), aim: Some(away), ..Hand::default() };
        Self {
            scene,
            hands: Hands::new(settings, 0.02, placement),
            input: HandsInput { hands: [hand; 2], ..HandsInput::default() },
            output: HandsOutput::default(),
            reports: Vec::new(),
            on_panel: [false; 2],
        }
    }

    /// Puts a hand so that the tip of its instrument, trigger let go, is at a point of model space.
    fn tip(&mut self, hand: usize, at: DVec3) {
        let position = self.hands.placement().to_world(at) + DVec3::Z * 0.12;
        self.input.hands[hand].grip = Some(Pose { position, ..Pose::IDENTITY });
    }

    fn frame(&mut self) {
        let around =
            Around { scene: &self.scene, bounds: self.scene.ground_bounds(), head: &HEAD, on_panel: self.on_panel, step_s: STEP };
        self.hands.frame(&self.input, &around, &mut self.output);
        for command in self.output.commands.clone() {
            self.reports.extend(self.scene.edit(command));
        }
        self.scene.step(STEP);
    }

    /// Draws the tip across the front of the sphere with the trigger pulled so far, and lets go.
    fn stroke(&mut self, hand: usize, trigger: f64) {
        for i in 0..30 {
            self.tip(hand, DVec3::new(-0.15 + 0.01 * f64::from(i), 0.0, 0.45));
            self.input.hands[hand].tear = trigger;
            self.frame();
        }
        self.input.hands[hand].tear = 0.0;
        self.frame();
    }

    fn outcomes(&self) -> Vec<&'static str> {
        self.reports.iter().map(|r| r.outcome.as_str()).collect()
    }
}

#[test]
fn the_scalpel_tears_where_it_is_led_and_deeper_with_more_trigger() {
    let area = |trigger: f64| {
        let mut desk = Desk::new(VrSettings::default());
        desk.stroke(1, trigger);
        assert_eq!(desk.outcomes(), ["torn"]);
        let lowest = desk.scene.last_tear_boxes().iter().flat_map(|b| b.corners()).map(|c| c.z);
        lowest.fold(f64::INFINITY, f64::min)
    };
    assert!(area(1.0) < area(0.3) - 0.02, "deeper with more trigger");
    let mut other = Desk::new(VrSettings::default());
    other.stroke(0, 1.0);
    assert!(other.outcomes().is_empty(), "the left hand holds forceps");
    let mut left = Desk::new(VrSettings { hand: Dexterity::Left, ..VrSettings::default() });
    left.stroke(0, 1.0);
    assert_eq!(left.outcomes(), ["torn"], "left-handed use");
}

#[test]
fn contact_is_felt_at_the_surface_only() {
    let mut desk = Desk::new(VrSettings::default());
    desk.tip(1, DVec3::new(0.0, 0.0, 0.6));
    desk.frame();
    assert!(!desk.output.felt.touches[1]);
    desk.tip(1, DVec3::new(0.0, 0.0, 0.4));
    desk.frame();
    assert!(desk.output.felt.touches[1] && !desk.output.felt.touches[0]);
}

#[test]
fn the_plane_tool_shows_its_plane_and_cuts_on_release_unless_called_off() {
    let mut desk = Desk::new(VrSettings::default());
    desk.input.plane = true;
    desk.frame();
    desk.input.plane = false;
    desk.tip(1, DVec3::new(0.1, 0.0, 0.4));
    desk.input.hands[1].tear = 1.0;
    desk.frame();
    let (point, normal) = desk.output.plane.expect("a preview");
    assert!(point.x - 0.1 < 1e-9 && normal.distance(DVec3::X) < 1e-9 && desk.reports.is_empty());
    desk.input.hands[1].grab = 1.0;
    desk.frame();
    desk.input.hands[1] = Hand { tear: 0.0, grab: 0.0, ..desk.input.hands[1] };
    desk.frame();
    assert!(desk.reports.is_empty(), "a squeeze calls it off");
    desk.input.hands[1].tear = 1.0;
    desk.frame();
    desk.input.hands[1].tear = 0.0;
    desk.frame();
    assert_eq!(desk.outcomes(), ["cut"]);
    assert_eq!(desk.reports[0].pieces.len(), 2);
}

#[test]
fn forceps_pull_and_a_fist_squeezes() {
    let mut desk = Desk::new(VrSettings::default());
    let moved = |desk: &Desk| {
        let displaced = desk.scene.tissues().filter_map(|(_, t)| t.layer()).flat_map(|l| l.displacements().to_vec());
        displaced.map(|u| u.length()).fold(0.0, f64::max)
    };
    for z in [0.5, 0.5, 0.55, 0.6, 0.65] {
        desk.tip(0, DVec3::new(0.0, 0.0, z));
        desk.input.hands[0].tear = 1.0;
        desk.frame();
    }
    assert!(moved(&desk) > 0.1 && desk.hands.is_busy());
    desk.input.hands[0].tear = 0.0;
    desk.frame();
    assert!(!desk.hands.is_busy());
    desk.tip(1, DVec3::new(0.0, 0.0, 0.4));
    desk.input.hands[1].grab = 1.0;
    desk.frame();
    assert!(desk.output.commands.iter().any(|c| matches!(c, EditCommand::PlaceCollider { .. })), "fingers close in");
    desk.input.hands[1].grab = 0.0;
    desk.frame();
    assert!(desk.output.commands.iter().any(|c| matches!(c, EditCommand::RemoveCollider { .. })) && !desk.hands.is_busy());
}

#[test]
fn hands_in_the_air_carry_scale_and_turn_the_model() {
    let mut desk = Desk::new(VrSettings::default());
    let before = *desk.hands.placement();
    let place = |desk: &mut Desk, left: DVec3, right: DVec3| {
        for (hand, at) in [left, right].into_iter().enumerate() {
            desk.input.hands[hand].grip = Some(Pose { position: at, ..Pose::IDENTITY });
        }
        desk.frame();
    };
    place(&mut desk, DVec3::new(-0.5, 1.3, 0.0), DVec3::new(0.5, 1.3, 0.0));
    desk.input.hands[1].grab = 1.0;
    desk.frame();
    place(&mut desk, DVec3::new(-0.5, 1.3, 0.0), DVec3::new(0.5, 1.4, 0.0));
    let carried = *desk.hands.placement();
    assert!((carried.position - before.position).distance(DVec3::Y * 0.1) < 1e-9 && carried.scale == before.scale);
    desk.input.hands[0].grab = 1.0;
    desk.frame();
    place(&mut desk, DVec3::new(-1.0, 1.35, 0.0), DVec3::new(1.0, 1.35, 0.0));
    assert!(desk.hands.placement().scale > 1.9 * before.scale);
    assert!(desk.output.commands.is_empty(), "the tissue is left alone");
    desk.input.hands[0].grab = 0.0;
    desk.input.hands[1].grab = 0.0;
    desk.frame();
    let still = *desk.hands.placement();
    place(&mut desk, DVec3::ZERO, DVec3::ONE);
    assert_eq!(*desk.hands.placement(), still, "nothing moves that is not held");
    desk.input.recentre = true;
    desk.frame();
    assert!((desk.hands.placement().scale - before.scale).abs() < 1e-12);
}

#[test]
fn the_panel_s_triggers_and_lost_focus_tear_nothing() {
    let mut desk = Desk::new(VrSettings::default());
    desk.on_panel[1] = true;
    desk.stroke(1, 1.0);
    assert!(desk.reports.is_empty());
    desk.on_panel[1] = false;
    for i in 0..10 {
        desk.tip(1, DVec3::new(-0.1 + 0.02 * f64::from(i), 0.0, 0.45));
        desk.input.hands[1].tear = 1.0;
        desk.frame();
    }
    let mut commands = Vec::new();
    desk.hands.step_away(&mut commands);
    assert!(matches!(commands[..], [EditCommand::StrokeEnd]) && !desk.hands.is_busy());
}

#[test]
fn a_trigger_that_is_held_when_the_hands_come_back_is_let_go_first() {
    let mut desk = Desk::new(VrSettings::default());
    let mut commands = Vec::new();
    desk.hands.step_away(&mut commands);
    desk.stroke(1, 1.0);
    assert!(commands.is_empty() && desk.reports.is_empty(), "it was pulled for the runtime's menu");
    desk.stroke(1, 1.0);
    assert_eq!(desk.outcomes(), ["torn"], "let go and pulled, it tears");
    // and so where a button ends what the trigger was in the middle of
    tearing(&mut desk, 1);
    desk.input.undo = true;
    desk.frame();
    desk.input.undo = false;
    let reports = desk.reports.len();
    desk.stroke(1, 1.0);
    assert_eq!(desk.reports.len(), reports, "{:?}", desk.outcomes());
    desk.stroke(1, 1.0);
    assert_eq!(desk.outcomes().last(), Some(&"torn"));
}

/// A bare left hand at a point of the room, its palm turned from the head by an angle, pinched so far; and whether the panel's
/// button is pressed.
fn show_palm(desk: &mut Desk, (position, off): (DVec3, f64), pinch: f64) -> bool {
    let palm = DQuat::from_rotation_y(off) * (HEAD.position - position).normalize();
    desk.input.hands[0] = Hand {
        grip: Some(Pose { position, ..Pose::IDENTITY }),
        tear: pinch,
        grab: 0.3 * pinch,
        bare: true,
        palm: Some(palm),
        ..Hand::default()
    };
    desk.input.menu = false;
    desk.hands.gestures(&mut desk.input, &HEAD);
    let menu = desk.input.menu;
    desk.frame();
    menu
}

const BEFORE_THE_FACE: DVec3 = DVec3::new(-0.1, 1.5, -0.4);

#[test]
fn a_pinch_of_the_palm_that_is_looked_at_is_the_panel_s_button() {
    let mut desk = Desk::new(VrSettings::default());
    let facing = (BEFORE_THE_FACE, 0.2);
    let pressed = [0.0, 0.2, 1.0, 1.0, 0.4, 1.0, 0.0, 1.0].map(|pinch| show_palm(&mut desk, facing, pinch));
    assert_eq!(pressed, [false, false, true, false, false, false, false, true], "once a pinch");
    assert!(!desk.hands.is_busy(), "and it closes no forceps");
    // a pinch that has begun is the panel's, also when the hand turns away
    assert!(!show_palm(&mut desk, (BEFORE_THE_FACE, 2.0), 1.0) && !desk.hands.is_busy());
    // one that lasts while the runtime's menu closes was meant for that
    show_palm(&mut desk, facing, 0.0);
    desk.hands.step_away(&mut Vec::new());
    let pressed = [1.0, 1.0, 0.0, 1.0].map(|pinch| show_palm(&mut desk, facing, pinch));
    assert_eq!(pressed, [false, false, false, true]);
}

#[test]
fn pinches_elsewhere_close_the_forceps_and_open_no_panel() {
    let beside = DVec3::new(-0.6, 1.2, 0.1);
    for (what, place) in [("turned away", (BEFORE_THE_FACE, 1.2)), ("out of sight", (beside, 0.0))] {
        let mut desk = Desk::new(VrSettings::default());
        let pressed = [0.0, 1.0, 1.0].map(|pinch| show_palm(&mut desk, place, pinch));
        assert!(pressed == [false; 3] && desk.hands.is_busy(), "{what}");
        // what the forceps hold they keep, whatever the palm does
        assert!(!show_palm(&mut desk, (BEFORE_THE_FACE, 0.0), 1.0) && desk.hands.is_busy(), "{what}");
        assert!(!show_palm(&mut desk, (BEFORE_THE_FACE, 0.0), 0.0) && !desk.hands.is_busy());
        assert!(show_palm(&mut desk, (BEFORE_THE_FACE, 0.0), 1.0), "the next pinch is the panel's");
    }
    let mut desk = Desk::new(VrSettings::default());
    for pinch in [0.0, 1.0] {
        show_palm(&mut desk, (BEFORE_THE_FACE, 0.0), pinch);
        // a controller is held in that very pose
        desk.input.hands[0] = Hand { bare: false, palm: None, tear: pinch, ..desk.input.hands[0] };
        desk.input.menu = false;
        desk.hands.gestures(&mut desk.input, &HEAD);
        assert!(!desk.input.menu && desk.input.hands[0].tear == pinch);
    }
}

/// The blade in the front of the sphere, some way along a stroke.
fn tearing(desk: &mut Desk, hand: usize) {
    for i in 0..10 {
        desk.tip(hand, DVec3::new(-0.1 + 0.02 * f64::from(i), 0.0, 0.45));
        desk.input.hands[hand].tear = 1.0;
        desk.frame();
    }
    assert!(desk.hands.is_busy());
}

#[test]
fn nothing_jumps_while_the_blade_is_at_work() {
    let mut desk = Desk::new(VrSettings::default());
    tearing(&mut desk, 1);
    let before = *desk.hands.placement();
    desk.input.hands[1].turn = 1.0;
    desk.frame();
    assert_eq!(*desk.hands.placement(), before, "the room does not turn");
    // the hand passes before the panel: the stroke goes on
    desk.on_panel[1] = true;
    desk.frame();
    assert!(desk.reports.is_empty() && desk.hands.is_busy());
    desk.on_panel[1] = false;
    desk.input.hands[1].turn = 0.0;
    desk.input.recentre = true;
    desk.frame();
    assert_eq!(desk.outcomes(), ["torn"], "the stroke ends before the model comes back");
    desk.input.hands[1].tear = 0.0;
    desk.input.recentre = false;
    desk.frame();
    desk.input.hands[1].turn = 1.0;
    desk.frame();
    assert!((desk.hands.placement().yaw - before.yaw).abs() > 0.1, "afterwards it does");
}

#[test]
fn a_plane_is_not_cut_by_passing_before_the_panel() {
    let mut desk = Desk::new(VrSettings::default());
    let mut commands = Vec::new();
    desk.hands.use_plane(true, &mut commands);
    desk.tip(1, DVec3::new(0.1, 0.0, 0.4));
    desk.input.hands[1].tear = 1.0;
    desk.frame();
    desk.on_panel[1] = true;
    desk.frame();
    assert!(desk.reports.is_empty() && desk.output.plane.is_some() && desk.hands.uses_plane());
}

#[test]
fn a_controller_that_is_laid_down_ends_its_stroke() {
    let mut desk = Desk::new(VrSettings::default());
    tearing(&mut desk, 1);
    desk.input.hands[1].bare = true;
    desk.input.hands[1].tear = 0.0;
    desk.frame();
    assert_eq!(desk.outcomes(), ["torn"]);
    desk.tip(1, DVec3::new(0.3, 0.2, 0.3));
    desk.input.hands[1].bare = false;
    desk.frame();
    assert_eq!(desk.reports.len(), 1, "nothing is torn on the way back");
}

#[test]
fn tearing_is_felt_in_the_scalpel_s_hand_to_its_end() {
    for (hand, dexterity) in [(1, Dexterity::Right), (0, Dexterity::Left)] {
        let mut desk = Desk::new(VrSettings { hand: dexterity, ..VrSettings::default() });
        // the other hand's forceps are closed meanwhile
        desk.input.hands[1 - hand].tear = 1.0;
        tearing(&mut desk, hand);
        assert_eq!(desk.output.editing, Some(hand));
        desk.input.hands[hand].tear = 0.0;
        desk.frame();
        assert_eq!((desk.outcomes(), desk.output.editing), (vec!["torn"], Some(hand)), "what the end severs, too");
        desk.frame();
        assert_eq!(desk.output.editing, Some(1 - hand));
    }
}

#[test]
fn undo_ends_the_stroke_and_takes_it_back() {
    let mut desk = Desk::new(VrSettings::default());
    let hash = desk.scene.edit_hash();
    desk.stroke(1, 1.0);
    assert_ne!(desk.scene.edit_hash(), hash);
    desk.input.undo = true;
    desk.frame();
    assert_eq!(desk.scene.edit_hash(), hash);
}

#[test]
fn a_tip_is_calibrated_by_turning_about_it_and_nothing_is_torn_meanwhile() {
    let mut desk = Desk::new(VrSettings::default());
    let offset = DVec3::new(0.01, -0.02, -0.17);
    let mut commands = Vec::new();
    desk.hands.calibrate(true, &mut commands);
    // The point lies in the sphere: a blade would tear there.
    let point = desk.hands.placement().to_world(DVec3::new(0.0, 0.0, 0.45));
    let mut found = None;
    for i in 0..150 {
        let t = 0.08 * f64::from(i);
        let rotation = DQuat::from_euler(glam::EulerRot::YXZ, 0.5 * t.sin(), 0.5 * (1.3 * t).sin(), 0.5 * (0.7 * t).cos());
        desk.input.hands[1].grip = Some(Pose { position: point - rotation * offset, rotation });
        desk.input.hands[1].tear = if i < 140 { 1.0 } else { 0.0 };
        desk.frame();
        found = found.or(desk.output.calibrated.clone());
    }
    let tip = found.expect("it has ended").expect("found");
    assert!(tip.offset.distance(offset) < 1e-6 && desk.reports.is_empty(), "{tip:?} {:?}", desk.outcomes());
    let held = desk.output.held[1].expect("tracked");
    assert!(desk.hands.placement().to_world(held.tip).distance(point) < 1e-6, "the tip is where the point is");
    desk.tip(1, DVec3::new(0.0, 0.0, 0.45));
    desk.hands.calibrate(true, &mut commands);
    for tear in [1.0, 1.0, 0.0] {
        desk.input.hands[1].tear = tear;
        desk.frame();
    }
    assert!(desk.output.calibrated.as_ref().is_some_and(Result::is_err), "a hand that did not turn");
    desk.stroke(1, 1.0);
    assert_eq!(desk.outcomes(), ["torn"], "afterwards the trigger tears again");
}
