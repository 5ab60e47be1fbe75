//! Views from the six sides, and a box brought into view.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::pose::Aim;
use super::{LEAST_DIAGONAL, NavigateError, Navigator, check_box};

/// Room around a framed box, as a factor.
const ROOM: f64 = 1.05;

/// A side to look from: a face, an edge or a corner of the box that a view cube shows. By name, or as signs along right, back and
/// up: `"front"` is `[0, -1, 0]`. In front is +Z where Y is up and -Y where Z is; right is +X in both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "SideJson")]
pub struct Side([i8; 3]);

/// As a script says it.
#[derive(Deserialize)]
#[serde(untagged)]
enum SideJson {
    Name(String),
    Signs([i8; 3]),
}

impl TryFrom<SideJson> for Side {
    type Error = String;

    fn try_from(side: SideJson) -> Result<Self, String> {
        let found = match &side {
            SideJson::Name(name) => {
                Side::NAMED.iter().find(|(_, other)| other.eq_ignore_ascii_case(name)).map(|(side, _)| *side)
            }
            SideJson::Signs(signs) => Side::new(*signs),
        };
        found.ok_or_else(|| {
            let names = Side::NAMED.map(|(_, name)| name.to_lowercase()).join(", ");
            format!("expected a side ({names}), or three of -1, 0 and 1 that are not all 0")
        })
    }
}

impl Side {
    /// From the front.
    pub const FRONT: Side = Side([0, -1, 0]);
    /// From behind.
    pub const BACK: Side = Side([0, 1, 0]);
    /// From the left.
    pub const LEFT: Side = Side([-1, 0, 0]);
    /// From the right.
    pub const RIGHT: Side = Side([1, 0, 0]);
    /// From above; the back is up in the picture.
    pub const TOP: Side = Side([0, 0, 1]);
    /// From below; the front is up in the picture.
    pub const BOTTOM: Side = Side([0, 0, -1]);
    /// From the front, right and above, at equal angles to the three axes.
    pub const ISOMETRIC: Side = Side([1, -1, 1]);

    /// Those that have names.
    pub const NAMED: [(Side, &'static str); 7] = [
        (Side::FRONT, "Front"),
        (Side::BACK, "Back"),
        (Side::LEFT, "Left"),
        (Side::RIGHT, "Right"),
        (Side::TOP, "Top"),
        (Side::BOTTOM, "Bottom"),
        (Side::ISOMETRIC, "Isometric"),
    ];

    /// Of signs along right, back and up; `None` where they are none, or all 0.
    pub fn new(signs: [i8; 3]) -> Option<Self> {
        let is_side = signs != [0; 3] && signs.iter().all(|sign| (-1..=1).contains(sign));
        is_side.then_some(Side(signs))
    }

    /// From the middle towards it, along right, back and up; of any length.
    pub fn direction(self) -> DVec3 {
        DVec3::from(self.0.map(f64::from))
    }

    pub(super) fn aim(self) -> Aim {
        let [right, back, up] = self.0.map(f64::from);
        let level = right.hypot(back);
        // Straight down and up look as from the front.
        let heading = if level > 0.0 { (-right).atan2(-back) } else { 0.0 };
        Aim { heading, pitch: (-up).atan2(level) }
    }
}

impl Navigator {
    /// Turns about the pivot to look from this side, in so many seconds; jumps when they are not above 0. The pivot stays
    /// where it is in the picture, and its size.
    pub fn look_from(&mut self, side: Side, seconds: f64) {
        let mut there = self.destination();
        let world_from_view = there.compass.orientation(side.aim());
        there.pose = there.pose.turned_about(there.pivot, world_from_view);
        self.travel_to(there, seconds);
    }

    /// Brings a box into view, all of it, in a window of this size, in so many seconds; jumps when they are not above 0. The
    /// direction of view stays: during a glide, that where it ends. The box's centre becomes the pivot.
    ///
    /// # Errors
    ///
    /// The box is none; nothing moves then.
    pub fn frame_box(
        &mut self,
        min: DVec3,
        max: DVec3,
        size: (u32, u32),
        seconds: f64,
    ) -> Result<(), NavigateError> {
        check_box(min, max)?;
        let mut there = self.destination();
        let (right, up, forward) = (there.pose.right(), there.pose.up(), there.pose.forward());
        // A point gets some room too.
        let half = (0.5 * (max - min)).max(DVec3::splat(LEAST_DIAGONAL * there.diagonal()));
        // How far the box goes from its centre along an axis of the view.
        let reach = |axis: DVec3| half.dot(axis.abs());
        let aspect = f64::from(size.0.max(1)) / f64::from(size.1.max(1));
        let tan = there.tan_half_fov();
        let depth = if there.is_parallel() {
            let height = 2.0 * ROOM * reach(up).max(reach(right) / aspect);
            there.parallel_height = Some(height);
            // As a perspective would have it, but before all of the box.
            (0.5 * height / tan).max(ROOM * reach(forward))
        } else {
            let needed = corners(half).map(|corner| {
                let wide = corner.dot(up).abs().max(corner.dot(right).abs() / aspect);
                wide / tan - corner.dot(forward)
            });
            ROOM * needed.into_iter().fold(0.0, f64::max)
        };
        there.pivot = min + 0.5 * (max - min);
        there.pose.eye = there.pivot - depth * forward;
        self.travel_to(there, seconds);
        Ok(())
    }

    /// To where another navigator is.
    fn travel_to(&mut self, mut there: Navigator, seconds: f64) {
        there.given = None;
        // The camera of a checked pose can be refused only where f64 does not tell eye and target apart; then there is nowhere
        // to go.
        let _ = self.travel(&there.camera((1, 1)), there.pivot, seconds);
    }
}

/// Corners of a box around 0.
fn corners(half: DVec3) -> [DVec3; 8] {
    let sign = |bit: usize| if bit == 0 { -1.0 } else { 1.0 };
    [0, 1, 2, 3, 4, 5, 6, 7].map(|i| half * DVec3::new(sign(i & 1), sign(i & 2), sign(i & 4)))
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::super::testing::{Random, SIZE, navigator, pixel, pixel_of};
    use super::*;

    #[test]
    fn standard_views_look_from_their_sides_and_keep_the_pivot() {
        // Towards the eye, and up in the picture, where Z is up.
        let slanted = DVec3::new(-1.0, 0.0, 1.0) / 2f64.sqrt();
        let slanted_up = DVec3::new(1.0, 0.0, 1.0) / 2f64.sqrt();
        let left_edge = Side::new([-1, 0, 1]).unwrap();
        let equal = DVec3::new(1.0, -1.0, 1.0) / 3f64.sqrt();
        let equal_up = DVec3::new(-1.0, 1.0, 2.0) / 6f64.sqrt();
        for (side, back, up) in [
            (Side::FRONT, DVec3::NEG_Y, DVec3::Z),
            (Side::BACK, DVec3::Y, DVec3::Z),
            (Side::LEFT, DVec3::NEG_X, DVec3::Z),
            (Side::RIGHT, DVec3::X, DVec3::Z),
            (Side::TOP, DVec3::Z, DVec3::Y),
            (Side::BOTTOM, DVec3::NEG_Z, DVec3::NEG_Y),
            (Side::ISOMETRIC, equal, equal_up),
            (left_edge, slanted, slanted_up),
        ] {
            for (world_up, world_from_z_up) in [
                (DVec3::Z, glam::DQuat::IDENTITY),
                (DVec3::Y, glam::DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2)),
            ] {
                let mut navigator = navigator(DVec3::ZERO, world_up);
                navigator.set_pivot(DVec3::new(5.0, -3.0, 2.0));
                let before = (pixel(&navigator, navigator.pivot()), navigator.depth());
                navigator.look_from(side, 0.0);
                let after = (pixel(&navigator, navigator.pivot()), navigator.depth());
                assert!(after.0.distance(before.0) < 1e-6 && (after.1 - before.1).abs() < 1e-9, "{side:?}");
                let camera = navigator.camera(SIZE);
                let found_back = (DVec3::from(camera.eye) - DVec3::from(camera.target)).normalize_or_zero();
                assert!(found_back.distance(world_from_z_up * back) < 1e-9, "{side:?} {found_back}");
                let found_up = DVec3::from(camera.up);
                assert!(found_up.distance(world_from_z_up * up) < 1e-9, "{side:?} {found_up}");
            }
        }
    }

    #[test]
    fn sides_have_names_or_signs() {
        let read = |text: &str| serde_json::from_str::<Side>(text);
        assert_eq!(read("\"top\"").unwrap(), Side::TOP);
        assert_eq!(read("[1,-1,1]").unwrap(), Side::ISOMETRIC);
        for wrong in ["\"north\"", "[0,0,0]", "[2,0,0]", "[1,0]"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
        assert!(read("[0,0,0]").unwrap_err().to_string().contains("front, back"));
    }

    #[test]
    fn a_framed_box_is_all_in_view_and_fills_it() {
        let mut random = Random::new(41);
        for round in 0..600 {
            let mut navigator = navigator(DVec3::ZERO, [DVec3::Y, DVec3::Z][round % 2]);
            navigator.set_parallel(round.is_multiple_of(3));
            navigator.orbit(random.vector().truncate() * 900.0, SIZE);
            let before = navigator.pose.world_from_view;
            let (min, extent) = (random.vector() * 30.0, random.vector().abs() * 20.0);
            let extent = if round % 10 == 0 { extent * DVec3::new(1.0, 0.02, 0.02) } else { extent };
            let size = [(640, 480), (200, 900), (1920, 300), (1, 1)][round % 4];
            navigator.frame_box(min, min + extent, size, 0.0).unwrap();
            assert!(before.angle_between(navigator.pose.world_from_view) < 1e-6, "the direction stays");
            let window = DVec2::new(f64::from(size.0), f64::from(size.1));
            let half = (0.5 * extent).max(DVec3::splat(LEAST_DIAGONAL * navigator.diagonal()));
            // 1 where a corner is on the picture's border, more outside and behind the eye.
            let widest = |navigator: &Navigator| {
                let camera = navigator.camera(size);
                let of_corner = |corner: DVec3| {
                    let corner = min + 0.5 * extent + corner;
                    let depth = (corner - navigator.pose.eye).dot(navigator.pose.forward());
                    let from_middle = pixel_of(&camera, corner) / window * 2.0 - 1.0;
                    if depth > 0.0 { from_middle.abs().max_element() } else { f64::INFINITY }
                };
                corners(half).map(of_corner).into_iter().fold(0.0, f64::max)
            };
            let found = widest(&navigator);
            assert!(found <= 1.0, "seed 41, round {round}: {found}");
            // A little nearer some of it would be outside.
            navigator.given = None;
            let forward = navigator.pose.forward();
            navigator.pose.eye += (1.0 - 0.99 / ROOM) * navigator.depth() * forward;
            navigator.parallel_height = navigator.parallel_height.map(|height| height * 0.99 / ROOM);
            let nearer = widest(&navigator);
            assert!(nearer > 1.0, "seed 41, round {round}: {nearer}");
        }
    }

    #[test]
    fn framing_during_a_glide_looks_from_where_that_ends() {
        let mut navigator = navigator(DVec3::ZERO, DVec3::Z);
        navigator.look_from(Side::TOP, 1.0);
        navigator.advance(0.1);
        navigator.frame_box(DVec3::ZERO, DVec3::ONE, SIZE, 1.0).unwrap();
        assert!(navigator.is_gliding());
        navigator.advance(2.0);
        assert!(navigator.pose.forward().distance(DVec3::NEG_Z) < 1e-9);
        assert_eq!(navigator.pivot(), DVec3::splat(0.5));
        let before = navigator.camera(SIZE);
        let inside_out = navigator.frame_box(DVec3::ONE, DVec3::ZERO, SIZE, 0.0);
        assert!(matches!(inside_out, Err(NavigateError::Bounds { .. })));
        assert_eq!(navigator.camera(SIZE), before);
    }
}
