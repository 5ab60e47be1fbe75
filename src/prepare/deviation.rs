//! How far a coarse level is from a finer one, measured at points of both.
//!
//! The simplifier's own figure is an average over the planes that meet at a vertex: beside large faces it hides the
//! loss of small ones (a thin rib, a small hole). So distances are measured, in both directions, point to triangle:
//! from every vertex that the coarse level lost to the coarse surface, and from the middle of every coarse triangle
//! and open edge to the fine surface (a filled notch or hole shows only there). Cignoni et al. 1998, "Metro", sample
//! likewise; we differ by a local search instead of a global one, which can only make the result larger.

use std::collections::VecDeque;

use glam::DVec3;

/// "No home".
const NONE: u32 = u32::MAX;
/// Triangles that one search looks at, at most: it ends in time on a fan of 65,536 triangles, too.
const MAX_TESTS: usize = 512;
/// From this many triangles around a vertex on, a search had better begin elsewhere.
const HUB_TRIANGLES: usize = 16;

/// Triangles over shared positions, with the triangles around each vertex.
pub(super) struct Surface {
    triangles: Vec<[u32; 3]>,
    /// The triangles around vertex v are `around[first[v] .. first[v + 1]]`.
    first: Vec<u32>,
    around: Vec<u32>,
}

impl Surface {
    /// Corners are below `vertex_count`; there are fewer than 2^32 / 3 triangles.
    pub fn new(triangles: Vec<[u32; 3]>, vertex_count: usize) -> Surface {
        let mut first = vec![0u32; vertex_count + 1];
        for &corner in triangles.iter().flatten() {
            first[corner as usize + 1] += 1;
        }
        for v in 0..vertex_count {
            first[v + 1] += first[v];
        }
        let mut next = first.clone();
        let mut around = vec![0u32; triangles.len() * 3];
        for (t, corners) in (0u32..).zip(&triangles) {
            for &corner in corners {
                around[next[corner as usize] as usize] = t;
                next[corner as usize] += 1;
            }
        }
        Surface { triangles, first, around }
    }

    /// Its triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    fn around(&self, vertex: u32) -> &[u32] {
        &self.around[self.first[vertex as usize] as usize..self.first[vertex as usize + 1] as usize]
    }

    fn uses(&self, vertex: u32) -> bool {
        !self.around(vertex).is_empty()
    }

    fn neighbours(&self, vertex: u32) -> impl Iterator<Item = u32> {
        self.around(vertex).iter().flat_map(|&t| self.triangles[t as usize])
    }

    /// Whether the edge of one triangle has no other.
    fn is_open(&self, a: u32, b: u32) -> bool {
        let (rim, hub) = if self.around(a).len() <= self.around(b).len() { (a, b) } else { (b, a) };
        self.around(rim).iter().filter(|&&t| self.triangles[t as usize].contains(&hub)).take(2).count() == 1
    }

    /// Corners of a triangle, those with few triangles around first: of a fan the rim before the hub.
    fn cheapest_first(&self, mut corners: [u32; 3]) -> [u32; 3] {
        corners.sort_by_key(|&corner| self.around(corner).len());
        corners
    }

    /// Squared distance from `point` to the nearest triangle that a search from vertex `start` finds, never less than
    /// the distance to the surface; infinite if nothing is around `start`. It goes from the nearest triangle so far
    /// to those around its corners while that helps, and ends early at or below `enough`.
    fn distance_squared(&self, positions: &[DVec3], point: DVec3, start: u32, enough: f64) -> f64 {
        let mut best = f64::INFINITY;
        let mut tests = 0;
        let mut corners = [start, NONE, NONE];
        let mut searched = NONE;
        'search: loop {
            for corner in corners {
                if corner == searched || corner == NONE {
                    continue;
                }
                let mut better = None;
                for &t in self.around(corner) {
                    let triangle = self.triangles[t as usize];
                    let distance = point_triangle_squared(point, triangle.map(|v| positions[v as usize]));
                    if distance < best {
                        best = distance;
                        better = Some(triangle);
                    }
                    tests += 1;
                    if best <= enough || tests == MAX_TESTS {
                        return best;
                    }
                }
                if let Some(triangle) = better {
                    corners = self.cheapest_first(triangle);
                    searched = corner;
                    continue 'search;
                }
            }
            return best;
        }
    }
}

/// How far two levels are apart.
pub(super) struct Deviation {
    /// The largest distance found, part units, or what the search was told to begin with.
    pub distance: f64,
    /// True when a piece of the fine surface has no vertex left in the coarse one. Such pieces are not measured: what
    /// their loss costs is for the caller to know.
    pub has_lost_pieces: bool,
}

/// The deviation between two levels, distances below `at_least` counted as that. The coarse level's vertices are a
/// subset of the fine one's.
pub(super) fn deviation(fine: &Surface, coarse: &Surface, positions: &[DVec3], at_least: f64) -> Deviation {
    let mut worst = at_least * at_least;
    let mut has_lost_pieces = false;
    for (vertex, home) in (0u32..).zip(homes(fine, coarse, positions)) {
        if home == NONE {
            has_lost_pieces |= fine.uses(vertex);
        } else if home != vertex {
            let point = positions[vertex as usize];
            worst = worst.max(coarse.distance_squared(positions, point, home, worst));
        }
    }
    for &triangle in coarse.triangles() {
        let [a, b, c] = triangle.map(|v| positions[v as usize]);
        let mut measure = |point: DVec3| {
            let mut nearest = f64::INFINITY;
            for start in fine.cheapest_first(triangle) {
                nearest = nearest.min(fine.distance_squared(positions, point, start, worst));
                if nearest <= worst {
                    return;
                }
            }
            worst = nearest;
        };
        measure((a + b + c) / 3.0);
        for (i, (from, to)) in [(a, b), (b, c), (c, a)].into_iter().enumerate() {
            if coarse.is_open(triangle[i], triangle[(i + 1) % 3]) {
                measure((from + to) / 2.0);
            }
        }
    }
    Deviation { distance: worst.sqrt().max(at_least), has_lost_pieces }
}

/// For each vertex of `fine` a vertex near it that `coarse` kept: itself, or the nearest among the homes of its
/// neighbours. [`NONE`] where no kept vertex is connected.
fn homes(fine: &Surface, coarse: &Surface, positions: &[DVec3]) -> Vec<u32> {
    let vertices = 0..positions.len() as u32;
    let mut home: Vec<u32> = vertices.clone().map(|v| if coarse.uses(v) { v } else { NONE }).collect();
    // Breadth first, so that everything connected has some home.
    let mut queue: VecDeque<u32> = vertices.clone().filter(|&v| coarse.uses(v)).collect();
    while let Some(v) = queue.pop_front() {
        for neighbour in fine.neighbours(v) {
            if home[neighbour as usize] == NONE {
                home[neighbour as usize] = home[v as usize];
                queue.push_back(neighbour);
            }
        }
    }
    // Fewest edges is not nearest: all around a fan are one edge from its hub, where a search is long. Two sweeps hand
    // on nearer homes.
    for v in vertices.clone().chain(vertices.rev()) {
        let own = home[v as usize];
        if own == v || own == NONE || coarse.around(own).len() < HUB_TRIANGLES {
            continue;
        }
        let far = |home: u32| positions[home as usize].distance_squared(positions[v as usize]);
        let mut nearest = (far(own), own);
        for candidate in fine.neighbours(v).map(|n| home[n as usize]) {
            if candidate != nearest.1 && far(candidate) < nearest.0 {
                nearest = (far(candidate), candidate);
            }
        }
        home[v as usize] = nearest.1;
    }
    home
}

/// Squared distance from a point to a triangle, which may be a segment or a point.
///
/// Ericson 2005, "Real-Time Collision Detection", 5.1.5: at most one division. We differ where rounding or a degenerate
/// triangle leaves the region unclear: there the nearest edge counts.
pub(super) fn point_triangle_squared(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (ab_ap, ac_ap) = (ab.dot(ap), ac.dot(ap));
    if ab_ap <= 0.0 && ac_ap <= 0.0 {
        return ap.length_squared();
    }
    let bp = p - b;
    let (ab_bp, ac_bp) = (ab.dot(bp), ac.dot(bp));
    if ab_bp >= 0.0 && ac_bp <= ab_bp {
        return bp.length_squared();
    }
    let cp = p - c;
    let (ab_cp, ac_cp) = (ab.dot(cp), ac.dot(cp));
    if ac_cp >= 0.0 && ab_cp <= ac_cp {
        return cp.length_squared();
    }
    // Barycentric weights of the projection, times twice the area squared.
    let weight_c = ab_ap * ac_bp - ab_bp * ac_ap;
    let weight_b = ab_cp * ac_ap - ab_ap * ac_cp;
    let weight_a = ab_bp * ac_cp - ab_cp * ac_bp;
    if weight_a > 0.0 && weight_b > 0.0 && weight_c > 0.0 {
        let total = weight_a + weight_b + weight_c;
        return ap.distance_squared(ab * (weight_b / total) + ac * (weight_c / total));
    }
    point_segment_squared(p, a, b).min(point_segment_squared(p, b, c)).min(point_segment_squared(p, c, a))
}

fn point_segment_squared(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let along = b - a;
    let length_squared = along.length_squared();
    let t = if length_squared > 0.0 { ((p - a).dot(along) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
    p.distance_squared(a + along * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_to_a_triangle_is_that_to_its_nearest_point() {
        let mut random = oorandom::Rand64::new(11);
        for case in 0..200 {
            let [a, b, c, p] =
                [0; 4].map(|_| DVec3::from_array([0; 3].map(|_| random.rand_float() * 4.0 - 2.0)));
            let measured = point_triangle_squared(p, [a, b, c]).sqrt();
            let mut sampled = f64::INFINITY;
            for i in 0..=100 {
                for j in 0..=100 - i {
                    let (u, v) = (f64::from(i) / 100.0, f64::from(j) / 100.0);
                    sampled = sampled.min(p.distance(a + (b - a) * u + (c - a) * v));
                }
            }
            assert!(measured <= sampled + 1e-12, "case {case}: {measured} > {sampled}");
            assert!(measured >= sampled - 0.06, "case {case}: {measured} < {sampled}");
        }
    }

    #[test]
    fn points_and_segments_have_distances_too() {
        let (o, x) = (DVec3::ZERO, DVec3::X);
        assert_eq!(point_triangle_squared(DVec3::new(3.0, 4.0, 0.0), [o, o, o]), 25.0);
        assert_eq!(point_triangle_squared(DVec3::new(0.5, 2.0, 0.0), [o, x, x]), 4.0);
        assert_eq!(point_triangle_squared(DVec3::new(2.0, 0.0, 0.0), [o, x / 2.0, x]), 1.0);
    }

    #[test]
    fn a_lost_piece_is_noticed() {
        let positions: Vec<DVec3> = (0..6).map(|i| DVec3::new(f64::from(i % 3), f64::from(i), 0.0)).collect();
        let both = Surface::new(vec![[0, 1, 2], [3, 4, 5]], positions.len());
        let one = Surface::new(vec![[0, 1, 2]], positions.len());
        assert!(deviation(&both, &one, &positions, 0.0).has_lost_pieces);
        assert!(!deviation(&both, &both, &positions, 0.0).has_lost_pieces);
        assert!(!deviation(&one, &one, &positions, 0.0).has_lost_pieces, "unused vertices are no pieces");
    }

    /// A square of `n` by `n` cells with two triangles each; `height` gives z.
    fn plate(n: u32, height: impl Fn(u32, u32) -> f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let mut positions = Vec::new();
        let mut triangles = Vec::new();
        for y in 0..=n {
            for x in 0..=n {
                positions.push(DVec3::new(f64::from(x), f64::from(y), height(x, y)));
                if x < n && y < n {
                    let v = y * (n + 1) + x;
                    triangles.push([v, v + 1, v + n + 2]);
                    triangles.push([v, v + n + 2, v + n + 1]);
                }
            }
        }
        (positions, triangles)
    }

    #[test]
    fn a_lost_spike_is_measured_in_full() {
        let (positions, triangles) = plate(8, |x, y| if (x, y) == (3, 4) { 2.5 } else { 0.0 });
        let fine = Surface::new(triangles, positions.len());
        let coarse = Surface::new(vec![[0, 8, 80], [0, 80, 72]], positions.len());
        assert_eq!(deviation(&fine, &coarse, &positions, 0.0).distance, 2.5);
        assert_eq!(deviation(&fine, &coarse, &positions, 3.0).distance, 3.0);
    }

    #[test]
    fn a_filled_hole_is_measured_though_no_vertex_is_far() {
        let (positions, mut triangles) = plate(9, |_, _| 0.0);
        triangles.retain(|t| {
            let middle = t.iter().map(|&v| positions[v as usize]).sum::<DVec3>() / 3.0;
            middle.distance(DVec3::new(6.0, 3.0, 0.0)) > 1.5
        });
        let fine = Surface::new(triangles, positions.len());
        let coarse = Surface::new(vec![[0, 9, 99], [0, 99, 90]], positions.len());
        let measured = deviation(&fine, &coarse, &positions, 0.0).distance;
        assert_eq!(measured, 1.0);
    }

    #[test]
    fn a_fan_of_many_triangles_is_searched_in_bounded_time() {
        let n = 65_535u32;
        let mut positions = vec![DVec3::ZERO];
        positions.extend((0..n).map(|i| {
            let angle = f64::from(i) / f64::from(n) * std::f64::consts::TAU;
            DVec3::new(libm::cos(angle), libm::sin(angle), 0.0)
        }));
        let fan = |stride: u32| {
            let rim: Vec<u32> = (0..n).step_by(stride as usize).map(|i| i + 1).collect();
            let next = rim.iter().cycle().skip(1);
            rim.iter().zip(next).map(|(&a, &b)| [0, a, b]).collect::<Vec<_>>()
        };
        let (fine, coarse) = (Surface::new(fan(1), positions.len()), Surface::new(fan(15), positions.len()));
        let measured = deviation(&fine, &coarse, &positions, 0.0).distance;
        // The sagitta of 15 of 65,535 steps.
        let expected = 1.0 - libm::cos(std::f64::consts::PI * 15.0 / f64::from(n));
        assert!((0.9..1.01).contains(&(measured / expected)), "{measured} instead of {expected}");
    }
}
