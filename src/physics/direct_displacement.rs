//! Direct displacement: what follows a grabbed particle (the paper's Eq. 2, MATHS 3.4).
//!
//! `D_j = I + sum_k W_jk (D'_k - I)` over the grabbed particles `k`; for displacements that is
//! `target_j = sum_k W_jk u'_k`, with `g_jk = min(1, r / |a_j - a_k|)` and `W_jk = g_jk / max(1, sum_k g_jk)`.

use glam::DVec3;

/// The weight of one grabbed particle before normalisation: 1 within `radius`, then falling with the distance.
/// Coinciding particles follow wholly.
#[inline]
pub fn pull(distance: f64, radius: f64) -> f64 {
    if distance <= radius { 1.0 } else { (radius / distance).clamp(0.0, 1.0) }
}

/// Weights `W_jk` of the grabbed anchors on a particle at `anchor`, in the order given, into `weights`. They sum to 1 at
/// most. `radius` (metres) is how far a follower moves as far as the grabbed particle itself.
pub fn weights(anchor: DVec3, grabbed: &[DVec3], radius: f64, weights: &mut Vec<f64>) {
    weights.clear();
    weights.extend(grabbed.iter().map(|a| pull(anchor.distance(*a), radius)));
    let sum = weights.iter().sum::<f64>().max(1.0);
    weights.iter_mut().for_each(|w| *w /= sum);
}

/// Where a follower's spring pulls it while the grab lasts: the displacement `sum_k W_jk u'_k`, metres. `grabbed` pairs a
/// grabbed particle's anchor with its displacement.
pub fn target(anchor: DVec3, grabbed: &[(DVec3, DVec3)], radius: f64) -> DVec3 {
    target_over(anchor, grabbed.iter().map(|&(a, u)| (a, u, 1.0)), radius)
}

/// [`target`] where a share of each pull, from 0 to 1, reaches the follower.
pub fn target_over(anchor: DVec3, grabbed: impl Iterator<Item = (DVec3, DVec3, f32)>, radius: f64) -> DVec3 {
    let (mut pulls, mut moved) = (Pulls::default(), DVec3::ZERO);
    for (other, displacement, share) in grabbed {
        moved += pulls.add(anchor.distance(other), radius, share) * displacement;
    }
    moved / pulls.norm()
}

/// Pulls on one follower, each by the share of it that wounds leave. They are normalised as though all were whole that the largest
/// share is of: what wounds take from all of them is gone, and what they take from some goes to the others.
#[derive(Clone, Copy, Debug, Default)]
struct Pulls {
    sum: f64,
    largest_share: f64,
}

impl Pulls {
    fn add(&mut self, distance: f64, radius: f64, share: f32) -> f64 {
        let share = f64::from(share);
        let g = pull(distance, radius) * share;
        self.sum += g;
        self.largest_share = self.largest_share.max(share);
        g
    }

    fn norm(&self) -> f64 {
        if self.largest_share > 0.0 { (self.sum / self.largest_share).max(1.0) } else { 1.0 }
    }
}

/// Groups of grabbed particles that move alike, and are told apart: one a hand.
const GROUPS: usize = 4;
/// Displacements that differ by this share of their length and of the radius have moved alike.
const ALIKE: f64 = 1e-12;

/// A grabbed particle.
#[derive(Clone, Copy, Debug)]
struct Grabbed {
    anchor: DVec3,
    /// Its displacement when the followers' sums were made.
    base: DVec3,
    group: usize,
}

/// What a follower's sum comes to.
#[derive(Clone, Copy, Debug)]
struct Follower {
    anchor: DVec3,
    made_for: u64,
    /// `sum_k W_jk base_k`.
    base: DVec3,
    /// `sum_k W_jk` over each group.
    shares: [f64; GROUPS],
}

/// [`target`] of many followers, frame after frame. A hand that carries its particles along by one vector changes the sum over
/// them by that vector times the sum of their weights, so the weights are gone through once, when the hand takes hold, and not
/// in every frame.
#[derive(Clone, Debug, Default)]
pub struct Followers {
    grabbed: Vec<Grabbed>,
    radius: f64,
    /// How far each group has moved since.
    moves: Vec<DVec3>,
    /// False if there are more groups than are told apart.
    regular: bool,
    /// Counts the sets of weights.
    made: u64,
    followers: Vec<Follower>,
    edits: u64,
    /// Counts the sets of what is grabbed, and the edits meanwhile.
    sets: u64,
    /// By follower: for which set it was asked what reaches it, and the answers, one for each that is grabbed.
    asked: Vec<u64>,
    reaching: Vec<f32>,
}

/// Grabbed particles for each of which there is room for all followers' answers at first.
const GRABBED: usize = 64;
/// Answers that room is made for at first, at most.
const ANSWERS: usize = 1 << 20;

impl Followers {
    /// Makes room for so many followers and grabbed particles.
    pub fn make_room(&mut self, particles: usize) {
        self.grabbed.reserve(particles);
        self.moves.reserve(GROUPS + 1);
        self.followers.reserve(particles);
        self.asked.reserve(particles);
        self.reaching.reserve((particles * particles.min(GRABBED)).min(ANSWERS));
    }

    /// Tells anchors and displacements of what is grabbed, metres, in any order but always the same. `radius` as for [`pull`];
    /// `edits` is any number that changes with every edit: a wound may part followers from what is grabbed. True if something else is
    /// grabbed now, so that [`Followers::target`] asks what reaches whom.
    pub fn set_grabbed(&mut self, grabbed: &[(DVec3, DVec3)], radius: f64, edits: u64) -> bool {
        let same = self.radius == radius
            && self.edits == edits
            && self.grabbed.len() == grabbed.len()
            && self.grabbed.iter().zip(grabbed).all(|(known, now)| known.anchor == now.0);
        if !same {
            (self.radius, self.edits) = (radius, edits);
            self.sets += 1;
            self.grabbed.clear();
            self.grabbed.extend(grabbed.iter().map(|&(anchor, base)| Grabbed { anchor, base, group: 0 }));
            self.begin(1);
            return true;
        }
        if self.regular && self.follow(grabbed) {
            return false;
        }
        // Others move alike than did so far.
        self.moves.clear();
        for (known, now) in self.grabbed.iter_mut().zip(grabbed) {
            let by = now.1 - known.base;
            let found = self.moves.iter().position(|m| alike(*m, by, known.base, radius));
            known.group = found.unwrap_or(self.moves.len());
            if found.is_none() && self.moves.len() <= GROUPS {
                self.moves.push(by);
            }
            known.base = now.1;
        }
        self.begin(self.moves.len());
        false
    }

    fn begin(&mut self, groups: usize) {
        self.regular = groups <= GROUPS;
        self.moves.clear();
        self.moves.resize(groups, DVec3::ZERO);
        self.made += 1;
    }

    /// Finds how far each group has moved; false if some of one have moved otherwise than the rest.
    fn follow(&mut self, grabbed: &[(DVec3, DVec3)]) -> bool {
        let (radius, mut seen) = (self.radius, [false; GROUPS]);
        for (known, now) in self.grabbed.iter().zip(grabbed) {
            let by = now.1 - known.base;
            if !std::mem::replace(&mut seen[known.group], true) {
                self.moves[known.group] = by;
            } else if !alike(self.moves[known.group], by, known.base, radius) {
                return false;
            }
        }
        true
    }

    /// [`target`] of the follower with this number, whose anchor is here, over all that is grabbed, as far as that `reaches` it: a share
    /// from 0 to 1, less than 1 where a wound lies between them. It is asked for with the place in the list, once for as long as the
    /// same is grabbed.
    pub fn target(&mut self, follower: usize, anchor: DVec3, reaches: impl Fn(usize) -> f64) -> DVec3 {
        let held = self.grabbed.len();
        if follower >= self.asked.len() {
            self.asked.resize(follower + 1, 0);
        }
        if self.reaching.len() < (follower + 1) * held {
            self.reaching.resize((follower + 1) * held, 0.0);
        }
        let (answers, known) = (&mut self.reaching[follower * held..][..held], self.followers.get(follower));
        if self.asked[follower] != self.sets || known.is_some_and(|known| known.anchor != anchor) {
            answers.iter_mut().enumerate().for_each(|(k, answer)| *answer = reaches(k) as f32);
            self.asked[follower] = self.sets;
        }
        if !self.regular {
            let joined = self.grabbed.iter().zip(&*answers).map(|(g, share)| (g.anchor, g.base, *share));
            return target_over(anchor, joined, self.radius);
        }
        if follower >= self.followers.len() {
            let unknown = Follower { anchor, made_for: 0, base: DVec3::ZERO, shares: [0.0; GROUPS] };
            self.followers.resize(follower + 1, unknown);
        }
        let (known, made) = (&mut self.followers[follower], self.made);
        if known.made_for != made || known.anchor != anchor {
            let (mut pulls, mut base, mut shares) = (Pulls::default(), DVec3::ZERO, [0.0; GROUPS]);
            for (grabbed, share) in self.grabbed.iter().zip(&*answers).filter(|(_, share)| **share > 0.0) {
                let g = pulls.add(anchor.distance(grabbed.anchor), self.radius, *share);
                base += g * grabbed.base;
                shares[grabbed.group] += g;
            }
            let norm = pulls.norm();
            *known = Follower { anchor, made_for: made, base: base / norm, shares: shares.map(|s| s / norm) };
        }
        self.moves.iter().zip(known.shares).fold(known.base, |sum, (by, share)| sum + share * *by)
    }

    /// How often the weights of all were made anew.
    pub fn times_made(&self) -> u64 {
        self.made
    }
}

fn alike(a: DVec3, b: DVec3, base: DVec3, radius: f64) -> bool {
    a.distance(b) <= ALIKE * (radius + a.length() + base.length())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_never_sum_to_more_than_one() {
        let grabbed: Vec<DVec3> = (0..5).map(|k| DVec3::new(k as f64 * 0.1, 0.0, 0.0)).collect();
        let mut w = Vec::new();
        for k in 0..50 {
            weights(DVec3::new(0.0, k as f64 * 0.1, 0.0), &grabbed, 0.2, &mut w);
            let sum: f64 = w.iter().sum();
            assert!(sum <= 1.0 + 1e-12 && w.iter().all(|w| *w > 0.0));
        }
        // Broken twin: without the normalisation five grabbed particles would pull a follower five times as far.
        assert!(grabbed.iter().map(|a| pull(a.distance(DVec3::ZERO), 1.0)).sum::<f64>() > 4.0);
    }

    #[test]
    fn one_grab_carries_the_near_wholly_and_the_far_in_proportion() {
        let u = DVec3::new(0.0, 0.0, 0.3);
        let at = |d: f64| target(DVec3::new(d, 0.0, 0.0), &[(DVec3::ZERO, u)], 0.1);
        assert_eq!(at(0.0), u);
        assert_eq!(at(0.1), u);
        assert!((at(0.2) - u / 2.0).length() < 1e-15);
        assert!((at(1.0) - u / 10.0).length() < 1e-15);
        assert!((at(0.2) - u).length() > 0.1);
    }

    #[test]
    fn a_common_move_of_all_grabbed_carries_an_enclosed_follower() {
        let u = DVec3::new(0.1, -0.2, 0.05);
        let ring: Vec<_> = (0..6).map(|k| (DVec3::new((k as f64).cos(), (k as f64).sin(), 0.0) * 0.1, u)).collect();
        assert!((target(DVec3::ZERO, &ring, 0.1) - u).length() < 1e-12);
    }

    #[test]
    fn odd_input_is_harmless() {
        assert_eq!(target(DVec3::ONE, &[], 1.0), DVec3::ZERO);
        assert_eq!(pull(0.0, 0.0), 1.0);
        assert_eq!(pull(1.0, 0.0), 0.0);
        let (mut w, p) = (Vec::new(), DVec3::ONE);
        weights(p, &[p, p], 0.0, &mut w);
        assert_eq!(w, [0.5, 0.5]);
    }

    /// Hands that come, move together or apart, twist what they hold, and let go; anchors that an edit puts elsewhere.
    #[test]
    fn followers_go_where_the_sum_over_all_that_is_grabbed_has_them() {
        let place = |k: usize| DVec3::new((k as f64 * 1.7).sin(), (k as f64 * 0.9).cos(), (k as f64 * 0.3).sin());
        let mut anchors: Vec<DVec3> = (0..60).map(place).collect();
        let mut followers = Followers::default();
        let mut most = 0f64;
        let mut check = |followers: &mut Followers, anchors: &[DVec3], grabbed: &[(DVec3, DVec3)]| {
            followers.set_grabbed(grabbed, 0.3, 0);
            for (j, a) in anchors.iter().enumerate() {
                let (wanted, found) = (target(*a, grabbed, 0.3), followers.target(j, *a, |_| 1.0));
                most = most.max(wanted.distance(found));
                assert!(wanted.distance(found) < 1e-12, "{j}: {wanted} {found}");
            }
        };
        let start = |k: usize| 0.1 * place(k + 100);
        let held = |count: usize, by: &dyn Fn(usize) -> DVec3| -> Vec<(DVec3, DVec3)> {
            (0..count).map(|k| (place(k), start(k) + by(k))).collect()
        };
        let step = |k: i32| f64::from(k) * DVec3::new(0.02, -0.01, 0.03);
        for k in 0..20 {
            check(&mut followers, &anchors, &held(12, &|_| step(k)));
        }
        assert_eq!(followers.times_made(), 1, "one hand that carries all alike");
        for k in 0..20 {
            let two = |p: usize| if p < 7 { step(k) } else { -0.5 * step(k) };
            check(&mut followers, &anchors, &held(18, &two));
        }
        assert_eq!(followers.times_made(), 3, "two hands: once when the second came, once when they parted");
        for k in 0..20 {
            let twist = |p: usize| glam::DQuat::from_rotation_y(f64::from(k) * 0.1) * place(p) - place(p);
            check(&mut followers, &anchors, &held(18, &twist));
        }
        assert_eq!(followers.times_made(), 22, "each moves by itself");
        let before = followers.times_made();
        for k in 0..20 {
            anchors[5] += 0.01;
            check(&mut followers, &anchors, &held(12, &|_| step(k)));
        }
        assert_eq!(followers.times_made(), before + 1);
        // Broken twin: shares that are not made anew when what is grabbed changes.
        followers.set_grabbed(&held(12, &|_| step(0)), 0.3, 0);
        let stale = followers.target(3, anchors[3], |_| 1.0);
        assert!(stale.distance(target(anchors[3], &held(12, &|_| step(9)), 0.3)) > 1e-3);
        // A wound that comes in between: what is beyond it does not count.
        followers.set_grabbed(&held(12, &|_| step(9)), 0.3, 1);
        let beyond = |k: usize| f64::from(u8::from(k < 5));
        assert!(followers.target(3, anchors[3], beyond).distance(target(anchors[3], &held(5, &|_| step(9)), 0.3)) < 1e-12);
    }
}
