//! Many lists that grow, in one array: adding to any of them finds room for all.

use crate::geometry::room::{fit, headroom};

/// Lists by number, each a slice. One that outgrows its room moves to what another has left, or to the end of the array.
#[derive(Clone, Debug)]
pub(super) struct Lists<T> {
    runs: Vec<Run>,
    entries: Vec<T>,
    /// Room that lists have left, by the power of two that it has at least.
    left: [Vec<Run>; 32],
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
        Self { runs: Vec::new(), entries: Vec::new(), left: Default::default() }
    }
}

/// Runs of one size that lists have moved out of.
const LEFT: usize = 256;

impl<T: Copy> Lists<T> {
    /// Empties all lists.
    pub(super) fn clear(&mut self) {
        self.runs.clear();
        self.entries.clear();
        self.left.iter_mut().for_each(Vec::clear);
    }

    /// Makes room for so many entries more, and for more lists.
    pub(super) fn reserve(&mut self, entries: usize) {
        self.runs.reserve(headroom(self.runs.len()));
        self.entries.reserve(entries);
        self.left.iter_mut().for_each(|left| left.reserve(LEFT));
    }

    /// Number of entries of all lists, with what they have room for.
    pub(super) fn room(&self) -> usize {
        self.entries.len()
    }

    /// Makes room for so many entries in a list.
    pub(super) fn widen(&mut self, list: usize, room: usize, fill: T) {
        fit(&mut self.runs, list + 1, Run::default());
        let Self { runs, entries, left } = self;
        let run = &mut runs[list];
        let old = *run;
        let room = room.max(old.len as usize);
        let wanted = room.max(1).next_power_of_two().ilog2() as usize;
        let found = left.get_mut(wanted).and_then(Vec::pop);
        let new = found.unwrap_or(Run { start: entries.len(), len: 0, room: room as u32 });
        if entries.len() < new.start + new.room as usize {
            entries.resize(new.start + new.room as usize, fill);
        }
        entries.copy_within(old.start..old.start + old.len as usize, new.start);
        *run = Run { len: old.len, ..new };
        if old.room > 0 {
            left[old.room.ilog2() as usize].push(Run { len: 0, ..old });
        }
    }

    /// Appends to a list.
    pub(super) fn push(&mut self, list: usize, entry: T) {
        let run = self.runs.get(list).copied().unwrap_or_default();
        if run.len == run.room {
            let least = (LEAST_BYTES / size_of::<T>()).max(1);
            self.widen(list, (2 * run.room as usize).max(least.next_power_of_two()), entry);
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

    #[test]
    fn what_one_list_has_left_the_next_one_fills() {
        let mut lists = Lists::default();
        for list in 0..8 {
            (0..500usize).for_each(|i| lists.push(list, 1000 * list + i));
        }
        for list in 0..8 {
            assert!(lists.get(list).iter().copied().eq(1000 * list..1000 * list + 500));
        }
        // eight of 512, and 32 to 256 that the first one grew out of; each would leave as much of its own otherwise
        assert_eq!(lists.room(), 8 * 512 + 32 + 64 + 128 + 256);
    }
}
