//! The grid: a cube of 2^log2 voxels a side around the model.

use glam::DVec3;

/// Vertices are snapped to this many steps a voxel before voxelization.
pub const SUBVOXELS: i32 = 256;

/// Smallest and largest log2 of the voxels a side.
pub const LOG2_RANGE: std::ops::RangeInclusive<u32> = 6..=17;

/// Voxels kept free on every side, so that snapping and the widened overlap test stay inside.
const MARGIN_VOXELS: f64 = 1.0;

/// Why a grid can't be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GridError {
    /// The bounds hold NaN or infinity, or are inside out.
    #[error("the bounds {min} .. {max} are not a finite box")]
    Bounds {
        /// Low corner as given.
        min: DVec3,
        /// High corner as given.
        max: DVec3,
    },
    /// Voxels a side out of range.
    #[error("a grid of 2^{log2} voxels a side was asked for; supported are 2^6 (64) to 2^17 (131,072)")]
    Resolution {
        /// As asked for.
        log2: u32,
    },
    /// The voxel size is not a positive finite number.
    #[error("the voxel size {size} is not a positive number")]
    VoxelSize {
        /// As asked for.
        size: f64,
    },
    /// Voxels that f64 coordinates cannot tell apart.
    #[error(
        "a voxel of {size:e} units is below what f64 can resolve at coordinates of {magnitude:e}: \
         choose larger voxels or move the model nearer to the origin"
    )]
    TooFine {
        /// Voxel size in world units.
        size: f64,
        /// Largest coordinate.
        magnitude: f64,
    },
}

/// A cube of 2^log2 voxels a side, aligned with the world's axes.
///
/// *Grid space* has its origin at the cube's low corner and the voxel as unit; voxel (i, j, k) is the closed box
/// `[i, i+1] x [j, j+1] x [k, k+1]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Low corner in world space.
    pub origin: DVec3,
    /// Side of a voxel in world units.
    pub voxel_size: f64,
    /// log2 of the voxels a side, 6 to 17.
    pub log2: u32,
}

impl Grid {
    /// The smallest cube of 2^log2 voxels around a box of world space, centred on it, with a free voxel on each side.
    ///
    /// A box without extent (a single point) gets voxels of one millionth of its distance from the origin, or 1.
    pub fn around(min: DVec3, max: DVec3, log2: u32) -> Result<Self, GridError> {
        check_bounds(min, max)?;
        if !LOG2_RANGE.contains(&log2) {
            return Err(GridError::Resolution { log2 });
        }
        let free = f64::from(1u32 << log2) - 2.0 * MARGIN_VOXELS;
        let magnitude = min.abs().max(max.abs()).max_element();
        let mut extent = (max - min).max_element();
        // A point's box is widened by rounding alone.
        if extent <= magnitude * (64.0 * f64::EPSILON) {
            extent = if magnitude > 0.0 { magnitude * 1e-6 * free } else { free };
        }
        Self::centred(min, max, extent / free, log2)
    }

    /// The smallest cube with voxels of `voxel_size` world units around a box, with a free voxel on each side.
    pub fn with_voxel_size(min: DVec3, max: DVec3, voxel_size: f64) -> Result<Self, GridError> {
        check_bounds(min, max)?;
        if !(voxel_size.is_finite() && voxel_size > 0.0) {
            return Err(GridError::VoxelSize { size: voxel_size });
        }
        let needed = (max - min).max_element() / voxel_size + 2.0 * MARGIN_VOXELS;
        let log2 = LOG2_RANGE.clone().find(|&log2| needed <= f64::from(1u32 << log2));
        // Past the largest grid: report how large it would have to be.
        let log2 = log2.ok_or(GridError::Resolution { log2: needed.log2().ceil() as u32 })?;
        Self::centred(min, max, voxel_size, log2)
    }

    fn centred(min: DVec3, max: DVec3, voxel_size: f64, log2: u32) -> Result<Self, GridError> {
        let magnitude = min.abs().max(max.abs()).max_element();
        // The snapping step must stand well above one unit in the last place of the largest coordinate.
        if voxel_size < magnitude * f64::EPSILON * f64::from(SUBVOXELS) * 4.0
            || voxel_size < f64::MIN_POSITIVE
        {
            return Err(GridError::TooFine { size: voxel_size, magnitude });
        }
        let half = 0.5 * voxel_size * f64::from(1u32 << log2);
        Ok(Grid { origin: min + 0.5 * (max - min) - DVec3::splat(half), voxel_size, log2 })
    }

    /// Voxels a side.
    #[inline]
    pub fn side(&self) -> u32 {
        1 << self.log2
    }

    /// World position to grid space.
    #[inline]
    pub fn grid_from_world(&self, world: DVec3) -> DVec3 {
        (world - self.origin) / self.voxel_size
    }

    /// Grid position to world space.
    #[inline]
    pub fn world_from_grid(&self, grid: DVec3) -> DVec3 {
        self.origin + grid * self.voxel_size
    }

    /// Snaps a grid position to 1/256 voxel. Positions outside the grid are moved to its surface: callers make the
    /// grid around everything that they voxelize, so that this only absorbs rounding.
    #[inline]
    pub fn snap(&self, grid: DVec3) -> [i32; 3] {
        let most = (self.side() as i32) * SUBVOXELS;
        // Truncation rounds to nearest here: what is below 0 is clamped anyway.
        let at = |c: f64| ((c * f64::from(SUBVOXELS) + 0.5) as i32).clamp(0, most);
        [at(grid.x), at(grid.y), at(grid.z)]
    }
}

fn check_bounds(min: DVec3, max: DVec3) -> Result<(), GridError> {
    let finite = min.is_finite() && max.is_finite() && (max - min).is_finite();
    if finite && min.cmple(max).all() { Ok(()) } else { Err(GridError::Bounds { min, max }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_lies_inside_its_grid_with_a_free_voxel_on_each_side() {
        let cases = [
            (DVec3::ZERO, DVec3::ONE),
            (DVec3::new(4e5, 4e5, 0.0), DVec3::new(4.01e5, 4.02e5, 12.0)),
            (DVec3::splat(-1e7), DVec3::splat(-1e7 + 0.5)),
            (DVec3::splat(3.0), DVec3::splat(3.0)),
            (DVec3::ZERO, DVec3::ZERO),
            (DVec3::splat(7.0).map(f64::next_down), DVec3::splat(7.0).map(f64::next_up)),
        ];
        for (min, max) in cases {
            for log2 in LOG2_RANGE {
                let grid = Grid::around(min, max, log2).unwrap();
                let low = grid.grid_from_world(min);
                let high = grid.grid_from_world(max);
                let margin = 1.0 - 1e-4;
                assert!(low.min_element() > margin, "{min} {max} {log2}: {low}");
                assert!(high.max_element() < f64::from(grid.side()) - margin, "{min} {max} {log2}: {high}");
            }
        }
    }

    #[test]
    fn a_voxel_size_gives_the_smallest_grid_that_holds_the_box() {
        let grid = Grid::with_voxel_size(DVec3::ZERO, DVec3::new(1000.0, 10.0, 1.0), 1.0).unwrap();
        assert_eq!(grid.log2, 10);
        let too_many = Grid::with_voxel_size(DVec3::ZERO, DVec3::splat(1e6), 1.0);
        assert_eq!(too_many, Err(GridError::Resolution { log2: 20 }));
    }

    #[test]
    fn bounds_that_are_no_box_are_refused() {
        assert!(Grid::around(DVec3::NAN, DVec3::ONE, 10).is_err());
        assert!(Grid::around(DVec3::ONE, DVec3::ZERO, 10).is_err());
        assert!(Grid::around(DVec3::splat(-1e308), DVec3::splat(1e308), 10).is_err());
        assert!(Grid::around(DVec3::splat(1e15), DVec3::splat(1e15 + 100.0), 17).is_err());
    }
}
