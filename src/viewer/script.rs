//! Sessions without hands: a list of steps, done in a real window.
//!
//! A script is a JSON list. Besides every [`Action`], steps are
//! `{"do":"wait"}` (until the picture is settled, routes and glides are over, a search has answered; or `"seconds"`),
//! `{"do":"click","x":0.5,"y":0.5}` (shares of the picture), `{"do":"drag","x":0.5,"y":0.5,"to_x":0.6,"to_y":0.5}` (a handle),
//! `{"do":"rectangle", ...}` (likewise; selects), `{"do":"screenshot","file":"a.png"}` (the whole window), and
//! `{"do":"expect", ...}`.
//!
//! A script begins with the usual preferences, and leaves the user's as they are.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

use glam::DVec2;
use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::action::Action;
use super::session::Session;
use super::viewport::{Purpose, Viewport};

/// A picture that has not settled by then never does.
const LONGEST_WAIT: Duration = Duration::from_secs(120);

/// Why a script cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ScriptError {
    /// It cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
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
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
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
    /// Drag a handle of what is selected, or of a section.
    Drag { x: f64, y: f64, to_x: f64, to_y: f64 },
    /// Select all that is seen in a rectangle.
    Rectangle {
        x: f64,
        y: f64,
        to_x: f64,
        to_y: f64,
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
        moved: Option<usize>,
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
        let values: Vec<Value> = serde_json::from_str(&text).map_err(wrong(0))?;
        let step = |(number, value): (usize, Value)| {
            let kind = value.get("do").and_then(Value::as_str).unwrap_or_default().to_owned();
            let step = if OWN.contains(&kind.as_str()) {
                read_step(value).map(Step::Own)
            } else {
                read_step(value).map(Step::Action)
            };
            // Of what it might have been, the error lists the actions alone.
            let unknown = format!("unknown variant `{kind}`");
            let is_unknown = |error: &serde_json::Error| error.to_string().starts_with(&unknown);
            let step = step.map_err(|error| {
                let others = OWN.map(|name| format!("`{name}`")).join(", ");
                if is_unknown(&error) { Error::custom(format!("{error}, {others}")) } else { error }
            });
            step.map_err(wrong(number))
        };
        let steps: Result<Vec<Step>, ScriptError> = values.into_iter().enumerate().map(step).collect();
        Ok(Script { steps: steps? })
    }
}

/// Steps that are [`Own`].
const OWN: [&str; 6] = ["wait", "click", "drag", "rectangle", "screenshot", "expect"];

/// One step; fields that it does not have are an error, also in those that have none.
fn read_step<T: DeserializeOwned + Serialize>(value: Value) -> Result<T, serde_json::Error> {
    let given: Vec<String> =
        value.as_object().into_iter().flat_map(|fields| fields.keys().cloned()).collect();
    let step: T = serde_json::from_value(value)?;
    let known = serde_json::to_value(&step)?;
    match given.iter().find(|name| known.get(name.as_str()).is_none()) {
        Some(unknown) => {
            Err(serde_json::Error::custom(format!("there is no field `{unknown}` in this step")))
        }
        None => Ok(step),
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
                    && !session.is_busy()
            }
            Step::Own(Own::Click { x, y, add }) => {
                let measures = session.measuring.is_on;
                let purpose = if measures { Purpose::Measure } else { Purpose::Select { add: *add } };
                viewport.pick(place(session, *x, *y), purpose).map_err(failed)?;
                true
            }
            Step::Own(Own::Rectangle { x, y, to_x, to_y, add }) => {
                let purpose = Purpose::Rectangle { to: place(session, *to_x, *to_y), add: *add };
                viewport.pick(place(session, *x, *y), purpose).map_err(failed)?;
                true
            }
            Step::Own(Own::Drag { x, y, to_x, to_y }) => {
                let rays = session.camera().rays().map_err(|error| failed(error.to_string()))?;
                let (from, to) = (place(session, *x, *y), place(session, *to_x, *to_y));
                if !session.begin_drag(&rays, from) {
                    return Err(failed(format!("there is no handle at {from}")));
                }
                session.drag_to(&rays, to);
                session.end_drag();
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

/// A place of the picture, pixels.
fn place(session: &Session, x: f64, y: f64) -> DVec2 {
    let (width, height) = session.size;
    DVec2::new(x * f64::from(width), y * f64::from(height))
}

/// Is the session as expected?
fn check(session: &Session, expected: &Own) -> Result<(), String> {
    let Own::Expect { selected, hidden, moved, found, current, measurements, message } = expected else {
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
    let motions = session.document.state().motions.len().to_string();
    same("moved", moved.map(|n| n.to_string()), motions)?;
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
