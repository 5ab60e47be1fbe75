//! Seeded views: most of them inside the model, where occlusion happens, some from outside.
//!
//! A place is drawn anywhere in the model's box and kept when an eye fits there: not in a part, not in a corner, with
//! something around it. A direction is kept when the camera sees more than a near wall, and more than the sky. What was
//! turned down is counted, so that a report can say how its views came about.

use std::f64::consts::TAU;

use glam::DVec3;
use serde::Serialize;

use super::space::Space;
use crate::camera::{Camera, CameraRays, Projection};

/// One view of a comparison.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct View {
    /// For people: `inside 3`, `frame 17`.
    pub name: String,
    /// The camera, so that anyone can repeat it.
    pub camera: Camera,
    /// Nothing of the view before may be used: the eye has jumped.
    pub starts_anew: bool,
}

/// Drawn places and directions that were not used, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Rejected {
    /// Places in an occupied voxel or nearer to one than an eye should be.
    pub too_close: u64,
    /// Places surrounded by one single part: inside of it.
    pub in_a_part: u64,
    /// Places with too little around them: above or beside the model.
    pub in_the_open: u64,
    /// Directions that show mostly a wall at arm's length.
    pub at_a_wall: u64,
    /// Directions that show next to nothing.
    pub at_nothing: u64,
    /// Views that were kept in the open, because no place with enough around it was found.
    pub kept_in_the_open: u64,
}

impl Rejected {
    /// All that were turned down.
    pub fn total(&self) -> u64 {
        self.too_close + self.in_a_part + self.in_the_open + self.at_a_wall + self.at_nothing
    }
}

/// Why there are no views.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ViewError {
    /// The model is solid, or nearly so.
    #[error(
        "no free place for an eye was found inside the model after {attempts} attempts ({rejected:?}); \
         give a camera path instead"
    )]
    NoRoom {
        /// Places and directions tried for one view.
        attempts: u64,
        /// What was wrong with them, all views so far.
        rejected: Rejected,
    },
}

/// Which views are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ViewSettings {
    /// How many. Fewer views of the same seed are the first of more.
    pub count: u32,
    /// Another seed, other views.
    pub seed: u64,
    /// Pixels a row, rows.
    pub size: (u32, u32),
}

/// Every so manieth view is from outside.
const OUTSIDE_EVERY: u32 = 5;
/// Vertical field of view inside the model, degrees.
pub(super) const FOV_Y_DEG: f64 = 60.0;
/// Attempts for one view before the model counts as solid.
const ATTEMPTS: u64 = 20_000;
/// Directions tried at a place that is fine.
const DIRECTIONS_A_PLACE: u32 = 6;
/// Free space that an eye needs on all sides, in persons: 30 cm.
pub(super) const EYE_ROOM: f64 = 0.18;
/// Of the 26 probes around a place, so many must meet something, or it is in the open: more than the lower half. A model
/// may have no such places, being a skid or a rack: half as many will do after each [`PATIENCE`] attempts.
const LEAST_PROBES_MET: usize = 12;
/// Attempts before less is asked of a place.
const PATIENCE: u64 = ATTEMPTS / 5;
/// Of the probes that met something, more than this share on one part means inside of it.
const ONE_PART_SHARE: f64 = 0.85;
/// Rays a side that look at what a direction shows.
const LOOK_SIDE: u32 = 12;
/// A wall nearer than this is at arm's length, in persons: 1.5 m.
const ARM: f64 = 0.9;
/// More than this share of a view at arm's length is a wall.
const WALL_SHARE: f64 = 0.3;
/// Less than this share of a view on the model is nothing.
const NOTHING_SHARE: f64 = 0.25;

/// Draws views inside and outside of a model, and tells what was rejected.
///
/// # Errors
///
/// There is no room inside.
pub fn random_views(space: &Space, settings: &ViewSettings) -> Result<(Vec<View>, Rejected), ViewError> {
    let mut rejected = Rejected::default();
    let views: Result<Vec<View>, ViewError> = (0..settings.count)
        .map(|index| {
            // A generator for each view: how long one took to find does not change the next.
            let mut random = oorandom::Rand64::new(u128::from(settings.seed) << 32 | u128::from(index));
            let (place, camera) = if index % OUTSIDE_EVERY == OUTSIDE_EVERY - 1 {
                ("outside", outside(space, settings.size, &mut random))
            } else {
                let (camera, is_open) = inside(space, settings.size, &mut random, &mut rejected)?;
                rejected.kept_in_the_open += u64::from(is_open);
                (if is_open { "in the open" } else { "inside" }, camera)
            };
            Ok(View { name: format!("{place} {index}"), camera, starts_anew: true })
        })
        .collect();
    Ok((views?, rejected))
}

/// The whole model from a random direction, from a little below its horizon to high above.
fn outside(space: &Space, (width, height): (u32, u32), random: &mut oorandom::Rand64) -> Camera {
    let (yaw, pitch) = (TAU * random.rand_float(), -0.15 + 1.1 * random.rand_float());
    Camera::around(space.min, space.max, space.direction(yaw, pitch), space.up, width, height)
}

/// A random eye in free space that sees something, and whether less had to be asked of its place.
pub(super) fn inside(
    space: &Space,
    size: (u32, u32),
    random: &mut oorandom::Rand64,
    rejected: &mut Rejected,
) -> Result<(Camera, bool), ViewError> {
    for attempt in 0..ATTEMPTS {
        let lowered = attempt / PATIENCE;
        let least_probes = (LEAST_PROBES_MET >> lowered).max(1);
        let share = DVec3::new(random.rand_float(), random.rand_float(), random.rand_float());
        let eye = space.min + share * (space.max - space.min);
        if !is_place(space, eye, least_probes, rejected) {
            continue;
        }
        for _ in 0..DIRECTIONS_A_PLACE {
            let (yaw, pitch) = (TAU * random.rand_float(), -0.35 + 0.6 * random.rand_float());
            let camera = looking(space, eye, space.direction(yaw, pitch), size);
            if camera.rays().is_ok_and(|rays| is_view(space, &rays, rejected)) {
                return Ok((camera, lowered > 0));
            }
        }
    }
    Err(ViewError::NoRoom { attempts: ATTEMPTS, rejected: *rejected })
}

/// A camera of the laboratory's field of view.
pub(super) fn looking(space: &Space, eye: DVec3, direction: DVec3, (width, height): (u32, u32)) -> Camera {
    Camera {
        eye: eye.into(),
        target: (eye + space.person * direction).into(),
        up: space.up.into(),
        projection: Projection::Perspective { fov_y_deg: FOV_Y_DEG },
        width,
        height,
    }
}

/// Does an eye fit here, in the model but not in a part of it?
fn is_place(space: &Space, eye: DVec3, least_probes: usize, rejected: &mut Rejected) -> bool {
    if space.is_occupied(eye) {
        rejected.too_close += 1;
        return false;
    }
    let met: Vec<_> = probes().filter_map(|direction| space.first_voxel(eye, direction)).collect();
    if met.iter().any(|first| first.distance < EYE_ROOM * space.person) {
        rejected.too_close += 1;
        return false;
    }
    if met.len() < least_probes {
        rejected.in_the_open += 1;
        return false;
    }
    let commonest = met.iter().map(|one| met.iter().filter(|other| other.owner == one.owner).count()).max();
    if commonest.unwrap_or(0) as f64 > ONE_PART_SHARE * met.len() as f64 {
        rejected.in_a_part += 1;
        return false;
    }
    true
}

/// Is there more to see than a wall or the sky?
fn is_view(space: &Space, camera: &CameraRays, rejected: &mut Rejected) -> bool {
    let (width, height) = camera.size();
    let at = |index: u32, length: u32| (f64::from(index) + 0.5) / f64::from(LOOK_SIDE) * f64::from(length);
    let looks = (0..LOOK_SIDE * LOOK_SIDE).map(|i| (at(i % LOOK_SIDE, width), at(i / LOOK_SIDE, height)));
    let distances: Vec<f64> = looks
        .map(|(x, y)| space.clearance(camera.eye(), camera.ray(x, y).direction.normalize_or_zero()))
        .collect();
    let share = |count: usize| count as f64 / distances.len() as f64;
    if share(distances.iter().filter(|&&d| d < ARM * space.person).count()) > WALL_SHARE {
        rejected.at_a_wall += 1;
        return false;
    }
    if share(distances.iter().filter(|d| d.is_finite()).count()) < NOTHING_SHARE {
        rejected.at_nothing += 1;
        return false;
    }
    true
}

/// The 26 directions to the neighbours of a cell, length 1.
pub(super) fn probes() -> impl Iterator<Item = DVec3> {
    let steps = [-1.0, 0.0, 1.0];
    steps
        .into_iter()
        .flat_map(move |x| steps.into_iter().flat_map(move |y| steps.map(|z| DVec3::new(x, y, z))))
        .filter_map(DVec3::try_normalize)
}
