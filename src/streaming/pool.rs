//! Where pages lie in one piece of memory of fixed size: a free list, best fit, and compaction when room is there but in pieces.

use std::collections::{BTreeMap, BTreeSet};

/// Starts and lengths are multiples of this, bytes: what copies on GPUs want.
pub const ALIGNMENT: u64 = 16;

/// Memory of fixed size, shared out to pages. It knows where things lie; it does not hold them.
#[derive(Clone, Debug)]
pub struct Pool {
    capacity: u64,
    /// Start of each used range, its length and page.
    used: BTreeMap<u64, (u64, u32)>,
    /// Start and length of each hole; two are never side by side.
    holes: BTreeMap<u64, u64>,
    /// The same as (length, start).
    by_length: BTreeSet<(u64, u64)>,
    free: u64,
}

/// Something to be moved down: its bytes are to be copied, as through a second memory where the ranges overlap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Move {
    /// Which page.
    pub page: u32,
    /// From here.
    pub from: u64,
    /// To here, always lower.
    pub to: u64,
    /// Bytes, padded.
    pub bytes: u64,
}

/// Bytes that a page takes in the pool.
pub fn padded(bytes: u64) -> u64 {
    bytes.next_multiple_of(ALIGNMENT)
}

impl Pool {
    /// All free. What is beyond a multiple of [`ALIGNMENT`] is not used.
    pub fn new(capacity: u64) -> Self {
        let capacity = capacity / ALIGNMENT * ALIGNMENT;
        let mut pool = Pool {
            capacity,
            used: BTreeMap::new(),
            holes: BTreeMap::new(),
            by_length: BTreeSet::new(),
            free: 0,
        };
        pool.add_hole(0, capacity);
        pool.free = capacity;
        pool
    }

    /// Bytes in all.
    pub fn capacity(&self) -> u64 {
        self.capacity
    }

    /// Bytes that are free, in however many pieces.
    pub fn free(&self) -> u64 {
        self.free
    }

    /// Finds room for a page, in the smallest hole that has it; `None` when no hole is large enough.
    pub fn allocate(&mut self, page: u32, bytes: u64) -> Option<u64> {
        let bytes = padded(bytes);
        let &(length, start) = self.by_length.range((bytes, 0)..).next()?;
        self.remove_hole(start, length);
        self.add_hole(start + bytes, length - bytes);
        self.used.insert(start, (bytes, page));
        self.free -= bytes;
        Some(start)
    }

    /// Frees what starts here; nothing does: nothing happens.
    pub fn release(&mut self, start: u64) {
        let Some((bytes, _)) = self.used.remove(&start) else { return };
        self.free += bytes;
        self.add_hole(start, bytes);
    }

    /// Moves the page above the lowest hole down into it. Repeated, it brings all holes together at the end. `None` when they are.
    pub fn compact(&mut self) -> Option<Move> {
        let (&to, &length) = self.holes.first_key_value()?;
        let from = to + length;
        let (bytes, page) = self.used.remove(&from)?;
        self.remove_hole(to, length);
        self.used.insert(to, (bytes, page));
        self.add_hole(to + bytes, length);
        Some(Move { page, from, to, bytes })
    }

    /// Adds a hole, joined with those beside it.
    fn add_hole(&mut self, start: u64, length: u64) {
        if length == 0 {
            return;
        }
        let (mut start, mut end) = (start, start + length);
        if let Some((&before, &length)) = self.holes.range(..start).next_back()
            && before + length == start
        {
            self.remove_hole(before, length);
            start = before;
        }
        if let Some(&length) = self.holes.get(&end) {
            self.remove_hole(end, length);
            end += length;
        }
        self.holes.insert(start, end - start);
        self.by_length.insert((end - start, start));
    }

    fn remove_hole(&mut self, start: u64, length: u64) {
        self.holes.remove(&start);
        self.by_length.remove(&(length, start));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Used ranges and holes tile the pool.
    fn check(pool: &Pool) {
        let used = pool.used.iter().map(|(&start, &(length, _))| (start, length, true));
        let holes = pool.holes.iter().map(|(&start, &length)| (start, length, false));
        let mut ranges: Vec<(u64, u64, bool)> = used.chain(holes).collect();
        ranges.sort_unstable();
        let mut at = 0;
        for &(start, length, _) in &ranges {
            assert_eq!(start, at);
            assert!(length > 0 && start % ALIGNMENT == 0 && length % ALIGNMENT == 0);
            at += length;
        }
        assert_eq!(at, pool.capacity);
        assert!(ranges.windows(2).all(|pair| pair[0].2 || pair[1].2), "two holes side by side");
        assert_eq!(pool.free, pool.holes.values().sum::<u64>());
        let by_length: BTreeSet<(u64, u64)> = pool.holes.iter().map(|(&s, &l)| (l, s)).collect();
        assert_eq!(by_length, pool.by_length);
    }

    #[test]
    fn ranges_never_overlap_and_compaction_makes_all_room_one() {
        for seed in 0..50 {
            let mut random = oorandom::Rand64::new(seed);
            let capacity = 1 + random.rand_u64() % 5000;
            let mut pool = Pool::new(capacity);
            let mut live: Vec<(u64, u64)> = Vec::new();
            for page in 0..600 {
                match random.rand_u64() % 3 {
                    0 | 1 => {
                        let bytes = 1 + random.rand_u64() % 400;
                        let largest = pool.by_length.last().map_or(0, |&(length, _)| length);
                        match pool.allocate(page, bytes) {
                            Some(start) => live.push((start, bytes)),
                            None => assert!(padded(bytes) > largest, "seed {seed}: there was room"),
                        }
                    }
                    _ if !live.is_empty() => {
                        let (start, _) = live.swap_remove((random.rand_u64() % live.len() as u64) as usize);
                        pool.release(start);
                    }
                    _ => {}
                }
                check(&pool);
            }
            let mut moves = 0;
            while let Some(Move { from, to, bytes, .. }) = pool.compact() {
                assert!(to < from && bytes > 0);
                check(&pool);
                moves += 1;
                assert!(moves <= live.len());
            }
            assert!(pool.holes.len() <= 1);
            assert!(pool.free == 0 || pool.allocate(9999, pool.free).is_some());
        }
    }
}
