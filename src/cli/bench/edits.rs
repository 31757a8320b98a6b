//! Tears and cuts, with what they must conserve.

use super::super::CliError;
use super::super::common::{particle_settings, tissue_settings};
use super::{Row, time_ms};
use crate::config::Config;
use crate::formats;
use crate::geometry::Plane;
use crate::input::ParticleOverrides;
use crate::scene::{EditCommand, EditReport, Scene, SceneSettings};
use crate::surgery::BladePose;
use crate::tissue::Tissue;
use glam::DVec3;

/// Boxes of a stroke.
const SEGMENTS: usize = 24;

/// The paper's rows, as reports name them.
const ROWS: [&str; 5] = ["perform_tear", "update_particles", "disconnect_particles", "bind", "update_mesh"];

pub(super) fn measure(quick: bool, config: &Config, note: &mut impl FnMut(Row)) -> Result<(), CliError> {
    let sizes: &[usize] = if quick { &[768, 5_000, 18_000] } else { &[768, 5_000, 18_000, 100_000, 1_000_000] };
    for &faces in sizes {
        let mut subject = Subject::new(faces, config)?;
        for row in subject.tears(if quick { 2 } else { 8 }) {
            note(row);
        }
        note(subject.cuts(if quick { 5 } else { 21 }));
    }
    Ok(())
}

/// A sphere under the knife.
struct Subject {
    scene: Scene,
    case: String,
    low: DVec3,
    high: DVec3,
    /// Mean edge, metres.
    edge: f64,
}

impl Subject {
    fn new(faces: usize, config: &Config) -> Result<Self, CliError> {
        let model = formats::load_generated("sphere", faces).map_err(CliError::run)?;
        let faces = model.mesh.face_count();
        let particles = particle_settings(&model, config, &ParticleOverrides::default(), 1)?;
        let tissue = Tissue::new(model, &tissue_settings(config, Some(particles))).map_err(CliError::run)?;
        let (low, high) = tissue.bounds();
        let edge = (tissue.measure_all().area / faces as f64 * 4.0 / 3f64.sqrt()).sqrt();
        let sample_distance = Some(2.0 * edge);
        let settings = SceneSettings { sampling: config.sampling, sample_distance, sample_time: Some(f64::INFINITY) };
        Ok(Self { scene: Scene::new(tissue, settings), case: format!("sphere, {faces} faces"), low, high, edge })
    }

    /// A stroke over the top, two edges a box, so that every size has as many faces crossed.
    fn stroke(&mut self, turn: f64) -> Option<EditReport> {
        let (centre, radius) = ((self.low + self.high) / 2.0, (self.high - self.low).max_element() / 2.0);
        let along = DVec3::new(turn.cos(), turn.sin(), 0.0);
        let step = 2.0 * self.edge / radius;
        self.scene.edit(EditCommand::StrokeBegin { width: 0.5 * self.edge });
        for k in 0..=SEGMENTS {
            let angle = (k as f64 - SEGMENTS as f64 / 2.0) * step;
            let out = DVec3::Z * angle.cos() + along * angle.sin();
            let pose = BladePose {
                t: k as f64,
                tip: centre + out * (radius - 2.0 * self.edge).max(0.2 * radius),
                base: centre + out * 2.0 * radius,
            };
            self.scene.edit(EditCommand::StrokePose(pose));
        }
        self.scene.edit(EditCommand::StrokeEnd).pop()
    }

    fn tears(&mut self, repetitions: usize) -> Vec<Row> {
        let (mut totals, mut error) = (Vec::new(), 0.0f64);
        let mut stages: Vec<Vec<f64>> = vec![Vec::new(); ROWS.len()];
        for turn in 0..repetitions {
            let Some(report) = self.stroke(turn as f64) else { continue };
            let left: f64 = report.pieces.iter().map(|p| p.area).sum();
            error = error.max((report.area_before - report.area_removed - left).abs() / report.area_before);
            for segment in &report.segments {
                totals.push(segment.stages.total());
                for (row, times) in ROWS.iter().zip(&mut stages) {
                    times.push(segment.stages.get(row));
                }
            }
            self.scene.edit(EditCommand::Undo);
        }
        let of = "area: before less taken less left";
        let mut rows = vec![Row::new("tear, one segment", &*self.case, &mut totals, error, of)];
        rows.extend(
            ROWS.iter().zip(&mut stages).map(|(row, times)| Row::new(&format!("  {row}"), &*self.case, times, error, of)),
        );
        rows
    }

    fn cuts(&mut self, repetitions: usize) -> Row {
        let centre = (self.low + self.high) / 2.0;
        let (mut times, mut error) = (Vec::new(), 0.0f64);
        for k in 0..repetitions {
            let turn = 0.1 + k as f64;
            let normal = DVec3::new(turn.cos(), turn.sin(), 0.37);
            let (ms, reports) =
                time_ms(|| self.scene.edit(EditCommand::Cut(Plane::Equation { normal, offset: normal.dot(centre) })));
            times.push(ms);
            let off = reports.iter().filter_map(|r| r.max_plane_distance).fold(0.0, f64::max);
            error = error.max(off / (self.high - self.low).length());
            self.scene.edit(EditCommand::Undo);
        }
        Row::new("cut into two tissues", &*self.case, &mut times, error, "off the plane, of the diagonal")
    }
}
