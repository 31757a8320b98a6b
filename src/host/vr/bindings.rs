//! The one action set, and the suggested binding of every action on every controller. One table: the code suggests from it
//! and docs/CONTROLS.md is printed from it.

use openxr::ExtensionSet;

/// What a user can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Act {
    /// Where the hand is.
    Grip,
    /// Where it points.
    Aim,
    /// Tear with the scalpel; close the forceps; press on the panel. 0 to 1.
    Tear,
    /// Close the fist: squeeze tissue, or take hold of the model. 0 to 1.
    Grab,
    /// Go over from tearing to cutting along a plane, and back.
    Plane,
    /// Open and close the panel.
    Menu,
    /// Take the last edit back.
    Undo,
    /// Do it again.
    Redo,
    /// Take everything back.
    Reset,
    /// Bring the model back within reach.
    Recentre,
    /// Turn in steps: left and right on a stick.
    Turn,
    /// The same on a pad that a thumb rests on: pressed at its side. Pressed in its middle it is a button.
    TurnPad,
    /// What the hand feels.
    Pulse,
}

/// How an action is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A pose.
    Pose,
    /// 0 to 1.
    Analog,
    /// On or off.
    Button,
    /// Two axes.
    Stick,
    /// Vibration.
    Output,
}

impl Act {
    /// All, in the order of the table.
    pub const ALL: [Self; 13] = [
        Self::Grip,
        Self::Aim,
        Self::Tear,
        Self::Grab,
        Self::Plane,
        Self::Menu,
        Self::Undo,
        Self::Redo,
        Self::Reset,
        Self::Recentre,
        Self::Turn,
        Self::TurnPad,
        Self::Pulse,
    ];

    /// The action's name for the runtime: lower case, without blanks.
    pub fn name(self) -> &'static str {
        match self {
            Self::Grip => "grip",
            Self::Aim => "aim",
            Self::Tear => "tear",
            Self::Grab => "grab",
            Self::Plane => "plane",
            Self::Menu => "menu",
            Self::Undo => "undo",
            Self::Redo => "redo",
            Self::Reset => "reset",
            Self::Recentre => "recentre",
            Self::Turn => "turn",
            Self::TurnPad => "turn_pad",
            Self::Pulse => "pulse",
        }
    }

    /// For people, in the runtime's binding page and in the documentation.
    pub fn title(self) -> &'static str {
        match self {
            Self::Grip => "Hand",
            Self::Aim => "Pointer",
            Self::Tear => "Tear, or close the forceps",
            Self::Grab => "Close the fist: squeeze, or hold the model",
            Self::Plane => "Cut along a plane, on and off",
            Self::Menu => "Panel, on and off",
            Self::Undo => "Undo",
            Self::Redo => "Redo",
            Self::Reset => "Reset the model",
            Self::Recentre => "Bring the model within reach",
            Self::Turn => "Snap turn",
            Self::TurnPad => "Snap turn, pressed at the side",
            Self::Pulse => "Vibration",
        }
    }

    /// How it is read.
    pub fn kind(self) -> Kind {
        match self {
            Self::Grip | Self::Aim => Kind::Pose,
            Self::Tear | Self::Grab => Kind::Analog,
            Self::Plane | Self::Menu | Self::Undo | Self::Redo | Self::Reset | Self::Recentre => Kind::Button,
            Self::Turn | Self::TurnPad => Kind::Stick,
            Self::Pulse => Kind::Output,
        }
    }

    /// True for a button that some controller has in the middle of the pad that turns the user at its sides.
    pub fn is_on_pad(self) -> bool {
        let clicks = |path: &str, pad: &str| !pad.is_empty() && path.strip_prefix(pad) == Some("/click");
        PROFILES.iter().any(|profile| {
            let pad = profile.rows.iter().find(|row| row.0 == Self::TurnPad);
            let mut buttons = profile.rows.iter().filter(|row| row.0 == self);
            pad.is_some_and(|pad| buttons.any(|row| clicks(row.1, pad.1) || clicks(row.2, pad.2)))
        })
    }
}

/// One row of a controller: the action, and its input on the left and on the right hand ("" where there is none).
pub type Row = (Act, &'static str, &'static str);

/// One controller.
pub struct Profile {
    /// For people.
    pub title: &'static str,
    /// The interaction profile's path.
    pub path: &'static str,
    /// The extension that brings it, for people; "" where the core does.
    pub extension: &'static str,
    /// True if the runtime has it.
    pub offered: fn(&ExtensionSet) -> bool,
    /// Bindings besides the poses and the vibration, which every controller has alike.
    pub rows: &'static [Row],
    /// True if it can vibrate.
    pub vibrates: bool,
}

impl Profile {
    /// All bindings: poses, rows, vibration.
    pub fn bindings(&self) -> impl Iterator<Item = Row> + '_ {
        let poses = [(Act::Grip, "input/grip/pose", "input/grip/pose"), (Act::Aim, "input/aim/pose", "input/aim/pose")];
        let pulse = self.vibrates.then_some((Act::Pulse, "output/haptic", "output/haptic"));
        poses.into_iter().chain(self.rows.iter().copied()).chain(pulse)
    }
}

fn core(_: &ExtensionSet) -> bool {
    true
}

/// The interaction profile of hands without a controller.
pub const BARE_HANDS: &str = "/interaction_profiles/ext/hand_interaction_ext";

const TRIGGERS: Row = (Act::Tear, "input/trigger/value", "input/trigger/value");
const SQUEEZES: Row = (Act::Grab, "input/squeeze/value", "input/squeeze/value");
const CLICKED_SQUEEZES: Row = (Act::Grab, "input/squeeze/click", "input/squeeze/click");
const STICKS: Row = (Act::Turn, "input/thumbstick", "input/thumbstick");
/// Buttons of a pair with X and Y on the left hand, A and B on the right, and sticks that can be pressed.
const PAIR: [Row; 6] = [
    (Act::Undo, "input/x/click", ""),
    (Act::Redo, "input/y/click", ""),
    (Act::Plane, "", "input/a/click"),
    (Act::Menu, "input/menu/click", "input/b/click"),
    (Act::Recentre, "input/thumbstick/click", ""),
    (Act::Reset, "", "input/thumbstick/click"),
];

/// Every controller that bindings are suggested for.
pub const PROFILES: [Profile; 8] = [
    Profile {
        title: "Simple controller",
        path: "/interaction_profiles/khr/simple_controller",
        extension: "",
        offered: core,
        vibrates: true,
        rows: &[(Act::Tear, "input/select/click", "input/select/click"), (Act::Menu, "input/menu/click", "input/menu/click")],
    },
    Profile {
        title: "Oculus Touch",
        path: "/interaction_profiles/oculus/touch_controller",
        extension: "",
        offered: core,
        vibrates: true,
        rows: &[TRIGGERS, SQUEEZES, STICKS, PAIR[0], PAIR[1], PAIR[2], PAIR[3], PAIR[4], PAIR[5]],
    },
    Profile {
        title: "Valve Index",
        path: "/interaction_profiles/valve/index_controller",
        extension: "",
        offered: core,
        vibrates: true,
        // its squeeze's value goes to 1 with a hand laid around it
        rows: &[
            TRIGGERS,
            (Act::Grab, "input/squeeze/force", "input/squeeze/force"),
            STICKS,
            (Act::Undo, "input/a/click", ""),
            (Act::Redo, "input/b/click", ""),
            (Act::Plane, "", "input/a/click"),
            (Act::Menu, "", "input/b/click"),
            (Act::Recentre, "input/thumbstick/click", ""),
            (Act::Reset, "", "input/thumbstick/click"),
        ],
    },
    Profile {
        title: "HTC Vive wand",
        path: "/interaction_profiles/htc/vive_controller",
        extension: "",
        offered: core,
        vibrates: true,
        rows: &[
            TRIGGERS,
            CLICKED_SQUEEZES,
            (Act::TurnPad, "input/trackpad", "input/trackpad"),
            (Act::Undo, "input/trackpad/click", ""),
            (Act::Plane, "", "input/trackpad/click"),
            (Act::Recentre, "input/menu/click", ""),
            (Act::Menu, "", "input/menu/click"),
        ],
    },
    Profile {
        title: "Windows Mixed Reality",
        path: "/interaction_profiles/microsoft/motion_controller",
        extension: "",
        offered: core,
        vibrates: true,
        rows: &[
            TRIGGERS,
            CLICKED_SQUEEZES,
            STICKS,
            (Act::Undo, "input/trackpad/click", ""),
            (Act::Plane, "", "input/trackpad/click"),
            (Act::Redo, "input/menu/click", ""),
            (Act::Menu, "", "input/menu/click"),
            (Act::Recentre, "input/thumbstick/click", ""),
            (Act::Reset, "", "input/thumbstick/click"),
        ],
    },
    Profile {
        title: "Pico Neo3",
        path: "/interaction_profiles/bytedance/pico_neo3_controller",
        extension: "XR_BD_controller_interaction",
        offered: |offered| offered.bd_controller_interaction,
        vibrates: true,
        rows: &[TRIGGERS, SQUEEZES, STICKS, PAIR[0], PAIR[1], PAIR[2], PAIR[3], PAIR[4], PAIR[5]],
    },
    Profile {
        title: "Pico 4",
        path: "/interaction_profiles/bytedance/pico4_controller",
        extension: "XR_BD_controller_interaction",
        offered: |offered| offered.bd_controller_interaction,
        vibrates: true,
        rows: &[TRIGGERS, SQUEEZES, STICKS, PAIR[0], PAIR[1], PAIR[2], PAIR[3], PAIR[4], PAIR[5]],
    },
    Profile {
        title: "Bare hands",
        path: BARE_HANDS,
        extension: "XR_EXT_hand_interaction",
        offered: |offered| offered.ext_hand_interaction,
        vibrates: false,
        rows: &[
            (Act::Tear, "input/pinch_ext/value", "input/pinch_ext/value"),
            (Act::Grab, "input/grasp_ext/value", "input/grasp_ext/value"),
        ],
    },
];

/// The table of docs/CONTROLS.md: a row an action, a column a controller, left hand and right hand.
pub fn markdown() -> String {
    let mut text = String::from("| action |");
    for profile in &PROFILES {
        text += &format!(" {} |", profile.title);
    }
    text += &format!("\n|---|{}\n", "---|".repeat(PROFILES.len()));
    for act in Act::ALL {
        text += &format!("| {} |", act.title());
        for profile in &PROFILES {
            text += &format!(" {} |", cell(profile, act));
        }
        text += "\n";
    }
    text
}

fn cell(profile: &Profile, act: Act) -> String {
    let Some((_, left, right)) = profile.bindings().find(|row| row.0 == act) else { return String::new() };
    let short =
        |path: &str| path.trim_start_matches("input/").trim_start_matches("output/").replace("_ext", "").replace('/', " ");
    match (left, right) {
        (l, r) if l == r => short(l),
        (l, "") => format!("left {}", short(l)),
        ("", r) => format!("right {}", short(r)),
        (l, r) => format!("left {}, right {}", short(l), short(r)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOCUMENT: &str = include_str!("../../../docs/CONTROLS.md");

    #[test]
    fn the_documentation_is_printed_from_the_table() {
        assert!(DOCUMENT.contains(&markdown()), "docs/CONTROLS.md lacks this table:\n{}", markdown());
        assert!(!DOCUMENT.contains(&markdown().replace("Undo", "Undone")));
        for profile in PROFILES.iter().filter(|p| !p.extension.is_empty()) {
            assert!(DOCUMENT.contains(profile.extension), "{}", profile.extension);
        }
    }

    #[test]
    fn every_controller_can_tear_and_no_input_does_two_things() {
        for profile in &PROFILES {
            for hand in 0..2 {
                let pick = |row: &Row| if hand == 0 { row.1 } else { row.2 };
                let mut inputs: Vec<&str> = profile.bindings().map(|row| pick(&row)).filter(|p| !p.is_empty()).collect();
                let all = inputs.len();
                inputs.sort_unstable();
                inputs.dedup();
                assert_eq!(inputs.len(), all, "{}: an input is bound twice", profile.title);
                let tears = profile.bindings().any(|row| row.0 == Act::Tear && !pick(&row).is_empty());
                assert!(tears, "{}: either hand can tear, so that left-handed use works", profile.title);
            }
        }
    }

    #[test]
    fn the_pad_of_the_wand_is_a_button_in_its_middle() {
        let on_pad: Vec<Act> = Act::ALL.into_iter().filter(|act| act.is_on_pad()).collect();
        assert_eq!(on_pad, [Act::Plane, Act::Undo]);
    }

    #[test]
    fn paths_are_of_the_right_kind() {
        for profile in &PROFILES {
            for (act, left, right) in profile.bindings() {
                for path in [left, right].into_iter().filter(|p| !p.is_empty()) {
                    let fits = match act.kind() {
                        Kind::Pose => path.ends_with("/pose"),
                        Kind::Analog => ["/value", "/force", "/click"].iter().any(|end| path.ends_with(end)),
                        Kind::Button => path.ends_with("/click"),
                        Kind::Stick => path.ends_with("/thumbstick") || path.ends_with("/trackpad"),
                        Kind::Output => path == "output/haptic",
                    };
                    assert!(fits, "{}: {act:?} on {path}", profile.title);
                }
            }
        }
    }
}
