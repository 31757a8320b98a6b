//! Rotations of the particles (MATHS 2.1) where a tissue needs them: kept up to date with poses, displacements and edits, held
//! still by fades through an edit, and counted in section bounds (MATHS 5.8). Without the setting every function here returns
//! at once.

use super::sections::SECTION_MARGIN;
use super::{Tissue, motions};
use crate::geometry::{SectionId, Turn, VertexId};
use crate::rig::displaced;
use glam::{DMat3, DVec3};
use std::ops::Range;

/// Buffers, kept between frames.
#[derive(Debug, Default)]
pub(super) struct TurnScratch {
    anchors: Vec<DVec3>,
    rest: Vec<DVec3>,
    before: Vec<Turn>,
    /// Farthest that turns may carry a vertex of each section, metres; empty while nothing is turned.
    reach: Vec<f64>,
    stamps: Vec<u32>,
}

impl Tissue {
    /// Finds the particles' turns anew: after a step, a new pose, or an edit.
    pub(super) fn refresh_turns(&mut self) {
        let Some(layer) = &mut self.layer else { return };
        if !layer.network.settings().rotations && layer.network.turns().is_empty() {
            return;
        }
        let TurnScratch { anchors, rest, .. } = &mut self.scratch.turns;
        anchors.clear();
        rest.clear();
        for (p, &anchor) in layer.map.anchors.iter().enumerate() {
            if anchor.is_none() {
                anchors.push(DVec3::ZERO);
                rest.push(DVec3::ZERO);
                continue;
            }
            anchors.push(self.pose.skin(&self.rows, anchor));
            rest.push(layer.opened(p, &self.rows, &self.pose));
        }
        if layer.network.update_turns(anchors, rest) {
            self.versions.rotations += 1;
        }
    }

    /// [`Tissue::refresh_turns`] after an edit: springs have come and gone, so turns jump. Adds to `targets`, vertices that are
    /// held already, all others that a turn would move, with the place where they stand (MATHS 2.2).
    pub(super) fn refresh_turns_held(&mut self, targets: &mut Vec<(VertexId, DVec3)>) {
        let Some(layer) = self.layer.as_ref().filter(|l| l.network.settings().rotations) else { return };
        let mut before = std::mem::take(&mut self.scratch.turns.before);
        before.clear();
        before.extend_from_slice(layer.network.turns());
        self.refresh_turns();
        if let Some(layer) = &self.layer {
            let (now, displacements) = (layer.network.turns(), layer.displacements());
            let at = |turns: &[Turn], p: usize| turns.get(p).copied().unwrap_or_default();
            let turned: Vec<bool> = (0..layer.map.len())
                .map(|p| {
                    let (old, new) = (at(&before, p), at(now, p));
                    (old.spin != DMat3::ZERO || new.spin != DMat3::ZERO) && old != new
                })
                .collect();
            if turned.contains(&true) {
                let mut held = vec![false; self.mesh.vertex_slots()];
                targets.iter().for_each(|(v, _)| held[v.index()] = true);
                for v in self.mesh.live_vertices().filter(|v| !held[v.index()] && v.index() < layer.map.influences.rows()) {
                    let row = layer.map.influences.row(v.index());
                    if row.iter().any(|i| turned[i.particle.index()]) {
                        let skinned = self.pose.skin(&self.rows, v);
                        let carried = |turns: &[Turn]| displaced(skinned, motions(row, displacements, turns));
                        targets.push((v, self.position(v) + (carried(&before) - carried(now))));
                    }
                }
            }
        }
        self.scratch.turns.before = before;
        self.refresh_turn_reach();
    }

    /// Linear part of what carries the surroundings of a vertex from rest to where they are seen: blended skin matrix, then the
    /// blended rotation of its particles.
    pub(super) fn linear(&self, v: VertexId) -> DMat3 {
        let skin = self.pose.blended_linear(&self.rows, v);
        let Some(layer) = self.layer.as_ref().filter(|l| !l.network.turns().is_empty()) else { return skin };
        if v.index() >= layer.map.influences.rows() {
            return skin;
        }
        let influences = layer.map.influences.row(v.index()).iter();
        let spin = |i: &crate::particles::Influence| layer.network.turns()[i.particle.index()].spin * f64::from(i.weight);
        influences.fold(DMat3::IDENTITY, |sum, i| sum + spin(i)) * skin
    }

    /// Brings [`Tissue::turn_reach`] up to date with the sections' bounds and the turns.
    pub(super) fn refresh_turn_reach(&mut self) {
        let TurnScratch { reach, stamps, .. } = &mut self.scratch.turns;
        reach.clear();
        let Some(layer) = self.layer.as_ref().filter(|l| !l.network.turns().is_empty()) else { return };
        let (turns, influences) = (layer.network.turns(), &layer.map.influences);
        let margin = SECTION_MARGIN * self.diagonal;
        stamps.clear();
        stamps.resize(turns.len(), u32::MAX);
        for s in 0..self.sections.len() {
            let (low, high) = self.sections.of(s);
            let mut farthest: f64 = 0.0;
            let vertices = self.mesh.section_faces(SectionId::new(s)).flat_map(|f| self.mesh.face(f));
            for i in vertices.filter(|v| v.index() < influences.rows()).flat_map(|v| influences.row(v.index())) {
                let p = i.particle.index();
                if std::mem::replace(&mut stamps[p], s as u32) != s as u32 && turns[p].spin != DMat3::ZERO {
                    let away = (turns[p].about - low).abs().max((high - turns[p].about).abs()).length() + margin;
                    farthest = farthest.max(turns[p].size() * away);
                }
            }
            reach.push(farthest);
        }
    }

    /// How far turns may carry a vertex of some sections from where displacements alone carry it, metres. As of the last
    /// [`Tissue::refresh_sections`].
    pub(super) fn turn_reach(&self, sections: Range<usize>) -> DVec3 {
        let reach = sections.filter_map(|s| self.scratch.turns.reach.get(s));
        DVec3::splat(reach.fold(0.0, |most, r| most.max(*r)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{ParticleId, Plane};
    use crate::particles::ParticleSettings;
    use crate::physics::NetworkSettings;
    use crate::surgery::plane_cut::PlaneCutScratch;
    use crate::tissue::TissueSettings;
    use glam::DQuat;

    fn tissue(model: &str, rotations: bool) -> Tissue {
        let model = crate::formats::load(model).unwrap();
        let rest: Vec<DVec3> = (0..model.rows.len()).map(|v| model.rows.rest(VertexId::new(v))).collect();
        let settings = TissueSettings {
            particles: Some(ParticleSettings::for_model(&model.mesh, &rest)),
            network: NetworkSettings { rotations, ..NetworkSettings::FIRM },
            opening_s: 0.2,
            section_faces: 64,
            fade_s: 0.25,
        };
        Tissue::new(model, &settings).unwrap()
    }

    fn turn_all(tissue: &mut Tissue, q: DQuat, shift: DVec3) {
        for p in 0..tissue.layer.as_ref().unwrap().map.len() {
            let layer = tissue.layer.as_ref().unwrap();
            let anchor = tissue.skinned(layer.map.anchors[p]);
            let network = &mut tissue.layer.as_mut().unwrap().network;
            network.set_state(ParticleId::new(p), q * anchor - anchor + shift, DVec3::ZERO);
        }
        tissue.step(0.0);
    }

    fn farthest_from_rigid(tissue: &Tissue, q: DQuat, shift: DVec3) -> f64 {
        let off = |v| tissue.position(v).distance(q * tissue.skinned(v) + shift);
        tissue.mesh.live_vertices().map(off).fold(0.0, f64::max) / tissue.diagonal
    }

    #[test]
    fn a_rigid_rotation_of_all_particles_moves_every_vertex_rigidly() {
        let (q, shift) = (DQuat::from_rotation_y(0.9) * DQuat::from_rotation_x(-0.5), DVec3::new(0.1, -0.2, 0.3));
        for (model, time) in [("sphere", 0.0), ("beam", 0.7)] {
            let mut turned = tissue(model, true);
            turned.set_pose(0.0, (!turned.rig.animations.is_empty()).then_some(0), time);
            turn_all(&mut turned, q, shift);
            let off = farthest_from_rigid(&turned, q, shift);
            assert!(off < 1e-6, "{model}: {off:e}");
            // Broken twin: without rotations the body is crumpled.
            let mut plain = tissue(model, false);
            plain.set_pose(0.0, (!plain.rig.animations.is_empty()).then_some(0), time);
            turn_all(&mut plain, q, shift);
            assert!(farthest_from_rigid(&plain, q, shift) > 1e-3, "{model}");
        }
    }

    fn poke(tissue: &mut Tissue) {
        let push = |p: usize| DVec3::new(0.0, 0.1 - 0.02 * (p % 3) as f64, -0.02 * (p % 5) as f64) * tissue.diagonal;
        let pushed: Vec<DVec3> = (0..tissue.layer.as_ref().unwrap().map.len()).map(push).collect();
        for (p, u) in pushed.into_iter().enumerate().step_by(3) {
            tissue.layer.as_mut().unwrap().network.set_state(ParticleId::new(p), u, DVec3::ZERO);
        }
        tissue.step(0.0);
    }

    #[test]
    fn at_rest_it_is_exactly_the_tissue_without_rotations_and_comes_back_to_it() {
        let (mut turned, plain) = (tissue("beam", true), tissue("beam", false));
        let same = |a: &Tissue, b: &Tissue| a.mesh.live_vertices().all(|v| a.position(v) == b.position(v));
        turned.step(1.0 / 90.0);
        assert!(same(&turned, &plain) && turned.versions.rotations == 1);
        poke(&mut turned);
        assert!(!same(&turned, &plain) && turned.versions.rotations > 1);
        for _ in 0..900 {
            turned.step(1.0 / 90.0);
        }
        assert!(turned.is_asleep() && turned.layer.as_ref().unwrap().network.turns().is_empty());
        assert!(same(&turned, &plain));
    }

    fn misplaced(tissue: &Tissue) -> usize {
        let mut faces = Vec::new();
        let mut missing = |f| {
            let center = tissue.mesh.face(f).map(|v| tissue.position(v));
            center.into_iter().any(|p| {
                tissue.faces_near(p, p, &mut faces);
                !faces.contains(&f)
            })
        };
        tissue.mesh.live_faces().filter(|&f| missing(f)).count()
    }

    #[test]
    fn section_bounds_hold_what_turns_move() {
        for model in ["sphere", "beam"] {
            let mut tissue = tissue(model, true);
            turn_all(&mut tissue, DQuat::from_rotation_z(1.5), DVec3::ZERO);
            tissue.refresh_sections();
            assert_eq!(misplaced(&tissue), 0, "{model}");
            // Only what turned particles hold is widened.
            let mut dented = self::tissue(model, true);
            dented.layer.as_mut().unwrap().network.set_state(ParticleId(0), DVec3::splat(0.05) * dented.diagonal, DVec3::ZERO);
            dented.step(0.0);
            dented.refresh_sections();
            let reach = &dented.scratch.turns.reach;
            assert!(reach.iter().any(|r| *r > 0.0) && reach.contains(&0.0));
            assert_eq!(misplaced(&dented), 0, "{model}");
            // Broken twin: bounds that leave the turns out. Displacements that cancel the turn's travel on average do not help.
            tissue.scratch.turns.reach.clear();
            for p in 0..tissue.layer.as_ref().unwrap().map.len() {
                tissue.layer.as_mut().unwrap().network.set_state(ParticleId::new(p), DVec3::ZERO, DVec3::ZERO);
            }
            assert!(misplaced(&tissue) > 0, "{model}");
        }
    }

    /// Losing a piece takes springs away and turns jump; fades hold every vertex that it does not concern (MATHS 2.2).
    #[test]
    fn nothing_pops_when_an_edit_changes_turns() {
        let mut held = tissue("sphere", true);
        poke(&mut held);
        let before: Vec<(VertexId, DVec3)> = held.mesh.live_vertices().map(|v| (v, held.position(v))).collect();
        let turns = held.layer.as_ref().unwrap().network.turns().to_vec();
        let plane = Plane::Equation { normal: DVec3::new(0.2, 1.0, 0.1), offset: 0.013 };
        let outcome = held.cut(&plane, &mut PlaneCutScratch::default(), &mut Default::default());
        assert!(!outcome.missed());
        let faces = held.component_faces().swap_remove(1);
        held.sever(&[faces]);
        let off = |tissue: &Tissue| {
            let live = before.iter().filter(|(v, _)| tissue.mesh.vertex_is_live(*v));
            live.map(|(v, p)| p.distance(tissue.position(*v))).fold(0.0, f64::max) / tissue.diagonal
        };
        assert!(off(&held) < 1e-7, "{:e}", off(&held));
        let after = held.layer.as_ref().unwrap().network.turns();
        assert!(turns.iter().zip(after).filter(|(a, b)| a != b).count() > 10);
        // Broken twin: the same turns without the fades.
        held.fades = Default::default();
        assert!(off(&held) > 1e-5, "{:e}", off(&held));
    }

    #[test]
    fn points_tied_to_the_surface_go_round_with_it() {
        let mut tissue = tissue("sphere", true);
        let v = tissue.mesh.live_vertices().nth(5).unwrap();
        let tied = tissue.skinned(v) + DVec3::new(0.02, -0.01, 0.05);
        let rest = tissue.rest_frame(v, tissue.position(v))(tied);
        let (q, shift) = (DQuat::from_rotation_x(0.8), DVec3::Y);
        turn_all(&mut tissue, q, shift);
        assert!(tissue.posed_frame(v)(rest).distance(q * tied + shift) < 1e-6);
        assert!(tissue.rest_frame(v, tissue.position(v))(q * tied + shift).distance(rest) < 1e-6);
    }
}
