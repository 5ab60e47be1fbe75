//! The CPU voxel core of Voxsight: triangles to a sparse voxel DAG that knows every owner of every voxel, and rays
//! through it. No files, no GPU, no logging.
//!
//! # The map, in the order data flows
//!
//! [`grid`] (the cube of voxels, snapping) -> [`voxelize`] (conservative overlap in exact integers, block by block) ->
//! [`dag`] (equal subtrees stored once; brick ordinals; owners) -> [`raycast`] (voxels along a ray, front to back).
//!
//! # Conventions
//!
//! *Grid space*: origin at the grid's low corner, unit = one voxel, axes as in the world. Voxel (i, j, k) is the closed
//! box from (i, j, k) to (i+1, j+1, k+1). A brick is 4x4x4 voxels in a 64-bit mask, bit x + 4 y + 16 z. Heights count
//! from the leaves: a node of height h covers 4^(h+1) voxels a side.
//!
//! # Example
//!
//! ```
//! use glam::DVec3;
//! use voxsight_voxel::{dag::OwnersRef, grid::Grid, raycast::GridRay, voxelize::{self, Drawables, SnappedMesh}};
//!
//! struct OneTriangle(Grid);
//! impl Drawables for OneTriangle {
//!     fn count(&self) -> u32 { 1 }
//!     fn load(&self, _: u32, mesh: &mut SnappedMesh) {
//!         let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
//!         mesh.vertices = corners.map(|p| self.0.snap(self.0.grid_from_world(p))).to_vec();
//!         mesh.triangles = vec![[0, 1, 2]];
//!     }
//! }
//!
//! let grid = Grid::around(DVec3::ZERO, DVec3::ONE, 8)?;
//! let voxels = voxelize::voxelize(&grid, &OneTriangle(grid))?;
//! let ray = GridRay::new(grid.grid_from_world(DVec3::new(0.2, 0.2, 5.0)), DVec3::NEG_Z);
//! let dag = voxels.dag.view();
//! let (voxel, _t) = dag.first_hit(&ray).expect("the ray goes through the triangle");
//! let (ordinal, mask) = dag.brick_at(voxel).expect("the voxel that was hit is in a brick");
//! let index = voxels.owners.index(dag.brick_count());
//! let owners = OwnersRef::new(&voxels.owners.directory, &voxels.owners.pages, &index);
//! assert_eq!(owners.of_brick(ordinal, mask).all().collect::<Vec<_>>(), [0]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bits;
pub mod dag;
pub mod grid;
pub mod raycast;
pub mod voxelize;
