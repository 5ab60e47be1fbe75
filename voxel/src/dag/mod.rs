//! The sparse voxel DAG: occupied voxels, equal subtrees stored once, and the owners of every voxel.

pub(crate) mod build;
mod counts;
pub mod node;
pub mod owners;
mod validate;

pub use owners::{OwnerTable, Owners, OwnersRef};
pub use validate::DagStatistics;

use crate::bits::SetBits;
use counts::Counts;
use node::{HEADER_WORDS, child_word, mask_at, node_length, slot};

/// Why a DAG cannot be built, or is not one.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DagError {
    /// More than 2^32 - 1 words of nodes or leaf masks.
    #[error("the DAG outgrows 32-bit offsets: choose a lower resolution")]
    TooManyNodes,
    /// A rule of the packed form is broken; the data did not come from this library, or was damaged.
    #[error("{rule} (at {place})")]
    Broken {
        /// What should be true.
        rule: &'static str,
        /// Where it is not.
        place: String,
    },
}

/// How to read the arrays of a DAG.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DagShape {
    /// log2 of the voxels a side of the grid, 6 to 17. The tree covers the next even number.
    pub log2: u32,
    /// End, in words, of the nodes of height 1, 2, ...; the last is the length of the array.
    pub height_ends: Vec<u32>,
    /// Word offset of the root, `None` for an empty grid.
    pub root: Option<u32>,
}

/// Height of the root over a grid of 2^log2 voxels a side: a node of height h covers 4^(h+1).
pub(crate) fn root_height(log2: u32) -> u32 {
    log2.div_ceil(2) - 1
}

/// A DAG in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dag {
    /// How to read the arrays.
    pub shape: DagShape,
    /// Nodes, see [`node`].
    pub words: Vec<u32>,
    /// Brick counts beside the words of height 2 and above, see [`node`].
    pub counts: Vec<u32>,
    /// Distinct leaf bricks.
    pub leaves: Vec<u64>,
}

impl Dag {
    /// A borrowed view. What this library built needs no validation.
    pub fn view(&self) -> DagRef<'_> {
        DagRef::assume_valid(&self.shape, &self.words, &self.counts, &self.leaves)
    }
}

/// A DAG over borrowed arrays, such as sections of a mapped file. See [`DagRef::validate`].
#[derive(Clone, Copy, Debug)]
pub struct DagRef<'a> {
    pub(crate) height: u32,
    pub(crate) log2: u32,
    pub(crate) root: Option<u32>,
    pub(crate) words: &'a [u32],
    pub(crate) counts: Counts<'a>,
    pub(crate) leaves: &'a [u64],
}

impl<'a> DagRef<'a> {
    /// A view over arrays that have passed [`DagRef::validate`] before, without checking them again. With other arrays,
    /// traversal may give nonsense or panic, but stays safe.
    pub fn assume_valid(shape: &DagShape, words: &'a [u32], counts: &'a [u32], leaves: &'a [u64]) -> Self {
        let counts = Counts::new(shape, words.len(), counts);
        DagRef { height: root_height(shape.log2), log2: shape.log2, root: shape.root, words, counts, leaves }
    }
}

impl DagRef<'_> {
    /// log2 of the voxels a side.
    pub fn log2(&self) -> u32 {
        self.log2
    }

    /// Height of the root: it covers 4^(height + 1) voxels a side.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Word offset of the root, `None` for an empty grid.
    pub fn root(&self) -> Option<u32> {
        self.root
    }

    /// The words of its nodes, see [`node`]: for those who traverse it elsewhere.
    pub fn words(&self) -> &[u32] {
        self.words
    }

    /// Low halves of the brick counts beside the words (see [`node`]), and the first word that has one. High halves are 0 as long
    /// as there are fewer than 2^32 bricks.
    pub fn low_counts(&self) -> (usize, &[u32]) {
        self.counts.low()
    }

    /// Its leaf bricks.
    pub fn leaves(&self) -> &[u64] {
        self.leaves
    }

    /// Voxels a side of the tree: the grid's, or twice as many, of which only the lower half is used.
    pub(crate) fn tree_side(&self) -> i32 {
        4 << (2 * self.height)
    }

    /// Occupied leaf bricks; their ordinals are below this. A grid of 2^17 may have more than 2^32.
    pub fn brick_count(&self) -> u64 {
        self.root.map_or(0, |root| self.counts.below(self.words, self.height, root))
    }

    /// Leaf bricks of a node of this height that come before those of its child in `slot`, which must be occupied.
    /// Summed along the path from the root: a brick's ordinal.
    #[inline]
    pub(crate) fn bricks_before(&self, height: u32, node: u32, slot: u32) -> u64 {
        let mask = mask_at(self.words, node);
        if height == 1 {
            return (mask & ((1 << slot) - 1)).count_ones().into();
        }
        self.counts.at(height, child_word(mask, node, slot))
    }

    /// Ordinal in depth-first order and mask of the brick that holds `voxel`, `None` where nothing is.
    pub fn brick_at(&self, voxel: [i32; 3]) -> Option<(u64, u64)> {
        if voxel.iter().any(|&c| c < 0 || c >> self.log2 != 0) {
            return None;
        }
        let mut at = self.root?;
        let mut ordinal = 0;
        for height in (1..=self.height).rev() {
            let slot = slot(voxel, 2 * height);
            let mask = mask_at(self.words, at);
            if mask >> slot & 1 == 0 {
                return None;
            }
            ordinal += self.bricks_before(height, at, slot);
            at = self.words[child_word(mask, at, slot)];
        }
        Some((ordinal, self.leaves[at as usize]))
    }

    /// Mask of the brick with this ordinal; `None` from the brick count on.
    pub fn brick_mask(&self, ordinal: u64) -> Option<u64> {
        let mut at = self.root.filter(|_| ordinal < self.brick_count())?;
        let mut left = ordinal;
        for height in (2..=self.height).rev() {
            // The last child that begins at or before what is left: counts rise along the children.
            let (mut first, mut end) =
                (at as usize + HEADER_WORDS, at as usize + node_length(self.words, at as usize));
            while end - first > 1 {
                let middle = first.midpoint(end);
                if self.counts.at(height, middle) <= left { first = middle } else { end = middle }
            }
            left -= self.counts.at(height, first);
            at = self.words[first];
        }
        let leaf = self.words[at as usize + HEADER_WORDS + left as usize];
        Some(self.leaves[leaf as usize])
    }

    /// Is this voxel occupied? Voxels outside the grid are not.
    pub fn is_occupied(&self, voxel: [i32; 3]) -> bool {
        self.brick_at(voxel).is_some_and(|(_, mask)| mask >> slot(voxel, 0) & 1 == 1)
    }

    /// Calls `visit(corner, ordinal, mask)` for every occupied brick in depth-first order.
    pub fn for_each_brick(&self, mut visit: impl FnMut([i32; 3], u64, u64)) {
        let mut ordinal = 0;
        if let Some(root) = self.root {
            self.walk(root, self.height, [0; 3], &mut ordinal, &mut visit);
        }
    }

    fn walk(
        &self,
        node: u32,
        height: u32,
        corner: [i32; 3],
        ordinal: &mut u64,
        visit: &mut impl FnMut([i32; 3], u64, u64),
    ) {
        let slots = SetBits(mask_at(self.words, node)).map(|slot| slot as i32);
        for (slot, word) in slots.zip(node as usize + HEADER_WORDS..) {
            let digits = [slot & 3, slot >> 2 & 3, slot >> 4];
            let child = [0, 1, 2].map(|k| corner[k] + (digits[k] << (2 * height)));
            if height == 1 {
                visit(child, *ordinal, self.leaves[self.words[word] as usize]);
                *ordinal += 1;
            } else {
                self.walk(self.words[word], height - 1, child, ordinal, visit);
            }
        }
    }
}
