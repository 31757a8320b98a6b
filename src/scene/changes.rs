//! What edits have changed, for those who mirror the scene.

use super::TissueId;
use crate::tissue::TissueDelta;
use std::sync::Arc;

/// Changes of a frame that there is room for at first, and deltas with room of their own.
const NOTED_ROOM: usize = 64;
const DELTAS: usize = 4;

/// Deltas in order, kept only while someone watches, and those that came back: a frame that tears makes none anew.
#[derive(Debug, Default)]
pub(super) struct Changes {
    is_watched: bool,
    noted: Vec<(TissueId, Arc<TissueDelta>)>,
    spare: Vec<Arc<TissueDelta>>,
}

impl Changes {
    pub(super) fn watch(&mut self) {
        self.is_watched = true;
        self.noted.reserve(NOTED_ROOM);
        self.spare.reserve(NOTED_ROOM);
        self.spare.resize_with(DELTAS, || Arc::new(TissueDelta::with_room(1)));
    }

    /// Notes what history holds too.
    pub(super) fn share(&mut self, id: TissueId, delta: &Arc<TissueDelta>) {
        if self.is_watched {
            self.noted.push((id, delta.clone()));
        }
    }

    /// Takes over what changed; `delta` gets the room of one that came back.
    pub(super) fn take_over(&mut self, id: TissueId, delta: &mut TissueDelta) {
        if self.is_watched && !delta.is_empty() {
            let mut own = self.spare.pop().unwrap_or_default();
            if let Some(own) = Arc::get_mut(&mut own) {
                std::mem::swap(own, delta);
            }
            self.noted.push((id, own));
        }
    }

    pub(super) fn take(&mut self) -> Vec<(TissueId, Arc<TissueDelta>)> {
        std::mem::take(&mut self.noted)
    }

    /// What nobody else holds is used again.
    pub(super) fn give_back(&mut self, mut taken: Vec<(TissueId, Arc<TissueDelta>)>) {
        self.spare.extend(taken.drain(..).map(|change| change.1).filter(|delta| Arc::strong_count(delta) == 1));
        if self.noted.is_empty() {
            self.noted = taken;
        }
    }
}
