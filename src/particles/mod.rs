//! The soft layer: sampling, the particle map, strips, the update after a wound (MATHS 3).

pub mod build;
mod clipped_anchors;
mod cut_links;
pub mod extract;
pub mod flood;
mod holders;
mod legs;
mod lens;
mod link_tests;
mod links_wanted;
mod lists;
pub mod map_edit;
pub mod map_json;
pub mod map_report;
pub mod map_update;
mod orphans;
pub mod particle_map;
mod places;
pub mod plane_update;
pub mod point_grid;
pub mod poisson;
pub mod quality;
pub mod random;
mod reaches;
pub mod settings;
mod sight;
mod slit_line;
pub mod strip_test;
pub mod strips;
#[cfg(test)]
mod test_models;
mod unfold;
pub mod validate;
mod ways_round;
mod work_rows;
mod wound;
pub mod wound_lines;

pub use build::{BuildReport, sigmoid_weight};
pub use extract::{Forgotten, MapPart, RowBefore};
pub use map_edit::{LipVertex, MapEdit, NewVertex};
pub use map_json::{MapJson, map_json};
pub use map_report::MapUpdateReport;
pub use map_update::{UpdateScratch, update_after_edit};
pub use particle_map::{Influence, Link, ParticleMap, ParticleMapDelta};
pub use plane_update::{PlaneCutVertices, PlaneUpdateScratch, update_after_plane_cut};
pub use poisson::{PoissonScratch, sample, sample_count, sample_with};
pub use quality::{SampleQuality, sample_quality};
pub use settings::{ParticleSettings, SettingsError, WoundSettings};
pub use strip_test::{StripGeometry, share_between};
pub(crate) use strips::StripsDerived;
pub use strips::{LipSide, Strip, StripError, Strips, StripsDelta, WoundMark};
pub use ways_round::WaysRound;
pub use wound::release_wound;

#[cfg(test)]
mod update_tests;
