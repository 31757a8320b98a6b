//! Undo and redo: a stack of units, each the deltas of the tissues it changed and the pieces it made (MATHS 7).

use super::edit::upload_bytes;
use super::{Scene, TissueId};
use crate::tissue::{Tissue, TissueDelta};
use std::sync::Arc;

/// One change of one unit. `Edited` lists the deltas of a tissue, oldest first in time of application.
pub(super) enum Change {
    /// A tissue was edited.
    Edited(TissueId, Vec<Arc<TissueDelta>>),
    /// A tissue was made. Holds the tissue while the unit is undone.
    Made(TissueId, Option<Box<Tissue>>),
}

impl Change {
    /// The piece that it holds.
    fn piece(&self) -> Option<(TissueId, &Tissue)> {
        match self {
            Change::Made(id, piece) => Some((*id, piece.as_deref()?)),
            Change::Edited(..) => None,
        }
    }

    /// [`Change::piece`], to change it.
    fn piece_mut(&mut self) -> Option<&mut Tissue> {
        match self {
            Change::Made(_, piece) => piece.as_deref_mut(),
            Change::Edited(..) => None,
        }
    }
}

/// What one undo takes back: one stroke, one cut.
#[derive(Default)]
pub(super) struct Unit {
    pub changes: Vec<Change>,
}

/// Units that can be undone, and units that can be redone.
#[derive(Default)]
pub(super) struct History {
    undo: Vec<Unit>,
    redo: Vec<Unit>,
    /// Bytes that a GPU mirror needed to follow undone and redone units, in all.
    pub travelled_bytes: usize,
    /// Room for the changes of the next units.
    spare_changes: Vec<Vec<Change>>,
    /// Room for the deltas of the next strokes.
    spare_deltas: Vec<Vec<Arc<TissueDelta>>>,
}

/// Units that there is room for at first.
const UNITS_ROOM: usize = 256;
/// Strokes that there is room for: no frame in which one ends waits for it.
const STROKES: usize = 8;
/// Edits to the room of a delta.
const EDITS: usize = 2;

impl History {
    /// Empty, with room for the next strokes.
    pub(super) fn with_room() -> Self {
        let mut history = Self { undo: Vec::with_capacity(UNITS_ROOM), ..Self::default() };
        while history.make_room() {}
        history
    }

    /// Makes room for one more stroke. False if there is enough.
    pub(super) fn make_room(&mut self) -> bool {
        if self.spare_changes.len() < STROKES {
            self.spare_changes.push(Vec::with_capacity(4));
        }
        if self.spare_deltas.len() < STROKES {
            let mut deltas = Vec::with_capacity(2);
            deltas.push(Arc::new(TissueDelta::with_room(EDITS)));
            self.spare_deltas.push(deltas);
        }
        self.spare_changes.len().min(self.spare_deltas.len()) < STROKES
    }

    /// A unit of no changes yet.
    pub(super) fn unit(&mut self) -> Unit {
        Unit { changes: self.spare_changes.pop().unwrap_or_default() }
    }

    /// Takes over what a stroke has changed; `delta` gets the room for another's.
    pub(super) fn take_over(&mut self, delta: &mut TissueDelta) -> Vec<Arc<TissueDelta>> {
        let mut deltas = self.spare_deltas.pop().unwrap_or_else(|| vec![Arc::default()]);
        if let Some(own) = deltas.first_mut().and_then(Arc::get_mut) {
            std::mem::swap(own, delta);
        }
        deltas
    }

    /// Forgets what was undone; its room is used again.
    fn forget_redo(&mut self) {
        for mut unit in self.redo.drain(..) {
            for change in unit.changes.drain(..) {
                let Change::Edited(_, mut deltas) = change else { continue };
                deltas.truncate(1);
                if self.spare_deltas.len() < STROKES && deltas.first_mut().is_some_and(|d| Arc::get_mut(d).is_some()) {
                    self.spare_deltas.push(deltas);
                }
            }
            if self.spare_changes.len() < STROKES {
                self.spare_changes.push(unit.changes);
            }
        }
    }
}

impl Scene {
    /// Puts a unit on the stack; what was undone before can no longer be redone.
    pub(super) fn commit(&mut self, unit: Unit) {
        if !unit.changes.is_empty() {
            self.history.forget_redo();
            self.history.undo.push(unit);
        }
    }

    /// Takes back the newest unit. False if there is none, or a stroke is in progress.
    pub fn undo(&mut self) -> bool {
        if !self.strokes.is_empty() {
            return false;
        }
        let Some(unit) = self.history.undo.pop() else { return false };
        let inverse = self.travel(unit);
        self.history.redo.push(inverse);
        true
    }

    /// Does the newest undone unit again. False if there is none, or a stroke is in progress.
    pub fn redo(&mut self) -> bool {
        if !self.strokes.is_empty() {
            return false;
        }
        let Some(unit) = self.history.redo.pop() else { return false };
        let inverse = self.travel(unit);
        self.history.undo.push(inverse);
        true
    }

    /// Ends a stroke in progress and takes back the newest unit: for a scene that has outgrown what shows it. False if there is
    /// nothing to take back.
    pub fn take_back(&mut self) -> bool {
        self.edit(super::EditCommand::StrokeEnd);
        self.undo()
    }

    /// Undoes every unit: the model as it was loaded. What was undone can be redone. False if
    /// there was nothing to undo.
    pub fn reset(&mut self) -> bool {
        self.grabs.let_go();
        let any = self.undo_depth() > 0 && self.strokes.is_empty();
        while self.undo() {}
        any
    }

    /// Number of units that [`Scene::undo`] can take back.
    pub fn undo_depth(&self) -> usize {
        self.history.undo.len()
    }

    /// Number of units that [`Scene::redo`] can do again.
    pub fn redo_depth(&self) -> usize {
        self.history.redo.len()
    }

    /// Applies a unit's changes, last to first, and returns the unit that leads back.
    fn travel(&mut self, mut unit: Unit) -> Unit {
        let mut inverse = Unit::default();
        let mut bytes = 0;
        let (mut gone, mut back) = (Vec::new(), Vec::new());
        let mut held = Vec::new();
        while let Some(change) = unit.changes.pop() {
            inverse.changes.push(match change {
                Change::Edited(id, deltas) => {
                    if unit.changes.last().is_some_and(|c| c.piece().is_some()) {
                        held.push((id, back.len(), self.held_before_parting(id)));
                    }
                    let Some(tissue) = self.tissues.get_mut(&id) else { continue };
                    // its pieces: those that have gone just now, and those to come next
                    let gone = inverse.changes.iter().rev().map_while(|change| Some(change.piece()?.1));
                    unit.changes.iter_mut().rev().map_while(Change::piece_mut).for_each(|piece| piece.come_off_again(tissue));
                    let deltas = tissue.travel(deltas, gone);
                    bytes += if self.measuring { upload_bytes(&deltas) } else { 0 };
                    self.rigid.rechoose_hull(id);
                    deltas.iter().for_each(|delta| self.changes.share(id, delta));
                    for (piece_id, piece) in inverse.changes.iter().rev().map_while(Change::piece) {
                        self.hold_parent(id, piece_id, piece);
                    }
                    Change::Edited(id, deltas)
                }
                Change::Made(id, Some(tissue)) => {
                    bytes += tissue.full_upload_bytes();
                    self.tissues.insert(id, tissue);
                    back.push(id);
                    Change::Made(id, None)
                }
                Change::Made(id, None) => {
                    gone.push(id);
                    Change::Made(id, self.tissues.remove(&id))
                }
            });
        }
        self.history.travelled_bytes += bytes;
        for (k, (parent, from, before)) in held.iter().enumerate() {
            let to = held.get(k + 1).map_or(back.len(), |next| next.1);
            self.hold_pieces(*parent, &back[*from..to], before);
        }
        gone.into_iter().for_each(|id| self.piece_went_back(id));
        self.pieces_came_back(&back);
        self.prune_grabs();
        inverse
    }
}
