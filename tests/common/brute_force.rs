//! A ray caster that shares nothing with the library's, and the comparison of `exact` with it.

use glam::DVec3;
use voxsight::camera::{Camera, Plane};
use voxsight::filter::Filter;
use voxsight::loaded::LoadedScene;
use voxsight::ray::Ray;
use voxsight::scene::Scene;

/// A hit is a tie when the next object is no farther behind it than this fraction of the distance: coplanar faces.
const TIE: f64 = 1e-9;
/// Brute force works on world coordinates, whose rounding shifts a grazing hit: so many units in their last place.
const WORLD_ROUNDING: f64 = 256.0 * f64::EPSILON;
/// Barycentric coordinates nearer than this to a triangle's edge are on it, for all that rounding can tell.
const EDGE: f64 = 1e-10;

/// All triangles of a scene in world space, with their drawables.
pub struct FlatScene {
    triangles: Vec<(u32, [DVec3; 3])>,
    transparent: Vec<bool>,
    /// Bounding sphere of each drawable and the range of its triangles.
    spheres: Vec<(DVec3, f64, std::ops::Range<usize>)>,
}

impl FlatScene {
    /// Of a whole scene.
    pub fn new(scene: &Scene) -> Self {
        let (mut triangles, mut transparent, mut spheres) = (Vec::new(), Vec::new(), Vec::new());
        for (id, drawable) in scene.drawables().iter().enumerate() {
            let level = scene.chunks()[drawable.chunk as usize].first_level;
            let mesh = scene.level_mesh(level).unwrap();
            let to_world = scene.world_from_part(drawable.object);
            let positions: Vec<DVec3> = scene
                .level_positions(level, &mesh)
                .iter()
                .map(|p| to_world.transform_point3(p.as_dvec3()))
                .collect();
            let start = triangles.len();
            triangles.extend(mesh.triangles.iter().map(|t| (id as u32, t.map(|v| positions[v as usize]))));
            let centre = positions.iter().sum::<DVec3>() / positions.len() as f64;
            let radius = positions.iter().map(|p| p.distance(centre)).fold(0.0, f64::max) * (1.0 + 1e-9);
            spheres.push((centre, radius, start..triangles.len()));
            transparent.push(scene.objects()[drawable.object as usize].colour[3] < 255);
        }
        FlatScene { triangles, transparent, spheres }
    }

    /// All triangles of opaque drawables that a ray meets or may meet. Written for the tests alone: Möller and Trumbore's
    /// test, in world space, no hierarchy but a sphere for each drawable. `rounding` is that of a length.
    pub fn meetings(&self, ray: &Ray, filter: &Filter, rounding: f64) -> Vec<Meeting> {
        // How far inside all clip planes, and behind the ray's start.
        let inside = |t: f64| {
            let height = |plane: &Plane| plane.normal.dot(ray.at(t) - plane.point) / plane.normal.length();
            filter.clip_planes().iter().map(height).fold(t, f64::min)
        };
        let mut meetings = Vec::new();
        for (drawable, (centre, radius, range)) in self.spheres.iter().enumerate() {
            let along = (*centre - ray.origin).dot(ray.direction) / ray.direction.length_squared();
            let nearest = ray.at(along.max(0.0));
            let is_absent = self.transparent[drawable] || filter.is_hidden(drawable as u32);
            if is_absent || nearest.distance(*centre) > *radius + rounding {
                continue;
            }
            let triangles = self.triangles[range.clone()].iter();
            let met = triangles.filter_map(|(_, triangle)| moller_trumbore(ray, triangle));
            meetings.extend(met.filter(|&(t, _)| inside(t) >= -rounding).map(|(t, surely)| Meeting {
                t,
                drawable: drawable as u32,
                surely: surely && inside(t) >= rounding,
            }));
        }
        meetings
    }
}

/// A ray and a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Meeting {
    /// In units of the ray's direction.
    pub t: f64,
    /// Whose triangle.
    pub drawable: u32,
    /// Not along an edge, a clip plane, or where the ray starts, where rounding decides whether they meet.
    pub surely: bool,
}

/// Where they may meet, and whether they do for sure.
fn moller_trumbore(ray: &Ray, [a, b, c]: &[DVec3; 3]) -> Option<(f64, bool)> {
    let (e1, e2) = (*b - *a, *c - *a);
    let p = ray.direction.cross(e2);
    let determinant = e1.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let sign = determinant.signum();
    let s = ray.origin - *a;
    let u = sign * s.dot(p);
    let q = s.cross(e1);
    let v = sign * ray.direction.dot(q);
    // Slivers seen edge-on have a determinant that is no larger than the rounding of the sums.
    let sums = s.length() * ray.direction.length() * e1.length().max(e2.length());
    let doubt = EDGE * determinant.abs() + 16.0 * f64::EPSILON * sums;
    let inside = u.min(v).min(determinant.abs() - (u + v));
    (inside >= -doubt).then(|| (e2.dot(q) / determinant, inside >= doubt))
}

/// Pixels that agree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Agreement {
    /// Pixels whose ray meets an opaque drawable.
    pub hits: u64,
    /// Of those, the ones where another drawable is as near: who of them is found is no error.
    pub ties: u64,
    /// Pixels where rounding decides what is met: rays along edges, clip planes, and faces they start on.
    pub doubtful: u64,
}

/// Compares `exact` with brute force at the middle of every `step`-th pixel of a row and column.
pub fn compare_with_brute_force(
    name: &str,
    loaded: &LoadedScene,
    flat: &FlatScene,
    camera: &Camera,
    step: usize,
) -> Agreement {
    let rays = camera.rays().unwrap();
    let bounds = loaded.scene().meta().bounds;
    let coordinates = bounds.min.iter().chain(&bounds.max).chain(&camera.eye);
    let farthest = coordinates.fold(0.0, |far: f64, c| far.max(c.abs()));
    let rounding = WORLD_ROUNDING * farthest;
    let mut agreement = Agreement::default();
    for row in (0..camera.height).step_by(step) {
        for column in (0..camera.width).step_by(step) {
            let ray = rays.ray(f64::from(column) + 0.5, f64::from(row) + 0.5);
            let filter = loaded.query().filter;
            let found = loaded.query().exact.closest_through(&ray, filter, |_| {});
            let met = flat.meetings(&ray, filter, rounding);
            let place = || {
                let first = met.iter().min_by(|a, b| a.t.total_cmp(&b.t));
                format!("{name}, pixel {column} {row}: {found:?}, brute force {first:?}")
            };
            let Some(hit) = found else {
                assert!(met.iter().all(|m| !m.surely), "{}", place());
                agreement.doubtful += u64::from(!met.is_empty());
                continue;
            };
            let tolerance = TIE * hit.t + rounding;
            let is_as_near = |m: &Meeting| (m.t - hit.t).abs() <= tolerance;
            assert!(met.iter().any(|m| m.drawable == hit.drawable && is_as_near(m)), "{}", place());
            let mut nearer = met.iter().filter(|m| m.t < hit.t - tolerance);
            assert!(nearer.clone().all(|m| !m.surely), "{}", place());
            agreement.hits += 1;
            agreement.doubtful += u64::from(nearer.next().is_some());
            let is_tied = met.iter().any(|m| m.surely && m.drawable != hit.drawable && is_as_near(m));
            agreement.ties += u64::from(is_tied);
        }
    }
    agreement
}
