//! Which way the faces of a loaded model look. Nothing is turned: a part that faces inward may be a cavity.

use super::Model;
use crate::geometry::VertexId;
use crate::geometry::measure::measure;
use glam::DVec3;

/// Volumes below this share of area times diagonal are rounding: a plate of two sheets has none.
const FLAT: f64 = 1e-6;

/// Warns of faces that are wound against each other, and of a closed model that is inside out in the stored pose.
pub(crate) fn warn(model: &mut Model) {
    let one_way = model.report.one_way_edges;
    if one_way > 0 {
        let edges = if one_way == 1 { "1 edge".into() } else { format!("{one_way} edges") };
        model.report.warnings.push(format!(
            "faces are wound against each other at {edges}: tears and cuts find the model open there, with slits and rims \
             that do not close and wrong volumes; recalculate the normals to point outside in the modelling program (a one-sided \
             surface keeps such edges)"
        ));
    }
    if is_inside_out(model) {
        model.report.warnings.push(
            "the model is inside out: its faces look inward and its volume is negative, so tears and cuts take the outside for \
             the inside, with walls and caps that look the wrong way; recalculate the normals to point outside in the modelling \
             program"
                .into(),
        );
    }
}

/// True for a closed surface with a negative volume in the stored pose, all parts and cavities together.
fn is_inside_out(model: &Model) -> bool {
    let pose = model.rig.rest_pose();
    let posed: Vec<DVec3> = (0..model.mesh.vertex_slots()).map(|v| pose.skin(&model.rows, VertexId::new(v))).collect();
    let measured = measure(&model.mesh, |v| posed[v.index()]);
    measured.closed() && measured.volume < -FLAT * measured.area * measured.diagonal()
}
