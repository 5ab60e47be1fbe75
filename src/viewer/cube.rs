//! The view cube: a small picture of the world's sides in the corner, to see and to choose where one looks from.
//!
//! Places are in half sides of the picture from its middle, x to the right and y up: the cube fits however it
//! is turned.

use glam::{DMat3, DVec2, DVec3};

use super::navigate::Side;

/// Half the cube's side: its corners are sqrt(3) times as far from its middle.
const HALF: f64 = 0.55;
/// A face's middle reaches so far from its own middle, as a share of half a side; beyond are edges and corners.
const FACE: f64 = 0.6;

/// A view of the cube.
#[derive(Clone, Copy, Debug)]
pub struct Cube {
    /// Right, up and towards who looks, from right, back and up of the world.
    view_from_sides: DMat3,
}

/// A face that is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Which.
    pub side: Side,
    /// Its name.
    pub name: &'static str,
    /// Its corners, in order.
    pub corners: [DVec2; 4],
    /// How straight it is looked at: 1 is straight.
    pub facing: f64,
}

impl Cube {
    /// As a camera sees it: its right and up in the picture, and the world's right, back and up; all of length 1.
    pub fn new((right, up): (DVec3, DVec3), sides: [DVec3; 3]) -> Self {
        let world_from_sides = DMat3::from_cols(sides[0], sides[1], sides[2]);
        let view_from_world = DMat3::from_cols(right, up, right.cross(up)).transpose();
        Cube { view_from_sides: view_from_world * world_from_sides }
    }

    /// The faces that are seen, with their places.
    pub fn faces(&self) -> Vec<Face> {
        let seen = |&(side, name): &(Side, &'static str)| {
            let normal = self.view_from_sides * side.direction();
            let is_face = side.direction().length_squared() < 1.5;
            (is_face && normal.z > 1e-6).then(|| {
                let (a, b) = side.direction().any_orthonormal_pair();
                let corners = [a + b, b - a, -a - b, a - b]
                    .map(|corner| (self.view_from_sides * (HALF * (side.direction() + corner))).truncate());
                Face { side, name, corners, facing: normal.z }
            })
        };
        Side::NAMED.iter().filter_map(seen).collect()
    }

    /// Where an edge or a corner is, or a face's middle; `None` on the far side.
    pub fn place_of(&self, side: Side) -> Option<DVec2> {
        let at = self.view_from_sides * (HALF * side.direction());
        (at.z > 0.0).then(|| at.truncate())
    }

    /// Where a cursor there would look from: a face's middle, an edge or a corner; `None` beside the cube.
    pub fn side_at(&self, place: DVec2) -> Option<Side> {
        let sides_from_view = self.view_from_sides.transpose();
        let (origin, direction) =
            (sides_from_view * place.extend(2.0) / HALF, sides_from_view * DVec3::NEG_Z / HALF);
        // Where the ray enters the cube from -1 to 1.
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for k in 0..3 {
            if direction[k].abs() > 1e-12 {
                let (a, b) = ((-1.0 - origin[k]) / direction[k], (1.0 - origin[k]) / direction[k]);
                enter = enter.max(a.min(b));
                leave = leave.min(a.max(b));
            } else if origin[k].abs() > 1.0 {
                return None;
            }
        }
        if enter > leave {
            return None;
        }
        let met = origin + enter * direction;
        let sign = |at: f64| if at > FACE { 1 } else { -i8::from(at < -FACE) };
        Side::new(met.to_array().map(sign))
    }
}

#[cfg(test)]
mod tests {
    use super::super::navigate::Random;
    use super::*;

    const SIDES: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];

    #[test]
    fn the_middle_of_the_cube_is_where_one_looks_from() {
        let mut random = Random::new(11);
        for round in 0..500 {
            let forward = random.vector().normalize_or(DVec3::X);
            let right = forward.any_orthonormal_vector();
            let cube = Cube::new((right, right.cross(forward)), SIDES);
            let side = cube.side_at(DVec2::ZERO).unwrap();
            // At most as far off as a corner of the part of a face that stands for the face.
            let cos = side.direction().normalize_or_zero().dot(-forward);
            assert!(cos > 0.76, "seed 11, round {round}: {side:?} {forward} {cos}");
            assert_eq!(cube.side_at(DVec2::splat(0.99)), None);
            let faces = cube.faces();
            assert!((1..=3).contains(&faces.len()), "{faces:?}");
            for face in faces {
                assert!(face.corners.iter().all(|corner| corner.length() < 1.0));
                let middle = face.corners.iter().sum::<DVec2>() / 4.0;
                assert_eq!(cube.side_at(middle), Some(face.side), "seed 11, round {round}");
            }
        }
    }

    #[test]
    fn from_the_front_there_are_nine_places() {
        // Looking along the world's back, up is up.
        let cube = Cube::new((DVec3::X, DVec3::Z), SIDES);
        let at = |x: f64, y: f64| cube.side_at(HALF * DVec2::new(x, y));
        assert_eq!(at(0.0, 0.0), Some(Side::FRONT));
        assert_eq!(at(0.9, 0.0), Side::new([1, -1, 0]));
        assert_eq!(at(-0.9, 0.9), Side::new([-1, -1, 1]));
        assert_eq!(at(0.0, -0.9), Side::new([0, -1, -1]));
        assert_eq!(at(1.1, 0.0), None);
        assert_eq!(cube.faces().len(), 1);
    }
}
