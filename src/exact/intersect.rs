//! Ray against triangle in f64, watertight along shared edges.

use glam::DVec3;

/// A ray in the space of a part. `t` is that of the world ray: affine maps keep it.
#[derive(Clone, Copy, Debug)]
pub struct PartRay {
    /// Part space.
    pub origin: DVec3,
    /// Part space; not of unit length.
    pub direction: DVec3,
}

/// Parameter at which the ray's line meets the closed triangle, from either side; `None` when it misses, or lies in
/// the triangle's plane.
///
/// The side of each edge is the sign of a triple product that a neighbouring triangle computes as the exact negative
/// (the products of a cross product commute, and IEEE subtraction is antisymmetric), so that no ray slips through a
/// shared edge. Edge functions as in Kensler and Shirley, "Optimizing Ray-Triangle Intersection via Automated Search",
/// 2006, here in their antisymmetric form.
#[inline]
pub fn intersect(ray: &PartRay, triangle: [DVec3; 3]) -> Option<f64> {
    let [a, b, c] = triangle.map(|p| p - ray.origin);
    let u = ray.direction.dot(c.cross(b));
    let v = ray.direction.dot(a.cross(c));
    let w = ray.direction.dot(b.cross(a));
    let outside = (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0);
    if outside {
        return None;
    }
    // From the corners as they are: exact differences for decoded vertices, so that a collinear triangle's is exactly 0.
    let normal = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]);
    let slope = normal.dot(ray.direction);
    if slope == 0.0 {
        return None;
    }
    let t = normal.dot(a) / slope;
    t.is_finite().then_some(t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_through_a_triangle_hits_it_from_both_sides() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        for z in [3.0, -3.0] {
            let ray = PartRay { origin: DVec3::new(0.25, 0.25, z), direction: DVec3::Z * -z };
            assert_eq!(intersect(&ray, triangle), Some(1.0));
            let beside = PartRay { origin: DVec3::new(0.75, 0.75, z), ..ray };
            assert_eq!(intersect(&beside, triangle), None);
        }
    }

    #[test]
    fn degenerate_triangles_and_rays_in_the_plane_are_missed() {
        let ray = PartRay { origin: DVec3::new(0.0, 0.0, 1.0), direction: DVec3::NEG_Z };
        assert_eq!(intersect(&ray, [DVec3::ZERO; 3]), None);
        assert_eq!(intersect(&ray, [DVec3::ZERO, DVec3::X, DVec3::X * 2.0]), None);
        let along = PartRay { origin: DVec3::new(-1.0, 0.2, 0.0), direction: DVec3::X };
        assert_eq!(intersect(&along, [DVec3::ZERO, DVec3::X, DVec3::Y]), None);
    }

    #[test]
    fn no_ray_slips_between_triangles_that_share_an_edge() {
        let mut random = oorandom::Rand64::new(4);
        let mut point = |scale: f64| {
            DVec3::new(random.rand_float() - 0.5, random.rand_float() - 0.5, random.rand_float() - 0.5)
                * scale
        };
        for round in 0..100_000 {
            // A fan around a hub; rays aimed at points of its spokes, as exactly as f64 allows.
            let hub = point(1.0) + DVec3::splat(1e3);
            let rim: Vec<DVec3> = [(1.0, 0.1), (-0.2, 0.9), (-0.9, -0.8), (0.7, -1.0)]
                .map(|(x, y)| hub + DVec3::new(x, y, 0.3) + point(0.2))
                .to_vec();
            let origin = hub + DVec3::new(0.0, 0.0, 40.0) + point(10.0);
            let spoke = rim[round % 4].lerp(hub, (point(1.0).x + 0.5) * 0.999 + 0.001);
            let ray = PartRay { origin, direction: spoke - origin };
            let hits = (0..4).filter(|&i| intersect(&ray, [hub, rim[i], rim[(i + 1) % 4]]).is_some()).count();
            assert!(hits >= 1, "seed 4, round {round}: {ray:?} slips through");
        }
    }
}
