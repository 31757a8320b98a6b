//! Forceps that take hold of tissue and pull it, and fingers that squeeze it.

use crate::physics::{RigidPose, RigidShape};
use crate::scene::EditCommand;
use glam::DVec3;

/// Forceps: what they close on follows them until they open.
#[derive(Clone, Copy, Debug)]
pub struct Forceps {
    id: u32,
    /// Where they closed, and where they were last.
    held: Option<(DVec3, DVec3)>,
}

impl Forceps {
    /// Forceps whose grabs are named `id`; two hands need two names.
    pub fn new(id: u32) -> Self {
        Self { id, held: None }
    }

    /// What the hand does now: where the jaws are (model space; `None`: not known) and whether they are closed. They take hold
    /// of what lies within `radius` metres at the first known point of a closing, and let go when they open.
    pub fn update(&mut self, point: Option<DVec3>, closed: bool, radius: f64, out: &mut Vec<EditCommand>) {
        if !closed {
            self.open(out);
            return;
        }
        let Some(point) = point.filter(|p| p.is_finite()) else { return };
        match &mut self.held {
            None => {
                out.push(EditCommand::GrabBegin { id: self.id, center: point, radius });
                self.held = Some((point, point));
            }
            Some((start, last)) if *last != point => {
                out.push(EditCommand::GrabMove { id: self.id, by: point - *start });
                *last = point;
            }
            Some(_) => {}
        }
    }

    /// Lets go, if anything is held.
    pub fn open(&mut self, out: &mut Vec<EditCommand>) {
        if self.held.take().is_some() {
            out.push(EditCommand::GrabEnd { id: self.id });
        }
    }

    /// Where the jaws closed and where they are, while they hold.
    pub fn held(&self) -> Option<(DVec3, DVec3)> {
        self.held
    }
}

/// How long a squeeze takes to close, seconds.
const CLOSING_S: f64 = 0.4;

/// Two round fingertips that close in on each other across what lies between them, as long as they are held (MATHS 4.4).
#[derive(Clone, Copy, Debug)]
pub struct Squeeze {
    ids: [u32; 2],
    held: Option<Pinch>,
}

/// Where a squeeze happens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinch {
    /// A point within the tissue, model space.
    pub middle: DVec3,
    /// Unit, from the middle to the first fingertip.
    pub across: DVec3,
    /// From the middle to the surface, towards the first fingertip and towards the second, metres.
    pub reach: [f64; 2],
    /// Radius of a fingertip, metres.
    pub radius: f64,
    /// When it began, seconds.
    pub began_s: f64,
}

/// How much of the way to the middle the fingertips go.
const CLOSED: f64 = 0.45;

impl Pinch {
    /// Middles of the fingertips: at first they touch the surface from outside.
    fn fingertips(&self, time_s: f64) -> [DVec3; 2] {
        let u = ((time_s - self.began_s) / CLOSING_S).clamp(0.0, 1.0);
        let left = 1.0 - CLOSED * u * u * (3.0 - 2.0 * u);
        let [a, b] = self.reach.map(|reach| self.across * (reach * left + self.radius));
        [self.middle + a, self.middle - b]
    }
}

impl Squeeze {
    /// Fingertips whose rigid bodies are named `ids`.
    pub fn new(ids: [u32; 2]) -> Self {
        Self { ids, held: None }
    }

    /// Puts the fingertips down; they close in as time passes.
    pub fn begin(&mut self, pinch: Pinch, out: &mut Vec<EditCommand>) {
        self.held = Some(pinch);
        self.tick(pinch.began_s, out);
    }

    /// Closes the fingertips as far as they have come by `time_s`.
    pub fn tick(&mut self, time_s: f64, out: &mut Vec<EditCommand>) {
        let Some(pinch) = self.held else { return };
        for (id, place) in self.ids.into_iter().zip(pinch.fingertips(time_s)) {
            let shape = RigidShape::Sphere { radius: pinch.radius };
            out.push(EditCommand::PlaceCollider { id, shape, pose: RigidPose::at(place) });
        }
    }

    /// Lets go.
    pub fn release(&mut self, out: &mut Vec<EditCommand>) {
        if self.held.take().is_some() {
            out.extend(self.ids.map(|id| EditCommand::RemoveCollider { id }));
        }
    }

    /// True while the fingers hold.
    pub fn is_held(&self) -> bool {
        self.held.is_some()
    }

    /// True while they are still closing in.
    pub fn is_closing(&self, time_s: f64) -> bool {
        self.held.is_some_and(|p| time_s < p.began_s + CLOSING_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moves(commands: &[EditCommand], of: u32) -> Vec<DVec3> {
        let by = |c: &EditCommand| match c {
            EditCommand::GrabMove { id, by } if *id == of => Some(*by),
            _ => None,
        };
        commands.iter().filter_map(by).collect()
    }

    #[test]
    fn forceps_hold_from_closing_to_opening() {
        let (mut forceps, mut out) = (Forceps::new(7), Vec::new());
        forceps.update(Some(DVec3::X), false, 0.1, &mut out);
        assert!(out.is_empty());
        forceps.update(None, true, 0.1, &mut out);
        for x in [1.0, 1.0, 2.0, 4.0] {
            forceps.update(Some(DVec3::X * x), true, 0.1, &mut out);
        }
        forceps.update(None, true, 0.1, &mut out);
        forceps.update(Some(DVec3::X * 9.0), false, 0.1, &mut out);
        forceps.open(&mut out);
        assert!(matches!(out[0], EditCommand::GrabBegin { id: 7, center, radius } if center == DVec3::X && radius == 0.1));
        assert_eq!(moves(&out, 7), [DVec3::X, DVec3::X * 3.0], "by how much, from where they closed");
        assert!(matches!(out[3], EditCommand::GrabEnd { id: 7 }) && out.len() == 4);
    }

    #[test]
    fn fingertips_close_in_evenly_and_never_touch() {
        let (mut squeeze, mut out) = (Squeeze::new([1, 2]), Vec::new());
        let pinch = Pinch { middle: DVec3::ZERO, across: DVec3::X, reach: [0.3, 0.3], radius: 0.1, began_s: 10.0 };
        squeeze.begin(pinch, &mut out);
        for t in [10.1, 10.2, 10.5, 20.0] {
            squeeze.tick(t, &mut out);
        }
        assert!(squeeze.is_held() && squeeze.is_closing(10.1) && !squeeze.is_closing(10.5));
        squeeze.release(&mut out);
        squeeze.release(&mut out);
        let places = |of: u32| -> Vec<DVec3> {
            let place = |c: &EditCommand| match c {
                EditCommand::PlaceCollider { id, pose, .. } if *id == of => Some(pose.point(DVec3::ZERO)),
                _ => None,
            };
            out.iter().filter_map(place).collect()
        };
        let (a, b) = (places(1), places(2));
        assert_eq!((a.len(), b.len()), (5, 5));
        assert!(a.iter().zip(&b).all(|(a, b)| *a == -*b && a.distance(*b) > 0.2));
        assert!((a[0].x - 0.4).abs() < 1e-12 && a.windows(2).take(3).all(|w| w[1].x < w[0].x) && a[3] == a[4]);
        assert_eq!(out.iter().filter(|c| matches!(c, EditCommand::RemoveCollider { .. })).count(), 2);
    }
}
