//! From where a frame is seen: any number of views, each with a place and an asymmetric angle of view, as a headset has them.
//!
//! Reverse depth with an infinite far plane: depth is 1 at the near plane and falls to 0 at infinity, so f32 depth is as fine
//! near the horizon as near the eye.

use super::camera::{Bounds, Camera};
use super::error::GpuError;
use super::types::View;
use glam::{DMat3, DMat4, DQuat, DVec3, DVec4};

/// Most views of one call: a uniform buffer's array. Call again for more.
pub const MOST_VIEWS: usize = 8;

/// Angles from the line of sight to the four edges of a picture, radians; `left` and `down` are negative where the edge lies
/// left of and below it, as OpenXR has them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fov {
    /// To the left edge.
    pub left: f64,
    /// To the right edge.
    pub right: f64,
    /// To the lower edge.
    pub down: f64,
    /// To the upper edge.
    pub up: f64,
}

impl Fov {
    /// The same to both sides: full vertical angle, and width over height.
    pub fn symmetric(fov_y: f64, aspect: f64) -> Self {
        let (x, y) = (((0.5 * fov_y).tan() * aspect).atan(), 0.5 * fov_y);
        Self { left: -x, right: x, down: -y, up: y }
    }

    /// Tangents: left, right, down, up.
    fn tangents(&self) -> [f64; 4] {
        [self.left, self.right, self.down, self.up].map(f64::tan)
    }
}

/// One eye. World space, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewPose {
    /// Where it is.
    pub position: DVec3,
    /// `world_from_eye`; the eye looks along its -z, its y is up.
    pub rotation: DQuat,
    /// Edges of the picture.
    pub fov: Fov,
    /// Distance of the near plane; there is no far plane.
    pub near: f64,
}

/// What one call draws: view `i` goes to layer `i` of the target.
#[derive(Clone, Copy, Debug)]
pub struct ViewSet<'a> {
    /// One to [`MOST_VIEWS`].
    pub views: &'a [ViewPose],
    /// True to leave out the pixels under [`super::Renderer::set_visibility_masks`].
    pub masked: bool,
}

impl<'a> ViewSet<'a> {
    /// Views without a mask.
    pub fn new(views: &'a [ViewPose]) -> Self {
        Self { views, masked: false }
    }
}

impl ViewPose {
    /// A camera as a view, for a picture of the given width over height. The near plane scales with the distance to the
    /// camera's target, so that millimetres and kilometres work alike. Errors: the camera looks nowhere.
    pub fn from_camera(camera: &Camera, aspect: f64) -> Result<Self, GpuError> {
        camera.check()?;
        let back = (camera.eye - camera.target).normalize();
        let right = camera.up.cross(back).normalize();
        let axes = DMat3::from_cols(right, back.cross(right), back);
        Ok(Self {
            position: camera.eye,
            rotation: DQuat::from_mat3(&axes).normalize(),
            fov: Fov::symmetric(camera.fov_y, aspect),
            near: 1e-3 * camera.eye.distance(camera.target),
        })
    }

    /// Unit, where it looks to.
    pub fn forward(&self) -> DVec3 {
        self.rotation * DVec3::NEG_Z
    }

    /// Errors: a number that is not finite, edges that cross or reach 90 degrees, a near plane that is not in front.
    pub fn check(&self) -> Result<(), GpuError> {
        let numbers = [self.fov.left, self.fov.right, self.fov.down, self.fov.up, self.near];
        if !self.position.is_finite() || !self.rotation.is_finite() || !numbers.iter().all(|n| n.is_finite()) {
            return Err(GpuError::BadCamera("a number is not finite"));
        }
        if (self.rotation.length_squared() - 1.0).abs() > 1e-3 {
            return Err(GpuError::BadCamera("the rotation of a view is not a unit quaternion"));
        }
        let quarter = std::f64::consts::FRAC_PI_2 - 1e-4;
        if numbers[..4].iter().any(|a| a.abs() > quarter) || self.fov.right <= self.fov.left || self.fov.up <= self.fov.down {
            return Err(GpuError::BadCamera("the edges of a view must lie within 90 degrees and not cross"));
        }
        if self.near <= 0.0 {
            return Err(GpuError::BadCamera("the near plane of a view must lie in front of it"));
        }
        Ok(())
    }

    /// World to clip space.
    pub fn clip_from_world(&self) -> DMat4 {
        let [l, r, d, u] = self.fov.tangents();
        let projection = DMat4::from_cols(
            DVec4::new(2.0 / (r - l), 0.0, 0.0, 0.0),
            DVec4::new(0.0, 2.0 / (u - d), 0.0, 0.0),
            DVec4::new((r + l) / (r - l), (u + d) / (u - d), 0.0, -1.0),
            DVec4::new(0.0, 0.0, self.near, 0.0),
        );
        projection * DMat4::from_rotation_translation(self.rotation, self.position).inverse()
    }

    /// True if some of the box may be in the picture, seen from here or from a little beside (a pose that comes late differs
    /// from the one that was culled by).
    pub fn may_see(&self, bounds: &Bounds) -> bool {
        if bounds.is_empty() {
            return false;
        }
        let clip = self.clip_from_world();
        let corners = bounds.corners().map(|c| clip * c.extend(1.0));
        let beyond = |outside: fn(&DVec4) -> bool| corners.iter().all(outside);
        !(beyond(|p| p.x > CULL_MARGIN * p.w.abs())
            || beyond(|p| p.x < -CULL_MARGIN * p.w.abs())
            || beyond(|p| p.y > CULL_MARGIN * p.w.abs())
            || beyond(|p| p.y < -CULL_MARGIN * p.w.abs())
            || beyond(|p| p.w < p.z * 0.5))
    }

    /// True if all of the box is in the picture.
    pub fn sees_whole(&self, bounds: &Bounds) -> bool {
        let clip = self.clip_from_world();
        let inside = |p: DVec4| p.x.abs() <= p.w && p.y.abs() <= p.w && p.z <= p.w;
        !bounds.is_empty() && bounds.corners().iter().all(|c| inside(clip * c.extend(1.0)))
    }

    /// What the shaders are told of a view that fills `size` pixels.
    pub(super) fn record(&self, size: (u32, u32)) -> View {
        let axis = |v: DVec3| (self.rotation * v).as_vec3().extend(0.0).to_array();
        let [l, r, d, u] = self.fov.tangents();
        View {
            clip_from_world: self.clip_from_world().as_mat4().to_cols_array_2d(),
            eye: self.position.as_vec3().extend(self.near as f32).to_array(),
            right: axis(DVec3::X),
            up: axis(DVec3::Y),
            forward: axis(DVec3::NEG_Z),
            lens: [0.5 * (r - l), 0.5 * (u - d), 0.5 * (r + l), 0.5 * (u + d)].map(|t| t as f32),
            size: [size.0 as f32, size.1 as f32, 1.0 / size.0 as f32, 1.0 / size.1 as f32],
        }
    }
}

/// How far outside the picture a box must lie to be left out, in half-widths from the middle: a pose may come late.
const CULL_MARGIN: f64 = 1.15;

/// Errors: no view, too many, or one that [`ViewPose::check`] refuses.
pub(super) fn check_views(views: &[ViewPose]) -> Result<(), GpuError> {
    if views.is_empty() || views.len() > MOST_VIEWS {
        return Err(GpuError::BadViews { views: views.len(), most: MOST_VIEWS });
    }
    views.iter().try_for_each(ViewPose::check)
}

/// Lowers the resolution when the GPU falls behind and raises it again when there is room, by drawing into a part of the
/// target. Works on times that it is told; has no clock.
#[derive(Clone, Copy, Debug)]
pub struct Resolution {
    floor: f64,
    scale: f64,
    calm: u32,
    settling: u32,
}

impl Resolution {
    /// At full size; never below `floor` (0 to 1) of it along each side.
    pub fn new(floor: f64) -> Self {
        let floor = if floor.is_finite() { floor.clamp(0.1, 1.0) } else { 1.0 };
        Self { floor, scale: 1.0, calm: 0, settling: 0 }
    }

    /// Share of the full width and height.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Takes the time a frame took on the GPU and the time there is. Pixels go with the square of the scale: above 90 % of the
    /// budget it falls at once to where 80 % are expected, below 65 % it rises by 4 % after half a second's frames. The frames that
    /// were under way when it fell tell of what was, and are left out.
    pub fn frame(&mut self, gpu_ms: f64, budget_ms: f64) {
        let load = gpu_ms / budget_ms;
        if !load.is_finite() || load <= 0.0 {
            return;
        }
        if self.settling > 0 {
            self.settling -= 1;
            return;
        }
        if load > 0.9 {
            self.calm = 0;
            self.settling = super::timing::FRAMES as u32;
            self.scale = (self.scale * (0.8 / load).sqrt().max(0.7)).max(self.floor);
        } else if load < 0.65 {
            self.calm += 1;
            if self.calm >= CALM_FRAMES {
                self.calm = 0;
                self.scale = (self.scale * 1.04).min(1.0);
            }
        } else {
            self.calm = 0;
        }
    }

    /// The part of a target of `full` pixels to draw into; a multiple of 8 a side, so that tiles stay whole.
    pub fn viewport(&self, full: (u32, u32)) -> (u32, u32) {
        let side = |n: u32| {
            let scaled = (f64::from(n) * self.scale) as u32;
            if self.scale >= 1.0 { n } else { (scaled.next_multiple_of(8)).clamp(1, n.max(1)) }
        };
        (side(full.0), side(full.1))
    }
}

const CALM_FRAMES: u32 = 45;

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dcamera::rh::{proj::directx::perspective_infinite_reverse, view::look_at_mat4};

    fn camera() -> Camera {
        Camera { eye: DVec3::new(1.0, 2.0, 3.0), target: DVec3::new(0.1, 0.2, -0.3), up: DVec3::Y, fov_y: 0.9 }
    }

    #[test]
    fn a_symmetric_view_is_the_usual_projection() -> Result<(), GpuError> {
        let camera = camera();
        let view = ViewPose::from_camera(&camera, 1.5)?;
        let usual = perspective_infinite_reverse(0.9, 1.5, view.near) * look_at_mat4(camera.eye, camera.target, camera.up);
        assert!(view.clip_from_world().abs_diff_eq(usual, 1e-12));
        let wider = ViewPose { fov: Fov { right: view.fov.right + 0.1, ..view.fov }, ..view };
        assert!(!wider.clip_from_world().abs_diff_eq(usual, 1e-3));
        Ok(())
    }

    #[test]
    fn the_edges_of_an_asymmetric_view_lie_on_the_picture_s_edges() -> Result<(), GpuError> {
        let fov = Fov { left: -0.9, right: 0.6, down: -0.7, up: 0.8 };
        let view = ViewPose { fov, ..ViewPose::from_camera(&camera(), 1.0)? };
        view.check()?;
        let at = |x: f64, y: f64| {
            let p = view.position + view.rotation * DVec3::new(x.tan(), y.tan(), -1.0) * 7.0;
            let clip = view.clip_from_world() * p.extend(1.0);
            (clip.x / clip.w, clip.y / clip.w, clip.z / clip.w)
        };
        let (x, y, z) = at(fov.left, fov.down);
        assert!((x + 1.0).abs() < 1e-12 && (y + 1.0).abs() < 1e-12 && (z - view.near / 7.0).abs() < 1e-12);
        let (x, y, _) = at(fov.right, fov.up);
        assert!((x - 1.0).abs() < 1e-12 && (y - 1.0).abs() < 1e-12);
        Ok(())
    }

    #[test]
    fn boxes_out_of_sight_are_told_from_those_in_sight() -> Result<(), GpuError> {
        let view = ViewPose::from_camera(&camera(), 1.0)?;
        let around = |p: DVec3, r: f64| Bounds { min: p - r, max: p + r };
        let ahead = view.position + view.forward() * 2.0;
        let right = view.rotation * DVec3::X;
        assert!(view.may_see(&around(ahead, 0.1)));
        assert!(view.may_see(&around(view.position, 1.0)), "the eye is inside");
        assert!(view.may_see(&around(ahead + right * 20.0, 40.0)), "large boxes reach in");
        assert!(!view.may_see(&around(view.position - view.forward() * 2.0, 0.1)), "behind");
        assert!(!view.may_see(&around(ahead + right * 4.0, 0.1)) && !view.may_see(&around(ahead - right * 4.0, 0.1)));
        assert!(!view.may_see(&Bounds::EMPTY));
        Ok(())
    }

    #[test]
    fn views_that_look_nowhere_are_refused() -> Result<(), GpuError> {
        let good = ViewPose::from_camera(&camera(), 1.0)?;
        assert!(good.check().is_ok() && check_views(&[good]).is_ok());
        for bad in [
            ViewPose { near: 0.0, ..good },
            ViewPose { position: DVec3::NAN, ..good },
            ViewPose { rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..good },
            ViewPose { fov: Fov { left: 0.7, right: -0.7, ..good.fov }, ..good },
            ViewPose { fov: Fov { up: 1.6, ..good.fov }, ..good },
        ] {
            assert!(bad.check().is_err(), "{bad:?}");
        }
        assert!(check_views(&[]).is_err() && check_views(&[good; MOST_VIEWS + 1]).is_err());
        Ok(())
    }

    #[test]
    fn resolution_falls_under_load_to_the_floor_and_comes_back() {
        let mut resolution = Resolution::new(0.6);
        resolution.frame(7.0, 10.0);
        assert_eq!((resolution.scale(), resolution.viewport((1001, 500))), (1.0, (1001, 500)));
        resolution.frame(12.0, 10.0);
        assert!(resolution.scale() < 0.83 && resolution.scale() > 0.8);
        let (x, y) = resolution.viewport((1000, 500));
        assert!(x < 1000 && y < 500 && x % 8 == 0);
        let fallen = resolution.scale();
        for _ in 0..crate::gpu::timing::FRAMES {
            resolution.frame(30.0, 10.0);
        }
        assert_eq!(resolution.scale(), fallen, "frames that were under way say nothing of the smaller picture");
        for _ in 0..20 {
            resolution.frame(30.0, 10.0);
        }
        assert_eq!(resolution.scale(), 0.6);
        for _ in 0..100 * CALM_FRAMES {
            resolution.frame(3.0, 10.0);
        }
        assert_eq!(resolution.scale(), 1.0);
        resolution.frame(f64::NAN, 10.0);
        resolution.frame(1.0, 0.0);
        assert_eq!(resolution.scale(), 1.0);
    }
}
