//! What a user can ask for: by a button, a key, or a line of a script.

use std::path::PathBuf;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::navigate::{Mode, Side};
use crate::camera::Camera;

/// An axis of the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum AxisName {
    /// The first.
    X,
    /// The second.
    Y,
    /// The third.
    Z,
}

impl AxisName {
    /// All three.
    pub const ALL: [AxisName; 3] = [AxisName::X, AxisName::Y, AxisName::Z];

    /// Its direction.
    pub fn unit(self) -> DVec3 {
        match self {
            AxisName::X => DVec3::X,
            AxisName::Y => DVec3::Y,
            AxisName::Z => DVec3::Z,
        }
    }

    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            AxisName::X => "X",
            AxisName::Y => "Y",
            AxisName::Z => "Z",
        }
    }
}

/// What a user can ask for. In a script, `{"do":"hide"}`, `{"do":"search","text":"pump"}`.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Action {
    /// Search the tree; an empty text ends it.
    Search {
        /// Part of a name, or of a path if there is a `/` in it.
        text: String,
    },
    /// Select a node by its path.
    Select {
        /// As [`crate::scene::Scene::node_path`] writes it.
        path: String,
        /// Beside what is selected.
        #[serde(default)]
        add: bool,
    },
    /// Select nothing.
    ClearSelection,
    /// Hide what is selected.
    Hide,
    /// Show what is selected.
    Show,
    /// Show only what is selected.
    Isolate,
    /// Look through what is selected.
    Xray,
    /// Look through it no more.
    Opaque,
    /// Show everything.
    ShowAll,
    /// Take the last change back.
    Undo,
    /// Make it again.
    Redo,
    /// Bring what is selected into view.
    ZoomToSelection,
    /// Bring everything into view.
    ZoomAll,
    /// A standard view, or from an edge or a corner.
    LookFrom {
        /// From where.
        side: Side,
    },
    /// Parallel projection, or perspective.
    Parallel {
        /// Parallel.
        on: bool,
    },
    /// Another way to move.
    Navigate {
        /// Which.
        mode: Mode,
    },
    /// Jump.
    Camera {
        /// To here.
        camera: Camera,
    },
    /// Cut everything by a plane across an axis.
    AddSection {
        /// Which axis.
        axis: AxisName,
        /// Where between the scene's sides, 0 to 1; else through the middle of what is selected.
        #[serde(default)]
        at: Option<f64>,
        /// Keep the other side.
        #[serde(default)]
        flip: bool,
    },
    /// Cut nothing.
    ClearSections,
    /// Move what is selected.
    Move {
        /// By this, model units.
        by: [f64; 3],
    },
    /// Turn what is selected about the mean of its parts' middles.
    Rotate {
        /// About this axis.
        axis: AxisName,
        /// By this.
        degrees: f64,
    },
    /// Handles to move and turn what is selected by.
    MoveTool {
        /// Show them.
        on: bool,
    },
    /// Move what is selected back.
    MoveBack,
    /// Remember what is seen.
    AddBookmark {
        /// By this name.
        name: String,
    },
    /// See it again.
    GoToBookmark {
        /// Its name.
        name: String,
    },
    /// Call it otherwise.
    RenameBookmark {
        /// Its name.
        name: String,
        /// Its new one.
        to: String,
    },
    /// Forget it.
    RemoveBookmark {
        /// Its name.
        name: String,
    },
    /// Begin to record a route, or end it.
    Record {
        /// Begin.
        on: bool,
    },
    /// Play the route.
    Play,
    /// Play it no more.
    Stop,
    /// Add this camera to the route, two seconds after its end.
    AddKeyframe,
    /// See what a keyframe of the route sees.
    GoToKeyframe {
        /// From 0.
        index: usize,
    },
    /// Give a keyframe this camera.
    SetKeyframe {
        /// From 0.
        index: usize,
    },
    /// Give a keyframe another time.
    MoveKeyframe {
        /// From 0.
        index: usize,
        /// As the route counts.
        seconds: f64,
    },
    /// Jump to a keyframe, or fly to it.
    CutKeyframe {
        /// From 0.
        index: usize,
        /// Jump.
        on: bool,
    },
    /// Take a keyframe out of the route.
    RemoveKeyframe {
        /// From 0.
        index: usize,
    },
    /// Frames a second of the route in its file.
    RouteFps {
        /// So many.
        fps: f64,
    },
    /// Turn the route about.
    ReverseRoute,
    /// Play the route faster, or slower.
    SpeedRoute {
        /// Times as fast.
        factor: f64,
    },
    /// Write the route for `compare`, `walk` and `render`.
    ExportRoute {
        /// There.
        file: PathBuf,
    },
    /// Read a route.
    OpenRoute {
        /// From there.
        file: PathBuf,
    },
    /// Clicks measure, or select.
    Measure {
        /// Measure.
        on: bool,
    },
    /// Forget all measurements.
    ClearMeasurements,
    /// Cast shadows.
    Shadows {
        /// Do.
        on: bool,
    },
    /// Draw what a section cuts open as solid.
    Caps {
        /// Do.
        on: bool,
    },
    /// Go on drawing what is drawn now: shows what is culled.
    Freeze {
        /// Do.
        on: bool,
    },
    /// Open another scene, or a model, instead of this one.
    Open {
        /// It.
        file: PathBuf,
    },
    /// Compare the picture with what rays through all triangles see.
    CheckLost,
}
