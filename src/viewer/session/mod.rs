//! What the window shows and does, without the window: one scene that is walked through.

mod dragging;
mod measuring;
mod routes;
mod views;

pub use dragging::Dragging;
pub use measuring::Measuring;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use glam::{DAffine3, DQuat, DVec3};

use super::action::{Action, AxisName};
use super::bookmarks::{Bookmark, Bookmarks, find_nodes};
use super::document::{Document, ObjectSet, Section};
use super::load::Opened;
use super::navigate::{Mode, Motion, NavigateError, Navigator};
use super::preferences::Preferences;
use super::route::{Recorder, Route};
use super::search::Search;
use super::tree::Tree;
use crate::camera::{Camera, Plane};

/// Seconds of a glide to another view.
const GLIDE: f64 = 0.35;
/// Messages that are kept.
const MOST_MESSAGES: usize = 50;

/// Why a session cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// Nothing to look at.
    #[error(transparent)]
    Navigate(#[from] NavigateError),
    /// The system has no more threads.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] std::io::Error),
}

/// A route that plays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playing {
    /// Seconds since its start.
    pub seconds: f64,
}

/// One scene that is walked through.
pub struct Session {
    /// The scene and what was done with it.
    pub document: Document,
    /// Rows of the assembly.
    pub tree: Tree,
    /// The camera.
    pub navigator: Navigator,
    /// Saved views.
    pub bookmarks: Bookmarks,
    /// The route that was recorded or opened.
    pub route: Option<Route>,
    /// It is played.
    pub playing: Option<Playing>,
    /// Measuring.
    pub measuring: Measuring,
    /// What is remembered.
    pub preferences: Preferences,
    /// What is searched for.
    pub search_text: String,
    /// The node whose properties are shown.
    pub current: Option<u32>,
    /// The row that should be scrolled to.
    pub scroll_to: Option<usize>,
    /// What was told, oldest first.
    pub messages: Vec<String>,
    /// What is selected has handles that move and turn it.
    pub moves_parts: bool,
    /// A handle under the mouse button.
    pub dragging: Option<Dragging>,
    /// Where a rectangle begins in which is selected, pixels.
    pub rectangle: Option<glam::DVec2>,
    /// What is drawn stays as it is, wherever the camera goes.
    pub is_frozen: bool,
    /// Another file is to be opened.
    pub wanted_file: Option<PathBuf>,
    /// Another amount of memory for geometry was set.
    pub is_memory_changed: bool,
    /// File of the route: read from, or written to.
    pub route_file: String,
    /// The lost-pixel check is asked for.
    pub is_check_wanted: bool,
    /// Views that are to be remembered, as soon as there is a picture of them.
    pub wanted_bookmarks: Vec<Bookmark>,
    /// Size of the picture, pixels.
    pub size: (u32, u32),
    path: PathBuf,
    search: Search,
    /// What the newest answer is about.
    found_text: Option<String>,
    recording: Option<(Recorder, f64)>,
    /// The route is in a file as it is.
    is_route_saved: bool,
    told: Arc<dyn Fn() + Send + Sync>,
}

impl Session {
    /// Begins with what was opened. `told` is called when a search has found something, or a measured point: by other threads.
    ///
    /// # Errors
    ///
    /// See [`SessionError`].
    pub fn new(
        opened: Opened,
        preferences: Preferences,
        told: impl Fn() + Send + Sync + 'static,
    ) -> Result<Self, SessionError> {
        let told: Arc<dyn Fn() + Send + Sync> = Arc::new(told);
        let search_told = Arc::clone(&told);
        let Opened { scene, path, remarks, .. } = opened;
        let meta = scene.scene().meta();
        let (min, max) = (DVec3::from(meta.bounds.min), DVec3::from(meta.bounds.max));
        let mut navigator = Navigator::new(min, max, meta.settings.up.unit(), meta.settings.metres_per_unit)?;
        navigator.set_mode(preferences.navigation);
        let mut messages = remarks;
        if let Err(error) = navigator.set_fov_y_deg(preferences.fov_y_deg) {
            messages.push(error.to_string());
        }
        let bookmarks = Bookmarks::load(&Bookmarks::path_beside(&path)).unwrap_or_else(|error| {
            messages.push(error.to_string());
            Bookmarks::default()
        });
        Ok(Session {
            tree: Tree::new(scene.scene()),
            search: Search::new(Arc::clone(&scene), move || search_told())?,
            document: Document::new(scene),
            navigator,
            bookmarks,
            route: None,
            playing: None,
            measuring: Measuring::default(),
            preferences,
            search_text: String::new(),
            current: None,
            scroll_to: None,
            messages,
            moves_parts: false,
            dragging: None,
            rectangle: None,
            is_frozen: false,
            wanted_file: None,
            is_memory_changed: false,
            route_file: path.with_extension("route.json").display().to_string(),
            is_check_wanted: false,
            wanted_bookmarks: Vec::new(),
            size: (1, 1),
            path,
            found_text: None,
            recording: None,
            is_route_saved: true,
            told,
        })
    }

    /// The scene's file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The camera of the picture.
    pub fn camera(&self) -> Camera {
        self.navigator.camera(self.size)
    }

    /// Is a route recorded?
    pub fn is_recording(&self) -> bool {
        self.recording.is_some()
    }

    /// Is something being worked out that is still to come?
    pub fn is_busy(&self) -> bool {
        self.is_searching() || self.measuring.is_busy()
    }

    /// Is a search under way?
    pub fn is_searching(&self) -> bool {
        !self.search_text.trim().is_empty() && self.found_text.as_deref() != Some(self.search_text.trim())
    }

    /// Keeps what would be lost with it: views without a picture yet, a route that is recorded or nowhere else. What is told about that
    /// nobody will read in the window.
    #[must_use]
    pub fn close(&mut self) -> Vec<String> {
        let before = std::mem::take(&mut self.messages);
        self.save_wanted(None);
        if self.is_recording() {
            self.act_or_tell(&Action::Record { on: false });
        }
        if let Err(told) = self.keep_route() {
            self.tell(told);
        }
        std::mem::replace(&mut self.messages, before)
    }

    /// Tells a user something.
    pub fn tell(&mut self, message: impl Into<String>) {
        self.messages.push(message.into());
        if self.messages.len() > MOST_MESSAGES {
            self.messages.remove(0);
        }
    }

    // --- Time ---

    /// Time passes: glides, motion by keys, a route that plays or is recorded, answers of the search. Is anything moving?
    pub fn advance(&mut self, passed: Duration, motion: &Motion) -> bool {
        let seconds = passed.as_secs_f64();
        self.take_found();
        if self.measuring.take() {
            self.tell("the point could not be worked out: try another");
        }
        let before = self.camera();
        self.navigator.advance(seconds);
        self.step(seconds, motion);
        self.play(seconds);
        self.record(seconds);
        self.camera() != before
            || self.navigator.is_gliding()
            || self.playing.is_some()
            || self.is_recording()
    }

    fn step(&mut self, seconds: f64, motion: &Motion) {
        if self.navigator.mode() == Mode::Orbit {
            return;
        }
        if *motion != Motion::default() {
            self.playing = None;
        }
        if self.playing.is_some() {
            return;
        }
        let (shown, _) = self.document.shown_soon();
        self.navigator.step(seconds, motion, &*shown);
    }

    fn take_found(&mut self) {
        let Some(found) = self.search.take() else { return };
        self.found_text = Some(found.text.clone());
        if found.text == self.search_text.trim() && !found.text.is_empty() {
            self.tree.set_found(self.document.scene().scene(), Some(found.nodes));
            self.scroll_to = Some(0);
        }
    }

    // --- Actions ---

    /// Does what a user asks for.
    ///
    /// # Errors
    ///
    /// A sentence that says why it cannot be done.
    pub fn act(&mut self, action: &Action) -> Result<(), String> {
        let selected: Vec<u32> = self.document.selected().iter().collect();
        match action {
            Action::Search { text } => self.search_for(text),
            Action::Select { path, add } => self.select_path(path, *add)?,
            Action::ClearSelection => self.document.select([]),
            Action::Hide => {
                self.document.set_hidden(some(&selected)?, true);
                self.document.select([]);
            }
            Action::Show => self.document.set_hidden(some(&selected)?, false),
            Action::Isolate => self.document.isolate(some(&selected)?),
            Action::Xray => self.document.set_seen_through(some(&selected)?, true),
            Action::Opaque => self.document.set_seen_through(some(&selected)?, false),
            Action::ShowAll => self.document.show_all(),
            Action::Undo => self.undone("undone", Document::undo)?,
            Action::Redo => self.undone("done again", Document::redo)?,
            Action::ZoomToSelection => self.zoom_to(some(&selected)?)?,
            Action::ZoomAll => self.zoom_to(0..self.document.scene().scene().objects().len() as u32)?,
            Action::LookFrom { side } => self.glide_to(|navigator| {
                navigator.look_from(*side, GLIDE);
                Ok(())
            })?,
            Action::Parallel { on } => self.glide_to(|navigator| {
                navigator.set_parallel(*on);
                Ok(())
            })?,
            Action::Navigate { mode } => {
                self.preferences.navigation = *mode;
                self.navigator.set_mode(*mode);
            }
            Action::Camera { camera } => {
                self.playing = None;
                self.navigator.set_camera(camera).map_err(|e| e.to_string())?;
                if let Some((recorder, _)) = &mut self.recording {
                    recorder.cut();
                }
            }
            Action::AddSection { axis, at, flip } => self.add_section(*axis, *at, *flip),
            Action::ClearSections => self.document.change("Remove sections", |state| state.sections.clear()),
            Action::Move { by } => {
                let objects = self.selection()?;
                self.document.move_by("Move", &objects, DAffine3::from_translation((*by).into()));
            }
            Action::Rotate { axis, degrees } => self.rotate(*axis, *degrees)?,
            Action::MoveTool { on } => self.moves_parts = *on,
            Action::MoveBack => {
                let objects = self.selection()?;
                self.document.move_back(&objects);
            }
            Action::AddBookmark { name } => {
                let view = self.view(name);
                self.wanted_bookmarks.push(view);
            }
            Action::GoToBookmark { name } => self.go_to_bookmark(name)?,
            Action::RenameBookmark { name, to } => self.rename_bookmark(name, to)?,
            Action::RemoveBookmark { name } => self.remove_bookmark(name)?,
            Action::Record { on } => self.set_recording(*on)?,
            Action::Play => {
                let route = self.route.as_ref().filter(|route| !route.keyframes().is_empty());
                route.ok_or("there is no route: record one, or open one")?;
                self.playing = Some(Playing { seconds: 0.0 });
            }
            Action::Stop => self.playing = None,
            Action::AddKeyframe => self.add_keyframe()?,
            Action::GoToKeyframe { index } => self.go_to_keyframe(*index)?,
            Action::SetKeyframe { index } => {
                let camera = self.camera();
                self.edit_route(|route| route.replace(*index, camera))?;
            }
            Action::MoveKeyframe { index, seconds } => {
                self.edit_route(|route| route.move_to(*index, *seconds))?;
            }
            Action::CutKeyframe { index, on } => self.edit_route(|route| route.set_cut(*index, *on))?,
            Action::RemoveKeyframe { index } => self.edit_route(|route| route.remove(*index))?,
            Action::RouteFps { fps } => self.edit_route(|route| route.set_fps(*fps))?,
            Action::ReverseRoute => self.edit_route(|route| route.reverse())?,
            Action::SpeedRoute { factor } => self.edit_route(|route| route.change_speed(*factor))?,
            Action::ExportRoute { file } => self.export_route(file)?,
            Action::OpenRoute { file } => self.open_route(file)?,
            Action::Measure { on } => {
                self.measuring.is_on = *on;
                self.measuring.from = None;
            }
            Action::ClearMeasurements => self.measuring.clear(),
            Action::Shadows { on } => self.preferences.shadows = *on,
            Action::Caps { on } => self.preferences.caps = *on,
            Action::Freeze { on } => self.is_frozen = *on,
            Action::Open { file } => self.wanted_file = Some(file.clone()),
            Action::CheckLost => self.is_check_wanted = true,
        }
        Ok(())
    }

    /// Does it, and tells why it cannot be done.
    pub fn act_or_tell(&mut self, action: &Action) {
        if let Err(told) = self.act(action) {
            self.tell(told);
        }
    }

    fn selection(&self) -> Result<ObjectSet, String> {
        let selected = self.document.selected().clone();
        if selected.count() == 0 { Err("nothing is selected".into()) } else { Ok(selected) }
    }

    fn undone(&mut self, what: &str, step: fn(&mut Document) -> Option<String>) -> Result<(), String> {
        let name = step(&mut self.document).ok_or("there is nothing more")?;
        self.tell(format!("{what}: {name}"));
        Ok(())
    }

    /// Searches for a text; an empty one shows the tree again.
    pub fn search_for(&mut self, text: &str) {
        self.search_text = text.to_owned();
        let text = text.trim();
        if text.is_empty() {
            self.tree.set_found(self.document.scene().scene(), None);
            if let Some(node) = self.current {
                self.reveal(node);
            }
        } else {
            self.search.ask(text);
        }
    }

    fn select_path(&mut self, path: &str, add: bool) -> Result<(), String> {
        let found = find_nodes(self.document.scene().scene(), &[path.to_owned()]);
        let first = *found.nodes.first().ok_or_else(|| format!("there is no node {path}"))?;
        // Several bolts may have the same path: all are meant.
        for (number, &node) in found.nodes.iter().enumerate() {
            self.select_node(node, add || number > 0);
        }
        self.current = Some(first);
        self.reveal(first);
        Ok(())
    }

    /// Selects a node's objects, or adds them to the selection.
    pub fn select_node(&mut self, node: u32, add: bool) {
        let objects = self.document.objects_of(node);
        if add {
            self.document.toggle(objects)
        } else {
            self.document.select(objects)
        }
        self.current = Some(node);
    }

    /// Selects what was picked, or adds it; nothing where nothing was.
    pub fn select_picked(&mut self, drawable: Option<u32>, add: bool) {
        let Some(drawable) = drawable else {
            if !add {
                self.document.select([]);
                self.current = None;
            }
            return;
        };
        let scene = self.document.scene().scene();
        let object = scene.drawable_object(drawable);
        let node = scene.objects()[object as usize].node;
        if add {
            self.document.toggle([object])
        } else {
            self.document.select([object])
        }
        self.current = Some(node);
        self.reveal(node);
    }

    /// Selects the objects of what was seen in a rectangle, or adds them.
    pub fn select_drawables(&mut self, drawables: &[u32], add: bool) {
        if !add {
            self.document.select([]);
            self.current = None;
        }
        let scene = Arc::clone(self.document.scene());
        let objects = drawables.iter().map(|&drawable| scene.scene().drawable_object(drawable));
        self.document.add(objects);
    }

    /// Shows a node's row.
    pub fn reveal(&mut self, node: u32) {
        let scene = Arc::clone(self.document.scene());
        self.scroll_to = self.tree.reveal(scene.scene(), node);
        if self.tree.found().is_none() {
            self.search_text.clear();
        }
    }

    /// Brings objects into view.
    ///
    /// # Errors
    ///
    /// No objects were given.
    pub fn zoom_to(&mut self, objects: impl IntoIterator<Item = u32>) -> Result<(), String> {
        let (min, max) = self.document.bounds(objects).ok_or("there is nothing to zoom to")?;
        let size = self.size;
        self.glide_to(|navigator| {
            navigator.frame_box(min, max, size, GLIDE).map_err(|error| error.to_string())
        })
    }

    /// Another view; a route that plays does not turn the camera back.
    fn glide_to(&mut self, go: impl FnOnce(&mut Navigator) -> Result<(), String>) -> Result<(), String> {
        self.playing = None;
        go(&mut self.navigator)
    }

    /// Corners of the scene's box, as the file has it.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let bounds = self.document.scene().scene().meta().bounds;
        (bounds.min.into(), bounds.max.into())
    }

    fn add_section(&mut self, axis: AxisName, at: Option<f64>, flip: bool) {
        let selected = self.document.selected().iter();
        let all = self.bounds();
        let (min, max) = self.document.bounds(selected).unwrap_or(all);
        let (from, to) = if at.is_some() { all } else { (min, max) };
        let share = at.unwrap_or(0.5);
        let normal = if flip { -axis.unit() } else { axis.unit() };
        let point = from + share * (to - from);
        let name = format!("{} {}", axis.name(), self.document.state().sections.len() + 1);
        let section = Section { name, plane: Plane { normal: -normal, point }, is_on: true };
        self.document.change("Add section", |state| state.sections.push(section));
    }

    fn rotate(&mut self, axis: AxisName, degrees: f64) -> Result<(), String> {
        let objects = self.selection()?;
        let centre = self.document.middle_of_selection().ok_or("nothing is selected")?;
        let turn = DQuat::from_axis_angle(axis.unit(), degrees.to_radians());
        self.document.move_by("Rotate", &objects, dragging::turn_about(centre, turn));
        Ok(())
    }
}

/// The list, if there is anything in it.
fn some(selected: &[u32]) -> Result<impl Iterator<Item = u32> + Clone + '_, String> {
    if selected.is_empty() { Err("nothing is selected".into()) } else { Ok(selected.iter().copied()) }
}
