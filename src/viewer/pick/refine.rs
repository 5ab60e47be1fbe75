//! The exact point of a drawable that a pixel shows.

use glam::{DAffine3, DVec2, DVec3, UVec2};

use crate::camera::CameraRays;
use crate::exact::TriangleHit;
use crate::ray::Ray;
use crate::visibility::QueryScene;

use super::super::screen::{Nearest, Screen};

/// Where rays are tried, in pixels from the middle of the pixel and by distance from it: the middle, those of the pixel's sides,
/// its corners, and the middles of the eight pixels around it.
const TRIED: [DVec2; 17] = [
    DVec2::new(0.0, 0.0),
    DVec2::new(-0.5, 0.0),
    DVec2::new(0.5, 0.0),
    DVec2::new(0.0, -0.5),
    DVec2::new(0.0, 0.5),
    DVec2::new(-0.5, -0.5),
    DVec2::new(0.5, -0.5),
    DVec2::new(-0.5, 0.5),
    DVec2::new(0.5, 0.5),
    DVec2::new(-1.0, 0.0),
    DVec2::new(1.0, 0.0),
    DVec2::new(0.0, -1.0),
    DVec2::new(0.0, 1.0),
    DVec2::new(-1.0, -1.0),
    DVec2::new(1.0, -1.0),
    DVec2::new(-1.0, 1.0),
    DVec2::new(1.0, 1.0),
];

/// A point on a drawable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picked {
    /// Whose point it is.
    pub drawable: u32,
    /// Index of the triangle in the drawable's chunk, as [`TriangleHit::triangle`].
    pub triangle: u32,
    /// World space, where the drawable is shown.
    pub point: DVec3,
    /// Normal of the triangle on the side that is seen, world space, length 1; zero for a triangle without area.
    pub normal: DVec3,
    /// From the eye (in a parallel projection from the plane of the eye), world units.
    pub distance: f64,
    /// Nothing else that is shown lies before the point: at level 0, too, the drawable is what is seen there. Other drawables are
    /// taken to be where the scene has them.
    pub is_confirmed: bool,
}

/// The point of a drawable that a pixel (column, row) shows, on its level-0 triangles and inside the clip planes.
///
/// It is where the ray through the pixel's middle first meets the drawable. The image may be of a coarser level, and the
/// drawable thin, so that this ray misses: rays through the pixel's sides and corners and through the pixels around it are
/// tried then, and after them the point of the drawable that is nearest to the pixel's middle in the image.
///
/// `moved` (world from world) is a rigid motion of the drawable alone: it is picked where that puts it.
///
/// `None` where no point of it can be seen in this image, even if nothing else were there: hidden by the filter, cut away, or
/// outside of the image; or where the scene has no such drawable.
pub fn refine(
    scene: &QueryScene,
    camera: &CameraRays,
    pixel: UVec2,
    drawable: u32,
    moved: Option<DAffine3>,
) -> Option<Picked> {
    let target = Target::new(scene, camera, drawable, moved)?;
    let middle = pixel.as_dvec2() + 0.5;
    let (ray, hit) = TRIED
        .iter()
        .find_map(|&offset| target.hit(middle + offset))
        .or_else(|| target.nearest_on_screen(middle))?;
    Some(target.picked(&ray, &hit))
}

/// A drawable that is picked.
struct Target<'a> {
    scene: &'a QueryScene<'a>,
    /// Brought near the scene: what is picked is told apart by small differences of depth.
    camera: CameraRays,
    /// Depth that this took away.
    nearer_by: f64,
    drawable: u32,
    moved: DAffine3,
    moved_back: DAffine3,
}

impl<'a> Target<'a> {
    fn new(
        scene: &'a QueryScene<'a>,
        camera: &CameraRays,
        drawable: u32,
        moved: Option<DAffine3>,
    ) -> Option<Self> {
        if drawable >= scene.exact.drawable_count() || scene.filter.is_hidden(drawable) {
            return None;
        }
        // What was moved may be before the scene's box, where a camera brought near to it would not see it.
        let near = if moved.is_some() { *camera } else { scene.exact.brought_near(camera) };
        let nearer_by = (near.eye() - camera.eye()).dot(camera.forward());
        let moved = moved.unwrap_or(DAffine3::IDENTITY);
        let moved_back = moved.inverse();
        let target = Target { scene, camera: near, nearer_by, drawable, moved, moved_back };
        moved_back.is_finite().then_some(target)
    }

    /// The first hit of the ray through a place in the image, and that ray.
    fn hit(&self, place: DVec2) -> Option<(Ray, TriangleHit)> {
        let ray = self.camera.ray(place.x, place.y);
        let clipped = self.scene.filter.clipped(&ray)?;
        let carried_back = Ray {
            origin: self.moved_back.transform_point3(ray.origin),
            direction: self.moved_back.transform_vector3(ray.direction),
            ..clipped
        };
        let hit = self.scene.exact.closest_of(self.drawable, &carried_back)?;
        Some((ray, hit))
    }

    /// The point that is nearest to a place in the image that no ray meets the drawable at. It is on the drawable's outline
    /// there, so that the sides of triangles are all that has to be looked at, and nothing of the drawable hides it.
    fn nearest_on_screen(&self, place: DVec2) -> Option<(Ray, TriangleHit)> {
        let exact = self.scene.exact;
        let chunk = exact.chunks().get(exact.chunk_of(self.drawable) as usize)?;
        let mut eye_from_part = self.moved * exact.world_from_part(self.drawable);
        eye_from_part.translation -= self.camera.eye();
        let screen = Screen::new(&self.camera, self.scene.filter);
        let nearest = |triangle: u32| -> Option<(Nearest, u32)> {
            let corners = chunk.triangle(triangle).map(|corner| eye_from_part.transform_point3(corner));
            Some((screen.near_outline(corners, place)?, triangle))
        };
        let all = (0..chunk.triangle_count()).filter_map(nearest);
        let (found, triangle) = all.min_by(|(a, _), (b, _)| a.compare(b))?;
        let at = found.on_screen.at;
        let hit = TriangleHit { t: found.on_screen.depth, drawable: self.drawable, triangle };
        Some((self.camera.ray(at.x, at.y), hit))
    }

    fn picked(&self, ray: &Ray, hit: &TriangleHit) -> Picked {
        let point = ray.at(hit.t);
        let normal = self.moved.transform_vector3(self.scene.exact.normal(hit));
        let mut others = self.scene.filter.clone();
        others.set_hidden(self.drawable, true);
        let before = Ray { t_max: hit.t.next_down(), ..*ray };
        Picked {
            drawable: self.drawable,
            triangle: hit.triangle,
            point,
            normal: if normal.dot(ray.direction) > 0.0 { -normal } else { normal },
            distance: ray.origin.distance(point) + self.nearer_by,
            is_confirmed: self.scene.exact.closest(&before, &others).is_none(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Plane, Projection};
    use crate::filter::Filter;
    use crate::loaded::LoadedScene;
    use crate::model::{Colour, Mesh, Model, Node, Object, Part};
    use crate::prepare::{BuildSettings, Resolution, build};
    use crate::progress::Silent;
    use crate::render::{NOBODY, RenderSettings, Renderer};
    use crate::report::Findings;
    use crate::sample::{PlantSettings, cameras, plant};
    use crate::scene::Scene;

    fn load(model: Model) -> LoadedScene {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.vxs");
        let settings = BuildSettings { resolution: Resolution::Log2(7), ..BuildSettings::default() };
        build(model, Vec::new(), Findings::default(), &settings, &path, &Silent).unwrap();
        LoadedScene::new(Scene::open(&path).unwrap(), &Silent).unwrap()
    }

    /// A square of side 2 across x and y, placed at each of these with this scale.
    fn squares(placed: &[(DVec3, f64)]) -> LoadedScene {
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let positions = corners.map(|(x, y)| DVec3::new(x, y, 0.0)).to_vec();
        let mesh = Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]] };
        let parts = vec![Part { name: "square".to_owned(), mesh }];
        let mut model = Model { parts, ..Model::default() };
        for (node, &(at, scale)) in (0..).zip(placed) {
            let world_from_part = DAffine3::from_translation(at) * DAffine3::from_scale(DVec3::splat(scale));
            model.nodes.push(Node { name: format!("square {node}"), ..Node::default() });
            model.objects.push(Object { node, part: 0, world_from_part, colour: Colour([200; 4]) });
        }
        load(model)
    }

    /// From 10 before `at`, along -z; a pixel is 0.1 wide at depth 10.
    fn camera(at: DVec3, is_parallel: bool) -> CameraRays {
        let projection = if is_parallel {
            Projection::Orthographic { height: 10.0 }
        } else {
            Projection::Perspective { fov_y_deg: 2.0 * f64::to_degrees(f64::atan(0.5)) }
        };
        let eye = (at + DVec3::Z * 10.0).into();
        Camera { eye, target: at.into(), up: [0.0, 1.0, 0.0], projection, width: 100, height: 100 }
            .rays()
            .unwrap()
    }

    #[test]
    fn what_a_picture_of_a_plant_shows_is_picked_and_confirmed() {
        let settings = PlantSettings { objects: 300, triangles: 30_000, ..PlantSettings::default() };
        let loaded = load(plant(&settings));
        let (width, height) = (160, 120);
        for view in cameras(&settings) {
            let projection = Projection::Perspective { fov_y_deg: view.fov_y_deg };
            let (eye, target, up) = (view.eye, view.target, view.up);
            let camera = Camera { eye, target, up, projection, width, height }.rays().unwrap();
            let picture = loaded.picture();
            let middles = RenderSettings::middles(DVec3::Y);
            let (film, _) = Renderer::new(&picture, &camera, &middles).rows(0..height, &Silent).unwrap();
            let mut shown = 0;
            for (i, seen) in film.pixels.iter().enumerate().step_by(7) {
                let pixel = UVec2::new(i as u32 % width, i as u32 / width);
                let picked = refine(&loaded.query(), &camera, pixel, seen.drawable, None);
                if seen.drawable == NOBODY {
                    assert_eq!(picked, None);
                    continue;
                }
                let picked = picked.unwrap_or_else(|| panic!("{}, {pixel}: nothing", view.name));
                let ray = camera.ray(f64::from(pixel.x) + 0.5, f64::from(pixel.y) + 0.5);
                let first = loaded.query().exact.closest(&ray, &Filter::default()).unwrap();
                assert!(picked.is_confirmed, "{}, {pixel}: {picked:?} {first:?}", view.name);
                assert_eq!((picked.drawable, picked.point), (seen.drawable, ray.at(first.t)), "{pixel}");
                let normal = DVec3::from(seen.normal.map(f64::from));
                assert!(picked.normal.distance(normal) < 1e-6, "{}, {pixel}: {picked:?}", view.name);
                let distance = picked.distance - ray.origin.distance(picked.point);
                assert!(distance.abs() < 1e-12, "{}, {pixel}", view.name);
                shown += 1;
            }
            assert!(shown > 200, "{}: {shown}", view.name);
        }
    }

    #[test]
    fn what_lies_behind_is_not_confirmed_unless_what_is_before_it_is_hidden_or_cut_away() {
        for centre in [DVec3::ZERO, DVec3::new(1e7, -1e7, 1e7)] {
            let mut loaded = squares(&[(centre, 1.0), (centre - DVec3::Z, 1.0)]);
            for is_parallel in [false, true] {
                *loaded.filter_mut() = Filter::default();
                let camera = camera(centre, is_parallel);
                let pick = |loaded: &LoadedScene, drawable| {
                    refine(&loaded.query(), &camera, UVec2::new(52, 47), drawable, None)
                };
                let (front, back) = (pick(&loaded, 0).unwrap(), pick(&loaded, 1).unwrap());
                assert!(front.is_confirmed && !back.is_confirmed);
                let expected = centre + DVec3::new(0.25, 0.25, 0.0);
                assert!(front.point.distance(expected) < 1e-6, "{front:?}");
                assert!(front.normal.distance(DVec3::Z) < 1e-9, "{front:?}");
                loaded.filter_mut().set_hidden(0, true);
                assert_eq!(pick(&loaded, 0), None, "hidden");
                assert!(pick(&loaded, 1).unwrap().is_confirmed);
                *loaded.filter_mut() = Filter::default();
                let plane = Plane { normal: DVec3::NEG_Z, point: centre - DVec3::Z * 0.5 };
                loaded.filter_mut().clip_by(plane);
                assert_eq!(pick(&loaded, 0), None, "cut away");
                assert!(pick(&loaded, 1).unwrap().is_confirmed);
                assert_eq!(pick(&loaded, 2), None, "no such drawable");
            }
        }
    }

    #[test]
    fn a_ray_that_just_misses_takes_the_nearest_point_in_the_image() {
        // A square of half a pixel's width, whose middle is at the place (52.7, 50) of the image.
        let thin = squares(&[(DVec3::new(0.27, 0.0, 0.0), 0.025)]);
        for is_parallel in [false, true] {
            let camera = camera(DVec3::ZERO, is_parallel);
            let at = |x, y| refine(&thin.query(), &camera, UVec2::new(x, y), 0, None).unwrap();
            let inside = |point: DVec3| (point.x - 0.27).abs() <= 0.0251 && point.y.abs() <= 0.0251;
            // Its own pixel and neighbours, by rays; then pixels farther off, by the outline.
            for (x, y) in [(52, 50), (52, 49), (53, 50), (51, 50), (40, 50), (52, 90), (90, 10)] {
                let picked = at(x, y);
                assert!(inside(picked.point) && picked.is_confirmed, "({x}, {y}): {picked:?}");
                assert!(picked.point.z.abs() < 1e-6 && (picked.normal - DVec3::Z).length() < 1e-9);
            }
            assert!((at(40, 49).point - DVec3::new(0.245, 0.025, 0.0)).length() < 1e-4, "{:?}", at(40, 49));
        }
        // What of it is cut away is not taken for the nearest.
        let mut wide = squares(&[(DVec3::ZERO, 1.0)]);
        wide.filter_mut().clip_by(Plane { normal: DVec3::X, point: DVec3::X * 0.5 });
        let camera = camera(DVec3::ZERO, false);
        let picked = refine(&wide.query(), &camera, UVec2::new(20, 52), 0, None).unwrap();
        assert!((picked.point - DVec3::new(0.5, -0.25, 0.0)).length() < 1e-6, "{picked:?}");
    }

    #[test]
    fn what_was_moved_is_picked_where_it_is_shown() {
        for centre in [DVec3::ZERO, DVec3::new(-1e7, 1e7, 1e7)] {
            let loaded = squares(&[(centre, 1.0), (centre - DVec3::Z * 2.0, 3.0)]);
            // Turned about the world's y axis through the centre, and lifted.
            let turn = DAffine3::from_rotation_y(0.5);
            let there = DAffine3::from_translation(centre + DVec3::Y * 2.0);
            let moved = there * turn * DAffine3::from_translation(-centre);
            let camera = camera(centre, false);
            let query = loaded.query();
            let picked = refine(&query, &camera, UVec2::new(54, 30), 0, Some(moved)).unwrap();
            let normal = turn.transform_vector3(DVec3::Z);
            let height = (picked.point - centre).dot(normal);
            assert!(height.abs() < 1e-6 && picked.normal.distance(normal) < 1e-6, "{picked:?}");
            let ray = camera.ray(54.5, 30.5);
            let off = (picked.point - ray.origin).cross(ray.direction).length();
            assert!(off < 1e-6 && picked.is_confirmed, "{picked:?}");
            // Where it stood, only its outline is near; behind the other square it is not confirmed.
            let before = refine(&query, &camera, UVec2::new(50, 50), 0, Some(moved)).unwrap();
            assert!((before.point - centre).y > 0.99, "{before:?}");
            let back = Some(DAffine3::from_translation(DVec3::Z * -5.0));
            assert!(!refine(&query, &camera, UVec2::new(50, 50), 0, back).unwrap().is_confirmed);
            let nowhere = Some(DAffine3::from_scale(DVec3::ZERO));
            assert_eq!(refine(&query, &camera, UVec2::new(50, 50), 0, nowhere), None);
        }
    }
}
