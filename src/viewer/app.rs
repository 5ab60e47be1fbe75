//! The window: loading, panels, picture, keys and mouse.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use eframe::egui_wgpu::{RenderState, WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew};
use egui::{CentralPanel, Color32, Key, Panel, PointerButton, ProgressBar, Rect, Sense, Ui, pos2};
use glam::DVec2;

use super::action::Action;
use super::load::{LoadStatus, Loading, Opened};
use super::navigate::{Mode, Motion};
use super::panels;
use super::preferences::{Loaded, Preferences, WindowLook};
use super::script::{Script, ScriptRun};
use super::session::Session;
use super::viewport::{Purpose, Viewport, cube_side};
use crate::gpu::context::{Context, ContextSettings, backends, device_descriptor};
use crate::human::grouped;

/// Points that a wheel turns for a step of zoom.
const POINTS_PER_STEP: f32 = 50.0;
/// A frame that took longer counts as this: after a pause nothing jumps.
const LONGEST_FRAME: Duration = Duration::from_millis(250);

/// What the window is opened with.
#[derive(Clone, Debug)]
pub struct ViewerOptions {
    /// A scene, or a model.
    pub path: PathBuf,
    /// What is done in it, instead of or beside a user.
    pub script: Option<Script>,
    /// Part of the name of the graphics adapter to use.
    pub adapter: Option<String>,
    /// Width and height of the window at first, points.
    pub size: (u32, u32),
    /// Ctrl-C.
    pub interrupt: Arc<Interrupt>,
}

/// What who watches for Ctrl-C and the window tell each other.
#[derive(Debug, Default)]
pub struct Interrupt {
    is_asked: AtomicBool,
    window: OnceLock<egui::Context>,
}

impl Interrupt {
    /// Asks the window to close: what would be lost is kept, what is half-written removed. Must the program end at once? There is no
    /// window yet, or it was asked before.
    pub fn ask(&self) -> bool {
        let is_again = self.is_asked.swap(true, Ordering::Relaxed);
        self.wake();
        is_again || self.window.get().is_none()
    }

    /// Something has come that the window looks for in its next frame.
    fn wake(&self) {
        if let Some(window) = self.window.get() {
            window.request_repaint();
        }
    }
}

/// Why there is no window, or why it has closed.
#[derive(Debug, thiserror::Error)]
pub enum ViewerError {
    /// The window system, or the graphics driver.
    #[error("the window cannot be opened: {0}")]
    Window(#[from] eframe::Error),
    /// Nowhere to open it.
    #[error(
        "there is no display: neither DISPLAY nor WAYLAND_DISPLAY is set. On a machine without a screen, use `xvfb-run`, or \
         `voxsight walk`, which needs none"
    )]
    NoDisplay,
    /// A script has failed.
    #[error("{0}")]
    Script(String),
}

/// Opens the window, and returns when it is closed.
///
/// # Errors
///
/// There is no display, or no adapter that does; a script that fails.
pub fn run(options: ViewerOptions) -> Result<(), ViewerError> {
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let displays = ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"];
    if cfg!(target_os = "linux") && !displays.into_iter().any(is_set) {
        return Err(ViewerError::NoDisplay);
    }
    let outcome = Arc::new(std::sync::Mutex::new(None));
    let told = Arc::clone(&outcome);
    let size = [options.size.0 as f32, options.size.1 as f32];
    let title = title(&options.path);
    let native = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default().with_inner_size(size).with_title(title),
        // There are no gradients to be smoothed, and software drivers take long for it.
        dithering: false,
        wgpu_options: WgpuConfiguration { wgpu_setup: setup(options.adapter.clone()), ..Default::default() },
        ..Default::default()
    };
    // A scene that is there is loaded while the window opens. What has to be made first waits for the window: until then Ctrl-C ends
    // the program at once, and would leave half of it.
    let is_there = options.path.extension().is_some_and(|extension| extension == "vxs");
    let stage = is_there.then(|| begin(&options.path, &options.interrupt));
    let make = move |creation: &eframe::CreationContext<'_>| -> Result<Box<dyn eframe::App>, Box<dyn std::error::Error + Send + Sync>> {
        Ok(Box::new(App::new(creation, options, stage, told)?))
    };
    eframe::run_native("voxsight", native, Box::new(make))?;
    let failed = outcome.lock().unwrap_or_else(std::sync::PoisonError::into_inner).take();
    failed.map_or(Ok(()), |text| Err(ViewerError::Script(text)))
}

/// Of the window.
fn title(path: &Path) -> String {
    format!("Voxsight - {}", path.display())
}

/// A file that was dropped on the window.
fn dropped_file(egui: &egui::Context) -> Option<PathBuf> {
    egui.input(|input| input.raw.dropped_files.first().map(|file| file.path().to_owned()))
}

/// The device that the window and the scene share.
fn setup(adapter: Option<String>) -> WgpuSetup {
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    setup.instance_descriptor.backends = backends();
    setup.device_descriptor = Arc::new(|adapter| {
        // What it lacks is told when the scene is drawn.
        device_descriptor(adapter).unwrap_or_else(|_| wgpu::DeviceDescriptor::default())
    });
    let wanted = adapter.or_else(|| std::env::var("WGPU_ADAPTER_NAME").ok()).filter(|name| !name.is_empty());
    if let Some(wanted) = wanted {
        setup.native_adapter_selector = Some(Arc::new(move |adapters, _| {
            let is_wanted = |adapter: &&wgpu::Adapter| {
                adapter.get_info().name.to_lowercase().contains(&wanted.to_lowercase())
            };
            let names: Vec<String> = adapters.iter().map(|adapter| adapter.get_info().name).collect();
            adapters
                .iter()
                .find(is_wanted)
                .cloned()
                .ok_or_else(|| format!("no GPU is named \"{wanted}\"; there are {names:?}"))
        }));
    }
    WgpuSetup::CreateNew(setup)
}

/// What the window shows.
enum Stage {
    /// Since when.
    Loading(Loading, Instant),
    Failed {
        path: PathBuf,
        told: String,
    },
    Open(Box<Open>),
}

/// An opened scene.
struct Open {
    session: Session,
    viewport: Viewport,
    /// A text field had the keys in the frame before.
    had_focus: bool,
    /// The picture was not at rest then.
    was_moving: bool,
    /// Since when its first picture is waited for, and how long loading took.
    opening: Option<(Instant, Duration)>,
}

struct App {
    stage: Stage,
    preferences: Preferences,
    window: RenderState,
    context: Context,
    script: Option<ScriptRun>,
    outcome: Arc<std::sync::Mutex<Option<String>>>,
    frame_began: Instant,
    notes: Vec<String>,
    keeps_preferences: bool,
    interrupt: Arc<Interrupt>,
    /// What was cancelled and still winds up: waited for when the window closes.
    cancelled: Vec<Loading>,
}

impl App {
    fn new(
        creation: &eframe::CreationContext<'_>,
        options: ViewerOptions,
        stage: Option<Stage>,
        outcome: Arc<std::sync::Mutex<Option<String>>>,
    ) -> Result<Self, Box<dyn std::error::Error + Send + Sync>> {
        let window =
            creation.wgpu_render_state.clone().ok_or("there is no graphics driver for the window")?;
        // Once more, for the error: without what it lacks nothing is drawn.
        device_descriptor(&window.adapter)?;
        let settings = ContextSettings { adapter: options.adapter, ..Default::default() };
        let context =
            Context::of_device(&window.adapter, window.device.clone(), window.queue.clone(), &settings);
        if options.script.is_some() {
            // Until it has: the window may be closed before.
            *outcome.lock().unwrap_or_else(std::sync::PoisonError::into_inner) =
                Some("the window was closed before the script was done".to_owned());
        }
        // What a script sees must not hang on who runs it.
        let loaded = if options.script.is_some() { Loaded::default() } else { Preferences::load() };
        let look = match loaded.preferences.look {
            WindowLook::Dark => egui::Theme::Dark,
            WindowLook::Light => egui::Theme::Light,
        };
        creation.egui_ctx.set_theme(look);
        options.interrupt.window.get_or_init(|| creation.egui_ctx.clone());
        // A drag in the picture takes the keys away from a text field, as a click does.
        creation.egui_ctx.options_mut(|options| {
            options.input_options.surrender_focus_on = egui::SurrenderFocusOn::Presses;
        });
        Ok(App {
            stage: stage.unwrap_or_else(|| begin(&options.path, &options.interrupt)),
            preferences: loaded.preferences,
            window,
            context,
            keeps_preferences: options.script.is_none(),
            interrupt: options.interrupt,
            cancelled: Vec::new(),
            script: options.script.map(ScriptRun::new),
            outcome,
            frame_began: Instant::now(),
            notes: loaded.notes,
        })
    }

    /// Opens what was loaded.
    fn open(&mut self, opened: Opened, since: Instant, egui: &egui::Context) -> Result<Open, String> {
        let loaded = opened.took;
        self.preferences.remember(&opened.path);
        let repaint = egui.clone();
        let mut session = Session::new(opened, self.preferences.clone(), move || repaint.request_repaint())
            .map_err(|error| error.to_string())?;
        self.notes.drain(..).for_each(|note| session.tell(note));
        let viewport = Viewport::new(&self.context, &session).or_else(|error| {
            // More than this adapter can hold was asked for: the scene is seen all the same.
            session.tell(format!("{error}: the usual amount of memory is used"));
            session.preferences.geometry_bytes = Preferences::default().geometry_bytes;
            Viewport::new(&self.context, &session)
        });
        Ok(Open {
            session,
            viewport: viewport.map_err(|error| error.to_string())?,
            had_focus: false,
            was_moving: false,
            opening: Some((since, loaded)),
        })
    }

    fn follow_loading(&mut self, egui: &egui::Context) {
        let Stage::Loading(loading, since) = &self.stage else { return };
        let since = *since;
        // Seldom: a software driver takes its time from loading.
        egui.request_repaint_after(Duration::from_millis(300));
        let Some(outcome) = loading.take() else { return };
        let path = loading.path().to_owned();
        self.stage = match outcome
            .map_err(|error| error.to_string())
            .and_then(|opened| self.open(opened, since, egui))
        {
            Ok(open) => Stage::Open(Box::new(open)),
            Err(told) => Stage::Failed { path, told },
        };
    }
}

/// Loads a file.
fn begin(path: &Path, window: &Arc<Interrupt>) -> Stage {
    let window = Arc::clone(window);
    match Loading::begin(path.to_owned(), move || window.wake()) {
        Ok(loading) => Stage::Loading(loading, Instant::now()),
        Err(error) => Stage::Failed { path: path.to_owned(), told: error.to_string() },
    }
}

impl eframe::App for App {
    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        let egui = ui.ctx().clone();
        let passed = self.frame_began.elapsed().min(LONGEST_FRAME);
        self.frame_began = Instant::now();
        self.follow_loading(&egui);
        if self.interrupt.is_asked.load(Ordering::Relaxed) {
            egui.send_viewport_cmd(egui::ViewportCommand::Close);
        }
        let mut begin_again = dropped_file(&egui);
        match &mut self.stage {
            Stage::Loading(loading, _) => {
                if loading_screen(ui, &loading.status(), loading.path()) {
                    loading.cancel();
                }
            }
            Stage::Failed { path, told } => {
                if let Some(chosen) = failed_screen(ui, path, told, &mut self.preferences) {
                    begin_again = Some(chosen);
                }
            }
            Stage::Open(open) => {
                let outcome = open.ui(ui, passed, &self.window);
                begin_again = begin_again.or(open.session.wanted_file.take());
                if let Err(error) = outcome {
                    let path = open.session.path().to_owned();
                    self.replace(Stage::Failed { path, told: error });
                } else if std::mem::take(&mut open.session.is_memory_changed) {
                    open.resize_memory(&self.context, &self.window);
                }
            }
        }
        if let Some(path) = begin_again {
            egui.send_viewport_cmd(egui::ViewportCommand::Title(title(&path)));
            self.replace(begin(&path, &self.interrupt));
        }
        self.run_script(&egui);
    }

    /// What panels are filled with: they need not fill themselves, which a driver without a GPU takes long for.
    fn clear_color(&self, visuals: &egui::Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
    }

    fn on_exit(&mut self) {
        self.close();
        if self.keeps_preferences
            && let Err(error) = self.preferences.save()
        {
            eprintln!("{error}");
        }
    }
}

impl App {
    /// Shows something else.
    fn replace(&mut self, stage: Stage) {
        self.close();
        if let Stage::Loading(loading, _) = std::mem::replace(&mut self.stage, stage) {
            // Not here: some of what it does cannot be stopped at once.
            loading.cancel();
            self.cancelled.push(loading);
        }
        self.cancelled.retain(|loading| !loading.is_over());
    }

    /// Keeps what would be lost with an opened scene.
    fn close(&mut self) {
        if let Stage::Open(open) = &mut self.stage {
            open.session.close().iter().for_each(|told| eprintln!("{told}"));
            self.preferences = open.session.preferences.clone();
            open.viewport.free(&self.window);
        }
    }

    fn run_script(&mut self, egui: &egui::Context) {
        let Some(script) = &mut self.script else { return };
        let outcome = match &mut self.stage {
            Stage::Loading(..) => return,
            Stage::Failed { told, .. } => Err(told.clone()),
            Stage::Open(open) => script.step(egui, &mut open.session, &mut open.viewport),
        };
        egui.request_repaint();
        match outcome {
            Ok(false) => {}
            Ok(true) => {
                *self.outcome.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = None;
                self.script = None;
                egui.send_viewport_cmd(egui::ViewportCommand::Close);
            }
            Err(told) => {
                *self.outcome.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = Some(told);
                self.script = None;
                egui.send_viewport_cmd(egui::ViewportCommand::Close);
            }
        }
    }
}

/// How far loading is. Is it to be cancelled?
fn loading_screen(ui: &mut Ui, status: &LoadStatus, path: &Path) -> bool {
    let mut is_cancelled = false;
    CentralPanel::no_frame().show(ui, |ui| {
        ui.add_space(0.35 * ui.available_height());
        ui.vertical_centered(|ui| {
            ui.heading(path.display().to_string());
            ui.label(&status.stage);
            let share = if status.total > 0 { status.done as f32 / status.total as f32 } else { 0.0 };
            let done = grouped(status.done);
            let text = if status.total > 0 {
                format!("{done} of {} {}", grouped(status.total), status.unit)
            } else {
                format!("{done} {}", status.unit)
            };
            ui.add(ProgressBar::new(share).desired_width(400.0).animate(status.total == 0).text(text));
            is_cancelled = ui.button("Cancel").clicked();
        });
    });
    is_cancelled
}

/// What went wrong. What is to be opened now?
fn failed_screen(ui: &mut Ui, path: &Path, told: &str, preferences: &mut Preferences) -> Option<PathBuf> {
    let mut chosen = None;
    CentralPanel::no_frame().show(ui, |ui| {
        ui.add_space(0.3 * ui.available_height());
        ui.vertical_centered(|ui| {
            ui.heading("This cannot be shown");
            ui.label(path.display().to_string());
            ui.colored_label(Color32::LIGHT_RED, told);
            ui.label("`voxsight verify` checks a scene, `voxsight build` makes one of a model.");
            if ui.button("Try again").clicked() {
                chosen = Some(path.to_owned());
            }
            ui.add_space(20.0);
            ui.label("Or open another: drop a file on this window, or choose");
            chosen = chosen.take().or(panels::recent(ui, preferences));
        });
    });
    chosen
}

impl Open {
    /// Begins with another amount of memory for geometry; with as much as before where the adapter has no more.
    fn resize_memory(&mut self, context: &Context, window: &RenderState) {
        match Viewport::new(context, &self.session) {
            Ok(viewport) => {
                self.viewport.free(window);
                self.viewport = viewport;
                // What it went on drawing is gone.
                self.session.is_frozen = false;
            }
            Err(error) => {
                self.session.tell(error.to_string());
                self.session.preferences.geometry_bytes = self.viewport.figures.budget;
            }
        }
    }

    /// All of the window. What the GPU could not do is an error.
    fn ui(&mut self, ui: &mut Ui, passed: Duration, window: &RenderState) -> Result<(), String> {
        let Open { session, viewport, had_focus, was_moving, opening } = self;
        let bare = egui::Frame::side_top_panel(ui.style()).fill(Color32::TRANSPARENT);
        Panel::top("tools").frame(bare).show(ui, |ui| panels::toolbar(ui, session));
        Panel::bottom("status").frame(bare).show(ui, |ui| panels::status(ui, session, &viewport.figures));
        // The picture keeps a fifth of the window.
        let most = (0.4 * ui.available_width()).max(120.0);
        let width = session.preferences.left_panel as f32;
        let left =
            Panel::left("tree").frame(bare).resizable(true).default_size(width).size_range(120.0..=most);
        let shown = left.show(ui, |ui| panels::tree(ui, session));
        session.preferences.left_panel = shown.response.rect.width().into();
        let width = session.preferences.right_panel as f32;
        let right = Panel::right("properties")
            .frame(bare)
            .resizable(true)
            .default_size(width)
            .size_range(120.0..=most);
        let shown = right.show(ui, |ui| {
            let document = Arc::clone(session.document.scene());
            let seen = |objects| viewport.seen_of(&document, objects);
            panels::properties(ui, session, &seen);
        });
        session.preferences.right_panel = shown.response.rect.width().into();
        let mut outcome = Ok(false);
        CentralPanel::no_frame().show(ui, |ui| {
            // After a rest no time has passed that anything could have moved in; but who walks may fall.
            let is_walking = session.navigator.mode() == Mode::Walk;
            let passed = if *was_moving || is_walking { passed } else { Duration::ZERO };
            outcome = picture(ui, session, viewport, passed, window, *had_focus);
        });
        *had_focus = ui.memory(|memory| memory.focused().is_some());
        *was_moving = outcome?;
        // What is read and loaded comes later than the window.
        if viewport.figures.drawn > 0
            && let Some((since, loaded)) = opening.take()
        {
            let [first, loaded] = [since.elapsed(), loaded].map(|time| time.as_secs_f64());
            session.tell(format!("first picture after {first:.2} s, {loaded:.2} s of it for loading"));
        }
        Ok(())
    }
}

/// The picture, and what mouse and keys do in it. Is there more to come?
fn picture(
    ui: &mut Ui,
    session: &mut Session,
    viewport: &mut Viewport,
    passed: Duration,
    window: &RenderState,
    had_focus: bool,
) -> Result<bool, String> {
    let area = ui.available_rect_before_wrap();
    let response = ui.allocate_rect(area, Sense::click_and_drag());
    let scale = ui.pixels_per_point();
    let side = |points: f32| ((points * scale) as u32).clamp(1, crate::camera::MAX_SIDE);
    session.size = (side(area.width()), side(area.height()));
    mouse(ui, &response, session, viewport, scale);
    // Escape has taken the keys from a text field before this is asked: it is not meant for the picture then.
    let is_free = !had_focus && ui.memory(|memory| memory.focused().is_none());
    let motion = if is_free { keys(ui, session) } else { Motion::default() };
    let is_moving = session.advance(passed, &motion) || motion != Motion::default();
    viewport.answers(session).map_err(|error| error.to_string())?;
    let has_more = viewport.draw(session, window).map_err(|error| error.to_string())?;
    if let Some(texture) = viewport.texture() {
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        ui.painter().image(texture, area, whole, Color32::WHITE);
    }
    let pointer = response.hover_pos().or(response.interact_pointer_pos());
    viewport.overlay(session, &ui.painter_at(area), area, pointer);
    if let (Some(from), Some(to)) = (session.rectangle, response.interact_pointer_pos()) {
        let from = area.min + egui::vec2(from.x as f32, from.y as f32) / scale;
        let drawn = Rect::from_two_pos(from, to);
        let fill = Color32::from_rgba_unmultiplied(120, 170, 255, 40);
        ui.painter().rect(
            drawn,
            0.0,
            fill,
            egui::Stroke::new(1.0, Color32::LIGHT_BLUE),
            egui::StrokeKind::Inside,
        );
    }
    if is_moving || has_more {
        ui.ctx().request_repaint();
    }
    Ok(is_moving || has_more)
}

fn mouse(ui: &Ui, response: &egui::Response, session: &mut Session, viewport: &mut Viewport, scale: f32) {
    let place = |point: egui::Pos2| {
        let at = (point - response.rect.min) * scale;
        DVec2::new(at.x.into(), at.y.into())
    };
    let pointer = response.interact_pointer_pos().or(response.hover_pos());
    let cursor = pointer.map(place);
    let modifiers = ui.input(|input| input.modifiers);
    if let Some(pointer) = pointer
        && response.clicked()
        && let Some(side) = cube_side(&session.navigator, response.rect, pointer)
    {
        session.act_or_tell(&Action::LookFrom { side });
        return;
    }
    if let Some(cursor) = cursor {
        // A nudge of a handle is no click on what is behind it.
        let rays = session.camera().rays().ok();
        let is_handle = rays.is_some_and(|rays| session.handle_at(&rays, cursor).is_some());
        if !is_handle {
            clicks(response, session, viewport, cursor, modifiers.command);
        }
        if response.drag_started()
            && let Some((ray, Some(distance))) = viewport.point_under(cursor)
        {
            session.navigator.set_pivot(ray.at(distance));
        }
        wheel(ui, response, session, viewport, cursor);
    }
    if drag_handle(ui, response, session, &place) {
        return;
    }
    if drag_rectangle(ui, response, session, viewport, &place) {
        return;
    }
    let delta = response.drag_delta() * scale;
    let delta = DVec2::new(delta.x.into(), delta.y.into()) * session.preferences.mouse_speed;
    if delta == DVec2::ZERO {
        return;
    }
    session.playing = None;
    let size = session.size;
    let pans = response.dragged_by(PointerButton::Middle)
        || response.dragged_by(PointerButton::Secondary)
        || modifiers.shift;
    match session.navigator.mode() {
        Mode::Orbit if pans => session.navigator.pan(delta, size),
        Mode::Orbit => session.navigator.orbit(delta, size),
        Mode::Fly | Mode::Walk => session.navigator.look(delta, size),
    }
}

fn clicks(
    response: &egui::Response,
    session: &mut Session,
    viewport: &mut Viewport,
    at: DVec2,
    command: bool,
) {
    let purpose = if session.measuring.is_on {
        Purpose::Measure
    } else if response.double_clicked() {
        Purpose::Zoom
    } else {
        Purpose::Select { add: command }
    };
    // A double click is a click, too.
    if response.clicked()
        && let Err(told) = viewport.pick(at, purpose)
    {
        session.tell(told);
    }
}

fn wheel(ui: &Ui, response: &egui::Response, session: &mut Session, viewport: &Viewport, cursor: DVec2) {
    let wheel = ui.input(|input| input.smooth_scroll_delta().y);
    if response.hovered()
        && wheel != 0.0
        && let Some((ray, distance)) = viewport.point_under(cursor)
    {
        let steps = f64::from(wheel / POINTS_PER_STEP) * session.preferences.mouse_speed;
        session.playing = None;
        session.navigator.zoom(steps, &ray, distance);
    }
}

/// Draws a rectangle with the command key, and selects in it. Is one being drawn?
fn drag_rectangle(
    ui: &Ui,
    response: &egui::Response,
    session: &mut Session,
    viewport: &mut Viewport,
    place: &dyn Fn(egui::Pos2) -> DVec2,
) -> bool {
    let (origin, modifiers) = ui.input(|input| (input.pointer.press_origin(), input.modifiers));
    if response.drag_started_by(PointerButton::Primary) && modifiers.command {
        session.rectangle = origin.map(place);
    }
    let Some(from) = session.rectangle else { return false };
    if response.dragged_by(PointerButton::Primary) {
        return true;
    }
    session.rectangle = None;
    if let Some(to) = response.interact_pointer_pos().map(place) {
        let purpose = Purpose::Rectangle { to, add: modifiers.shift };
        if let Err(told) = viewport.pick(from, purpose) {
            session.tell(told);
        }
    }
    true
}

/// Takes, drags or lets go a handle. Is one in hand?
fn drag_handle(
    ui: &Ui,
    response: &egui::Response,
    session: &mut Session,
    place: &dyn Fn(egui::Pos2) -> DVec2,
) -> bool {
    let Ok(rays) = session.camera().rays() else { return false };
    // Where the button went down: a drag begins some points later.
    let origin = ui.input(|input| input.pointer.press_origin());
    if response.drag_started_by(PointerButton::Primary)
        && let Some(origin) = origin
    {
        session.begin_drag(&rays, place(origin));
    }
    if session.dragging.is_none() {
        return false;
    }
    if let Some(at) = response.interact_pointer_pos() {
        session.drag_to(&rays, place(at));
    }
    if !response.dragged_by(PointerButton::Primary) {
        session.end_drag();
    }
    true
}

/// Keys: shortcuts, and motion.
fn keys(ui: &Ui, session: &mut Session) -> Motion {
    let pressed = |key| ui.input(|input| input.key_pressed(key) && !input.modifiers.command);
    let command = |key, shift| {
        ui.input(|input| input.key_pressed(key) && input.modifiers.command && input.modifiers.shift == shift)
    };
    let is_orbit = session.navigator.mode() == Mode::Orbit;
    let mut escape = pressed(Key::Escape);
    if escape && (session.dragging.is_some() || session.rectangle.is_some()) {
        session.cancel_drag();
        escape = false;
    }
    for (is_asked, action) in [
        (pressed(Key::F), Action::ZoomToSelection),
        (pressed(Key::Home), Action::ZoomAll),
        (pressed(Key::H), Action::Hide),
        (pressed(Key::I), Action::Isolate),
        (pressed(Key::X), Action::Xray),
        (pressed(Key::M), Action::Measure { on: !session.measuring.is_on }),
        (pressed(Key::G), Action::MoveTool { on: !session.moves_parts }),
        (escape && session.playing.is_some(), Action::Stop),
        (escape && session.playing.is_none(), Action::ClearSelection),
        (command(Key::Z, false), Action::Undo),
        (command(Key::Y, false) || command(Key::Z, true), Action::Redo),
    ] {
        if is_asked {
            session.act_or_tell(&action);
        }
    }
    if is_orbit {
        return Motion::default();
    }
    let down = |key| f64::from(u8::from(ui.input(|input| input.key_down(key))));
    Motion {
        forward: down(Key::W) + down(Key::ArrowUp) - down(Key::S) - down(Key::ArrowDown),
        right: down(Key::D) + down(Key::ArrowRight) - down(Key::A) - down(Key::ArrowLeft),
        up: down(Key::E) - down(Key::Q),
        hurry: if ui.input(|input| input.modifiers.shift) { 4.0 } else { 1.0 },
    }
}
