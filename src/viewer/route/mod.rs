//! A camera route that can be edited: keyframes with times, played and written as [`CameraPath`] has them.
//!
//! A [`Recorder`] makes one of a motion; [`Route::to_json`] writes what `--path` of the commands reads. Times are
//! those of the keyframes, in seconds; the first keyframe's need not be 0.

mod record;

pub use record::{Recorder, Tolerance};

use crate::camera::Camera;
use crate::lab::keyframes::{CameraPath, DEFAULT_FPS, Keyframe, PathError};

/// A camera route, or an empty one. Whatever its editing, it can be walked as a path of the commands; an edit that
/// would make it otherwise is refused and changes nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct Route {
    /// Checked; all keyframes have the size of the first.
    path: Option<CameraPath>,
    fps: f64,
}

/// Why an edit of a route is refused.
#[derive(Debug, thiserror::Error)]
pub enum RouteError {
    /// It could not be walked.
    #[error(transparent)]
    Path(#[from] PathError),
    /// No such keyframe.
    #[error("there is no keyframe {index}: the route has {count}, counted from 0")]
    NoKeyframe {
        /// Asked for.
        index: usize,
        /// There are.
        count: usize,
    },
    /// Nothing gets slower or faster by it.
    #[error("a route's speed is changed by a finite factor above 0; it is {0}")]
    Speed(f64),
}

impl Default for Route {
    fn default() -> Self {
        Route { path: None, fps: DEFAULT_FPS }
    }
}

impl Route {
    /// A route of keyframes; they get the size of the first. Where the kind of projection changes there is a cut.
    ///
    /// # Errors
    ///
    /// A camera is bad, times do not rise, or the route is too long.
    pub fn new(keyframes: Vec<Keyframe>, fps: f64) -> Result<Self, RouteError> {
        Ok(Route { path: checked(keyframes, fps)?, fps })
    }

    /// By rising time.
    pub fn keyframes(&self) -> &[Keyframe] {
        self.path.as_ref().map_or(&[], CameraPath::keyframes)
    }

    /// Frames a second of the exported path.
    pub fn fps(&self) -> f64 {
        self.fps
    }

    /// Seconds from the first keyframe to the last.
    pub fn duration(&self) -> f64 {
        match self.keyframes() {
            [first, .., last] => last.t - first.t,
            _ => 0.0,
        }
    }

    /// The camera at a time, at the ends before the first keyframe and after the last; `None` for an empty route. Its
    /// size is that of the first keyframe.
    ///
    /// Where eye and target meet between two keyframes, or the view comes to lie along `up`, it is the earlier of them.
    pub fn camera_at(&self, seconds: f64) -> Option<Camera> {
        let (_, camera) = self.path.as_ref()?.at(seconds);
        if camera.rays().is_ok() {
            return Some(camera);
        }
        let after = self.keyframes().partition_point(|keyframe| keyframe.t <= seconds);
        self.keyframes().get(after.saturating_sub(1)).map(|keyframe| keyframe.camera)
    }

    /// Another number of frames a second for the exported path.
    ///
    /// # Errors
    ///
    /// It is not above 0 and at most 1000, or the path would have too many frames.
    pub fn set_fps(&mut self, fps: f64) -> Result<(), RouteError> {
        *self = Route::new(self.keyframes().to_vec(), fps)?;
        Ok(())
    }

    // --- Editing ---

    /// Adds a keyframe at a time when there is none; its index.
    ///
    /// # Errors
    ///
    /// The camera is bad, there is a keyframe at that time, or the route gets too long.
    pub fn insert(&mut self, seconds: f64, camera: Camera) -> Result<usize, RouteError> {
        let index = self.keyframes().partition_point(|keyframe| keyframe.t < seconds);
        self.edit(|keyframes| keyframes.insert(index, Keyframe { t: seconds, camera, cut: false }))?;
        Ok(index)
    }

    /// Gives a keyframe another camera.
    ///
    /// # Errors
    ///
    /// The camera is bad, or there is no such keyframe.
    pub fn replace(&mut self, index: usize, camera: Camera) -> Result<(), RouteError> {
        self.edit_one(index, |keyframe| keyframe.camera = camera)
    }

    /// Jumps to a keyframe, or flies to it. Where the kind of projection changes it stays a jump.
    ///
    /// # Errors
    ///
    /// There is no such keyframe.
    pub fn set_cut(&mut self, index: usize, cut: bool) -> Result<(), RouteError> {
        self.edit_one(index, |keyframe| keyframe.cut = cut)
    }

    /// Moves a keyframe in time.
    ///
    /// # Errors
    ///
    /// It would reach a neighbour, or there is no such keyframe.
    pub fn move_to(&mut self, index: usize, seconds: f64) -> Result<(), RouteError> {
        self.edit_one(index, |keyframe| keyframe.t = seconds)
    }

    /// Removes a keyframe. A cut stays between what was on its sides.
    ///
    /// # Errors
    ///
    /// There is no such keyframe.
    pub fn remove(&mut self, index: usize) -> Result<(), RouteError> {
        self.check_index(index)?;
        self.edit(|keyframes| {
            let removed = keyframes.remove(index);
            if let Some(next) = keyframes.get_mut(index) {
                next.cut |= removed.cut;
            }
        })
    }

    /// Plays everything so many times as fast, from the same first time on.
    ///
    /// # Errors
    ///
    /// The factor is not finite and above 0, or the route gets too long or too short for its keyframes.
    pub fn change_speed(&mut self, factor: f64) -> Result<(), RouteError> {
        if !(factor > 0.0 && factor.is_finite()) {
            return Err(RouteError::Speed(factor));
        }
        let start = self.keyframes().first().map_or(0.0, |first| first.t);
        self.edit(|keyframes| {
            keyframes.iter_mut().for_each(|keyframe| keyframe.t = start + (keyframe.t - start) / factor);
        })
    }

    /// Plays everything backwards. The camera waits before a cut, so that a wait comes to its other side.
    ///
    /// # Errors
    ///
    /// Times that differ in their last bits come to be the same.
    pub fn reverse(&mut self) -> Result<(), RouteError> {
        self.edit(|keyframes| {
            let (start, end) = match keyframes.as_slice() {
                [first, .., last] => (first.t, last.t),
                _ => return,
            };
            // A keyframe is jumped to from the other side.
            let mut cut_after = false;
            for keyframe in keyframes.iter_mut().rev() {
                keyframe.t = start + (end - keyframe.t);
                std::mem::swap(&mut keyframe.cut, &mut cut_after);
            }
            keyframes.reverse();
        })
    }

    fn edit_one(&mut self, index: usize, change: impl FnOnce(&mut Keyframe)) -> Result<(), RouteError> {
        self.check_index(index)?;
        self.edit(|keyframes| keyframes.get_mut(index).map_or((), change))
    }

    /// Changes a copy, and keeps it when it can be walked.
    fn edit(&mut self, change: impl FnOnce(&mut Vec<Keyframe>)) -> Result<(), RouteError> {
        let mut keyframes = self.keyframes().to_vec();
        change(&mut keyframes);
        self.path = checked(keyframes, self.fps)?;
        Ok(())
    }

    fn check_index(&self, index: usize) -> Result<(), RouteError> {
        let count = self.keyframes().len();
        if index < count { Ok(()) } else { Err(RouteError::NoKeyframe { index, count }) }
    }

    // --- Files ---

    /// The path that the commands walk, of cameras of this size in pixels.
    ///
    /// # Errors
    ///
    /// The route is empty, or the size is none of an image.
    pub fn path(&self, size: (u32, u32)) -> Result<CameraPath, PathError> {
        let mut keyframes = self.keyframes().to_vec();
        for keyframe in &mut keyframes {
            (keyframe.camera.width, keyframe.camera.height) = size;
        }
        CameraPath::new(keyframes, self.fps)
    }

    /// That path as the text of a path file.
    ///
    /// # Errors
    ///
    /// As [`Route::path`].
    pub fn to_json(&self, size: (u32, u32)) -> Result<String, PathError> {
        Ok(self.path(size)?.to_json()?)
    }

    /// Reads a path file, also a plain list of cameras.
    ///
    /// # Errors
    ///
    /// Those of the commands.
    pub fn from_json(text: &str) -> Result<Self, PathError> {
        let path = CameraPath::from_json(text, None)?;
        Ok(Route { fps: path.fps(), path: Some(path) })
    }
}

/// A path of the keyframes, if there are any.
fn checked(mut keyframes: Vec<Keyframe>, fps: f64) -> Result<Option<CameraPath>, PathError> {
    let Some(first) = keyframes.first() else {
        return if fps > 0.0 && fps <= 1000.0 { Ok(None) } else { Err(PathError::Fps(fps)) };
    };
    let (size, mut kind) = ((first.camera.width, first.camera.height), first.camera.projection);
    for Keyframe { camera, cut, .. } in &mut keyframes {
        (camera.width, camera.height) = size;
        *cut |= std::mem::discriminant(&kind) != std::mem::discriminant(&camera.projection);
        kind = camera.projection;
    }
    CameraPath::new(keyframes, fps).map(Some)
}

#[cfg(test)]
mod tests;
