use super::*;

fn text(preferences: &Preferences) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("viewer.json");
    preferences.save_to(&path).unwrap();
    fs::read(&path).unwrap()
}

fn load(text: &str) -> Loaded {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("viewer.json");
    fs::write(&path, text).unwrap();
    let loaded = Preferences::load_from(&path);
    assert!(loaded.notes.iter().all(|note| note.starts_with(&path.display().to_string())), "{loaded:?}");
    assert_eq!(fs::read_to_string(&path).unwrap(), text, "what can be read stays as it is");
    loaded
}

#[test]
fn any_preferences_are_read_as_they_were_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("not/yet/there/viewer.json");
    assert_eq!(Preferences::load_from(&path), Loaded::default(), "no file, defaults");
    for seed in 0..100 {
        let mut random = oorandom::Rand64::new(seed);
        let mut preferences = Preferences {
            geometry_bytes: random.rand_range(16 << 20..1 << 40),
            triangles: random.rand_range(10_000..1_000_000_000),
            pixel_error: 100.0 * random.rand_float(),
            rays_per_pixel: format!("1/{}", random.rand_range(1..65_536)).parse().unwrap(),
            shadows: seed % 2 == 0,
            shadow_samples: random.rand_range(1..65) as u32,
            navigation: [Mode::Orbit, Mode::Fly, Mode::Walk][seed as usize % 3],
            fov_y_deg: 10.0 + 110.0 * random.rand_float(),
            mouse_speed: 0.05 + random.rand_float(),
            look: if seed % 3 == 0 { WindowLook::Dark } else { WindowLook::Light },
            left_panel: 80.0 + 100.0 * random.rand_float(),
            right_panel: 80.0 + 100.0 * random.rand_float(),
            ..Preferences::default()
        };
        (0..random.rand_range(0..20)).for_each(|i| preferences.remember(Path::new(&format!("/é\"{i}.vxs"))));
        preferences.save_to(&path).unwrap();
        let expected = Loaded { preferences, notes: Vec::new() };
        assert_eq!(Preferences::load_from(&path), expected, "seed {seed}");
    }
}

#[test]
fn unknown_fields_are_kept_and_missing_ones_are_defaults() {
    let loaded = load(r#"{"fov_y_deg":70,"headset":{"ipd":0.1,"on":[1,null]},"zoom":18446744073709551615}"#);
    assert!(loaded.notes.is_empty());
    assert_eq!(loaded.preferences.fov_y_deg, 70.0);
    assert_eq!(loaded.preferences.triangles, Preferences::default().triangles);
    let written: Map<String, Value> = serde_json::from_slice(&text(&loaded.preferences)).unwrap();
    assert_eq!(written["headset"], serde_json::json!({"ipd": 0.1, "on": [1, null]}));
    assert_eq!(written["zoom"], serde_json::json!(u64::MAX));
    assert_eq!(load("{}"), Loaded::default());
}

#[test]
fn values_out_of_range_are_brought_into_it_and_told() {
    let loaded = load(r#"{"geometry_bytes":1,"fov_y_deg":500,"shadow_samples":0,"left_panel":-3.5}"#);
    let found = &loaded.preferences;
    assert_eq!((found.geometry_bytes, found.shadow_samples), (16 << 20, 1));
    assert_eq!((found.fov_y_deg, found.left_panel), (120.0, 80.0));
    assert_eq!(loaded.notes.len(), 4);
    assert!(loaded.notes[2].ends_with("fov_y_deg is 500, expected 10 to 120; 120 is used"), "{loaded:?}");
    // Never written, whatever a field was set to.
    let wild = Preferences { fov_y_deg: f64::NAN, mouse_speed: f64::INFINITY, ..Preferences::default() };
    let again = load(&String::from_utf8(text(&wild)).unwrap());
    assert_eq!(again.notes, Vec::<String>::new());
    assert_eq!((again.preferences.fov_y_deg, again.preferences.mouse_speed), (10.0, 20.0));
}

#[test]
fn a_value_of_another_kind_costs_that_value_only() {
    let loaded = load(
        r#"{"navigation":"teleport","rays_per_pixel":"2/3","triangles":-1,"look":"light","recent":[7],"shadows":true}"#,
    );
    let expected = Preferences { look: WindowLook::Light, shadows: true, ..Preferences::default() };
    assert_eq!(loaded.preferences, expected);
    let told: Vec<bool> = ["navigation", "rays_per_pixel", "recent", "triangles"]
        .iter()
        .map(|name| loaded.notes.iter().any(|note| note.contains(&format!("{name} cannot be used"))))
        .collect();
    assert_eq!((told, loaded.notes.len()), (vec![true; 4], 4), "{loaded:?}");
}

#[test]
fn recent_scenes_are_twelve_newest_first_without_repeats() {
    let mut preferences = Preferences::default();
    let mut expected: Vec<PathBuf> = Vec::new();
    let mut random = oorandom::Rand64::new(5);
    for _ in 0..500 {
        let scene = PathBuf::from(format!("/scenes/{}.vxs", random.rand_range(0..20)));
        preferences.remember(&scene);
        expected.retain(|other| *other != scene);
        expected.insert(0, scene);
        expected.truncate(12);
        assert_eq!(preferences.recent().collect::<Vec<_>>(), expected, "seed 5");
    }
    preferences.forget(&expected.remove(3));
    assert_eq!(preferences.recent().collect::<Vec<_>>(), expected);
    preferences.remember(Path::new("here.vxs"));
    assert!(preferences.recent().next().unwrap().is_absolute());
    let names: Vec<String> = (0..30).map(|i| format!("\"/{}\"", i % 15)).collect();
    let loaded = load(&format!("{{\"recent\":[{}]}}", names.join(",")));
    let recent: Vec<&Path> = loaded.preferences.recent().collect();
    assert_eq!((recent.len(), recent[11]), (12, Path::new("/11")));
}

#[test]
fn a_file_cut_off_anywhere_is_moved_aside_and_the_viewer_starts() {
    let mut preferences = Preferences::default();
    preferences.remember(Path::new("/scenes/é.vxs"));
    let whole = text(&preferences);
    for end in 0..whole.len() - 1 {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("viewer.json"), &whole[..end]).unwrap();
        let loaded = Preferences::load_from(&at("viewer.json"));
        assert_eq!(loaded.preferences, Preferences::default(), "{end}");
        assert!(loaded.notes.len() == 1 && loaded.notes[0].contains("viewer.json.damaged"), "{loaded:?}");
        assert_eq!(fs::read(at("viewer.json.damaged")).unwrap(), &whole[..end]);
        assert!(!at("viewer.json").exists());
        assert_eq!(Preferences::load_from(&at("viewer.json")), Loaded::default());
    }
}

#[test]
fn damaged_files_are_never_lost() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for damage in ["first", "[]", "7"] {
        fs::write(at("viewer.json"), damage).unwrap();
        assert!(!Preferences::load_from(&at("viewer.json")).notes.is_empty());
    }
    // Damaged while the viewer ran.
    fs::write(at("viewer.json"), "fourth").unwrap();
    Preferences::default().save_to(&at("viewer.json")).unwrap();
    let names =
        ["viewer.json.damaged", "viewer.json.damaged-2", "viewer.json.damaged-3", "viewer.json.damaged-4"];
    assert_eq!(names.map(|name| fs::read_to_string(at(name)).unwrap()), ["first", "[]", "7", "fourth"]);
    assert_eq!(Preferences::load_from(&at("viewer.json")), Loaded::default());
    // A folder in its place cannot be read, is told, and stays.
    fs::create_dir(at("folder")).unwrap();
    assert!(Preferences::load_from(&at("folder")).notes[0].contains("cannot be read"));
    let error = Preferences::default().save_to(&at("folder")).unwrap_err().to_string();
    assert!(error.contains("cannot be written") && at("folder").is_dir(), "{error}");
}

#[test]
fn saving_at_the_same_time_leaves_a_whole_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("viewer.json");
    let all: Vec<Preferences> =
        [20.0, 30.0, 40.0].map(|fov_y_deg| Preferences { fov_y_deg, ..Preferences::default() }).into();
    all[0].save_to(&path).unwrap();
    std::thread::scope(|scope| {
        for preferences in &all {
            scope.spawn(|| (0..20).for_each(|_| preferences.save_to(&path).unwrap()));
        }
        for _ in 0..200 {
            let loaded = Preferences::load_from(&path);
            assert!(loaded.notes.is_empty() && all.contains(&loaded.preferences), "{loaded:?}");
        }
    });
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}
