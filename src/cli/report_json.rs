//! Edit reports as the JSON of CONTRACT.

use crate::diagnostics::Stages;
use crate::scene::{EditReport, PieceReport};
use serde_json::{Map, Value, json};

/// Milliseconds by stage, and their total.
pub fn stages(stages: &Stages) -> Value {
    let mut map: Map<String, Value> = stages.rows().iter().map(|&(name, ms)| (name.to_string(), json!(ms))).collect();
    map.insert("total".into(), json!(stages.total()));
    Value::Object(map)
}

fn piece(piece: &PieceReport) -> Value {
    let side = match piece.side {
        1 => json!("positive"),
        -1 => json!("negative"),
        _ => Value::Null,
    };
    // scenes that do not measure have not looked at edges either
    let is_measured = !piece.area.is_nan();
    let count = |edges: usize| is_measured.then_some(edges);
    json!({
        "faces": piece.faces,
        "area": piece.area,
        "volume": piece.volume,
        "closed": is_measured.then_some(piece.closed),
        "boundary_edges": count(piece.boundary_edges),
        "non_manifold_edges": count(piece.non_manifold_edges),
        "degenerate_faces": count(piece.degenerate_faces),
        "side": side,
    })
}

/// An edit, all keys.
pub fn edit(report: &EditReport) -> Value {
    let segment = |s: &crate::tissue::stroke::SegmentReport| {
        let rows = ["perform_tear", "update_particles", "disconnect_particles", "bind", "update_mesh"];
        let mut map: Map<String, Value> = rows.iter().map(|&row| (row.to_string(), json!(s.stages.get(row)))).collect();
        map.insert("total".into(), json!(s.stages.total()));
        Value::Object(map)
    };
    let mut value = json!({
        "kind": report.kind,
        "outcome": report.outcome.as_str(),
        "vertices": report.vertices,
        "faces": report.faces,
        "pieces": report.pieces.iter().map(piece).collect::<Vec<_>>(),
        "new_vertices": report.new_vertices,
        "promoted_vertices": report.promoted_vertices,
        "intersection_points": report.intersection_points,
        "area_before": report.area_before,
        "volume_before": report.volume_before,
        "max_row_entries": report.max_row_entries,
        "faces_visited": report.faces_visited,
        "bytes_uploaded": report.bytes_uploaded,
        "time_ms": stages(&report.stages),
        "measuring_ms": report.measuring.total(),
    });
    match report.kind {
        "cut" => {
            value["max_plane_distance"] = json!(report.max_plane_distance);
            let caps = report.caps;
            value["caps"] =
                json!({ "loops": caps.loops, "faces": caps.faces, "unclosed_edges": caps.unclosed_edges, "forced": caps.forced });
        }
        "tear" => {
            value["area_removed"] = json!(report.area_removed);
            value["wall_faces"] = json!(report.wall_faces);
            value["unclosed_edges"] = json!(report.unclosed_edges);
            value["wall_deviation"] = json!(report.wall_deviation);
            value["smallest_angle"] = json!(report.smallest_angle);
            value["segments"] = Value::Array(report.segments.iter().map(segment).collect());
        }
        _ => {}
    }
    value
}

/// The edits of a run, each with its frame.
#[cfg(feature = "gpu")]
pub fn edits<'a>(reports: impl Iterator<Item = &'a crate::app::FrameReport>) -> Value {
    let edits = reports.enumerate().flat_map(|(frame, report)| report.edits.iter().map(move |e| (frame, e)));
    let all = edits.map(|(frame, report)| {
        let mut value = edit(report);
        value["frame"] = json!(frame);
        value["export_deviation"] = json!(null); // nothing is exported
        value
    });
    all.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::TissueId;

    #[test]
    fn what_was_not_measured_is_null() {
        let measured = PieceReport {
            tissue: TissueId(0),
            faces: 4,
            area: 1.0,
            volume: 0.1,
            closed: true,
            boundary_edges: 0,
            non_manifold_edges: 0,
            degenerate_faces: 0,
            side: 1,
            lowest_origin: 0,
        };
        let not = PieceReport { area: f64::NAN, volume: f64::NAN, ..measured.clone() };
        let (measured, not) = (piece(&measured), piece(&not));
        for key in ["area", "volume", "closed", "boundary_edges", "non_manifold_edges", "degenerate_faces"] {
            assert!(not[key].is_null() && !measured[key].is_null(), "{key}");
        }
        assert!(measured["closed"] == true && not["faces"] == 4 && not["side"] == "positive");
    }
}
