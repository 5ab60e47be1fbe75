//! The vertex, edge or face under the cursor.

use glam::{DAffine3, DVec2, DVec3};

use crate::camera::CameraRays;
use crate::exact::intersect::{PartRay, intersect};
use crate::filter::Filter;
use crate::ray::Ray;

use super::super::pick::Picked;
use super::super::screen::{Nearest, Screen};
use super::Features;

/// Something hides a point when it is nearer than that by more than this many pixels' width: less is rounding.
const HIDES_PX: f64 = 0.01;

/// What a point of a measurement lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SnapKind {
    /// A vertex.
    Vertex,
    /// A feature edge.
    Edge,
    /// Anywhere on a face.
    Face,
}

/// A point to measure from or to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Snap {
    /// What it lies on.
    pub kind: SnapKind,
    /// World space.
    pub point: DVec3,
    /// Normal of the face under the cursor, world space, as [`Picked::normal`].
    pub normal: DVec3,
}

/// How a part is seen.
#[derive(Clone, Copy)]
pub struct SnapView<'a> {
    /// From where.
    pub camera: &'a CameraRays,
    /// What is cut away is not snapped to.
    pub filter: &'a Filter,
    /// Where the part is shown: its placement and any motion of the user's.
    pub world_from_part: DAffine3,
}

/// What a measurement at the cursor (pixels from the image's upper left corner) is meant to begin or end at. `surface` is the
/// point of the part under the cursor.
///
/// It is the vertex that is nearest to the cursor in the image within `radius` pixels; else of the feature edges the nearest
/// point within the radius; else `surface`. Of those at one place in the image the one in front counts. Points that are
/// outside of the image, cut away, or hidden behind the part itself do not count; other parts hide nothing.
pub fn snap(features: &Features, view: &SnapView, cursor: DVec2, radius: f64, surface: &Picked) -> Snap {
    let near = Neighbourhood::new(features, view, cursor, radius);
    let vertex = || near.vertex().map(|point| (SnapKind::Vertex, point));
    let edge = || near.edge().map(|point| (SnapKind::Edge, point));
    let (kind, point) = vertex().or_else(edge).unwrap_or((SnapKind::Face, surface.point));
    Snap { kind, point, normal: surface.normal }
}

/// A part about the cursor.
struct Neighbourhood<'a> {
    features: &'a Features,
    view: &'a SnapView<'a>,
    cursor: DVec2,
    radius: f64,
    screen: Screen,
    /// All vertices, relative to the eye.
    vertices: Vec<DVec3>,
    /// Triangles that may hide what is within the radius, front to back: those that hide much are asked first.
    blockers: Vec<Blocker>,
}

/// A triangle that may hide something.
struct Blocker {
    /// Depth of its nearest corner.
    depth: f64,
    /// Relative to the eye.
    corners: [DVec3; 3],
}

impl<'a> Neighbourhood<'a> {
    fn new(features: &'a Features, view: &'a SnapView, cursor: DVec2, radius: f64) -> Self {
        // Moved to the eye before vertices are placed: far from the origin, their digits are kept.
        let mut eye_from_part = view.world_from_part;
        eye_from_part.translation -= view.camera.eye();
        let vertices =
            features.vertices().iter().map(|&vertex| eye_from_part.transform_point3(vertex)).collect();
        let screen = Screen::new(view.camera, view.filter);
        let mut near =
            Neighbourhood { features, view, cursor, radius, screen, vertices, blockers: Vec::new() };
        near.blockers = near.find_blockers();
        near
    }

    fn find_blockers(&self) -> Vec<Blocker> {
        let places: Vec<Option<DVec2>> =
            self.vertices.iter().map(|&vertex| Some(self.screen.project(vertex)?.at)).collect();
        let forward = self.view.camera.forward();
        let may_block = |triangle: &&[u32; 3]| {
            // Indices of features are below the number of vertices.
            let [Some(a), Some(b), Some(c)] = triangle.map(|corner| places[corner as usize]) else {
                // It reaches behind the eye, and anywhere in the image.
                return true;
            };
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            self.cursor.clamp(low, high).distance(self.cursor) <= self.radius
        };
        let blocker = |triangle: &[u32; 3]| {
            let corners = triangle.map(|corner| self.vertices[corner as usize]);
            let depths = corners.map(|corner| corner.dot(forward));
            Blocker { depth: depths.into_iter().fold(f64::INFINITY, f64::min), corners }
        };
        let mut blockers: Vec<Blocker> =
            self.features.triangles().iter().filter(may_block).map(blocker).collect();
        blockers.sort_unstable_by(|a, b| a.depth.total_cmp(&b.depth));
        blockers
    }

    /// The nearest vertex, world space.
    fn vertex(&self) -> Option<DVec3> {
        let near = self.vertices.iter().zip(self.features.vertices()).filter_map(|(&vertex, &in_part)| {
            let nearest = self.screen.near_point(vertex, self.cursor)?;
            (nearest.distance <= self.radius && self.screen.holds(vertex)).then_some((nearest, in_part))
        });
        let in_part = self.first_visible(near.collect())?;
        Some(self.view.world_from_part.transform_point3(in_part))
    }

    /// The nearest point of a feature edge, world space.
    fn edge(&self) -> Option<DVec3> {
        let near = self.features.edges().iter().filter_map(|ends| {
            let [a, b] = ends.map(|end| self.vertices[end as usize]);
            let nearest = self.screen.near_segment(a, b, self.cursor)?;
            (nearest.distance <= self.radius).then_some((nearest, nearest.point))
        });
        let from_eye = self.first_visible(near.collect())?;
        Some(self.view.camera.eye() + from_eye)
    }

    /// What belongs to the nearest of these that is not hidden.
    fn first_visible(&self, mut found: Vec<(Nearest, DVec3)>) -> Option<DVec3> {
        found.sort_by(|(a, _), (b, _)| a.compare(b));
        found.into_iter().find(|(nearest, _)| self.is_visible(nearest)).map(|(_, point)| point)
    }

    fn is_visible(&self, nearest: &Nearest) -> bool {
        let camera = self.view.camera;
        let depth = nearest.on_screen.depth;
        let start = if camera.is_parallel() { nearest.point - depth * camera.forward() } else { DVec3::ZERO };
        // At 1 it is at the point.
        let ray = PartRay { origin: start, direction: nearest.point - start };
        let Some(clipped) = self.view.filter.clipped(&Ray::new(camera.eye() + ray.origin, ray.direction))
        else {
            return false;
        };
        let before = 1.0 - HIDES_PX * camera.pixel_at(depth) / depth;
        let hides = |t: f64| t >= clipped.t_min && t < before;
        let mut nearer = self.blockers.iter().take_while(|blocker| blocker.depth < depth);
        !nearer.any(|blocker| intersect(&ray, blocker.corners).is_some_and(hides))
    }
}

#[cfg(test)]
mod tests {
    use super::super::features::tests::{cuboid, cylinder};
    use super::*;
    use crate::camera::{Camera, Plane, Projection};
    use glam::{DQuat, EulerRot};

    const WIDTH: u32 = 400;
    const HEIGHT: u32 = 300;
    const RADIUS: f64 = 12.0;

    fn vector(random: &mut oorandom::Rand64) -> DVec3 {
        DVec3::new(random.rand_float(), random.rand_float(), random.rand_float()) * 2.0 - 1.0
    }

    fn camera(eye: DVec3, target: DVec3, up: DVec3, is_parallel: bool) -> CameraRays {
        let projection = if is_parallel {
            Projection::Orthographic { height: 6.0 }
        } else {
            Projection::Perspective { fov_y_deg: 50.0 }
        };
        let (eye, target, up) = (eye.into(), target.into(), up.into());
        Camera { eye, target, up, projection, width: WIDTH, height: HEIGHT }.rays().unwrap()
    }

    /// The point of the triangles under the cursor, found without hierarchies.
    fn surface(triangles: &[[DVec3; 3]], view: &SnapView, cursor: DVec2) -> Option<Picked> {
        let ray = view.camera.ray(cursor.x, cursor.y);
        let part_ray = PartRay { origin: ray.origin, direction: ray.direction };
        let placed = |t: &[DVec3; 3]| t.map(|corner| view.world_from_part.transform_point3(corner));
        let hits = triangles.iter().map(placed).filter_map(|t| Some((intersect(&part_ray, t)?, t)));
        let (t, [a, b, c]) = hits.filter(|hit| hit.0 > 0.0).min_by(|a, b| a.0.total_cmp(&b.0))?;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let (point, distance) = (ray.at(t), ray.at(t).distance(ray.origin));
        Some(Picked { drawable: 0, triangle: 0, point, normal, distance, is_confirmed: true })
    }

    /// Of a closed convex shape, without rays: a point is visible where a triangle about it faces the eye. The least distance
    /// in the image of a visible vertex, and of a visible one of many points along the edges.
    struct BruteForce<'a> {
        triangles: Vec<[DVec3; 3]>,
        view: &'a SnapView<'a>,
        cursor: DVec2,
    }

    impl BruteForce<'_> {
        fn is_visible(&self, point: DVec3, is_about: impl Fn(&[DVec3; 3]) -> bool) -> bool {
            let camera = self.view.camera;
            let towards = if camera.is_parallel() { camera.forward() } else { point - camera.eye() };
            let faces = |&[a, b, c]: &[DVec3; 3]| (b - a).cross(c - a).dot(towards) < 0.0;
            self.triangles.iter().filter(|t| is_about(t)).any(faces)
        }

        /// Pixels from the cursor; the pixel's place found by the camera's own rays.
        fn distance(&self, point: DVec3) -> Option<f64> {
            let camera = self.view.camera;
            let depth = (point - camera.eye()).dot(camera.forward());
            let corner = camera.ray(0.0, 0.0).at(depth);
            let (across, down) =
                (camera.ray(1.0, 0.0).at(depth) - corner, camera.ray(0.0, 1.0).at(depth) - corner);
            let steps = |along: DVec3| (point - corner).dot(along) / along.length_squared();
            let place = DVec2::new(steps(across), steps(down));
            let size = DVec2::new(WIDTH.into(), HEIGHT.into());
            let is_inside = place.cmpge(DVec2::ZERO).all() && place.cmple(size).all();
            (depth > 0.0 && is_inside).then(|| place.distance(self.cursor))
        }

        fn vertices(&self) -> f64 {
            let seen = self.triangles.iter().flatten().filter(|&&p| self.is_visible(p, |t| t.contains(&p)));
            seen.filter_map(|&p| self.distance(p)).fold(f64::INFINITY, f64::min)
        }

        fn edges(&self, edges: impl Iterator<Item = [DVec3; 2]>) -> f64 {
            let along = edges.flat_map(|[a, b]| {
                let about = move |t: &[DVec3; 3]| t.contains(&a) && t.contains(&b);
                (0..=400).map(move |i| (a.lerp(b, f64::from(i) / 400.0), about))
            });
            let seen = along.filter(|(point, about)| self.is_visible(*point, about));
            seen.filter_map(|(point, _)| self.distance(point)).fold(f64::INFINITY, f64::min)
        }
    }

    #[test]
    fn snaps_are_the_nearest_visible_vertices_and_edges() {
        let shapes = [(cuboid(), 12), (cylinder(24), 48), (cylinder(6), 18)];
        let mut kinds = [0; 3];
        for (seed, offset) in [(1, DVec3::ZERO), (2, DVec3::new(1e7, -1e7, 1e7))] {
            let mut random = oorandom::Rand64::new(seed);
            for round in 0..600 {
                let (triangles, edge_count) = &shapes[round % 3];
                let features = Features::new(triangles.iter().copied());
                assert_eq!(features.edges().len(), *edge_count);
                let angles = 6.3 * vector(&mut random);
                let turn = DQuat::from_euler(EulerRot::XYZ, angles.x, angles.y, angles.z);
                let scale = DVec3::ONE + 0.5 * vector(&mut random);
                let world_from_part = DAffine3::from_scale_rotation_translation(scale, turn, offset);
                let eye = offset + 6.0 * vector(&mut random).normalize_or(DVec3::X);
                let camera = camera(eye, offset + vector(&mut random), vector(&mut random), round % 2 == 0);
                let view = SnapView { camera: &camera, filter: &Filter::default(), world_from_part };
                let place = |limit: u32, at: f64| f64::from(limit) * (0.2 + 0.6 * at);
                let cursor =
                    DVec2::new(place(WIDTH, random.rand_float()), place(HEIGHT, random.rand_float()));
                let Some(picked) = surface(triangles, &view, cursor) else { continue };
                let found = snap(&features, &view, cursor, RADIUS, &picked);

                let to_world = |p: DVec3| world_from_part.transform_point3(p);
                let triangles = triangles.iter().map(|t| t.map(to_world)).collect();
                let brute = BruteForce { triangles, view: &view, cursor };
                let place = |end: u32| to_world(features.vertices()[end as usize]);
                let (vertex, edge) =
                    (brute.vertices(), brute.edges(features.edges().iter().map(|e| e.map(place))));
                let off = brute.distance(found.point).unwrap();
                let told =
                    format!("seed {seed}, round {round}: {found:?} {off} off, vertex {vertex}, edge {edge}");
                match found.kind {
                    SnapKind::Vertex => assert!((off - vertex).abs() < 2e-3 && off <= RADIUS, "{told}"),
                    // Samples of an edge lie up to 1.5 pixels apart.
                    SnapKind::Edge => {
                        assert!(
                            vertex > RADIUS && (-2e-3..0.8).contains(&(edge - off)) && off <= RADIUS,
                            "{told}"
                        );
                    }
                    SnapKind::Face => {
                        assert!(vertex > RADIUS && edge > RADIUS && found.point == picked.point, "{told}")
                    }
                }
                kinds[found.kind as usize] += 1;
            }
        }
        assert!(kinds.iter().all(|&count| count > 60), "{kinds:?}");
    }

    /// What the cursor snaps to on the box from -1 to 1 at `centre`, seen along -z from 6 before its middle.
    fn on_box(centre: DVec3, cursor: DVec2, filter: &Filter, is_parallel: bool) -> Snap {
        let camera = camera(centre + DVec3::Z * 6.0, centre, DVec3::Y, is_parallel);
        let view = SnapView { camera: &camera, filter, world_from_part: DAffine3::from_translation(centre) };
        let picked = surface(&cuboid(), &view, cursor).unwrap();
        snap(&Features::new(cuboid()), &view, cursor, RADIUS, &picked)
    }

    #[test]
    fn vertices_come_out_exactly_and_of_two_in_line_the_one_in_front() {
        for centre in [DVec3::ZERO, DVec3::new(1e7, 1e7, -1e7)] {
            // Parallel, 50 pixels a unit: the box's corners are at (150, 100) and so on, those behind at the same places.
            let at = |x, y| on_box(centre, DVec2::new(x, y), &Filter::default(), true);
            let vertex = at(153.0, 104.0);
            assert_eq!((vertex.kind, vertex.point), (SnapKind::Vertex, centre + DVec3::new(-1.0, 1.0, 1.0)));
            let edge = at(153.0, 150.0);
            assert_eq!(edge.kind, SnapKind::Edge);
            assert!(edge.point.distance(centre + DVec3::new(-1.0, 0.0, 1.0)) < 1e-6, "{edge:?}");
            let face = at(180.0, 140.0);
            assert_eq!((face.kind, face.normal), (SnapKind::Face, DVec3::Z));
            // In perspective the corners behind are inward of those in front, and hidden by the front face.
            let inward = DVec2::new(154.0, 104.0);
            let hidden = on_box(centre, inward, &Filter::default(), false);
            assert!((hidden.point - centre).z > 0.99 || hidden.kind == SnapKind::Face, "{hidden:?}");
        }
    }

    #[test]
    fn what_is_cut_away_is_not_snapped_to_and_hides_nothing() {
        let mut filter = Filter::default();
        filter.clip_by(Plane { normal: DVec3::NEG_Z, point: DVec3::ZERO });
        // Through the open front, the corner behind.
        let vertex = on_box(DVec3::ZERO, DVec2::new(153.0, 104.0), &filter, true);
        assert_eq!((vertex.kind, vertex.point), (SnapKind::Vertex, DVec3::new(-1.0, 1.0, -1.0)));
        filter.clip_by(Plane { normal: DVec3::NEG_Y, point: DVec3::Y * 0.5 });
        let edge = on_box(DVec3::ZERO, DVec2::new(153.0, 128.0), &filter, true);
        assert_eq!(edge.kind, SnapKind::Edge);
        assert!(edge.point.y <= 0.5 + 1e-9 && edge.point.z == -1.0, "{edge:?}");
    }
}
