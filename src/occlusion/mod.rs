//! Box-based occlusion culling: the methods that the voxels are compared with (DESIGN.md section 8), as good as we can make
//! them.
//!
//! A depth image of some drawables ([`raster`]), a pyramid of its farthest depths ([`pyramid`]), and every drawable's box
//! ([`boxes`]) tested against it. The methods differ in whom they draw: [`hzm`] a few drawables that look like good
//! occluders (Peng and Cao 2013), [`hzb`] all that were visible in the last frame (what engines do).
//!
//! # What is promised
//!
//! A drawable is hidden only when at the centre of every pixel that its box reaches into there is an opaque triangle nearer than
//! all of the box. So no drawable is lost that a ray through a pixel's centre meets first; one that is
//! seen only between the centres may be. Depths are rounded away from the eye and boxes towards it, so that faces in one
//! plane hide nothing of each other.

pub mod boxes;
pub mod compactness;
mod frame;
pub mod hzb;
pub mod hzm;
pub mod mesh;
pub mod pyramid;
pub mod raster;
mod scene;
pub mod view;

pub use scene::OcclusionScene;
