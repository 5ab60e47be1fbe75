//! Where a moving camera will be: what it will see can be loaded before it is seen.

use glam::{DMat3, DQuat, DVec3};

use crate::camera::Camera;

/// Rotations of less than this between two frames are none.
const STILL: f64 = 1e-9;

/// The camera `frames` frames after `now`, if it goes on moving and turning as it did from `last`, the frame before. `None` when it
/// stands still, or has jumped: turned by more than an eighth of a circle, or gone farther than to what it looks at.
pub fn predicted(last: &Camera, now: &Camera, frames: f64) -> Option<Camera> {
    let (eye_before, eye) = (DVec3::from(last.eye), DVec3::from(now.eye));
    let step = eye - eye_before;
    let turn = basis(now)? * basis(last)?.transpose();
    let turn = DQuat::from_mat3(&turn);
    let (axis, angle) = turn.to_axis_angle();
    let angle = if angle > std::f64::consts::PI { angle - std::f64::consts::TAU } else { angle };
    let view = DVec3::from(now.target) - eye;
    let has_jumped = angle.abs() > std::f64::consts::FRAC_PI_4 || step.length() > view.length();
    let is_still = angle.abs() < STILL && step.length() < STILL * view.length();
    if has_jumped || is_still || now.projection != last.projection {
        return None;
    }
    let turn = DQuat::from_axis_angle(axis, angle * frames);
    let eye = eye + step * frames;
    Some(Camera {
        eye: eye.into(),
        target: (eye + turn * view).into(),
        up: (turn * DVec3::from(now.up)).into(),
        ..*now
    })
}

/// Right, up and back; `None` for a camera that is none.
fn basis(camera: &Camera) -> Option<DMat3> {
    let back = (DVec3::from(camera.eye) - DVec3::from(camera.target)).try_normalize()?;
    let right = DVec3::from(camera.up).cross(back).try_normalize()?;
    Some(DMat3::from_cols(right, back.cross(right), back))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Projection;

    /// A camera on a helix that looks along it: it moves and turns evenly.
    fn on_helix(t: f64) -> Camera {
        let turn = DQuat::from_axis_angle(DVec3::new(0.3, 1.0, 0.2).normalize_or(DVec3::Y), 0.05 * t);
        let eye = DVec3::new(1.0, 2.0, 3.0) + DVec3::new(0.2, 0.0, -0.1) * t;
        let projection = Projection::Perspective { fov_y_deg: 60.0 };
        let up = turn * DVec3::Y;
        let target = eye + turn * DVec3::new(5.0, 1.0, 0.5);
        Camera { eye: eye.into(), target: target.into(), up: up.into(), projection, width: 64, height: 64 }
    }

    #[test]
    fn even_motion_is_predicted() {
        for frames in [0.0, 1.0, 2.5, 10.0] {
            let found = predicted(&on_helix(3.0), &on_helix(4.0), frames).unwrap();
            let expected = on_helix(4.0 + frames);
            for (a, b) in
                [(found.eye, expected.eye), (found.target, expected.target), (found.up, expected.up)]
            {
                assert!(
                    (DVec3::from(a) - DVec3::from(b)).length() < 1e-6,
                    "{frames}: {found:?} {expected:?}"
                );
            }
        }
    }

    #[test]
    fn stillness_and_jumps_are_not() {
        let camera = on_helix(0.0);
        assert_eq!(predicted(&camera, &camera, 5.0), None);
        assert_eq!(predicted(&camera, &on_helix(200.0), 5.0), None, "far away");
        assert_eq!(
            predicted(&camera, &Camera { target: [-4.0, 2.0, 3.0], ..camera }, 5.0),
            None,
            "turned around"
        );
        let parallel = Camera { projection: Projection::Orthographic { height: 3.0 }, ..on_helix(1.0) };
        assert_eq!(predicted(&camera, &parallel, 5.0), None);
    }
}
