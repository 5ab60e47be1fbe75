//! `voxsight view`: walks through a scene in a window.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;

use super::Failure;
use super::numbers::parse_size;
use crate::viewer::script::Script;
use crate::viewer::{Interrupt, ViewerOptions, run};

/// Flags of `view`.
#[derive(Args)]
pub struct View {
    /// A scene (.vxs), or a model or a folder of models, of which one is made first and kept beside it
    #[arg(value_name = "SCENE|MODEL")]
    file: PathBuf,
    /// Size of the window at first
    #[arg(long, default_value = "1280x800", value_parser = parse_size, value_name = "WxH")]
    size: (u32, u32),
    /// Do what a JSON list says, take the screenshots that it asks for, and close the window
    #[arg(long, value_name = "STEPS.json")]
    script: Option<PathBuf>,
    /// Part of the name of the graphics adapter to use
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
}

impl View {
    pub fn run(self) -> Result<(), Failure> {
        // Before a window opens that would only close again.
        std::fs::metadata(&self.file)
            .map_err(|error| format!("{}: cannot be read: {error}", self.file.display()))?;
        let script = self.script.as_deref().map(Script::read).transpose()?;
        let interrupt = Arc::new(Interrupt::default());
        let asked = Arc::clone(&interrupt);
        ctrlc::set_handler(move || {
            if asked.ask() {
                std::process::exit(1);
            }
        })
        .map_err(|error| format!("cannot watch for Ctrl-C: {error}"))?;
        let (path, adapter, size) = (self.file, self.adapter, self.size);
        Ok(run(ViewerOptions { path, script, adapter, size, interrupt })?)
    }
}
