//! Sessions without hands: a list of steps, done in a real window.
//!
//! A script is a JSON list. Besides every [`Action`], steps are
//! `{"do":"wait"}` (until the picture is settled, routes and glides are over, a search has answered; or `"seconds"`), `{"do":"click","x":0.5,"y":0.5}` (shares of the picture),
//! `{"do":"screenshot","file":"a.png"}` (the whole window), and `{"do":"expect", ...}`.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

use glam::DVec2;
use serde::Deserialize;

use super::action::Action;
use super::session::Session;
use super::viewport::{Purpose, Viewport};

/// A picture that has not settled by then never does.
const LONGEST_WAIT: Duration = Duration::from_secs(120);

/// Why a script cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ScriptError {
    /// It cannot be read.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// As the system says.
        source: std::io::Error,
    },
    /// It is not a list of steps.
    #[error("{}: step {step}: {source}; expected a list such as [{{\"do\":\"search\",\"text\":\"pump\"}},{{\"do\":\"screenshot\",\"file\":\"a.png\"}}]", path.display())]
    Step {
        /// The file.
        path: PathBuf,
        /// From 0.
        step: usize,
        /// What is wrong with it.
        source: serde_json::Error,
    },
}

/// A step that is no [`Action`].
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
enum Own {
    /// Wait until nothing changes any more, or some seconds.
    Wait {
        #[serde(default)]
        seconds: Option<f64>,
    },
    /// Click in the picture.
    Click {
        /// Shares of its width and height.
        x: f64,
        y: f64,
        #[serde(default)]
        add: bool,
    },
    /// Write what the window shows.
    Screenshot { file: PathBuf },
    /// Fail unless this is so.
    Expect {
        #[serde(default)]
        selected: Option<u32>,
        #[serde(default)]
        hidden: Option<u32>,
        #[serde(default)]
        found: Option<usize>,
        /// Name of the current node.
        #[serde(default)]
        current: Option<String>,
        #[serde(default)]
        measurements: Option<usize>,
        #[serde(default)]
        message: Option<String>,
    },
}

#[derive(Clone, Debug, PartialEq)]
enum Step {
    Own(Own),
    Action(Action),
}

/// Steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Script {
    steps: Vec<Step>,
}

impl Script {
    /// Reads a script.
    ///
    /// # Errors
    ///
    /// It cannot be read, or is none.
    pub fn read(path: &Path) -> Result<Self, ScriptError> {
        let file = |source| ScriptError::File { path: path.to_owned(), source };
        let text = std::fs::read_to_string(path).map_err(file)?;
        let wrong = |step| move |source| ScriptError::Step { path: path.to_owned(), step, source };
        let values: Vec<serde_json::Value> = serde_json::from_str(&text).map_err(wrong(0))?;
        let step = |(number, value): (usize, serde_json::Value)| {
            let kind = value.get("do").and_then(serde_json::Value::as_str).unwrap_or_default();
            if ["wait", "click", "screenshot", "expect"].contains(&kind) {
                serde_json::from_value(value).map(Step::Own).map_err(wrong(number))
            } else {
                serde_json::from_value(value).map(Step::Action).map_err(wrong(number))
            }
        };
        let steps: Result<Vec<Step>, ScriptError> = values.into_iter().enumerate().map(step).collect();
        Ok(Script { steps: steps? })
    }
}

/// A script under way.
pub struct ScriptRun {
    steps: Vec<Step>,
    next: usize,
    /// Since when the step at hand is waited for.
    since: Option<Instant>,
    picture: Option<Receiver<Arc<egui::ColorImage>>>,
}

impl ScriptRun {
    /// At its beginning.
    pub fn new(script: Script) -> Self {
        ScriptRun { steps: script.steps, next: 0, since: None, picture: None }
    }

    /// Does a step, or waits for it: once a frame. Is it all done?
    ///
    /// # Errors
    ///
    /// What could not be done, or is not as expected.
    pub fn step(
        &mut self,
        egui: &egui::Context,
        session: &mut Session,
        viewport: &mut Viewport,
    ) -> Result<bool, String> {
        let Some(step) = self.steps.get(self.next).cloned() else {
            // Views that are being saved come first.
            return Ok(session.wanted_bookmarks.is_empty());
        };
        let since = *self.since.get_or_insert_with(Instant::now);
        let number = self.next;
        let failed = |told: String| format!("script, step {number}: {told}");
        let is_done = match &step {
            Step::Action(action) => session.act(action).map(|()| true).map_err(failed)?,
            Step::Own(Own::Wait { seconds: Some(seconds) }) => since.elapsed().as_secs_f64() >= *seconds,
            Step::Own(Own::Wait { seconds: None }) => {
                if since.elapsed() > LONGEST_WAIT {
                    return Err(failed("the picture does not settle".into()));
                }
                // A frame or two for what was just asked for.
                since.elapsed() > Duration::from_millis(300)
                    && viewport.is_settled()
                    && !session.navigator.is_gliding()
                    && session.playing.is_none()
                    && !session.is_searching()
            }
            Step::Own(Own::Click { x, y, add }) => {
                let (width, height) = session.size;
                let cursor = DVec2::new(x * f64::from(width), y * f64::from(height));
                let measures = session.measuring.is_on;
                let purpose = if measures { Purpose::Measure } else { Purpose::Select { add: *add } };
                viewport.pick(session, cursor, purpose);
                true
            }
            Step::Own(Own::Screenshot { file }) => self.take_picture(egui, file, since).map_err(failed)?,
            Step::Own(expected @ Own::Expect { .. }) => {
                check(session, expected).map_err(failed)?;
                true
            }
        };
        if is_done {
            self.next += 1;
            self.since = None;
        }
        Ok(false)
    }

    /// Asks for the window's picture, or writes it when it is there. Is it written?
    fn take_picture(&mut self, egui: &egui::Context, file: &Path, since: Instant) -> Result<bool, String> {
        let Some(picture) = &self.picture else {
            let (tell, told) = channel();
            egui.request_screenshot(move |image| {
                // The script has ended meanwhile.
                let _ = tell.send(image);
            });
            self.picture = Some(told);
            return Ok(false);
        };
        let image = match picture.try_recv() {
            Ok(image) => image,
            Err(TryRecvError::Empty) if since.elapsed() < LONGEST_WAIT => return Ok(false),
            Err(_) => return Err("the window gives no picture".to_owned()),
        };
        self.picture = None;
        let bytes: Vec<u8> =
            image.pixels.iter().flat_map(|pixel| [pixel.r(), pixel.g(), pixel.b()]).collect();
        let [width, height] = image.size.map(|side| side as u32);
        let picture =
            image::RgbImage::from_raw(width, height, bytes).ok_or("the window's picture is too short")?;
        let mut png = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut png, image::ImageFormat::Png).map_err(|error| error.to_string())?;
        crate::atomic_file::write_whole(file, png.get_ref())
            .map_err(|e| format!("{}: {e}", file.display()))?;
        Ok(true)
    }
}

/// Is the session as expected?
fn check(session: &Session, expected: &Own) -> Result<(), String> {
    let Own::Expect { selected, hidden, found, current, measurements, message } = expected else {
        return Ok(());
    };
    let scene = session.document.scene().scene();
    let name = |node: u32| scene.name(scene.nodes()[node as usize].name).to_owned();
    let same = |what: &str, wanted: Option<String>, is: String| match wanted {
        Some(wanted) if wanted != is => Err(format!("{what}: {is} instead of {wanted}")),
        _ => Ok(()),
    };
    let text = |number: &Option<u32>| number.map(|number| number.to_string());
    same("selected", text(selected), session.document.selected().count().to_string())?;
    same("hidden", text(hidden), session.document.state().hidden.count().to_string())?;
    same("found", found.map(|n| n.to_string()), session.tree.found().map_or(0, <[u32]>::len).to_string())?;
    same("current", current.clone(), session.current.map(name).unwrap_or_default())?;
    same("measurements", measurements.map(|n| n.to_string()), session.measuring.done.len().to_string())?;
    let told = session.messages.join("\n");
    match message {
        Some(part) if !told.contains(part.as_str()) => {
            Err(format!("no message has \"{part}\"; there are: {told}"))
        }
        _ => Ok(()),
    }
}
