//! A first look at many points: which of them a link from one point can reach through a strip.

use glam::{DVec3, Vec3A, Vec4};

/// How a point sees a strip: the directions, a cone of four planes through the point, one a lane; and how far it is off.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    pub(super) from: DVec3,
    /// Coordinates of the normals, which have unit length or, where a plane bounds nothing, none.
    pub normals: [Vec4; 3],
    /// A plane before the strip: its unit normal, away from the point, and how far the point is from it; zeros where there is none.
    pub before: [f32; 4],
    pub(super) slack: f32,
}

impl Sight {
    /// A point that every direction counts for.
    pub fn everywhere(from: DVec3) -> Self {
        Self { from, normals: [Vec4::ZERO; 3], before: [0.0; 4], slack: 0.0 }
    }

    /// How far below the planes a point within `radius` of the one that looks may seem and be on them: a thousand roundings.
    #[inline]
    pub fn slack(radius: f64) -> f32 {
        (-1e-4 * radius) as f32
    }

    /// False only if no link from the point to `p`, within its radius, can meet the strip. Says nothing where a known side stands
    /// in for geometry.
    #[inline]
    pub fn may_meet(&self, p: DVec3) -> bool {
        let ([x, y, z], d) = (self.normals, (p - self.from).as_vec3());
        let [nx, ny, nz, height] = self.before;
        nx * d.x + ny * d.y + nz * d.z >= height + self.slack
            && (x * d.x + y * d.y + z * d.z).cmpge(Vec4::splat(self.slack)).all()
    }

    /// [`Sight::may_meet`] for any point of a box.
    pub fn may_meet_box(&self, low: Vec3A, high: Vec3A) -> bool {
        let ([x, y, z], from) = (self.normals, self.from.as_vec3a());
        let (d, half) = (0.5 * (low + high) - from, 0.5 * (high - low));
        let most = x * d.x + y * d.y + z * d.z + (x.abs() * half.x + y.abs() * half.y + z.abs() * half.z);
        // roundings of places are those of the box's and the point's own size
        let doubt = 1e-6 * (low.abs().max(high.abs()) + from.abs()).element_sum();
        let [nx, ny, nz, height] = self.before;
        let n = Vec3A::new(nx, ny, nz);
        n.dot(d) + n.abs().dot(half) >= height + self.slack - doubt && most.cmpge(Vec4::splat(self.slack - doubt)).all()
    }
}
