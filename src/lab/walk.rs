//! A seeded walk through a scene: a person's steps, at 30 frames a second, through free space.
//!
//! The walker steers for the longest free way near its heading and turns aside before what is in the way, so that the
//! path is smooth, as a user's is, and the eye never enters a part. Its head sways a little.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::space::Space;
use super::views::{EYE_ROOM, Rejected, View, ViewError, ViewSettings, inside, looking};

/// Way of a frame, in persons: 1.4 m/s at 30 frames a second and 1.7 m.
pub const STEP: f64 = 1.4 / 30.0 / 1.7;
/// Largest turn of a frame, radians: 75 degrees a second.
const TURN: f64 = 75.0 / 30.0 * PI / 180.0;
/// How far the walker looks ahead, in persons.
const LOOK_AHEAD: f64 = 6.0;
/// Directions considered, radians from the heading.
const WAYS: [f64; 11] = [0.0, 0.2, -0.2, 0.45, -0.45, 0.9, -0.9, 1.6, -1.6, 2.4, -2.4];
/// How much of the look-ahead a radian of turning is worth.
const STRAIGHTNESS: f64 = 0.18;
/// Frames until the walker prefers another side.
const MOOD_FRAMES: u32 = 90;

/// Draws `settings.count` frames of a walk.
///
/// # Errors
///
/// There is no room inside to start from.
pub fn walk(space: &Space, settings: &ViewSettings) -> Result<(Vec<View>, Rejected), ViewError> {
    let mut random = oorandom::Rand64::new(u128::from(settings.seed) << 32 | u128::from(u32::MAX));
    let mut rejected = Rejected::default();
    let (start, _) = inside(space, settings.size, &mut random, &mut rejected)?;
    let mut walker = Walker::new(space, start.eye.into(), TAU * random.rand_float());
    let mut views = Vec::with_capacity(settings.count as usize);
    for frame in 0..settings.count {
        if frame % MOOD_FRAMES == 0 {
            walker.mood = 0.4 * (random.rand_float() - 0.5);
        }
        let camera = looking(space, walker.eye, walker.look(frame), settings.size);
        views.push(View { name: format!("frame {frame}"), camera, starts_anew: frame == 0 });
        walker.step();
    }
    Ok((views, rejected))
}

struct Walker<'a> {
    space: &'a Space<'a>,
    eye: DVec3,
    /// Heading in the ground plane, radians.
    heading: f64,
    /// The side that is turned to while there is no way ahead.
    blocked_turn: Option<f64>,
    /// Preferred side, radians.
    mood: f64,
}

impl<'a> Walker<'a> {
    /// Starts at a free place, brought down to a person's height above what is below.
    fn new(space: &'a Space, place: DVec3, heading: f64) -> Self {
        let drop = space.clearance(place, -space.up) - space.person;
        let eye = if drop > 0.0 && drop.is_finite() { place - drop * space.up } else { place };
        let eye = if is_roomy(space, eye) { eye } else { place };
        Walker { space, eye, heading, blocked_turn: None, mood: 0.0 }
    }

    /// Where the head looks.
    fn look(&self, frame: u32) -> DVec3 {
        let seconds = f64::from(frame) / 30.0;
        let (sway, nod) = (0.2 * libm::sin(1.1 * seconds), 0.08 * libm::sin(0.7 * seconds) - 0.06);
        self.space.direction(self.heading + sway, nod)
    }

    /// Turns towards the best way, and goes on if nothing is in the way.
    fn step(&mut self) {
        let step = STEP * self.space.person;
        let ahead = self.eye + step * self.space.direction(self.heading, 0.0);
        let is_free = self.free_way(self.heading) > step && is_roomy(self.space, ahead);
        if is_free {
            self.eye = ahead;
            self.blocked_turn = None;
        }
        let best = self.best_way();
        // In a corner the best side may change with every frame: the first one holds until there is a way.
        let turn = match self.blocked_turn {
            Some(turn) => turn,
            None if is_free => best.clamp(-TURN, TURN),
            None => *self.blocked_turn.insert(if best < 0.0 { -TURN } else { TURN }),
        };
        self.heading += turn;
    }

    /// The direction from the heading, radians, where the way is long and the turn is short.
    fn best_way(&self) -> f64 {
        let look = LOOK_AHEAD * self.space.person;
        let score = |way: f64| {
            let free = self.free_way(self.heading + way).min(look) / look;
            free - STRAIGHTNESS * (way - self.mood).abs()
        };
        WAYS.into_iter().max_by(|a, b| score(*a).total_cmp(&score(*b))).unwrap_or(0.0)
    }

    /// Free way for shoulders and head, less the room that an eye needs, world units.
    fn free_way(&self, heading: f64) -> f64 {
        let direction = self.space.direction(heading, 0.0);
        let room = EYE_ROOM * self.space.person;
        let side = room * self.space.up.cross(direction);
        let ways = [DVec3::ZERO, side, -side].map(|at| self.space.clearance(self.eye + at, direction));
        ways.into_iter().fold(f64::INFINITY, f64::min) - room
    }
}

/// Is there some room around an eye? Half of what a start needs: one may pass by closely.
fn is_roomy(space: &Space, eye: DVec3) -> bool {
    let room = 0.5 * EYE_ROOM * space.person;
    !space.is_occupied(eye) && super::views::probes().all(|direction| space.clearance(eye, direction) >= room)
}
