use super::*;
use crate::camera::Projection;

fn camera(x: f64) -> Camera {
    Camera {
        eye: [x, 0.1 * x, 9.0],
        target: [x, 1.0, 0.3 * x],
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg: 50.0 },
        width: 80,
        height: 60,
    }
}

fn key(t: f64, x: f64, cut: bool) -> Keyframe {
    Keyframe { t, camera: camera(x), cut }
}

/// 0 to 2 s, a cut, 2.1 to 4 s.
fn route() -> Route {
    let keys = [key(0.0, 0.0, false), key(1.0, 4.0, false), key(2.0, 5.0, false)];
    let later = [key(2.1, 50.0, true), key(3.0, 52.0, false), key(4.0, 51.0, false)];
    Route::new([&keys[..], &later].concat(), 25.0).unwrap()
}

fn times(route: &Route) -> Vec<f64> {
    route.keyframes().iter().map(|key| key.t).collect()
}

/// No edit of the list changes the route.
fn refused(route: &Route, edit: impl FnOnce(&mut Route) -> Result<(), RouteError>) -> String {
    let mut edited = route.clone();
    let error = edit(&mut edited).unwrap_err();
    assert_eq!(&edited, route);
    error.to_string()
}

#[test]
fn export_then_import_gives_the_same_frames() {
    for seed in 0..40 {
        let mut random = oorandom::Rand64::new(seed);
        let mut t = 1e3 * random.rand_float();
        let mut keys = Vec::new();
        for index in 0..1 + seed as usize % 7 {
            t += 0.01 + random.rand_float();
            let x = 10f64.powi(index as i32) * random.rand_float();
            keys.push(key(t, x, random.rand_float() < 0.3));
        }
        let fps = 1.0 + 100.0 * random.rand_float();
        let route = Route::new(keys, fps).unwrap();
        let read = Route::from_json(&route.to_json((80, 60)).unwrap()).unwrap();
        assert_eq!(read, route, "seed {seed}");
        let frames = |route: &Route| route.path((640, 480)).unwrap().views().unwrap();
        assert_eq!(frames(&read), frames(&route), "seed {seed}");
        let text = route.to_json((640, 480)).unwrap();
        let by_command = CameraPath::from_json(&text, None).unwrap();
        assert_eq!(by_command.views().unwrap(), frames(&route), "seed {seed}");
        assert!(by_command.keyframes().iter().all(|key| (key.camera.width, key.camera.height) == (640, 480)));
    }
}

#[test]
fn it_is_played_as_the_commands_play_it() {
    let route = route();
    let views = route.path((80, 60)).unwrap().views().unwrap();
    assert_eq!((views.len(), route.duration()), (101, 4.0));
    for (frame, view) in views.iter().enumerate() {
        assert_eq!(route.camera_at(frame as f64 / 25.0), Some(view.camera), "frame {frame}");
    }
    assert_eq!(route.camera_at(-3.0), Some(camera(0.0)));
    assert_eq!(route.camera_at(f64::NAN), Some(camera(0.0)));
    assert_eq!(route.camera_at(1e9), Some(camera(51.0)));
    assert_eq!(Route::default().camera_at(0.0), None);

    // Through its own target: there is always a camera that can be used.
    let mut there = camera(1.0);
    (there.eye, there.target) = ([0.0, 0.0, 9.0], [0.0; 3]);
    let back = Camera { eye: there.target, target: there.eye, ..there };
    let keys =
        [there, back].into_iter().zip([0.0, 1.0]).map(|(camera, t)| Keyframe { t, camera, cut: false });
    let through = Route::new(keys.collect(), 30.0).unwrap();
    assert_eq!(through.camera_at(0.5), Some(there));
    assert!(through.path((80, 60)).unwrap().views().is_err());
}

#[test]
fn keyframes_are_inserted_replaced_moved_and_removed() {
    let mut route = Route::default();
    for (t, at) in [(2.0, 0), (1.0, 0), (3.0, 2), (2.5, 2)] {
        assert_eq!(route.insert(t, camera(t)).unwrap(), at);
    }
    assert_eq!(times(&route), [1.0, 2.0, 2.5, 3.0]);
    route.replace(1, camera(7.0)).unwrap();
    assert_eq!(route.camera_at(2.0), Some(camera(7.0)));
    route.move_to(1, 1.25).unwrap();
    route.move_to(3, 13.0).unwrap();
    route.move_to(2, 12.5).unwrap();
    assert_eq!(times(&route), [1.0, 1.25, 12.5, 13.0]);
    route.change_speed(2.0).unwrap();
    assert_eq!(times(&route), [1.0, 1.125, 6.75, 7.0]);
    route.remove(0).unwrap();
    assert_eq!(times(&route), [1.125, 6.75, 7.0]);
    (0..3).for_each(|_| route.remove(0).unwrap());
    assert_eq!(route, Route::default());
}

#[test]
fn a_removed_jump_stays_a_jump_and_another_projection_makes_one() {
    let mut route = route();
    route.remove(3).unwrap();
    let cuts = |route: &Route| route.keyframes().iter().map(|key| key.cut).collect::<Vec<_>>();
    assert_eq!(cuts(&route), [false, false, false, true, false]);
    route.set_cut(3, false).unwrap();
    route.replace(1, Camera { projection: Projection::Orthographic { height: 5.0 }, ..camera(4.0) }).unwrap();
    assert_eq!(cuts(&route), [false, true, true, false, false]);
    route.set_cut(1, false).unwrap();
    assert!(cuts(&route)[1], "nothing is between two kinds of projection");
    // Another size is no reason to refuse: keyframes have the size of the first.
    route.replace(4, Camera { width: 1, ..camera(3.0) }).unwrap();
    assert_eq!(route.keyframes()[4].camera, camera(3.0));
}

#[test]
fn reversed_it_plays_backwards() {
    let route = route();
    let mut reversed = route.clone();
    reversed.reverse().unwrap();
    let cuts: Vec<bool> = reversed.keyframes().iter().map(|key| key.cut).collect();
    assert_eq!(cuts, [false, false, false, true, false, false]);
    let steps = (0..=400).map(|step| 0.01 * f64::from(step)).filter(|t| !(1.999..2.101).contains(t));
    for t in steps {
        let (forth, back) = (route.camera_at(t).unwrap(), reversed.camera_at(4.0 - t).unwrap());
        let apart = |a: [f64; 3], b: [f64; 3]| glam::DVec3::from(a).distance(b.into());
        assert!(apart(forth.eye, back.eye) + apart(forth.target, back.target) < 1e-9, "at {t}");
    }
    reversed.reverse().unwrap();
    let near =
        |(a, b): (&Keyframe, &Keyframe)| (a.t - b.t).abs() < 1e-12 && (a.camera, a.cut) == (b.camera, b.cut);
    assert!(reversed.keyframes().iter().zip(route.keyframes()).all(near));
}

#[test]
fn what_cannot_be_walked_is_refused_and_changes_nothing() {
    let route = route();
    let insert = |t| refused(&route, |route| route.insert(t, camera(1.0)).map(drop));
    assert!(insert(2.0).contains("later"), "{}", insert(2.0));
    assert!(!insert(f64::NAN).is_empty() && insert(1e9).contains("216,000"));
    let bad = Camera { eye: camera(1.0).target, ..camera(1.0) };
    assert!(refused(&route, |route| route.replace(2, bad)).contains("keyframe 2"));
    assert!(refused(&route, |route| route.replace(6, camera(1.0))).contains("no keyframe 6"));
    assert!(refused(&route, |route| route.remove(6)).contains("has 6"));
    assert!(refused(&route, |route| route.move_to(1, 2.0)).contains("later"));
    assert!(refused(&route, |route| route.change_speed(0.0)).contains("above 0"));
    assert!(refused(&route, |route| route.change_speed(1e-9)).contains("216,000"));
    assert!(refused(&route, |route| route.set_fps(0.0)).contains("fps"));
    assert!(refused(&Route::default(), |route| route.set_fps(f64::NAN)).contains("fps"));
    assert!(Route::default().to_json((8, 8)).unwrap_err().to_string().contains("no keyframes"));
    assert!(route.to_json((0, 8)).unwrap_err().to_string().contains("pixels"));
    for text in ["", "{}", "[]", r#"{"keyframes":[]}"#] {
        let here = Route::from_json(text).unwrap_err().to_string();
        assert_eq!(here, CameraPath::from_json(text, None).unwrap_err().to_string());
    }
    let text = route.to_json((80, 60)).unwrap();
    for end in 0..text.len() {
        assert!(Route::from_json(&text[..end]).is_err(), "{end}");
    }
}
