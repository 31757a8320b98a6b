//! Which vertices lie on the lip of a wound: told on the CPU, once for each that an edit concerns. The shaders ask for it again and again.

use super::cpu_deform::is_lip;
use super::view::TissueView;
use crate::geometry::room::{fit, with_headroom};
use crate::geometry::{FaceId, VertexId};
use std::ops::Range;

/// Lips of a tissue as its vertex records say.
#[derive(Debug, Default)]
pub(super) struct Lips {
    is_lip: Vec<bool>,
    /// The last look at each vertex, and the number of looks.
    looked_at: Vec<u32>,
    looks: u32,
    /// Vertices whose records are to be written for this alone.
    changed: Vec<u32>,
}

impl Lips {
    /// Makes room for a mesh of so many vertices, and for what edits put in.
    pub(super) fn make_room(&mut self, vertices: usize) {
        self.is_lip.reserve(with_headroom(vertices));
        self.looked_at.reserve(with_headroom(vertices));
        self.changed.reserve(with_headroom(vertices));
    }

    /// True for a vertex on a lip.
    pub(super) fn contains(&self, v: usize) -> bool {
        self.is_lip.get(v).copied().unwrap_or_default()
    }

    /// Looks at the vertices and the corners of faces that have changed.
    pub(super) fn look(
        &mut self,
        view: &TissueView<'_>,
        vertices: impl Iterator<Item = Range<usize>>,
        faces: impl Iterator<Item = Range<usize>>,
    ) {
        fit(&mut self.is_lip, view.mesh.vertex_slots(), false);
        fit(&mut self.looked_at, view.mesh.vertex_slots(), 0);
        self.changed.clear();
        if self.looks == u32::MAX {
            self.looked_at.fill(0);
            self.looks = 0;
        }
        self.looks += 1;
        let Self { is_lip: known, looked_at, looks, changed } = self;
        let mut look = |v: VertexId| {
            if std::mem::replace(&mut looked_at[v.index()], *looks) == *looks {
                return false;
            }
            let now = is_lip(view, v);
            std::mem::replace(&mut known[v.index()], now) != now
        };
        for v in vertices.flatten() {
            look(VertexId::new(v));
        }
        for f in faces.flatten().map(FaceId::new).filter(|f| view.mesh.is_live(*f)) {
            changed.extend(view.mesh.face(f).into_iter().filter(|&v| look(v)).map(|v| v.0));
        }
    }

    /// Vertices whose record has changed by this alone, since the last look.
    pub(super) fn changed(&self) -> impl Iterator<Item = usize> + '_ {
        self.changed.iter().map(|&v| v as usize)
    }
}
