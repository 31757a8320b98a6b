//! Rigid bodies of a scene as the renderer sees them: polished metal in the shape that pushes.

use crate::app::FrameView;
use crate::formats::Model;
use crate::geometry::VertexId;
use crate::gpu::{GpuError, MaterialView, Renderer, TissueDirty, TissueView, ViewVersions};
use crate::particles::ParticleMap;
use crate::physics::RigidShape;
use crate::rig::Pose;
use crate::scene::ColliderView;
use std::collections::BTreeMap;

const STEEL: MaterialView =
    MaterialView { base_colour: [0.36, 0.38, 0.41, 1.0], texture: None, roughness: 0.32, wetness: 0.25, scatter: 0.0 };
/// Keys of rigid bodies in the renderer, beside those of tissues.
const KEY: u64 = 1 << 40;

/// The bodies that the renderer knows.
#[derive(Default)]
pub(super) struct Instruments {
    known: BTreeMap<u32, (RigidShape, Model)>,
    map: ParticleMap,
    pose: Pose,
}

impl Instruments {
    /// Forgets all bodies.
    pub(super) fn forget(&mut self, renderer: &mut Renderer) {
        for id in std::mem::take(&mut self.known).into_keys() {
            renderer.remove(KEY | u64::from(id));
        }
    }

    /// Brings the renderer's bodies to those of the scene.
    pub(super) fn sync(&mut self, renderer: &mut Renderer, view: &FrameView) -> Result<(), GpuError> {
        let now: BTreeMap<u32, ColliderView> = view.scene.colliders().map(|c| (c.id, c)).collect();
        self.known.retain(|id, (shape, _)| {
            let stays = now.get(id).is_some_and(|c| c.shape == *shape);
            if !stays {
                renderer.remove(KEY | u64::from(*id));
            }
            stays
        });
        for (id, collider) in &now {
            let mut dirty = TissueDirty::clean();
            if !self.known.contains_key(id) {
                let Some(model) = solid(&collider.shape) else { continue };
                self.known.insert(*id, (collider.shape, model));
                dirty = TissueDirty::Full;
            }
            let Some((_, model)) = self.known.get(id) else { continue };
            let tissue = TissueView {
                mesh: &model.mesh,
                rows: &model.rows,
                map: &self.map,
                displacements: &[],
                rotations: &[],
                fades: &[],
                fades_written: &[],
                fade_duration_s: 0.0,
                time_s: 0.0,
                pose: &self.pose,
                materials: &[STEEL],
                diagonal: 2.0 * collider.shape.reach(),
                world_from_tissue: collider.pose.affine(),
                versions: ViewVersions::default(),
            };
            renderer.sync(KEY | u64::from(*id), &tissue, &dirty)?;
        }
        Ok(())
    }
}

/// The bundled sphere, stretched to the shape.
fn solid(shape: &RigidShape) -> Option<Model> {
    let mut model = crate::formats::load("sphere").ok()?;
    let (radius, half_length) = match *shape {
        RigidShape::Sphere { radius } => (radius, 0.0),
        RigidShape::Capsule { half_length, radius } => (radius, half_length),
    };
    for v in 0..model.rows.len() {
        let direction = model.rows.rest(VertexId::new(v)).normalize_or_zero();
        let place = direction * radius + glam::DVec3::Y * half_length.copysign(direction.y);
        model.rows.rest_position.set(v, place.as_vec3().to_array());
    }
    model.rows.take_delta();
    Some(model)
}
