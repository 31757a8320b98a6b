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

/// Moves faces that touch no other of their section, or only a few, into a section next to them, so that a section is one
/// connected component wherever its surface is. Sections may grow by their neighbours' strays.
pub fn join_strays(mesh: &Mesh, count: usize, section: &mut [SectionId]) {
    let mut parent: Vec<u32> = (0..mesh.face_slots() as u32).collect();
    let around = |f: FaceId| mesh.all_opposites()[f.index()].into_iter().filter(|h| h.is_some()).map(|h| h.face());
    for f in mesh.live_faces() {
        for g in around(f).filter(|g| *g < f && section[g.index()] == section[f.index()]) {
            let (a, b) = (root(&mut parent, f.0), root(&mut parent, g.0));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut size = vec![0u32; mesh.face_slots()];
    let mut largest = vec![u32::MAX; count];
    for f in mesh.live_faces() {
        size[root(&mut parent, f.0) as usize] += 1;
    }
    for f in mesh.live_faces().filter(|f| parent[f.index()] == f.0) {
        let largest = &mut largest[section[f.index()].index()];
        if *largest == u32::MAX || size[*largest as usize] < size[f.index()] {
            *largest = f.0;
        }
    }
    let mut strays: Vec<FaceId> =
        mesh.live_faces().filter(|f| root(&mut parent, f.0) != largest[section[f.index()].index()]).collect();
    let mut is_stray = vec![false; mesh.face_slots()];
    strays.iter().for_each(|f| is_stray[f.index()] = true);
    loop {
        let before = strays.len();
        strays.retain(|&f| match around(f).find(|g| !is_stray[g.index()]) {
            Some(g) => {
                section[f.index()] = section[g.index()];
                is_stray[f.index()] = false;
                false
            }
            None => true,
        });
        // what is left is no neighbour of any section: surfaces smaller than one
        if strays.len() == before {
            return;
        }
    }
}

fn root(parent: &mut [u32], mut f: u32) -> u32 {
    while parent[f as usize] != f {
        parent[f as usize] = parent[parent[f as usize] as usize];
        f = parent[f as usize];
    }
    f
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_strays_a_section_is_one_component() {
        let mut mesh = octahedron();
        // opposite faces share a section, and no edge
        let mut section: Vec<SectionId> = (0..8).map(|f| SectionId::new([0, 0, 1, 1, 1, 1, 0, 1][f])).collect();
        let parts = |mesh: &Mesh, section: &[SectionId]| {
            let mut apart = mesh.clone();
            for h in (0..8).flat_map(|f| (0..3).map(move |k| crate::geometry::HalfEdge::of(FaceId::new(f), k))) {
                let back = apart.opposite(h);
                if back.is_some() && section[h.face().index()] != section[back.face().index()] {
                    apart.open_edge(h);
                }
            }
            crate::geometry::Components::find(&apart).count()
        };
        assert!(parts(&mesh, &section) > 2);
        join_strays(&mesh, 2, &mut section);
        assert_eq!(parts(&mesh, &section), 2);
        mesh.assign_sections(2, &section);
        assert_eq!(mesh.validate(), Ok(()));
    }
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
