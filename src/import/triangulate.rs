//! Cuts polygons into triangles: a fan where that is right, ear clipping where the polygon is concave.

use glam::{DVec2, DVec3};

/// Polygons with more corners are fanned: clipping is quadratic, and text is cheap to write for an attacker.
const MAX_CLIPPED: usize = 256;

/// Appends the `corners.len() - 2` triangles of a polygon; nothing for fewer than 3 corners.
///
/// `position` may say `None` for a corner that is not known (yet): then the polygon is fanned. The polygon
/// may be slightly warped; it is cut as seen along its average normal. One that crosses itself gets some
/// triangulation.
pub(super) fn polygon(
    corners: &[u32],
    position: impl Fn(u32) -> Option<DVec3>,
    triangles: &mut Vec<[u32; 3]>,
) {
    match *corners {
        [] | [_] | [_, _] => {}
        [a, b, c] => triangles.push([a, b, c]),
        _ => match concave_outline(corners, position) {
            Some(outline) => clip_ears(corners, &outline, triangles),
            None => {
                let fan = corners.windows(2).skip(1);
                triangles.extend(fan.filter_map(|pair| match (corners.first(), pair) {
                    (Some(&a), &[b, c]) => Some([a, b, c]),
                    _ => None,
                }));
            }
        },
    }
}

/// The polygon in its plane, counter-clockwise; `None` when a fan will do.
fn concave_outline(corners: &[u32], position: impl Fn(u32) -> Option<DVec3>) -> Option<Vec<DVec2>> {
    if corners.len() > MAX_CLIPPED {
        return None;
    }
    let points: Vec<DVec3> = corners.iter().map(|&corner| position(corner)).collect::<Option<_>>()?;
    let origin = *points.first()?;
    // Newell's normal, relative to one corner so that map coordinates do not cancel.
    let pairs = points.iter().zip(points.iter().cycle().skip(1));
    let normal: DVec3 = pairs.map(|(&a, &b)| (a - origin).cross(b - origin)).sum();
    let size = normal.abs();
    // Dropping the largest component keeps the outline's sense of rotation if its sign is put back.
    let outline: Vec<DVec2> = points
        .iter()
        .map(|&p| {
            let p = p - origin;
            if size.x >= size.y && size.x >= size.z {
                DVec2::new(p.y * normal.x.signum(), p.z)
            } else if size.y >= size.z {
                DVec2::new(p.z * normal.y.signum(), p.x)
            } else {
                DVec2::new(p.x * normal.z.signum(), p.y)
            }
        })
        .collect();
    let n = outline.len();
    let is_concave =
        (0..n).any(|i| turn(at(&outline, i + n - 1), at(&outline, i), at(&outline, i + 1)) < 0.0);
    is_concave.then_some(outline)
}

/// Twice the signed area of a triangle: positive for a left turn. NaN for unusable coordinates.
fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

fn at(outline: &[DVec2], i: usize) -> DVec2 {
    outline.get(i % outline.len().max(1)).copied().unwrap_or_default()
}

/// Cuts off one convex corner after the other that has no other corner inside.
fn clip_ears(corners: &[u32], outline: &[DVec2], triangles: &mut Vec<[u32; 3]>) {
    let mut left: Vec<usize> = (0..corners.len()).collect();
    let mut start = 0;
    while left.len() > 3 {
        let n = left.len();
        // A polygon that crosses itself may have no ear: then any corner is cut off, so that this ends.
        let ear = (0..n).map(|i| (start + i) % n).find(|&i| is_ear(&left, outline, i)).unwrap_or(start % n);
        push(corners, &left, [ear + n - 1, ear, ear + 1], triangles);
        left.remove(ear);
        // Going on behind the ear makes rounder triangles than going on at the same corner.
        start = (ear + 1) % left.len();
    }
    push(corners, &left, [0, 1, 2], triangles);
}

fn push(corners: &[u32], left: &[usize], triangle: [usize; 3], triangles: &mut Vec<[u32; 3]>) {
    let corner = |i: usize| left.get(i % left.len()).and_then(|&at| corners.get(at)).copied();
    if let [Some(a), Some(b), Some(c)] = triangle.map(corner) {
        triangles.push([a, b, c]);
    }
}

fn is_ear(left: &[usize], outline: &[DVec2], i: usize) -> bool {
    let n = left.len();
    let point = |i: usize| left.get(i % n).map_or(DVec2::NAN, |&corner| at(outline, corner));
    let (a, b, c) = (point(i + n - 1), point(i), point(i + 1));
    if turn(a, b, c).partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return false;
    }
    // The other corners, from the one behind c to the one before a. One that lies on a corner (the bridge of
    // a hole does) blocks nothing.
    (i + 2..i + n - 1).map(point).all(|p| {
        let is_inside = turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0;
        !is_inside || p == a || p == b || p == c
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(points: &[DVec3]) -> Vec<[u32; 3]> {
        let corners: Vec<u32> = (0..points.len() as u32).collect();
        let mut triangles = Vec::new();
        polygon(&corners, |i| points.get(i as usize).copied(), &mut triangles);
        triangles
    }

    fn area(points: &[DVec3], triangles: &[[u32; 3]], normal: DVec3) -> Vec<f64> {
        let p = |i: u32| points[i as usize];
        triangles.iter().map(|&[a, b, c]| (p(b) - p(a)).cross(p(c) - p(a)).dot(normal) / 2.0).collect()
    }

    /// Stars are concave at every second corner. The oracle is the area by Gauss.
    #[test]
    fn triangles_of_concave_polygons_have_no_negative_area_and_the_right_sum() {
        let mut random = oorandom::Rand64::new(7);
        for corners in 4..60 {
            let axes =
                [(DVec3::X, DVec3::Y), (DVec3::Y, DVec3::Z), (DVec3::Z, DVec3::X), (DVec3::Y, DVec3::X)];
            for (u, v) in axes {
                let far = DVec3::new(435_440.0, 90_409.0, 10.0);
                let points: Vec<DVec3> = (0..corners)
                    .map(|i| {
                        let angle = std::f64::consts::TAU * f64::from(i) / f64::from(corners);
                        let radius = 0.2 + random.rand_float();
                        far + radius * (libm::cos(angle) * u + libm::sin(angle) * v)
                    })
                    .collect();
                let triangles = cut(&points);
                assert_eq!(triangles.len() as u32, corners as u32 - 2, "seed 7");
                let areas = area(&points, &triangles, u.cross(v));
                let n = points.len();
                let gauss: f64 = (0..n)
                    .map(|i| {
                        let (a, b) = (points[i] - far, points[(i + 1) % n] - far);
                        a.cross(b).dot(u.cross(v)) / 2.0
                    })
                    .sum();
                assert!(areas.iter().all(|&a| a >= -1e-9), "seed 7, {corners} corners: {areas:?}");
                assert!((areas.iter().sum::<f64>() - gauss).abs() < 1e-7, "seed 7, {corners} corners");
            }
        }
    }

    #[test]
    fn a_convex_polygon_is_a_fan_and_a_dart_is_cut_at_its_notch() {
        let at = |x, y| DVec3::new(x, y, 0.0);
        let square = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
        assert_eq!(cut(&square), [[0, 1, 2], [0, 2, 3]]);
        let dart = [at(0.0, 0.0), at(2.0, 1.0), at(0.0, 2.0), at(1.0, 1.0)];
        assert!(area(&dart, &cut(&dart), DVec3::Z).iter().all(|&a| a > 0.0));
    }

    #[test]
    fn hopeless_polygons_end_and_give_all_their_triangles() {
        let bow_tie = [DVec3::ZERO, DVec3::ONE, DVec3::X, DVec3::Y, DVec3::Z];
        assert_eq!(cut(&bow_tie).len(), 3);
        assert_eq!(cut(&[DVec3::NAN; 200]).len(), 198);
        assert_eq!(cut(&[DVec3::ZERO; 300]).len(), 298);
        assert_eq!(cut(&[DVec3::ZERO; 2]).len(), 0);
        let mut triangles = Vec::new();
        polygon(&[5, 6, 7, 8], |_| None, &mut triangles);
        assert_eq!(triangles, [[5, 6, 7], [5, 7, 8]]);
    }
}
