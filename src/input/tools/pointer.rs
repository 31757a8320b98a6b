//! The pointer on a picture: which button does what, and where that is on the tissue.
//!
//! | gesture | what it does |
//! |---|---|
//! | left drag from the tissue | tears; the wheel sets the depth, with shift or alt the lean |
//! | left drag from beside it, right drag, alt and left drag | turns the camera |
//! | middle drag, shift and right drag | shifts the picture |
//! | wheel | brings the point under the cursor nearer or farther |
//! | shift and left drag | draws a line and cuts along the plane through it and the eye; the pieces are closed |
//! | ctrl and left drag | grabs |
//! | squeeze key | squeezes what is under the cursor |

use super::blade::PointerBlade;
use super::forceps::{Forceps, Pinch, Squeeze};
use super::orbit::OrbitCamera;
use super::pick::{Hit, Picker, Ray};
use super::plane::{PlanePreview, plane_through};
use super::scalpel::Scalpel;
use crate::scene::{EditCommand, Scene, TissueId};
use glam::DVec3;

/// A button of a pointer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Button {
    /// The first.
    Left,
    /// The wheel's.
    Middle,
    /// The second.
    Right,
}

/// Keys that are held while a pointer acts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Modifiers {
    /// Shift.
    pub shift: bool,
    /// Control, or command where that is the custom.
    pub ctrl: bool,
    /// Alt, or option.
    pub alt: bool,
}

/// What the tools are set to, for a model of a given size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolSettings {
    /// Width of a slit, metres.
    pub width: f64,
    /// Depth of the blade, metres.
    pub depth: f64,
    /// Lean of the blade to the right, radians.
    pub tilt: f64,
    /// Radius of a grab, metres.
    pub grab_radius: f64,
    /// Diagonal of the model, metres: limits of the others scale with it.
    pub diagonal: f64,
}

impl ToolSettings {
    /// Largest lean either way, radians.
    pub const MOST_TILT: f64 = 1.2;

    /// What suits a model of this diagonal, metres.
    pub fn for_diagonal(diagonal: f64, width: f64) -> Self {
        Self { width, depth: 0.03 * diagonal, tilt: 0.0, grab_radius: 0.08 * diagonal, diagonal }
    }

    /// Least and largest depth, metres.
    pub fn depth_range(&self) -> [f64; 2] {
        [0.002 * self.diagonal, 0.6 * self.diagonal]
    }

    fn deepen(&mut self, notches: f64) {
        let [low, high] = self.depth_range();
        self.depth = (self.depth * 1.15f64.powf(notches)).clamp(low, high);
    }

    fn lean(&mut self, notches: f64) {
        self.tilt = (self.tilt + 0.1 * notches).clamp(-Self::MOST_TILT, Self::MOST_TILT);
    }
}

/// A place on the tissue that the pointer tore at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceSample {
    /// Where the pointer was, pixels from the top left of the picture.
    pub pixel: [f64; 2],
    /// Whose surface was there.
    pub tissue: TissueId,
    /// The point of the surface, tissue space at rest.
    pub rest: DVec3,
}

/// Where one stroke of the pointer went.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StrokeTrace {
    /// Its places on the tissue, in order.
    pub samples: Vec<TraceSample>,
}

/// What the tools show besides the tissue, model space.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Preview {
    /// Tip and base of the blade.
    pub blade: Option<[DVec3; 2]>,
    /// About where the blade has lately been going, metres; zero when it has just gone in.
    pub travel: DVec3,
    /// The plane that a line would cut.
    pub plane: Option<PlanePreview>,
    /// Ball in which tissue is held: middle and radius.
    pub held: Option<(DVec3, f64)>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Gesture {
    /// Where the blade last stood, and whether it began on skin as loaded.
    Tear {
        point: DVec3,
        normal: DVec3,
        skin: bool,
    },
    /// The pixel where the line begins.
    Plane {
        start: [f64; 2],
    },
    /// Where the tissue was taken hold of.
    Grab {
        point: DVec3,
    },
    Orbit,
    Pan,
}

/// Names of the pointer's grab and of its two fingertips.
const GRAB: u32 = 0x4d00;
const FINGERTIPS: [u32; 2] = [0x4d01, 0x4d02];
/// Radius of a fingertip, in grab radii.
const FINGERTIP: f64 = 0.7;
/// A line shorter than this many pixels is a click.
const LEAST_LINE: f64 = 4.0;
/// What a notch of the wheel does to the distance.
const ZOOM: f64 = 0.88;

/// A mouse or touchpad that looks at a scene through a camera. It says what is to be done; the scene stays as it is.
pub struct PointerTools {
    /// The camera.
    pub camera: OrbitCamera,
    /// What the tools are set to.
    pub settings: ToolSettings,
    size: [f64; 2],
    cursor: [f64; 2],
    picker: Picker,
    gesture: Option<(Button, Gesture)>,
    scalpel: Scalpel,
    /// See [`Preview::travel`].
    travel: DVec3,
    forceps: Forceps,
    squeeze: Squeeze,
    trace: StrokeTrace,
    traces: Vec<StrokeTrace>,
}

impl PointerTools {
    /// Tools at rest on a picture of `size` pixels.
    pub fn new(camera: OrbitCamera, settings: ToolSettings, size: [f64; 2]) -> Self {
        Self {
            camera,
            settings,
            size,
            cursor: [size[0] / 2.0, size[1] / 2.0],
            picker: Picker::default(),
            gesture: None,
            scalpel: Scalpel::default(),
            travel: DVec3::ZERO,
            forceps: Forceps::new(GRAB),
            squeeze: Squeeze::new(FINGERTIPS),
            trace: StrokeTrace::default(),
            traces: Vec::new(),
        }
    }

    /// The picture has another size now, pixels.
    pub fn resize(&mut self, size: [f64; 2]) {
        self.size = size;
    }

    /// A button went down at the cursor.
    pub fn press(&mut self, button: Button, keys: Modifiers, time_s: f64, scene: &Scene, out: &mut Vec<EditCommand>) {
        if self.gesture.is_some() {
            return; // one gesture at a time
        }
        let gesture = match button {
            Button::Middle => Some(Gesture::Pan),
            Button::Right if keys.shift => Some(Gesture::Pan),
            Button::Right => Some(Gesture::Orbit),
            Button::Left if keys.alt && keys.shift => Some(Gesture::Pan),
            Button::Left if keys.alt => Some(Gesture::Orbit),
            Button::Left if keys.ctrl => self.grab(scene, out),
            Button::Left if keys.shift => Some(Gesture::Plane { start: self.cursor }),
            Button::Left => self.pierce(time_s, scene, out).or(Some(Gesture::Orbit)),
        };
        self.gesture = gesture.map(|g| (button, g));
    }

    /// The cursor is at `pixel` now.
    pub fn moved(&mut self, pixel: [f64; 2], time_s: f64, scene: &Scene, out: &mut Vec<EditCommand>) {
        let by = [pixel[0] - self.cursor[0], pixel[1] - self.cursor[1]];
        self.cursor = pixel;
        match self.gesture {
            Some((_, Gesture::Orbit)) => self.camera.orbit(by, self.size),
            Some((_, Gesture::Pan)) => self.camera.pan(by, self.size),
            Some((_, Gesture::Grab { point })) => {
                let at = self.camera.on_plane(pixel, self.size, point);
                self.forceps.update(Some(at), true, self.settings.grab_radius, out);
            }
            Some((button, Gesture::Tear { point, normal, skin })) => {
                let gesture = self.lead(point, normal, skin, scene);
                self.gesture = Some((button, gesture));
                self.place_blade(time_s, out);
            }
            Some((_, Gesture::Plane { .. })) | None => {}
        }
    }

    /// A button was let go.
    pub fn release(&mut self, button: Button, out: &mut Vec<EditCommand>) {
        let Some((_, gesture)) = self.gesture.take_if(|g| g.0 == button) else { return };
        match gesture {
            Gesture::Tear { .. } => {
                self.scalpel.lift(out);
                self.traces.push(std::mem::take(&mut self.trace));
            }
            Gesture::Plane { start } => out.extend(self.plane_from(start).map(EditCommand::CutClosed)),
            Gesture::Grab { .. } => self.forceps.open(out),
            Gesture::Orbit | Gesture::Pan => {}
        }
    }

    /// The wheel turned by `notches`, away from the user: nearer; while tearing: deeper (leaning, with shift or alt).
    pub fn wheel(&mut self, notches: f64, keys: Modifiers, time_s: f64, scene: &Scene, out: &mut Vec<EditCommand>) {
        if !notches.is_finite() {
            return;
        }
        match self.gesture {
            Some((_, Gesture::Tear { .. })) => {
                if keys.shift || keys.alt {
                    self.settings.lean(notches);
                } else {
                    self.settings.deepen(-notches);
                }
                self.place_blade(time_s, out);
            }
            None | Some((_, Gesture::Plane { .. })) => self.zoom(ZOOM.powf(notches), scene),
            Some(_) => {}
        }
    }

    /// Zooms to the point under the cursor: the surface's, else the one at the target's distance.
    pub fn zoom(&mut self, factor: f64, scene: &Scene) {
        let on_plane = self.camera.on_plane(self.cursor, self.size, self.camera.target());
        let towards = self.hit(scene).map_or(on_plane, |h| h.point);
        self.camera.zoom(factor, Some(towards));
    }

    /// The squeeze key went down (or up): two fingertips close in from left and right on what is under the cursor.
    pub fn squeeze(&mut self, held: bool, time_s: f64, scene: &Scene, out: &mut Vec<EditCommand>) {
        if !held {
            self.squeeze.release(out);
        } else if !self.squeeze.is_held()
            && let Some(hit) = self.hit(scene)
        {
            let pinch = self.pinch(&hit, time_s, scene);
            self.squeeze.begin(pinch, out);
        }
    }

    /// Lets time pass for what moves by itself. Returns whether it goes on moving.
    pub fn tick(&mut self, time_s: f64, out: &mut Vec<EditCommand>) -> bool {
        self.squeeze.tick(time_s, out);
        self.squeeze.is_closing(time_s)
    }

    /// Drops whatever is in hand: the window lost the focus, or the user thought better of it. A stroke ends where it is, a
    /// plane does not cut.
    pub fn cancel(&mut self, out: &mut Vec<EditCommand>) {
        match self.gesture {
            Some((_, Gesture::Plane { .. })) => self.gesture = None,
            Some((button, _)) => self.release(button, out),
            None => {}
        }
        self.squeeze.release(out);
    }

    /// Another scene takes the place of the one that the tools worked on.
    pub fn forget(&mut self, out: &mut Vec<EditCommand>) {
        self.cancel(out);
        self.picker.clear();
        self.traces.clear();
    }

    /// Strokes that have ended since the last call.
    pub fn take_traces(&mut self) -> Vec<StrokeTrace> {
        std::mem::take(&mut self.traces)
    }

    /// True while a gesture, or a squeeze, is in progress.
    pub fn is_busy(&self) -> bool {
        self.gesture.is_some() || self.squeeze.is_held()
    }

    /// What is to be shown besides the tissue.
    pub fn preview(&mut self, scene: &Scene) -> Preview {
        let mut preview = Preview { blade: self.scalpel.last_pose().map(|p| [p.tip, p.base]), ..Preview::default() };
        if preview.blade.is_some() {
            preview.travel = self.travel;
        }
        if let Some((_, Gesture::Plane { start })) = self.gesture
            && let Some(plane) = self.plane_from(start)
        {
            self.picker.refresh(scene);
            let (eye, target) = (self.camera.eye(), self.camera.target());
            let [a, b] = [start, self.cursor].map(|p| self.camera.on_plane(p, self.size, target));
            preview.plane = Some(PlanePreview::new(&self.picker, scene, &plane, [eye, a, b]));
        }
        let radius = self.settings.grab_radius;
        preview.held = self.forceps.held().map(|h| (h.1, radius));
        preview
    }

    /// What is under the cursor.
    pub fn hit(&mut self, scene: &Scene) -> Option<Hit> {
        self.picker.refresh(scene);
        self.picker.cast(scene, &self.camera.ray(self.cursor, self.size))
    }

    /// A squeeze of the tissue behind a hit: from its left and right side, half way through it.
    fn pinch(&self, hit: &Hit, time_s: f64, scene: &Scene) -> Pinch {
        let hair = 1e-6 * self.settings.diagonal;
        let exit = |origin: DVec3, direction: DVec3| {
            let inward = self.picker.cast(scene, &Ray { origin: origin + direction * hair, direction });
            inward.filter(|h| !h.outside).map(|h| h.distance)
        };
        let ahead = self.camera.ray(self.cursor, self.size).direction;
        let thickness = exit(hit.point, ahead).unwrap_or(self.settings.grab_radius);
        let (middle, across) = (hit.point + ahead * (0.5 * thickness), self.camera.axes()[0]);
        let reach = [across, -across].map(|way| exit(middle, way).unwrap_or(self.settings.grab_radius));
        Pinch { middle, across, reach, radius: FINGERTIP * self.settings.grab_radius, began_s: time_s }
    }

    fn plane_from(&self, start: [f64; 2]) -> Option<crate::geometry::Plane> {
        let [dx, dy] = [self.cursor[0] - start[0], self.cursor[1] - start[1]];
        if dx.hypot(dy) < LEAST_LINE {
            return None;
        }
        let target = self.camera.target();
        let [a, b] = [start, self.cursor].map(|p| self.camera.on_plane(p, self.size, target));
        plane_through(self.camera.eye(), a, b)
    }

    fn grab(&mut self, scene: &Scene, out: &mut Vec<EditCommand>) -> Option<Gesture> {
        let point = self.hit(scene)?.point;
        self.forceps.update(Some(point), true, self.settings.grab_radius, out);
        Some(Gesture::Grab { point })
    }

    fn pierce(&mut self, time_s: f64, scene: &Scene, out: &mut Vec<EditCommand>) -> Option<Gesture> {
        let hit = self.hit(scene)?;
        self.trace = StrokeTrace::default();
        self.travel = DVec3::ZERO;
        self.note(&hit, scene);
        let normal = if hit.outside { hit.normal } else { -hit.normal };
        let gesture = Gesture::Tear { point: hit.point, normal, skin: is_skin(&hit, scene) };
        self.gesture = Some((Button::Left, gesture));
        self.place_blade(time_s, out);
        Some(gesture)
    }

    /// Where the blade goes next: along the surface, or, where there is none, on across the picture at the same distance. What
    /// shows through the slit (the far side from within, a wall) is not the surface that the blade is led along.
    fn lead(&mut self, point: DVec3, normal: DVec3, skin: bool, scene: &Scene) -> Gesture {
        match self.hit(scene).filter(|h| h.outside && (!skin || is_skin(h, scene))) {
            Some(hit) => {
                self.note(&hit, scene);
                Gesture::Tear { point: hit.point, normal: hit.normal, skin }
            }
            None => Gesture::Tear { point: self.camera.on_plane(self.cursor, self.size, point), normal, skin },
        }
    }

    fn place_blade(&mut self, time_s: f64, out: &mut Vec<EditCommand>) {
        let Some((_, Gesture::Tear { point, normal, .. })) = self.gesture else { return };
        let ToolSettings { depth, tilt, diagonal, width, .. } = self.settings;
        let blade = PointerBlade { depth, tilt, reach: (0.08 * diagonal).max(0.5 * depth) };
        let pose = blade.pose(time_s, point, normal, self.camera.axes()[0]);
        if let Some(last) = self.scalpel.last_pose() {
            // a hand trembles: what counts is where it has gone over the last few movements
            self.travel = self.travel * 0.85 + (pose.base - last.base);
        }
        self.scalpel.update(Some(pose), true, width, out);
    }

    fn note(&mut self, hit: &Hit, scene: &Scene) {
        let Some(tissue) = scene.tissue(hit.tissue) else { return };
        let rest = tissue.rest_positions();
        let corners = tissue.mesh().face(hit.face).map(|v| rest[v.index()]);
        let rest = corners.iter().zip(hit.weights).map(|(&p, w)| p * w).sum();
        self.trace.samples.push(TraceSample { pixel: self.cursor, tissue: hit.tissue, rest });
    }
}

/// True for a face of the model as it was loaded, whole or clipped; false for walls, floors and caps.
fn is_skin(hit: &Hit, scene: &Scene) -> bool {
    scene.tissue(hit.tissue).is_some_and(|t| !t.mesh().is_interior(hit.face))
}
