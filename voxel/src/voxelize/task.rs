//! One task: the drawables of a cell become its sub-DAG.
//!
//! The triangles that touch the cell are loaded once and narrowed down, child by child, to blocks. A task that is a
//! single block holds no triangles at all: they go from the drawable to the bricks.

use super::block::{BlockBuilder, MOST_PARTS};
use super::cell::{Cell, SnappedBox};
use super::overlap::TriangleOverlap;
use super::plan::{PAGE_HEIGHT, Task};
use super::{Drawables, SnappedMesh, SnappedTriangle, VoxelizeError, go_on};
use crate::bits::SetBits;
use crate::dag::build::{DagTables, NodeDraft};
use crate::dag::owners::OwnerBuilder;

/// What a task gives.
pub(super) struct SubDag {
    pub cell: Cell,
    pub tables: DagTables,
    pub owners: OwnerBuilder,
    /// Offset of the cell's node in the top table; `None` when no triangle touches it after all.
    pub root: Option<u32>,
    /// See [`Task::new_triangles`].
    pub new_triangles: u64,
    /// Triangles that were loaded for it.
    pub loaded_triangles: u64,
}

impl SubDag {
    /// Bytes in use, about.
    pub fn bytes(&self) -> u64 {
        self.tables.bytes() + self.owners.bytes()
    }
}

/// Triangles of the children of an open cell: indices by slot.
#[derive(Default)]
struct Narrowed {
    /// (slot, index), in the order of the indices.
    pairs: Vec<(u8, u32)>,
    /// The indices, slot by slot.
    indices: Vec<u32>,
    ends: Vec<usize>,
}

/// Working memory of a thread.
pub(super) struct TaskBuilder<'a> {
    drawables: &'a dyn Drawables,
    block: BlockBuilder,
    block_height: u32,
    mesh: SnappedMesh,
    triangles: Vec<SnappedTriangle>,
    drawable_of: Vec<u32>,
    /// By height.
    narrowed: Vec<Narrowed>,
}

impl<'a> TaskBuilder<'a> {
    /// For blocks of up to `block_height` in a grid of `side` voxels whose root has height `height`. What a task gives may
    /// hold `memory` bytes.
    pub fn new(
        drawables: &'a dyn Drawables,
        block_height: u32,
        height: u32,
        side: i32,
        memory: Option<u64>,
    ) -> Self {
        TaskBuilder {
            drawables,
            block: BlockBuilder::new(block_height, side, memory, MOST_PARTS),
            block_height,
            mesh: SnappedMesh::default(),
            triangles: Vec::new(),
            drawable_of: Vec::new(),
            narrowed: (0..=height).map(|_| Narrowed::default()).collect(),
        }
    }

    pub fn build(&mut self, task: &Task) -> Result<SubDag, VoxelizeError> {
        let cell = task.cell;
        let mut out = SubDag {
            cell,
            tables: DagTables::new(cell.height),
            owners: OwnerBuilder::default(),
            root: None,
            new_triangles: task.new_triangles,
            loaded_triangles: 0,
        };
        if cell.height <= self.block_height {
            self.block.begin(cell, out.bytes())?;
            let mut mesh = std::mem::take(&mut self.mesh);
            for &drawable in &task.drawables {
                self.load(drawable, &mut mesh, &mut out)?;
                mesh.iter()
                    .filter(|t| cell.meets(&SnappedBox::of(t)))
                    .try_for_each(|t| self.block.add(drawable, &t))?;
            }
            self.mesh = mesh;
            out.root = self.block.finish(&mut out)?;
        } else {
            self.load_all(task, &mut out)?;
            let crowded = |_| VoxelizeError::Crowded {
                side: 1 << cell.shift(),
                most: u32::MAX.into(),
                what: "triangles",
            };
            let all: Vec<u32> = (0..u32::try_from(self.triangles.len()).map_err(crowded)?).collect();
            out.root = self.cell(cell, &all, &mut out)?;
        }
        out.owners.end_page();
        Ok(out)
    }

    fn load(&self, drawable: u32, mesh: &mut SnappedMesh, out: &mut SubDag) -> Result<(), VoxelizeError> {
        go_on(self.drawables, 0)?;
        self.drawables.load(drawable, mesh);
        out.loaded_triangles += mesh.triangles.len() as u64;
        Ok(())
    }

    /// Loads the triangles whose boxes meet the cell.
    fn load_all(&mut self, task: &Task, out: &mut SubDag) -> Result<(), VoxelizeError> {
        self.triangles.clear();
        self.drawable_of.clear();
        let mut mesh = std::mem::take(&mut self.mesh);
        for &drawable in &task.drawables {
            self.load(drawable, &mut mesh, out)?;
            let inside = SnappedBox::around(&mesh.vertices).is_some_and(|bounds| task.cell.holds(&bounds));
            let meets = |t: &SnappedTriangle| inside || task.cell.meets(&SnappedBox::of(t));
            self.triangles.extend(mesh.iter().filter(meets));
            self.drawable_of.resize(self.triangles.len(), drawable);
        }
        self.mesh = mesh;
        Ok(())
    }

    /// Builds a cell from the triangles with these indices, which rise.
    fn cell(&mut self, cell: Cell, indices: &[u32], out: &mut SubDag) -> Result<Option<u32>, VoxelizeError> {
        if indices.is_empty() {
            return Ok(None);
        }
        let root = if cell.height <= self.block_height {
            go_on(self.drawables, 0)?;
            self.block.begin(cell, out.bytes())?;
            for &index in indices {
                self.block.add(self.drawable_of[index as usize], &self.triangles[index as usize])?;
            }
            self.block.finish(out)?
        } else {
            let mut narrowed = std::mem::take(&mut self.narrowed[cell.height as usize]);
            narrowed.fill(cell, indices, &self.triangles);
            let mut draft = NodeDraft::default();
            let mut start = 0;
            for (slot, &end) in narrowed.ends.iter().enumerate() {
                let of_child = &narrowed.indices[start..end];
                start = end;
                if let Some(node) = self.cell(cell.child(slot as u32), of_child, out)? {
                    draft.add(slot as u32, node);
                }
            }
            self.narrowed[cell.height as usize] = narrowed;
            if draft.is_empty() {
                None
            } else {
                Some(out.tables.heights[cell.height as usize - 1].intern(&draft)?)
            }
        };
        if cell.height == PAGE_HEIGHT {
            // However the grid was cut into tasks, pages end here.
            out.owners.end_page();
        }
        Ok(root)
    }
}

impl Narrowed {
    /// Sorts triangles to the children of a cell that they touch.
    fn fill(&mut self, cell: Cell, indices: &[u32], triangles: &[SnappedTriangle]) {
        self.pairs.clear();
        let mut counts = [0; 64];
        for &index in indices {
            let triangle = &triangles[index as usize];
            let bounds = SnappedBox::of(triangle);
            let mut slots = 0u64;
            cell.for_each_child(&bounds, |slot| slots |= 1 << slot);
            // Few have more than one child to go to; only those are worth the exact test.
            if slots & (slots.wrapping_sub(1)) != 0 {
                let overlap = TriangleOverlap::new(*triangle);
                for slot in SetBits(slots) {
                    if !overlap.touches_cell(cell.child(slot).corner, 2 * cell.height) {
                        slots &= !(1 << slot);
                    }
                }
            }
            for slot in SetBits(slots) {
                counts[slot as usize] += 1;
                self.pairs.push((slot as u8, index));
            }
        }
        let mut sum = 0;
        let mut next = counts.map(|count| {
            sum += count;
            sum - count
        });
        self.indices.clear();
        self.indices.resize(self.pairs.len(), 0);
        for &(slot, index) in &self.pairs {
            let at = &mut next[slot as usize];
            self.indices[*at] = index;
            *at += 1;
        }
        self.ends.clear();
        self.ends.extend(next);
    }
}
