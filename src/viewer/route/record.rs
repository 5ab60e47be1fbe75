//! A recorded motion as few keyframes: splines through them stay within a tolerance of every recorded frame.
//!
//! A piece between two cuts begins as its two ends. Between neighbours that are not good enough the worst frame becomes
//! a keyframe, until all are (Ramer 1972, Douglas and Peucker 1973, with splines in place of chords); then keyframes
//! without which it is still good enough are left out.

use std::mem::discriminant;

use super::{Route, RouteError};
use crate::camera::{Camera, Projection};
use crate::lab::keyframes::{DEFAULT_FPS, Keyframe, MAX_FRAMES, PathError, between};
use glam::DVec3;

/// Nothing moves for at least so many seconds: a pause.
const MIN_PAUSE: f64 = 0.25;
/// In a pause the camera may move by this share of the tolerance: what rounding may do, and nothing that is seen.
const PAUSE_SHARE: f64 = 1e-3;
/// A jump is a motion between two frames of more than this: radians, or shares of the distance of what is looked at.
const JUMP_MOTION: f64 = 0.5;
/// And one that is so many times as fast as before and after it.
const JUMP_SPEED: f64 = 8.0;
/// What the rounding of coordinates may do to a point, as a share of its largest coordinate.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// How far a route may be from what was recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Of the eye, and of the height of a parallel projection: a share of the distance from eye to target, or of
    /// that height.
    pub eye: f64,
    /// Of the direction of the view, of its roll, and of the field of view.
    pub degrees: f64,
}

impl Default for Tolerance {
    /// Two pixels or so.
    fn default() -> Self {
        Tolerance { eye: 2e-3, degrees: 0.1 }
    }
}

/// Takes the camera of every frame, and makes a route of them.
#[derive(Clone, Debug)]
pub struct Recorder {
    tolerance: Tolerance,
    frames: Vec<Keyframe>,
    jumps_next: bool,
}

impl Recorder {
    /// Nothing recorded yet. A tolerance below 0 is taken as 0.
    pub fn new(tolerance: Tolerance) -> Self {
        let Tolerance { eye, degrees } = tolerance;
        let tolerance = Tolerance { eye: eye.max(0.0), degrees: degrees.max(0.0) };
        Recorder { tolerance, frames: Vec::new(), jumps_next: false }
    }

    /// The next camera is jumped to. Jumps that are much faster than the motion around them are noticed without it.
    pub fn cut(&mut self) {
        self.jumps_next = true;
    }

    /// Takes the camera of a frame, also when it has not moved: without frames a pause cannot be told from a motion.
    ///
    /// # Errors
    ///
    /// The camera is bad, the time is not later than the last, or the recording gets too long; the frame is not taken,
    /// and recording can go on.
    pub fn add(&mut self, seconds: f64, camera: Camera) -> Result<(), PathError> {
        let index = self.frames.len();
        camera.rays().map_err(|source| PathError::Camera { frame: format!("frame {index}"), source })?;
        let (start, last) = self
            .frames
            .first()
            .zip(self.frames.last())
            .map_or((seconds, f64::NEG_INFINITY), |(a, b)| (a.t, b.t));
        if !(seconds > last && seconds.is_finite()) {
            return Err(PathError::Time(index));
        }
        let path_frames = (seconds - start) * DEFAULT_FPS;
        if path_frames >= MAX_FRAMES {
            return Err(PathError::TooLong(path_frames));
        }
        self.frames.push(Keyframe { t: seconds, camera, cut: self.jumps_next });
        self.jumps_next = false;
        Ok(())
    }

    /// The route of what was recorded; an empty one when nothing was.
    ///
    /// # Errors
    ///
    /// None that is known: the frames were checked.
    pub fn finish(mut self) -> Result<Route, RouteError> {
        self.find_jumps();
        let is_still = still_frames(&self.frames);
        let mut keyframes = Vec::new();
        let mut start = 0;
        for frames in self.frames.chunk_by(|_, next| !next.cut) {
            let is_still = is_still.get(start..start + frames.len()).unwrap_or_default();
            start += frames.len();
            let piece = Piece { frames, is_still, tolerance: self.tolerance };
            keyframes.extend(piece.keep().into_iter().filter_map(|index| frames.get(index)));
        }
        Route::new(keyframes, DEFAULT_FPS)
    }

    /// Marks frames that the camera jumped to.
    fn find_jumps(&mut self) {
        let motions: Vec<(f64, f64)> =
            self.frames.array_windows().map(|[a, b]| (motion(&a.camera, &b.camera), b.t - a.t)).collect();
        let speed = |index: usize| motions.get(index).map(|(motion, seconds)| motion / seconds);
        for (index, frame) in self.frames.iter_mut().enumerate().skip(1) {
            let own = index - 1;
            let (before, after) = (own.checked_sub(1).and_then(speed), speed(index));
            let around = before.into_iter().chain(after).reduce(f64::max);
            // With nothing around them to compare with, two frames are a motion.
            let (Some(&(motion, seconds)), Some(around)) = (motions.get(own), around) else { continue };
            frame.cut |= motion > JUMP_MOTION && motion / seconds > JUMP_SPEED * around;
        }
        let mut kind = None;
        for frame in &mut self.frames {
            let own = discriminant(&frame.camera.projection);
            frame.cut |= kind.replace(own).is_some_and(|before| before != own);
        }
    }
}

/// Which frames are in a pause. Sizes do not matter: the window may change while the camera rests.
fn still_frames(frames: &[Keyframe]) -> Vec<bool> {
    let rests = |a: &Keyframe, b: &Keyframe| {
        let (a, b) = (a.camera, b.camera);
        (a.eye, a.target, a.up, a.projection) == (b.eye, b.target, b.up, b.projection)
    };
    let mut is_still = Vec::with_capacity(frames.len());
    for run in frames.chunk_by(rests) {
        let is_pause = matches!(run, [first, .., last] if last.t - first.t >= MIN_PAUSE);
        is_still.extend(run.iter().map(|_| is_pause));
    }
    is_still
}

/// How far a camera moves: the larger of its turn in radians and the way of its eye in distances of what it looks at.
fn motion(from: &Camera, to: &Camera) -> f64 {
    let distance = looked_at_distance(from).max(looked_at_distance(to));
    let way = DVec3::from(from.eye).distance(to.eye.into()) / distance;
    match (from.rays(), to.rays()) {
        (Ok(from), Ok(to)) => way.max(angle(from.forward(), to.forward())),
        // Not a recorded one.
        _ => f64::INFINITY,
    }
}

fn looked_at_distance(camera: &Camera) -> f64 {
    DVec3::from(camera.eye).distance(camera.target.into())
}

/// Radians; exact for small ones too, and 0 for equal directions.
fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

/// Frames between two cuts.
struct Piece<'a> {
    frames: &'a [Keyframe],
    /// Of each frame.
    is_still: &'a [bool],
    tolerance: Tolerance,
}

impl Piece<'_> {
    /// The frames that become keyframes: their indexes, rising.
    fn keep(&self) -> Vec<usize> {
        let mut kept = vec![0, self.frames.len().saturating_sub(1)];
        kept.dedup();
        loop {
            let worst: Vec<usize> =
                (0..kept.len()).filter_map(|from| self.worst_after(&kept, from)).collect();
            if worst.is_empty() {
                break;
            }
            kept.extend(worst);
            kept.sort_unstable();
        }
        while self.leave_out(&mut kept) {}
        kept
    }

    /// Of the frames between `kept[from]` and the next, the one that is farthest out of tolerance, if any is.
    fn worst_after(&self, kept: &[usize], from: usize) -> Option<usize> {
        let key = |index: usize| self.frames.get(*kept.get(index)?);
        let (a, b) = (*kept.get(from)?, *kept.get(from + 1)?);
        let (start, end) = (self.frames.get(a)?, self.frames.get(b)?);
        let (before, beyond) = (from.checked_sub(1).and_then(key), key(from + 2));
        let between_keys = self.frames.iter().zip(self.is_still).enumerate().take(b).skip(a + 1);
        let excess = between_keys.map(|(index, (frame, &is_still))| {
            let played = between(before, start, end, beyond, frame.t);
            let share = if is_still { PAUSE_SHARE } else { 1.0 };
            (index, deviation(&played, &frame.camera, &self.tolerance) / share)
        });
        let out = excess.filter(|&(_, excess)| excess > 1.0);
        out.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
    }

    /// Goes once through the keyframes and leaves out those that are not needed; was there any?
    fn leave_out(&self, kept: &mut Vec<usize>) -> bool {
        let mut needed: Vec<usize> = Vec::with_capacity(kept.len());
        for (at, &index) in kept.iter().enumerate() {
            let after = kept.get(at + 1..).unwrap_or_default();
            let is_end = needed.is_empty() || after.is_empty();
            if is_end || !self.is_good_without(&needed, after) {
                needed.push(index);
            }
        }
        let some = needed.len() < kept.len();
        *kept = needed;
        some
    }

    /// Is it good enough when the keyframes `after` follow on those `before`? A keyframe has a say in the two
    /// intervals on each side of it, and these depend on one more.
    fn is_good_without(&self, before: &[usize], after: &[usize]) -> bool {
        const REACH: usize = 3;
        let near = before.get(before.len().saturating_sub(REACH)..).unwrap_or_default();
        let around: Vec<usize> = near.iter().chain(after.iter().take(REACH)).copied().collect();
        let gap = near.len().saturating_sub(1);
        (gap.saturating_sub(1)..=gap + 1).all(|from| self.worst_after(&around, from).is_none())
    }
}

/// How far a played camera is from the recorded one, as a share of the tolerance: the largest of eye, direction, roll
/// and lens. What the rounding of coordinates does is no deviation.
fn deviation(played: &Camera, recorded: &Camera, tolerance: &Tolerance) -> f64 {
    let (Some(a), Some(b)) = (axes(played), axes(recorded)) else { return f64::INFINITY };
    let distance = looked_at_distance(recorded);
    let largest = recorded.eye.iter().chain(&recorded.target).fold(0.0, |most: f64, x| most.max(x.abs()));
    let rounding = ROUNDING * largest / distance;
    let eye = DVec3::from(played.eye).distance(recorded.eye.into()) / distance;
    let turn = angle(a.0, b.0).max(angle(a.1, b.1));
    let (degrees, share) = lens_deviation(&played.projection, &recorded.projection);
    let degrees = degrees.max((turn - rounding).to_degrees());
    let share = share.max(eye - rounding);
    // Nothing is a deviation of 0, however small the tolerance is.
    let part = |deviation: f64, most: f64| if deviation > 0.0 { deviation / most } else { 0.0 };
    part(share, tolerance.eye).max(part(degrees, tolerance.degrees))
}

/// Forward and right, length 1.
fn axes(camera: &Camera) -> Option<(DVec3, DVec3)> {
    let forward = camera.rays().ok()?.forward();
    Some((forward, forward.cross(camera.up.into()).try_normalize()?))
}

/// By how many degrees the fields of view differ, or by which share the heights do.
fn lens_deviation(played: &Projection, recorded: &Projection) -> (f64, f64) {
    match (played, recorded) {
        (Projection::Perspective { fov_y_deg: a }, Projection::Perspective { fov_y_deg: b }) => {
            ((a - b).abs(), 0.0)
        }
        (Projection::Orthographic { height: a }, Projection::Orthographic { height: b }) => {
            (0.0, (a - b).abs() / b)
        }
        // There is a cut between them.
        _ => (f64::INFINITY, f64::INFINITY),
    }
}

#[cfg(test)]
mod tests;
