//! What lies between two points, and how it is written.

use std::fmt;

use glam::DVec3;

use crate::container::Settings;

use super::snap::{Snap, SnapKind};

/// Faces at a smaller angle than this are parallel.
const PARALLEL_DEG: f64 = 0.1;

/// Lengths are written to the millimetre.
const FINE_METRES: f64 = 1e-3;

/// Or to so many digits, where that is finer.
const DIGITS: f64 = 4.0;

/// No more digits behind the point than this.
const MOST_DECIMALS: f64 = 9.0;

/// A unit that lengths are written in: the scene's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LengthUnit<'a> {
    /// Its name, such as `mm`.
    pub name: &'a str,
    /// Its length in metres.
    pub metres: f64,
}

/// From one point to another. Every vector `up` is the world's up direction, of any length but 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// The first point.
    pub from: Snap,
    /// The second point.
    pub to: Snap,
}

impl<'a> LengthUnit<'a> {
    /// The unit of a scene.
    pub fn of(settings: &'a Settings) -> Self {
        LengthUnit { name: &settings.unit, metres: settings.metres_per_unit }
    }

    /// A length with its unit, such as `1.250 m`: to the millimetre or to four digits, whichever is finer.
    pub fn show(&self, length: f64) -> String {
        format!("{} {}", fixed(length, self.decimals(length)), self.name)
    }

    /// Digits behind the point.
    fn decimals(&self, length: f64) -> usize {
        let for_millimetres = (self.metres / FINE_METRES).log10().ceil();
        // Minus infinity for a length of 0, of which the cast below makes 0 digits.
        let for_digits =
            if length == 0.0 { f64::NEG_INFINITY } else { DIGITS - 1.0 - length.abs().log10().floor() };
        for_millimetres.max(for_digits).clamp(0.0, MOST_DECIMALS) as usize
    }
}

/// A number with so many digits behind the point, and no minus before what is written as 0.
fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().all(|digit| matches!(digit, b'0' | b'.')) => digits.to_owned(),
        _ => text,
    }
}

impl Measurement {
    /// From the first point to the second, world space.
    pub fn difference(&self) -> DVec3 {
        self.to.point - self.from.point
    }

    /// Of the two points, world units.
    pub fn distance(&self) -> f64 {
        self.difference().length()
    }

    /// How much higher the second point is, world units; negative where it is lower.
    pub fn rise(&self, up: DVec3) -> f64 {
        self.difference().dot(up.normalize_or_zero())
    }

    /// Distance as seen from above, world units.
    pub fn level_distance(&self, up: DVec3) -> f64 {
        self.difference().reject_from(up).length()
    }

    /// Angle of the way from the first point to the second to the horizon, -90 to 90 degrees: positive where it rises, 0
    /// where both points are one.
    pub fn slope_deg(&self, up: DVec3) -> f64 {
        self.rise(up).atan2(self.level_distance(up)).to_degrees()
    }

    /// Distance of the planes of two faces, world units; `None` unless both points are on faces, and these parallel within 0.1
    /// degrees.
    pub fn plane_distance(&self) -> Option<f64> {
        if self.from.kind != SnapKind::Face || self.to.kind != SnapKind::Face {
            return None;
        }
        let (a, b) = (self.from.normal.try_normalize()?, self.to.normal.try_normalize()?);
        // Faces of either side: a wall's two faces look away from each other.
        let b = if a.dot(b) < 0.0 { -b } else { b };
        let angle = a.cross(b).length().atan2(a.dot(b)).to_degrees();
        (angle <= PARALLEL_DEG).then(|| self.difference().dot((a + b).normalize_or(a)).abs())
    }

    /// Distance and differences along the axes in a unit, such as `1.250 m  (dx 0.300, dy 0.000, dz 1.214)`; between parallel
    /// faces followed by `, planes 1.214 m`.
    pub fn shown<'a>(&'a self, unit: LengthUnit<'a>) -> impl fmt::Display + 'a {
        ShownMeasurement { measurement: self, unit }
    }
}

struct ShownMeasurement<'a> {
    measurement: &'a Measurement,
    unit: LengthUnit<'a>,
}

impl fmt::Display for ShownMeasurement<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let ShownMeasurement { measurement, unit } = self;
        let distance = measurement.distance();
        let decimals = unit.decimals(distance);
        let [dx, dy, dz] = measurement.difference().to_array().map(|along| fixed(along, decimals));
        write!(f, "{}  (dx {dx}, dy {dy}, dz {dz})", unit.show(distance))?;
        match measurement.plane_distance() {
            Some(planes) => write!(f, ", planes {} {}", fixed(planes, decimals), unit.name),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const METRES: LengthUnit = LengthUnit { name: "m", metres: 1.0 };
    const MILLIMETRES: LengthUnit = LengthUnit { name: "mm", metres: 1e-3 };

    fn between(from: DVec3, to: DVec3) -> Measurement {
        let at = |point| Snap { kind: SnapKind::Vertex, point, normal: DVec3::Z };
        Measurement { from: at(from), to: at(to) }
    }

    fn faces(from: (DVec3, DVec3), to: (DVec3, DVec3)) -> Measurement {
        let at = |(point, normal)| Snap { kind: SnapKind::Face, point, normal };
        Measurement { from: at(from), to: at(to) }
    }

    #[test]
    fn numbers_of_a_way_are_those_of_its_right_triangle() {
        for centre in [DVec3::ZERO, DVec3::new(1e7, -1e7, 3e7)] {
            let way = between(centre, centre + DVec3::new(3.0, 12.0, 4.0));
            assert_eq!(way.distance(), 13.0);
            assert_eq!((way.rise(DVec3::Y * 2.0), way.level_distance(DVec3::Y * 2.0)), (12.0, 5.0));
            assert_eq!((way.rise(DVec3::Z), way.level_distance(DVec3::Z)), (4.0, f64::sqrt(153.0)));
            assert!((way.slope_deg(DVec3::Y) - 67.380_135).abs() < 1e-6, "{}", way.slope_deg(DVec3::Y));
            let back = Measurement { from: way.to, to: way.from };
            assert_eq!(back.slope_deg(DVec3::Z), -way.slope_deg(DVec3::Z));
        }
        assert_eq!(between(DVec3::ZERO, DVec3::Y).slope_deg(DVec3::Y), 90.0);
        assert_eq!(between(DVec3::ONE, DVec3::ONE).slope_deg(DVec3::Z), 0.0);
    }

    #[test]
    fn planes_of_parallel_faces_have_a_distance() {
        let turned = |degrees: f64| DVec3::new(degrees.to_radians().sin(), 0.0, degrees.to_radians().cos());
        let to = DVec3::new(5.0, -7.0, 2.0);
        for (normal, expected) in [
            (DVec3::Z, Some(2.0)),
            (DVec3::NEG_Z, Some(2.0)),
            (turned(0.11), None),
            (DVec3::X, None),
            (DVec3::ZERO, None),
        ] {
            assert_eq!(faces((DVec3::ZERO, DVec3::Z), (to, normal)).plane_distance(), expected, "{normal}");
        }
        // Nearly parallel: the same from both ends.
        let nearly = faces((DVec3::ZERO, DVec3::Z), (to, -turned(0.09)));
        let back = Measurement { from: nearly.to, to: nearly.from };
        assert_eq!(nearly.plane_distance(), back.plane_distance());
        assert!((nearly.plane_distance().unwrap() - 2.0).abs() < 0.01);
        assert_eq!(between(DVec3::ZERO, DVec3::Z).plane_distance(), None, "vertices have no planes");
    }

    #[test]
    fn measurements_are_written_with_their_unit() {
        let way = between(DVec3::splat(1e7), DVec3::splat(1e7) + DVec3::new(0.3, -0.0004, 1.2138));
        assert_eq!(way.shown(METRES).to_string(), "1.250 m  (dx 0.300, dy 0.000, dz 1.214)");
        let way = faces((DVec3::ZERO, DVec3::Z), (DVec3::new(3.0, 0.0, -4.0), DVec3::NEG_Z));
        assert_eq!(
            way.shown(MILLIMETRES).to_string(),
            "5.000 mm  (dx 3.000, dy 0.000, dz -4.000), planes 4.000 mm"
        );
        assert_eq!(
            between(DVec3::ONE, DVec3::ONE).shown(METRES).to_string(),
            "0.000 m  (dx 0.000, dy 0.000, dz 0.000)"
        );
    }

    #[test]
    fn lengths_are_written_to_the_millimetre_or_to_four_digits() {
        let feet = LengthUnit { name: "ft", metres: 0.3048 };
        for (unit, length, expected) in [
            (METRES, 1234.5678, "1234.568 m"),
            (METRES, 0.012_345, "0.01235 m"),
            (METRES, 1e-30, "0.000000000 m"),
            (METRES, f64::NAN, "NaN m"),
            (MILLIMETRES, 1234.5678, "1235 mm"),
            (MILLIMETRES, 12.345_678, "12.35 mm"),
            (MILLIMETRES, 0.0, "0 mm"),
            (MILLIMETRES, -0.4, "-0.4000 mm"),
            (feet, 10.0, "10.000 ft"),
        ] {
            assert_eq!(unit.show(length), expected);
        }
        assert_eq!(fixed(-0.0004, 3), "0.000");
        assert_eq!(fixed(-0.0006, 3), "-0.001");
    }
}
