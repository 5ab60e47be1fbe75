//! Scenes made to break culling: every method of the library is asked about each of them, and keeps what it promises.
//!
//! What [`trial::Trial::look`] checks for every scene and camera:
//!
//! - `exact` is what brute force over all triangles finds, ties apart;
//! - `hybrid` is `exact`, bit for bit;
//! - `voxel` is the first voxel with an opaque owner, found by the plain walk: its owners are visible, whatever their
//!   triangles do in it. It does not promise to find all that `exact` finds, which stands behind that voxel; the scenes say
//!   which drawables it must find;
//! - `hzm` and `hzb` hide nothing that a ray through a pixel's centre meets first. What is seen only between the
//!   centres they may lose: that is counted and printed;
//! - `frustum` hides nothing that any ray meets;
//! - `coherent` and `coherent-voxel` find in a first frame what `hybrid` and `voxel` find with the same rays, in a second
//!   frame what both frames' rays find; `coherent` keeps nothing that is out of view;
//! - `adaptive` makes nothing up, and loses only what is smaller than a tile of rays;
//! - nobody shows what is hidden by the user.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a failed test panics")]

#[path = "../common/mod.rs"]
mod common;

mod crowds;
mod frames;
mod inside;
mod left_out;
mod openings;
mod placement;
mod shapes;
mod thin;
mod ties;
mod trial;
mod windows;
