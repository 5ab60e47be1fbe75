//! Packs owners brick by brick, in the order of the ordinals.

use super::bits::{BitWriter, width_of};
use super::elias_fano::Shape;
use super::page::{Header, MAX_RUNS, write_code};

/// Drawables of a page's palette after which it is closed: its pool stays small however many owners a brick has.
const MAX_POOL: usize = 1 << 16;

/// Packed pages, and the open one.
#[derive(Default)]
pub(crate) struct OwnerBuilder {
    /// First ordinal, and first word, of each finished page.
    pub directory: Vec<[u64; 2]>,
    pub pages: Vec<u64>,
    /// Bricks so far.
    pub bricks: u64,
    open: OpenPage,
}

#[derive(Default)]
struct OpenPage {
    /// Ordinal of its first brick.
    first: u64,
    /// Starts of the runs, counted from there.
    starts: Vec<u64>,
    /// Palette entry of each run, and whether it is masked.
    values: Vec<(u16, bool)>,
    /// Palette: end of each entry in the pool.
    ends: Vec<u32>,
    pool: Vec<u32>,
    code_starts: Vec<u64>,
    codes: BitWriter,
    /// Reused while packing.
    bits: BitWriter,
}

impl OpenPage {
    fn entry(&self, entry: usize) -> &[u32] {
        let start = match entry {
            0 => 0,
            _ => self.ends[entry - 1],
        };
        &self.pool[start as usize..self.ends[entry] as usize]
    }

    /// Is the last run one of bricks that all of these own, all voxels?
    fn continues(&self, same: impl Fn(&[u32]) -> bool) -> bool {
        self.values.last().is_some_and(|&(value, masked)| !masked && same(self.entry(value.into())))
    }

    /// Palette entry of a set of drawables, made when it is new.
    fn value_of(&mut self, drawables: impl Iterator<Item = u32> + Clone) -> u16 {
        // Latest first: neighbours mostly share their owners.
        let known = (0..self.ends.len()).rev().find(|&e| self.entry(e).iter().copied().eq(drawables.clone()));
        let value = known.unwrap_or_else(|| {
            self.pool.extend(drawables);
            self.ends.push(self.pool.len() as u32);
            self.ends.len() - 1
        });
        value as u16
    }
}

impl OwnerBuilder {
    /// Bytes that finished pages hold.
    pub fn bytes(&self) -> u64 {
        (8 * self.pages.capacity() + 16 * self.directory.capacity()) as u64
    }

    /// The next brick, all of whose voxels one drawable owns alone.
    #[inline]
    pub fn push_one(&mut self, drawable: u32) {
        if !self.open.continues(|owners| owners == [drawable]) {
            self.start_run(std::iter::once(drawable), false);
        }
        self.bricks += 1;
    }

    /// The next brick, touched by `owners`: (drawable, voxels), drawables rising, at least one.
    pub fn push(&mut self, owners: &[(u32, u64)]) {
        let union = owners.iter().fold(0, |union, (_, mask)| union | mask);
        let drawables = owners.iter().map(|&(drawable, _)| drawable);
        let masked = owners.iter().any(|&(_, mask)| mask != union);
        if masked {
            self.start_run(drawables, true);
            let codes = &mut self.open.codes;
            self.open.code_starts.push(codes.len() as u64);
            write_code(owners, union, codes);
        } else if !self.open.continues(|set| drawables.clone().eq(set.iter().copied())) {
            self.start_run(drawables, false);
        }
        self.bricks += 1;
    }

    fn start_run(&mut self, drawables: impl Iterator<Item = u32> + Clone, masked: bool) {
        if self.open.starts.len() == MAX_RUNS || self.open.pool.len() > MAX_POOL {
            self.end_page();
        }
        if self.open.starts.is_empty() {
            self.open.first = self.bricks;
        }
        let value = self.open.value_of(drawables);
        self.open.starts.push(self.bricks - self.open.first);
        self.open.values.push((value, masked));
    }

    /// Closes the open page, if any: the next brick begins another one.
    pub fn end_page(&mut self) {
        let page = &mut self.open;
        let Some((_, later_starts)) = page.starts.split_first() else { return };
        let (lowest, highest) =
            page.pool.iter().fold((u32::MAX, 0), |(low, high), &d| (low.min(d), high.max(d)));
        let later_codes = page.code_starts.get(1..).unwrap_or_default();
        let (starts, codes) = (Shape::of(later_starts), Shape::of(later_codes));
        let header = Header {
            runs: page.starts.len(),
            entries: page.ends.len(),
            drawable_width: width_of(u64::from(highest - lowest)),
            start_low: starts.low_width,
            start_upper: starts.upper_bits,
            code_low: codes.low_width,
            code_upper: codes.upper_bits,
            has_masks: !page.code_starts.is_empty(),
            lowest,
            pool: page.pool.len(),
        };
        let bits = &mut page.bits;
        bits.clear();
        starts.write(later_starts, bits);
        page.values.iter().for_each(|&(value, _)| bits.push(value.into(), header.value_width()));
        if header.has_sets() {
            let mut begins = page.ends.iter().peekable();
            for index in 1..page.pool.len() as u32 {
                bits.push(begins.next_if_eq(&&index).is_some().into(), 1);
            }
        }
        page.pool.iter().for_each(|&d| bits.push(u64::from(d - lowest), header.drawable_width));
        if header.has_masks {
            page.values.iter().for_each(|&(_, masked)| bits.push(masked.into(), 1));
            codes.write(later_codes, bits);
            bits.append(&page.codes);
        }
        self.directory.push([page.first, self.pages.len() as u64]);
        self.pages.extend(header.pack());
        self.pages.extend_from_slice(bits.words());

        page.starts.clear();
        page.values.clear();
        page.ends.clear();
        page.pool.clear();
        page.code_starts.clear();
        page.codes.clear();
    }
}
