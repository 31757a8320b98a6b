//! Index newtypes. An index never travels as a bare integer, so a face cannot be taken for a vertex.

use bytemuck::{Pod, Zeroable};

macro_rules! index_type {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Pod, Zeroable)]
        #[repr(transparent)]
        pub struct $name(pub u32);

        impl $name {
            /// The absent index.
            pub const NONE: Self = Self(u32::MAX);

            /// From a slice position. Panics only if `index` does not fit in 32 bits (a bug: loaders refuse such models).
            #[inline]
            pub fn new(index: usize) -> Self {
                debug_assert!(index < u32::MAX as usize);
                Self(index as u32)
            }

            /// As a slice position.
            #[inline]
            pub fn index(self) -> usize {
                self.0 as usize
            }

            /// False for [`Self::NONE`].
            #[inline]
            pub fn is_some(self) -> bool {
                self.0 != u32::MAX
            }

            /// True for [`Self::NONE`].
            #[inline]
            pub fn is_none(self) -> bool {
                self.0 == u32::MAX
            }
        }

        impl Default for $name {
            fn default() -> Self {
                Self::NONE
            }
        }

        impl std::fmt::Debug for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                if self.is_none() {
                    write!(f, concat!(stringify!($name), "(-)"))
                } else {
                    write!(f, concat!(stringify!($name), "({})"), self.0)
                }
            }
        }
    };
}

index_type!(
    /// A topological vertex: one per point of the surface, however many seams meet there.
    VertexId
);
index_type!(
    /// A face slot of a [`crate::geometry::Mesh`]; slots are reused after a face is removed.
    FaceId
);
index_type!(
    /// A wedge: a vertex with one set of corner attributes (uv, normal, colour). Seams have several wedges a vertex.
    WedgeId
);
index_type!(
    /// A section: a cluster of faces with shared bounds (MATHS 5.8).
    SectionId
);
index_type!(
    /// A particle of the soft layer.
    ParticleId
);
index_type!(
    /// A half-edge `3 * face + k`, from corner `k` of the face to corner `k + 1`.
    HalfEdge
);

impl HalfEdge {
    /// The half-edge that leaves corner `k` of `face`.
    #[inline]
    pub fn of(face: FaceId, k: usize) -> Self {
        Self(face.0 * 3 + k as u32)
    }

    /// The face it belongs to.
    #[inline]
    pub fn face(self) -> FaceId {
        FaceId(self.0 / 3)
    }

    /// The corner it leaves, 0 to 2.
    #[inline]
    pub fn corner(self) -> usize {
        (self.0 % 3) as usize
    }

    /// The next half-edge of the same face.
    #[inline]
    pub fn next(self) -> Self {
        if self.0 % 3 == 2 { Self(self.0 - 2) } else { Self(self.0 + 1) }
    }

    /// The previous half-edge of the same face.
    #[inline]
    pub fn prev(self) -> Self {
        if self.0.is_multiple_of(3) { Self(self.0 + 2) } else { Self(self.0 - 1) }
    }
}
