//! Progress on the terminal: a bar where there is one, a line for each stage elsewhere; Ctrl-C stops cleanly.

use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use indicatif::{ProgressBar, ProgressStyle};

use super::Failure;
use crate::progress::Progress;

/// Progress bars on stderr.
pub struct TerminalProgress {
    quiet: bool,
    is_terminal: bool,
    cancelled: Arc<AtomicBool>,
    current: Mutex<Option<Stage>>,
}

struct Stage {
    name: String,
    bar: ProgressBar,
    started: Instant,
}

impl TerminalProgress {
    /// Also takes over Ctrl-C: the first asks the work to stop, the second ends the program at once.
    pub fn new(quiet: bool) -> Result<Self, Failure> {
        let cancelled = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&cancelled);
        ctrlc::set_handler(move || {
            if flag.swap(true, Ordering::Relaxed) {
                std::process::exit(1);
            }
            tell(format_args!("stopping; once more to stop at once"));
        })
        .map_err(|error| format!("cannot watch for Ctrl-C: {error}"))?;
        let is_terminal = std::io::stderr().is_terminal();
        Ok(TerminalProgress { quiet, is_terminal, cancelled, current: Mutex::new(None) })
    }

    /// Ends the stage on display.
    pub fn finish(&self) {
        if let Some(stage) = self.lock().take() {
            stage.bar.finish_and_clear();
            if !self.quiet {
                tell(format_args!("{} ({:.2} s)", stage.name, stage.started.elapsed().as_secs_f64()));
            }
        }
    }

    /// Something that the user should know, whatever the answer.
    pub fn remark(&self, text: &str) {
        if !self.quiet {
            tell(format_args!("{text}"));
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Option<Stage>> {
        self.current.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A line on stderr. Nobody reading any more is no reason to stop the work.
fn tell(line: std::fmt::Arguments) {
    let _unread = writeln!(std::io::stderr(), "{line}");
}

impl Progress for TerminalProgress {
    fn stage(&self, name: &str, total: u64, unit: &str) {
        self.finish();
        let bar = if self.quiet || !self.is_terminal {
            ProgressBar::hidden()
        } else if total == 0 {
            ProgressBar::new_spinner().with_message(name.to_owned())
        } else {
            let template =
                format!("{{msg:24}} [{{bar:30}}] {{human_pos}} of {{human_len}} {unit}, {{eta}} left");
            let bar = ProgressBar::new(total).with_message(name.to_owned());
            match ProgressStyle::with_template(&template) {
                Ok(style) => bar.with_style(style.progress_chars("=> ")),
                // Only the looks differ.
                Err(_) => bar,
            }
        };
        *self.lock() = Some(Stage { name: name.to_owned(), bar, started: Instant::now() });
    }

    fn advance(&self, count: u64) {
        if let Some(stage) = self.lock().as_ref() {
            stage.bar.inc(count);
        }
    }

    fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}
