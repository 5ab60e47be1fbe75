//! Cutting a big part into spatial chunks, before it is quantized.
//!
//! Cuts by number of triangles follow the surface-area heuristic over binned centroids (Wald 2007, "On fast
//! construction of SAH-based bounding volume hierarchies"; Xue et al. 2016, sec. 3.1, cut likewise), cuts by extent
//! halve the space. Whole triangles are handed out, by centroid; none is cut.

use glam::DVec3;

use crate::model::Mesh;

/// Bins per axis that the surface-area heuristic looks at.
const BINS: usize = 32;
/// A cut by the heuristic leaves at least one part in this many on each side: the heuristic alone would shave off
/// slivers, and small chunks cost more than they save.
const MAX_IMBALANCE: usize = 8;
/// Groups above this many triangles are cut on several threads.
const PARALLEL_TRIANGLES: usize = 1 << 17;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bounds {
    pub min: DVec3,
    pub max: DVec3,
}

impl Bounds {
    /// Encloses nothing; every box and point grows it.
    pub const EMPTY: Bounds = Bounds { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// The smallest box around `points`.
    pub fn of(points: impl IntoIterator<Item = DVec3>) -> Bounds {
        points.into_iter().fold(Bounds::EMPTY, |bounds, p| bounds.union(&Bounds { min: p, max: p }))
    }

    /// The smallest box around `triangles` of `mesh`.
    pub fn of_triangles(mesh: &Mesh, triangles: &[u32]) -> Bounds {
        Bounds::of(triangles.iter().flat_map(|&t| corners(mesh, t)))
    }

    /// The smallest box around both.
    pub fn union(&self, other: &Bounds) -> Bounds {
        Bounds { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Length of the sides; negative infinity for the empty box.
    pub fn extent(&self) -> DVec3 {
        self.max - self.min
    }

    /// Half the surface area, 0 for the empty box.
    fn half_area(&self) -> f64 {
        let e = self.extent().max(DVec3::ZERO);
        e.x * e.y + e.y * e.z + e.z * e.x
    }
}

/// What a chunk may hold.
pub(super) struct Limits {
    /// At least 1.
    pub max_triangles: usize,
    /// Largest side per axis, if there is a limit. A single triangle may exceed it.
    pub max_extent: Option<DVec3>,
}

/// Splits the triangles of `mesh` into groups within `limits`; gives their indices. Each triangle is in exactly one
/// group, no group is empty, and the order depends on the mesh alone.
///
/// The mesh has fewer than 2^32 triangles, its indices are in range, its extent is finite.
pub(super) fn split(mesh: &Mesh, limits: &Limits) -> Vec<Vec<u32>> {
    let all: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    if all.is_empty() { Vec::new() } else { split_group(mesh, limits, all) }
}

fn split_group(mesh: &Mesh, limits: &Limits, group: Vec<u32>) -> Vec<Vec<u32>> {
    let (low, high) = if group.len() > limits.max_triangles.max(1) {
        cut_by_count(mesh, group)
    } else if let Some((axis, limit)) = exceeded_axis(mesh, limits, &group) {
        cut_by_extent(mesh, group, axis, limit)
    } else {
        return vec![group];
    };
    let (mut groups, rest) = if low.len() + high.len() > PARALLEL_TRIANGLES {
        rayon::join(|| split_group(mesh, limits, low), || split_group(mesh, limits, high))
    } else {
        (split_group(mesh, limits, low), split_group(mesh, limits, high))
    };
    groups.extend(rest);
    groups
}

fn corners(mesh: &Mesh, triangle: u32) -> [DVec3; 3] {
    mesh.triangles[triangle as usize].map(|corner| mesh.positions[corner as usize])
}

fn centroid(mesh: &Mesh, triangle: u32) -> DVec3 {
    let [a, b, c] = corners(mesh, triangle);
    // Divided first, so that the sum of huge coordinates stays finite.
    a / 3.0 + b / 3.0 + c / 3.0
}

/// The axis on which a group of two or more triangles exceeds its limit most, and that limit.
fn exceeded_axis(mesh: &Mesh, limits: &Limits, group: &[u32]) -> Option<(usize, f64)> {
    let max_extent = limits.max_extent.filter(|_| group.len() > 1)?;
    let excess = Bounds::of_triangles(mesh, group).extent() / max_extent;
    let axis = longest_axis(excess);
    (excess[axis] > 1.0).then_some((axis, max_extent[axis]))
}

fn longest_axis(v: DVec3) -> usize {
    let axis = if v.y > v.x { 1 } else { 0 };
    if v.z > v[axis] { 2 } else { axis }
}

/// Cuts a group of two or more triangles in the middle of their centroids' range.
fn cut_by_extent(mesh: &Mesh, group: Vec<u32>, axis: usize, limit: f64) -> (Vec<u32>, Vec<u32>) {
    let centroids = Bounds::of(group.iter().map(|&t| centroid(mesh, t)));
    // Centroids much closer than the limit: no cut in space makes the boxes smaller. Halving ends it all the same.
    if centroids.extent()[axis] > limit / 1024.0 {
        let middle = centroids.min[axis] + centroids.extent()[axis] / 2.0;
        let (low, high): (Vec<u32>, Vec<u32>) =
            group.iter().partition(|&&t| centroid(mesh, t)[axis] < middle);
        if !low.is_empty() && !high.is_empty() {
            return (low, high);
        }
    }
    cut_at_median(mesh, group, axis)
}

/// Cuts a group of two or more triangles where the surface-area heuristic is least.
fn cut_by_count(mesh: &Mesh, group: Vec<u32>) -> (Vec<u32>, Vec<u32>) {
    let centroids = Bounds::of(group.iter().map(|&t| centroid(mesh, t)));
    match cheapest_cut(mesh, &group, &centroids) {
        Some(cut) => {
            group.iter().partition(|&&t| bin_of(centroid(mesh, t), &centroids)[cut.axis] < cut.first_high_bin)
        }
        None => cut_at_median(mesh, group, longest_axis(centroids.extent())),
    }
}

/// Two halves by rank along `axis`; equal centroids are ordered by index.
fn cut_at_median(mesh: &Mesh, mut group: Vec<u32>, axis: usize) -> (Vec<u32>, Vec<u32>) {
    let middle = group.len() / 2;
    let rank = |t: u32| centroid(mesh, t)[axis];
    group.select_nth_unstable_by(middle, |&a, &b| rank(a).total_cmp(&rank(b)).then(a.cmp(&b)));
    let mut high = group.split_off(middle);
    // Selection leaves both halves in an order of its own; the mesh's order has better locality.
    group.sort_unstable();
    high.sort_unstable();
    (group, high)
}

struct Cut {
    axis: usize,
    first_high_bin: usize,
}

#[derive(Clone, Copy)]
struct Bin {
    count: usize,
    bounds: Bounds,
}

impl Bin {
    const EMPTY: Bin = Bin { count: 0, bounds: Bounds::EMPTY };

    fn union(&self, other: &Bin) -> Bin {
        Bin { count: self.count + other.count, bounds: self.bounds.union(&other.bounds) }
    }
}

/// Bin of a centroid, per axis.
fn bin_of(centroid: DVec3, centroids: &Bounds) -> [usize; 3] {
    let at = (centroid - centroids.min) / centroids.extent();
    // On a flat axis this is 0/0; `as` makes it bin 0.
    at.to_array().map(|at| ((at * BINS as f64) as usize).min(BINS - 1))
}

/// `None` when no cut leaves enough on both sides.
fn cheapest_cut(mesh: &Mesh, group: &[u32], centroids: &Bounds) -> Option<Cut> {
    let mut bins = [[Bin::EMPTY; BINS]; 3];
    for &triangle in group {
        let one = Bin { count: 1, bounds: Bounds::of(corners(mesh, triangle)) };
        for (axis, bin) in bin_of(centroid(mesh, triangle), centroids).into_iter().enumerate() {
            bins[axis][bin] = bins[axis][bin].union(&one);
        }
    }
    let fewest = (group.len() / MAX_IMBALANCE).max(1);
    let mut best: Option<(f64, Cut)> = None;
    for (axis, bins) in bins.iter().enumerate() {
        // highs[i] is everything from bin i on.
        let mut highs = [Bin::EMPTY; BINS + 1];
        for i in (0..BINS).rev() {
            highs[i] = highs[i + 1].union(&bins[i]);
        }
        let mut low = Bin::EMPTY;
        for first_high_bin in 1..BINS {
            low = low.union(&bins[first_high_bin - 1]);
            let high = &highs[first_high_bin];
            if low.count < fewest || high.count < fewest {
                continue;
            }
            let cost =
                low.bounds.half_area() * low.count as f64 + high.bounds.half_area() * high.count as f64;
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, Cut { axis, first_high_bin }));
            }
        }
    }
    best.map(|(_, cut)| cut)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn soup(seed: u64, count: u32, size: f64, place: impl Fn(&mut oorandom::Rand64) -> DVec3) -> Mesh {
        let mut random = oorandom::Rand64::new(seed.into());
        let mut mesh = Mesh::default();
        for i in 0..count {
            let at = place(&mut random);
            for _ in 0..3 {
                let [x, y, z] = [0; 3].map(|_| random.rand_float() * size);
                mesh.positions.push(at + DVec3::new(x, y, z));
            }
            mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        mesh
    }

    fn anywhere(random: &mut oorandom::Rand64) -> DVec3 {
        DVec3::from_array([0; 3].map(|_| random.rand_float()))
    }

    #[test]
    fn every_triangle_is_in_exactly_one_group_within_the_limits() {
        for seed in 0..4 {
            let limits = Limits { max_triangles: 100, max_extent: Some(DVec3::new(0.3, 0.5, 2.0)) };
            let mesh = soup(seed, 5_000, 0.01, anywhere);
            let groups = split(&mesh, &limits);
            let mut all: Vec<u32> = groups.concat();
            all.sort_unstable();
            assert!(all.into_iter().eq(0..5_000), "seed {seed}");
            for group in &groups {
                assert!(!group.is_empty() && group.len() <= 100, "seed {seed}: {} triangles", group.len());
                let extent = Bounds::of_triangles(&mesh, group).extent();
                assert!(extent.x <= 0.3 && extent.y <= 0.5, "seed {seed}: extent {extent}");
            }
            assert!(groups.len() < 5_000 / 8, "seed {seed}: {} groups", groups.len());
        }
    }

    #[test]
    fn triangles_in_one_place_are_split_by_rank() {
        let mesh =
            Mesh { positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y], triangles: vec![[0, 1, 2]; 1_000] };
        let groups = split(&mesh, &Limits { max_triangles: 300, max_extent: Some(DVec3::splat(2.0)) });
        assert_eq!(groups.iter().map(Vec::len).collect::<Vec<_>>(), [250; 4]);
        assert_eq!(groups[1][0], 250);
    }

    #[test]
    fn triangles_longer_than_the_limit_end_alone() {
        let mesh = soup(1, 64, 1.0, |_| DVec3::ZERO);
        let groups = split(&mesh, &Limits { max_triangles: 100, max_extent: Some(DVec3::splat(1e-6)) });
        assert_eq!(groups.len(), 64);
    }

    #[test]
    fn clusters_are_not_cut_through() {
        // Two far clusters, unequal: the heuristic finds the gap where the median would not.
        let mesh = soup(3, 900, 0.01, |r| {
            anywhere(r) + if r.rand_u64().is_multiple_of(3) { 100.0 } else { 0.0 } * DVec3::X
        });
        let groups = split(&mesh, &Limits { max_triangles: 800, max_extent: None });
        assert_eq!(groups.len(), 2);
        assert!(groups.iter().all(|g| Bounds::of_triangles(&mesh, g).extent().x < 2.0));
    }

    #[test]
    fn groups_are_equal_for_any_number_of_threads() {
        let mesh = soup(9, PARALLEL_TRIANGLES as u32 + 1_000, 0.001, anywhere);
        let split_on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| split(&mesh, &Limits { max_triangles: 1_000, max_extent: None }))
        };
        assert_eq!(split_on(1), split_on(3));
    }
}
