//! Oriented boxes of drawables, and what of the image they cover.

use glam::{DAffine3, DVec3};

use super::view::{LEAST_H, View};
use crate::camera::Plane;

/// Boxes are made wider by this many units in the last place of their largest coordinate, for the rounding of placements.
const PLACEMENT_ROUNDING: f64 = 64.0 * f64::EPSILON;
/// Nearness of a box is rounded up by this part of it (parallel: of it and the scene), and its bounds in pixels
/// are made wider by as much of them: f32 and the sums before it round less.
const ROUNDING: f64 = 1.0 / (1 << 20) as f64;

/// A parallelepiped of world space: the points `centre + a half[0] + b half[1] + c half[2]`, -1 <= a, b, c <= 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedBox {
    /// Its middle.
    pub centre: DVec3,
    /// From there to the middles of three faces.
    pub half: [DVec3; 3],
}

/// What a box covers of the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScreenBox {
    /// First and last column of pixels that the box reaches into, within the image.
    pub left: u32,
    /// Last column.
    pub right: u32,
    /// First row.
    pub top: u32,
    /// Last row.
    pub bottom: u32,
    /// Nearness ([`super::view`]) of its nearest point, or a little more.
    pub nearest: f32,
    /// Area of its bounds in pixels, those beyond the image too.
    pub area: f32,
}

/// Where a box is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sight {
    /// Nothing of it is in the image.
    Outside,
    /// It reaches the plane of the eye: it may cover anything.
    AtEye,
    /// It covers at most this.
    Covers(ScreenBox),
}

impl OrientedBox {
    /// Of a box of part space, placed.
    pub fn placed(world_from_part: &DAffine3, min: DVec3, max: DVec3) -> Self {
        let centre = world_from_part.transform_point3(min + 0.5 * (max - min));
        let half = 0.5 * (max - min);
        let m = world_from_part.matrix3;
        let half = [m.x_axis * half.x, m.y_axis * half.y, m.z_axis * half.z];
        let farthest = centre.abs().max_element() + half.iter().map(|h| h.abs().max_element()).sum::<f64>();
        let slack = farthest * PLACEMENT_ROUNDING;
        let axes = [m.x_axis, m.y_axis, m.z_axis];
        let wider = |k: usize| half[k] + axes[k].normalize_or_zero() * slack;
        OrientedBox { centre, half: [wider(0), wider(1), wider(2)] }
    }

    /// Half its extent along a direction, times the direction's length.
    pub fn reach(&self, direction: DVec3) -> f64 {
        self.half.iter().map(|half| half.dot(direction).abs()).sum()
    }

    /// Least and greatest height above a plane, times the length of its normal.
    pub fn heights(&self, plane: &Plane) -> (f64, f64) {
        let (middle, reach) = (plane.normal.dot(self.centre - plane.point), self.reach(plane.normal));
        (middle - reach, middle + reach)
    }

    /// Half extents of its axis-aligned box.
    pub fn aligned_half(&self) -> DVec3 {
        self.half.iter().fold(DVec3::ZERO, |sum, half| sum + half.abs())
    }

    /// Areas of its faces across the three axes.
    pub fn face_areas(&self) -> [f64; 3] {
        let [a, b, c] = self.half;
        [b.cross(c), c.cross(a), a.cross(b)].map(|face| 4.0 * face.length())
    }

    /// What it covers of the image: never less than it does.
    pub fn seen(&self, view: &View) -> Sight {
        let middle = view.point(self.centre);
        let half = self.half.map(|half| view.vector(half));
        let (width, height) = view.size();
        let (last_x, last_y) = (f64::from(width) - 1.0, f64::from(height) - 1.0);
        // Along any direction of (X, Y, third) space.
        let third = if view.is_parallel() { middle.a } else { middle.h };
        let reach = |k: usize| half.iter().map(|h| h[k].abs()).sum::<f64>();
        let (third_low, third_high) = (third - reach(2), third + reach(2));
        if view.is_parallel() {
            if self.heights(&view.eye_plane()).1 < 0.0 {
                return Sight::Outside;
            }
            let x = (middle.x - reach(0), middle.x + reach(0));
            let y = (middle.y - reach(1), middle.y + reach(1));
            let nearest = third_high + ROUNDING * (1.0 + third_high.abs());
            return covers(x, y, nearest, last_x, last_y);
        }
        if third_high < 0.0 {
            return Sight::Outside;
        }
        let slack = 1e-12 * (third.abs() + reach(2));
        if third_low - slack < LEAST_H {
            // Wholly beyond one side of the image?
            let side = |axis: usize, middle: f64, edge: f64, sign: f64| {
                let reach: f64 = half.iter().map(|h| (h[axis] - edge * h[2]).abs()).sum();
                sign * (middle - edge * third) + reach < 0.0
            };
            let beyond = side(0, middle.x, -0.5, 1.0)
                || side(0, middle.x, last_x + 0.5, -1.0)
                || side(1, middle.y, -0.5, 1.0)
                || side(1, middle.y, last_y + 0.5, -1.0);
            return if beyond { Sight::Outside } else { Sight::AtEye };
        }
        let (mut x, mut y) = ((f64::INFINITY, f64::NEG_INFINITY), (f64::INFINITY, f64::NEG_INFINITY));
        for corner in 0..8u32 {
            let sign = |k: u32| if corner >> k & 1 == 0 { -1.0 } else { 1.0 };
            let signs = [sign(0), sign(1), sign(2)];
            let at = |axis: usize, middle: f64| {
                middle + signs[0] * half[0][axis] + signs[1] * half[1][axis] + signs[2] * half[2][axis]
            };
            let inverse = at(2, third).recip();
            let (column, row) = (at(0, middle.x) * inverse, at(1, middle.y) * inverse);
            x = (x.0.min(column), x.1.max(column));
            y = (y.0.min(row), y.1.max(row));
        }
        covers(x, y, (1.0 + ROUNDING) / (third_low - slack), last_x, last_y)
    }
}

/// The pixels between the bounds, given from pixel centre to pixel centre.
fn covers(x: (f64, f64), y: (f64, f64), nearest: f64, last_x: f64, last_y: f64) -> Sight {
    let span = |(low, high): (f64, f64), last: f64| {
        let low = (low - ROUNDING * (1.0 + low.abs()) + 0.5).floor();
        let high = (high + ROUNDING * (1.0 + high.abs()) + 0.5).floor();
        // Bounds that are not numbers bound nothing.
        let low = if low >= 0.0 { low } else { 0.0 };
        let high = if high <= last { high } else { last };
        (low <= high && high >= 0.0).then_some((low as u32, high as u32))
    };
    let (Some((left, right)), Some((top, bottom))) = (span(x, last_x), span(y, last_y)) else {
        return Sight::Outside;
    };
    let area = ((x.1 - x.0) * (y.1 - y.0)) as f32;
    Sight::Covers(ScreenBox { left, right, top, bottom, nearest: nearest as f32, area })
}
