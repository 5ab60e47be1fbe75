//! The axes that can separate a triangle from cells within a window, beside those of the box.

use fearless_simd::{Simd, SimdBase, i32x4};

use super::plane::{Plane, PlaneBounds};
use super::projection::{EdgeBounds, KEPT_AXES, Projection};
use crate::bits::{spread_xy, spread_xz, spread_yz};

/// Tests of 4x4x4 cells at a time. *Values* are those of the first of 64 cells on each axis, at a level of the descent:
/// 0 at the window's low corner.
pub(super) trait Axes<S: Simd> {
    /// Values of the first of 64 cells.
    type Values: Copy;
    /// Bounds of the values of touched cells of one size.
    type Bounds: Copy;
    /// Bounds of the values of covered cells of one size, on all axes but the plane's.
    type Covering: Copy;

    /// Values at the window's low corner.
    fn origin(simd: S) -> Self::Values;
    /// For cells of `2^level` voxels that overlap the triangle on these axes.
    fn touching(&self, simd: S, level: u32) -> Self::Bounds;
    /// For cells of `2^level` voxels of which every voxel overlaps the triangle on these axes but the plane's.
    fn covering(&self, simd: S, level: u32) -> Self::Covering;
    /// Values of the first cell within the first of the cells with `values`.
    fn within(values: Self::Values) -> Self::Values;
    /// Adds the bounds' offsets: cheaper once for many cells.
    fn offset(values: Self::Values, bounds: &Self::Bounds) -> Self::Values;
    /// From the first cell within the first cell to that within cell `at`, 0 to 3 an axis.
    fn step(&self, within: Self::Values, at: [i32; 3]) -> Self::Values;
    /// Cells that overlap the triangle on these axes; the bounds' offsets have been added.
    fn touched(&self, offset_values: Self::Values, bounds: &Self::Bounds) -> u64;
    /// Cells that overlap the triangle's plane; the bounds' offsets have been added.
    fn on_plane(&self, offset_values: Self::Values, bounds: &Self::Bounds) -> u64;
    /// [`Self::step`] for [`Self::on_plane`] alone.
    fn step_on_plane(&self, within: Self::Values, at: [i32; 3]) -> Self::Values;
    /// Cells within the bounds of [`Self::covering`].
    fn covered(&self, values: Self::Values, bounds: &Self::Covering) -> u64;
}

/// All nine edge axes and the plane.
pub(super) struct Solid<S: Simd> {
    projections: [Projection<S>; 3],
    plane: Plane<S>,
}

impl<S: Simd> Solid<S> {
    /// Of the triangle with corners `v`, in steps from the low corner of a window of `width` voxels; `small` as in
    /// [`Projection::new`].
    #[inline(always)]
    pub fn new(simd: S, v: &[[i32; 3]; 3], small: bool, width: i32) -> Self {
        Solid {
            projections: [
                Projection::new(simd, v, KEPT_AXES[0], small, width),
                Projection::new(simd, v, KEPT_AXES[1], small, width),
                Projection::new(simd, v, KEPT_AXES[2], small, width),
            ],
            plane: Plane::new(simd, v, width),
        }
    }
}

#[derive(Clone, Copy)]
pub(super) struct SolidValues<S: Simd> {
    edges: [i32x4<S>; 3],
    plane: i64,
}

impl<S: Simd> Axes<S> for Solid<S> {
    type Values = SolidValues<S>;
    type Bounds = ([EdgeBounds<S>; 3], PlaneBounds);
    type Covering = [EdgeBounds<S>; 3];

    #[inline(always)]
    fn origin(simd: S) -> Self::Values {
        SolidValues { edges: [i32x4::splat(simd, 0); 3], plane: 0 }
    }
    #[inline(always)]
    fn touching(&self, simd: S, level: u32) -> Self::Bounds {
        let [yz, xz, xy] = &self.projections;
        let edges = [yz.touching(simd, level), xz.touching(simd, level), xy.touching(simd, level)];
        (edges, self.plane.touching(level))
    }
    #[inline(always)]
    fn covering(&self, simd: S, level: u32) -> Self::Covering {
        let [yz, xz, xy] = &self.projections;
        [yz.covering(simd, level), xz.covering(simd, level), xy.covering(simd, level)]
    }
    #[inline(always)]
    fn within(values: Self::Values) -> Self::Values {
        let [yz, xz, xy] = values.edges;
        SolidValues { edges: [yz << 2, xz << 2, xy << 2], plane: values.plane << 2 }
    }
    #[inline(always)]
    fn offset(values: Self::Values, (edges, plane): &Self::Bounds) -> Self::Values {
        let [yz, xz, xy] = values.edges;
        SolidValues {
            edges: [yz + edges[0].offset, xz + edges[1].offset, xy + edges[2].offset],
            plane: values.plane + plane.offset,
        }
    }
    #[inline(always)]
    fn step(&self, within: Self::Values, at: [i32; 3]) -> Self::Values {
        let [yz, xz, xy] = within.edges;
        let [x, y, z] = at;
        SolidValues {
            edges: [
                self.projections[0].descend(yz, y, z),
                self.projections[1].descend(xz, x, z),
                self.projections[2].descend(xy, x, y),
            ],
            plane: self.plane.descend(within.plane, at),
        }
    }
    #[inline(always)]
    fn touched(&self, offset_values: Self::Values, (edges, plane): &Self::Bounds) -> u64 {
        let [yz, xz, xy] = offset_values.edges;
        spread_yz(self.projections[0].columns(yz, &edges[0]))
            & spread_xz(self.projections[1].columns(xz, &edges[1]))
            & spread_xy(self.projections[2].columns(xy, &edges[2]))
            & self.plane.cells(offset_values.plane, plane)
    }
    #[inline(always)]
    fn on_plane(&self, offset_values: Self::Values, (_, plane): &Self::Bounds) -> u64 {
        self.plane.cells(offset_values.plane, plane)
    }
    #[inline(always)]
    fn step_on_plane(&self, within: Self::Values, at: [i32; 3]) -> Self::Values {
        SolidValues { plane: self.plane.descend(within.plane, at), ..within }
    }
    #[inline(always)]
    fn covered(&self, values: Self::Values, bounds: &Self::Covering) -> u64 {
        let [yz, xz, xy] = values.edges;
        spread_yz(self.projections[0].columns(yz + bounds[0].offset, &bounds[0]))
            & spread_xz(self.projections[1].columns(xz + bounds[1].offset, &bounds[1]))
            & spread_xy(self.projections[2].columns(xy + bounds[2].offset, &bounds[2]))
    }
}

/// A triangle that is flat along an axis, or within one voxel there: nothing but the three edge axes of its projection
/// along it can separate it from a cell that its box touches.
pub(super) struct Planar<S: Simd> {
    axis: usize,
    projection: Projection<S>,
}

impl<S: Simd> Planar<S> {
    /// Flat along `axis`; the rest as in [`Solid::new`].
    #[inline(always)]
    pub fn new(simd: S, v: &[[i32; 3]; 3], axis: usize, small: bool, width: i32) -> Self {
        Planar { axis, projection: Projection::new(simd, v, KEPT_AXES[axis], small, width) }
    }

    #[inline(always)]
    fn spread(&self, columns: u16) -> u64 {
        match self.axis {
            0 => spread_yz(columns),
            1 => spread_xz(columns),
            _ => spread_xy(columns),
        }
    }
}

impl<S: Simd> Axes<S> for Planar<S> {
    type Values = i32x4<S>;
    type Bounds = EdgeBounds<S>;
    type Covering = EdgeBounds<S>;

    #[inline(always)]
    fn origin(simd: S) -> Self::Values {
        i32x4::splat(simd, 0)
    }
    #[inline(always)]
    fn touching(&self, simd: S, level: u32) -> Self::Bounds {
        self.projection.touching(simd, level)
    }
    #[inline(always)]
    fn covering(&self, simd: S, level: u32) -> Self::Covering {
        self.projection.covering(simd, level)
    }
    #[inline(always)]
    fn within(values: Self::Values) -> Self::Values {
        values << 2
    }
    #[inline(always)]
    fn offset(values: Self::Values, bounds: &Self::Bounds) -> Self::Values {
        values + bounds.offset
    }
    #[inline(always)]
    fn step(&self, within: Self::Values, at: [i32; 3]) -> Self::Values {
        let (a, b) = KEPT_AXES[self.axis];
        self.projection.descend(within, at[a], at[b])
    }
    #[inline(always)]
    fn touched(&self, offset_values: Self::Values, bounds: &Self::Bounds) -> u64 {
        self.spread(self.projection.columns(offset_values, bounds))
    }
    #[inline(always)]
    fn on_plane(&self, _: Self::Values, _: &Self::Bounds) -> u64 {
        u64::MAX
    }
    #[inline(always)]
    fn step_on_plane(&self, within: Self::Values, _: [i32; 3]) -> Self::Values {
        within
    }
    #[inline(always)]
    fn covered(&self, values: Self::Values, bounds: &Self::Covering) -> u64 {
        self.spread(self.projection.columns(values + bounds.offset, bounds))
    }
}
