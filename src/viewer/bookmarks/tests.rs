use super::*;
use crate::camera::Projection;

fn view(name: &str) -> Bookmark {
    let camera = Camera {
        eye: [1e7 + 0.1, -3e6, 1.0 / 3.0],
        target: [1e7 + 4.0, -3e6, 5e-324],
        up: [0.0, 0.0, 1.0],
        projection: Projection::Perspective { fov_y_deg: 60.0 },
        width: 1280,
        height: 720,
    };
    let (hidden, xray) = (vec![r"/unit/a\/b\\c".into(), "/é".into()], vec!["/unit".into()]);
    let planes = vec![SectionPlane { point: [0.1, 0.2, 0.3], normal: [0.0, 0.0, -2.0] }];
    let image = image::RgbImage::from_fn(40, 30, |x, y| image::Rgb([x as u8, y as u8, 7]));
    let thumbnail = Thumbnail::new(&image);
    Bookmark { name: name.into(), camera, hidden, shown: Vec::new(), xray, planes, thumbnail }
}

fn list(names: &[&str]) -> Bookmarks {
    let mut bookmarks = Bookmarks::default();
    for name in names {
        bookmarks.add(view(name)).unwrap();
    }
    bookmarks
}

fn names(bookmarks: &Bookmarks) -> Vec<&str> {
    bookmarks.views().iter().map(|view| view.name.as_str()).collect()
}

#[test]
fn names_are_unique_whatever_is_done() {
    let mut bookmarks = list(&["Pump", " Pump ", "", "Pump", "Pump 2", "View"]);
    assert_eq!(names(&bookmarks), ["Pump", "Pump 2", "View", "Pump 3", "Pump 2 2", "View 2"]);
    assert_eq!(bookmarks.rename(0, "Pump"), Some("Pump"));
    assert_eq!(bookmarks.rename(1, "Pump"), Some("Pump 2"), "its own name is free");
    assert_eq!(bookmarks.rename(2, "Pump"), Some("Pump 4"));
    assert_eq!(bookmarks.rename(9, "Pump"), None);
}

#[test]
fn views_are_removed() {
    let mut bookmarks = list(&["a", "b", "c", "d"]);
    assert_eq!(bookmarks.remove(1).unwrap().name, "b");
    assert_eq!(bookmarks.remove(3), None);
    assert_eq!(names(&bookmarks), ["a", "c", "d"]);
}

#[test]
fn what_others_have_saved_meanwhile_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.views.json");
    let add =
        |name: &str| Bookmarks::change(&path, |views| views.add(view(name)).map_or((), |_| ())).unwrap();
    add("Pump");
    assert_eq!(names(&add("Valve")), ["Pump", "Valve"]);
    fs::write(&path, "{").unwrap();
    assert!(Bookmarks::change(&path, |views| drop(views.remove(0))).is_err());
    assert_eq!(fs::read(&path).unwrap(), b"{");
}

#[test]
fn files_stand_beside_their_scenes() {
    for (scene, expected) in [
        ("a/plant.vxs", "a/plant.views.json"),
        ("plant.v2.VXS", "plant.v2.views.json"),
        ("/x.y/plant", "/x.y/plant.views.json"),
        ("a/.vxs", "a/.vxs.views.json"),
    ] {
        assert_eq!(Bookmarks::path_beside(Path::new(scene)), Path::new(expected));
    }
}

#[test]
fn any_numbers_and_names_are_read_as_they_were_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.views.json");
    assert_eq!(Bookmarks::load(&path).unwrap(), Bookmarks::default(), "no file, no views");
    for seed in 0..100 {
        let mut random = oorandom::Rand64::new(seed);
        // Every bit pattern of a finite number that a camera may have.
        let mut number = || {
            let bits = f64::from_bits(random.rand_u64());
            if bits.is_finite() && bits.abs() < 1e100 { bits } else { 1.5 * random.rand_float() }
        };
        let mut bookmarks = Bookmarks::default();
        for index in 0..5 {
            let mut one = view(&format!("\"{seed}\\ \u{1}é\n{index}"));
            one.camera.eye = [number(), number(), number()];
            one.camera.target = [number(), number(), number()];
            one.camera.up = [number(), number(), number()];
            one.planes
                .push(SectionPlane { point: [number(), number(), number()], normal: [1.0, number(), 0.0] });
            // Some have coordinates that nothing can be seen from.
            let _ = bookmarks.add(one);
        }
        assert!(!bookmarks.views().is_empty(), "seed {seed}");
        bookmarks.save(&path).unwrap();
        assert_eq!(Bookmarks::load(&path).unwrap(), bookmarks, "seed {seed}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing else is left");
}

/// Loading and saving fail, with this in the message, and leave the file as it is.
fn refused(path: &Path, bytes: &[u8]) -> String {
    fs::write(path, bytes).unwrap();
    let error = Bookmarks::load(path).unwrap_err().to_string();
    assert_eq!(list(&["other"]).save(path).unwrap_err().to_string(), error);
    assert_eq!(fs::read(path).unwrap(), bytes);
    assert!(error.starts_with(&path.display().to_string()), "{error}");
    error
}

#[test]
fn files_cut_off_anywhere_are_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.views.json");
    let mut bookmarks = list(&["a", "b"]);
    bookmarks.views[1].thumbnail = None;
    bookmarks.save(&path).unwrap();
    let whole = fs::read(&path).unwrap();
    // The last byte ends the line only.
    for end in 0..whole.len() - 1 {
        refused(&path, &whole[..end]);
    }
    // Any byte may be anything: an error or other views, and never a panic.
    for seed in 0..3000 {
        let mut random = oorandom::Rand64::new(seed);
        let mut bytes = whole.clone();
        bytes[random.rand_range(0..whole.len() as u64) as usize] = random.rand_u64() as u8;
        fs::write(&path, &bytes).unwrap();
        let _ = Bookmarks::load(&path);
        assert_eq!(fs::read(&path).unwrap(), bytes, "seed {seed}");
    }
}

#[test]
fn what_is_wrong_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.views.json");
    list(&["a"]).save(&path).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    for (from, to, expected) in [
        ("\"format\": 1", "\"format\": 2, \"groups\": []", "newer Voxsight"),
        ("\"format\": 1", "\"format\": 18446744073709551615", "newer Voxsight"),
        ("\"format\": 1,", "", "missing field `format`"),
        ("\"format\": 1", "\"format\": 0", "never used"),
        ("\"format\": 1", "\"format\": 1, \"groups\": []", "unknown field `groups`"),
        ("\"xray\"", "\"x-ray\"", "unknown field `x-ray`"),
        ("\"normal\"", "\"n\"", "unknown field `n`"),
        ("\"fov_y_deg\": 60.0", "\"fov_y_deg\": 180", "the saved view \"a\": the camera's fov_y_deg"),
        ("-2.0", "0.0", "section plane"),
        ("\"thumbnail\": \"iVBO", "\"thumbnail\": \"iVBA", "thumbnail"),
    ] {
        assert!(text.contains(from), "{from} is not in {text}");
        let error = refused(&path, text.replace(from, to).as_bytes());
        assert!(error.contains(expected), "{error}");
    }
    let error = Bookmarks::load(folder.path()).unwrap_err().to_string();
    assert!(error.contains("cannot be read"), "{error}");
    let nowhere = folder.path().join("no/folder.json");
    let error = list(&["a"]).save(&nowhere).unwrap_err().to_string();
    assert!(error.contains("cannot be written"), "{error}");
}

#[test]
fn views_that_nothing_can_be_seen_by_are_refused() {
    let mut bookmarks = list(&["a"]);
    let before = bookmarks.clone();
    let mut bad = view("b");
    bad.camera.eye[1] = f64::NAN;
    assert!(matches!(bookmarks.add(bad), Err(ViewError::Camera(_))));
    for plane in [([f64::INFINITY, 0.0, 0.0], [1.0; 3]), ([0.0; 3], [0.0; 3]), ([0.0; 3], [f64::NAN; 3])] {
        let planes = vec![SectionPlane { point: plane.0, normal: plane.1 }];
        assert!(matches!(bookmarks.add(Bookmark { planes, ..view("b") }), Err(ViewError::Plane(_))));
    }
    assert_eq!(bookmarks, before);
}

#[test]
fn saving_at_the_same_time_leaves_a_whole_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.views.json");
    let lists = [list(&["a"]), list(&["b", "c", "d"]), list(&[])];
    std::thread::scope(|scope| {
        for list in &lists {
            scope.spawn(|| (0..20).for_each(|_| list.save(&path).unwrap()));
        }
        scope.spawn(|| {
            for _ in 0..200 {
                let read = Bookmarks::load(&path).unwrap();
                assert!(read.views().is_empty() || lists.contains(&read));
            }
        });
    });
    assert!(lists.contains(&Bookmarks::load(&path).unwrap()));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}
