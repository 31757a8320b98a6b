//! Sections: clusters of faces whose bounds tell an edit where not to look (the paper's sections, MATHS 5.8).

use super::ids::{FaceId, SectionId, VertexId};
use super::mesh::Mesh;
use glam::DVec3;

/// Splits the live faces into clusters of at most `faces_per_section`, by halving along the longest side of their
/// centroids' bounds. Returns the number of sections and the section of every face slot.
pub fn cluster_faces(mesh: &Mesh, position: impl Fn(VertexId) -> DVec3, faces_per_section: usize) -> (usize, Vec<SectionId>) {
    let mut faces: Vec<(FaceId, DVec3)> =
        mesh.live_faces().map(|f| (f, mesh.face(f).iter().map(|&v| position(v)).sum::<DVec3>() / 3.0)).collect();
    let mut section = vec![SectionId(0); mesh.face_slots()];
    let mut count = 0;
    let mut stack: Vec<(usize, usize)> = vec![(0, faces.len())];
    while let Some((start, end)) = stack.pop() {
        let part = &mut faces[start..end];
        if part.len() <= faces_per_section.max(1) {
            for (f, _) in part.iter() {
                section[f.index()] = SectionId::new(count);
            }
            count += usize::from(!part.is_empty());
            continue;
        }
        let (low, high) = part.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), f| (l.min(f.1), h.max(f.1)));
        let size = high - low;
        let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).unwrap_or(0);
        let middle = part.len() / 2;
        part.select_nth_unstable_by(middle, |a, b| a.1[axis].total_cmp(&b.1[axis]).then(a.0.cmp(&b.0)));
        stack.push((start + middle, end));
        stack.push((start, start + middle));
    }
    (count.max(1), section)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::validate::tests::octahedron;

    #[test]
    fn every_face_has_a_small_section() {
        let mut mesh = octahedron();
        let (count, section) = cluster_faces(&mesh, |v| DVec3::new(f64::from(v.0), f64::from(v.0 * v.0 % 5), 0.0), 3);
        mesh.assign_sections(count, &section);
        assert_eq!(mesh.validate(), Ok(()));
        assert!((3..=4).contains(&count));
        let sizes: Vec<usize> = (0..count).map(|s| mesh.section_faces(SectionId::new(s)).count()).collect();
        assert!(sizes.iter().all(|&n| (1..=3).contains(&n)) && sizes.iter().sum::<usize>() == 8);
    }
}
