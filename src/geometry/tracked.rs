//! Arrays that remember what was written to them: the common currency of undo, dirty ranges and edit reports.
//!
//! Every array that an edit may change is a [`Tracked`]. Writes go through [`Tracked::set`], which notes the old
//! value; [`Tracked::take_delta`] hands over all notes since the last call. A [`Delta`] is proportional to what was
//! touched, never to the array (MATHS 7). Applying it restores the array bit for bit and returns the inverse.

use super::hash::StateHash;
use super::room::{fit, headroom};
use bytemuck::Pod;
use std::ops::{Deref, Range};

/// From this many notes on a delta takes them over, room and all: a copy would take longer than finding room anew.
const MANY_NOTES: usize = 4096;

/// Notes that a list has room for at first: more than a segment of a tear mostly takes. It is no memory before it is written to.
const NOTES_ROOM: usize = 4096;

/// Entries from before an edit that it cuts off, as many as there is room for at first: faces take the slots that earlier ones have left.
const CUT_ROOM: usize = 512;

/// A growable array whose changes can be taken back. Reads deref to a slice.
#[derive(Clone, Debug)]
pub struct Tracked<T> {
    data: Vec<T>,
    log: Vec<(u32, T)>,
    /// Shortest length since the last delta: entries from here on are new.
    base_len: usize,
    /// Entries cut off below `base_len`, last to first.
    cut: Vec<T>,
    /// Length at the last delta.
    start_len: usize,
}

/// What [`Tracked`] noted between two calls of [`Tracked::take_delta`], enough to go back.
#[derive(Clone, Debug, PartialEq)]
pub struct Delta<T> {
    /// Length to go back to.
    len: usize,
    /// Values to write back, applied last to first.
    writes: Vec<(u32, T)>,
    /// Values behind `restore_from`, which the change cut off or will be appended by a redo.
    tail: Vec<T>,
    /// Length common to both states.
    restore_from: usize,
    /// Length of the state the delta was taken from.
    new_len: usize,
}

impl<T> Default for Tracked<T> {
    fn default() -> Self {
        Self { data: Vec::new(), log: Vec::new(), base_len: 0, cut: Vec::new(), start_len: 0 }
    }
}

impl<T> Default for Delta<T> {
    fn default() -> Self {
        Self { len: 0, writes: Vec::new(), tail: Vec::new(), restore_from: 0, new_len: 0 }
    }
}

impl<T: Copy> From<Vec<T>> for Tracked<T> {
    fn from(data: Vec<T>) -> Self {
        let len = data.len();
        Self { data, log: Vec::new(), base_len: len, cut: Vec::new(), start_len: len }
    }
}

impl<T> Deref for Tracked<T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        &self.data
    }
}

impl<T: Copy> Tracked<T> {
    /// Writes one entry and notes the old value. Panics when out of range, as a slice does.
    #[inline]
    pub fn set(&mut self, index: usize, value: T) {
        if index < self.base_len {
            self.log.push((index as u32, self.data[index]));
        }
        self.data[index] = value;
    }

    /// [`Tracked::set`] for entries that follow one another.
    #[inline]
    pub fn set_slice(&mut self, start: usize, values: &[T]) {
        let noted = self.base_len.clamp(start, start + values.len()) - start;
        let old = &mut self.data[start..start + values.len()];
        self.log.extend((start as u32..).zip(old[..noted].iter().copied()));
        old.copy_from_slice(values);
    }

    /// Makes room for the entries that edits will append: a growing array is copied as a whole, which no edit should wait for.
    pub fn make_room(&mut self) {
        self.data.reserve(headroom(self.data.len()));
        self.make_room_for_notes(1);
    }

    /// Makes room for the notes of so many usual edits.
    pub fn make_room_for_notes(&mut self, edits: usize) {
        self.log.reserve(edits * NOTES_ROOM);
        self.cut.reserve(edits * CUT_ROOM);
    }

    /// Makes room for so many entries more, and for the notes of an edit.
    pub fn reserve(&mut self, entries: usize) {
        self.data.reserve(entries);
        self.make_room_for_notes(1);
    }

    /// [`Tracked::set`] for many entries, each listed once: `new` makes the value from the old one.
    pub fn update(&mut self, indices: impl Iterator<Item = usize>, new: impl Fn(T) -> T) {
        let (least, most) = indices.size_hint();
        self.log.reserve(most.unwrap_or(least));
        let (data, noted) = (&mut self.data[..], self.base_len);
        for index in indices {
            let old = data[index];
            data[index] = new(old);
            if index < noted {
                self.log.push((index as u32, old));
            }
        }
    }

    /// Appends one entry and returns its position.
    #[inline]
    pub fn push(&mut self, value: T) -> usize {
        self.data.push(value);
        self.data.len() - 1
    }

    /// Appends entries and returns the position of the first.
    #[inline]
    pub fn extend(&mut self, values: &[T]) -> usize {
        self.data.extend_from_slice(values);
        self.data.len() - values.len()
    }

    /// Appends copies of entries and returns the position of the first.
    pub fn extend_from_within(&mut self, range: Range<usize>) -> usize {
        let first = self.data.len();
        self.data.extend_from_within(range);
        first
    }

    /// Removes and returns the last entry.
    pub fn pop(&mut self) -> Option<T> {
        let value = *self.data.last()?;
        if self.data.len() <= self.base_len {
            self.cut.push(value);
            self.base_len -= 1;
        }
        self.data.pop();
        Some(value)
    }

    /// True if anything was written since the last delta.
    pub fn is_dirty(&self) -> bool {
        !self.log.is_empty() || self.data.len() != self.start_len || self.base_len != self.start_len
    }

    /// Indices written or appended since the last delta, repeats possible.
    pub fn touched(&self) -> impl Iterator<Item = usize> + '_ {
        self.log.iter().map(|w| w.0 as usize).chain(self.base_len..self.data.len())
    }

    /// Indices of values that were written over since the last delta, repeats possible.
    pub fn overwritten_at(&self) -> impl Iterator<Item = usize> + '_ {
        self.log.iter().map(|w| w.0 as usize)
    }

    /// Values that were written over since the last delta.
    pub fn overwritten(&self) -> impl Iterator<Item = &T> + '_ {
        self.log.iter().map(|w| &w.1)
    }

    /// Everything noted since the last call; the notes start anew.
    pub fn take_delta(&mut self) -> Delta<T> {
        let mut delta = Delta::default();
        self.take_delta_into(&mut delta);
        delta
    }

    /// [`Tracked::take_delta`] into a delta whose room is used again.
    pub fn take_delta_into(&mut self, delta: &mut Delta<T>) {
        delta.writes.clear();
        if self.log.len() < MANY_NOTES {
            // a copy of just the size: the notes keep their room for the next edit, and a delta that is used again gets some to spare
            let room = delta.writes.capacity();
            if (1..self.log.len()).contains(&room) {
                delta.writes.reserve(4 * self.log.len());
            }
            delta.writes.extend_from_slice(&self.log);
            self.log.clear();
        } else {
            std::mem::swap(&mut delta.writes, &mut self.log);
        }
        delta.tail.clear();
        delta.tail.extend(self.cut.drain(..).rev());
        (delta.len, delta.restore_from, delta.new_len) = (self.start_len, self.base_len, self.data.len());
        self.start_len = self.data.len();
        self.base_len = self.start_len;
    }

    /// Goes back by `delta`, which must be the newest that was taken; returns the way forward again.
    pub fn apply(&mut self, mut delta: Delta<T>) -> Delta<T> {
        self.exchange(&mut delta);
        delta
    }

    /// [`Tracked::apply`] that leaves the way forward in `delta`.
    pub fn exchange(&mut self, delta: &mut Delta<T>) {
        debug_assert!(!self.is_dirty(), "a delta applies to a state without open notes");
        let Delta { writes, tail, restore_from, .. } = delta;
        let (kept, restored) = (*restore_from, tail.len());
        tail.extend_from_slice(&self.data[kept..]);
        self.data.truncate(kept);
        self.data.extend_from_slice(&tail[..restored]);
        tail.drain(..restored);
        for (index, value) in writes.iter_mut().rev() {
            std::mem::swap(&mut self.data[*index as usize], value);
        }
        // entries behind it travel in the tail
        writes.retain(|w| (w.0 as usize) < kept);
        writes.reverse();
        debug_assert_eq!(self.data.len(), delta.len);
        (delta.len, delta.new_len) = (delta.new_len, delta.len);
        self.start_len = self.data.len();
        self.base_len = self.start_len;
    }
}

impl<T: Pod> Tracked<T> {
    /// Feeds length and content into `hash`.
    pub fn hash_into(&self, hash: &mut StateHash) {
        hash.word(self.data.len() as u64);
        hash.bytes(bytemuck::cast_slice(&self.data));
    }
}

/// Counts how many different numbers there are, without sorting them and in time that follows how many come.
#[derive(Clone, Debug, Default)]
pub struct Distinct {
    /// A bit a number; all clear between counts.
    bits: Vec<u64>,
    /// Words with a bit set.
    words: Vec<u32>,
}

impl Distinct {
    /// With room for numbers below this one.
    pub fn with_room(numbers: usize) -> Self {
        Self { bits: vec![0; numbers.div_ceil(64)], words: Vec::with_capacity(numbers.div_ceil(64)) }
    }

    /// Counts them.
    pub fn count(&mut self, numbers: impl Iterator<Item = usize>) -> usize {
        for n in numbers {
            fit(&mut self.bits, n / 64 + 1, 0);
            let word = &mut self.bits[n / 64];
            if *word == 0 {
                self.words.push((n / 64) as u32);
            }
            *word |= 1 << (n % 64);
        }
        let taken = |word: u32| std::mem::take(&mut self.bits[word as usize]).count_ones() as usize;
        self.words.drain(..).map(taken).sum()
    }
}

impl<T: Copy> Delta<T> {
    /// Adds what the next change noted: the delta then goes back over both.
    pub fn append(&mut self, later: &Self) {
        debug_assert_eq!(self.new_len, later.len, "the change that came next");
        let kept = self.restore_from;
        self.writes.extend(later.writes.iter().filter(|w| (w.0 as usize) < kept));
        if later.restore_from < kept {
            self.tail.splice(..0, later.tail[..kept - later.restore_from].iter().copied());
            self.restore_from = later.restore_from;
        }
        self.new_len = later.new_len;
    }
}

impl<T> Delta<T> {
    /// Makes room for what so many usual edits note.
    pub fn make_room(&mut self, edits: usize) {
        self.writes.reserve(edits * NOTES_ROOM);
        self.tail.reserve(edits * CUT_ROOM);
    }

    /// True if nothing changed.
    pub fn is_empty(&self) -> bool {
        self.writes.is_empty() && self.len == self.new_len && self.restore_from == self.len
    }

    /// Indices that differ between the two states, or may, repeats possible.
    pub fn touched(&self) -> impl Iterator<Item = usize> + '_ {
        let tail = self.restore_from..self.len.max(self.new_len);
        self.writes.iter().map(|w| w.0 as usize).chain(tail)
    }

    /// Indices of values from before and after that differ, or may, repeats possible: [`Delta::touched`] without those that only one state has.
    pub fn overwritten_at(&self) -> impl Iterator<Item = usize> + '_ {
        self.writes.iter().map(|w| w.0 as usize)
    }

    /// Values that applying the delta brings back.
    pub fn overwritten(&self) -> impl Iterator<Item = &T> + '_ {
        self.writes.iter().map(|w| &w.1).chain(&self.tail)
    }

    /// The entries that differ between the two states, as index ranges of the longer one, in no order, repeats possible.
    pub fn touched_ranges(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let written = self.writes.iter().map(|w| w.0 as usize).filter(|&i| i < self.restore_from);
        let tail = self.restore_from..self.len.max(self.new_len);
        written.map(|i| i..i + 1).chain((!tail.is_empty()).then_some(tail))
    }

    /// [`Delta::touched`] of the entries that there are now, since the delta was made: those that a mirror must be sent.
    pub fn written(&self) -> impl Iterator<Item = usize> + '_ {
        self.touched().filter(|&i| i < self.new_len)
    }

    /// Bytes of the entries that differ and that there are now, each counted once.
    pub fn dirty_bytes(&self, distinct: &mut Distinct) -> usize {
        distinct.count(self.written()) * std::mem::size_of::<T>()
    }

    /// Heap bytes that the delta holds.
    pub fn heap_bytes(&self) -> usize {
        self.writes.len() * std::mem::size_of::<(u32, T)>() + self.tail.len() * std::mem::size_of::<T>()
    }
}

/// Declares the delta of a struct of [`Tracked`] arrays, with `take_delta`, `apply_delta` and `hash_arrays`.
///
/// ```ignore
/// tracked_arrays!(Mesh => MeshDelta { faces: [VertexId; 3], wedges: Wedge });
/// ```
#[macro_export]
macro_rules! tracked_arrays {
    ($owner:ident => $delta:ident { $($field:ident : $ty:ty),* $(,)? }) => {
        /// What an edit changed, array by array; enough to go back (MATHS 7).
        #[derive(Clone, Debug, Default)]
        pub struct $delta {
            $(#[doc = concat!("Changes of `", stringify!($field), "`.")]
            pub $field: $crate::geometry::Delta<$ty>,)*
        }

        impl $delta {
            /// True if nothing changed.
            pub fn is_empty(&self) -> bool {
                true $(&& self.$field.is_empty())*
            }

            /// Heap bytes held.
            pub fn heap_bytes(&self) -> usize {
                0 $(+ self.$field.heap_bytes())*
            }

            /// Makes room in every list for what so many usual edits note.
            pub fn make_room(&mut self, edits: usize) {
                $(self.$field.make_room(edits);)*
            }

            /// Adds what the next edit changed.
            pub fn append(&mut self, later: &Self) {
                $(self.$field.append(&later.$field);)*
            }
        }

        impl $owner {
            /// Everything changed since the last call.
            pub fn take_delta(&mut self) -> $delta {
                let mut delta = $delta::default();
                self.take_delta_into(&mut delta);
                delta
            }

            /// The same into a delta whose room is used again.
            pub fn take_delta_into(&mut self, delta: &mut $delta) {
                $(self.$field.take_delta_into(&mut delta.$field);)*
            }

            /// Goes back by `delta` (the newest taken) and returns the way forward.
            pub fn apply_delta(&mut self, delta: $delta) -> $delta {
                $delta { $($field: self.$field.apply(delta.$field),)* }
            }

            /// [`Self::apply_delta`] that leaves the way forward in `delta`.
            pub fn exchange_delta(&mut self, delta: &mut $delta) {
                $(self.$field.exchange(&mut delta.$field);)*
            }

            /// Makes room in every array for what edits will append.
            pub fn make_room(&mut self) {
                $(self.$field.make_room();)*
            }

            /// Feeds every tracked array into `hash`.
            pub fn hash_arrays(&self, hash: &mut $crate::geometry::StateHash) {
                $(self.$field.hash_into(hash);)*
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[derive(Clone, Debug)]
    enum Op {
        Set(usize, u32),
        Update(usize, u32),
        Push(u32),
        Pop,
    }

    fn ops() -> impl Strategy<Value = Vec<Op>> {
        let op = prop_oneof![
            (any::<usize>(), any::<u32>()).prop_map(|(i, v)| Op::Set(i, v)),
            (any::<usize>(), any::<u32>()).prop_map(|(i, v)| Op::Update(i, v)),
            any::<u32>().prop_map(Op::Push),
            Just(Op::Pop),
        ];
        prop::collection::vec(op, 0..40)
    }

    fn run(array: &mut Tracked<u32>, ops: &[Op]) {
        for op in ops {
            match *op {
                Op::Set(i, v) if !array.is_empty() => array.set(i % array.len(), v),
                Op::Update(i, v) if !array.is_empty() => array.update((i % array.len()..array.len()).step_by(2), |old| old ^ v),
                Op::Push(v) => drop(array.push(v)),
                Op::Pop => drop(array.pop()),
                Op::Set(..) | Op::Update(..) => {}
            }
        }
    }

    proptest! {
        #[test]
        fn undo_and_redo_restore_every_state(start in prop::collection::vec(any::<u32>(), 0..10), edits in prop::collection::vec(ops(), 1..6)) {
            let mut array = Tracked::from(start);
            let mut states = vec![array.to_vec()];
            let mut undo = Vec::new();
            for edit in &edits {
                run(&mut array, edit);
                undo.push(array.take_delta());
                states.push(array.to_vec());
            }
            let mut redo = Vec::new();
            for i in (0..undo.len()).rev() {
                redo.push(array.apply(undo.pop().unwrap()));
                prop_assert_eq!(&array.to_vec(), &states[i]);
            }
            for state in &states[1..] {
                undo.push(array.apply(redo.pop().unwrap()));
                prop_assert_eq!(&array.to_vec(), state);
            }
            for i in (0..undo.len()).rev() {
                array.apply(undo.pop().unwrap());
                prop_assert_eq!(&array.to_vec(), &states[i]);
            }
        }

        #[test]
        fn changes_in_a_row_are_undone_and_redone_as_one(start in prop::collection::vec(any::<u32>(), 0..10), edits in prop::collection::vec(ops(), 1..6)) {
            let mut array = Tracked::from(start.clone());
            let (mut all, mut next) = (array.take_delta(), Delta::default());
            for edit in &edits {
                run(&mut array, edit);
                array.take_delta_into(&mut next);
                all.append(&next);
            }
            let end = array.to_vec();
            let redo = array.apply(all);
            prop_assert_eq!(&array.to_vec(), &start);
            let undo = array.apply(redo);
            prop_assert_eq!(&array.to_vec(), &end);
            array.apply(undo);
            prop_assert_eq!(&array.to_vec(), &start);
        }

        #[test]
        fn touched_ranges_cover_every_difference(start in prop::collection::vec(any::<u32>(), 1..20), edit in ops()) {
            let mut array = Tracked::from(start.clone());
            run(&mut array, &edit);
            let delta = array.take_delta();
            let entries: std::collections::BTreeSet<usize> = delta.touched_ranges().flatten().collect();
            let there = entries.iter().filter(|&&i| i < array.len()).count();
            prop_assert_eq!(delta.dirty_bytes(&mut Distinct::default()), there * std::mem::size_of::<u32>());
            for i in 0..array.len().max(start.len()) {
                if array.get(i) != start.get(i) {
                    prop_assert!(entries.contains(&i));
                }
            }
        }
    }
}
