//! One step of the particle network: time, and error as MATHS 4.3, on the benchmark networks of `physics::reference`.

use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;
use incise::geometry::ParticleId;
use incise::physics::reference::{Integrator, ReferenceNetwork, SplitMix, benchmark_network, max_difference, parse_network};
use incise::physics::{Network, NetworkSettings, NetworkTopology, StepScratch};
use std::hint::black_box;
use std::time::Instant;

const STEP: f64 = 1.0 / 60.0;

/// Settings whose step of 1/60 s has the wanted `h omega_max` (Gershgorin), coupling 1, damping ratio 0.1.
fn settings_for(topology: &NetworkTopology, reach: f64) -> NetworkSettings {
    let unit = NetworkSettings { frequency_hz: 1.0, damping_ratio: 0.1, coupling: 1.0, rotations: false };
    let (_, high) = Network::new(topology, unit, 1.0).expect("valid").spectrum();
    NetworkSettings { frequency_hz: reach / (STEP * high.sqrt()), ..unit }
}

/// Random displacements, nothing sleeping.
fn excited(topology: &NetworkTopology, settings: NetworkSettings) -> Network {
    let mut network = Network::new(topology, settings, 1e-30).expect("valid");
    let mut random = SplitMix(7);
    for p in 0..topology.particles() as u32 {
        let u = DVec3::from_array(std::array::from_fn(|_| random.signed()));
        network.set_state(ParticleId(p), u, DVec3::ZERO);
    }
    network
}

/// Error of one second of steps of `step`, against Runge-Kutta at `h omega` = 0.02.
fn errors(topology: &NetworkTopology, reach: f64, steppers: &mut [(&str, Stepper)]) -> Vec<f64> {
    let settings = settings_for(topology, reach);
    let mut reference = ReferenceNetwork::new(topology, settings);
    reference.u = excited(topology, settings).displacements().to_vec();
    let scale = max_difference(&reference.u, &vec![[0.0; 3]; reference.u.len()]);
    let mut worst = vec![0.0f64; steppers.len()];
    let substeps = (reach / 0.02) as usize;
    for _ in 0..60 {
        (0..substeps).for_each(|_| reference.step(Integrator::RungeKutta, STEP / substeps as f64));
        for ((_, stepper), worst) in steppers.iter_mut().zip(&mut worst) {
            *worst = worst.max(max_difference(&stepper(), &reference.u) / scale);
        }
    }
    worst
}

type Stepper = Box<dyn FnMut() -> Vec<[f64; 3]>>;

fn ours(topology: &NetworkTopology, reach: f64) -> Stepper {
    let mut network = excited(topology, settings_for(topology, reach));
    let mut scratch = StepScratch::default();
    Box::new(move || {
        network.step(STEP, &mut scratch);
        network.displacements().to_vec()
    })
}

fn peer(topology: &NetworkTopology, reach: f64, integrator: Integrator, substeps: usize) -> Stepper {
    let settings = settings_for(topology, reach);
    let mut network = ReferenceNetwork::new(topology, settings);
    network.u = excited(topology, settings).displacements().to_vec();
    Box::new(move || {
        (0..substeps).for_each(|_| network.step(integrator, STEP / substeps as f64));
        network.u.clone()
    })
}

/// The soft body of rapier3d with the law of MATHS 4.1: its edges are springs along their length, which are linear and pull alike in
/// all directions where the rest length is 0. So its particles are placed at their displacements, each tied to the origin for its
/// anchor. What tiny steps of it converge to is then our reference (at `h omega_max` 2 its error is 0.77, 0.34, 0.12
/// and 0.033 with 4, 16, 64 and 256 substeps). State is f32; a substep is one of its steps, for
/// it applies damping once a step, with the four sweeps over the edges that are its default.
fn rapier(topology: &NetworkTopology, reach: f64, substeps: usize) -> Stepper {
    use rapier3d::prelude::*;
    let settings = settings_for(topology, reach);
    let n = topology.particles();
    let mut edges: Vec<[u32; 2]> = (0..n as u32).map(|p| [p, p + n as u32]).collect();
    let mut softness: Vec<(u32, SpringCoefficients<f32>)> = Vec::new();
    for p in 0..n as u32 {
        softness.push((p, SpringCoefficients::new(settings.frequency_hz as f32, 0.0)));
    }
    for p in 0..n {
        let (columns, weights) = topology.row(p);
        for (&other, &weight) in columns.iter().zip(weights).filter(|(other, _)| **other as usize > p) {
            // a spring of a natural frequency is as stiff as half the mass, that of the pair, needs
            let stiffness = settings.anchor_rate() * settings.coupling * f64::from(weight);
            let frequency = (2.0 * stiffness).sqrt() / std::f64::consts::TAU;
            softness.push((edges.len() as u32, SpringCoefficients::new(frequency as f32, 0.0)));
            edges.push([p as u32, other]);
        }
    }
    let mut builder = SoftBodyBuilder::new(vec![Vector::ZERO; 2 * n])
        .particle_mass(1.0)
        .pinned_particles(n as u32..2 * n as u32)
        .edges(edges)
        .no_surface_collider()
        .linear_damping(settings.damping_rate() as f32)
        .can_sleep(false);
    builder.edge_softness = softness;
    let (mut bodies, mut colliders, mut soft_bodies) = (RigidBodySet::new(), ColliderSet::new(), SoftBodySet::new());
    let body = soft_bodies.insert(builder, &mut bodies, &mut colliders);
    if let Some(body) = soft_bodies.get_mut(body) {
        for (p, u) in excited(topology, settings).displacements().iter().enumerate() {
            body.set_particle_position(p, Vector::from_array(u.map(|x| x as f32)));
        }
    }
    let dt = (STEP / substeps as f64) as f32;
    let mut parameters = IntegrationParameters { dt, num_solver_iterations: 1, ..Default::default() };
    parameters.normalized_max_linear_velocity = f32::MAX;
    parameters.soft_bodies.max_extra_substeps = 0;
    let (mut pipeline, mut islands, mut broad, mut narrow) =
        (PhysicsPipeline::new(), IslandManager::new(), BroadPhaseBvh::new(), NarrowPhase::new());
    let (mut joints, mut multibodies, mut ccd) = (ImpulseJointSet::new(), MultibodyJointSet::new(), CCDSolver::new());
    Box::new(move || {
        for _ in 0..substeps {
            pipeline.step(
                Vector::ZERO,
                &parameters,
                &mut islands,
                &mut broad,
                &mut narrow,
                &mut bodies,
                &mut colliders,
                &mut joints,
                &mut multibodies,
                &mut soft_bodies,
                &mut ccd,
                &(),
                &(),
            );
        }
        let body = soft_bodies.get(body).expect("nobody removed it");
        body.particle_positions().take(n).map(|p| p.to_array().map(f64::from)).collect()
    })
}

/// Seconds that one second of simulated time takes, the best of three.
fn cost(make: impl Fn() -> Stepper) -> f64 {
    let run = || {
        let mut stepper = make();
        stepper();
        let start = Instant::now();
        (0..60).for_each(|_| drop(black_box(stepper())));
        start.elapsed().as_secs_f64()
    };
    (0..3).map(|_| run()).fold(f64::INFINITY, f64::min)
}

/// What steps the network, with its substeps.
#[derive(Clone, Copy)]
enum Method {
    Incise,
    Peer(Integrator, usize),
    Rapier(usize),
}

/// Error against time on the fixed network, as MATHS 4.3. The peers are written plainly (`physics::reference`): their errors
/// are exact, their times are those of plain loops.
fn accuracy(topology: &NetworkTopology) {
    println!("error over 1 s and time of a 1/60 s step; 200 particles, 1,256 springs, damping ratio 0.1");
    println!("{:>12} {:<24} {:>10} {:>12}", "h omega_max", "method", "error", "us a step");
    for reach in [2.0, 4.0, 7.0, 13.0, 15.0, 30.0] {
        let mut names = vec![("incise".to_string(), Method::Incise)];
        for substeps in [4, 16, 64] {
            names.push((format!("symplectic Euler x{substeps}"), Method::Peer(Integrator::SymplecticEuler, substeps)));
        }
        for substeps in [1, 4] {
            names.push((format!("implicit Euler x{substeps}"), Method::Peer(Integrator::ImplicitEuler, substeps)));
            names.push((format!("Crank-Nicolson x{substeps}"), Method::Peer(Integrator::CrankNicolson, substeps)));
        }
        for substeps in [4, 16, 64] {
            names.push((format!("XPBD x{substeps}"), Method::Peer(Integrator::Xpbd, substeps)));
        }
        for substeps in [4, 16, 64] {
            names.push((format!("rapier soft body x{substeps}"), Method::Rapier(substeps)));
        }
        let make = |method: Method| match method {
            Method::Incise => ours(topology, reach),
            Method::Peer(integrator, substeps) => peer(topology, reach, integrator, substeps),
            Method::Rapier(substeps) => rapier(topology, reach, substeps),
        };
        let mut steppers: Vec<(&str, Stepper)> = names.iter().map(|(name, method)| (name.as_str(), make(*method))).collect();
        let errors = errors(topology, reach, &mut steppers);
        for ((name, method), error) in names.iter().zip(errors) {
            let time = cost(|| make(*method)) / 60.0 * 1e6;
            println!("{reach:>12} {name:<24} {error:>10.2e} {time:>12.1}");
        }
    }
}

/// Time of one step, the least of many short runs: what is left when nothing else runs.
fn least_times() {
    for (particles, springs) in [(200, 1256), (20_000, 154_000)] {
        let (_, topology) = benchmark_network(particles, springs);
        for reach in [7.0, 15.0] {
            let mut network = excited(&topology, settings_for(&topology, reach));
            let mut scratch = StepScratch::default();
            let (rounds, steps) = if particles < 1000 { (3000, 10) } else { (60, 1) };
            let mut least = f64::INFINITY;
            for round in 0..rounds {
                push(&mut network, if round % 2 == 0 { 0.1 } else { -0.1 });
                let start = Instant::now();
                for _ in 0..steps {
                    black_box(network.step(STEP, &mut scratch));
                }
                least = least.min(start.elapsed().as_secs_f64() / f64::from(steps));
            }
            println!("least time of a step, {particles} particles, h omega_max {reach}: {:.1} us", least * 1e6);
        }
    }
}

/// Forces that change now and then: without them a long run would come to rest, and rest costs nothing.
fn push(network: &mut Network, size: f64) {
    let size = size * network.settings().anchor_rate();
    for p in 0..network.len() as u32 {
        let force = if p % 2 == 0 { size } else { -size };
        network.set_force(ParticleId(p), DVec3::new(force, 0.0, 0.5 * force));
    }
}

fn times(criterion: &mut Criterion) {
    if !std::env::args().any(|a| a == "--test") {
        let fixed = parse_network(include_str!("network-200.txt")).expect("a network");
        least_times();
        accuracy(&fixed);
    }
    for (particles, springs) in [(200, 1256), (20_000, 154_000)] {
        let (_, topology) = benchmark_network(particles, springs);
        for reach in [2.0, 7.0, 15.0, 60.0, 2000.0] {
            let settings = settings_for(&topology, reach);
            let mut network = excited(&topology, settings);
            let mut scratch = StepScratch::default();
            let report = network.step(STEP, &mut scratch);
            let name = format!("step/{particles}/h_omega {reach}/{:?} {}", report.method, report.degree);
            let mut count = 0;
            criterion.bench_function(&name, |b| {
                b.iter(|| {
                    count += 1;
                    if count % 32 == 1 {
                        push(&mut network, if count % 64 == 1 { 0.1 } else { -0.1 });
                    }
                    black_box(network.step(STEP, &mut scratch))
                })
            });
            assert_eq!(network.awake_particles(), particles);
        }
        let mut resting = Network::new(&topology, NetworkSettings::FIRM, 1.0).expect("valid");
        let mut scratch = StepScratch::default();
        criterion.bench_function(&format!("step/{particles}/asleep"), |b| b.iter(|| resting.step(STEP, &mut scratch)));
        criterion.bench_function(&format!("set_topology/{particles}"), |b| b.iter(|| resting.set_topology(&topology, None)));
    }
}

criterion_group!(network, times);
criterion_main!(network);
