//! A camera that a hand turns, shifts and brings nearer.

use super::pick::Ray;
use crate::input::CameraPose;
use glam::{DQuat, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// A turntable around a target: up stays up. Angles in radians, lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrbitCamera {
    target: DVec3,
    distance: f64,
    yaw: f64,
    pitch: f64,
    fov_y: f64,
    /// Size of what is looked at: limits how near and how far.
    extent: f64,
}

/// Nearest and farthest distance, in extents.
const REACH: (f64, f64) = (0.02, 20.0);
/// The eye stays this far off the poles, radians.
const POLE: f64 = 0.02;

impl OrbitCamera {
    /// A camera at `pose`, about something of size `extent` metres. The pose's up is taken for +Y.
    pub fn new(pose: &CameraPose, extent: f64) -> Self {
        let back = pose.eye - pose.target;
        let distance = back.length();
        let back = back.normalize_or(DVec3::Z);
        let pitch = back.y.clamp(-1.0, 1.0).asin();
        let mut camera = Self { target: pose.target, distance, yaw: back.x.atan2(back.z), pitch, fov_y: pose.fov_y, extent };
        camera.turn(0.0, 0.0);
        camera.zoom(1.0, None);
        camera
    }

    fn rotation(&self) -> DQuat {
        DQuat::from_rotation_y(self.yaw) * DQuat::from_rotation_x(-self.pitch)
    }

    /// Where it is and where it looks.
    pub fn pose(&self) -> CameraPose {
        CameraPose { eye: self.eye(), target: self.target, up: DVec3::Y, fov_y: self.fov_y }
    }

    /// The eye.
    pub fn eye(&self) -> DVec3 {
        self.target + self.rotation() * DVec3::Z * self.distance
    }

    /// Unit vectors to the right and up in the picture, and towards the viewer.
    pub fn axes(&self) -> [DVec3; 3] {
        let turn = self.rotation();
        [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| turn * axis)
    }

    /// Turns about the target, radians: to the right and upwards.
    pub fn turn(&mut self, yaw: f64, pitch: f64) {
        if yaw.is_finite() && pitch.is_finite() {
            self.yaw = (self.yaw + yaw).rem_euclid(2.0 * PI);
            self.pitch = (self.pitch + pitch).clamp(POLE - FRAC_PI_2, FRAC_PI_2 - POLE);
        }
    }

    /// A drag by `by` pixels on a picture of `size` turns half a turn over its height.
    pub fn orbit(&mut self, by: [f64; 2], size: [f64; 2]) {
        let per_pixel = PI / size[1].max(1.0);
        self.turn(-by[0] * per_pixel, by[1] * per_pixel);
    }

    /// A drag by `by` pixels shifts the picture by as much, at the distance of the target.
    pub fn pan(&mut self, by: [f64; 2], size: [f64; 2]) {
        let metres = 2.0 * self.distance * (0.5 * self.fov_y).tan() / size[1].max(1.0);
        let [right, up, _] = self.axes();
        let shift = (up * by[1] - right * by[0]) * metres;
        if shift.is_finite() {
            self.target += shift;
        }
    }

    /// Brings everything nearer (`factor` below 1) or farther, so that `towards` stays where it is in the picture.
    pub fn zoom(&mut self, factor: f64, towards: Option<DVec3>) {
        if !(factor.is_finite() && factor > 0.0) {
            return;
        }
        let distance = (self.distance * factor).clamp(REACH.0 * self.extent, REACH.1 * self.extent);
        if let Some(p) = towards.filter(|p| p.is_finite()) {
            self.target = p + (self.target - p) * (distance / self.distance);
        }
        self.distance = distance;
    }

    /// The ray through a pixel (from the top left) of a picture of `size`.
    pub fn ray(&self, pixel: [f64; 2], size: [f64; 2]) -> Ray {
        let [right, up, back] = self.axes();
        let tan = (0.5 * self.fov_y).tan();
        let y = 1.0 - 2.0 * pixel[1] / size[1].max(1.0);
        let x = (2.0 * pixel[0] / size[0].max(1.0) - 1.0) * size[0] / size[1].max(1.0);
        Ray { origin: self.eye(), direction: (right * (x * tan) + up * (y * tan) - back).normalize() }
    }

    /// Where a pixel's ray meets the plane through `point` that faces the camera.
    pub fn on_plane(&self, pixel: [f64; 2], size: [f64; 2], point: DVec3) -> DVec3 {
        let ray = self.ray(pixel, size);
        let back = self.axes()[2];
        let depth = (point - ray.origin).dot(back) / ray.direction.dot(back);
        ray.origin + ray.direction * depth
    }

    /// The pixel that a point is seen at; `None` behind the eye.
    pub fn pixel_of(&self, point: DVec3, size: [f64; 2]) -> Option<[f64; 2]> {
        let [right, up, back] = self.axes();
        let to = point - self.eye();
        let depth = -to.dot(back);
        let scale = 0.5 * size[1] / ((0.5 * self.fov_y).tan() * depth);
        (depth > 0.0).then(|| [0.5 * size[0] + to.dot(right) * scale, 0.5 * size[1] - to.dot(up) * scale])
    }

    /// The middle of the picture.
    pub fn target(&self) -> DVec3 {
        self.target
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [f64; 2] = [800.0, 600.0];

    fn camera() -> OrbitCamera {
        let (eye, target) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.1, 0.2, 0.3));
        OrbitCamera::new(&CameraPose { eye, target, up: DVec3::Y, fov_y: 0.9 }, 1.0)
    }

    #[test]
    fn a_pose_comes_back() {
        let pose = camera().pose();
        assert!((pose.eye - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12, "{pose:?}");
        let [right, up, back] = camera().axes();
        assert!((right.cross(up) - back).length() < 1e-12 && up.y > 0.0 && right.y.abs() < 1e-12);
    }

    #[test]
    fn pixels_and_rays_agree() {
        let camera = camera();
        for pixel in [[0.0, 0.0], [400.0, 300.0], [790.0, 20.0]] {
            let ray = camera.ray(pixel, SIZE);
            let back = camera.pixel_of(ray.origin + ray.direction * 2.5, SIZE).unwrap();
            assert!((back[0] - pixel[0]).hypot(back[1] - pixel[1]) < 1e-9, "{back:?}");
            let p = camera.on_plane(pixel, SIZE, DVec3::ZERO);
            assert!(p.dot(camera.axes()[2]).abs() < 1e-12);
        }
        assert!(camera.pixel_of(camera.eye() + camera.axes()[2], SIZE).is_none(), "behind the eye");
        let up = camera.ray([400.0, 0.0], SIZE).direction.angle_between(camera.ray([400.0, 600.0], SIZE).direction);
        assert!((up - 0.9).abs() < 1e-12, "the whole height is the angle of view");
    }

    #[test]
    fn a_drag_to_the_right_brings_the_left_side_to_the_front() {
        let mut camera = camera();
        let before = camera.eye();
        let right = camera.axes()[0];
        camera.orbit([50.0, 0.0], SIZE);
        assert!((camera.eye() - before).dot(right) < 0.0);
        assert!(((camera.eye() - camera.target()).length() - (before - camera.target()).length()).abs() < 1e-12);
        for _ in 0..1000 {
            camera.orbit([0.0, 50.0], SIZE);
        }
        assert!(camera.axes()[1].y > 0.0, "never over the pole");
    }

    #[test]
    fn a_pan_moves_the_picture_with_the_hand() {
        let mut camera = camera();
        let target = camera.target();
        camera.pan([30.0, -20.0], SIZE);
        let pixel = camera.pixel_of(target, SIZE).unwrap();
        assert!((pixel[0] - 430.0).abs() < 1e-9 && (pixel[1] - 280.0).abs() < 1e-9, "{pixel:?}");
    }

    #[test]
    fn zooming_keeps_the_point_under_the_cursor() {
        let mut camera = camera();
        let pixel = [650.0, 120.0];
        let point = camera.on_plane(pixel, SIZE, DVec3::new(0.3, 0.0, 0.2));
        camera.zoom(0.7, Some(point));
        let after = camera.pixel_of(point, SIZE).unwrap();
        assert!((after[0] - pixel[0]).hypot(after[1] - pixel[1]) < 1e-9);
        for _ in 0..200 {
            camera.zoom(0.5, Some(point));
        }
        assert!((camera.eye() - camera.target()).length() > 0.0199, "it stops before the surface");
        camera.zoom(f64::NAN, None);
        camera.zoom(0.0, None);
        assert!(camera.eye().is_finite());
    }
}
