//! Plays a script: the frame's input from the clock.

use super::frame::{CameraPose, InputFrame};
use super::script::{ActionKind, Motion, Script};
use crate::geometry::Plane;
use crate::physics::{RigidPose, RigidShape};
use crate::scene::EditCommand;
use glam::{DQuat, DVec3};

/// Turns a script into one [`InputFrame`] a frame. Deterministic: time is frame number times step.
#[derive(Clone, Debug)]
pub struct ScriptPlayer {
    script: Script,
    /// Width of tears, metres.
    width: f64,
    camera: CameraPose,
    progress: Vec<Progress>,
}

/// How far an action has come.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Progress {
    begun: bool,
    ended: bool,
    /// Blade poses that were fed.
    fed: usize,
}

impl ScriptPlayer {
    /// A player with the scene's default tear `width` (metres) and a camera where the script names none.
    pub fn new(script: Script, width: f64, default_camera: CameraPose) -> Self {
        let mut camera = CameraPose {
            eye: script.camera.eye.unwrap_or(default_camera.eye),
            target: script.camera.target.unwrap_or(default_camera.target),
            up: script.camera.up,
            fov_y: script.camera.fov_y,
        };
        // A camera that looks along its up, as from straight above: away from z is up, or y if it looks along z.
        let sight = camera.target - camera.eye;
        let is_along = |up: DVec3| sight.cross(up).length_squared() <= 1e-24 * sight.length_squared() * up.length_squared();
        if is_along(camera.up) {
            camera.up = if is_along(DVec3::Z) { DVec3::Y } else { DVec3::NEG_Z };
        }
        let progress = vec![Progress::default(); script.actions.len()];
        Self { script, width, camera, progress }
    }

    /// Number of frames to play.
    pub fn frames(&self) -> usize {
        self.script.total_frames() as usize
    }

    /// The input of a frame. Frames are asked for in order, each once.
    pub fn frame(&mut self, frame: usize) -> InputFrame {
        let now = self.script.time_of(frame as u32);
        let mut input =
            InputFrame { time_s: now, step_s: self.script.step, camera: Some(self.camera_at(now)), ..InputFrame::default() };
        for i in 0..self.script.actions.len() {
            let at = self.script.actions[i].at;
            // a hair of tolerance, so that 0.5 s is frame 45 of 90 however the step was rounded
            if now + 1e-9 >= at && !self.progress[i].ended && !self.waits(i) {
                self.act(i, now, &mut input);
            }
        }
        input
    }

    /// An edit that falls into a tear waits until the blade is lifted: a stroke is one unit of undo.
    fn waits(&self, i: usize) -> bool {
        use ActionKind::{Cut, CutByBlade, Redo, Reset, Tear, Undo};
        let edits =
            |i: usize| matches!(self.script.actions[i].kind, Tear { .. } | Cut { .. } | CutByBlade { .. } | Undo | Redo | Reset);
        let tearing = |k: usize| {
            let progress = self.progress[k];
            matches!(self.script.actions[k].kind, Tear { .. }) && progress.begun && !progress.ended
        };
        edits(i) && (0..self.progress.len()).any(|k| k != i && tearing(k))
    }

    fn act(&mut self, i: usize, now: f64, input: &mut InputFrame) {
        let action = &self.script.actions[i];
        let progress = &mut self.progress[i];
        let local = now - action.at + 1e-9;
        let begins = !std::mem::replace(&mut progress.begun, true);
        let id = i as u32;
        match &action.kind {
            ActionKind::Tear { path } => {
                if begins {
                    input.commands.push(EditCommand::StrokeBegin { width: self.width });
                }
                let poses = path.poses();
                while progress.fed < poses.len() && poses[progress.fed].t <= local {
                    input.commands.push(EditCommand::StrokePose(poses[progress.fed]));
                    progress.fed += 1;
                }
                match poses.get(progress.fed) {
                    Some(next) if progress.fed > 0 => {
                        let last = poses[progress.fed - 1];
                        let t = now - action.at;
                        if t > last.t {
                            let u = (t - last.t) / (next.t - last.t);
                            input.commands.push(EditCommand::StrokePose(last.lerp(next, u)));
                        }
                    }
                    Some(_) => {}
                    None => {
                        input.commands.push(EditCommand::StrokeEnd);
                        progress.ended = true;
                    }
                }
            }
            ActionKind::Cut { plane, cap, bounded } => {
                let plane = Plane::Equation { normal: plane.normal, offset: plane.distance };
                input.commands.push(match &bounded[..] {
                    [] if *cap => EditCommand::CutClosed(plane),
                    [] => EditCommand::Cut(plane),
                    corners => EditCommand::CutBounded { plane, corners: corners.to_vec(), closed: *cap },
                });
                progress.ended = true;
            }
            ActionKind::CutByBlade { path, cap } => {
                let poses = path.poses().to_vec();
                input.commands.push(EditCommand::CutByBlade { poses, closed: *cap });
                progress.ended = true;
            }
            ActionKind::Grab { center, radius, until, moves } => {
                if begins {
                    input.commands.push(EditCommand::GrabBegin { id, center: *center, radius: *radius });
                }
                if now + 1e-9 >= *until {
                    input.commands.push(EditCommand::GrabEnd { id });
                    progress.ended = true;
                } else {
                    input.commands.push(EditCommand::GrabMove { id, by: Motion::sample(moves, DVec3::ZERO, local) });
                }
            }
            ActionKind::Undo => self.once(i, EditCommand::Undo, input),
            ActionKind::Redo => self.once(i, EditCommand::Redo, input),
            ActionKind::Reset => self.once(i, EditCommand::Reset, input),
            ActionKind::Show { layer, on } => {
                input.show.push((*layer, *on));
                progress.ended = true;
            }
            ActionKind::Poke { radius, until, path } => {
                let start = path.first().map_or(DVec3::ZERO, |m| m.to);
                let places = [Motion::sample(path, start, local)];
                let starts = if begins { &[start][..] } else { &[] };
                progress.ended = collide(input, i, *radius, [starts, &places], now + 1e-9 >= *until);
            }
            ActionKind::Squeeze { a, b, radius, until } => {
                let share = if *until > action.at { ((now - action.at) / (until - action.at)).clamp(0.0, 1.0) } else { 1.0 };
                // Up to where the spheres touch each other.
                let way = (b - a).normalize_or_zero() * (0.5 * (a.distance(*b) - 2.0 * radius)).max(0.0) * share;
                let starts = if begins { &[*a, *b][..] } else { &[] };
                progress.ended = collide(input, i, *radius, [starts, &[*a + way, *b - way]], now + 1e-9 >= *until);
            }
        }
    }

    fn once(&mut self, i: usize, command: EditCommand, input: &mut InputFrame) {
        input.commands.push(command);
        self.progress[i].ended = true;
    }

    /// The camera, turned about its target by the script's orbit.
    fn camera_at(&self, now: f64) -> CameraPose {
        let axis = self.camera.up.try_normalize().unwrap_or(DVec3::Y);
        let turn = DQuat::from_axis_angle(axis, self.script.camera.orbit * now);
        CameraPose { eye: self.camera.target + turn * (self.camera.eye - self.camera.target), ..self.camera }
    }
}

/// Rigid spheres of action `i` at `places`, or their end. Returns whether it is. One that appears goes from where it starts: it may have
/// come far by the first frame, and would stand in the tissue without having pushed it.
fn collide(input: &mut InputFrame, i: usize, radius: f64, [starts, places]: [&[DVec3]; 2], ends: bool) -> bool {
    let id = |k: usize| (2 * i + k) as u32;
    let place = |(k, at): (usize, &DVec3)| {
        let shape = RigidShape::Sphere { radius };
        EditCommand::PlaceCollider { id: id(k), shape, pose: RigidPose::at(*at) }
    };
    if ends {
        input.commands.extend((0..places.len()).map(|k| EditCommand::RemoveCollider { id: id(k) }));
    } else {
        input.commands.extend(starts.iter().enumerate().chain(places.iter().enumerate()).map(place));
    }
    ends
}
