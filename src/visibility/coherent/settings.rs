//! What a coherent query may be told, and what not.

use crate::visibility::{RayMethod, RaysPerPixel};

/// How a coherent query trades rays for time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoherentSettings {
    /// What each ray does.
    pub method: RayMethod,
    /// Rays per pixel in each frame. All are cast: there is no [`adaptive`](crate::visibility::QuerySettings::adaptive)
    /// coherent query. (A tile that one frame finds uniform is just where the next frames' rays look for what is thin.)
    pub rays_per_pixel: RaysPerPixel,
    /// Frames for which a drawable stays visible after it was last seen by a moving camera.
    pub window: u32,
    /// What is left of a sample count after a frame of a moving camera, 0 to 1.
    pub decay: f64,
    /// Drawables asked after in a frame, at most, as a fraction of the frame's rays; 0 or more.
    pub questions: f64,
    /// A drawable asked after so often in vain is gone; at least 1.
    pub patience: u32,
    /// Rays per pixel, over all frames of a camera that stands still, after which no more are cast; above 0, infinite for
    /// a query that never rests.
    pub enough: f64,
}

/// Settings that make no query.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CoherentError {
    /// [`CoherentSettings::decay`].
    #[error("what is left of a sample count after a frame is a fraction, 0 to 1; it is {0}")]
    Decay(f64),
    /// [`CoherentSettings::questions`].
    #[error("the questions of a frame are a fraction of its rays, finite and at least 0; it is {0}")]
    Questions(f64),
    /// [`CoherentSettings::patience`].
    #[error("a drawable has to be asked after in vain at least once before it is gone; patience is 0")]
    Patience,
    /// [`CoherentSettings::enough`].
    #[error("a still camera needs rays: enough is a number of rays per pixel above 0; it is {0}")]
    Enough(f64),
}

impl CoherentSettings {
    /// Settings that have served well for this many rays a frame: a window in which every pixel gets a ray.
    pub fn new(method: RayMethod, rays_per_pixel: RaysPerPixel) -> Self {
        let frames_per_pixel = (1.0 / rays_per_pixel.get()).ceil();
        CoherentSettings {
            method,
            rays_per_pixel,
            window: (frames_per_pixel as u32).clamp(8, 64),
            decay: 0.8,
            questions: 0.25,
            patience: 3,
            enough: 16.0,
        }
    }

    /// Is there a query of these settings?
    ///
    /// # Errors
    ///
    /// The first setting out of its range.
    pub fn check(&self) -> Result<(), CoherentError> {
        if !(0.0..=1.0).contains(&self.decay) {
            return Err(CoherentError::Decay(self.decay));
        }
        if !(self.questions >= 0.0 && self.questions.is_finite()) {
            return Err(CoherentError::Questions(self.questions));
        }
        if self.patience == 0 {
            return Err(CoherentError::Patience);
        }
        if self.enough.is_nan() || self.enough <= 0.0 {
            return Err(CoherentError::Enough(self.enough));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused() {
        let good = CoherentSettings::new(RayMethod::Hybrid, RaysPerPixel::ONE);
        assert_eq!(good.check(), Ok(()));
        for decay in [0.0, 1.0] {
            assert_eq!(CoherentSettings { decay, ..good }.check(), Ok(()));
        }
        for decay in [-0.1, 1.1, f64::NAN] {
            let error = CoherentSettings { decay, ..good }.check().unwrap_err();
            assert!(matches!(error, CoherentError::Decay(_)), "{decay}: {error}");
        }
        for questions in [-0.1, f64::INFINITY, f64::NAN] {
            let error = CoherentSettings { questions, ..good }.check().unwrap_err();
            assert!(matches!(error, CoherentError::Questions(_)), "{questions}: {error}");
        }
        for enough in [0.0, -1.0, f64::NAN] {
            let error = CoherentSettings { enough, ..good }.check().unwrap_err();
            assert!(matches!(error, CoherentError::Enough(_)), "{enough}: {error}");
        }
        assert_eq!(CoherentSettings { enough: f64::INFINITY, ..good }.check(), Ok(()));
        assert_eq!(CoherentSettings { patience: 0, ..good }.check(), Err(CoherentError::Patience));
    }
}
