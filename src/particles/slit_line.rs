//! Strips as they are kept, where they lie in their slits, and which share an edge.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Strips back that one may go on from: where a blade turns about a point of its own, chains take turns.
const TURNS: usize = 8;

/// One strip: the quad that the blade swept between two samples, in rest space.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Strip {
    /// `tip0, tip1, base1, base0`, metres: the blade at the earlier sample is `tip0 - base0`, at the later `tip1 - base1`.
    /// Not extended.
    pub corners: [[f64; 3]; 4],
    /// Radius of influence `d` when the strip was made: it is tested extended by `d` above the base, `d / 4` below the tip at most. 0 for
    /// a blade in a wound that stood open: its strip is not extended.
    pub reach: f64,
    /// The slit it belongs to. Strips of a slit follow one another; each shares an edge with one before it, but where a chain begins.
    pub slit: u32,
    /// The wound on whose line it lies; [`super::wound_lines::NO_WOUND`] if it runs beside, below the skin.
    pub wound: u32,
    /// Where its earlier end lies on that line, metres.
    pub place: f64,
    /// Where it cut the skin, at its earlier and its later end, metres.
    pub skin: [[f64; 3]; 2],
    /// How long it counts as on its wound's line, metres.
    pub length: f64,
    /// +1 if it runs the line's way, -1 if the blade came back over it, 0 if it runs beside.
    pub way: i32,
    /// Zero; keeps the layout explicit.
    pub padding: u32,
}

/// Where strips of a chain turn by more in all, a lip is no longer one piece: the way along it is a fifth longer than the straight one by
/// then, if it goes round in a circle.
const MOST_TURN: f64 = std::f64::consts::TAU / 3.0;

impl Strip {
    /// Towards side +1, twice the mean of its triangles' areas long.
    fn normal(&self) -> DVec3 {
        let [tip0, tip1, base1, base0] = self.corners.map(DVec3::from_array);
        (tip1 - base0).cross(base1 - tip0)
    }

    /// True if it runs beside the lines of all wounds: it parts what it parts, and holds no wound particles.
    pub fn is_beside(&self) -> bool {
        self.way == 0
    }

    /// Where it cut the skin, at its earlier and its later end.
    pub fn skin_edge(&self) -> [DVec3; 2] {
        self.skin.map(DVec3::from_array)
    }

    /// Unit vector along it in the skin; where it cut next to none, along its corners.
    pub(super) fn along(&self) -> DVec3 {
        let [from, to] = self.skin_edge();
        let [tip0, tip1, base1, base0] = self.corners.map(DVec3::from_array);
        (to - from).try_normalize().unwrap_or_else(|| (tip1 + base1 - tip0 - base0).normalize_or_zero())
    }

    /// How far a point (rest space) lies inwards from one of its ends, along it, metres.
    pub(super) fn inwards(&self, at_end: bool, p: DVec3) -> f64 {
        let way = self.along() * if at_end { -1.0 } else { 1.0 };
        (p - self.skin_edge()[usize::from(at_end)]).dot(way)
    }

    /// What of the skin it cut so many metres along it.
    pub(super) fn skin_at(&self, along: f64) -> DVec3 {
        let [from, to] = self.skin_edge();
        from + self.along() * (along * from.distance(to) / self.length.max(f64::MIN_POSITIVE))
    }

    /// True if a point (rest space) is nearer to where it cut the skin than so many metres.
    pub(super) fn is_near_skin(&self, p: DVec3, near: f64) -> bool {
        let [from, to] = self.skin_edge();
        let along = (p - from).dot(self.along()).clamp(0.0, from.distance(to));
        (p - from).distance_squared(self.along() * along) < near * near
    }

    /// What lies so many metres along it, on its wound's line.
    pub(super) fn place_at(&self, along: f64) -> f64 {
        self.place + f64::from(self.way) * along
    }

    /// Where its later end lies on its wound's line, metres.
    pub fn end_place(&self) -> f64 {
        self.place_at(self.length)
    }
}

/// No strip.
pub(super) const NONE: u32 = u32::MAX;

/// Where a strip lies in its slit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Along {
    /// First strip of the slit.
    pub(super) start: usize,
    /// The strip that ends in the edge that this one starts from, and the one that starts where it ends; or [`NONE`].
    pub(super) last: u32,
    pub(super) next: u32,
    /// The first of the strips that share edges up to this one, and by how much they turn in all on the way here, radians.
    chain: u32,
    turn: f64,
}

impl Along {
    /// Of strip `k`, of which those before are known; that which it goes on from is told.
    pub(super) fn new(strips: &[Strip], along: &mut [Self], k: usize) -> Self {
        let strip = &strips[k];
        let of_slit = |m: &usize| strips[*m].slit == strip.slit;
        let start = k.checked_sub(1).filter(of_slit).map_or(k, |m| along[m].start);
        let ends_here = |m: &usize| strips[*m].corners[1] == strip.corners[0] && strips[*m].corners[2] == strip.corners[3];
        let last = (start.max(k.saturating_sub(TURNS))..k).rev().find(ends_here);
        if let Some(m) = last.filter(|&m| along[m].next == NONE) {
            along[m].next = k as u32;
        }
        let (chain, turn) = last.map_or((k as u32, 0.0), |m| {
            let turn = strips[m].normal().angle_between(strip.normal());
            (along[m].chain, along[m].turn + if turn.is_finite() { turn } else { 0.0 })
        });
        Self { start, last: last.map_or(NONE, |m| m as u32), next: NONE, chain, turn }
    }

    /// True if so little turns between two strips of one chain that their lips on one side are of one piece.
    pub(super) fn is_in_line(&self, other: &Self) -> bool {
        self.chain == other.chain && (self.turn - other.turn).abs() <= MOST_TURN
    }
}
