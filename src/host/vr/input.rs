//! The action set in use: what the hands do in a frame, read from the runtime.

use super::bindings::{Act, BARE_HANDS, Kind, PROFILES};
use super::error::{Named, VrError};
use super::runtime::Runtime;
use super::space::Pose;
use glam::DVec3;
use openxr as xr;

/// One hand in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hand {
    /// Where it is, in the room; `None`: not tracked.
    pub grip: Option<Pose>,
    /// Where it points.
    pub aim: Option<Pose>,
    /// Trigger, or pinch: 0 to 1.
    pub tear: f64,
    /// Squeeze, or fist: 0 to 1.
    pub grab: f64,
    /// Stick to the right: -1 to 1.
    pub turn: f64,
    /// True if no controller is held.
    pub bare: bool,
    /// Of a bare hand: the unit normal that the palm looks along, in the room.
    pub palm: Option<DVec3>,
}

/// Both hands in a frame, left first, and the buttons that went down in it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HandsInput {
    /// Left, right.
    pub hands: [Hand; 2],
    /// Go over to cutting along a plane, or back.
    pub plane: bool,
    /// Open or close the panel.
    pub menu: bool,
    /// Undo.
    pub undo: bool,
    /// Redo.
    pub redo: bool,
    /// Reset.
    pub reset: bool,
    /// Bring the model within reach.
    pub recentre: bool,
}

/// The side of a pad begins this far from its middle; a thumb that presses the middle is seldom there.
const PAD_SIDE: f64 = 0.5;

/// The side of a pad that a thumb is at: -1 or 1; none in the middle.
fn side_of_pad(x: f64) -> Option<f64> {
    (x.abs() > PAD_SIDE).then(|| x.signum())
}

/// Fingertips nearer than this are a full pinch, farther than that are none. Metres.
const PINCH: (f64, f64) = (0.015, 0.04);

/// Where the palm looks in the frame of a palm joint: the back of the hand is up.
const JOINT_PALM: DVec3 = DVec3::NEG_Y;
/// The same in the frames of the left and of the right hand's grip: x goes out of the left palm and into the right one.
const GRIP_PALM: [DVec3; 2] = [DVec3::X, DVec3::NEG_X];

/// Actions of one kind, in the order of [`Act::ALL`].
struct Actions {
    poses: Vec<(Act, xr::Action<xr::Posef>)>,
    analogs: Vec<(Act, xr::Action<f32>)>,
    buttons: Vec<(Act, xr::Action<bool>)>,
    sticks: Vec<(Act, xr::Action<xr::Vector2f>)>,
    pulse: xr::Action<xr::Haptic>,
}

/// The action set of a session.
pub struct Input {
    set: xr::ActionSet,
    actions: Actions,
    hands: [xr::Path; 2],
    /// Grip and aim of each hand.
    spaces: [[xr::Space; 2]; 2],
    trackers: Option<[xr::HandTracker; 2]>,
    /// The interaction profile of bare hands, and the hands that the runtime says to have it.
    bare: (xr::Path, [bool; 2]),
    /// Buttons that are down, a bit an action.
    down: u16,
}

impl Input {
    /// Makes the actions, suggests bindings for every controller that the runtime knows, and attaches the set.
    pub fn new(runtime: &Runtime, session: &xr::Session<xr::Vulkan>) -> Result<Self, VrError> {
        let instance = &runtime.instance;
        let path = |text: &str| instance.string_to_path(text).named("a path");
        let hands = [path(xr::USER_HAND_LEFT)?, path(xr::USER_HAND_RIGHT)?];
        let set = instance.create_action_set("surgery", "Surgery", 0).named("an action set")?;
        let actions = Actions::new(&set, &hands)?;
        suggest(runtime, &actions)?;
        session.attach_action_sets(&[&set]).named("attaching the actions")?;
        let space = |act: Act, hand: usize| {
            let pose = &actions.poses.iter().find(|p| p.0 == act).expect("every pose has its action").1;
            pose.create_space(session, hands[hand], xr::Posef::IDENTITY).named("a hand's space")
        };
        let spaces = [[space(Act::Grip, 0)?, space(Act::Aim, 0)?], [space(Act::Grip, 1)?, space(Act::Aim, 1)?]];
        let tracker = |hand| session.create_hand_tracker(hand).ok();
        let trackers = if runtime.tracks_hands() {
            tracker(xr::Hand::LEFT).zip(tracker(xr::Hand::RIGHT)).map(|(left, right)| [left, right])
        } else {
            None
        };
        let bare = (path(BARE_HANDS)?, [false; 2]);
        Ok(Self { set, actions, hands, spaces, trackers, bare, down: 0 })
    }

    /// Asks which hands hold no controller. Call it when interaction profiles have changed.
    pub fn look_for_bare_hands(&mut self, session: &xr::Session<xr::Vulkan>) {
        let (profile, hands) = (self.bare.0, self.hands);
        self.bare.1 = hands.map(|hand| session.current_interaction_profile(hand).is_ok_and(|now| now == profile));
    }

    /// Asks the runtime for the actions' states. Call once a frame, before the frame begins.
    pub fn sync(&self, session: &xr::Session<xr::Vulkan>) -> Result<(), VrError> {
        session.sync_actions(&[xr::ActiveActionSet::new(&self.set)]).named("xrSyncActions")
    }

    /// The hands at `time`, in `base`, by the last [`Input::sync`]. Reads each button's edge, so call it once a frame.
    pub fn read(&mut self, session: &xr::Session<xr::Vulkan>, base: &xr::Space, time: xr::Time) -> Result<HandsInput, VrError> {
        let mut input = HandsInput { hands: self.hands(session, base, time)?, ..HandsInput::default() };
        let mut down = 0;
        for (index, &hand) in self.hands.iter().enumerate() {
            let pad = self.stick(Act::TurnPad, index, session)?;
            for (act, action) in &self.actions.buttons {
                let state = action.state(session, hand).named("a button")?;
                let is_down = state.is_active && state.current_state;
                match pad.and_then(side_of_pad).filter(|_| is_down && act.is_on_pad()) {
                    Some(side) => input.hands[index].turn = side,
                    None => down |= u16::from(is_down) << *act as u16,
                }
            }
        }
        let went_down = |act: Act| down & !self.down & (1 << act as u16) != 0;
        input.plane = went_down(Act::Plane);
        input.menu = went_down(Act::Menu);
        input.undo = went_down(Act::Undo);
        input.redo = went_down(Act::Redo);
        input.reset = went_down(Act::Reset);
        input.recentre = went_down(Act::Recentre);
        self.down = down;
        Ok(input)
    }

    /// Where the hands are and how far they close; no buttons.
    pub fn hands(&self, session: &xr::Session<xr::Vulkan>, base: &xr::Space, time: xr::Time) -> Result<[Hand; 2], VrError> {
        let mut hands = [Hand::default(); 2];
        for (index, hand) in hands.iter_mut().enumerate() {
            let [grip, aim] = &self.spaces[index];
            (hand.grip, hand.aim) = (located(grip, base, time)?, located(aim, base, time)?);
            hand.tear = self.analog(Act::Tear, index, session)?;
            hand.grab = self.analog(Act::Grab, index, session)?;
            hand.turn = self.stick(Act::Turn, index, session)?.unwrap_or(0.0);
            hand.bare = self.bare.1[index];
            hand.palm = hand.grip.filter(|_| hand.bare).map(|grip| grip.rotation * GRIP_PALM[index]);
            if let (true, Some(trackers)) = (hand.bare || hand.grip.is_none(), &self.trackers)
                && let Some(joints) = base.locate_hand_joints(&trackers[index], time).named("a hand's joints")?
                && let Some((pose, pinch)) = pinch(&joints)
            {
                // where the runtime tells of pinches itself, its word counts as well
                let (aim, tear) = (hand.aim.or(Some(pose)), hand.tear.max(pinch));
                let palm = Some(pose.rotation * JOINT_PALM);
                *hand = Hand { grip: Some(pose), aim, tear, bare: true, palm, ..*hand };
            }
        }
        Ok(hands)
    }

    /// How far a stick is pushed to the right, -1 to 1; none where the controller has no such stick.
    fn stick(&self, act: Act, hand: usize, session: &xr::Session<xr::Vulkan>) -> Result<Option<f64>, VrError> {
        let Some((_, action)) = self.actions.sticks.iter().find(|s| s.0 == act) else { return Ok(None) };
        let state = action.state(session, self.hands[hand]).named("a stick")?;
        let x = f64::from(state.current_state.x);
        Ok((state.is_active && x.is_finite()).then_some(x.clamp(-1.0, 1.0)))
    }

    fn analog(&self, act: Act, hand: usize, session: &xr::Session<xr::Vulkan>) -> Result<f64, VrError> {
        let mut most = 0.0f64;
        for (_, action) in self.actions.analogs.iter().filter(|a| a.0 == act) {
            let state = action.state(session, self.hands[hand]).named("a trigger")?;
            if state.is_active && state.current_state.is_finite() {
                most = most.max(f64::from(state.current_state).clamp(0.0, 1.0));
            }
        }
        Ok(most)
    }

    /// Vibrates a hand. A controller that cannot is no error.
    pub fn pulse(&self, session: &xr::Session<xr::Vulkan>, hand: usize, amplitude: f64, seconds: f64) -> Result<(), VrError> {
        let vibration = xr::HapticVibration::new()
            .amplitude(amplitude.clamp(0.0, 1.0) as f32)
            .frequency(xr::FREQUENCY_UNSPECIFIED)
            .duration(xr::Duration::from_nanos((seconds * 1e9) as i64));
        self.actions.pulse.apply_feedback(session, self.hands[hand], &vibration).named("a vibration")
    }
}

impl Actions {
    fn new(set: &xr::ActionSet, hands: &[xr::Path; 2]) -> Result<Self, VrError> {
        fn make<T: xr::ActionTy>(set: &xr::ActionSet, hands: &[xr::Path; 2], act: Act) -> Result<xr::Action<T>, VrError> {
            set.create_action::<T>(act.name(), act.title(), hands).named("an action")
        }
        let mut actions = Self {
            poses: Vec::new(),
            analogs: Vec::new(),
            buttons: Vec::new(),
            sticks: Vec::new(),
            pulse: make(set, hands, Act::Pulse)?,
        };
        for act in Act::ALL {
            match act.kind() {
                Kind::Pose => actions.poses.push((act, make(set, hands, act)?)),
                Kind::Analog => actions.analogs.push((act, make(set, hands, act)?)),
                Kind::Button => actions.buttons.push((act, make(set, hands, act)?)),
                Kind::Stick => actions.sticks.push((act, make(set, hands, act)?)),
                Kind::Output => {}
            }
        }
        Ok(actions)
    }

    fn binding(&self, act: Act, path: xr::Path) -> Option<xr::Binding<'_>> {
        fn find<T: xr::ActionTy>(list: &[(Act, xr::Action<T>)], act: Act) -> Option<&xr::Action<T>> {
            list.iter().find(|a| a.0 == act).map(|a| &a.1)
        }
        match act.kind() {
            Kind::Pose => find(&self.poses, act).map(|a| xr::Binding::new(a, path)),
            Kind::Analog => find(&self.analogs, act).map(|a| xr::Binding::new(a, path)),
            Kind::Button => find(&self.buttons, act).map(|a| xr::Binding::new(a, path)),
            Kind::Stick => find(&self.sticks, act).map(|a| xr::Binding::new(a, path)),
            Kind::Output => Some(xr::Binding::new(&self.pulse, path)),
        }
    }
}

/// Suggests the table's bindings. A controller whose paths a runtime refuses is left out with a warning; the others stand.
fn suggest(runtime: &Runtime, actions: &Actions) -> Result<(), VrError> {
    for profile in PROFILES.iter().filter(|p| (p.offered)(&runtime.extensions)) {
        let path = |text: &str| runtime.instance.string_to_path(text).named("a path");
        let mut bindings = Vec::new();
        for (act, left, right) in profile.bindings() {
            for (hand, input) in [(xr::USER_HAND_LEFT, left), (xr::USER_HAND_RIGHT, right)] {
                if !input.is_empty() {
                    bindings.extend(actions.binding(act, path(&format!("{hand}/{input}"))?));
                }
            }
        }
        if let Err(answer) = runtime.instance.suggest_interaction_profile_bindings(path(profile.path)?, &bindings) {
            tracing::warn!("{}: the runtime refused our bindings for it ({answer})", profile.title);
        }
    }
    Ok(())
}

/// A space's pose, if it is known.
pub fn located(space: &xr::Space, base: &xr::Space, time: xr::Time) -> Result<Option<Pose>, VrError> {
    let location = space.locate(base, time).named("a pose")?;
    let valid = xr::SpaceLocationFlags::POSITION_VALID | xr::SpaceLocationFlags::ORIENTATION_VALID;
    Ok(location.location_flags.contains(valid).then(|| Pose::from_xr(&location.pose)).flatten())
}

/// Between thumb and index finger, turned as the palm; and how far they close.
fn pinch(joints: &xr::HandJointLocations) -> Option<(Pose, f64)> {
    let joint = |joint: xr::HandJoint| {
        let location = &joints[joint];
        let valid = xr::SpaceLocationFlags::POSITION_VALID | xr::SpaceLocationFlags::ORIENTATION_VALID;
        location.location_flags.contains(valid).then(|| Pose::from_xr(&location.pose)).flatten()
    };
    let (thumb, index, palm) = (joint(xr::HandJoint::THUMB_TIP)?, joint(xr::HandJoint::INDEX_TIP)?, joint(xr::HandJoint::PALM)?);
    let apart = thumb.position.distance(index.position);
    let closed = ((PINCH.1 - apart) / (PINCH.1 - PINCH.0)).clamp(0.0, 1.0);
    Some((Pose { position: 0.5 * (thumb.position + index.position), rotation: palm.rotation }, closed))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    /// A tracked hand whose fingertips are so far apart, metres.
    fn joints(apart: f64) -> xr::HandJointLocations {
        let location_flags = xr::SpaceLocationFlags::POSITION_VALID | xr::SpaceLocationFlags::ORIENTATION_VALID;
        let palm = Pose { position: DVec3::new(0.1, 1.2, -0.2), rotation: DQuat::from_rotation_y(0.7) };
        let at = |position: DVec3| Pose { position, rotation: DQuat::IDENTITY }.to_xr();
        let mut all = [xr::HandJointLocation { location_flags, pose: palm.to_xr(), radius: 0.01 }; xr::HAND_JOINT_COUNT];
        all[xr::HandJoint::THUMB_TIP].pose = at(DVec3::new(0.1, 1.3, -0.3));
        all[xr::HandJoint::INDEX_TIP].pose = at(DVec3::new(0.1 + apart, 1.3, -0.3));
        all
    }

    #[test]
    fn a_pinch_closes_as_the_fingertips_meet_and_lies_between_them() {
        let closed = |apart: f64| pinch(&joints(apart)).expect("a tracked hand").1;
        assert_eq!([closed(0.1), closed(PINCH.1), closed(PINCH.0), closed(0.0)].map(|c| c.round()), [0.0, 0.0, 1.0, 1.0]);
        assert!((closed(0.5 * (PINCH.0 + PINCH.1)) - 0.5).abs() < 1e-4);
        let (pose, _) = pinch(&joints(0.02)).expect("a tracked hand");
        assert!(pose.position.distance(DVec3::new(0.11, 1.3, -0.3)) < 1e-6);
        assert!((pose.yaw() - 0.7).abs() < 1e-6, "turned as the palm");
    }

    #[test]
    fn a_pad_turns_at_its_sides_alone() {
        assert_eq!([-1.0, -0.6, -0.4, 0.0, 0.4, 0.6].map(side_of_pad), [Some(-1.0), Some(-1.0), None, None, None, Some(1.0)]);
    }

    #[test]
    fn a_hand_of_which_a_fingertip_is_not_seen_does_not_pinch() {
        for joint in [xr::HandJoint::THUMB_TIP, xr::HandJoint::INDEX_TIP, xr::HandJoint::PALM] {
            let mut unseen = joints(0.0);
            unseen[joint].location_flags = xr::SpaceLocationFlags::ORIENTATION_VALID;
            assert!(pinch(&unseen).is_none(), "{joint:?}");
        }
    }
}
