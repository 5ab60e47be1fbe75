//! Glides from one view to another.

use glam::{DQuat, DVec3};

use super::Navigator;
use super::pose::Pose;
use crate::camera::{Camera, CameraError, Projection};

/// A view as it is interpolated: what is looked at moves on a straight line, the eye turns about it and comes nearer or
/// recedes by equal factors in equal times. So a glide around a thing keeps it in view, and one across the scene
/// does not rush through what is near.
#[derive(Clone, Copy, Debug)]
struct Waypoint {
    target: DVec3,
    /// Of the target.
    depth: f64,
    world_from_view: DQuat,
    fov_y_deg: f64,
    /// Of a parallel projection.
    height: Option<f64>,
}

impl Waypoint {
    fn between(&self, to: &Waypoint, share: f64) -> Waypoint {
        let linear = |a: f64, b: f64| a + share * (b - a);
        let geometric = |a: f64, b: f64| a * (b / a).powf(share);
        Waypoint {
            target: self.target + share * (to.target - self.target),
            depth: geometric(self.depth, to.depth),
            world_from_view: self.world_from_view.slerp(to.world_from_view, share).normalize(),
            fov_y_deg: linear(self.fov_y_deg, to.fov_y_deg),
            height: self.height.zip(to.height).map(|(a, b)| geometric(a, b)),
        }
    }
}

/// A glide on its way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Glide {
    from: Waypoint,
    to: Waypoint,
    /// Where it ends, exactly.
    camera: Camera,
    /// The pivot there.
    pivot: DVec3,
    elapsed: f64,
    seconds: f64,
}

impl Navigator {
    /// Glides to a camera in so many seconds; jumps when they are not above 0. Its target becomes the pivot. The view there is
    /// the camera's exactly, until something moves.
    ///
    /// # Errors
    ///
    /// The camera cannot be used; nothing moves then.
    pub fn go_to(&mut self, camera: &Camera, seconds: f64) -> Result<(), CameraError> {
        self.travel(camera, camera.target.into(), seconds)
    }

    /// Is a glide on its way?
    pub fn is_gliding(&self) -> bool {
        self.glide.is_some()
    }

    /// Moves a glide on by a time in seconds.
    pub fn advance(&mut self, dt: f64) {
        let Some(mut glide) = self.glide.filter(|_| dt > 0.0) else { return };
        glide.elapsed += dt;
        if glide.elapsed >= glide.seconds {
            return self.arrive(&glide);
        }
        let share = glide.elapsed / glide.seconds;
        let eased = share * share * (3.0 - 2.0 * share);
        let at = glide.from.between(&glide.to, eased);
        let mut pose = Pose { eye: at.target, world_from_view: at.world_from_view };
        pose.eye -= at.depth * pose.forward();
        self.pose = pose;
        self.pivot = at.target;
        self.fov_y_deg = at.fov_y_deg;
        self.parallel_height = at.height;
        self.glide = Some(glide);
    }

    /// [`Navigator::go_to`] with a pivot of its own.
    pub(super) fn travel(&mut self, camera: &Camera, pivot: DVec3, seconds: f64) -> Result<(), CameraError> {
        let pose = Pose::of(camera)?;
        let depth = (DVec3::from(camera.target) - pose.eye).dot(pose.forward());
        let (fov_y_deg, height) = match camera.projection {
            Projection::Perspective { fov_y_deg } => (fov_y_deg, None),
            Projection::Orthographic { height } => (self.fov_y_deg, Some(height)),
        };
        let to = Waypoint {
            target: camera.target.into(),
            depth,
            world_from_view: pose.world_from_view,
            fov_y_deg,
            height,
        };
        // The kind of projection changes at once, where the picture changes least by it.
        let is_glide = seconds > 0.0 && seconds.is_finite();
        if is_glide {
            self.set_parallel(height.is_some());
        }
        let from = self.waypoint();
        let glide = Glide { from, to, camera: *camera, pivot, elapsed: 0.0, seconds };
        self.given = None;
        if is_glide {
            self.glide = Some(glide)
        } else {
            self.arrive(&glide)
        }
        Ok(())
    }

    /// The view as it is, towards the pivot's depth.
    fn waypoint(&self) -> Waypoint {
        let depth = self.depth();
        Waypoint {
            target: self.pose.eye + depth * self.pose.forward(),
            depth,
            world_from_view: self.pose.world_from_view,
            fov_y_deg: self.fov_y_deg,
            height: self.parallel_height,
        }
    }

    /// The view at the end of the glide, or now.
    pub(super) fn destination(&self) -> Navigator {
        let mut there = self.clone();
        if let Some(glide) = &self.glide {
            there.arrive(glide);
        }
        there
    }

    fn arrive(&mut self, glide: &Glide) {
        self.pose = Pose { eye: glide.camera.eye.into(), world_from_view: glide.to.world_from_view };
        self.pivot = glide.pivot;
        self.fov_y_deg = glide.to.fov_y_deg;
        self.parallel_height = glide.to.height;
        self.given = Some(glide.camera);
        self.glide = None;
        self.fall_speed = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::super::testing::{Boxes, Random, SIZE, navigator, pixel};
    use super::super::{Mode, Motion};
    use super::*;

    fn random_camera(random: &mut Random, round: usize) -> Camera {
        let projection = match round % 2 {
            0 => Projection::Perspective { fov_y_deg: 20.0 + 80.0 * random.unit() },
            _ => Projection::Orthographic { height: 1.0 + 50.0 * random.unit() },
        };
        let [eye, target, up] = [50.0, 50.0, 1.0].map(|scale| (random.vector() * scale).into());
        Camera { eye, target, up, projection, width: SIZE.0, height: SIZE.1 }
    }

    #[test]
    fn a_jump_and_the_end_of_a_glide_are_the_asked_camera_to_the_last_bit() {
        let mut random = Random::new(31);
        let mut navigator = navigator(DVec3::ZERO, DVec3::Z);
        for round in 0..300 {
            let camera = random_camera(&mut random, round);
            if round % 3 == 0 {
                navigator.set_camera(&camera).unwrap();
            } else {
                navigator.go_to(&camera, 0.5).unwrap();
                (0..29).for_each(|_| navigator.advance(1.0 / 60.0));
                assert!(navigator.is_gliding() && navigator.camera(SIZE) != camera);
                (0..2).for_each(|_| navigator.advance(1.0 / 60.0));
            }
            assert!(!navigator.is_gliding());
            assert_eq!(navigator.camera(SIZE), camera, "seed 31, round {round}");
            let wide = navigator.camera((7, 5));
            assert_eq!((wide.eye, wide.width, wide.height), (camera.eye, 7, 5));
            // And the navigator's own idea of it is the same picture.
            let point = DVec3::from(camera.target) + random.vector();
            let as_given = pixel(&navigator, point);
            navigator.given = None;
            assert!(pixel(&navigator, point).distance(as_given) < 1e-6, "seed 31, round {round}");
        }
    }

    #[test]
    fn a_glide_is_continuous_and_begins_where_the_view_is() {
        let mut random = Random::new(32);
        for round in 0..100 {
            let mut navigator = navigator(DVec3::ZERO, DVec3::Y);
            navigator.set_parallel(round % 2 == 1);
            let before = navigator.pose;
            navigator.go_to(&random_camera(&mut random, round), 1.0).unwrap();
            let mut last = before;
            for frame in 0..=1000 {
                navigator.advance(1e-3);
                let way = navigator.pose.eye.distance(last.eye);
                let angle = navigator.pose.world_from_view.angle_between(last.world_from_view);
                assert!(way < 2.0 && angle < 0.02, "seed 32, round {round}, frame {frame}: {way} {angle}");
                last = navigator.pose;
            }
            assert!(!navigator.is_gliding());
        }
    }

    #[test]
    fn any_motion_of_the_user_ends_a_glide_and_none_does_not() {
        let camera = random_camera(&mut Random::new(33), 0);
        let mut start = navigator(DVec3::ZERO, DVec3::Y);
        start.set_mode(Mode::Fly);
        start.go_to(&camera, 1.0).unwrap();
        start.advance(0.3);
        let (drag, nothing) = (DVec2::new(3.0, 4.0), Boxes::default());
        let ray = start.camera(SIZE).rays().unwrap().ray(9.0, 9.0);
        let ahead = Motion { forward: 1.0, ..Motion::default() };
        let ends = |motion: &dyn Fn(&mut Navigator)| {
            let mut navigator = start.clone();
            motion(&mut navigator);
            !navigator.is_gliding()
        };
        assert!(
            ends(&|n| n.orbit(drag, SIZE)) && ends(&|n| n.pan(drag, SIZE)) && ends(&|n| n.look(drag, SIZE))
        );
        assert!(ends(&|n| n.zoom(1.0, &ray, None)) && ends(&|n| n.step(0.1, &ahead, &nothing)));
        assert!(!ends(&|n| n.orbit(DVec2::ZERO, SIZE)) && !ends(&|n| n.zoom(0.0, &ray, None)));
        assert!(!ends(&|n| n.step(0.1, &Motion::default(), &nothing)));
        assert!(!ends(&|n| n.advance(f64::NAN)) && !ends(&|n| n.advance(0.6)) && ends(&|n| n.advance(0.7)));
    }

    #[test]
    fn a_camera_that_cannot_be_used_moves_nothing() {
        let mut navigator = navigator(DVec3::ZERO, DVec3::Y);
        let before = navigator.camera(SIZE);
        let bad = Camera { up: [0.0; 3], ..before };
        assert!(matches!(navigator.go_to(&bad, 1.0), Err(CameraError::Up { .. })));
        assert_eq!((navigator.camera(SIZE), navigator.is_gliding()), (before, false));
    }
}
