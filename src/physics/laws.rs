//! Laws of the dynamics (DESIGN section 4, MATHS 4), each with a broken twin that must fail it.

use super::reference::{Integrator, ReferenceNetwork, SplitMix, benchmark_network, max_difference};
use super::{Network, NetworkSettings, NetworkTopology, StepMethod, StepScratch};
use crate::geometry::ParticleId;
use glam::DVec3;
use proptest::prelude::*;

const FRAME: f64 = 1.0 / 60.0;

fn small() -> NetworkTopology {
    benchmark_network(60, 300).1
}

fn settings(frequency_hz: f64, damping_ratio: f64, coupling: f64) -> NetworkSettings {
    NetworkSettings { frequency_hz, damping_ratio, coupling, rotations: false }
}

/// Settings with the wanted `h omega_max` at a step of 1/60 s.
fn settings_for(topology: &NetworkTopology, reach: f64, damping_ratio: f64) -> NetworkSettings {
    let unit = settings(1.0, damping_ratio, 1.0);
    let (_, high) = Network::new(topology, unit, 1.0).unwrap().spectrum();
    NetworkSettings { frequency_hz: reach / (FRAME * high.sqrt()), ..unit }
}

fn random_state(network: &mut Network, size: f64, flat: bool, seed: u64) {
    let mut random = SplitMix(seed);
    for p in 0..network.len() as u32 {
        let mut u = DVec3::new(random.signed(), random.signed(), random.signed()) * size;
        if flat {
            u.z = 0.0;
        }
        network.set_state(ParticleId(p), u, DVec3::ZERO);
    }
}

/// The reference with the same state.
fn reference_of(network: &Network, topology: &NetworkTopology) -> ReferenceNetwork {
    let mut reference = ReferenceNetwork::new(topology, network.settings());
    for p in 0..network.len() {
        let id = ParticleId(p as u32);
        reference.u[p] = network.displacement(id).into();
        reference.v[p] = network.velocity(id).into();
        reference.rest[p] = network.rest_displacement(id).into();
    }
    reference
}

fn advance(reference: &mut ReferenceNetwork, h: f64, substeps: usize) {
    (0..substeps).for_each(|_| reference.step(Integrator::RungeKutta, h / substeps as f64));
}

fn largest(u: &[[f64; 3]]) -> f64 {
    max_difference(u, &vec![[0.0; 3]; u.len()])
}

fn frames(network: &mut Network, count: usize, scratch: &mut StepScratch) {
    for _ in 0..count {
        network.step(FRAME, scratch);
    }
}

/// Error of MATHS 4.3 over one second at 60 Hz; `stretch` breaks the solver's idea of its step.
fn error_over_a_second(topology: &NetworkTopology, settings: NetworkSettings, stretch: f64) -> f64 {
    let mut network = Network::new(topology, settings, 1e-9).unwrap();
    random_state(&mut network, 1.0, false, 3);
    let mut reference = reference_of(&network, topology);
    let start = largest(network.displacements());
    let mut scratch = StepScratch::default();
    // h omega = 0.05 a substep: 1e-7 over the second.
    let substeps = (20.0 * FRAME * network.spectrum().1.sqrt()) as usize + 20;
    let mut worst: f64 = 0.0;
    for _ in 0..60 {
        network.step(FRAME * stretch, &mut scratch);
        advance(&mut reference, FRAME, substeps);
        worst = worst.max(max_difference(network.displacements(), &reference.u) / start);
    }
    worst
}

#[test]
fn the_series_is_within_a_thousandth_of_the_reference() {
    let topology = small();
    for reach in [0.5, 2.0, 7.0, 15.0, 40.0] {
        for damping in [0.0, 0.1, 1.0, 3.0] {
            let settings = settings_for(&topology, reach, damping);
            let error = error_over_a_second(&topology, settings, 1.0);
            assert!(error < 5e-4, "h omega_max {reach}, damping {damping}: {error}");
        }
    }
    // Broken twin: half a per cent off in time.
    assert!(error_over_a_second(&topology, settings_for(&topology, 7.0, 0.1), 1.005) > 1e-3);
}

#[test]
fn masses_forces_rests_and_grabs_agree_with_the_reference() {
    let topology = small();
    let masses: Vec<f64> = (0..60).map(|p| [1.0, 0.2, 5.0][p % 3]).collect();
    for (broken, reach) in [(false, 0.9), (true, 0.9), (false, 4.0)] {
        let mut network = Network::new(&topology, settings_for(&topology, reach, 0.2), 1e-9).unwrap();
        network.set_topology(&topology, Some(&masses));
        random_state(&mut network, 0.1, false, 5);
        network.set_force(ParticleId(3), DVec3::new(9.0, -3.0, 1.0));
        let mut reference = reference_of(&network, &topology);
        reference.masses = masses.clone();
        reference.forces[3] = [9.0, -3.0, 1.0];
        let mut scratch = StepScratch::default();
        for frame in 0..30 {
            let rest = DVec3::new(0.0, 0.01 * frame as f64, 0.0);
            let target = network.displacement(ParticleId(11)) + DVec3::new(0.004, 0.0, -0.002);
            network.set_rest_displacement(ParticleId(8), rest);
            network.set_grabs(&[(ParticleId(11), target)]);
            let before = reference.rest[8];
            reference.held[11] = true;
            reference.v[11] = ((target - network.displacement(ParticleId(11))) / FRAME).into();
            // The reference moves the rest displacement in 800 small stairs, at their middles.
            for k in 0..800 {
                let part = (k as f64 + 0.5) / 800.0;
                reference.rest[8] = std::array::from_fn(|m| before[m] + part * (rest[m] - before[m]));
                reference.step(Integrator::RungeKutta, FRAME / 800.0);
            }
            reference.rest[8] = if broken { before } else { rest.into() };
            let report = network.step(FRAME, &mut scratch);
            assert_eq!(report.method, StepMethod::Chebyshev);
            assert!((network.displacement(ParticleId(11)) - target).length() < 1e-15);
        }
        let error = max_difference(network.displacements(), &reference.u);
        assert_eq!(error < 1e-4, !broken, "reach {reach}: {error}");
    }
}

/// A particle that starts where it rests stays there, and its neighbours with it.
#[test]
fn a_particle_that_starts_at_its_rest_stirs_nothing() {
    for starts_there in [true, false] {
        let topology = NetworkTopology::from_pairs(2, std::iter::once((0, 1, 1.0)));
        let mut network = Network::new(&topology, settings(3.0, 0.5, 2.0), 1e-9).unwrap();
        if starts_there {
            network.set_start(ParticleId(1), DVec3::X, DVec3::ZERO, DVec3::ZERO);
        } else {
            network.set_state(ParticleId(1), DVec3::X, DVec3::ZERO);
        }
        let mut most = 0.0f64;
        for _ in 0..30 {
            network.set_rest_displacement(ParticleId(1), DVec3::X);
            network.step(FRAME, &mut StepScratch::default());
            most = most
                .max(network.displacement(ParticleId(1)).distance(DVec3::X))
                .max(network.displacement(ParticleId(0)).length());
        }
        assert_eq!(most == 0.0, starts_there, "{most}");
    }
}

#[test]
fn a_lone_particle_is_the_closed_form() {
    let topology = NetworkTopology::from_pairs(1, std::iter::empty());
    for frequency in [0.1, 3.0, 60.0, 5033.0] {
        for damping in [0.0, 0.001, 1.0, 1.0 + 1e-9, 4.0] {
            let mut network = Network::new(&topology, settings(frequency, damping, 1.0), 1e-9).unwrap();
            network.set_state(ParticleId(0), DVec3::X, DVec3::ZERO);
            let mut scratch = StepScratch::default();
            let omega = std::f64::consts::TAU * frequency;
            for step in 1..=1200 {
                let report = network.step(FRAME, &mut scratch);
                assert!(matches!(report.method, StepMethod::ClosedForm | StepMethod::Asleep));
                let t = step as f64 * FRAME;
                let exact = |damping: f64| {
                    let decay = damping * omega;
                    let d = omega * (1.0 - damping * damping).abs().sqrt();
                    if damping < 1.0 {
                        (-decay * t).exp() * ((d * t).cos() + decay / d * (d * t).sin())
                    } else if damping < 1.0 + 1e-6 {
                        (-decay * t).exp() * (1.0 + omega * t)
                    } else {
                        let (a, b) = (-decay + d, -decay - d);
                        (a * (b * t).exp() - b * (a * t).exp()) / (a - b)
                    }
                };
                let x = network.displacement(ParticleId(0)).x;
                assert!((x - exact(damping)).abs() < 1e-6, "f {frequency} damping {damping} t {t}: {x}");
            }
        }
    }
}

/// What the stability set asks of one run.
struct Run {
    peak: f64,
    end: f64,
    energy_error: f64,
}

fn run(topology: &NetworkTopology, masses: Option<&[f64]>, settings: NetworkSettings, h: f64, flat: bool) -> Run {
    let mut network = Network::new(topology, settings, 1e-9).unwrap();
    network.set_topology(topology, masses);
    random_state(&mut network, 10.0, flat, 11);
    let (start, energy) = (largest(network.displacements()), network.energy());
    let mut scratch = StepScratch::default();
    let until = if settings.damping_ratio > 0.0 { 10.0 / (settings.damping_ratio * settings.anchor_rate().sqrt()) } else { 0.0 };
    // As far as the law looks, or a number of steps that a test can afford.
    let steps = ((until / h).ceil() as usize).clamp(20, 400);
    let mut peak: f64 = 0.0;
    for _ in 0..steps {
        network.step(h, &mut scratch);
        peak = peak.max(largest(network.displacements()) / start);
    }
    assert_eq!(network.quarantined(), 0);
    let settled = steps as f64 * h >= until;
    let end = if settled { largest(network.displacements()) / start } else { 0.0 };
    Run { peak, end, energy_error: (network.energy() / energy - 1.0).abs() }
}

#[test]
fn every_step_stiffness_and_start_is_stable() {
    let topology = benchmark_network(40, 180).1;
    let ratios: Vec<f64> = (0..40).map(|p| [1.0, 1e6, 1e-3, 1e3][p % 4]).collect();
    for h in [1e-5, 1e-3, 1.0 / 90.0, 1.0 / 11.0, 1.0] {
        for stiffness in [1.0, 1e3, 1e6, 1e9] {
            for (damping, coupling) in [(0.0, 1.0), (0.05, 1.0), (0.3, 1000.0), (0.8, 0.1)] {
                for (masses, flat) in [(None, false), (None, true), (Some(ratios.as_slice()), false)] {
                    let settings = settings(f64::sqrt(stiffness) / std::f64::consts::TAU, damping, coupling);
                    let run = run(&topology, masses, settings, h, flat);
                    let name = format!("h {h} k {stiffness} damping {damping} coupling {coupling} masses {}", masses.is_some());
                    assert!(run.peak.is_finite(), "{name}");
                    if masses.is_none() {
                        assert!(run.peak < 3.0, "{name}: peak {}", run.peak);
                    }
                    if damping == 0.0 {
                        assert!(run.energy_error < 1e-3, "{name}: energy {}", run.energy_error);
                    } else {
                        let scale = if masses.is_some() { 1e3 } else { 1.0 };
                        assert!(run.end < 1e-4 * scale, "{name}: end {}", run.end);
                    }
                }
            }
        }
    }
}

/// Broken twin of the stability set: symplectic Euler at 90 Hz past its limit.
#[test]
fn symplectic_euler_fails_the_stability_set() {
    let topology = benchmark_network(40, 180).1;
    let mut reference = ReferenceNetwork::new(&topology, settings(30.0, 0.05, 1.0));
    reference.u[0] = [1.0, 0.0, 0.0];
    (0..200).for_each(|_| reference.step(Integrator::SymplecticEuler, 1.0 / 90.0));
    let size = largest(&reference.u);
    assert!(size.is_nan() || size > 1e3);
}

#[test]
fn coinciding_particles_and_strong_springs_are_harmless() {
    // Particles at one point would weigh their spring by 1 / 0: the map caps it, the network must bear the cap.
    let topology = NetworkTopology::from_pairs(3, [(0, 1, 1e12f32), (1, 2, 1.0)].into_iter());
    for damping in [0.0, 0.1, 2.0] {
        let mut network = Network::new(&topology, settings(10.0, damping, 1.0), 1e-9).unwrap();
        random_state(&mut network, 1.0, false, 2);
        let mut scratch = StepScratch::default();
        for _ in 0..300 {
            network.step(FRAME, &mut scratch);
            assert!(largest(network.displacements()) < 3.0);
        }
        assert_eq!(network.quarantined(), 0);
    }
}

#[test]
fn a_network_goes_to_its_rest_displacement_whatever_the_method() {
    let topology = small();
    for reach in [2.0, 15.0, 1e4] {
        for damping in [0.7, 3.0] {
            let mut network = Network::new(&topology, settings_for(&topology, reach, damping), 1.0).unwrap();
            let rest: Vec<[f64; 3]> = (0..60).map(|p| [0.01 * p as f64, 0.2, -0.1]).collect();
            network.set_rest_displacements(&rest);
            let mut scratch = StepScratch::default();
            for _ in 0..20_000 {
                network.step(FRAME, &mut scratch);
            }
            // Asleep, and then exactly there.
            assert!(!network.awake(), "reach {reach} damping {damping}");
            assert_eq!(network.displacements(), &rest[..]);
            // Broken twin: the old rest displacement.
            assert!(max_difference(network.displacements(), &vec![[0.0; 3]; 60]) > 0.1);
        }
    }
}

#[test]
fn a_constant_force_bends_it_to_the_static_answer_whatever_the_method() {
    let topology = small();
    for reach in [3.0, 1e4] {
        let mut network = Network::new(&topology, settings_for(&topology, reach, 0.9), 1.0).unwrap();
        let force = network.settings().anchor_rate() * 0.1;
        network.set_force(ParticleId(7), DVec3::new(force, 0.0, 0.0));
        network.set_grabs(&[(ParticleId(20), DVec3::new(0.0, 0.05, 0.0))]);
        let mut scratch = StepScratch::default();
        frames(&mut network, 3000, &mut scratch);
        assert!(!network.awake() && network.is_grabbed(ParticleId(20)));
        let mut reference = reference_of(&network, &topology);
        reference.forces[7] = [force, 0.0, 0.0];
        reference.held[20] = true;
        reference.v.fill([0.0; 3]);
        let energy = |r: &ReferenceNetwork| r.energy();
        let least = energy(&reference);
        // Static equilibrium is the least energy: any small change of a free particle costs.
        for p in [0, 7, 33] {
            for push in [1e-3, -1e-3] {
                let mut changed = reference.clone();
                changed.u[p][0] += push;
                assert!(energy(&changed) > least);
            }
        }
        let mut broken = reference.clone();
        broken.u[7][0] += 0.02;
        let moved = energy(&broken);
        broken.u[7][0] -= 1e-3;
        assert!(energy(&broken) < moved);
    }
}

#[test]
fn a_disturbed_corner_wakes_only_its_surroundings_and_loses_nothing() {
    let topology = benchmark_network(2000, 12_000).1;
    let settings = NetworkSettings { coupling: 0.1, ..settings_for(&topology, 2.0, 1.0) };
    let poke = |length: f64| {
        let mut network = Network::new(&topology, settings, length).unwrap();
        network.set_state(ParticleId(5), DVec3::new(0.003, 0.0, 0.0), DVec3::ZERO);
        let mut scratch = StepScratch::default();
        let mut awake = Vec::new();
        for _ in 0..10 {
            awake.push(network.step(FRAME, &mut scratch).awake);
        }
        (network, awake)
    };
    let (local, awake) = poke(1.0);
    assert!(awake[0] > 10 && awake.iter().all(|a| *a < 1000), "{awake:?}");
    let (whole, all) = poke(1e-30);
    assert!(all[9] > 2 * awake[9]);
    let error = max_difference(local.displacements(), whole.displacements());
    assert!(error < 2e-6, "{error}");
    // Broken twin: with a threshold a hundred times as large the rest is not rest any more.
    let (loose, _) = poke(300.0);
    assert!(max_difference(loose.displacements(), whole.displacements()) > 2e-6);
}

#[test]
fn sleep_costs_nothing_and_ends_at_any_touch() {
    let topology = small();
    let mut network = Network::new(&topology, NetworkSettings::FIRM, 1.0).unwrap();
    let mut scratch = StepScratch::default();
    assert_eq!(network.step(FRAME, &mut scratch).method, StepMethod::Asleep);
    let touches: [fn(&mut Network); 5] = [
        |n| n.set_force(ParticleId(1), DVec3::X),
        |n| n.clear_forces(),
        |n| n.set_grabs(&[(ParticleId(2), DVec3::Y)]),
        |n| n.set_grabs(&[]),
        |n| n.set_rest_displacement(ParticleId(4), DVec3::Z),
    ];
    for touch in touches {
        touch(&mut network);
        assert!(network.awake());
        frames(&mut network, 2000, &mut scratch);
        let report = network.step(FRAME, &mut scratch);
        assert_eq!((report.method, report.awake), (StepMethod::Asleep, 0));
    }
    // The same values again are no touch.
    network.set_rest_displacement(ParticleId(4), DVec3::Z);
    network.clear_forces();
    network.set_grabs(&[]);
    assert!(!network.awake());
}

#[test]
fn a_component_that_nothing_drives_ends_at_zero_and_not_in_denormals() {
    let topology = small();
    let mut network = Network::new(&topology, settings_for(&topology, 7.0, 0.3), 1e-30).unwrap();
    random_state(&mut network, 1.0, false, 4);
    let mut scratch = StepScratch::default();
    for frame in 0..3000 {
        let push = if frame % 64 < 32 { 1.0 } else { -1.0 };
        network.set_force(ParticleId(9), DVec3::new(push, 0.0, 0.0));
        network.step(FRAME, &mut scratch);
    }
    let sizes = |k: usize| network.displacements().iter().map(move |u| u[k].abs());
    assert!(sizes(0).all(|x| x > 1e-30), "what is driven goes on");
    assert!(sizes(1).all(|y| y == 0.0 || y > 1e-200), "{:e}", sizes(1).fold(1.0, f64::min));
}

/// Ten minutes at 60 Hz of a beating rest displacement and a poke a second: the last beat is the tenth beat.
#[test]
fn ten_minutes_do_not_drift() {
    let topology = benchmark_network(30, 120).1;
    let mut network = Network::new(&topology, NetworkSettings { damping_ratio: 0.15, ..NetworkSettings::SOFT }, 1e-9).unwrap();
    let mut scratch = StepScratch::default();
    let mut snapshots = Vec::new();
    for frame in 0..36_000 {
        let phase = std::f64::consts::TAU * (frame % 60) as f64 / 60.0;
        network.set_rest_displacement(ParticleId(3), DVec3::new(0.1 * phase.sin(), 0.02 * phase.cos(), 0.0));
        let poke = if frame % 60 < 5 { DVec3::new(0.0, 0.0, 9.0) } else { DVec3::ZERO };
        network.set_force(ParticleId(20), poke);
        network.step(FRAME, &mut scratch);
        if [600, 35_940, 35_950].contains(&frame) {
            snapshots.push(network.displacements().to_vec());
        }
    }
    assert!(max_difference(&snapshots[0], &snapshots[1]) < 1e-9);
    assert!(max_difference(&snapshots[0], &snapshots[2]) > 1e-3);
}

#[test]
fn settings_change_keeps_the_state_and_the_new_law_holds() {
    let topology = small();
    let mut network = Network::new(&topology, settings_for(&topology, 4.0, 0.1), 1e-9).unwrap();
    random_state(&mut network, 1.0, false, 9);
    let mut scratch = StepScratch::default();
    frames(&mut network, 5, &mut scratch);
    let before = network.displacements().to_vec();
    network.set_settings(settings_for(&topology, 6.0, 0.4)).unwrap();
    assert_eq!(network.displacements(), &before[..]);
    assert!(network.set_settings(settings(-1.0, 0.1, 1.0)).is_err());
    let mut reference = reference_of(&network, &topology);
    let mut old_law = reference.clone();
    old_law.settings = settings_for(&topology, 4.0, 0.1);
    for _ in 0..10 {
        network.step(FRAME, &mut scratch);
        advance(&mut reference, FRAME, 300);
        advance(&mut old_law, FRAME, 300);
    }
    assert!(max_difference(network.displacements(), &reference.u) < 1e-3);
    assert!(max_difference(network.displacements(), &old_law.u) > 1e-2);
}

#[test]
fn topology_change_keeps_survivors_by_id() {
    let topology = small();
    let mut network = Network::new(&topology, NetworkSettings::SOFT, 1.0).unwrap();
    random_state(&mut network, 1.0, false, 4);
    network.set_grabs(&[(ParticleId(9), DVec3::X)]);
    let mut scratch = StepScratch::default();
    frames(&mut network, 3, &mut scratch);
    let state = |n: &Network, p: u32| (n.displacement(ParticleId(p)), n.velocity(ParticleId(p)), n.is_grabbed(ParticleId(p)));
    let before: Vec<_> = (0..60).map(|p| state(&network, p)).collect();
    let larger = NetworkTopology::from_pairs(63, [(60, 61, 1.0), (3, 61, 1.0), (5, 9, 2.0)].into_iter());
    network.set_topology(&larger, None);
    assert!((0..60).all(|p| state(&network, p) == before[p as usize]));
    assert_eq!(state(&network, 61), (DVec3::ZERO, DVec3::ZERO, false));
    network.set_topology(&benchmark_network(40, 100).1, None);
    assert!(network.len() == 40 && (0..40).all(|p| state(&network, p) == before[p as usize]));
    network.step(FRAME, &mut scratch);
    assert_ne!(state(&network, 1), before[1]);
}

#[test]
fn what_is_not_finite_is_refused_or_taken_back() {
    let topology = small();
    let mut network = Network::new(&topology, NetworkSettings::SOFT, 1.0).unwrap();
    network.set_force(ParticleId(0), DVec3::new(f64::NAN, 0.0, 0.0));
    network.set_state(ParticleId(1), DVec3::splat(1e300), DVec3::ZERO);
    network.set_rest_displacements(&[[f64::INFINITY; 3]; 60]);
    network.set_grabs(&[(ParticleId(77), DVec3::ZERO)]);
    assert_eq!((network.refused(), network.awake()), (63, false));
    random_state(&mut network, 0.1, false, 1);
    let mut scratch = StepScratch::default();
    network.step(FRAME, &mut scratch);
    let good = network.displacements().to_vec();
    network.v[3] = [f64::NAN, 0.0, 0.0, 0.0];
    let report = network.step(FRAME, &mut scratch);
    assert_eq!((report.method, network.quarantined()), (StepMethod::Quarantined, 1));
    assert_eq!(network.displacements(), &good[..]);
    assert_eq!(network.step(FRAME, &mut scratch).method, StepMethod::Chebyshev);
    // A state that is broken itself goes back to rest.
    network.e[3] = [f64::NAN, 0.0, 0.0, 0.0];
    frames(&mut network, 4, &mut scratch);
    assert!(largest(network.displacements()).is_finite());
    assert_ne!(network.step(FRAME, &mut scratch).method, StepMethod::Quarantined);
}

#[test]
fn odd_steps_do_nothing_or_are_shortened() {
    let topology = small();
    let mut network = Network::new(&topology, NetworkSettings::SOFT, 1.0).unwrap();
    random_state(&mut network, 0.1, false, 1);
    let before = network.displacements().to_vec();
    let mut scratch = StepScratch::default();
    for h in [0.0, -1.0, 1e-300, f64::NAN] {
        assert_eq!(network.step(h, &mut scratch).method, StepMethod::Asleep);
        assert_eq!(network.displacements(), &before[..]);
    }
    assert_eq!(network.step(f64::INFINITY, &mut scratch).step, 1.0);
    let mut empty = Network::default();
    assert_eq!(empty.step(FRAME, &mut scratch).method, StepMethod::Asleep);
}

#[test]
fn a_steady_step_neither_grows_memory_nor_refits() {
    let topology = small();
    let mut network = Network::new(&topology, settings_for(&topology, 7.0, 0.1), 1e-30).unwrap();
    random_state(&mut network, 1.0, false, 1);
    let mut scratch = StepScratch::default();
    let mut frame = |k: usize, network: &mut Network| {
        network.set_rest_displacement(ParticleId(8), DVec3::splat(0.001 * k as f64));
        network.set_grabs(&[(ParticleId(11), DVec3::splat(0.002 * k as f64))]);
        network.set_force(ParticleId(5), DVec3::splat(k as f64));
        network.step(FRAME, &mut scratch);
        (scratch.capacities(), scratch.series_updates(), network.activity.capacities())
    };
    let first = frame(1, &mut network);
    for k in 2..200 {
        assert_eq!(frame(k, &mut network), first);
    }
}

/// The same network in another particle order does the same: nothing depends on where a particle happens to stand.
#[test]
fn renaming_particles_changes_nothing_but_names() {
    let topology = small();
    let rename = |p: u32| (p * 7 + 3) % 60;
    let pairs: Vec<(u32, u32, f32)> = (0..60u32)
        .flat_map(|a| {
            let (columns, weights) = topology.row(a as usize);
            columns.iter().zip(weights).filter(move |(b, _)| a < **b).map(move |(b, w)| (rename(a), rename(*b), *w))
        })
        .collect();
    let renamed = NetworkTopology::from_pairs(60, pairs.into_iter());
    let settings = settings_for(&topology, 7.0, 0.1);
    let (mut a, mut b) = (Network::new(&topology, settings, 1.0).unwrap(), Network::new(&renamed, settings, 1.0).unwrap());
    random_state(&mut a, 1.0, false, 1);
    for p in 0..60 {
        b.set_state(ParticleId(rename(p)), a.displacement(ParticleId(p)), DVec3::ZERO);
    }
    let mut scratch = StepScratch::default();
    for _ in 0..30 {
        a.step(FRAME, &mut scratch);
        b.step(FRAME, &mut scratch);
    }
    let apart = |q: fn(u32) -> u32| {
        (0..60).map(|p| (a.displacement(ParticleId(p)) - b.displacement(ParticleId(q(p)))).length()).fold(0.0, f64::max)
    };
    assert!(apart(|p| (p * 7 + 3) % 60) < 1e-9);
    assert!(apart(|p| p) > 1e-3);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..Default::default() })]

    /// Any material and step: bounded, no quarantine, and no energy from nowhere.
    #[test]
    fn energy_never_grows(
        log_stiffness in 0.0f64..9.0, log_step in -5.0f64..0.0, damping in 0.0f64..3.0, log_coupling in -2.0f64..3.0, seed in 0u64..1000,
    ) {
        let topology = benchmark_network(24, 80).1;
        let frequency = 10f64.powf(0.5 * log_stiffness) / std::f64::consts::TAU;
        let mut network = Network::new(&topology, settings(frequency, damping, 10f64.powf(log_coupling)), 1e-9).unwrap();
        random_state(&mut network, 1.0, false, seed);
        let start = network.energy();
        let mut scratch = StepScratch::default();
        for _ in 0..30 {
            network.step(10f64.powf(log_step), &mut scratch);
            prop_assert!(network.energy() <= start * (1.0 + 1e-3));
        }
        prop_assert_eq!(network.quarantined(), 0);
    }
}
