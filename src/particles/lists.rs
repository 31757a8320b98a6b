//! Many lists that grow, in one array: adding to any of them finds room for all.

use crate::geometry::room::{fit, headroom};

/// Lists by number, each a slice. One that outgrows its room moves to the end of the array.
#[derive(Clone, Debug)]
pub(super) struct Lists<T> {
    runs: Vec<Run>,
    entries: Vec<T>,
}

/// Where a list lies.
#[derive(Clone, Copy, Debug, Default)]
struct Run {
    start: usize,
    len: u32,
    room: u32,
}

/// Bytes of a list's first entries, one of them at least.
const LEAST_BYTES: usize = 256;

impl<T> Default for Lists<T> {
    fn default() -> Self {
        Self { runs: Vec::new(), entries: Vec::new() }
    }
}

impl<T: Copy> Lists<T> {
    /// Empties all lists.
    pub(super) fn clear(&mut self) {
        self.runs.clear();
        self.entries.clear();
    }

    /// Makes room for so many entries more, and for more lists.
    pub(super) fn reserve(&mut self, entries: usize) {
        self.runs.reserve(headroom(self.runs.len()));
        self.entries.reserve(entries);
    }

    /// Number of entries of all lists, with what they have room for.
    pub(super) fn room(&self) -> usize {
        self.entries.len()
    }

    /// Makes room for so many entries in a list.
    pub(super) fn widen(&mut self, list: usize, room: usize, fill: T) {
        fit(&mut self.runs, list + 1, Run::default());
        let run = &mut self.runs[list];
        let start = self.entries.len();
        self.entries.extend_from_within(run.start..run.start + run.len as usize);
        self.entries.resize(start + room.max(run.len as usize), fill);
        (run.start, run.room) = (start, room as u32);
    }

    /// Appends to a list.
    pub(super) fn push(&mut self, list: usize, entry: T) {
        let run = self.runs.get(list).copied().unwrap_or_default();
        if run.len == run.room {
            self.widen(list, (2 * run.room as usize).max(LEAST_BYTES / size_of::<T>()).max(1), entry);
        }
        let run = &mut self.runs[list];
        self.entries[run.start + run.len as usize] = entry;
        run.len += 1;
    }

    /// Empties a list.
    pub(super) fn empty(&mut self, list: usize) {
        if let Some(run) = self.runs.get_mut(list) {
            run.len = 0;
        }
    }

    /// A list; empty where nothing was ever added.
    #[inline]
    pub(super) fn get(&self, list: usize) -> &[T] {
        self.runs.get(list).map_or(&[], |run| &self.entries[run.start..run.start + run.len as usize])
    }

    /// [`Lists::get`], to change.
    #[inline]
    pub(super) fn get_mut(&mut self, list: usize) -> &mut [T] {
        self.runs.get(list).map_or(&mut [], |run| &mut self.entries[run.start..run.start + run.len as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_grow_side_by_side() {
        let mut lists = Lists::default();
        lists.widen(2, 3, 0);
        for i in 0..100usize {
            lists.push(i % 7, i);
        }
        for list in 0..7 {
            let expected: Vec<usize> = (list..100).step_by(7).collect();
            assert_eq!(lists.get(list), expected);
        }
        lists.empty(3);
        lists.push(3, 5);
        assert_eq!((lists.get(3), lists.get(9)), (&[5][..], &[][..]));
    }
}
