//! Compressed rows that can be rewritten one at a time.
//!
//! [`SlotCsr`] is a CSR whose rows carry start *and* length, so an edit rewrites the rows it touches and leaves the
//! rest of the arena alone: cost and upload follow the wound, not the model. Built by count, scan, fill.

use super::hash::StateHash;
use super::room::rows_headroom;
use super::tracked::{Delta, Tracked};
use bytemuck::{Pod, Zeroable};

/// Notes of entries that there is room for, as many times those of other lists: an edit writes rows as a whole.
const ENTRIES: usize = 4;

/// Notes of rows rewritten in place that there is room for at first: no memory before it is written to.
const REWRITTEN_ROOM: usize = 4096;

/// Where a row lies in the arena.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Span {
    /// First entry.
    pub start: u32,
    /// Number of entries.
    pub len: u32,
}

/// Rows of `T`, each rewritable. Shape: `spans.len()` rows over one arena of entries.
#[derive(Clone, Debug)]
pub struct SlotCsr<T> {
    spans: Tracked<Span>,
    entries: Tracked<T>,
    /// Rows whose entries were replaced in place, with their span as it was, since the last delta.
    rewritten: Vec<u32>,
}

/// What changed in a [`SlotCsr`].
#[derive(Clone, Debug)]
pub struct SlotCsrDelta<T> {
    /// Changes of the row table.
    pub spans: Delta<Span>,
    /// Changes of the arena.
    pub entries: Delta<T>,
    /// Rows whose entries were replaced in place, with their span as it was.
    rewritten: Vec<u32>,
}

impl<T> Default for SlotCsr<T> {
    fn default() -> Self {
        Self { spans: Tracked::default(), entries: Tracked::default(), rewritten: Vec::new() }
    }
}

impl<T> Default for SlotCsrDelta<T> {
    fn default() -> Self {
        Self { spans: Delta::default(), entries: Delta::default(), rewritten: Vec::new() }
    }
}

impl<T> SlotCsrDelta<T> {
    /// Rows that differ between the two states, or may, repeats possible.
    pub fn changed_rows(&self) -> impl Iterator<Item = usize> + '_ {
        self.spans.touched().chain(self.rewritten.iter().map(|row| *row as usize))
    }

    /// [`Delta::make_room`] for rows and entries.
    pub fn make_room(&mut self, edits: usize) {
        self.spans.make_room(edits);
        self.entries.make_room(ENTRIES * edits);
        self.rewritten.reserve(edits * REWRITTEN_ROOM);
    }

    /// True if nothing changed.
    pub fn is_empty(&self) -> bool {
        self.spans.is_empty() && self.entries.is_empty()
    }

    /// Heap bytes held.
    pub fn heap_bytes(&self) -> usize {
        self.spans.heap_bytes() + self.entries.heap_bytes() + self.rewritten.len() * size_of::<u32>()
    }
}

impl<T: Copy> SlotCsrDelta<T> {
    /// Adds what the next edit changed.
    pub fn append(&mut self, later: &Self) {
        self.spans.append(&later.spans);
        self.entries.append(&later.entries);
        self.rewritten.extend_from_slice(&later.rewritten);
    }
}

impl<T: Copy + Pod> SlotCsr<T> {
    /// `rows` empty rows.
    pub fn with_rows(rows: usize) -> Self {
        Self { spans: vec![Span::default(); rows].into(), ..Self::default() }
    }

    /// From a list of rows.
    pub fn from_rows<'a>(rows: impl IntoIterator<Item = &'a [T]>) -> Self
    where
        T: 'a,
    {
        let mut spans = Vec::new();
        let mut entries = Vec::new();
        for row in rows {
            spans.push(Span { start: entries.len() as u32, len: row.len() as u32 });
            entries.extend_from_slice(row);
        }
        Self { spans: spans.into(), entries: entries.into(), rewritten: Vec::new() }
    }

    /// From `(row, entry)` pairs in any order; entries of a row keep their relative order.
    pub fn from_pairs(rows: usize, pairs: &[(u32, T)]) -> Self {
        let mut spans = vec![Span::default(); rows];
        for (row, _) in pairs {
            spans[*row as usize].len += 1;
        }
        let mut start = 0;
        for span in &mut spans {
            span.start = start;
            start += span.len;
        }
        let mut cursor: Vec<u32> = spans.iter().map(|s| s.start).collect();
        let mut entries = vec![T::zeroed(); pairs.len()];
        for (row, entry) in pairs {
            let at = &mut cursor[*row as usize];
            entries[*at as usize] = *entry;
            *at += 1;
        }
        Self { spans: spans.into(), entries: entries.into(), rewritten: Vec::new() }
    }

    /// Copies of some rows in order (`None`: an empty one), each entry as `copied` makes it. Rows that follow one another in
    /// the arena are copied as one.
    pub fn gather(&self, rows: impl Iterator<Item = Option<usize>>, copied: impl Fn(&T) -> T) -> Self {
        let old = &self.spans[..];
        let mut spans: Vec<Span> = rows.map(|row| row.map_or(Span::default(), |row| old[row])).collect();
        let total = spans.iter().map(|span| span.len as usize).sum();
        let mut entries = Vec::with_capacity(total);
        if total > 0 {
            let (mut run, mut end) = (0..0, 0);
            for span in &mut spans {
                let (start, len) = (span.start as usize, span.len as usize);
                if start == run.end {
                    run.end += len;
                } else if len > 0 {
                    entries.extend(self.entries[run].iter().map(&copied));
                    run = start..start + len;
                }
                span.start = end;
                end += span.len;
            }
            entries.extend(self.entries[run].iter().map(&copied));
        } else {
            spans.fill(Span::default());
        }
        Self { spans: spans.into(), entries: entries.into(), rewritten: Vec::new() }
    }

    /// Copies of some rows in order: each entry as `copied` makes it, if that says so.
    pub fn gather_some(&self, rows: impl Iterator<Item = usize> + Clone, copied: impl Fn(&T) -> (T, bool)) -> Self {
        let mut spans = Vec::with_capacity(rows.size_hint().0);
        let mut entries = Vec::with_capacity(rows.clone().map(|row| self.spans[row].len as usize).sum());
        // a few at a time: whether an entry stays nobody foresees, so that each is written, and the next over one that does not
        let mut made = [T::zeroed(); 16];
        for row in rows {
            let start = entries.len();
            for few in self.row(row).chunks(made.len()) {
                let mut count = 0;
                for entry in few {
                    let (copy, stays) = copied(entry);
                    made[count] = copy;
                    count += usize::from(stays);
                }
                entries.extend_from_slice(&made[..count]);
            }
            spans.push(Span { start: start as u32, len: (entries.len() - start) as u32 });
        }
        Self { spans: spans.into(), entries: entries.into(), rewritten: Vec::new() }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.spans.len()
    }

    /// Number of entries in all rows (not the arena, which may have holes).
    pub fn len(&self) -> usize {
        self.spans.iter().map(|s| s.len as usize).sum()
    }

    /// True if no row has an entry.
    pub fn is_empty(&self) -> bool {
        self.spans.iter().all(|s| s.len == 0)
    }

    /// One row.
    #[inline]
    pub fn row(&self, row: usize) -> &[T] {
        let span = self.spans[row];
        &self.entries[span.start as usize..(span.start + span.len) as usize]
    }

    /// The row table: what the GPU mirrors.
    pub fn spans(&self) -> &[Span] {
        &self.spans
    }

    /// The whole arena, holes included: what the GPU mirrors.
    pub fn arena(&self) -> &[T] {
        &self.entries
    }

    /// Appends a row and returns its index.
    pub fn push_row(&mut self, entries: &[T]) -> usize {
        let start = self.entries.extend(entries) as u32;
        self.spans.push(Span { start, len: entries.len() as u32 })
    }

    /// Appends a copy of a row and returns its index.
    pub fn push_copy(&mut self, row: usize) -> usize {
        let Span { start, len } = self.spans[row];
        let copy = self.entries.extend_from_within(start as usize..(start + len) as usize) as u32;
        self.spans.push(Span { start: copy, len })
    }

    /// Appends empty rows up to `rows` in all.
    pub fn grow_rows(&mut self, rows: usize) {
        while self.spans.len() < rows {
            self.spans.push(Span { start: self.entries.len() as u32, len: 0 });
        }
    }

    /// Replaces a row: in place where the new entries fit, else at the arena's end.
    pub fn set_row(&mut self, row: usize, entries: &[T]) {
        let old = self.spans[row];
        if entries.len() <= old.len as usize {
            self.entries.set_slice(old.start as usize, entries);
            if entries.len() != old.len as usize {
                self.spans.set(row, Span { start: old.start, len: entries.len() as u32 });
            } else {
                self.rewritten.push(row as u32);
            }
        } else {
            let start = self.entries.extend(entries) as u32;
            self.spans.set(row, Span { start, len: entries.len() as u32 });
        }
    }

    /// Makes room for so many rows and entries more.
    pub fn reserve(&mut self, rows: usize, entries: usize) {
        self.spans.reserve(rows);
        self.entries.reserve(entries);
        self.rewritten.reserve(REWRITTEN_ROOM);
    }

    /// Makes room for what edits will append.
    pub fn make_room(&mut self) {
        self.spans.make_room();
        self.entries.reserve(rows_headroom(self.entries.len()));
        self.entries.make_room_for_notes(ENTRIES);
        self.rewritten.reserve(REWRITTEN_ROOM);
    }

    /// Empties rows, each listed once. Their entries stay in the arena as a hole.
    pub fn clear_rows(&mut self, rows: impl Iterator<Item = usize>) {
        self.spans.update(rows, |span| Span { len: 0, ..span });
    }

    /// Everything changed since the last call.
    pub fn take_delta(&mut self) -> SlotCsrDelta<T> {
        let mut delta = SlotCsrDelta::default();
        self.take_delta_into(&mut delta);
        delta
    }

    /// The same into a delta whose room is used again.
    pub fn take_delta_into(&mut self, delta: &mut SlotCsrDelta<T>) {
        self.spans.take_delta_into(&mut delta.spans);
        self.entries.take_delta_into(&mut delta.entries);
        delta.rewritten.clear();
        // some room to spare for what is appended to a delta that is used again
        let room = delta.rewritten.capacity();
        if (1..self.rewritten.len()).contains(&room) {
            delta.rewritten.reserve(4 * self.rewritten.len());
        }
        delta.rewritten.append(&mut self.rewritten);
    }

    /// Goes back by the newest delta and returns the way forward.
    pub fn apply_delta(&mut self, delta: SlotCsrDelta<T>) -> SlotCsrDelta<T> {
        let SlotCsrDelta { spans, entries, rewritten } = delta;
        SlotCsrDelta { spans: self.spans.apply(spans), entries: self.entries.apply(entries), rewritten }
    }

    /// Feeds rows and arena into `hash`.
    pub fn hash_into(&self, hash: &mut StateHash) {
        self.spans.hash_into(hash);
        self.entries.hash_into(hash);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_survive_rewrites_and_undo() {
        let mut csr = SlotCsr::from_pairs(3, &[(2, 7u32), (0, 1), (2, 8)]);
        assert_eq!((csr.row(0), csr.row(1), csr.row(2)), (&[1][..], &[][..], &[7, 8][..]));
        csr.set_row(1, &[4, 5, 6]);
        csr.set_row(2, &[9]);
        csr.push_row(&[3]);
        assert_eq!((csr.row(1), csr.row(2), csr.row(3)), (&[4, 5, 6][..], &[9][..], &[3][..]));
        assert_eq!(csr.len(), 6);
        let delta = csr.take_delta();
        csr.apply_delta(delta);
        assert_eq!((csr.rows(), csr.row(1), csr.row(2)), (3, &[][..], &[7, 8][..]));
    }

    #[test]
    fn rows_are_gathered_and_cleared() {
        let mut csr = SlotCsr::from_rows([&[1u32][..], &[], &[2, 3], &[4], &[5, 6]]);
        csr.set_row(1, &[7, 8]);
        let picked = csr.gather([Some(0), None, Some(2), Some(3), Some(1), Some(4)].into_iter(), |x| x + 10);
        let rows: Vec<&[u32]> = (0..6).map(|r| picked.row(r)).collect();
        assert_eq!(rows, [&[11][..], &[], &[12, 13], &[14], &[17, 18], &[15, 16]]);
        assert_eq!(picked.arena(), [11, 12, 13, 14, 17, 18, 15, 16]);
        let even = csr.gather_some([4, 1, 0].into_iter(), |x| (x / 2, x % 2 == 0));
        assert_eq!((even.rows(), even.row(0), even.row(1), even.row(2)), (3, &[3][..], &[4][..], &[][..]));
        csr.take_delta();
        csr.clear_rows([1, 2].into_iter());
        assert_eq!((csr.row(1), csr.row(2), csr.row(3), csr.len()), (&[][..], &[][..], &[4][..], 4));
        let delta = csr.take_delta();
        csr.apply_delta(delta);
        assert_eq!((csr.row(1), csr.row(2)), (&[7, 8][..], &[2, 3][..]));
    }
}
