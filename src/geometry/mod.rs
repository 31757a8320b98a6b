//! Indices, arrays that can be taken back, and the triangle mesh. Knows nothing of bones, particles or tools.

pub mod components;
pub mod csr;
mod divide;
mod ears;
pub mod extract;
mod flips;
pub mod fx;
pub mod hash;
pub mod ids;
pub mod measure;
pub mod mesh;
pub mod predicates;
pub mod room;
pub mod section_graph;
pub mod sections;
pub mod topology;
pub mod tracked;
pub mod triangulate;
pub mod turn;
pub mod validate;
mod weld;

pub use components::Components;
pub use csr::{SlotCsr, SlotCsrDelta, Span};
pub(crate) use ears::Pairs;
pub use extract::Extraction;
pub use fx::FxHashMap;
pub use hash::StateHash;
pub use ids::{FaceId, HalfEdge, ParticleId, SectionId, VertexId, WedgeId};
pub use measure::Measures;
pub use mesh::{FaceInfo, Mesh, MeshDelta, Wedge};
pub use predicates::Plane;
pub use section_graph::{Part, PartsBefore, SectionGraph};
pub use topology::{NewFace, SplitVertex, TopologyScratch};
pub use tracked::{Delta, Distinct, Tracked};
pub use triangulate::{NO_OPPOSITE, TriangulationOutcome, Triangulator};
pub use turn::{Turn, cofactor};
