//! What the window shows and does, without the window: one scene that is walked through.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use glam::{DAffine3, DQuat, DVec3};

use super::action::{Action, AxisName, SideName};
use super::bookmarks::{Bookmark, Bookmarks, Thumbnail, find_nodes, node_paths};
use super::document::{Document, ObjectSet, Section};
use super::load::Opened;
use super::measure::{Features, Measurement, Snap, SnapView, snap};
use super::navigate::{Mode, Motion, NavigateError, Navigator, SceneProbe};
use super::pick::Picked;
use super::preferences::Preferences;
use super::route::{Recorder, Route, Tolerance};
use super::search::Search;
use super::tree::Tree;
use crate::camera::{Camera, CameraRays, Plane};
use crate::filter::Filter;
use crate::visibility::QueryScene;

/// Seconds of a glide to another view.
const GLIDE: f64 = 0.35;
/// How near the cursor a vertex or an edge is snapped to, pixels.
const SNAP_PIXELS: f64 = 10.0;
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

/// Measuring from point to point.
#[derive(Clone, Debug, Default)]
pub struct Measuring {
    /// Do clicks measure?
    pub is_on: bool,
    /// The first point of the next one.
    pub from: Option<Snap>,
    /// Done.
    pub done: Vec<Measurement>,
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
    /// What is drawn stays as it is, wherever the camera goes.
    pub is_frozen: bool,
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
    /// What of an object can be snapped to; the newest.
    features: Option<(u32, Features)>,
    /// What stops who walks; of the version of the document.
    probe_filter: (u64, Filter),
}

impl Session {
    /// Begins with what was opened. `told` is called when a search has found something.
    ///
    /// # Errors
    ///
    /// See [`SessionError`].
    pub fn new(
        opened: Opened,
        preferences: Preferences,
        told: impl Fn() + Send + 'static,
    ) -> Result<Self, SessionError> {
        let Opened { scene, path, remarks } = opened;
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
            search: Search::new(Arc::clone(&scene), told)?,
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
            is_frozen: false,
            is_check_wanted: false,
            wanted_bookmarks: Vec::new(),
            size: (1, 1),
            path,
            found_text: None,
            recording: None,
            features: None,
            probe_filter: (u64::MAX, Filter::default()),
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

    /// Is a search under way?
    pub fn is_searching(&self) -> bool {
        !self.search_text.trim().is_empty() && self.found_text.as_deref() != Some(self.search_text.trim())
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
        if self.probe_filter.0 != self.document.version() {
            let (mut filter, moved) = self.document.changes();
            if let Some(moved) = moved {
                moved.hide_in(self.document.scene(), &mut filter);
            }
            self.probe_filter = (self.document.version(), filter);
        }
        let scene = QueryScene { filter: &self.probe_filter.1, ..self.document.scene().query() };
        self.navigator.step(seconds, motion, &SceneProbe::new(&scene));
    }

    fn play(&mut self, seconds: f64) {
        let (Some(playing), Some(route)) = (&mut self.playing, &self.route) else { return };
        playing.seconds += seconds;
        let is_over = playing.seconds >= route.duration();
        let camera = route.camera_at(playing.seconds.min(route.duration()));
        if let Some(camera) = camera
            && let Err(error) = self.navigator.set_camera(&camera)
        {
            self.tell(format!("the route cannot be played: {error}"));
            self.playing = None;
        } else if is_over {
            self.playing = None;
        }
    }

    fn record(&mut self, seconds: f64) {
        let camera = self.camera();
        let Some((recorder, at)) = &mut self.recording else { return };
        *at += seconds.max(1e-6);
        if let Err(error) = recorder.add(*at, camera) {
            self.tell(format!("recording: {error}"));
        }
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
            Action::LookFrom { side } => self.navigator.look_from(side.standard(), GLIDE),
            Action::Parallel { on } => self.navigator.set_parallel(*on),
            Action::Navigate { mode } => {
                self.preferences.navigation = *mode;
                self.navigator.set_mode(*mode);
            }
            Action::Camera { camera } => self.navigator.set_camera(camera).map_err(|e| e.to_string())?,
            Action::AddSection { axis, at, flip } => self.add_section(*axis, *at, *flip),
            Action::ClearSections => self.document.change("Remove sections", |state| state.sections.clear()),
            Action::Move { by } => {
                let objects = self.selection()?;
                self.document.move_by("Move", &objects, DAffine3::from_translation((*by).into()));
            }
            Action::Rotate { axis, degrees } => self.rotate(*axis, *degrees)?,
            Action::MoveBack => {
                let objects = self.selection()?;
                self.document.move_back(&objects);
            }
            Action::AddBookmark { name } => {
                let view = self.view(name);
                self.wanted_bookmarks.push(view);
            }
            Action::GoToBookmark { name } => self.go_to_bookmark(name)?,
            Action::RemoveBookmark { name } => self.remove_bookmark(name)?,
            Action::Record { on } => self.set_recording(*on)?,
            Action::Play => {
                let route = self.route.as_ref().filter(|route| !route.keyframes().is_empty());
                route.ok_or("there is no route: record one, or open one")?;
                self.playing = Some(Playing { seconds: 0.0 });
            }
            Action::Stop => self.playing = None,
            Action::AddKeyframe => self.add_keyframe()?,
            Action::ReverseRoute => self.edit_route(|route| route.reverse())?,
            Action::SpeedRoute { factor } => self.edit_route(|route| route.change_speed(*factor))?,
            Action::ExportRoute { file } => self.export_route(file)?,
            Action::OpenRoute { file } => {
                let text = std::fs::read_to_string(file).map_err(|e| format!("{}: {e}", file.display()))?;
                let route = Route::from_json(&text).map_err(|e| format!("{}: {e}", file.display()))?;
                self.route = Some(route);
            }
            Action::Measure { on } => {
                self.measuring.is_on = *on;
                self.measuring.from = None;
            }
            Action::ClearMeasurements => {
                self.measuring = Measuring { is_on: self.measuring.is_on, ..Measuring::default() }
            }
            Action::Shadows { on } => self.preferences.shadows = *on,
            Action::Freeze { on } => self.is_frozen = *on,
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
        let node = *found.nodes.first().ok_or_else(|| format!("there is no node {path}"))?;
        self.select_node(node, add);
        self.reveal(node);
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
    /// There are none.
    pub fn zoom_to(&mut self, objects: impl IntoIterator<Item = u32>) -> Result<(), String> {
        let (min, max) = self.document.bounds(objects).ok_or("there is nothing to zoom to")?;
        self.navigator.frame_box(min, max, self.size, GLIDE).map_err(|error| error.to_string())
    }

    fn add_section(&mut self, axis: AxisName, at: Option<f64>, flip: bool) {
        let selected = self.document.selected().iter();
        let meta = self.document.scene().scene().meta().bounds;
        let all = (DVec3::from(meta.min), DVec3::from(meta.max));
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
        // The mean of the parts' own middles turns with them: back and forth ends where it began.
        let middles = objects.iter().filter_map(|object| self.document.bounds([object]));
        let sum: DVec3 = middles.map(|(min, max)| 0.5 * (min + max)).sum();
        let centre = sum / f64::from(objects.count());
        let turn = DAffine3::from_quat(DQuat::from_axis_angle(axis.unit(), degrees.to_radians()));
        let about = DAffine3::from_translation(centre) * turn * DAffine3::from_translation(-centre);
        self.document.move_by("Rotate", &objects, about);
        Ok(())
    }

    // --- Saved views ---

    /// What is seen now, to be remembered by a name.
    fn view(&self, name: &str) -> Bookmark {
        let scene = self.document.scene().scene();
        let paths = |objects: &ObjectSet| -> Vec<String> {
            let mut nodes: Vec<u32> =
                objects.iter().map(|object| scene.objects()[object as usize].node).collect();
            nodes.dedup();
            node_paths(scene, &nodes)
        };
        let state = self.document.state();
        // The shorter list: of a large plant with one pump isolated, the pump.
        let count = scene.objects().len() as u32;
        let mut shown = ObjectSet::default();
        if 2 * state.hidden.count() > count && state.hidden.count() < count {
            (0..count).filter(|&object| !state.hidden.has(object)).for_each(|object| shown.set(object, true));
        }
        let hidden = if shown.count() > 0 { Vec::new() } else { paths(&state.hidden) };
        Bookmark {
            name: name.to_owned(),
            camera: self.camera(),
            hidden,
            shown: paths(&shown),
            xray: paths(&state.seen_through),
            planes: self.document.planes().map(Into::into).collect(),
            thumbnail: None,
        }
    }

    /// Saves the views that are to be remembered, with what they look like.
    pub fn save_wanted(&mut self, picture: Option<&image::RgbImage>) {
        let thumbnail = picture.and_then(Thumbnail::new);
        let wanted = std::mem::take(&mut self.wanted_bookmarks);
        if wanted.is_empty() {
            return;
        }
        for view in wanted {
            if let Err(error) = self.bookmarks.add(Bookmark { thumbnail: thumbnail.clone(), ..view }) {
                self.tell(error.to_string());
            }
        }
        self.save_bookmarks();
    }

    fn save_bookmarks(&mut self) {
        if let Err(error) = self.bookmarks.save(&Bookmarks::path_beside(&self.path)) {
            self.tell(error.to_string());
        }
    }

    fn bookmark(&self, name: &str) -> Result<usize, String> {
        let at = self.bookmarks.views().iter().position(|view| view.name == name);
        at.ok_or_else(|| format!("there is no saved view \"{name}\""))
    }

    fn go_to_bookmark(&mut self, name: &str) -> Result<(), String> {
        let at = self.bookmark(name)?;
        let Some(view) = self.bookmarks.views().get(at).cloned() else { return Ok(()) };
        let scene = Arc::clone(self.document.scene());
        let (hidden, xray) = (find_nodes(scene.scene(), &view.hidden), find_nodes(scene.scene(), &view.xray));
        let shown = find_nodes(scene.scene(), &view.shown);
        let missing = hidden.missing + shown.missing + xray.missing;
        let own_objects = |nodes: &[u32]| {
            let mut set = ObjectSet::default();
            let objects = scene.scene().objects();
            for &node in nodes {
                let first = objects.partition_point(|object| object.node < node);
                let own = objects[first..].iter().take_while(|object| object.node == node).count();
                (first..first + own).for_each(|object| set.set(object as u32, true));
            }
            set
        };
        let sections = view.planes.iter().enumerate().map(|(number, &plane)| Section {
            name: format!("Plane {}", number + 1),
            plane: plane.into(),
            is_on: true,
        });
        let sections: Vec<Section> = sections.collect();
        self.document.change("Go to a view", |state| {
            state.hidden = own_objects(&hidden.nodes);
            if !view.shown.is_empty() {
                let shown = own_objects(&shown.nodes);
                let all = 0..scene.scene().objects().len() as u32;
                all.filter(|&object| !shown.has(object)).for_each(|object| state.hidden.set(object, true));
            }
            state.seen_through = own_objects(&xray.nodes);
            state.sections = sections;
        });
        if missing > 0 {
            self.tell(format!("{missing} parts of the view \"{name}\" are not in this scene any more"));
        }
        self.navigator.go_to(&view.camera, GLIDE).map_err(|error| error.to_string())
    }

    fn remove_bookmark(&mut self, name: &str) -> Result<(), String> {
        let at = self.bookmark(name)?;
        self.bookmarks.remove(at);
        self.save_bookmarks();
        Ok(())
    }

    // --- Routes ---

    fn set_recording(&mut self, is_on: bool) -> Result<(), String> {
        if is_on {
            self.recording = Some((Recorder::new(Tolerance::default()), 0.0));
            return Ok(());
        }
        let (recorder, _) = self.recording.take().ok_or("nothing is recorded")?;
        let route = recorder.finish().map_err(|error| error.to_string())?;
        self.tell(format!("recorded {:.1} s, {} keyframes", route.duration(), route.keyframes().len()));
        self.route = Some(route);
        Ok(())
    }

    fn add_keyframe(&mut self) -> Result<(), String> {
        let camera = self.camera();
        if self.route.is_none() {
            self.route = Some(Route::new(Vec::new(), 30.0).map_err(|error| error.to_string())?);
        }
        self.edit_route(|route| {
            let at = if route.keyframes().is_empty() { 0.0 } else { route.duration() + 2.0 };
            route.insert(at, camera).map(|_| ())
        })
    }

    fn edit_route(
        &mut self,
        edit: impl FnOnce(&mut Route) -> Result<(), super::route::RouteError>,
    ) -> Result<(), String> {
        let route = self.route.as_mut().ok_or("there is no route: record one, or open one")?;
        edit(route).map_err(|error| error.to_string())
    }

    fn export_route(&mut self, file: &Path) -> Result<(), String> {
        let route = self.route.as_ref().ok_or("there is no route: record one, or open one")?;
        let text = route.to_json(self.size).map_err(|error| error.to_string())?;
        crate::atomic_file::write_whole(file, text.as_bytes())
            .map_err(|e| format!("{}: {e}", file.display()))?;
        self.tell(format!("the route is in {}", file.display()));
        Ok(())
    }

    // --- Measuring ---

    /// A click while measuring: the first point, or the second. `filter` is what is left out.
    pub fn measure_at(&mut self, camera: &CameraRays, filter: &Filter, cursor: glam::DVec2, picked: &Picked) {
        let scene = Arc::clone(self.document.scene());
        let object = scene.scene().drawable_object(picked.drawable);
        if self.features.as_ref().is_none_or(|(of, _)| *of != object) {
            // All of it, or the borders of its chunks would be edges.
            let drawables = scene.scene().object_drawables(object);
            self.features = Some((object, Features::of_drawables(scene.query().exact, drawables)));
        }
        let Some((_, features)) = &self.features else { return };
        let motion = self.document.state().motions.get(&object).copied().unwrap_or(DAffine3::IDENTITY);
        let view =
            SnapView { camera, filter, world_from_part: motion * scene.scene().world_from_part(object) };
        let found = snap(features, &view, cursor, SNAP_PIXELS, picked);
        match self.measuring.from.take() {
            None => self.measuring.from = Some(found),
            Some(from) => self.measuring.done.push(Measurement { from, to: found }),
        }
    }
}

/// The list, if there is anything in it.
fn some(selected: &[u32]) -> Result<impl Iterator<Item = u32> + Clone + '_, String> {
    if selected.is_empty() { Err("nothing is selected".into()) } else { Ok(selected.iter().copied()) }
}

impl SideName {
    /// For the navigator.
    fn standard(self) -> super::navigate::Standard {
        use super::navigate::Standard;
        match self {
            SideName::Front => Standard::Front,
            SideName::Back => Standard::Back,
            SideName::Left => Standard::Left,
            SideName::Right => Standard::Right,
            SideName::Top => Standard::Top,
            SideName::Bottom => Standard::Bottom,
            SideName::Isometric => Standard::Isometric,
        }
    }
}
