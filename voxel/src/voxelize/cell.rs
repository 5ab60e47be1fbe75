//! Cells of the octree, and which of them a box of snapped vertices may touch.

use super::SnappedTriangle;
use crate::grid::SUBVOXELS;

/// A cell of height h: 4^(h+1) voxels a side, what a node of that height covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Cell {
    /// Low corner, voxels.
    pub corner: [i32; 3],
    pub height: u32,
}

impl Cell {
    /// log2 of the voxels a side.
    pub fn shift(&self) -> u32 {
        2 * self.height + 2
    }

    pub fn child(&self, slot: u32) -> Cell {
        let digits = [slot & 3, slot >> 2 & 3, slot >> 4];
        let corner = [0, 1, 2].map(|k| self.corner[k] + ((digits[k] as i32) << (2 * self.height)));
        Cell { corner, height: self.height - 1 }
    }

    /// Does it hold all cells that the box may touch?
    pub fn holds(&self, bounds: &SnappedBox) -> bool {
        let (low, high) = bounds.cells(self.shift());
        let at = self.corner.map(|c| c >> self.shift());
        low == at && high == at
    }

    /// May the box touch it?
    pub fn meets(&self, bounds: &SnappedBox) -> bool {
        let (low, high) = bounds.cells(self.shift());
        let at = self.corner.map(|c| c >> self.shift());
        (0..3).all(|k| low[k] <= at[k] && at[k] <= high[k])
    }

    /// Calls `visit(slot)` for the children that the box may touch, rising.
    #[inline]
    pub fn for_each_child(&self, bounds: &SnappedBox, mut visit: impl FnMut(u32)) {
        let (low, high) = bounds.cells(2 * self.height);
        let first = self.corner.map(|c| c >> (2 * self.height));
        let (low, high) = (
            [0, 1, 2].map(|k| (low[k] - first[k]).clamp(0, 4)),
            [0, 1, 2].map(|k| (high[k] - first[k]).clamp(-1, 3)),
        );
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    visit((x + 4 * y + 16 * z) as u32);
                }
            }
        }
    }
}

/// Box of snapped vertices, steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SnappedBox {
    pub min: [i32; 3],
    pub max: [i32; 3],
}

impl SnappedBox {
    /// `None` without vertices.
    pub fn around(vertices: &[[i32; 3]]) -> Option<Self> {
        let (first, others) = vertices.split_first()?;
        let mut bounds = SnappedBox { min: *first, max: *first };
        for vertex in others {
            for ((min, max), &c) in bounds.min.iter_mut().zip(&mut bounds.max).zip(vertex) {
                *min = c.min(*min);
                *max = c.max(*max);
            }
        }
        Some(bounds)
    }

    #[inline]
    pub fn of([a, b, c]: &SnappedTriangle) -> Self {
        SnappedBox {
            min: [0, 1, 2].map(|k| a[k].min(b[k]).min(c[k])),
            max: [0, 1, 2].map(|k| a[k].max(b[k]).max(c[k])),
        }
    }

    /// First and last cell of `2^shift` voxels that a triangle in this box may touch: never fewer than
    /// [`super::overlap::TriangleOverlap::cell_range`] says.
    #[inline]
    pub fn cells(&self, shift: u32) -> ([i32; 3], [i32; 3]) {
        /// Steps; overlap tests widen by one, and touching counts.
        const WIDEN: i32 = 2;
        let size_log2 = shift + SUBVOXELS.trailing_zeros();
        (self.min.map(|c| (c - WIDEN) >> size_log2), self.max.map(|c| (c + WIDEN) >> size_log2))
    }
}

#[cfg(test)]
mod tests {
    use super::super::overlap::TriangleOverlap;
    use super::*;

    #[test]
    fn a_box_never_leaves_out_a_cell_that_a_triangle_touches() {
        let mut random = oorandom::Rand64::new(8);
        for round in 0..20_000 {
            let shift = random.rand_range(2..15) as u32;
            let side = 1u64 << random.rand_range(9..26);
            let coordinate = |random: &mut oorandom::Rand64| {
                let c = random.rand_range(0..side + 1) as i32;
                // On a border of cells, or just beside one, as often as not.
                if random.rand_range(0..2) == 0 {
                    ((c >> 8 << 8) + random.rand_range(0..5) as i32 - 2).max(0)
                } else {
                    c
                }
            };
            let triangle = [0; 3].map(|_: i32| [0; 3].map(|_: i32| coordinate(&mut random)));
            let (low, high) = TriangleOverlap::new(triangle).cell_range(shift);
            let (box_low, box_high) = SnappedBox::of(&triangle).cells(shift);
            let within = (0..3).all(|k| box_low[k] <= low[k] && box_high[k] >= high[k]);
            assert!(within, "seed 8, round {round}: {triangle:?}, cells of 2^{shift}");
        }
    }
}
