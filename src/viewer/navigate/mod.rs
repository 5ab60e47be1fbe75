//! How the camera moves: orbit, fly and walk, glides between views, standard views.
//!
//! ```text
//! pose       where the eye is and how it is turned; heading and pitch
//! orbit      turning about the pivot, pan, zoom to the cursor
//! fly        looking around, free flight at a speed that suits what is ahead
//! walk       feet on the ground, steps, walls
//! glide      from one view to another in time
//! standard   views from the six sides, a box brought into view
//! probe      what stands in the way: single rays
//! ```
//!
//! World space in f64 throughout, lengths in model units. Nothing is kept relative to the world's origin but positions, so
//! that a scene far from it moves as one at it does. Motions with a number that is not finite are ignored: they come from
//! devices, frame by frame, and the next one is good again.

mod fly;
mod glide;
mod orbit;
mod pose;
mod probe;
mod standard;
#[cfg(test)]
mod testing;
#[cfg(test)]
pub(super) use testing::Random;
mod walk;

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::camera::{Camera, CameraError, Projection};
use glide::Glide;
use pose::{Compass, Pose};

pub use probe::Probe;
pub use standard::Side;
pub use walk::Body;

/// Vertical field of view unless another is set, degrees.
pub const DEFAULT_FOV_Y_DEG: f64 = 60.0;

/// The pivot's depth when the pivot lies behind the eye, as a fraction of the scene's diagonal.
const DEPTH_WITHOUT_PIVOT: f64 = 0.1;

/// Nearest that zoom comes to anything, as a fraction of the scene's diagonal.
const NEAREST: f64 = 1e-6;

/// The camera's target lies no nearer than this fraction of the diagonal: far from the world's origin, where f64 rounds
/// positions to 2^-53 of their size, a near target would turn the view by that.
const NEAREST_TARGET: f64 = 0.01;

/// A scene may be a single point; its diagonal is then taken for this, model units.
const LEAST_DIAGONAL: f64 = 1e-3;

/// How the user moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// About the pivot; [`Navigator::step`] does nothing.
    #[default]
    Orbit,
    /// Freely.
    Fly,
    /// On the ground.
    Walk,
}

/// What the user's keys ask for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// -1 to 1: back or ahead.
    pub forward: f64,
    /// -1 to 1: left or right.
    pub right: f64,
    /// -1 to 1: down or up, along the world's up. Nothing to who walks.
    pub up: f64,
    /// Times the usual speed: 1, more to hurry, less to creep. From 0.01 to 100.
    pub hurry: f64,
}

impl Default for Motion {
    fn default() -> Self {
        Motion { forward: 0.0, right: 0.0, up: 0.0, hurry: 1.0 }
    }
}

impl Motion {
    /// The axes within their range, and the hurry; `None` when there is no motion.
    fn checked(&self) -> Option<(DVec3, f64)> {
        let axes = DVec3::new(self.forward, self.right, self.up);
        if !axes.is_finite() || !self.hurry.is_finite() {
            return None;
        }
        let axes = axes.clamp(DVec3::NEG_ONE, DVec3::ONE);
        (axes != DVec3::ZERO).then_some((axes, self.hurry.clamp(0.01, 100.0)))
    }
}

/// Why a navigator cannot do what is asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NavigateError {
    /// A box is inside out, or has no finite size.
    #[error("the box {min} .. {max} is not a finite box: min must not be above max on any axis")]
    Bounds {
        /// Low corner as given.
        min: DVec3,
        /// High corner as given.
        max: DVec3,
    },
    /// The world's up is zero or not finite.
    #[error("the world's up must be a finite vector other than 0; it is {0}")]
    Up(DVec3),
    /// Length of the model's unit out of range.
    #[error("the metres per model unit must be finite and above 0; they are {0}")]
    Unit(f64),
}

/// The camera and how it moves.
#[derive(Clone, Debug)]
pub struct Navigator {
    min: DVec3,
    max: DVec3,
    compass: Compass,
    body: Body,
    mode: Mode,
    pose: Pose,
    fov_y_deg: f64,
    /// Height of the picture in model units; `None` in a perspective.
    parallel_height: Option<f64>,
    pivot: DVec3,
    /// The camera that was set or glided to, until something moves: it is given back to the last bit.
    given: Option<Camera>,
    glide: Option<Glide>,
    /// Of flight, model units a second; `None` before the first step.
    fly_speed: Option<f64>,
    /// Downward speed of who walks, model units a second.
    fall_speed: f64,
}

impl Navigator {
    /// A navigator in a scene of these bounds, its eye before all of the scene, looking from the front, right and above.
    ///
    /// # Errors
    ///
    /// The bounds are no box, `up` has no direction, or the length of the model's unit is not above 0.
    pub fn new(min: DVec3, max: DVec3, up: DVec3, metres_per_unit: f64) -> Result<Self, NavigateError> {
        check_box(min, max)?;
        let compass = Compass::new(up).ok_or(NavigateError::Up(up))?;
        let body = Body::person(metres_per_unit).ok_or(NavigateError::Unit(metres_per_unit))?;
        let centre = min + 0.5 * (max - min);
        let world_from_view = compass.orientation(Side::ISOMETRIC.aim());
        let mut navigator = Navigator {
            min,
            max,
            compass,
            body,
            mode: Mode::default(),
            pose: Pose { eye: centre, world_from_view },
            fov_y_deg: DEFAULT_FOV_Y_DEG,
            parallel_height: None,
            pivot: centre,
            given: None,
            glide: None,
            fly_speed: None,
            fall_speed: 0.0,
        };
        navigator.frame_box(min, max, (1, 1), 0.0)?;
        // What was set is not a user's camera: the eye is where it is, and the field of view may still be set.
        navigator.given = None;
        Ok(navigator)
    }

    /// The camera for a window of so many pixels. Its target is at the pivot's depth, or a hundredth of the scene away if
    /// that is farther.
    pub fn camera(&self, (width, height): (u32, u32)) -> Camera {
        if let Some(given) = self.given {
            return Camera { width, height, ..given };
        }
        let reach = self.depth().max(NEAREST_TARGET * self.diagonal());
        let target = self.pose.eye + reach * self.pose.forward();
        let projection = self.projection();
        let (eye, up) = (self.pose.eye.into(), self.pose.up().into());
        Camera { eye, target: target.into(), up, projection, width, height }
    }

    /// Jumps to a camera; its target becomes the pivot. It is kept as it is, tilted horizon and all, until something moves:
    /// turning it brings the horizon level.
    ///
    /// # Errors
    ///
    /// The camera cannot be used.
    pub fn set_camera(&mut self, camera: &Camera) -> Result<(), CameraError> {
        self.go_to(camera, 0.0)
    }

    /// Right, back and up of the world, as standard views have them; length 1.
    pub fn sides(&self) -> [DVec3; 3] {
        let (back, right) = self.compass.level(0.0);
        [right, back, self.compass.up]
    }

    /// Right and up in the picture, length 1.
    pub fn picture_axes(&self) -> (DVec3, DVec3) {
        (self.pose.right(), self.pose.up())
    }

    /// How the user moves.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Moves in another way from now on; who walks begins to fall here.
    pub fn set_mode(&mut self, mode: Mode) {
        if mode != self.mode {
            self.mode = mode;
            self.fly_speed = None;
            self.fall_speed = 0.0;
        }
    }

    /// The point that orbits turn about and whose depth pans follow, world space.
    pub fn pivot(&self) -> DVec3 {
        self.pivot
    }

    /// Sets the pivot: what is under the cursor, or the middle of a selection. The picture stays.
    pub fn set_pivot(&mut self, pivot: DVec3) {
        if pivot.is_finite() {
            self.pivot = pivot;
        }
    }

    /// Vertical field of view of perspectives, degrees.
    pub fn fov_y_deg(&self) -> f64 {
        self.fov_y_deg
    }

    /// Sets the vertical field of view of perspectives. The eye stays where it is.
    ///
    /// # Errors
    ///
    /// It is not between 0 and 180 degrees.
    pub fn set_fov_y_deg(&mut self, fov_y_deg: f64) -> Result<(), CameraError> {
        if !(fov_y_deg > 0.0 && fov_y_deg < 180.0) {
            return Err(CameraError::FieldOfView(fov_y_deg));
        }
        self.begin_motion();
        self.fov_y_deg = fov_y_deg;
        Ok(())
    }

    /// Is the projection parallel?
    pub fn is_parallel(&self) -> bool {
        self.parallel_height.is_some()
    }

    /// Changes to a parallel projection or to a perspective. What is at the pivot's depth keeps its size: a perspective's eye
    /// moves along the view for it.
    pub fn set_parallel(&mut self, is_parallel: bool) {
        if is_parallel == self.is_parallel() {
            return;
        }
        self.begin_motion();
        self.bring_pivot_ahead();
        let height = self.height_at_pivot();
        if is_parallel {
            self.parallel_height = Some(height);
        } else {
            let depth = height / (2.0 * self.tan_half_fov());
            self.pose.eye += (self.depth() - depth) * self.pose.forward();
            self.parallel_height = None;
        }
    }

    fn projection(&self) -> Projection {
        match self.parallel_height {
            Some(height) => Projection::Orthographic { height },
            None => Projection::Perspective { fov_y_deg: self.fov_y_deg },
        }
    }

    fn tan_half_fov(&self) -> f64 {
        (0.5 * self.fov_y_deg).to_radians().tan()
    }

    fn diagonal(&self) -> f64 {
        (self.max - self.min).length().max(LEAST_DIAGONAL)
    }

    fn centre(&self) -> DVec3 {
        self.min + 0.5 * (self.max - self.min)
    }

    /// The pivot's depth along the view; something sensible when it lies behind the eye.
    fn depth(&self) -> f64 {
        let depth = (self.pivot - self.pose.eye).dot(self.pose.forward());
        if depth >= NEAREST * self.diagonal() { depth } else { DEPTH_WITHOUT_PIVOT * self.diagonal() }
    }

    /// Height of the picture at the pivot's depth, model units.
    fn height_at_pivot(&self) -> f64 {
        self.parallel_height.unwrap_or_else(|| 2.0 * self.depth() * self.tan_half_fov())
    }

    /// A pivot behind the eye says nothing about what the user looks at: it is moved into the view.
    fn bring_pivot_ahead(&mut self) {
        if (self.pivot - self.pose.eye).dot(self.pose.forward()) < NEAREST * self.diagonal() {
            self.pivot = self.pose.eye + self.depth() * self.pose.forward();
        }
    }

    /// The user moves: a glide ends where it is.
    fn begin_motion(&mut self) {
        self.glide = None;
        self.given = None;
    }

    /// The orientation after a drag of so many pixels, `per_row` radians a row of the picture: to the right turns to the right,
    /// down looks down, and the horizon is level. Straight up and down are not reached, so that "ahead" keeps its meaning.
    fn turned(&self, pixels: DVec2, per_row: f64) -> glam::DQuat {
        let mut aim = self.compass.aim(self.pose.world_from_view);
        // A standard view from the top is straight down; turning it does not tilt it at once.
        let limit = pose::MOST_PITCH.max(aim.pitch.abs());
        aim.heading += per_row * pixels.x;
        aim.pitch = (aim.pitch - per_row * pixels.y).clamp(-limit, limit);
        self.compass.orientation(aim)
    }
}

/// Rows of the picture; a window that is minimised has none.
fn rows((_, height): (u32, u32)) -> f64 {
    f64::from(height.max(1))
}

fn check_box(min: DVec3, max: DVec3) -> Result<(), NavigateError> {
    let is_box = min.is_finite() && max.is_finite() && (max - min).is_finite() && min.cmple(max).all();
    if is_box { Ok(()) } else { Err(NavigateError::Bounds { min, max }) }
}

#[cfg(test)]
mod tests;
