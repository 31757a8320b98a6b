//! Ranges of an arena: first fit over a sorted free list. Deterministic: the same calls give the same ranges.

use std::ops::Range;

/// Hands out ranges of elements.
#[derive(Clone, Debug, Default)]
pub struct RangeAllocator {
    free: Vec<Range<u32>>,
    capacity: u32,
}

impl RangeAllocator {
    /// Elements in all.
    pub fn capacity(&self) -> u32 {
        self.capacity
    }

    /// Takes `len` elements; `None` if no gap is long enough.
    pub fn take(&mut self, len: u32) -> Option<Range<u32>> {
        let at = self.free.iter().position(|gap| gap.end - gap.start >= len)?;
        let start = self.free[at].start;
        self.free[at].start += len;
        if self.free[at].is_empty() {
            self.free.remove(at);
        }
        Some(start..start + len)
    }

    /// Gives a range back.
    pub fn give(&mut self, range: Range<u32>) {
        if range.is_empty() {
            return;
        }
        let at = self.free.partition_point(|gap| gap.start < range.start);
        self.free.insert(at, range);
        if at + 1 < self.free.len() && self.free[at].end == self.free[at + 1].start {
            self.free[at].end = self.free.remove(at + 1).end;
        }
        if at > 0 && self.free[at - 1].end == self.free[at].start {
            self.free[at - 1].end = self.free.remove(at).end;
        }
    }

    /// Makes room behind the end.
    pub fn grow(&mut self, capacity: u32) {
        debug_assert!(capacity >= self.capacity);
        let old = std::mem::replace(&mut self.capacity, capacity);
        self.give(old..capacity);
    }

    /// Length of the gap at the very end.
    pub fn tail_gap(&self) -> u32 {
        self.free.last().filter(|gap| gap.end == self.capacity).map_or(0, |gap| gap.end - gap.start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn ranges_never_overlap_and_all_comes_back(ops in prop::collection::vec((any::<bool>(), 1u32..50), 1..80)) {
            let mut allocator = RangeAllocator::default();
            let mut taken: Vec<Range<u32>> = Vec::new();
            for (take, n) in ops {
                if take || taken.is_empty() {
                    let range = allocator.take(n).unwrap_or_else(|| {
                        let capacity = allocator.capacity() + n;
                        allocator.grow(capacity);
                        allocator.take(n).expect("room was made")
                    });
                    prop_assert!(range.end <= allocator.capacity() && range.len() == n as usize);
                    prop_assert!(taken.iter().all(|t| t.end <= range.start || range.end <= t.start));
                    taken.push(range);
                } else {
                    allocator.give(taken.swap_remove(n as usize % taken.len()));
                }
            }
            for range in taken.drain(..) {
                allocator.give(range);
            }
            prop_assert_eq!(allocator.tail_gap(), allocator.capacity());
        }
    }

    #[test]
    fn a_gap_that_is_too_short_is_not_taken() {
        let mut allocator = RangeAllocator::default();
        allocator.grow(10);
        let first = allocator.take(4);
        assert_eq!((first.clone(), allocator.take(6)), (Some(0..4), Some(4..10)));
        allocator.give(first.unwrap_or_default());
        assert_eq!(allocator.take(5), None);
    }
}
