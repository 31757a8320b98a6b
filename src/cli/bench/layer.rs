//! The soft layer: steps of the network beside other integrators, and sampling.

use super::super::CliError;
use super::{Row, time_ms};
use crate::formats;
use crate::geometry::ParticleId;
use crate::particles::{PoissonScratch, sample_count, sample_quality, sample_with};
use crate::physics::reference::{Integrator, ReferenceNetwork, SplitMix, benchmark_network, max_difference};
use crate::physics::{Network, NetworkSettings, NetworkTopology, StepScratch};
use glam::DVec3;

const STEP: f64 = 1.0 / 60.0;

/// Steps: one second.
const STEPS: usize = 60;

const ERROR: &str = "worst over 1 s, of the start";

pub(super) fn measure(quick: bool, note: &mut impl FnMut(Row)) -> Result<(), CliError> {
    let (_, topology) = benchmark_network(200, 1256);
    for reach in [2.0, 7.0, 15.0] {
        for row in steps(&topology, reach)? {
            note(row);
        }
    }
    let sizes: &[(usize, usize)] = if quick { &[(10_000, 190)] } else { &[(10_000, 190), (2_000_000, 20_000)] };
    for &(faces, wanted) in sizes {
        note(sampling(faces, wanted, if quick { 5 } else { 11 })?);
    }
    Ok(())
}

/// A way to go one step on, and what stands after it.
type Stepper = Box<dyn FnMut() -> (f64, Vec<[f64; 3]>)>;

fn steps(topology: &NetworkTopology, reach: f64) -> Result<Vec<Row>, CliError> {
    let unit = NetworkSettings { frequency_hz: 1.0, damping_ratio: 0.1, coupling: 1.0, rotations: false };
    let (_, high) = Network::new(topology, unit, 1.0).map_err(CliError::run)?.spectrum();
    let settings = NetworkSettings { frequency_hz: reach / (STEP * high.sqrt()), ..unit };
    let mut network = Network::new(topology, settings, 1e-30).map_err(CliError::run)?;
    let mut random = SplitMix(7);
    for p in 0..topology.particles() as u32 {
        network.set_state(ParticleId(p), DVec3::from_array(std::array::from_fn(|_| random.signed())), DVec3::ZERO);
    }
    let start = network.displacements().to_vec();
    let mut steppers: Vec<(String, Stepper)> = vec![("incise".into(), ours(network))];
    for (name, integrator, substeps) in [
        ("symplectic Euler x16", Integrator::SymplecticEuler, 16),
        ("implicit Euler", Integrator::ImplicitEuler, 1),
        ("Crank-Nicolson", Integrator::CrankNicolson, 1),
    ] {
        steppers.push((name.into(), peer(topology, settings, &start, integrator, substeps)));
    }
    let mut reference = ReferenceNetwork::new(topology, settings);
    reference.u = start;
    let scale = max_difference(&reference.u, &vec![[0.0; 3]; reference.u.len()]);
    let substeps = (reach / 0.02).ceil() as usize;
    let mut figures = vec![(Vec::with_capacity(STEPS), 0.0f64); steppers.len()];
    for _ in 0..STEPS {
        (0..substeps).for_each(|_| reference.step(Integrator::RungeKutta, STEP / substeps as f64));
        for ((_, stepper), (times, worst)) in steppers.iter_mut().zip(&mut figures) {
            let (ms, u) = stepper();
            times.push(ms);
            let error = max_difference(&u, &reference.u) / scale;
            // NaN must not hide behind a maximum
            *worst = if error.is_nan() || worst.is_nan() { f64::NAN } else { worst.max(error) };
        }
    }
    let rows = steppers.iter().zip(&mut figures).map(|((name, _), (times, error))| {
        Row::new("step, 200 particles", format!("h omega {reach}, {name}"), times, *error, ERROR)
    });
    Ok(rows.collect())
}

fn ours(mut network: Network) -> Stepper {
    let mut scratch = StepScratch::default();
    Box::new(move || (time_ms(|| network.step(STEP, &mut scratch)).0, network.displacements().to_vec()))
}

/// Another integrator, written plainly: its time is an upper bound of what it needs.
fn peer(
    topology: &NetworkTopology,
    settings: NetworkSettings,
    start: &[[f64; 3]],
    integrator: Integrator,
    substeps: usize,
) -> Stepper {
    let mut network = ReferenceNetwork::new(topology, settings);
    network.u = start.to_vec();
    Box::new(move || {
        let (ms, ()) = time_ms(|| (0..substeps).for_each(|_| network.step(integrator, STEP / substeps as f64)));
        (ms, network.u.clone())
    })
}

fn sampling(faces: usize, wanted: usize, repetitions: usize) -> Result<Row, CliError> {
    let model = formats::load_generated("sphere", faces).map_err(CliError::run)?;
    let rest: Vec<DVec3> = (0..model.rows.len()).map(|v| model.rows.rest(crate::geometry::VertexId::new(v))).collect();
    let (spacing, _) = sample_count(&model.mesh, &rest, wanted, 1);
    let (mut scratch, mut samples) = (PoissonScratch::default(), Vec::new());
    let mut times: Vec<f64> =
        (0..repetitions).map(|_| time_ms(|| sample_with(&model.mesh, &rest, spacing, 1, &mut scratch, &mut samples)).0).collect();
    let quality = sample_quality(&model.mesh, &rest, &samples, spacing);
    let case = format!("{} vertices, {} samples", rest.len(), samples.len());
    Ok(Row::new("Poisson-disk sampling", case, &mut times, 1.0 - quality.radius_ratio, "1 less the radius ratio"))
}
