//! Camera paths of the command line: reading them, and naming their frames.

use std::path::{Path, PathBuf};

use super::Failure;
use crate::lab::keyframes::CameraPath;
use crate::lab::views::View;

/// Where the number of a frame stands in a name.
pub const FRAME: &str = "{frame}";
/// Digits of it, at least.
const FRAME_DIGITS: usize = 4;

/// Reads a path; `size` replaces the size of its cameras.
pub fn read_path(file: &Path, size: Option<(u32, u32)>) -> Result<CameraPath, Failure> {
    let told = |error: &dyn std::fmt::Display| format!("{}: {error}", file.display());
    let text = std::fs::read_to_string(file).map_err(|error| told(&format!("cannot be read: {error}")))?;
    Ok(CameraPath::from_json(&text, size).map_err(|error| told(&error))?)
}

/// All frames of a path.
pub fn read_views(file: &Path, size: Option<(u32, u32)>) -> Result<Vec<View>, Failure> {
    let views = read_path(file, size)?.views();
    Ok(views.map_err(|error| format!("{}: {error}", file.display()))?)
}

/// The name of a frame of `count`.
pub fn frame_name(pattern: &Path, frame: usize, count: usize) -> PathBuf {
    let digits = count.saturating_sub(1).to_string().len().max(FRAME_DIGITS);
    pattern.to_string_lossy().replace(FRAME, &format!("{frame:0digits$}")).into()
}
