//! Binning: which triangles touch which block.

use rayon::prelude::*;

use super::overlap::TriangleOverlap;
use super::{Drawables, SnappedMesh, SnappedTriangle, for_each_cell};
use crate::dag::node::slot;
use crate::dag::{DagError, root_height};

/// Triangles a batch, about: small enough to balance, large enough to amortize.
const BATCH_TRIANGLES: u64 = 1 << 17;

/// Triangles of one drawable in one block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Entry {
    /// Path of the block from the root, six bits a height: its depth-first order.
    pub key: u64,
    pub drawable: u32,
    /// Where its triangles are.
    pub source: Source,
}

/// Where the triangles of an entry are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Source {
    /// The whole drawable: load it again.
    Whole,
    /// A range of a batch's binned triangles.
    Binned { batch: u32, start: usize, count: usize },
}

/// All entries, sorted by block and then by drawable, and the triangles of those that are spread over blocks.
pub(super) struct Bins {
    entries: Vec<Entry>,
    batches: Vec<Vec<SnappedTriangle>>,
    blocks: BlockGrid,
}

/// How the grid is cut into blocks.
#[derive(Clone, Copy)]
struct BlockGrid {
    block_height: u32,
    /// Height of the root.
    height: u32,
    /// log2 of the voxels a side of a block.
    shift: u32,
    /// Coordinate of the last block along each axis.
    last: i32,
}

/// One block that has triangles.
pub(super) struct Block {
    /// Path from the root, six bits a height.
    pub key: u64,
    /// Low corner, voxels.
    pub corner: [i32; 3],
    /// Range of its entries.
    pub entries: std::ops::Range<usize>,
}

impl Bins {
    /// Blocks that have triangles, in depth-first order.
    pub fn blocks(&self) -> impl Iterator<Item = Block> {
        let mut start = 0;
        self.entries.chunk_by(|a, b| a.key == b.key).map(move |entries| {
            let range = start..start + entries.len();
            start = range.end;
            let key = entries[0].key;
            Block { key, corner: self.blocks.corner(key), entries: range }
        })
    }

    pub fn entries(&self, block: &Block) -> &[Entry] {
        &self.entries[block.entries.clone()]
    }

    pub fn triangles(&self, batch: u32, start: usize, count: usize) -> &[SnappedTriangle] {
        &self.batches[batch as usize][start..][..count]
    }
}

pub(super) fn bin(drawables: &dyn Drawables, block_height: u32, log2: u32) -> Result<Bins, DagError> {
    let blocks = BlockGrid::new(block_height, log2);
    let batches = batches(drawables);
    let binned: Vec<Option<(Vec<Entry>, Vec<SnappedTriangle>)>> = batches
        .par_iter()
        .enumerate()
        .map_init(SnappedMesh::default, |mesh, (batch, range)| {
            let mut entries = Vec::new();
            let mut triangles = Vec::new();
            for drawable in range.clone() {
                if drawables.advance(0) {
                    return None;
                }
                drawables.load(drawable, mesh);
                blocks.bin(drawable, mesh, batch as u32, &mut entries, &mut triangles);
            }
            Some((entries, triangles))
        })
        .collect();
    let mut entries = Vec::new();
    let mut batches = Vec::new();
    for part in binned {
        let (mut of_batch, triangles) = part.ok_or(DagError::Cancelled)?;
        entries.append(&mut of_batch);
        batches.push(triangles);
    }
    entries.par_sort_unstable();
    Ok(Bins { entries, batches, blocks })
}

/// Ranges of drawables with about [`BATCH_TRIANGLES`] triangles each, independent of the number of threads.
fn batches(drawables: &dyn Drawables) -> Vec<std::ops::Range<u32>> {
    let mut batches = Vec::new();
    let (mut start, mut triangles) = (0, 0u64);
    for drawable in 0..drawables.count() {
        triangles += u64::from(drawables.triangle_count(drawable)) + 16;
        if triangles >= BATCH_TRIANGLES || drawable + 1 == drawables.count() {
            batches.push(start..drawable + 1);
            (start, triangles) = (drawable + 1, 0);
        }
    }
    batches
}

impl BlockGrid {
    fn new(block_height: u32, log2: u32) -> Self {
        let shift = 2 * block_height + 2;
        BlockGrid {
            block_height,
            height: root_height(log2),
            shift,
            last: (1 << log2.saturating_sub(shift)) - 1,
        }
    }

    /// Path from the root of the block that holds a voxel, six bits a height.
    fn key(&self, voxel: [i32; 3]) -> u64 {
        (self.block_height + 1..=self.height).rev().fold(0, |key, h| key << 6 | u64::from(slot(voxel, 2 * h)))
    }

    /// Low corner, in voxels, of the block with this path.
    fn corner(&self, key: u64) -> [i32; 3] {
        let mut corner = [0; 3];
        for height in self.block_height + 1..=self.height {
            let digit = (key >> (6 * (height - self.block_height - 1)) & 63) as i32;
            for (k, c) in corner.iter_mut().enumerate() {
                *c |= (digit >> (2 * k) & 3) << (2 * height);
            }
        }
        corner
    }

    /// First and last block that a triangle's box touches.
    fn range(&self, overlap: &TriangleOverlap) -> ([i32; 3], [i32; 3]) {
        let (low, high) = overlap.cell_range(self.shift);
        let clamp = |c: [i32; 3]| c.map(|c| c.clamp(0, self.last));
        (clamp(low), clamp(high))
    }

    /// Adds a drawable to the blocks that it touches.
    fn bin(
        &self,
        drawable: u32,
        mesh: &SnappedMesh,
        batch: u32,
        entries: &mut Vec<Entry>,
        binned: &mut Vec<SnappedTriangle>,
    ) {
        if mesh.triangles.is_empty() {
            return;
        }
        // The box of all vertices in one block: no need to look at triangles.
        let (mut min, mut max) = ([i32::MAX; 3], [i32::MIN; 3]);
        for vertex in &mesh.vertices {
            for k in 0..3 {
                min[k] = min[k].min(vertex[k]);
                max[k] = max[k].max(vertex[k]);
            }
        }
        let (low, high) = self.range(&TriangleOverlap::new([min, max, min]));
        if low == high {
            let key = self.key(low.map(|c| c << self.shift));
            entries.push(Entry { key, drawable, source: Source::Whole });
            return;
        }

        let mut pairs: Vec<(u64, u32)> = Vec::new();
        for (index, triangle) in mesh.iter().enumerate() {
            let overlap = TriangleOverlap::new(triangle);
            let (low, high) = self.range(&overlap);
            for_each_cell(low, high, |block| {
                let corner = block.map(|c| c << self.shift);
                if low == high || overlap.touches_cell(corner, self.shift) {
                    pairs.push((self.key(corner), index as u32));
                }
            });
        }
        pairs.sort_unstable();
        for of_block in pairs.chunk_by(|a, b| a.0 == b.0) {
            let start = binned.len();
            let corners =
                |index: u32| mesh.triangles[index as usize].map(|corner| mesh.vertices[corner as usize]);
            binned.extend(of_block.iter().map(|&(_, index)| corners(index)));
            let source = Source::Binned { batch, start, count: of_block.len() };
            entries.push(Entry { key: of_block[0].0, drawable, source });
        }
    }
}
