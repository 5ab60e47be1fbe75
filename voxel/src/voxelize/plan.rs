//! What is built together: the grid is cut, top down, into cells whose drawables are little enough for one task.
//!
//! A cell is cut for one of two reasons:
//!
//! - *Bricks*: what its drawables are estimated to become is more than a task should hold. Only cells above [`PAGE_HEIGHT`].
//! - *Triangles*: more than one thread should have to itself. But a drawable goes to every child that its box touches, and
//!   is loaded again for each. So a cell is not cut for triangles if its children would have too many times those of the
//!   cell ([`MOST_REPEATS`], the product over all cells from the root down): a large drawable of many small triangles is
//!   left whole. Unless cells are cut for bricks, all tasks together load at most that many times all triangles.
//!
//! Owner pages end with cells of [`PAGE_HEIGHT`] and with tasks, and where they end is part of the result. So settings may cut
//! what is larger, which is many pages, and nothing else. Below, a cell is cut if it is *dense*: it has more than
//! [`DENSE_TRIANGLES`], and may be cut for triangles. Every cell above a dense one is dense as well, since it has no fewer
//! triangles and its product is no greater (every drawable goes to one child at least). Dense cells are cut whatever the
//! settings. So which cells of [`PAGE_HEIGHT`] and below are reached and cut depends on the drawables alone.

use rayon::prelude::*;

use super::cell::{Cell, SnappedBox};
use super::{Drawables, Settings, SnappedMesh, SnappedTriangle, VoxelizeError, go_on};
use crate::grid::SUBVOXELS;

/// Owner pages end with cells of this height (256 voxels a side), and with tasks that are smaller still.
pub(super) const PAGE_HEIGHT: u32 = 3;
/// Triangles of a cell that is cut whatever its size and the settings: some tenths of a second of work.
pub(super) const DENSE_TRIANGLES: u64 = 1 << 20;
/// Times that triangles may be loaded because cells are cut for triangles.
const MOST_REPEATS: f64 = 4.0;

/// What planning knows of a drawable.
#[derive(Clone, Copy, Debug)]
struct Measure {
    bounds: SnappedBox,
    triangles: u32,
    /// Bricks that it touches, roughly.
    bricks: f32,
}

impl Measure {
    fn of(mesh: &SnappedMesh) -> Option<Self> {
        let bounds = SnappedBox::around(&mesh.vertices)?;
        let triangles = mesh.triangles.len() as u32;
        let bricks: f64 = mesh.iter().map(|triangle| f64::from(bricks_of(&triangle))).sum();
        // Finely cut, long surfaces share bricks; never more than their box has.
        let bricks = (1.0 + bricks).min(bricks_in(&bounds)) as f32;
        (triangles > 0).then_some(Measure { bounds, triangles, bricks })
    }
}

/// Steps a side of a brick.
const BRICK_STEPS: i32 = 4 * SUBVOXELS;

/// Bricks that a triangle touches, roughly; 0 for tiny ones, which share theirs.
fn bricks_of([a, b, c]: &SnappedTriangle) -> f32 {
    let edge = |p: &[i32; 3], q: &[i32; 3]| [0, 1, 2].map(|k| (q[k] - p[k]) as f32);
    let length_squared = |v: [f32; 3]| v.iter().map(|c| c * c).sum::<f32>();
    let (p, q) = (edge(a, b), edge(a, c));
    let cross = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    // A flat surface touches a brick for each 4x4 voxels, a slanted one up to half as many again.
    let by_area = 0.75 * length_squared(cross).sqrt() / (BRICK_STEPS * BRICK_STEPS) as f32;
    // A needle has no area, and yet a brick for each 4 voxels of its length.
    let longest_squared = length_squared(p).max(length_squared(q)).max(length_squared(edge(b, c)));
    let by_length = longest_squared.sqrt() / BRICK_STEPS as f32;
    if by_length > 1.0 { by_area.max(by_length) } else { by_area }
}

/// Bricks that a box touches, no fewer.
fn bricks_in(bounds: &SnappedBox) -> f64 {
    let (low, high) = bounds.cells(2);
    (0..3).map(|k| f64::from(high[k] - low[k] + 1)).product()
}

/// A cell, and the drawables whose boxes touch it, rising.
pub(super) struct Task {
    pub cell: Cell,
    pub drawables: Vec<u32>,
    /// Triangles of the drawables that no task before had: they sum to all triangles.
    pub new_triangles: u64,
}

/// A cell to come, on the way down.
struct Open {
    cell: Cell,
    /// The drawables whose boxes touch it, rising.
    drawables: Vec<u32>,
    /// Product, over the cells above it, of how many times a cell's triangles its children have together.
    repeats: f64,
}

/// The tasks, in depth-first order of their cells.
pub(super) struct Tasks {
    /// `None` for drawables without triangles.
    measures: Vec<Option<Measure>>,
    /// Cells to come, the next one last.
    stack: Vec<Open>,
    /// Bit a drawable: a task had it.
    seen: Vec<u64>,
    task_triangles: u64,
    task_bricks: u64,
    dense_triangles: u64,
}

impl Tasks {
    /// Loads every drawable once.
    ///
    /// # Errors
    ///
    /// [`VoxelizeError::Cancelled`] when the caller wants to stop.
    pub fn plan(
        drawables: &dyn Drawables,
        settings: &Settings,
        dense_triangles: u64,
        root: Cell,
    ) -> Result<Self, VoxelizeError> {
        let measures = (0..drawables.count())
            .into_par_iter()
            .map_init(SnappedMesh::default, |mesh, drawable| {
                go_on(drawables, 0)?;
                drawables.load(drawable, mesh);
                Ok::<_, VoxelizeError>(Measure::of(mesh))
            })
            .collect::<Result<Vec<_>, _>>()?;
        let all: Vec<u32> =
            (0..drawables.count()).filter(|&drawable| measures[drawable as usize].is_some()).collect();
        let root = Open { cell: root, drawables: all, repeats: 1.0 };
        Ok(Tasks {
            seen: vec![0; measures.len().div_ceil(64)],
            stack: if root.drawables.is_empty() { Vec::new() } else { vec![root] },
            measures,
            task_triangles: settings.task_triangles,
            task_bricks: settings.task_bricks,
            dense_triangles,
        })
    }

    /// Triangles loaded to plan.
    pub fn planned_triangles(&self) -> u64 {
        self.measures.iter().flatten().map(|measure| u64::from(measure.triangles)).sum()
    }

    /// Triangles of drawables.
    fn triangles(&self, drawables: &[u32]) -> u64 {
        let measures = drawables.iter().filter_map(|&d| self.measures[d as usize]);
        measures.map(|measure| u64::from(measure.triangles)).sum()
    }

    /// The children of a cell that drawables touch, last first, if it is to be cut.
    fn cut(&self, open: &Open) -> Option<Vec<Open>> {
        let triangles = self.triangles(&open.drawables);
        let is_large = open.cell.height > PAGE_HEIGHT;
        let is_too_many = triangles > self.dense_triangles || is_large && triangles > self.task_triangles;
        let is_too_much = is_large && self.bricks(open) > self.task_bricks as f64;
        if open.cell.height == 1 || !is_too_many && !is_too_much {
            return None;
        }
        let of_child = self.children(open);
        let of_children: u64 = of_child.iter().map(|(_, drawables)| self.triangles(drawables)).sum();
        let repeats = open.repeats * of_children as f64 / triangles as f64;
        let child = |(cell, drawables)| Open { cell, drawables, repeats };
        let is_cut = is_too_much || is_too_many && repeats <= MOST_REPEATS;
        is_cut.then(|| of_child.into_iter().map(child).collect())
    }

    /// Bricks that a cell's drawables touch within it, roughly.
    fn bricks(&self, open: &Open) -> f64 {
        let measures = open.drawables.iter().filter_map(|&d| self.measures[d as usize]);
        measures.map(|m| f64::from(m.bricks) * share(&m.bounds, open.cell)).sum()
    }

    /// The children of a cell that drawables touch, last first.
    fn children(&self, open: &Open) -> Vec<(Cell, Vec<u32>)> {
        let mut of_child: [Vec<u32>; 64] = std::array::from_fn(|_| Vec::new());
        for &drawable in &open.drawables {
            let Some(measure) = self.measures[drawable as usize] else { continue };
            open.cell.for_each_child(&measure.bounds, |slot| of_child[slot as usize].push(drawable));
        }
        let children = of_child.into_iter().enumerate().rev().filter(|(_, drawables)| !drawables.is_empty());
        children.map(|(slot, drawables)| (open.cell.child(slot as u32), drawables)).collect()
    }
}

impl Iterator for Tasks {
    type Item = Task;

    fn next(&mut self) -> Option<Task> {
        loop {
            let open = self.stack.pop()?;
            if let Some(children) = self.cut(&open) {
                self.stack.extend(children);
                continue;
            }
            let Open { cell, drawables, .. } = open;
            let mut new_triangles = 0;
            for &drawable in &drawables {
                let (word, bit) = (drawable as usize / 64, 1 << (drawable % 64));
                if self.seen[word] & bit == 0 {
                    self.seen[word] |= bit;
                    let measure = self.measures[drawable as usize];
                    new_triangles += measure.map_or(0, |m| u64::from(m.triangles));
                }
            }
            return Some(Task { cell, drawables, new_triangles });
        }
    }
}

/// The share of a box that lies in a cell.
fn share(bounds: &SnappedBox, cell: Cell) -> f64 {
    let size = i64::from(SUBVOXELS) << cell.shift();
    (0..3)
        .map(|k| {
            let low = i64::from(cell.corner[k]) * i64::from(SUBVOXELS);
            let (min, max) = (i64::from(bounds.min[k]), i64::from(bounds.max[k]) + 1);
            (max.min(low + size) - min.max(low)).max(0) as f64 / (max - min) as f64
        })
        .product()
}
