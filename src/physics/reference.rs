//! What the fast step is judged by: a fixed benchmark network, a converged reference, the energy, and the usual
//! integrators. Independent of the solver: plain particle order, plain loops, nothing shared but the settings.

use super::settings::NetworkSettings;
use super::topology::NetworkTopology;

/// A 64-bit generator (splitmix64): the same seed gives the same numbers everywhere.
#[derive(Clone, Copy, Debug)]
pub struct SplitMix(pub u64);

impl SplitMix {
    /// The next 64 bits.
    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [-1, 1).
    pub fn signed(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// The benchmark network: `particles` points spread over a unit sphere (Fibonacci spiral, jittered, then shuffled, seed 1)
/// and its `springs` shortest pairs, weighted inversely to the distance, 1 at the mean (MATHS 4.1).
/// The two sizes of the goals are 200 with 1,256 and 20,000 with 154,000.
pub fn benchmark_network(particles: usize, springs: usize) -> (Vec<[f64; 3]>, NetworkTopology) {
    let mut random = SplitMix(1);
    let spacing = (4.0 * std::f64::consts::PI / particles as f64).sqrt();
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let mut points: Vec<[f64; 3]> = (0..particles)
        .map(|k| {
            let z = 1.0 - (2 * k + 1) as f64 / particles as f64;
            let (sin, cos) = (golden * k as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let p = [r * cos, r * sin, z].map(|x| x + 0.2 * spacing * random.signed());
            let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
            p.map(|x| x / length)
        })
        .collect();
    for k in (1..particles).rev() {
        points.swap(k, (random.next_u64() % (k as u64 + 1)) as usize);
    }
    let mut pairs = close_pairs(&points, 3.2 * spacing);
    pairs.sort_by(|a, b| a.2.total_cmp(&b.2).then((a.0, a.1).cmp(&(b.0, b.1))));
    pairs.truncate(springs);
    let mean = pairs.iter().map(|p| p.2).sum::<f64>() / pairs.len().max(1) as f64;
    let weighted = pairs.iter().map(|(a, b, d)| (*a, *b, (mean / d) as f32));
    (points.clone(), NetworkTopology::from_pairs(particles, weighted))
}

/// A network as text: the number of particles, then a line `a b weight` for each spring.
pub fn network_text(topology: &NetworkTopology) -> String {
    let mut text = format!("{}\n", topology.particles());
    for a in 0..topology.particles() {
        let (columns, weights) = topology.row(a);
        let mut row: Vec<(u32, f32)> =
            columns.iter().copied().zip(weights.iter().copied()).filter(|(b, _)| *b as usize > a).collect();
        row.sort_unstable_by_key(|(b, _)| *b);
        row.iter().for_each(|(b, weight)| text += &format!("{a} {b} {weight}\n"));
    }
    text
}

/// Reads [`network_text`]; `None` if it is none.
pub fn parse_network(text: &str) -> Option<NetworkTopology> {
    let mut lines = text.lines();
    let particles: usize = lines.next()?.trim().parse().ok()?;
    let spring = |line: &str| {
        let mut words = line.split_whitespace();
        Some((words.next()?.parse().ok()?, words.next()?.parse().ok()?, words.next()?.parse().ok()?))
    };
    let springs: Vec<(u32, u32, f32)> = lines.map(spring).collect::<Option<_>>()?;
    Some(NetworkTopology::from_pairs(particles, springs.into_iter()))
}

/// All pairs closer than `reach`, found through points sorted by z.
fn close_pairs(points: &[[f64; 3]], reach: f64) -> Vec<(u32, u32, f64)> {
    let mut by_z: Vec<u32> = (0..points.len() as u32).collect();
    by_z.sort_by(|a, b| points[*a as usize][2].total_cmp(&points[*b as usize][2]));
    let mut pairs = Vec::new();
    for (k, a) in by_z.iter().enumerate() {
        for b in &by_z[k + 1..] {
            let (p, q) = (points[*a as usize], points[*b as usize]);
            if q[2] - p[2] > reach {
                break;
            }
            let d = (0..3).map(|m| (p[m] - q[m]).powi(2)).sum::<f64>().sqrt();
            if d < reach {
                pairs.push((*a.min(b), *a.max(b), d));
            }
        }
    }
    pairs
}

/// Integrators to compare with, one step each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Integrator {
    /// Fourth-order Runge-Kutta: with small steps, the reference.
    RungeKutta,
    /// Symplectic Euler: what most soft-body code does.
    SymplecticEuler,
    /// Implicit Euler, solved to convergence.
    ImplicitEuler,
    /// Crank-Nicolson, solved to convergence.
    CrankNicolson,
    /// Extended position-based dynamics with one iteration a (small) step (Macklin et al. 2019): every spring a compliant
    /// constraint, solved one after the other.
    Xpbd,
}

/// The same equation in the plainest form: dense state, per-particle loops.
#[derive(Clone, Debug)]
pub struct ReferenceNetwork {
    /// Springs.
    pub topology: NetworkTopology,
    /// Material.
    pub settings: NetworkSettings,
    /// Masses, kg.
    pub masses: Vec<f64>,
    /// Displacements from rest, metres.
    pub u: Vec<[f64; 3]>,
    /// Velocities, m/s.
    pub v: Vec<[f64; 3]>,
    /// Rest displacements, metres.
    pub rest: Vec<[f64; 3]>,
    /// External forces, N.
    pub forces: Vec<[f64; 3]>,
    /// Particles that move at their present velocity, whatever pulls at them.
    pub held: Vec<bool>,
}

type Vectors = Vec<[f64; 3]>;

impl ReferenceNetwork {
    /// Unit masses, everything at rest.
    pub fn new(topology: &NetworkTopology, settings: NetworkSettings) -> Self {
        let n = topology.particles();
        let zero = vec![[0.0; 3]; n];
        let (u, v, rest, forces) = (zero.clone(), zero.clone(), zero.clone(), zero);
        Self { topology: topology.clone(), settings, masses: vec![1.0; n], u, v, rest, forces, held: vec![false; n] }
    }

    /// `M^-1 (F - K (u - u0))`.
    fn pull(&self, u: &[[f64; 3]]) -> Vectors {
        let rate = self.settings.anchor_rate();
        let away = |p: usize| -> [f64; 3] { std::array::from_fn(|k| u[p][k] - self.rest[p][k]) };
        let row = |p: usize| {
            let own = away(p);
            let mut a: [f64; 3] = std::array::from_fn(|k| self.forces[p][k] / self.masses[p] - rate * own[k]);
            let (columns, weights) = self.topology.row(p);
            for (other, weight) in columns.iter().zip(weights) {
                let mass = 0.5 * (self.masses[p] + self.masses[*other as usize]);
                let stiffness = rate * self.settings.coupling * *weight as f64 * mass / self.masses[p];
                let there = away(*other as usize);
                (0..3).for_each(|k| a[k] -= stiffness * (own[k] - there[k]));
            }
            if self.held[p] { [0.0; 3] } else { a }
        };
        (0..u.len()).map(row).collect()
    }

    fn acceleration(&self, u: &[[f64; 3]], v: &[[f64; 3]]) -> Vectors {
        let c = self.settings.damping_rate();
        let mut a = self.pull(u);
        for p in (0..a.len()).filter(|p| !self.held[*p]) {
            (0..3).for_each(|k| a[p][k] -= c * v[p][k]);
        }
        a
    }

    /// One step of `h` seconds.
    pub fn step(&mut self, integrator: Integrator, h: f64) {
        match integrator {
            Integrator::RungeKutta => self.runge_kutta(h),
            Integrator::SymplecticEuler => {
                self.v = add(&self.v, &self.acceleration(&self.u, &self.v), h);
                self.u = add(&self.u, &self.v, h);
            }
            Integrator::ImplicitEuler => self.implicit(h, 1.0),
            Integrator::CrankNicolson => self.implicit(h, 0.5),
            Integrator::Xpbd => self.xpbd(h),
        }
    }

    fn runge_kutta(&mut self, h: f64) {
        let (u, v) = (&self.u, &self.v);
        let a1 = self.acceleration(u, v);
        let (u2, v2) = (add(u, v, h / 2.0), add(v, &a1, h / 2.0));
        let a2 = self.acceleration(&u2, &v2);
        let (u3, v3) = (add(u, &v2, h / 2.0), add(v, &a2, h / 2.0));
        let a3 = self.acceleration(&u3, &v3);
        let (u4, v4) = (add(u, &v3, h), add(v, &a3, h));
        let a4 = self.acceleration(&u4, &v4);
        let blend = |x: &[f64; 3], d: [&[f64; 3]; 4]| -> [f64; 3] {
            std::array::from_fn(|k| x[k] + h / 6.0 * (d[0][k] + 2.0 * d[1][k] + 2.0 * d[2][k] + d[3][k]))
        };
        let next_u = (0..u.len()).map(|p| blend(&u[p], [&v[p], &v2[p], &v3[p], &v4[p]])).collect();
        let next_v = (0..u.len()).map(|p| blend(&v[p], [&a1[p], &a2[p], &a3[p], &a4[p]])).collect();
        (self.u, self.v) = (next_u, next_v);
    }

    fn xpbd(&mut self, h: f64) {
        let (before, left) = (self.u.clone(), (-self.settings.damping_rate() * h).exp());
        for p in (0..self.u.len()).filter(|p| !self.held[*p]) {
            (0..3).for_each(|k| self.v[p][k] = left * self.v[p][k] + h * self.forces[p][k] / self.masses[p]);
        }
        self.u = add(&before, &self.v, h);
        let weight = |p: usize| if self.held[p] { 0.0 } else { 1.0 / self.masses[p] };
        let rate = self.settings.anchor_rate();
        for p in 0..self.u.len() {
            // The anchor: stiffness `m rate`, and each neighbour once.
            let own = 1.0 / (rate * self.masses[p] * h * h);
            for k in 0..3 {
                let away = self.u[p][k] - self.rest[p][k];
                self.u[p][k] -= weight(p) * away / (weight(p) + own);
            }
            let (columns, weights) = self.topology.row(p);
            for (other, spring) in columns.iter().zip(weights).filter(|(other, _)| **other as usize > p) {
                let q = *other as usize;
                let stiffness = rate * self.settings.coupling * f64::from(*spring) * 0.5 * (self.masses[p] + self.masses[q]);
                let compliance = 1.0 / (stiffness * h * h);
                for k in 0..3 {
                    let apart = self.u[p][k] - self.rest[p][k] - self.u[q][k] + self.rest[q][k];
                    let lambda = -apart / (weight(p) + weight(q) + compliance);
                    self.u[p][k] += weight(p) * lambda;
                    self.u[q][k] -= weight(q) * lambda;
                }
            }
        }
        for p in (0..self.u.len()).filter(|p| !self.held[*p]) {
            (0..3).for_each(|k| self.v[p][k] = (self.u[p][k] - before[p][k]) / h);
        }
    }

    /// The theta scheme; its linear system by plain fixed-point sweeps (Gauss-Seidel) until nothing moves.
    fn implicit(&mut self, h: f64, theta: f64) {
        let (u0, v0) = (self.u.clone(), self.v.clone());
        let a0 = self.acceleration(&u0, &v0);
        let (rate, c) = (self.settings.anchor_rate(), self.settings.damping_rate());
        let mut v = v0.clone();
        for _ in 0..10_000 {
            let mut change: f64 = 0.0;
            for p in 0..v.len() {
                let (columns, weights) = self.topology.row(p);
                let sum: f64 = weights.iter().map(|w| *w as f64).sum();
                let diagonal = rate * (1.0 + self.settings.coupling * sum);
                let ahead = |q: usize, k: usize| u0[q][k] - self.rest[q][k] + h * ((1.0 - theta) * v0[q][k] + theta * v[q][k]);
                let next: [f64; 3] = std::array::from_fn(|k| {
                    let pull: f64 = columns.iter().zip(weights).map(|(q, w)| *w as f64 * ahead(*q as usize, k)).sum();
                    let known = u0[p][k] - self.rest[p][k] + h * (1.0 - theta) * v0[p][k];
                    let a = self.forces[p][k] - diagonal * known + rate * self.settings.coupling * pull;
                    (v0[p][k] + h * (1.0 - theta) * a0[p][k] + h * theta * a) / (1.0 + h * theta * (c + h * theta * diagonal))
                });
                change = (0..3).fold(change, |m, k| m.max((next[k] - v[p][k]).abs()));
                v[p] = next;
            }
            if change < 1e-13 {
                break;
            }
        }
        self.u =
            (0..v.len()).map(|p| std::array::from_fn(|k| u0[p][k] + h * ((1.0 - theta) * v0[p][k] + theta * v[p][k]))).collect();
        self.v = v;
    }

    /// Kinetic and elastic energy, less the work of constant forces, J.
    pub fn energy(&self) -> f64 {
        let mut energy = 0.0;
        for (p, pull) in self.pull(&self.u).iter().enumerate() {
            for (k, pull) in pull.iter().enumerate() {
                let away = self.u[p][k] - self.rest[p][k];
                let elastic = self.forces[p][k] - self.masses[p] * pull;
                energy += 0.5 * (self.masses[p] * self.v[p][k].powi(2) + elastic * away) - self.forces[p][k] * away;
            }
        }
        energy
    }
}

fn add(x: &[[f64; 3]], d: &[[f64; 3]], h: f64) -> Vectors {
    x.iter().zip(d).map(|(x, d)| std::array::from_fn(|k| x[k] + h * d[k])).collect()
}

/// Largest component of `a - b`: the norm of MATHS 4.3. NaN if any is.
pub fn max_difference(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let larger = |m: f64, x: f64| if x > m || x.is_nan() { x } else { m };
    a.iter().zip(b).flat_map(|(a, b)| (0..3).map(move |k| (a[k] - b[k]).abs())).fold(0.0, larger)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_benchmark_networks_have_the_sizes_of_the_goals() {
        let (_, small) = benchmark_network(200, 1256);
        small.validate().unwrap();
        assert_eq!((small.particles(), small.springs()), (200, 1256));
        let (_, large) = benchmark_network(20_000, 154_000);
        assert_eq!((large.particles(), large.springs()), (20_000, 154_000));
        assert!((0..20_000).all(|p| large.row(p).0.len() >= 6));
    }

    const FIXED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/network-200.txt");

    /// Writes the fixed benchmark network: `cargo test -- --ignored write_benchmark_network`.
    #[test]
    #[ignore = "writes benches/network-200.txt"]
    fn write_benchmark_network() {
        std::fs::write(FIXED, network_text(&benchmark_network(200, 1256).1)).unwrap();
    }

    #[test]
    fn the_fixed_network_is_the_generated_one() {
        let text = std::fs::read_to_string(FIXED).unwrap();
        let fixed = parse_network(&text).unwrap();
        fixed.validate().unwrap();
        assert_eq!((fixed.particles(), fixed.springs()), (200, 1256));
        assert_eq!(text, network_text(&benchmark_network(200, 1256).1));
        assert_ne!(text, network_text(&benchmark_network(200, 1255).1));
        assert!(parse_network("").is_none() && parse_network("3\n0 x 1\n").is_none());
    }

    #[test]
    fn integrators_converge_at_their_order() {
        let (_, topology) = benchmark_network(20, 50);
        let settings = NetworkSettings { frequency_hz: 1.0, damping_ratio: 0.1, coupling: 1.0, rotations: false };
        let run = |integrator, steps: usize| {
            let mut n = ReferenceNetwork::new(&topology, settings);
            n.u[3] = [0.1, 0.0, -0.2];
            n.forces[5] = [1.0, 0.0, 0.0];
            n.rest[7] = [0.0, 0.1, 0.0];
            (0..steps).for_each(|_| n.step(integrator, 0.2 / steps as f64));
            n.u
        };
        let exact = run(Integrator::RungeKutta, 4000);
        for (integrator, order) in [
            (Integrator::RungeKutta, 4.0),
            (Integrator::SymplecticEuler, 1.0),
            (Integrator::ImplicitEuler, 1.0),
            (Integrator::CrankNicolson, 2.0),
            (Integrator::Xpbd, 1.0),
        ] {
            let (a, b) = (max_difference(&run(integrator, 20), &exact), max_difference(&run(integrator, 40), &exact));
            let measured = (a / b).log2();
            assert!((measured - order).abs() < 0.35, "{integrator:?}: {measured}");
        }
    }

    #[test]
    fn energy_is_kept_without_damping_and_lost_with_it() {
        let (_, topology) = benchmark_network(20, 50);
        for (damping_ratio, kept) in [(0.0, true), (0.05, false)] {
            let settings = NetworkSettings { frequency_hz: 1.0, damping_ratio, coupling: 1.0, rotations: false };
            let mut n = ReferenceNetwork::new(&topology, settings);
            n.u[3] = [0.1, 0.0, -0.2];
            n.forces[5] = [1.0, 0.0, 0.0];
            let before = n.energy();
            (0..1000).for_each(|_| n.step(Integrator::RungeKutta, 1e-3));
            assert_eq!((n.energy() - before).abs() < 1e-6, kept);
        }
    }
}
