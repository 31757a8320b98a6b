//! Which way the faces of a loaded model look, and whether it has a size. Nothing is turned: a part that faces inward may be a cavity.

use super::{FormatError, Model};
use crate::geometry::measure::measure;
use crate::geometry::{Measures, VertexId};
use glam::DVec3;

/// Volumes below this share of area times diagonal are rounding: a plate of two sheets has none.
const FLAT: f64 = 1e-6;

/// Warns of faces that are wound against each other, and of a closed model that is inside out in the stored pose. An error is a model that
/// is a single point there: all that edits compare lengths with is its size.
pub(crate) fn check(model: &mut Model) -> Result<(), FormatError> {
    let measured = measured_at_rest(model);
    if measured.diagonal() == 0.0 {
        return Err(FormatError::NoSize);
    }
    let one_way = model.report.one_way_edges;
    if one_way > 0 {
        let edges = if one_way == 1 { "1 edge".into() } else { format!("{one_way} edges") };
        model.report.warnings.push(format!(
            "faces are wound against each other at {edges}: tears and cuts find the model open there, with slits and rims \
             that do not close and wrong volumes; recalculate the normals to point outside in the modelling program (a one-sided \
             surface keeps such edges)"
        ));
    }
    // all parts and cavities together
    if measured.closed() && measured.volume < -FLAT * measured.area * measured.diagonal() {
        model.report.warnings.push(
            "the model is inside out: its faces look inward and its volume is negative, so tears and cuts take the outside for \
             the inside, with walls and caps that look the wrong way; recalculate the normals to point outside in the modelling \
             program"
                .into(),
        );
    }
    Ok(())
}

fn measured_at_rest(model: &Model) -> Measures {
    let pose = model.rig.rest_pose();
    let posed: Vec<DVec3> = (0..model.mesh.vertex_slots()).map(|v| pose.skin(&model.rows, VertexId::new(v))).collect();
    measure(&model.mesh, |v| posed[v.index()])
}
