//! What clip planes cut open, drawn as solid.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use voxsight::camera::{Camera, Plane, Projection};
use voxsight::filter::Filter;
use voxsight::gpu::marks::Marks;
use voxsight::gpu::target::NOBODY;
use voxsight::loaded::LoadedScene;
use voxsight::model::{Colour, Node, Object, Part};
use voxsight::moved::Motions;
use voxsight::ray::Ray;
use voxsight::render::Lighting;
use voxsight::shown::Shown;
use voxsight::walkthrough::{Look, Walkthrough};

use super::common::{build_model, cuboid, load, random_model};
use super::context;
use super::walks::{finest, settle};

const SIZE: (u32, u32) = (320, 240);

/// Does the ray come out of what is cut away within a closed body? Then it leaves it once more often than it enters.
fn is_solid(scene: &LoadedScene, filter: &Filter, ray: &Ray) -> bool {
    let exact = scene.query().exact;
    let (Some(clipped), Some(hit)) = (filter.clipped(ray), exact.closest(ray, filter)) else {
        return false;
    };
    let (mut after, mut faces) = (clipped.t_min, 0);
    while let Some(face) = exact.closest_of(hit.drawable, &Ray { t_min: after, ..*ray }) {
        after = face.t + 1e-9;
        faces += 1;
    }
    clipped.t_min > ray.t_min && faces % 2 == 1
}

#[test]
fn caps_are_where_rays_come_out_of_what_is_cut_away_within_something_solid() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    // Boxes and tetrahedra, some of them mirrored; the third shape is an open sheet.
    let centre = DVec3::new(2e5, 1e4, -3e5);
    let mut model = random_model(11, 60, centre);
    model.objects.iter_mut().for_each(|object| {
        object.part %= 2;
        object.colour.0[3] = 255;
    });
    // Some that are wound the wrong way, where no plane cuts them: they are no caps.
    let mut inverted = cuboid();
    inverted.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
    model.parts.push(Part { name: "inverted".to_owned(), mesh: inverted });
    for at in [DVec3::new(6.0, 13.0, 22.0), DVec3::new(4.0, 2.0, 23.0), DVec3::new(5.0, 8.0, 25.0)] {
        let node = model.nodes.len() as u32;
        model.nodes.push(Node { name: "inverted".to_owned(), ..Node::default() });
        let world_from_part = DAffine3::from_translation(centre + at);
        model.objects.push(Object { node, part: 3, world_from_part, colour: Colour([200, 90, 60, 255]) });
    }
    build_model(model, 8, &path);
    let scene = Arc::new(load(&path));
    let bounds = scene.scene().meta().bounds;
    let (min, max) = (DVec3::from(bounds.min), DVec3::from(bounds.max));
    let mut filter = Filter::default();
    filter.clip_by(Plane { normal: DVec3::new(-1.0, 0.1, -0.2), point: 0.5 * (min + max) });
    filter.clip_by(Plane { normal: DVec3::new(0.1, -1.0, 0.0), point: min + 0.8 * (max - min) });
    let around = Camera::around(min, max, DVec3::new(1.0, 0.6, 0.4), DVec3::Y, SIZE.0, SIZE.1);
    let height = 1.2 * (max - min).max_element();
    let marks = Marks::default();
    for camera in [around, Camera { projection: Projection::Orthographic { height }, ..around }] {
        let mut walk = Walkthrough::new(Arc::clone(&scene), context, finest()).unwrap();
        let shown = Shown::new(Arc::clone(&scene), filter.clone(), Motions::new());
        walk.set_shown(Arc::new(shown)).unwrap();
        let mut frame = |lighting: &Lighting, caps: bool| -> (Vec<u32>, Vec<[u8; 4]>) {
            let look = Look { lighting, up: DVec3::Y, marks: &marks, shadows: None, caps };
            settle(&mut walk, &camera, &look);
            let targets = walk.renderer().targets();
            (targets.drawable.read(context).unwrap(), targets.picture.read(context).unwrap())
        };
        // In two lights: in one of them a wall may happen to be as bright as a cap.
        let [headlight, sunny] = [Lighting::headlight(), Lighting::sunny(DVec3::new(0.2, -1.0, 0.3))];
        let ((drawables, with), (_, without)) = (frame(&headlight, true), frame(&headlight, false));
        let ((_, with_sun), (_, without_sun)) = (frame(&sunny, true), frame(&sunny, false));
        let rays = camera.rays().unwrap();
        let (mut solid, mut wrong, mut uncut) = (0, 0, 0);
        for index in 0..with.len() {
            let pixel = (index as u32 % SIZE.0, index as u32 / SIZE.0);
            let ray = rays.ray(f64::from(pixel.0) + 0.5, f64::from(pixel.1) + 0.5);
            // Beside silhouettes rounding may show another drawable.
            let first = scene.query().exact.closest(&ray, &filter).map_or(NOBODY, |hit| hit.drawable);
            if first != drawables[index] {
                continue;
            }
            let expected = is_solid(&scene, &filter, &ray);
            uncut += u32::from(first != NOBODY && scene.scene().drawable_object(first) >= 60);
            solid += u32::from(expected);
            wrong += u32::from(
                expected != (with[index] != without[index] || with_sun[index] != without_sun[index]),
            );
        }
        println!("{solid} capped pixels, {wrong} otherwise");
        assert!(solid > 500 && uncut > 100, "{solid} {uncut}");
        assert!(wrong * 200 < solid, "{wrong} of {solid}");
    }
}

/// Two boxes that touch, cut along both. Rays that enter the first where it is cut and leave it where the second begins meet both
/// faces in one point.
#[test]
fn where_parts_touch_the_one_that_is_left_is_capped() {
    let Some(context) = context() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.vxs");
    let mut model = random_model(3, 0, DVec3::ZERO);
    // Its corners do not lie on its grid: they are rounded.
    let half = DVec3::new(1.0 / 3.0, 0.3, 0.7);
    let mut mesh = cuboid();
    mesh.positions.iter_mut().for_each(|corner| *corner *= half);
    model.parts = vec![Part { name: "box".to_owned(), mesh }];
    // A box from 0 to 1.
    let unit = DAffine3::from_scale(0.5 / half) * DAffine3::from_translation(half);
    let turned = DAffine3::from_axis_angle(DVec3::new(0.3, 1.0, -0.4).normalize_or_zero(), 0.7);
    let world = DAffine3::from_translation(DVec3::new(120.3, -7.7, 45.1)) * turned;
    let (first, second) = (DVec3::new(1.7, 1.3, 2.0), DVec3::new(2.3, 1.9, 2.6));
    // And something far behind, so that what a parallel projection sees reaches far.
    let beside = DVec3::X * first.x - 0.2 * DVec3::Y;
    for (at, size) in [(DVec3::ZERO, first), (beside, second), (DVec3::new(0.0, 0.0, -300.0), DVec3::ONE)] {
        let node = model.nodes.len() as u32;
        model.nodes.push(Node { name: "box".to_owned(), ..Node::default() });
        let world_from_part = world * DAffine3::from_translation(at) * DAffine3::from_scale(size) * unit;
        model.objects.push(Object { node, part: 0, world_from_part, colour: Colour([200, 90, 60, 255]) });
    }
    build_model(model, 7, &path);
    let scene = Arc::new(load(&path));
    let mut filter = Filter::default();
    let point = world.transform_point3(DVec3::Z * 1.2);
    filter.clip_by(Plane { normal: world.transform_vector3(-DVec3::Z), point });
    let looking = |eye: DVec3, target: DVec3| Camera {
        eye: world.transform_point3(eye).into(),
        target: world.transform_point3(target).into(),
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg: 40.0 },
        width: SIZE.0,
        height: SIZE.1,
    };
    let outside = looking(DVec3::new(-4.0, 2.0, 5.0), DVec3::new(1.8, 0.6, 1.2));
    let parallel = Camera { projection: Projection::Orthographic { height: 4.5 }, ..outside };
    // From within what is cut away, most of it beside and behind the eye.
    let inside = looking(DVec3::new(0.9, 0.5, 1.5), DVec3::new(1.7, 0.7, 0.8));
    // Hatching on the part's colour, between the lines and on them, and its border: sRGB of 0.8, 0.35 and 0.08 of it.
    let caps = [[181, 81, 53, 255], [124, 53, 34, 255], [61, 22, 12, 255]];
    let marks = Marks::default();
    for camera in [outside, parallel, inside] {
        let mut walk = Walkthrough::new(Arc::clone(&scene), context, finest()).unwrap();
        walk.set_shown(Arc::new(Shown::new(Arc::clone(&scene), filter.clone(), Motions::new()))).unwrap();
        let lighting = Lighting::headlight();
        let look = Look { lighting: &lighting, up: DVec3::Y, marks: &marks, shadows: None, caps: true };
        settle(&mut walk, &camera, &look);
        let targets = walk.renderer().targets();
        let drawables: Vec<u32> = targets.drawable.read(context).unwrap();
        let picture: Vec<[u8; 4]> = targets.picture.read(context).unwrap();
        let rays = camera.rays().unwrap();
        let (mut touching, mut wrong) = (0, 0);
        for index in 0..picture.len() {
            let pixel = (index as u32 % SIZE.0, index as u32 / SIZE.0);
            let ray = rays.ray(f64::from(pixel.0) + 0.5, f64::from(pixel.1) + 0.5);
            let from_world = world.inverse();
            let (origin, direction) =
                (from_world.transform_point3(ray.origin), from_world.transform_vector3(ray.direction));
            let entry = origin + (1.2 - origin.z) / direction.z * direction;
            let exit = origin + (first.x - origin.x) / direction.x * direction;
            let is_within = |at: DVec3| at.cmpgt(DVec3::splat(0.03)).all() && at.cmplt(first - 0.03).all();
            // Where it enters, and where it leaves by the common face.
            if is_within(DVec3::new(entry.x, entry.y, 1.0)) && is_within(DVec3::new(0.5, exit.y, exit.z)) {
                touching += 1;
                wrong += u32::from(drawables[index] != 0 || !caps.contains(&picture[index]));
            }
        }
        println!("{touching} pixels where both faces are, {wrong} of them not capped");
        assert!(touching > 1000 && wrong == 0, "{wrong} of {touching}");
    }
}
