//! The scalpel in a hand: presses and poses become one stroke.

use crate::scene::EditCommand;
use crate::surgery::BladePose;

/// A scalpel that is taken up, led and lifted. One stroke at a time; a stroke is one unit of undo.
#[derive(Clone, Copy, Debug, Default)]
pub struct Scalpel {
    cutting: bool,
    last: Option<BladePose>,
}

impl Scalpel {
    /// What the hand does now: where the blade is (`None`: not known, as when tracking is lost) and whether it cuts. `width`
    /// of the slit in metres counts at the beginning of a stroke. A stroke begins at the first known pose of a press, goes on
    /// over gaps in the tracking, and ends with the press. Poses are to come in order of time; one that equals the last is
    /// dropped, so that a hand at rest costs nothing.
    pub fn update(&mut self, pose: Option<BladePose>, pressed: bool, width: f64, out: &mut Vec<EditCommand>) {
        if !pressed {
            // the last word of the hand: where it lifted the blade
            self.follow(pose, out);
            self.lift(out);
            return;
        }
        let Some(pose) = pose.filter(|p| p.is_finite() && p.has_length()) else { return };
        if !self.cutting {
            self.cutting = true;
            out.push(EditCommand::StrokeBegin { width });
        }
        self.follow(Some(pose), out);
    }

    /// Ends the stroke where the blade was last, if one is in progress.
    pub fn lift(&mut self, out: &mut Vec<EditCommand>) {
        if self.cutting {
            out.push(EditCommand::StrokeEnd);
        }
        *self = Self::default();
    }

    /// True while a stroke is in progress.
    pub fn is_cutting(&self) -> bool {
        self.cutting
    }

    /// Where the blade was last in this stroke.
    pub fn last_pose(&self) -> Option<&BladePose> {
        self.last.as_ref()
    }

    fn follow(&mut self, pose: Option<BladePose>, out: &mut Vec<EditCommand>) {
        let Some(pose) = pose.filter(|p| self.cutting && p.is_finite() && p.has_length()) else { return };
        if self.last.is_none_or(|last| last.tip != pose.tip || last.base != pose.base) {
            out.push(EditCommand::StrokePose(pose));
            self.last = Some(pose);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn pose(t: f64, x: f64) -> BladePose {
        BladePose { t, tip: DVec3::new(x, 0.0, 0.0), base: DVec3::new(x, 1.0, 0.0) }
    }

    /// Commands as letters: b(egin), the x of a pose, e(nd).
    fn letters(commands: &[EditCommand]) -> String {
        let letter = |c: &EditCommand| match c {
            EditCommand::StrokeBegin { .. } => "b ".to_string(),
            EditCommand::StrokePose(p) => format!("{} ", p.tip.x),
            EditCommand::StrokeEnd => "e ".to_string(),
            other => format!("{other:?} "),
        };
        commands.iter().map(letter).collect()
    }

    #[test]
    fn a_press_is_one_stroke() {
        let (mut scalpel, mut out) = (Scalpel::default(), Vec::new());
        scalpel.update(Some(pose(0.0, 0.0)), false, 0.1, &mut out);
        assert!(out.is_empty(), "an idle hand says nothing");
        for (t, x) in [(0.1, 1.0), (0.2, 2.0), (0.3, 2.0), (0.4, 3.0)] {
            scalpel.update(Some(pose(t, x)), true, 0.1, &mut out);
        }
        assert!(scalpel.is_cutting() && scalpel.last_pose().is_some_and(|p| p.t == 0.4));
        scalpel.update(Some(pose(0.5, 4.0)), false, 0.1, &mut out);
        scalpel.update(Some(pose(0.6, 5.0)), false, 0.1, &mut out);
        assert_eq!(letters(&out), "b 1 2 3 4 e ");
        assert!(!scalpel.is_cutting());
    }

    #[test]
    fn a_stroke_survives_lost_tracking() {
        let (mut scalpel, mut out) = (Scalpel::default(), Vec::new());
        scalpel.update(None, true, 0.1, &mut out);
        assert!(out.is_empty(), "nowhere yet");
        scalpel.update(Some(pose(0.0, 1.0)), true, 0.1, &mut out);
        scalpel.update(None, true, 0.1, &mut out);
        scalpel.update(Some(BladePose { tip: DVec3::NAN, ..pose(0.1, 9.0) }), true, 0.1, &mut out);
        scalpel.update(Some(pose(0.2, 2.0)), true, 0.1, &mut out);
        scalpel.update(None, false, 0.1, &mut out);
        assert_eq!(letters(&out), "b 1 2 e ");
    }

    #[test]
    fn lifting_twice_ends_once() {
        let (mut scalpel, mut out) = (Scalpel::default(), Vec::new());
        scalpel.update(Some(pose(0.0, 1.0)), true, 0.1, &mut out);
        scalpel.lift(&mut out);
        scalpel.lift(&mut out);
        assert_eq!(letters(&out), "b 1 e ");
    }
}
