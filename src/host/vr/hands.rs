//! Tools in the hands: what two tracked hands do, turned into edit commands, and how they move the model about.
//!
//! | hand | trigger | squeeze |
//! |---|---|---|
//! | scalpel | tears, deeper the further it is pulled; with the plane tool, shows the plane and cuts on release | in tissue: a fist that squeezes |
//! | forceps | close on tissue | close on tissue |
//! | either, away from tissue | | takes hold of the model; both hands scale and turn it |
//!
//! Poses come in the room and leave in model space. A gesture that has begun goes on whatever the model does, and wherever the hand
//! points; while tools are at work the room does not turn.

use super::calibrate::{Pivot, Tip};
use super::haptics::Felt;
use super::input::{Hand, HandsInput};
use super::palm::PalmMenu;
use super::space::{Placement, Pose, SnapTurn};
use crate::config::VrSettings;
use crate::geometry::Plane;
use crate::input::tools::{Forceps, Pinch, Scalpel, Squeeze};
use crate::scene::{EditCommand, Scene};
use crate::surgery::BladePose;
use glam::DVec3;

/// What a hand holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tool {
    /// Tears and cuts.
    Scalpel,
    /// Grabs.
    Forceps,
}

/// Ids of grabs, apart from those of scripts and of the mouse. Two a hand for the fist, one for the forceps.
const GRABS: u32 = 0x5652_0000;
/// A trigger counts as pulled above the first and as let go below the second.
const PULLED: (f64, f64) = (0.15, 0.08);
/// From the grip to the near end of the blade. Metres in the room.
const HANDLE: f64 = 0.02;
/// Forceps take hold of particles within this. Metres in the room.
const JAWS: f64 = 0.03;
/// A fist closes from this far to either side. Metres in the room.
const FIST: f64 = 0.05;
/// Radius of its fingertips. Metres in the room.
const FINGER: f64 = 0.012;
/// A hand this near to the model's bounds squeezes tissue; farther away it takes hold of the model. Metres in the room.
const NEAR: f64 = 0.06;

/// A pull with hysteresis.
#[derive(Clone, Copy, Debug, Default)]
struct Pull {
    pulled: bool,
    /// What it was pulled for is over: it counts again once it has been let go.
    spent: bool,
}

impl Pull {
    fn update(&mut self, value: f64) -> bool {
        self.spent &= value > PULLED.1;
        self.pulled = !self.spent && value > if self.pulled { PULLED.1 } else { PULLED.0 };
        self.pulled
    }

    fn end(&mut self) {
        self.spent |= self.pulled;
        self.pulled = false;
    }
}

/// What one hand is in the middle of.
#[derive(Clone, Copy, Debug)]
struct Grip {
    tool: Tool,
    /// What it was in the last frame: bare fingers hold nothing.
    was: Tool,
    scalpel: Scalpel,
    forceps: Forceps,
    fist: Squeeze,
    tear: Pull,
    grab: Pull,
    /// The plane that is shown and cut on release, model space.
    plane: Option<(DVec3, DVec3)>,
    /// Where the hand took hold of the model, in the room.
    holds: Option<DVec3>,
    /// This squeeze began in tissue, so it stays one.
    squeezes: bool,
}

impl Grip {
    /// Ends what it is in the middle of.
    fn put_down(&mut self, out: &mut Vec<EditCommand>) {
        self.scalpel.lift(out);
        self.forceps.open(out);
        self.fist.release(out);
        (self.plane, self.holds, self.squeezes) = (None, None, false);
        self.tear.end();
        self.grab.end();
    }

    /// True while its tool is in the middle of something.
    fn is_at_work(&self) -> bool {
        self.scalpel.is_cutting() || self.forceps.held().is_some() || self.fist.is_held() || self.plane.is_some()
    }
}

/// What a hand holds and where, model space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held {
    /// What it is.
    pub tool: Tool,
    /// Its working end.
    pub tip: DVec3,
    /// Towards its other end: behind the fingers.
    pub base: DVec3,
    /// Unit, where a blade's edge points: down, in a hand held level.
    pub edge: DVec3,
    /// How far it is closed: 0 to 1.
    pub closed: f64,
    /// Fingers alone, without an instrument.
    pub bare: bool,
}

/// A frame's outcome.
#[derive(Clone, Debug, Default)]
pub struct HandsOutput {
    /// Edits, in order.
    pub commands: Vec<EditCommand>,
    /// What is in the hands.
    pub held: [Option<Held>; 2],
    /// The plane that would be cut: a point and its unit normal, model space.
    pub plane: Option<(DVec3, DVec3)>,
    /// Contacts; what was torn and severed is known after the edits.
    pub felt: Felt,
    /// The hand that edits, for whom tearing is felt.
    pub editing: Option<usize>,
    /// What came of a calibration that has just ended; a sentence where no tip was found.
    pub calibrated: Option<Result<Tip, String>>,
}

/// What a frame's hands work on.
#[derive(Clone, Copy)]
pub struct Around<'a> {
    /// The tissues.
    pub scene: &'a Scene,
    /// About where they are, model space: at least every position that is seen, if need be more.
    pub bounds: (DVec3, DVec3),
    /// The user's head, in the room.
    pub head: &'a Pose,
    /// Hands that point at the panel: their triggers are the panel's.
    pub on_panel: [bool; 2],
    /// Seconds since the last frame.
    pub step_s: f64,
}

/// Both hands and where the model stands.
#[derive(Clone, Debug)]
pub struct Hands {
    grips: [Grip; 2],
    settings: VrSettings,
    /// Of the diagonal.
    tear_width: f64,
    placement: Placement,
    snap: [SnapTurn; 2],
    plane_tool: bool,
    /// Places of the hands when they last began to hold the model, and the model's place then.
    held_from: Option<(Placement, [Option<DVec3>; 2])>,
    palm_menu: PalmMenu,
    /// Poses of the scalpel's hand while its tip is being calibrated.
    pivot: Option<Pivot>,
    time_s: f64,
}

impl Hands {
    /// The scalpel in the better hand, forceps in the other. `tear_width` is a fraction of the model's diagonal.
    pub fn new(settings: VrSettings, tear_width: f64, placement: Placement) -> Self {
        let tool = |hand: usize| if hand == settings.hand.hand() { Tool::Scalpel } else { Tool::Forceps };
        let grip = |hand: usize| {
            let id = GRABS + 3 * hand as u32;
            Grip {
                tool: tool(hand),
                was: tool(hand),
                scalpel: Scalpel::default(),
                forceps: Forceps::new(id),
                fist: Squeeze::new([id + 1, id + 2]),
                tear: Pull::default(),
                grab: Pull::default(),
                plane: None,
                holds: None,
                squeezes: false,
            }
        };
        Self {
            grips: [grip(0), grip(1)],
            settings,
            tear_width,
            placement,
            snap: [SnapTurn::default(); 2],
            plane_tool: false,
            held_from: None,
            palm_menu: PalmMenu::default(),
            pivot: None,
            time_s: 0.0,
        }
    }

    /// Where the model stands.
    pub fn placement(&self) -> &Placement {
        &self.placement
    }

    /// True if the scalpel cuts along planes.
    pub fn uses_plane(&self) -> bool {
        self.plane_tool
    }

    /// Goes over to cutting along planes, or back to tearing. What is in progress ends.
    pub fn use_plane(&mut self, on: bool, out: &mut Vec<EditCommand>) {
        if on != self.plane_tool {
            self.put_down(out);
            self.plane_tool = on;
        }
    }

    /// Brings a model with such bounds within reach of a head. What is in progress ends, or the tools would go through the tissue.
    pub fn recentre(&mut self, (low, high): (DVec3, DVec3), head: &Pose, out: &mut Vec<EditCommand>) {
        self.put_down(out);
        self.set_placement(Placement::within_reach(low, high, head));
    }

    /// Puts the model elsewhere, whatever the hands are in the middle of.
    pub fn set_placement(&mut self, placement: Placement) {
        self.placement = placement;
        self.held_from = None;
    }

    /// Changes the width of tears to come, a fraction of the model's diagonal, and the instruments' settings. Which hand holds
    /// what stays as it is.
    pub fn set_settings(&mut self, settings: &VrSettings, tear_width: f64) {
        self.settings = *settings;
        self.tear_width = tear_width;
    }

    /// From the grip to the instrument's tip, metres, in the hand's own frame.
    pub fn tip_offset(&self) -> [f64; 3] {
        self.settings.tip_offset
    }

    /// Begins to calibrate the tip, or gives it up: while it lasts, the scalpel's trigger gathers poses and tears nothing.
    pub fn calibrate(&mut self, on: bool, out: &mut Vec<EditCommand>) {
        self.put_down(out);
        self.pivot = on.then(Pivot::default);
    }

    /// The tool of a hand.
    pub fn tool(&self, hand: usize) -> Tool {
        self.grips[hand].tool
    }

    /// Exchanges the tools of the hands. What is in progress ends.
    pub fn swap_tools(&mut self, out: &mut Vec<EditCommand>) {
        self.put_down(out);
        let [left, right] = &mut self.grips;
        std::mem::swap(&mut left.tool, &mut right.tool);
    }

    /// The hands are somebody else's, or nobody's: what is in progress ends, and a trigger that is held when they come back, as one is
    /// that has just pressed on the runtime's menu, does nothing until it has been let go.
    pub fn step_away(&mut self, out: &mut Vec<EditCommand>) {
        self.put_down(out);
        self.grips.iter_mut().for_each(|grip| (grip.tear.spent, grip.grab.spent) = (true, true));
        self.palm_menu.look_away();
    }

    /// Ends everything that is in progress. A trigger that is held meanwhile is to be let go before it begins something else.
    pub fn put_down(&mut self, out: &mut Vec<EditCommand>) {
        self.grips.iter_mut().for_each(|grip| grip.put_down(out));
        self.held_from = None;
    }

    /// True while a stroke, a grab or a hold is in progress.
    pub fn is_busy(&self) -> bool {
        self.grips.iter().any(|grip| grip.is_at_work() || grip.holds.is_some())
    }

    /// Looks for gestures that stand for buttons: the palm of the bare left hand, shown to the head, and a pinch of it for the panel's.
    /// Call it before the panel and the tools take the input.
    pub fn gestures(&mut self, input: &mut HandsInput, head: &Pose) {
        let busy = self.grips[0].is_at_work() || self.grips[0].holds.is_some();
        input.menu |= self.palm_menu.frame(&mut input.hands[0], head, busy);
    }

    /// One frame.
    pub fn frame(&mut self, input: &HandsInput, around: &Around, out: &mut HandsOutput) {
        out.commands.clear();
        (out.held, out.plane, out.felt, out.editing) = ([None; 2], None, Felt::default(), None);
        out.calibrated = None;
        self.time_s += around.step_s;
        self.buttons(input, around, out);
        for hand in 0..2 {
            let mut state = input.hands[hand];
            // what has begun goes on while the hand passes before the panel
            if around.on_panel[hand] && !self.grips[hand].is_at_work() {
                state.tear = 0.0;
            }
            if self.grips[hand].tool == Tool::Scalpel && self.pivot.is_some() {
                self.turn_about_tip(&state, out);
                state.tear = 0.0;
            }
            self.hand(hand, &state, around, out);
        }
        self.move_model(&input.hands, around.head);
    }

    fn buttons(&mut self, input: &HandsInput, around: &Around, out: &mut HandsOutput) {
        for (pressed, command) in
            [(input.undo, EditCommand::Undo), (input.redo, EditCommand::Redo), (input.reset, EditCommand::Reset)]
        {
            if pressed {
                self.put_down(&mut out.commands);
                out.commands.push(command);
            }
        }
        if input.plane {
            self.use_plane(!self.plane_tool, &mut out.commands);
        }
        if input.recentre {
            self.recentre(around.bounds, around.head, &mut out.commands);
        }
    }

    fn hand(&mut self, hand: usize, state: &Hand, around: &Around, out: &mut HandsOutput) {
        let (scene, bounds) = (around.scene, around.bounds);
        let room = self.placement.length_to_model(1.0);
        let tool = if state.bare { Tool::Forceps } else { self.grips[hand].tool };
        if std::mem::replace(&mut self.grips[hand].was, tool) != tool {
            self.grips[hand].put_down(&mut out.commands);
        }
        let tear = self.grips[hand].tear.update(state.tear);
        let grab = self.grips[hand].grab.update(state.grab);
        let blade = state.grip.map(|grip| self.blade(&grip, state, tool));
        let grip_point = state.grip.map(|grip| self.placement.to_model(grip.position));
        out.held[hand] = blade.zip(state.grip).map(|(b, grip)| {
            let closed = if tool == Tool::Forceps { state.tear.max(state.grab) } else { state.tear };
            let edge = self.placement.pose_to_model(&grip).rotation * DVec3::NEG_Y;
            Held { tool, tip: b.tip, base: b.base, edge, closed, bare: state.bare }
        });
        let near =
            blade.zip(grip_point).is_some_and(|(blade, grip)| [blade.tip, grip].iter().any(|&p| within(p, bounds, NEAR * room)));
        if let Some(blade) = blade.filter(|b| within(b.tip, bounds, NEAR * room)) {
            out.felt.touches[hand] = scene.first_touch(&blade).is_some();
        }
        let begins = grab && !self.grips[hand].squeezes && self.grips[hand].holds.is_none();
        let grip = &mut self.grips[hand];
        if begins {
            grip.squeezes = near;
            grip.holds = if near { None } else { state.grip.map(|g| g.position) };
            self.held_from = None;
        }
        if !grab {
            if grip.holds.take().is_some() {
                self.held_from = None;
            }
            grip.squeezes = false;
        }
        let squeezes = grip.squeezes && grab;
        match tool {
            Tool::Forceps => {
                let closed = tear || squeezes;
                grip.forceps.update(blade.map(|b| b.tip), closed, JAWS * room, &mut out.commands);
                // what is torn is felt in the scalpel's hand
                if closed && out.editing.is_none() {
                    out.editing = Some(hand);
                }
            }
            Tool::Scalpel => {
                let width = self.width(scene);
                // the stroke that ends now is this hand's, too
                let was_cutting = self.grips[hand].scalpel.is_cutting();
                if self.plane_tool {
                    self.aim_plane(hand, blade, state, tear, out);
                } else {
                    self.grips[hand].scalpel.update(blade, tear, width, &mut out.commands);
                }
                if tear || was_cutting || self.grips[hand].scalpel.is_cutting() {
                    out.editing = Some(hand);
                }
                self.fist(hand, grip_point, state, squeezes, &mut out.commands);
            }
        }
    }

    /// Gathers poses while the trigger is held; the calibration ends when it is let go.
    fn turn_about_tip(&mut self, state: &Hand, out: &mut HandsOutput) {
        let Some(pivot) = &mut self.pivot else { return };
        match state.grip.filter(|_| state.tear > PULLED.0) {
            Some(grip) => pivot.add(&grip),
            None if pivot.count() > 0 => {
                let found = pivot.tip();
                if let Ok(tip) = found {
                    self.settings.tip_offset = tip.offset.to_array();
                }
                out.calibrated = Some(found);
                self.pivot = None;
            }
            None => {}
        }
    }

    /// The blade of a hand, model space. It goes deeper by the settings' reach as the trigger is pulled.
    fn blade(&self, grip: &Pose, state: &Hand, tool: Tool) -> BladePose {
        let offset = DVec3::from_array(self.settings.tip_offset);
        let along = offset.normalize_or(DVec3::NEG_Z);
        let deeper = if tool == Tool::Scalpel && !self.plane_tool { self.settings.reach * state.tear } else { 0.0 };
        // Bare fingers are their own tip.
        let tip = if state.bare { DVec3::ZERO } else { offset + along * deeper };
        let base = if state.bare { along * -HANDLE } else { along * HANDLE };
        let place = |local: DVec3| self.placement.to_model(grip.at(local));
        BladePose { t: self.time_s, tip: place(tip), base: place(base) }
    }

    /// Shows the plane of the blade's flat side while the trigger is held; cuts along it on release. A squeeze calls it off.
    fn aim_plane(&mut self, hand: usize, blade: Option<BladePose>, state: &Hand, held: bool, out: &mut HandsOutput) {
        let grip = &mut self.grips[hand];
        if state.grab > PULLED.0 {
            grip.plane = None;
            return;
        }
        if held {
            if let Some((blade, pose)) = blade.zip(state.grip) {
                let normal = self.placement.pose_to_model(&pose).rotation * DVec3::X;
                grip.plane = Some((blade.tip, normal));
            }
            out.plane = grip.plane;
        } else if let Some((point, normal)) = grip.plane.take() {
            out.commands.push(EditCommand::CutClosed(Plane::Equation { normal, offset: normal.dot(point) }));
            out.editing = Some(hand);
        }
    }

    fn fist(&mut self, hand: usize, point: Option<DVec3>, state: &Hand, closed: bool, out: &mut Vec<EditCommand>) {
        let room = self.placement.length_to_model(1.0);
        let placement = self.placement;
        let time_s = self.time_s;
        let fist = &mut self.grips[hand].fist;
        match (closed, fist.is_held()) {
            (true, false) => {
                if let Some((point, pose)) = point.zip(state.grip) {
                    let across = placement.pose_to_model(&pose).rotation * DVec3::X;
                    let pinch = Pinch { middle: point, across, reach: [FIST * room; 2], radius: FINGER * room, began_s: time_s };
                    fist.begin(pinch, out);
                }
            }
            (true, true) => fist.tick(time_s, out),
            (false, true) => fist.release(out),
            (false, false) => {}
        }
    }

    /// Carries, scales and turns the model with the hands that hold it; turns the user in steps.
    fn move_model(&mut self, hands: &[Hand; 2], head: &Pose) {
        let now = [0, 1].map(|h| self.grips[h].holds.and(hands[h].grip).map(|g| g.position));
        if now.iter().all(Option::is_none) {
            self.held_from = None;
        } else {
            let held = |from: &[Option<DVec3>; 2]| from.map(|f| f.is_some()) == now.map(|n| n.is_some());
            match self.held_from.filter(|(_, from)| held(from)) {
                None => self.held_from = Some((self.placement, now)),
                Some((start, [Some(a), Some(b)])) => {
                    if let [Some(c), Some(d)] = now {
                        self.placement = start.stretched([a, b], [c, d]);
                    }
                }
                Some((start, from)) => {
                    if let Some((from, to)) = from[0].zip(now[0]).or(from[1].zip(now[1])) {
                        self.placement = start.carried(from, to);
                    }
                }
            }
        }
        let at_work = self.grips.iter().any(Grip::is_at_work);
        for hand in 0..2 {
            let angle = self.snap[hand].turn(hands[hand].turn, self.settings.snap_turn);
            if angle != 0.0 && !at_work {
                self.placement = self.placement.turned_about(head.position, angle);
                self.held_from = None;
            }
        }
    }

    fn width(&self, scene: &Scene) -> f64 {
        let diagonal = scene.tissues().map(|(_, t)| t.diagonal()).fold(0.0, f64::max);
        self.tear_width * diagonal
    }
}

fn within(p: DVec3, (low, high): (DVec3, DVec3), margin: f64) -> bool {
    p.cmpge(low - margin).all() && p.cmple(high + margin).all()
}

#[cfg(test)]
#[path = "hands_tests.rs"]
mod tests;
