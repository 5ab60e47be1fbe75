use super::*;
use crate::lab::keyframes::CameraPath;

const FPS: f64 = 30.0;

/// Random smooth motions: sums of sines.
struct Wave(Vec<(f64, f64, DVec3)>);

impl Wave {
    fn new(random: &mut oorandom::Rand64, size: f64) -> Self {
        let wave = |_| {
            let mut unit = || 2.0 * random.rand_float() - 1.0;
            (0.3 + 2.0 * unit().abs(), 6.0 * unit(), size * DVec3::new(unit(), unit(), unit()))
        };
        Wave((0..4).map(wave).collect())
    }

    fn at(&self, t: f64) -> DVec3 {
        self.0.iter().map(|(speed, phase, size)| *size * (speed * t + phase).sin()).sum()
    }
}

fn camera(eye: DVec3, target: DVec3) -> Camera {
    Camera {
        eye: eye.into(),
        target: target.into(),
        up: [0.0, 0.0, 1.0],
        projection: Projection::Perspective { fov_y_deg: 60.0 },
        width: 64,
        height: 48,
    }
}

fn record(frames: &[Keyframe]) -> Route {
    let mut recorder = Recorder::new(Tolerance::default());
    for frame in frames {
        recorder.add(frame.t, frame.camera).unwrap();
    }
    recorder.finish().unwrap()
}

/// Frames of a motion by time.
fn frames(count: u32, camera: impl Fn(f64) -> Camera) -> Vec<Keyframe> {
    let times = (0..count).map(|frame| f64::from(frame) / FPS);
    times.map(|t| Keyframe { t, camera: camera(t), cut: false }).collect()
}

/// The largest deviation of what is played from the frames, as a share of the tolerance. Shares nothing with the
/// recorder: angles come from differences of unit vectors.
fn worst(path: &CameraPath, frames: &[Keyframe]) -> f64 {
    let tolerance = Tolerance::default();
    let of = |frame: &Keyframe| {
        let (_, played) = path.at(frame.t);
        let (rays, wanted) = (played.rays().unwrap(), frame.camera.rays().unwrap());
        let distance = DVec3::from(frame.camera.target).distance(wanted.eye());
        let degrees = |a: DVec3, b: DVec3| {
            let (a, b) = (a.normalize_or_zero(), b.normalize_or_zero());
            (2.0 * (0.5 * (a - b).length()).asin()).to_degrees()
        };
        let (row, wanted_row) = (rays.pixel_steps().0, wanted.pixel_steps().0);
        let turn = degrees(rays.forward(), wanted.forward()).max(degrees(row, wanted_row));
        let lens = match (played.projection, frame.camera.projection) {
            (Projection::Perspective { fov_y_deg: a }, Projection::Perspective { fov_y_deg: b }) => a - b,
            (a, b) if a == b => 0.0,
            _ => f64::INFINITY,
        };
        (rays.eye().distance(wanted.eye()) / distance / tolerance.eye)
            .max(turn.max(lens.abs()) / tolerance.degrees)
    };
    frames.iter().map(of).fold(0.0, f64::max)
}

fn path(keyframes: &[Keyframe]) -> CameraPath {
    CameraPath::new(keyframes.to_vec(), FPS).unwrap()
}

#[test]
fn random_smooth_motions_stay_within_tolerance_and_no_keyframe_could_be_left_out() {
    let (mut recorded, mut kept) = (0, 0);
    for seed in 0..24 {
        let mut random = oorandom::Rand64::new(seed);
        let centre = if seed % 2 == 0 { DVec3::ZERO } else { DVec3::new(1e7, -3e6, 2e7) };
        let (eye, target) = (Wave::new(&mut random, 1.0), Wave::new(&mut random, 1.5));
        let mut t = 0.0;
        let motion: Vec<Keyframe> = (0..400)
            .map(|_| {
                t += (0.5 + random.rand_float()) / FPS;
                let mut camera = camera(centre + eye.at(t), centre + target.at(t) + DVec3::X * 9.0);
                camera.projection = Projection::Perspective { fov_y_deg: 60.0 + 5.0 * t.sin() };
                Keyframe { t, camera, cut: false }
            })
            .collect();
        let route = record(&motion);
        let keys = route.keyframes();
        assert!(keys.iter().all(|key| !key.cut), "seed {seed}");
        assert_eq!((keys[0], keys[keys.len() - 1]), (motion[0], motion[399]), "seed {seed}");
        assert!(keys.iter().all(|key| motion.contains(key)), "seed {seed}: not recorded");
        let most = worst(&path(keys), &motion);
        assert!(most <= 1.0 + 1e-5, "seed {seed}: {most}");
        for index in 1..keys.len() - 1 {
            let without = [&keys[..index], &keys[index + 1..]].concat();
            let most = worst(&path(&without), &motion);
            assert!(most > 1.0 - 1e-5, "seed {seed}: keyframe {index} is not needed, {most}");
        }
        (recorded, kept) = (recorded + motion.len(), kept + keys.len());
    }
    assert!(kept * 5 < recorded, "{kept} of {recorded}");
}

#[test]
fn straight_even_motions_need_two_keyframes() {
    for seed in 0..50 {
        let mut random = oorandom::Rand64::new(seed);
        let mut unit = || 2.0 * random.rand_float() - 1.0;
        let mut vector = || DVec3::new(unit(), unit(), unit());
        let centre = 10f64.powi((seed % 8) as i32) * vector();
        let (speed, ahead) = (vector() * 3.0, DVec3::new(5.0, 0.0, 0.0) + vector());
        let motion = frames(300, |t| camera(centre + t * speed, centre + ahead + t * speed));
        let route = record(&motion);
        assert_eq!(route.keyframes(), [motion[0], motion[299]], "seed {seed}");
    }
}

#[test]
fn a_pause_stays_a_pause() {
    // To the right, a rest of two seconds, on around a corner.
    let eye = |t: f64| match t {
        t if t < 1.0 => DVec3::new(4.0 * t, 0.0, 0.0),
        t if t < 3.0 => DVec3::new(4.0, 0.0, 0.0),
        t => DVec3::new(4.0 + (t - 3.0).powi(2), 3.0 * (t - 3.0), 0.0),
    };
    for centre in [DVec3::ZERO, DVec3::new(1e7, -3e6, 2e7)] {
        let motion = frames(150, |t| camera(centre + eye(t), centre + DVec3::new(2.0, 9.0, -1.0)));
        let route = record(&motion);
        assert!(worst(&path(route.keyframes()), &motion) <= 1.0 + 1e-5);
        let rest = DVec3::from(motion[45].camera.eye);
        for frame in &motion[31..90] {
            let moved = rest.distance(route.camera_at(frame.t).unwrap().eye.into());
            assert!(moved <= 2e-5 + 1e-8, "{moved} at {}", frame.t);
        }
        // Its ends, and the frame beside each: with less, the splines around it would move it.
        let times: Vec<f64> = route.keyframes().iter().map(|key| key.t).collect();
        let of_pause: Vec<&f64> = times.iter().filter(|&&t| (1.0..=3.0).contains(&t)).collect();
        assert_eq!(of_pause, [&motion[30].t, &motion[31].t, &motion[89].t, &motion[90].t]);
    }
}

#[test]
fn jumps_become_cuts() {
    let round = |t: f64| DVec3::new((0.7 * t).cos(), (0.7 * t).sin(), 0.2 * t);
    let mut motion = frames(200, |t| {
        let centre = if t < 2.0 { DVec3::ZERO } else { DVec3::new(500.0, 40.0, 0.0) };
        camera(centre + 8.0 * round(t), centre + DVec3::new(0.0, 0.0, 1.0))
    });
    for frame in &mut motion[150..] {
        frame.camera.projection = Projection::Orthographic { height: 9.0 };
    }
    let route = record(&motion);
    let cuts: Vec<f64> = route.keyframes().iter().filter(|key| key.cut).map(|key| key.t).collect();
    assert_eq!(cuts, [motion[60].t, motion[150].t]);
    assert!(worst(&path(route.keyframes()), &motion) <= 1.0 + 1e-5);

    // A small one is one when it is called so, and a fast motion is none.
    let fast = |t: f64| camera(DVec3::new(0.0, 60.0 * t, 0.0), DVec3::new(1.0, 60.0 * t, 0.0));
    let mut recorder = Recorder::new(Tolerance::default());
    for (index, frame) in frames(20, fast).iter().enumerate() {
        if index == 7 {
            recorder.cut();
        }
        recorder.add(frame.t, frame.camera).unwrap();
    }
    let route = recorder.finish().unwrap();
    let kept: Vec<(f64, bool)> = route.keyframes().iter().map(|key| (key.t, key.cut)).collect();
    assert_eq!(kept, [(0.0, false), (6.0 / FPS, false), (7.0 / FPS, true), (19.0 / FPS, false)]);
}

#[test]
fn anything_can_be_recorded_and_no_tolerance_keeps_what_is_not_even() {
    for seed in 0..20 {
        let mut random = oorandom::Rand64::new(seed);
        let mut unit = || 2.0 * random.rand_float() - 1.0;
        let mut vector = || DVec3::new(unit(), unit(), unit());
        let noise: Vec<Keyframe> = frames(60, |_| camera(DVec3::ZERO, DVec3::X))
            .into_iter()
            .map(|frame| Keyframe { camera: camera(vector() * 0.1, DVec3::X + vector() * 0.1), ..frame })
            .collect();
        let mut recorder = Recorder::new(Tolerance { eye: 0.0, degrees: -1.0 });
        noise.iter().for_each(|frame| recorder.add(frame.t, frame.camera).unwrap());
        assert_eq!(recorder.finish().unwrap().keyframes(), noise, "seed {seed}");
    }
}

#[test]
fn bad_frames_are_refused_and_the_recording_goes_on() {
    let good = camera(DVec3::ZERO, DVec3::X);
    let mut recorder = Recorder::new(Tolerance::default());
    assert!(recorder.clone().finish().unwrap().keyframes().is_empty());
    recorder.add(1.0, good).unwrap();
    assert_eq!(recorder.clone().finish().unwrap().keyframes().len(), 1);
    for t in [1.0, 0.5, f64::NAN, f64::INFINITY] {
        assert!(matches!(recorder.add(t, good), Err(PathError::Time(1))), "{t}");
    }
    assert!(matches!(recorder.add(8000.0, good), Err(PathError::TooLong(_))));
    assert!(recorder.add(2.0, Camera { target: good.eye, ..good }).is_err());
    recorder.add(3.0, good).unwrap();
    // Another size of the window is no other camera.
    recorder.add(4.0, Camera { width: 9, ..good }).unwrap();
    let route = recorder.finish().unwrap();
    assert_eq!(route.keyframes().iter().map(|key| key.t).collect::<Vec<_>>(), [1.0, 4.0]);
}
