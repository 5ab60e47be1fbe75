//! One page of owners: up to 256 runs of consecutive bricks, self-contained, bit-packed.
//!
//! ```text
//! word 0    fields of 8, 8, 6, 6, 10, 6, 10, 1 bits, lowest first: runs - 1; palette entries - 1; bits of a drawable;
//!           low and upper bits of the starts; low and upper bits of the code starts; whether any run is masked
//! word 1    lowest drawable (32 bits), drawables of all palette entries together (32 bits)
//! then bits starts of the runs but the first, counted from the page's first brick (Elias-Fano)
//!           palette entry of each run, as narrow as the palette allows
//!           where the palette has sets: for each of its drawables but the first, whether an entry begins with it
//!           its drawables, less the lowest one; those of an entry rise
//!           where any run is masked: a bit a run; then the starts of the codes but the first (Elias-Fano); the codes
//! ```
//!
//! A run that is not masked: every drawable of its entry owns every voxel of its bricks. A masked run is one brick
//! with several owners, which do not own the same voxels. Its *code* says who owns what, given the n occupied voxels of
//! the brick in bit order: n bits for each owner but the last; for the last, a bit for each voxel that another one owns,
//! and nothing for the others, which are its own by necessity. So owners own the voxels of their brick and no others by
//! construction.

use super::bits::{BitWriter, Bits, low_mask, width_of};
use super::elias_fano::{EliasFano, Shape};

/// Words before the bits.
pub(super) const HEADER_WORDS: usize = 2;
/// Most runs, and so most palette entries, of a page.
pub(super) const MAX_RUNS: usize = 256;

/// Widths of the fields of word 0.
const FIELDS: [u32; 8] = [8, 8, 6, 6, 10, 6, 10, 1];

/// The two header words, unpacked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub runs: usize,
    pub entries: usize,
    pub drawable_width: u32,
    pub start_low: u32,
    pub start_upper: usize,
    pub code_low: u32,
    pub code_upper: usize,
    pub has_masks: bool,
    pub lowest: u32,
    /// Drawables of all entries together.
    pub pool: usize,
}

impl Header {
    pub fn pack(&self) -> [u64; HEADER_WORDS] {
        let fields = [
            self.runs as u64 - 1,
            self.entries as u64 - 1,
            self.drawable_width.into(),
            self.start_low.into(),
            self.start_upper as u64,
            self.code_low.into(),
            self.code_upper as u64,
            self.has_masks.into(),
        ];
        let mut word = 0;
        let mut at = 0;
        for (field, width) in fields.into_iter().zip(FIELDS) {
            debug_assert!(field & !low_mask(width) == 0, "{self:?}");
            word |= field << at;
            at += width;
        }
        [word, u64::from(self.lowest) | (self.pool as u64) << 32]
    }

    /// Any two words; fields that no page has are found by validation.
    #[inline]
    pub fn unpack(words: [u64; HEADER_WORDS]) -> Self {
        let mut at = 0;
        let [runs, entries, drawable_width, start_low, start_upper, code_low, code_upper, has_masks] = FIELDS
            .map(|width| {
                let field = words[0] >> at & low_mask(width);
                at += width;
                field
            });
        Header {
            runs: runs as usize + 1,
            entries: entries as usize + 1,
            drawable_width: drawable_width as u32,
            start_low: start_low as u32,
            start_upper: start_upper as usize,
            code_low: code_low as u32,
            code_upper: code_upper as usize,
            has_masks: has_masks == 1,
            lowest: words[1] as u32,
            pool: (words[1] >> 32) as usize,
        }
    }

    pub fn value_width(&self) -> u32 {
        width_of(self.entries as u64 - 1)
    }

    pub fn has_sets(&self) -> bool {
        self.pool != self.entries
    }
}

/// A page to read. Any words are safe to read; only validated ones make sense.
#[derive(Clone, Copy, Debug)]
pub(super) struct Page<'a> {
    pub header: Header,
    bits: Bits<'a>,
    starts: EliasFano<'a>,
    values_at: usize,
    marks_at: usize,
    pool_at: usize,
    masked_at: usize,
    /// End of the parts whose length the header tells.
    pub fixed_end: usize,
}

impl<'a> Page<'a> {
    /// Words that are missing are read as 0.
    #[inline]
    pub fn new(words: &'a [u64]) -> Self {
        let header = Header::unpack([0, 1].map(|i| words.get(i).copied().unwrap_or(0)));
        let bits = Bits(words.get(HEADER_WORDS..).unwrap_or_default());
        let shape =
            Shape { count: header.runs - 1, low_width: header.start_low, upper_bits: header.start_upper };
        let starts = EliasFano { bits, at: 0, shape };
        let values_at = shape.bits();
        let marks_at = values_at + header.runs * header.value_width() as usize;
        let marks = if header.has_sets() { header.pool.saturating_sub(1) } else { 0 };
        let pool_at = marks_at + marks;
        let masked_at = pool_at + header.pool * header.drawable_width as usize;
        let fixed_end = masked_at + if header.has_masks { header.runs } else { 0 };
        Page { header, bits, starts, values_at, marks_at, pool_at, masked_at, fixed_end }
    }

    /// The run that holds the page's brick number `brick`.
    #[inline]
    pub fn run_of(&self, brick: u64) -> usize {
        self.starts.rank(brick)
    }

    /// Start of a run, counted from the page's first brick; `None` past the last run.
    pub fn start(&self, run: usize) -> Option<u64> {
        match run.checked_sub(1) {
            None => Some(0),
            Some(i) => self.starts.get(i),
        }
    }

    /// Set bits of the unary part of the starts.
    pub fn start_ones(&self) -> usize {
        self.bits.count_ones(0, self.header.start_upper)
    }

    #[inline]
    pub fn value(&self, run: usize) -> usize {
        let width = self.header.value_width();
        self.bits.get(self.values_at + run * width as usize, width) as usize
    }

    /// Set marks: entries but the first.
    pub fn mark_ones(&self) -> usize {
        if self.header.has_sets() {
            self.bits.count_ones(self.marks_at, self.header.pool.saturating_sub(1))
        } else {
            self.header.entries - 1
        }
    }

    /// Where the drawables of a palette entry lie in the pool.
    #[inline]
    pub fn entry(&self, entry: usize) -> std::ops::Range<usize> {
        if !self.header.has_sets() {
            return entry..entry + 1;
        }
        let marks = self.header.pool.saturating_sub(1);
        let begin = |n: usize| self.bits.select_one(self.marks_at, marks, n).map(|mark| mark + 1);
        let start = match entry.checked_sub(1) {
            None => 0,
            Some(n) => begin(n).unwrap_or(self.header.pool),
        };
        start..begin(entry).unwrap_or(self.header.pool)
    }

    /// Does a palette entry begin at this index of the pool?
    pub fn is_entry_start(&self, pool_index: usize) -> bool {
        match pool_index.checked_sub(1) {
            Some(mark) if self.header.has_sets() => self.bits.get(self.marks_at + mark, 1) == 1,
            _ => true,
        }
    }

    #[inline]
    pub fn drawable(&self, pool_index: usize) -> u32 {
        let width = self.header.drawable_width;
        let above = self.bits.get(self.pool_at + pool_index * width as usize, width) as u32;
        self.header.lowest.wrapping_add(above)
    }

    #[inline]
    pub fn is_masked(&self, run: usize) -> bool {
        self.header.has_masks && self.bits.get(self.masked_at + run, 1) == 1
    }

    /// Masked runs before this one.
    pub fn masked_before(&self, run: usize) -> usize {
        self.bits.count_ones(self.masked_at, run)
    }

    /// All masked runs.
    pub fn masked_runs(&self) -> usize {
        if self.header.has_masks { self.masked_before(self.header.runs) } else { 0 }
    }

    /// Starts of the codes but the first, counted from the end of this list: it is as long as there are masked runs
    /// less one.
    pub fn code_starts(&self) -> EliasFano<'a> {
        let shape = Shape {
            count: self.masked_runs().saturating_sub(1),
            low_width: self.header.code_low,
            upper_bits: self.header.code_upper,
        };
        EliasFano { bits: self.bits, at: self.fixed_end, shape }
    }

    /// Position of the code of the masked run that has `index` masked ones before it.
    #[inline]
    pub fn code_at(&self, index: usize) -> usize {
        let starts = self.code_starts();
        let offset = match index.checked_sub(1) {
            None => 0,
            // Damaged starts lead past the end, where bits are 0.
            Some(i) => starts.get(i).unwrap_or(u64::MAX >> 8),
        };
        (self.fixed_end + starts.shape.bits()).saturating_add(offset as usize)
    }

    /// Bits of the page, padding included, and those of its header not.
    pub fn bit_length(&self) -> usize {
        64 * self.bits.0.len()
    }

    /// The owners of the brick number `brick` of the page, whose occupied voxels are `mask`.
    #[inline]
    pub fn owners(&self, brick: u64, mask: u64) -> OwnerSet<'a> {
        let run = self.run_of(brick);
        let code_at = self.is_masked(run).then(|| self.code_at(self.masked_before(run)));
        OwnerSet { mask, code_at, ..self.owners_of_run(run) }
    }

    /// All owners of the bricks of a run; not of which voxels.
    #[inline]
    pub fn owners_of_run(&self, run: usize) -> OwnerSet<'a> {
        let entry = self.entry(self.value(run));
        let width = self.header.drawable_width;
        OwnerSet {
            bits: self.bits,
            lowest: self.header.lowest,
            width,
            pool_at: self.pool_at + entry.start * width as usize,
            count: entry.len() as u32,
            mask: 0,
            code_at: None,
        }
    }
}

/// The owners of a brick, still packed.
#[derive(Clone, Copy, Debug)]
pub(super) struct OwnerSet<'a> {
    bits: Bits<'a>,
    lowest: u32,
    width: u32,
    pool_at: usize,
    pub count: u32,
    mask: u64,
    /// `None`: all own all voxels.
    pub code_at: Option<usize>,
}

impl<'a> OwnerSet<'a> {
    #[inline]
    pub fn drawable(&self, i: u32) -> u32 {
        let above = self.bits.get(self.pool_at + i as usize * self.width as usize, self.width) as u32;
        self.lowest.wrapping_add(above)
    }

    /// Bits of the code for owner `i`; the last one's follow those of the others.
    #[inline]
    fn row(&self, code_at: usize, i: u32) -> usize {
        code_at.saturating_add(i as usize * self.mask.count_ones() as usize)
    }

    /// The drawables that own an occupied voxel, in their order.
    #[inline]
    pub fn of_voxel(self, bit: u32) -> impl Iterator<Item = u32> + 'a {
        let voxels = self.mask.count_ones();
        let rank = (self.mask & low_mask(bit)).count_ones();
        let (mut is_covered, mut covered) = (false, 0);
        (0..self.count)
            .filter(move |&i| {
                let Some(code_at) = self.code_at else { return true };
                if i + 1 < self.count {
                    let row = self.bits.get(self.row(code_at, i), voxels);
                    let owns = row >> rank & 1 == 1;
                    is_covered |= owns;
                    covered |= row;
                    return owns;
                }
                let before = (covered & low_mask(rank)).count_ones();
                !is_covered || self.bits.get(self.row(code_at, i).saturating_add(before as usize), 1) == 1
            })
            .map(move |i| self.drawable(i))
    }

    /// All owners with the voxels that each owns, and the bits of the code.
    pub fn masks(self) -> (Vec<(u32, u64)>, usize) {
        let voxels = self.mask.count_ones();
        let Some(code_at) = self.code_at else {
            return ((0..self.count).map(|i| (self.drawable(i), self.mask)).collect(), 0);
        };
        let mut covered = 0;
        let mut masks = Vec::new();
        for i in 0..self.count.saturating_sub(1) {
            let row = self.bits.get(self.row(code_at, i), voxels);
            covered |= row;
            masks.push((self.drawable(i), spread(row, self.mask)));
        }
        let last = self.count.saturating_sub(1);
        let shared = self.bits.get(self.row(code_at, last), covered.count_ones());
        let row = spread(shared, covered) | low_mask(voxels) & !covered;
        masks.push((self.drawable(last), spread(row, self.mask)));
        (masks, last as usize * voxels as usize + covered.count_ones() as usize)
    }
}

/// Appends the code of a brick of occupied voxels `union`; see the module.
pub(super) fn write_code(owners: &[(u32, u64)], union: u64, out: &mut BitWriter) {
    let voxels = union.count_ones();
    let Some(((_, last), others)) = owners.split_last() else { return };
    let mut covered = 0;
    for &(_, mask) in others {
        covered |= mask;
        out.push(gather(mask, union), voxels);
    }
    out.push(gather(*last, covered), covered.count_ones());
}

/// The bits of `value` under the set bits of `mask`, side by side.
fn gather(value: u64, mask: u64) -> u64 {
    let (mut left, mut result, mut at) = (mask, 0, 0);
    while left != 0 {
        let lowest = left & left.wrapping_neg();
        result |= u64::from(value & lowest != 0) << at;
        at += 1;
        left ^= lowest;
    }
    result
}

/// The inverse: bit i of `value` to the place of the i-th set bit of `mask`.
fn spread(value: u64, mask: u64) -> u64 {
    let (mut left, mut result, mut at) = (mask, 0, 0);
    while left != 0 {
        let lowest = left & left.wrapping_neg();
        if value >> at & 1 == 1 {
            result |= lowest;
        }
        at += 1;
        left ^= lowest;
    }
    result
}
