//! Voxsight: voxel-assisted visibility and level of detail for CAD models too big to render.
//!
//! # The map, in the order data flows
//!
//! [`import`] reads files into a [`model::Model`] (parts, objects, assembly tree); [`sample`] makes one instead.
//! [`prepare`] turns it into levels of detail, quantized chunks and a voxel DAG with owners, and writes a
//! [`container`]. [`export`] writes models for other programs.
//!
//! # Conventions
//!
//! Right-handed; column vectors, names read `a_from_b`; *world* is model space in f64, *part* a part's own space,
//! *grid* is voxel units from the grid's low corner. Level 0 is the finest level of detail. Triangles are
//! counter-clockwise seen from outside. Colours are sRGB, 8 bits. Files are little endian.

pub mod container;
pub mod export;
pub mod geometry;
pub mod import;
pub mod model;
pub mod prepare;
pub mod progress;
pub mod report;
pub mod sample;
