//! What is built together: the grid is cut, top down, into cells whose drawables are little enough for one task.

use rayon::prelude::*;

use super::cell::{Cell, SnappedBox};
use super::{Drawables, Settings, SnappedMesh};
use crate::grid::SUBVOXELS;

/// Cells of this height (256 voxels a side) are not cut further: owner pages end with them.
pub(super) const SMALLEST_TASK: u32 = 3;

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
}

impl Tasks {
    /// Loads every drawable once. `None` when the caller wants to stop.
    pub fn plan(drawables: &dyn Drawables, settings: &Settings, root: Cell) -> Option<Self> {
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
        })
    }

    /// Triangles loaded to plan.
    pub fn planned_triangles(&self) -> u64 {
        self.measures.iter().flatten().map(|measure| u64::from(measure.triangles)).sum()
    }

    fn is_too_much(&self, cell: Cell, drawables: &[u32]) -> bool {
        let (mut triangles, mut bricks) = (0u64, 0.0);
        for measure in drawables.iter().filter_map(|&d| self.measures[d as usize]) {
            triangles += u64::from(measure.triangles);
            bricks += f64::from(measure.bricks) * share(&measure.bounds, cell);
        }
        triangles > self.task_triangles || bricks > self.task_bricks as f64
    }

    /// Replaces a cell by its children that drawables touch.
    fn cut(&mut self, cell: Cell, drawables: &[u32]) {
        let mut of_child: [Vec<u32>; 64] = std::array::from_fn(|_| Vec::new());
        for &drawable in drawables {
            let Some(measure) = self.measures[drawable as usize] else { continue };
            cell.for_each_child(&measure.bounds, |slot| of_child[slot as usize].push(drawable));
        }
        let children = of_child.into_iter().enumerate().rev().filter(|(_, drawables)| !drawables.is_empty());
        self.stack.extend(children.map(|(slot, drawables)| (cell.child(slot as u32), drawables)));
    }
}

impl Iterator for Tasks {
    type Item = Task;

    fn next(&mut self) -> Option<Task> {
        loop {
            let (cell, drawables) = self.stack.pop()?;
            if cell.height > SMALLEST_TASK && self.is_too_much(cell, &drawables) {
                self.cut(cell, &drawables);
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
