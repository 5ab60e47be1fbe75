//! `voxsight verify`: checks a scene to the last byte.

use std::path::PathBuf;

use clap::Args;

use super::Failure;
use super::output::{human_bytes, print_json, print_out};
use super::progress::TerminalProgress;
use crate::human::grouped;

/// Flags of `verify`.
#[derive(Args)]
pub struct Verify {
    /// The scene
    scene: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

impl Verify {
    pub fn run(self, progress: &TerminalProgress) -> Result<(), Failure> {
        let report = crate::container::verify(&self.scene, progress)?;
        progress.finish();
        if self.json {
            return print_json(&report);
        }
        print_out!(
            "{} is sound: {}, {} pages, {} triangles in all levels",
            self.scene.display(),
            human_bytes(report.file_bytes),
            grouped(report.pages),
            grouped(report.triangles)
        )?;
        Ok(())
    }
}
