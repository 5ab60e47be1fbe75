//! Rays of world space.

use glam::DVec3;

/// The points `origin + t direction` of world space for `t` in `t_min ..= t_max`. The direction may have any length
/// but 0; `t` counts in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start, world space.
    pub origin: DVec3,
    /// Any finite vector but 0.
    pub direction: DVec3,
    /// Hits nearer than this do not count.
    pub t_min: f64,
    /// Hits farther than this do not count.
    pub t_max: f64,
}

impl Ray {
    /// From `origin` on without end.
    pub fn new(origin: DVec3, direction: DVec3) -> Self {
        Ray { origin, direction, t_min: 0.0, t_max: f64::INFINITY }
    }

    /// The point at `t`.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }
}

/// How far apart neighbours are among points scattered over a square, by and large.
///
/// n points whose neighbours are s apart fill a square of side s sqrt(n), in which their mean squared distance from the middle is
/// s^2 n / 6.
pub(crate) fn spacing_of(points: impl ExactSizeIterator<Item = DVec3> + Clone) -> f64 {
    let count = points.len().max(1) as f64;
    let middle = points.clone().sum::<DVec3>() / count;
    let scatter = points.map(|point| point.distance_squared(middle)).sum::<f64>() / count;
    (6.0 * scatter / count).sqrt()
}
