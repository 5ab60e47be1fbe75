//! Voxsight: voxel-assisted visibility and level of detail for CAD models too big to render.
//!
//! # The map, in the order data flows
//!
//! - [`import`] reads files into a [`model::Model`]: parts, objects, assembly tree. [`sample`] makes one from a seed,
//!   [`export`] writes one for other programs, [`report`] counts what was repaired.
//! - [`prepare`] turns it into levels of detail ([`geometry`]), quantized chunks and a voxel DAG with owners
//!   ([`voxsight_voxel`]), and writes a [`container`].
//! - [`scene`] is an opened container as the runtime sees it; [`loaded`] makes it ready for CPU queries: its triangles
//!   in hierarchies ([`exact`]) beside its voxels.
//! - [`camera`] makes [`ray`]s, [`filter`] leaves out what is hidden or cut away; [`visibility`] asks what they see, and
//!   how wrong the answer is; [`render`] makes a picture of it, with soft shadows, and files of any size
//!   ([`render::file`]).
//! - [`shown`] is a scene as a user has left it: what is hidden, cut away, looked through, and where [`moved`] parts are now.
//! - [`lod`] chooses how fine what is visible is drawn, under a budget; [`streaming`] keeps a memory of fixed size filled with
//!   it.
//! - `gpu` (a feature) draws what is resident and casts rays through the voxels there; `walkthrough` is the frame loop over all
//!   of these: query, levels, streaming, drawing.
//! - `viewer` (a feature) is the window in which a scene is walked through; its sessions know no window.
//! - [`occlusion`] finds the same with boxes and depth images: the methods that the voxels are compared with. `lab`
//!   (a feature) runs methods over many views and reports run time against error.
//! - [`progress`] is how long work tells where it stands and learns that it should stop; `atomic_file` makes written
//!   files appear whole or not at all.
//!
//! # Conventions
//!
//! Right-handed; column vectors, names read `a_from_b`; *world* is model space in f64, *part* a part's own space,
//! *grid* is voxel units from the grid's low corner. Level 0 is the finest level of detail. Triangles are
//! counter-clockwise seen from outside. Colours are sRGB, 8 bits. Files are little endian.

mod atomic_file;
pub mod camera;
#[cfg(feature = "cli")]
pub mod cli;
pub mod container;
pub mod exact;
pub mod export;
pub mod filter;
pub mod geometry;
#[cfg(feature = "gpu")]
pub mod gpu;
#[cfg(any(feature = "cli", feature = "lab"))]
mod human;
pub mod import;
#[cfg(feature = "lab")]
pub mod lab;
pub mod loaded;
pub mod lod;
pub mod model;
pub mod moved;
pub mod occlusion;
pub mod prepare;
pub mod progress;
pub mod ray;
pub mod render;
pub mod report;
pub mod sample;
pub mod scene;
pub mod shown;
pub mod streaming;
#[cfg(feature = "viewer")]
pub mod viewer;
pub mod visibility;
#[cfg(feature = "gpu")]
pub mod walkthrough;
