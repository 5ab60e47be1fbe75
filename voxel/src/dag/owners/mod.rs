//! Which drawables touch each brick, and which of its voxels: every voxel knows all its owners exactly.
//!
//! Bricks are numbered in depth-first order. Neighbouring ordinals mostly share one owner, so that ordinals are stored
//! as *runs*, up to 256 of them a page. A page stands alone: where its runs start, its own palette of
//! drawables and sets of drawables (neighbouring runs alternate between few), and, for bricks whose owners own different voxels,
//! who owns which. A directory of two words a page, first ordinal and first word, finds the page of an ordinal. Pages
//! end where a cell of 256^3 voxels ends (a smaller one where triangles are dense), so that cells are packed in parallel and joined by copying.
//!
//! The masks of a brick's owners are stored relative to the brick's own mask, which the DAG knows: lookups take it.
//!
//! Measured (`benches/voxelize.rs`), bytes a brick, against plain lists of (start, value) u32 pairs and (drawable, mask) u64
//! pairs: plant of 12 M triangles at 8192^3 0.76 against 3.78, LEGO Falcon at 4096^3 1.32 against 9.43, Huldra plant
//! at 8192^3 0.39 against 1.99. The finer the grid, the fewer: 0.23 for plant and Falcon at 32,768^3.

mod bits;
mod build;
mod elias_fano;
mod page;
#[cfg(test)]
mod tests;
mod validate;

pub(crate) use build::OwnerBuilder;

use page::{OwnerSet, Page};

/// Packed owners in memory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OwnerTable {
    /// First ordinal and first word of each page.
    pub directory: Vec<[u64; 2]>,
    /// Words of all pages.
    pub pages: Vec<u64>,
}

impl OwnerTable {
    /// The lookup index of a table that this library built over `bricks` bricks.
    pub fn index(&self, bricks: u64) -> OwnersIndex {
        OwnersIndex::new(&self.directory, bricks)
    }
}

/// Lookup index over a directory of pages, made once when it is validated: about 4 bytes a page.
#[derive(Clone, Debug, Default)]
pub struct OwnersIndex {
    /// log2 of the ordinals of a span.
    shift: u32,
    /// For each span of ordinals, the page that holds its first.
    page_of_span: Vec<u32>,
}

impl OwnersIndex {
    fn new(directory: &[[u64; 2]], bricks: u64) -> Self {
        // About a span for each page.
        let per_page = bricks / (directory.len() as u64).max(1);
        let shift = bits::width_of(per_page).saturating_sub(1);
        let spans = if bricks == 0 { 0 } else { ((bricks - 1) >> shift) + 1 };
        let mut page = 0usize;
        let page_of_span = (0..spans).map(|span| {
            while directory.get(page + 1).is_some_and(|&[first, _]| first <= span << shift) {
                page += 1;
            }
            page as u32
        });
        OwnersIndex { shift, page_of_span: page_of_span.collect() }
    }
}

/// Owners over borrowed arrays, which [`OwnersIndex::validate`] has checked.
#[derive(Clone, Copy, Debug)]
pub struct OwnersRef<'a> {
    directory: &'a [[u64; 2]],
    pages: &'a [u64],
    index: &'a OwnersIndex,
}

/// The owners of one brick.
#[derive(Clone, Copy, Debug)]
pub struct Owners<'a>(OwnerSet<'a>);

impl<'a> Owners<'a> {
    /// All owners of the brick, rising.
    #[inline]
    pub fn all(self) -> impl Iterator<Item = u32> + 'a {
        (0..self.0.count).map(move |i| self.0.drawable(i))
    }

    /// The drawables that own voxel `bit` of the brick, which must be occupied; rising.
    #[inline]
    pub fn of_voxel(self, bit: u32) -> impl Iterator<Item = u32> + 'a {
        self.0.of_voxel(bit)
    }

    /// All owners of the brick, rising, each with the voxels that it owns.
    pub fn masks(self) -> Vec<(u32, u64)> {
        self.0.masks().0
    }
}

impl<'a> OwnersRef<'a> {
    /// A view over the arrays from which `index` was made.
    pub fn new(directory: &'a [[u64; 2]], pages: &'a [u64], index: &'a OwnersIndex) -> Self {
        OwnersRef { directory, pages, index }
    }

    /// First ordinal and first word of each page; words of all pages: for those who read them elsewhere.
    pub fn arrays(&self) -> (&'a [[u64; 2]], &'a [u64]) {
        (self.directory, self.pages)
    }

    /// Owners of the brick with this ordinal, which must be below the brick count, and this mask of occupied voxels
    /// ([`crate::dag::DagRef::brick_at`] gives both).
    #[inline]
    pub fn of_brick(&self, ordinal: u64, mask: u64) -> Owners<'a> {
        let page = self.page_of(ordinal);
        Owners(self.page(page).owners(ordinal - self.directory[page][0], mask))
    }

    /// All owners of the brick with this ordinal, which must be below the brick count; rising. Quicker than to ask
    /// [`OwnersRef::of_brick`] for them: who owns which voxels is not looked up.
    #[inline]
    pub fn all_of_brick(&self, ordinal: u64) -> impl Iterator<Item = u32> + 'a {
        let index = self.page_of(ordinal);
        let page = self.page(index);
        Owners(page.owners_of_run(page.run_of(ordinal - self.directory[index][0]))).all()
    }

    /// Place in the directory of the page that holds a brick.
    #[inline]
    fn page_of(&self, ordinal: u64) -> usize {
        let span = (ordinal >> self.index.shift) as usize;
        let first = self.index.page_of_span[span] as usize;
        let end = self.index.page_of_span.get(span + 1).map_or(self.directory.len(), |&p| p as usize + 1);
        let among = &self.directory[first..end];
        first + among.partition_point(|&[start, _]| start <= ordinal) - 1
    }

    /// A page, by its place in the directory.
    #[inline]
    fn page(&self, page: usize) -> Page<'a> {
        let start = self.directory[page][1] as usize;
        let end = self.directory.get(page + 1).map_or(self.pages.len(), |&[_, word]| word as usize);
        Page::new(&self.pages[start..end])
    }
}
