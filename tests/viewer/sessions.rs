//! What a user does, and what follows from it.

use std::time::Duration;

use glam::{DVec2, DVec3};
use voxsight::camera::Camera;
use voxsight::lab::keyframes::{CameraPath, Keyframe};
use voxsight::viewer::action::{Action, AxisName};
use voxsight::viewer::bookmarks::node_paths;
use voxsight::viewer::handles::{Handle, Shape};
use voxsight::viewer::measure::Snap;
use voxsight::viewer::navigate::{Motion, Side};
use voxsight::viewer::pick::Picked;
use voxsight::viewer::route::Route;
use voxsight::viewer::session::Session;
use voxsight::visibility::{Method, QuerySettings, query};

use super::{Sample, rest, wait_for};

fn act(session: &mut Session, script: &str) {
    let action: Action = serde_json::from_str(script).unwrap_or_else(|error| panic!("{script}: {error}"));
    session.act(&action).unwrap_or_else(|error| panic!("{script}: {error}"));
}

/// Drawables that the camera sees, as the document leaves them.
fn seen(session: &Session) -> Vec<bool> {
    let rays = session.camera().rays().unwrap();
    query(&session.document.shown().unmoved(), &rays, Method::Hybrid, &QuerySettings::default()).visible
}

#[test]
fn what_is_hidden_isolated_looked_through_and_cut_follows_and_is_undone() {
    let sample = Sample::new();
    let mut session = sample.session();
    let before = seen(&session);
    let scene = std::sync::Arc::clone(session.document.scene());
    let scene = scene.scene();
    // The object of a drawable that is seen.
    let drawable = before.iter().rposition(|visible| *visible).unwrap() as u32;
    let object = scene.drawable_object(drawable);
    // With its number, where several have this path.
    let path = node_paths(scene, &[scene.objects()[object as usize].node]).remove(0);
    act(&mut session, &serde_json::json!({"do": "select", "path": path}).to_string());
    assert!(session.document.selected().has(object));
    act(&mut session, r#"{"do":"isolate"}"#);
    let isolated = seen(&session);
    assert!(isolated[drawable as usize]);
    let others = (0..).zip(&isolated).filter(|(_, visible)| **visible).map(|(d, _)| scene.drawable_object(d));
    assert!(others.clone().all(|other| session.document.selected().has(other)), "others are seen");
    act(&mut session, r#"{"do":"undo"}"#);
    assert_eq!(seen(&session), before);
    act(&mut session, r#"{"do":"redo"}"#);
    assert_eq!(seen(&session), isolated);
    act(&mut session, r#"{"do":"show_all"}"#);
    act(&mut session, r#"{"do":"hide"}"#);
    assert!(!seen(&session)[drawable as usize], "hidden");
    assert_eq!(session.document.selected().count(), 0, "what is hidden is not selected any more");
    act(&mut session, r#"{"do":"undo"}"#);
    // Looked through, everything hides nothing: more is seen.
    let roots: Vec<u32> = scene.roots().collect();
    roots.iter().for_each(|&root| session.select_node(root, true));
    act(&mut session, r#"{"do":"xray"}"#);
    let through = seen(&session).iter().filter(|visible| **visible).count();
    let opaque = before.iter().filter(|visible| **visible).count();
    assert!(through > opaque, "{through} {opaque}");
    act(&mut session, r#"{"do":"show_all"}"#);
    // Cut across an axis, from either side.
    act(&mut session, r#"{"do":"clear_selection"}"#);
    act(&mut session, r#"{"do":"add_section","axis":"x","at":0.5}"#);
    let plane = session.document.shown().filter().clip_planes()[0];
    let bounds = scene.meta().bounds;
    assert!(plane.normal.dot(DVec3::from(bounds.min) - plane.point) > 0.0, "the lower side stays");
    assert!(plane.normal.dot(DVec3::from(bounds.max) - plane.point) < 0.0);
    act(&mut session, r#"{"do":"clear_sections"}"#);
    act(&mut session, r#"{"do":"add_section","axis":"x","at":0.5,"flip":true}"#);
    let other = session.document.shown().filter().clip_planes()[0];
    assert_eq!((other.normal, other.point), (-plane.normal, plane.point));
    act(&mut session, r#"{"do":"clear_sections"}"#);
    assert!(session.document.shown().filter().clip_planes().is_empty());
}

#[test]
fn moved_parts_are_elsewhere_until_they_are_moved_back() {
    let sample = Sample::new();
    let mut session = sample.session();
    session.document.select([5, 9]);
    let before = session.document.bounds([5, 9]).unwrap();
    let mean = |session: &Session| {
        let middles = [5, 9].map(|object| session.document.bounds([object]).unwrap());
        0.25 * middles.iter().map(|(min, max)| *min + *max).sum::<DVec3>()
    };
    let mean_before = mean(&session);
    act(&mut session, r#"{"do":"move","by":[3.0,0.5,-2.0]}"#);
    act(&mut session, r#"{"do":"rotate","axis":"y","degrees":90.0}"#);
    let moved = session.document.bounds([5, 9]).unwrap();
    let middle = |(min, max): (DVec3, DVec3)| 0.5 * (min + max);
    let by = mean(&session) - mean_before;
    assert!((by - DVec3::new(3.0, 0.5, -2.0)).length() < 1e-9, "{by}: turned about the parts' middles");
    let (a, b) = (before.1 - before.0, moved.1 - moved.0);
    assert!((a.x - b.z).abs() < 1e-6 && (a.z - b.x).abs() < 1e-6, "turned by 90 degrees: {a} {b}");
    let shown = session.document.shown();
    let parts = shown.moved().unwrap();
    let expected: Vec<u32> =
        [5, 9].iter().flat_map(|&object| session.document.scene().scene().object_drawables(object)).collect();
    assert_eq!(parts.drawables(), expected);
    // A ray straight down on it from above meets it.
    let over = DVec3::new(0.0, 1e3, 0.0);
    let hits = expected.iter().filter(|&&drawable| {
        let centre = middle(parts.drawable_box(drawable).unwrap());
        let ray = voxsight::ray::Ray::new(centre + over, DVec3::NEG_Y);
        parts.closest(&ray).is_some()
    });
    assert!(hits.count() > 0);
    act(&mut session, r#"{"do":"move_back"}"#);
    assert_eq!(session.document.bounds([5, 9]).unwrap(), before);
    assert!(session.document.shown().moved().is_none());
    // Every move is undone alone, a drag at once.
    session.document.select([5]);
    for _ in 0..3 {
        act(&mut session, r#"{"do":"move","by":[1.0,0.0,0.0]}"#);
    }
    act(&mut session, r#"{"do":"undo"}"#);
    assert_eq!(session.document.state().motions[&5].translation, DVec3::new(2.0, 0.0, 0.0));
    act(&mut session, r#"{"do":"move_back"}"#);
    for share in [0.1, 0.2, 0.3] {
        session.document.change_on("Drag", |state| {
            std::sync::Arc::make_mut(&mut state.motions)
                .insert(5, glam::DAffine3::from_translation(DVec3::X * share));
        });
    }
    session.document.end_gesture();
    session.document.change_on("Drag", |state| state.motions = Default::default());
    act(&mut session, r#"{"do":"undo"}"#);
    assert_eq!(session.document.state().motions[&5].translation, DVec3::X * 0.3);
    act(&mut session, r#"{"do":"undo"}"#);
    assert!(session.document.state().motions.is_empty(), "the drag is undone at once");
    // Back and forth ends where it began, whatever the sizes.
    session.document.select([5, 9, 30]);
    for degrees in [15.0, 15.0, -30.0] {
        session.act(&Action::Rotate { axis: AxisName::Y, degrees }).unwrap();
    }
    for motion in session.document.state().motions.values() {
        let off = (motion.translation.length()).max((motion.matrix3.x_axis - DVec3::X).length());
        assert!(off < 1e-9, "{motion:?}");
    }
}

#[test]
fn searches_find_reveal_and_end() {
    let sample = Sample::new();
    let mut session = sample.session();
    let scene = std::sync::Arc::clone(session.document.scene());
    let rows = session.tree.rows().len();
    let text = scene.scene().name(scene.scene().nodes().last().unwrap().name).to_owned();
    act(&mut session, &serde_json::json!({"do": "search", "text": text}).to_string());
    wait_for(&mut session, "an answer", |session| session.tree.found().is_some());
    let expected: Vec<u32> = scene.scene().find(&text).collect();
    assert_eq!(session.tree.found().unwrap(), expected);
    assert!(expected.iter().all(|&node| session.tree.row_of(node).is_some()));
    session.select_node(expected[0], false);
    act(&mut session, r#"{"do":"search","text":""}"#);
    assert!(session.tree.found().is_none() && session.tree.row_of(expected[0]).is_some(), "it is still seen");
    assert!(session.tree.rows().len() >= rows);
    act(&mut session, r#"{"do":"search","text":"no such thing"}"#);
    wait_for(&mut session, "an answer", |session| session.tree.found().is_some_and(<[u32]>::is_empty));
    assert!(session.tree.rows().is_empty());
}

#[test]
fn saved_views_come_back_with_what_was_hidden_and_cut() {
    let sample = Sample::new();
    let mut session = sample.session();
    session.document.select([3, 4, 8]);
    act(&mut session, r#"{"do":"hide"}"#);
    session.document.select([6]);
    act(&mut session, r#"{"do":"xray"}"#);
    act(&mut session, r#"{"do":"add_section","axis":"y","at":0.25}"#);
    act(&mut session, r#"{"do":"look_from","side":"left"}"#);
    rest(&mut session);
    let (state, camera) = (session.document.state().clone(), session.camera());
    act(&mut session, r#"{"do":"add_bookmark","name":"Pump room"}"#);
    // What comes before the picture does not count.
    act(&mut session, r#"{"do":"clear_sections"}"#);
    session.save_wanted(None);
    assert_eq!(session.messages, Vec::<String>::new());
    // Another day.
    let mut session = sample.session();
    assert_eq!(session.bookmarks.views().len(), 1);
    act(&mut session, r#"{"do":"go_to_bookmark","name":"Pump room"}"#);
    rest(&mut session);
    assert_eq!(session.camera(), camera);
    let found = session.document.state();
    assert_eq!((&found.hidden, &found.seen_through), (&state.hidden, &state.seen_through));
    assert_eq!(found.sections.len(), 1);
    assert_eq!(found.sections[0].plane, state.sections[0].plane);
    act(&mut session, r#"{"do":"remove_bookmark","name":"Pump room"}"#);
    assert!(sample.session().bookmarks.views().is_empty());
    let told = session.act(&Action::GoToBookmark { name: "Pump room".into() }).unwrap_err();
    assert!(told.contains("Pump room"), "{told}");
}

#[test]
fn routes_are_recorded_played_edited_and_exported() {
    let sample = Sample::new();
    let mut session = sample.session();
    act(&mut session, r#"{"do":"record","on":true}"#);
    act(&mut session, r#"{"do":"look_from","side":"front"}"#);
    rest(&mut session);
    act(&mut session, r#"{"do":"look_from","side":"right"}"#);
    rest(&mut session);
    let end = session.camera();
    act(&mut session, r#"{"do":"record","on":false}"#);
    let route = session.route.clone().unwrap();
    assert!(route.duration() > 0.5 && route.keyframes().len() > 2);
    act(&mut session, r#"{"do":"zoom_all"}"#);
    act(&mut session, r#"{"do":"play"}"#);
    wait_for(&mut session, "its end", |session| session.playing.is_none());
    let there = session.camera();
    let apart = (DVec3::from(there.eye) - DVec3::from(end.eye)).length();
    assert!(apart < 1e-2 * (DVec3::from(end.eye) - DVec3::from(end.target)).length(), "{apart}");
    let file = sample.folder.path().join("route.json");
    act(&mut session, &serde_json::json!({"do": "export_route", "file": file}).to_string());
    let path = CameraPath::from_json(&std::fs::read_to_string(&file).unwrap(), None).unwrap();
    assert!((path.views().unwrap().len() as f64 - 30.0 * route.duration()).abs() < 3.0);
    act(&mut session, r#"{"do":"speed_route","factor":2.0}"#);
    let faster = session.route.as_ref().unwrap().duration();
    assert!((2.0 * faster - route.duration()).abs() < 1e-9);
    act(&mut session, &serde_json::json!({"do": "open_route", "file": file}).to_string());
    assert!((session.route.as_ref().unwrap().duration() - route.duration()).abs() < 1e-9);
}

#[test]
fn what_cannot_be_done_is_said() {
    let sample = Sample::new();
    let mut session = sample.session();
    for action in [
        Action::Hide,
        Action::Isolate,
        Action::ZoomToSelection,
        Action::Move { by: [1.0, 0.0, 0.0] },
        Action::Rotate { axis: AxisName::X, degrees: 5.0 },
    ] {
        assert_eq!(session.act(&action).unwrap_err(), "nothing is selected", "{action:?}");
    }
    assert!(session.act(&Action::Undo).is_err() && session.act(&Action::Play).is_err());
    assert!(session.act(&Action::Record { on: false }).is_err());
    let told = session.act(&Action::Select { path: "/nowhere".into(), add: false }).unwrap_err();
    assert!(told.contains("/nowhere"), "{told}");
    session.act(&Action::LookFrom { side: Side::TOP }).unwrap();
    session.act_or_tell(&Action::Hide);
    assert_eq!(session.messages.last().unwrap(), "nothing is selected");
}

#[test]
fn an_isolated_part_is_remembered_by_itself() {
    let sample = Sample::new();
    let mut session = sample.session();
    session.document.select([7]);
    act(&mut session, r#"{"do":"isolate"}"#);
    let hidden = session.document.state().hidden.clone();
    act(&mut session, r#"{"do":"add_bookmark","name":"Alone"}"#);
    session.save_wanted(None);
    let view = &session.bookmarks.views()[0];
    assert_eq!((view.hidden.len(), view.shown.len()), (0, 1), "one path, not hundreds");
    let mut session = sample.session();
    act(&mut session, r#"{"do":"go_to_bookmark","name":"Alone"}"#);
    assert_eq!(session.document.state().hidden, hidden);
}

/// Where a point is in the session's picture, pixels.
fn pixel_of(session: &Session, point: DVec3) -> DVec2 {
    let rays = session.camera().rays().unwrap();
    let (right, down) = rays.pixel_steps();
    let away = point - rays.eye();
    let away = away / away.dot(rays.forward());
    let (width, height) = rays.size();
    let middle = 0.5 * DVec2::new(width.into(), height.into());
    middle + DVec2::new(away.dot(right), away.dot(down)) / right.length_squared()
}

#[test]
fn handles_are_dragged_and_a_drag_is_undone_at_once() {
    let sample = Sample::new();
    let mut session = sample.session();
    session.document.select([12]);
    act(&mut session, r#"{"do":"move_tool","on":true}"#);
    act(&mut session, r#"{"do":"zoom_to_selection"}"#);
    rest(&mut session);
    let rays = session.camera().rays().unwrap();
    let handles = session.handles(&rays);
    assert_eq!(handles.len(), 6);
    let Some(&(Handle::Along(AxisName::X), Shape::Arrow { from, to })) = handles.first() else { panic!() };
    let grip = from.lerp(to, 0.9);
    assert!(session.begin_drag(&rays, pixel_of(&session, grip)));
    // As far as its own length, in steps.
    for step in 1..=10 {
        let there = grip + (to - from) * f64::from(step) / 10.0;
        session.drag_to(&rays, pixel_of(&session, there));
    }
    session.end_drag();
    let moved = session.document.state().motions[&12].translation;
    assert!((moved - (to - from)).length() < 1e-4 * (to - from).length(), "{moved} {}", to - from);
    assert_eq!(session.document.undoable().0, Some("Move"));
    act(&mut session, r#"{"do":"undo"}"#);
    assert!(session.document.state().motions.is_empty());
    assert_eq!(session.document.undoable().0, None, "one change");
    // There and back again is none.
    session.begin_drag(&rays, pixel_of(&session, grip));
    session.drag_to(&rays, pixel_of(&session, grip + 0.3 * (to - from)));
    session.drag_to(&rays, pixel_of(&session, grip));
    session.end_drag();
    assert!(session.document.state().motions.is_empty() && session.document.undoable().0.is_none());
    // A section's arrow, wherever it is.
    act(&mut session, r#"{"do":"add_section","axis":"x"}"#);
    act(&mut session, r#"{"do":"move_tool","on":false}"#);
    let before = session.document.planes().next().unwrap();
    let Some(&(Handle::Section(0), Shape::Arrow { from, to })) = session.handles(&rays).first() else {
        panic!()
    };
    assert!(session.begin_drag(&rays, pixel_of(&session, 0.5 * (from + to))));
    session.drag_to(&rays, pixel_of(&session, to));
    session.end_drag();
    let by = session.document.planes().next().unwrap().point - before.point;
    assert!((by - 0.5 * (to - from)).length() < 1e-4 * (to - from).length(), "{by}");
    assert!(!session.begin_drag(&rays, DVec2::new(1.0, 1.0)), "there is nothing");
}

#[test]
fn what_moves_the_camera_ends_a_route() {
    let sample = Sample::new();
    let mut session = sample.session();
    // A route that does not begin at 0.
    let camera = session.camera();
    let there = Camera { eye: (DVec3::from(camera.eye) + DVec3::X).into(), ..camera };
    let keyframe = |t: f64, camera| Keyframe { t, camera, cut: false };
    session.route = Some(Route::new(vec![keyframe(10.0, camera), keyframe(12.0, there)], 30.0).unwrap());
    act(&mut session, r#"{"do":"play"}"#);
    session.advance(Duration::from_millis(1000), &Motion::default());
    let half = DVec3::from(session.camera().eye) - DVec3::from(camera.eye);
    assert!((half.x - 0.5).abs() < 0.2, "{half}");
    act(&mut session, r#"{"do":"look_from","side":[1,-1,0]}"#);
    assert!(session.playing.is_none());
    act(&mut session, r#"{"do":"play"}"#);
    act(&mut session, r#"{"do":"navigate","mode":"fly"}"#);
    let ahead = Motion { forward: 1.0, ..Motion::default() };
    session.advance(Duration::from_millis(10), &ahead);
    assert!(session.playing.is_none());
    act(&mut session, r#"{"do":"add_keyframe"}"#);
    assert_eq!(session.route.as_ref().unwrap().keyframes()[2].t, 14.0);
    // What is nowhere else is kept when another is recorded.
    act(&mut session, r#"{"do":"record","on":true}"#);
    let kept = session.path().with_extension("route.json");
    let path = CameraPath::from_json(&std::fs::read_to_string(&kept).unwrap(), None).unwrap();
    assert_eq!(path.keyframes().len(), 3);
    // And what is recorded when the window closes.
    session.advance(Duration::from_millis(100), &Motion::default());
    session.advance(Duration::from_millis(100), &Motion::default());
    let told = session.close();
    assert!(told.iter().any(|told| told.contains("route-2.json")), "{told:?}");
    let second = session.path().with_extension("route-2.json");
    assert!(CameraPath::from_json(&std::fs::read_to_string(&second).unwrap(), None).is_ok());
    assert!(session.close().is_empty(), "nothing is left to be kept");
    assert!(!session.path().with_extension("route-3.json").exists(), "once");
}

#[test]
fn an_escaped_drag_leaves_everything_as_it_was() {
    let sample = Sample::new();
    let mut session = sample.session();
    session.document.select([12]);
    act(&mut session, r#"{"do":"zoom_to_selection"}"#);
    act(&mut session, r#"{"do":"move_tool","on":true}"#);
    rest(&mut session);
    let rays = session.camera().rays().unwrap();
    let Some(&(_, Shape::Arrow { from, to })) = session.handles(&rays).first() else { panic!() };
    assert!(session.begin_drag(&rays, pixel_of(&session, from.lerp(to, 0.9))));
    session.drag_to(&rays, pixel_of(&session, to + 2.0 * (to - from)));
    assert!(!session.document.state().motions.is_empty());
    session.cancel_drag();
    assert!(session.document.state().motions.is_empty() && session.dragging.is_none());
    assert!(session.document.undoable().0.is_none());
    session.select_drawables(&[0, 1, 2], false);
    assert!(session.document.selected().count() >= 1 && !session.document.selected().has(12));
}

#[test]
fn two_windows_keep_each_others_views() {
    let sample = Sample::new();
    let (mut a, mut b) = (sample.session(), sample.session());
    for (session, name) in [(&mut a, "Pump"), (&mut b, "Valve")] {
        act(session, &serde_json::json!({"do": "add_bookmark", "name": name}).to_string());
        session.save_wanted(None);
    }
    act(&mut a, r#"{"do":"rename_bookmark","name":"Pump","to":"Pump room"}"#);
    let names: Vec<String> =
        sample.session().bookmarks.views().iter().map(|view| view.name.clone()).collect();
    assert_eq!(names, ["Pump room", "Valve"]);
    assert_eq!(a.bookmarks, sample.session().bookmarks);
}

#[test]
fn measured_points_come_in_order_and_snap() {
    let sample = Sample::new();
    let mut session = sample.session();
    let rays = session.camera().rays().unwrap();
    let shown = session.document.shown();
    // Two places at which something is.
    let hit = |x: f64, y: f64| {
        let ray = rays.ray(x, y);
        let hit = shown.closest(&ray)?;
        Some((
            DVec2::new(x, y),
            Picked {
                drawable: hit.drawable,
                triangle: hit.triangle,
                point: ray.at(hit.t),
                normal: shown.normal(&hit),
                distance: hit.t * ray.direction.length(),
                is_confirmed: true,
            },
        ))
    };
    let places: Vec<_> = (100..500).step_by(37).filter_map(|x| hit(x.into(), 240.0)).take(3).collect();
    assert_eq!(places.len(), 3);
    for (cursor, picked) in &places {
        session.measure_at(&rays, &shown, *cursor, picked).unwrap();
    }
    assert!(session.is_busy());
    wait_for(&mut session, "points", |session| !session.is_busy());
    assert_eq!(session.measuring.done.len(), 1);
    let near = |snap: &Snap, place: &(DVec2, Picked)| pixel_of(&session, snap.point).distance(place.0) < 11.0;
    let [measurement] = &session.measuring.done[..] else { panic!() };
    assert!(near(&measurement.from, &places[0]) && near(&measurement.to, &places[1]));
    assert!(near(session.measuring.from.as_ref().unwrap(), &places[2]));
    act(&mut session, r#"{"do":"clear_measurements"}"#);
    assert!(session.measuring.done.is_empty() && session.measuring.from.is_none());
}
