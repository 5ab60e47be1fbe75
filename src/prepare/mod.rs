//! The offline pipeline: a [`crate::model::Model`] becomes a container.
//!
//! ```text
//! localise    parts moved to their own origin, equal ones found
//! part        one part: chunk (spatial pieces) -> quantize and weld -> lod (levels, errors measured by deviation)
//! voxels      level 0 of everything, placed, snapped to the grid
//! build       all stages in order, streamed to the file
//! memory      a limit on the process
//! resources   time and memory of each stage
//! ```

pub mod build;
mod chunk;
mod deviation;
pub mod localise;
mod lod;
pub mod memory;
pub mod part;
mod quantize;
pub mod resources;
mod voxels;
mod weld;

pub use build::{BuildError, BuildOutcome, BuildSettings, Resolution, build};
