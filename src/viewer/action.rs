//! What a user can ask for: by a button, a key, or a line of a script.

use std::path::PathBuf;

use glam::DVec3;
use serde::Deserialize;

use super::navigate::Mode;
use crate::camera::Camera;

/// An axis of the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
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

/// A side to look from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SideName {
    /// From the front.
    Front,
    /// From behind.
    Back,
    /// From the left.
    Left,
    /// From the right.
    Right,
    /// From above.
    Top,
    /// From below.
    Bottom,
    /// From a corner above.
    Isometric,
}

impl SideName {
    /// All of them, with what they are called.
    pub const ALL: [(SideName, &'static str); 7] = [
        (SideName::Front, "Front"),
        (SideName::Back, "Back"),
        (SideName::Left, "Left"),
        (SideName::Right, "Right"),
        (SideName::Top, "Top"),
        (SideName::Bottom, "Bottom"),
        (SideName::Isometric, "Isometric"),
    ];
}

/// What a user can ask for. In a script, `{"do":"hide"}`, `{"do":"search","text":"pump"}`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
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
    /// A standard view.
    LookFrom {
        /// From where.
        side: SideName,
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
    /// Turn what is selected about the middle of its box.
    Rotate {
        /// About this axis.
        axis: AxisName,
        /// By this.
        degrees: f64,
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
    /// Go on drawing what is drawn now: shows what is culled.
    Freeze {
        /// Do.
        on: bool,
    },
    /// Compare the picture with what rays through all triangles see.
    CheckLost,
}
