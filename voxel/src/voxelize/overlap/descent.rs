//! From a triangle to its bricks: the smallest window of 4x4x4 cells that holds it, and down from there, 64 cells at a
//! time.

use fearless_simd::{Simd, i32x4};

use super::TriangleOverlap;
use super::bits::{box_mask, split_window, spread_xy, spread_xz, spread_yz};
use super::plane::{Plane, PlaneBounds};
use super::projection::{EdgeBounds, KEPT_AXES, Projection, SMALL, fits_32_bits};
use crate::grid::SUBVOXELS;
use crate::voxelize::SnappedTriangle;

/// Voxels from `first` to `last`, both included.
#[derive(Clone, Copy)]
pub(super) struct Region {
    pub first: [i32; 3],
    pub last: [i32; 3],
}

impl Region {
    /// A cell of `2^shift` voxels within a grid of `side` voxels, in whole bricks.
    #[inline(always)]
    pub fn cell(cell: [i32; 3], shift: u32, side: i32) -> Self {
        Region { first: cell, last: cell.map(|c| ((c + (1 << shift)).min(side) - 1) | 3) }
    }

    #[inline(always)]
    pub fn intersect(self, other: Region) -> Option<Region> {
        let first = [0, 1, 2].map(|k| self.first[k].max(other.first[k]));
        let last = [0, 1, 2].map(|k| self.last[k].min(other.last[k]));
        (0..3).all(|k| first[k] <= last[k]).then_some(Region { first, last })
    }

    /// log2 of the side of the smallest cells, of 4^n voxels, of which at most four an axis hold the region.
    #[inline(always)]
    fn level(&self) -> u32 {
        let mut level = 0;
        while (0..3).any(|k| (self.last[k] >> level) - (self.first[k] >> level) > 3) {
            level += 2;
        }
        level
    }
}

/// [`for_each_brick`] for many triangles.
#[inline(always)]
pub(super) fn for_each_brick_of<S: Simd>(
    simd: S,
    triangles: impl IntoIterator<Item = SnappedTriangle>,
    clip: Region,
    visit: &mut impl FnMut([i32; 3], u64),
) {
    for triangle in triangles {
        for_each_brick(simd, &TriangleOverlap::new(triangle), clip, visit);
    }
}

/// Visits the bricks that the triangle touches within `clip`, whose borders are borders of bricks.
#[inline(always)]
pub(super) fn for_each_brick<S: Simd>(
    simd: S,
    triangle: &TriangleOverlap,
    clip: Region,
    visit: &mut impl FnMut([i32; 3], u64),
) {
    let (first, last) = triangle.cell_range(0);
    let touched = Region { first, last };
    let Some(region) = touched.intersect(clip) else { return };
    let single = [0, 1, 2].map(|k| touched.first[k] == touched.last[k]);
    let level = region.level();
    if level == 0 {
        let last = [0, 1, 2].map(|k| region.last[k] - region.first[k]);
        let mut mask = box_mask([0; 3], last);
        // Within one voxel on two axes, a triangle touches all that its box touches.
        if single.iter().filter(|&&s| s).count() < 2 {
            let axes = Axes::new(simd, triangle, single, region.first, level);
            mask &= axes.touched(&axes.root(simd), &axes.touching(simd, 0));
        }
        if mask != 0 {
            split_window(region.first, last, mask, visit);
        }
    } else if fits_32_bits(triangle.extent(), 4 << level) {
        let corner = region.first.map(|c| c >> level << level);
        let axes = Axes::new(simd, triangle, single, corner, level);
        axes.for_each_brick(simd, &Window { corner, level, region }, visit);
    } else {
        wide(triangle, region, level, visit);
    }
}

/// Halves twice a region in which values of the triangle's edges need more than 32 bits.
#[inline(never)]
fn wide(
    triangle: &TriangleOverlap,
    region: Region,
    level: u32,
    visit: &mut impl FnMut([i32; 3], u64),
) {
    let cells = |corner: [i32; 3]| corner.map(|c| c >> level);
    crate::voxelize::for_each_cell(cells(region.first), cells(region.last), |at| {
        let first = at.map(|c| c << level);
        if triangle.touches_cell(first, level) {
            let last = first.map(|c| c + (1 << level) - 1);
            if let Some(cell) = region.intersect(Region { first, last }) {
                let clip = Region { first: cell.first.map(|c| c & !3), last: cell.last.map(|c| c | 3) };
                triangle.for_each_brick_in(clip, visit);
            }
        }
    });
}

/// 4x4x4 cells of `2^level` voxels at the voxel `corner`, and the voxels of them that the triangle's box touches.
struct Window {
    corner: [i32; 3],
    level: u32,
    region: Region,
}

/// The axes that can separate a triangle from a cell in a window of 4x4x4 cells, beside those of the box.
struct Axes<S: Simd> {
    projections: [Option<Projection<S>>; 3],
    plane: Option<Plane<S>>,
}

/// Bounds of all axes for cells of one size.
struct Bounds<S: Simd> {
    edges: [Option<EdgeBounds<S>>; 3],
    plane: PlaneBounds,
}

/// 4x4x4 cells: values of the first one.
#[derive(Clone, Copy)]
struct Cells<S: Simd> {
    edges: [i32x4<S>; 3],
    plane: i64,
}

/// A level of the descent: cells of one size.
struct Level<S: Simd> {
    touching: Bounds<S>,
    covering: [Option<EdgeBounds<S>>; 3],
    /// Cells, counted from the window's corner, that the triangle's box touches.
    first: [i32; 3],
    last: [i32; 3],
    /// Cells of which it touches every voxel.
    covered_first: [i32; 3],
    covered_last: [i32; 3],
}

/// 64 cells on the way down.
#[derive(Clone, Copy)]
struct Node<S: Simd> {
    cells: Cells<S>,
    /// The first cell, counted from the window's corner.
    first: [i32; 3],
    /// Cells still to visit.
    left: u64,
    /// Cells of which every voxel passes all tests but the plane's.
    covered: u64,
}

impl<S: Simd> Axes<S> {
    #[inline(always)]
    fn new(simd: S, triangle: &TriangleOverlap, single: [bool; 3], corner: [i32; 3], level: u32) -> Self {
        let v = triangle.vertices.map(|p| [0, 1, 2].map(|k| p[k] - corner[k] * SUBVOXELS));
        let width = 4 << level;
        let small = (0..3).all(|k| {
            let corner = corner[k] * SUBVOXELS;
            triangle.min[k] - corner > -SMALL && triangle.max[k] - corner < SMALL
        });
        let extent = triangle.extent();
        let projections = KEPT_AXES.map(|(a, b)| {
            // Within one voxel along `a`, or flat along it, the triangle's projection is a segment along b as far as
            // voxels can tell: the box tests say the same as the edges'.
            let separates = !single[a] && !single[b] && extent[a] != 0 && extent[b] != 0;
            separates.then(|| Projection::new(simd, &v, (a, b), small, width))
        });
        let plane = if single == [false; 3] { Plane::new(simd, &v, width) } else { None };
        Axes { projections, plane }
    }

    #[inline(always)]
    fn root(&self, simd: S) -> Cells<S> {
        Cells { edges: [Projection::origin(simd); 3], plane: 0 }
    }

    #[inline(always)]
    fn touching(&self, simd: S, level: u32) -> Bounds<S> {
        Bounds {
            edges: [0, 1, 2].map(|k| self.projections[k].as_ref().map(|p| p.touching(simd, level))),
            plane: self.plane.as_ref().map_or(PlaneBounds::default(), |p| p.touching(level)),
        }
    }

    #[inline(always)]
    fn level(&self, simd: S, window: &Window, level: u32) -> Level<S> {
        let from = |c: [i32; 3]| [0, 1, 2].map(|k| c[k] - window.corner[k]);
        let (first, last) = (from(window.region.first), from(window.region.last));
        Level {
            touching: self.touching(simd, level),
            covering: [0, 1, 2].map(|k| self.projections[k].as_ref().map(|p| p.covering(simd, level))),
            first: first.map(|c| c >> level),
            last: last.map(|c| c >> level),
            covered_first: first.map(|c| (c + (1 << level) - 1) >> level),
            covered_last: last.map(|c| ((c + 1) >> level) - 1),
        }
    }

    /// Cells within the bounds on the axes of the edges.
    #[inline(always)]
    fn edges(&self, cells: &Cells<S>, bounds: &[Option<EdgeBounds<S>>; 3]) -> u64 {
        let columns = |k: usize| match (&self.projections[k], &bounds[k]) {
            (Some(projection), Some(bounds)) => projection.columns(cells.edges[k], bounds),
            _ => 0xffff,
        };
        spread_yz(columns(0)) & spread_xz(columns(1)) & spread_xy(columns(2))
    }

    #[inline(always)]
    fn plane(&self, cells: &Cells<S>, bounds: &Bounds<S>) -> u64 {
        self.plane.as_ref().map_or(u64::MAX, |plane| plane.cells(cells.plane, bounds.plane))
    }

    /// Cells that overlap the triangle on all axes but the box's.
    #[inline(always)]
    fn touched(&self, cells: &Cells<S>, bounds: &Bounds<S>) -> u64 {
        self.edges(cells, &bounds.edges) & self.plane(cells, bounds)
    }

    /// The 64 cells within cell `at` of `cells`.
    #[inline(always)]
    fn descend(&self, cells: &Cells<S>, at: [i32; 3]) -> Cells<S> {
        let edges = [0, 1, 2].map(|k| {
            let (a, b) = KEPT_AXES[k];
            match &self.projections[k] {
                Some(projection) => projection.descend(cells.edges[k], at[a] as usize, at[b] as usize),
                None => cells.edges[k],
            }
        });
        let plane = self.plane.as_ref().map_or(0, |plane| plane.descend(cells.plane, at));
        Cells { edges, plane }
    }

    #[inline(always)]
    fn node(&self, cells: Cells<S>, first: [i32; 3], level: &Level<S>, all_covered: bool) -> Node<S> {
        let plane = self.plane(&cells, &level.touching);
        if all_covered {
            return Node { cells, first, left: plane, covered: u64::MAX };
        }
        let from = |c: [i32; 3]| [0, 1, 2].map(|k| c[k] - first[k]);
        let left = plane & self.edges(&cells, &level.touching.edges) & box_mask(from(level.first), from(level.last));
        let covered = if (0..3).all(|k| {
            level.covered_first[k] <= level.covered_last[k]
                && level.covered_first[k] <= first[k] + 3
                && level.covered_last[k] >= first[k]
        }) {
            self.edges(&cells, &level.covering)
                & box_mask(from(level.covered_first), from(level.covered_last))
        } else {
            0
        };
        Node { cells, first, left, covered }
    }

    /// Visits the bricks below the window's root, of cells of `2^level` voxels, at least 4.
    #[inline(always)]
    fn for_each_brick(&self, simd: S, window: &Window, visit: &mut impl FnMut([i32; 3], u64)) {
        let level = self.level(simd, window, window.level);
        let root = self.node(self.root(simd), [0; 3], &level, false);
        let voxels = self.level(simd, window, 0);
        if window.level == 2 {
            self.visit_bricks(window, &root, &voxels, visit);
        } else {
            self.visit_cells(simd, window, window.level, root, &voxels, visit);
        }
    }

    /// Visits the bricks below cells of `2^level` voxels, at least 16.
    #[inline(never)]
    fn visit_cells<V: FnMut([i32; 3], u64)>(
        &self,
        simd: S,
        window: &Window,
        level: u32,
        mut node: Node<S>,
        voxels: &Level<S>,
        visit: &mut V,
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let below = self.level(simd, window, level - 2);
                while let Some((at, covered)) = node.next() {
                    let cells = self.descend(&node.cells, at);
                    let first = [0, 1, 2].map(|k| (node.first[k] + at[k]) << 2);
                    let child = self.node(cells, first, &below, covered);
                    if level == 4 {
                        self.visit_bricks(window, &child, voxels, visit);
                    } else {
                        self.visit_cells(simd, window, level - 2, child, voxels, visit);
                    }
                }
            },
        );
    }

    /// Visits bricks, those without a test but the plane's first.
    #[inline(always)]
    fn visit_bricks(
        &self,
        window: &Window,
        node: &Node<S>,
        voxels: &Level<S>,
        visit: &mut impl FnMut([i32; 3], u64),
    ) {
        let first_of = |at: [i32; 3]| [0, 1, 2].map(|k| (node.first[k] + at[k]) << 2);
        let corner_of = |first: [i32; 3]| [0, 1, 2].map(|k| window.corner[k] + first[k]);
        for at in cells_of(node.left & node.covered) {
            let plane = self.plane.as_ref().map_or(0, |plane| plane.descend(node.cells.plane, at));
            let mask = self.plane.as_ref().map_or(u64::MAX, |p| p.cells(plane, voxels.touching.plane));
            visit(corner_of(first_of(at)), mask);
        }
        for at in cells_of(node.left & !node.covered) {
            let first = first_of(at);
            let from = |c: [i32; 3]| [0, 1, 2].map(|k| c[k] - first[k]);
            let cells = self.descend(&node.cells, at);
            let mask = self.touched(&cells, &voxels.touching) & box_mask(from(voxels.first), from(voxels.last));
            visit(corner_of(first), mask);
        }
    }
}

impl<S: Simd> Node<S> {
    /// The next cell, 0 to 3 an axis, and whether it is covered.
    #[inline(always)]
    fn next(&mut self) -> Option<([i32; 3], bool)> {
        let at = first_cell(self.left)?;
        let covered = self.covered & self.left & self.left.wrapping_neg() != 0;
        self.left &= self.left - 1;
        Some((at, covered))
    }
}

/// Cells of a mask, 0 to 3 an axis.
#[inline(always)]
fn cells_of(mut mask: u64) -> impl Iterator<Item = [i32; 3]> {
    std::iter::from_fn(
        #[inline(always)]
        move || {
            let at = first_cell(mask)?;
            mask &= mask - 1;
            Some(at)
        },
    )
}

#[inline(always)]
fn first_cell(mask: u64) -> Option<[i32; 3]> {
    let bit = mask.trailing_zeros() as i32;
    (mask != 0).then_some([bit & 3, bit >> 2 & 3, bit >> 4])
}
