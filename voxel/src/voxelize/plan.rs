//! What is built together: the grid is cut, top down, into cells whose drawables are little enough for one task.
//!
//! Owner pages end with tasks, and where they end is part of the result. So settings decide how large cells are cut, which are
//! many pages each, and the drawables alone how cells of [`PAGE_HEIGHT`] and below are: where triangles are so dense
//! that one thread would keep the others waiting.

use rayon::prelude::*;

use super::cell::{Cell, SnappedBox};
use super::{Drawables, Settings, SnappedMesh};
use crate::grid::SUBVOXELS;

/// Owner pages end with cells of this height (256 voxels a side), and with tasks that are smaller still.
pub(super) const PAGE_HEIGHT: u32 = 3;
/// Triangles of a cell that is cut whatever its size and the settings: some tenths of a second of work.
pub(super) const DENSE_TRIANGLES: u64 = 1 << 20;
/// A small dense cell is cut if its children do not have more than this many times its triangles: drawables as large as
/// the cell would be loaded again for each child.
const MOST_REPEATS: u64 = 4;

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
        let mut area = 0.0;
        for [a, b, c] in mesh.iter() {
            let edge = |p: [i32; 3]| [0, 1, 2].map(|k| (p[k] - a[k]) as f32);
            let (p, q) = (edge(b), edge(c));
            let cross = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
            area += 0.5 * cross.iter().map(|c| c * c).sum::<f32>().sqrt();
        }
        // A flat surface touches a brick for each 4x4 voxels, a slanted one up to half as many again.
        let brick_area = (16 * SUBVOXELS * SUBVOXELS) as f32;
        let triangles = mesh.triangles.len() as u32;
        (triangles > 0).then_some(Measure { bounds, triangles, bricks: 1.0 + 1.5 * area / brick_area })
    }
}

/// A cell, and the drawables whose boxes touch it, rising.
pub(super) struct Task {
    pub cell: Cell,
    pub drawables: Vec<u32>,
    /// Triangles of the drawables that no task before had: they sum to all triangles.
    pub new_triangles: u64,
}

/// The tasks, in depth-first order of their cells.
pub(super) struct Tasks {
    /// `None` for drawables without triangles.
    measures: Vec<Option<Measure>>,
    /// Cells to come, the next one last.
    stack: Vec<(Cell, Vec<u32>)>,
    /// Bit a drawable: a task had it.
    seen: Vec<u64>,
    task_triangles: u64,
    task_bricks: u64,
    dense_triangles: u64,
}

impl Tasks {
    /// Loads every drawable once. `None` when the caller wants to stop.
    pub fn plan(
        drawables: &dyn Drawables,
        settings: &Settings,
        dense_triangles: u64,
        root: Cell,
    ) -> Option<Self> {
        let measures = (0..drawables.count())
            .into_par_iter()
            .map_init(SnappedMesh::default, |mesh, drawable| {
                if drawables.advance(0) {
                    return None;
                }
                drawables.load(drawable, mesh);
                Some(Measure::of(mesh))
            })
            .collect::<Option<Vec<_>>>()?;
        let all: Vec<u32> =
            (0..drawables.count()).filter(|&drawable| measures[drawable as usize].is_some()).collect();
        Some(Tasks {
            seen: vec![0; measures.len().div_ceil(64)],
            stack: if all.is_empty() { Vec::new() } else { vec![(root, all)] },
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
    fn cut(&self, cell: Cell, drawables: &[u32]) -> Option<Vec<(Cell, Vec<u32>)>> {
        let triangles = self.triangles(drawables);
        let is_dense = triangles > self.dense_triangles;
        if cell.height > PAGE_HEIGHT {
            let is_too_much = is_dense || triangles > self.task_triangles || {
                let measures = drawables.iter().filter_map(|&d| self.measures[d as usize]);
                let bricks: f64 = measures.map(|m| f64::from(m.bricks) * share(&m.bounds, cell)).sum();
                bricks > self.task_bricks as f64
            };
            return is_too_much.then(|| self.children(cell, drawables));
        }
        if !is_dense || cell.height == 1 {
            return None;
        }
        let children = self.children(cell, drawables);
        let repeated: u64 = children.iter().map(|(_, drawables)| self.triangles(drawables)).sum();
        (repeated <= MOST_REPEATS * triangles).then_some(children)
    }

    /// The children of a cell that drawables touch, last first.
    fn children(&self, cell: Cell, drawables: &[u32]) -> Vec<(Cell, Vec<u32>)> {
        let mut of_child: [Vec<u32>; 64] = std::array::from_fn(|_| Vec::new());
        for &drawable in drawables {
            let Some(measure) = self.measures[drawable as usize] else { continue };
            cell.for_each_child(&measure.bounds, |slot| of_child[slot as usize].push(drawable));
        }
        let children = of_child.into_iter().enumerate().rev().filter(|(_, drawables)| !drawables.is_empty());
        children.map(|(slot, drawables)| (cell.child(slot as u32), drawables)).collect()
    }
}

impl Iterator for Tasks {
    type Item = Task;

    fn next(&mut self) -> Option<Task> {
        loop {
            let (cell, drawables) = self.stack.pop()?;
            if let Some(children) = self.cut(cell, &drawables) {
                self.stack.extend(children);
                continue;
            }
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
