//! The sparse voxel DAG: occupied voxels, equal subtrees stored once, and the owners of every voxel.

pub(crate) mod build;
pub mod node;
pub mod owners;
mod validate;

pub use owners::{OwnerTable, Owners, OwnersRef};
pub use validate::DagStatistics;

use node::{HEADER_WORDS, child_word, mask_at, slot};

/// Why a DAG cannot be built, or is not one.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DagError {
    /// More than 2^32 - 1 leaf bricks.
    #[error("the grid has more than 4,294,967,295 occupied bricks: choose a lower resolution")]
    TooManyBricks,
    /// More than 2^32 - 1 words of nodes or leaf masks.
    #[error("the DAG outgrows 32-bit offsets: choose a lower resolution")]
    TooManyNodes,
    /// More than 2^31 - 1 drawables or entries of owner lists.
    #[error("{what} outgrow 31-bit indices")]
    TooManyOwners {
        /// What there is too much of.
        what: &'static str,
    },
    /// A rule of the packed form is broken; the data did not come from this library, or was damaged.
    #[error("{rule} (at {place})")]
    Broken {
        /// What should be true.
        rule: &'static str,
        /// Where it is not.
        place: String,
    },
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
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
    /// Brick counts beside the words.
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
    pub(crate) counts: &'a [u32],
    pub(crate) leaves: &'a [u64],
}

impl<'a> DagRef<'a> {
    /// A view over arrays that have passed [`DagRef::validate`] before, without checking them again. With other arrays,
    /// traversal may give nonsense or panic, but stays safe.
    pub fn assume_valid(shape: &DagShape, words: &'a [u32], counts: &'a [u32], leaves: &'a [u64]) -> Self {
        DagRef { height: root_height(shape.log2), log2: shape.log2, root: shape.root, words, counts, leaves }
    }
}

impl DagRef<'_> {
    /// log2 of the voxels a side.
    pub fn log2(&self) -> u32 {
        self.log2
    }

    /// Voxels a side of the tree: the grid's, or twice as many, of which only the lower half is used.
    pub(crate) fn tree_side(&self) -> i32 {
        4 << (2 * self.height)
    }

    /// Occupied leaf bricks; their ordinals are below this.
    pub fn brick_count(&self) -> u32 {
        self.root.map_or(0, |root| self.counts[root as usize])
    }

    /// Ordinal in depth-first order and mask of the brick that holds `voxel`, `None` where nothing is.
    pub fn brick_at(&self, voxel: [i32; 3]) -> Option<(u32, u64)> {
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
            let word = child_word(mask, at, slot);
            ordinal += self.counts[word];
            at = self.words[word];
        }
        Some((ordinal, self.leaves[at as usize]))
    }

    /// Is this voxel occupied? Voxels outside the grid are not.
    pub fn is_occupied(&self, voxel: [i32; 3]) -> bool {
        self.brick_at(voxel).is_some_and(|(_, mask)| mask >> slot(voxel, 0) & 1 == 1)
    }

    /// Calls `visit(corner, ordinal, mask)` for every occupied brick in depth-first order.
    pub fn for_each_brick(&self, mut visit: impl FnMut([i32; 3], u32, u64)) {
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
        ordinal: &mut u32,
        visit: &mut impl FnMut([i32; 3], u32, u64),
    ) {
        let mut left = mask_at(self.words, node);
        let mut word = node as usize + HEADER_WORDS;
        while left != 0 {
            let slot = left.trailing_zeros() as i32;
            left &= left - 1;
            let digits = [slot & 3, slot >> 2 & 3, slot >> 4];
            let child = [0, 1, 2].map(|k| corner[k] + (digits[k] << (2 * height)));
            if height == 1 {
                visit(child, *ordinal, self.leaves[self.words[word] as usize]);
                *ordinal += 1;
            } else {
                self.walk(self.words[word], height - 1, child, ordinal, visit);
            }
            word += 1;
        }
    }
}
