//! Occupied voxels near a line: a tree of boxes, with tests so generous that rounding does not matter.

use glam::DVec3;

use super::line::Line;

/// Voxels, or boxes, in a box.
const FANOUT: usize = 8;

type Cell = ([i32; 3], [i32; 3]);

/// Voxels in the order of a curve, and boxes of 8, 64, ... of them.
pub struct Nearby {
    /// Low corners, and high corners: one above the last voxel.
    levels: Vec<Vec<Cell>>,
}

impl Nearby {
    pub fn new(voxels: &[[i32; 3]]) -> Self {
        let mut sorted = voxels.to_vec();
        sorted.sort_by_cached_key(|v| curve(*v));
        let mut levels = vec![sorted.iter().map(|v| (*v, v.map(|c| c + 1))).collect::<Vec<Cell>>()];
        loop {
            let Some(last) = levels.last().filter(|level| level.len() > 1) else { return Nearby { levels } };
            let next = last.chunks(FANOUT).map(|cells| {
                cells.iter().fold(([i32::MAX; 3], [i32::MIN; 3]), |(low, high), cell| {
                    ([0, 1, 2].map(|k| low[k].min(cell.0[k])), [0, 1, 2].map(|k| high[k].max(cell.1[k])))
                })
            });
            levels.push(next.collect());
        }
    }

    /// Calls `found` for all voxels that the line passes within a voxel's width, and for some others.
    pub fn for_each(&self, line: &Line, mut found: impl FnMut([i32; 3])) {
        let mut waiting = vec![(self.levels.len() - 1, 0)];
        while let Some((level, i)) = waiting.pop() {
            let (low, high) = self.levels[level][i];
            let corner = |c: [i32; 3]| DVec3::from_array(c.map(f64::from));
            if line.inside(corner(low) - 1.0, corner(high) + 1.0).is_none() {
                continue;
            }
            if level == 0 {
                found(low);
            } else {
                let end = self.levels[level - 1].len().min((i + 1) * FANOUT);
                waiting.extend((i * FANOUT..end).map(|child| (level - 1, child)));
            }
        }
    }
}

/// Position along a Morton curve.
fn curve(voxel: [i32; 3]) -> u64 {
    (0..17).fold(0, |code, bit| {
        let digit = (0..3).fold(0, |digit, k| digit | u64::from(voxel[k] as u32 >> bit & 1) << k);
        code | digit << (3 * bit)
    })
}
