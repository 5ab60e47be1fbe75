//! Cameras that every scene can have: found from its box and its voxels.

use glam::DVec3;
use voxsight::scene::Scene;
use voxsight_voxel::dag::DagRef;
use voxsight_voxel::grid::Grid;
use voxsight_voxel::raycast::GridRay;

/// Pixels a side of a tile: one packet.
pub const TILE: usize = 8;

/// A pinhole camera of square pixels, the same rays for every contender: not normalized, so that making them costs
/// little.
pub struct Pinhole {
    pub eye: DVec3,
    pub target: DVec3,
    pub up: DVec3,
    corner: DVec3,
    right: DVec3,
    down: DVec3,
    size: usize,
    /// The same in voxels.
    grid_eye: DVec3,
}

/// A named camera.
pub struct View {
    pub name: &'static str,
    pub camera: Pinhole,
}

impl Pinhole {
    fn new(grid: Grid, eye: DVec3, target: DVec3, size: usize) -> Self {
        let forward = (target - eye).normalize_or_zero();
        let up = if forward.z.abs() > 0.99 { DVec3::Y } else { DVec3::Z };
        let reach = 30f64.to_radians().tan();
        let right = forward.cross(up).normalize_or_zero() * reach;
        let down = forward.cross(right).normalize_or_zero() * reach;
        Pinhole {
            eye,
            target,
            up,
            corner: forward - right - down,
            right: right * (2.0 / size as f64),
            down: down * (2.0 / size as f64),
            size,
            grid_eye: grid.grid_from_world(eye),
        }
    }

    pub fn pixels(&self) -> usize {
        self.size * self.size
    }

    /// Upper left pixels of the tiles.
    pub fn tiles(&self) -> Vec<(usize, usize)> {
        let a_side = self.size / TILE;
        (0..a_side * a_side).map(|i| (i % a_side * TILE, i / a_side * TILE)).collect()
    }

    /// World directions of the pixels of a tile.
    #[inline]
    pub fn directions(&self, (column, row): (usize, usize)) -> impl Iterator<Item = DVec3> {
        (0..TILE * TILE).map(move |i| {
            let (x, y) = ((column + i % TILE) as f64 + 0.5, (row + i / TILE) as f64 + 0.5);
            self.corner + x * self.right + y * self.down
        })
    }

    /// The same as rays of grid space; only the parameter is another.
    #[inline]
    pub fn grid_rays(&self, tile: (usize, usize)) -> impl Iterator<Item = GridRay> {
        self.directions(tile).map(|direction| GridRay::new(self.grid_eye, direction))
    }
}

/// Six views: outside, far, top, inside, along, near.
pub fn views(scene: &Scene, size: usize) -> Vec<View> {
    let (grid, dag) = (scene.grid(), scene.dag());
    let (min, max) = bounds(&dag);
    let (min, max) = (grid.world_from_grid(min), grid.world_from_grid(max));
    let (centre, extent) = (0.5 * (min + max), max - min);
    let radius = 0.5 * extent.length();
    let view = |name, eye: DVec3, target: DVec3| View { name, camera: Pinhole::new(grid, eye, target, size) };
    let long = if extent.x >= extent.y { DVec3::X } else { DVec3::Y };
    let outside = centre + DVec3::new(-0.62, -0.66, 0.42) * 2.0 * radius;
    // In the open, as near the middle as may be, at the height where people stand.
    let inside = free_place(&grid, &dag, centre - DVec3::Z * 0.2 * extent.z, extent);
    let along = free_place(&grid, &dag, centre - (0.42 * long + 0.25 * DVec3::Z) * extent, extent);
    let towards = (centre - outside).normalize_or_zero();
    let ray = GridRay::new(grid.grid_from_world(outside), towards);
    let hit = dag
        .first_hit(&ray)
        .map_or(centre, |(voxel, _)| grid.world_from_grid(DVec3::from(voxel.map(f64::from))));
    vec![
        view("outside", outside, centre),
        view("far", centre + (outside - centre) * 4.0, centre),
        view("top", centre + DVec3::new(0.1, 0.05, 1.0) * 1.5 * radius, centre),
        view("inside", inside, inside + long + DVec3::new(0.2, 0.3, -0.1)),
        view("along", along, along + long + DVec3::new(0.01, 0.02, -0.003)),
        view("near", hit - towards * 0.04 * radius, hit),
    ]
}

/// Low and high corner of the occupied bricks, voxels.
fn bounds(dag: &DagRef) -> (DVec3, DVec3) {
    let (mut low, mut high) = ([i32::MAX; 3], [0; 3]);
    dag.for_each_brick(|corner, _, _| {
        for k in 0..3 {
            low[k] = low[k].min(corner[k]);
            high[k] = high[k].max(corner[k] + 4);
        }
    });
    (DVec3::from(low.map(f64::from)), DVec3::from(high.map(f64::from)))
}

/// The place nearest to `wanted` that has some room around it: nothing within 1 % of the extent along the six axes, and
/// something in five of them.
fn free_place(grid: &Grid, dag: &DagRef, wanted: DVec3, extent: DVec3) -> DVec3 {
    let mut random = oorandom::Rand64::new(11);
    let room = 0.01 * extent.max_element() / grid.voxel_size;
    let mut best = (f64::INFINITY, wanted);
    for _ in 0..4000 {
        let offset = DVec3::new(random.rand_float(), random.rand_float(), random.rand_float()) - 0.5;
        let place = wanted + 0.4 * offset * extent;
        let origin = grid.grid_from_world(place);
        let hits = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z]
            .map(|axis| dag.first_hit(&GridRay::new(origin, axis)).map(|(_, t)| t));
        let surrounded = hits.iter().flatten().count() >= 5;
        let free = hits.iter().flatten().all(|&t| t > room);
        if surrounded && free && offset.length() < best.0 {
            best = (offset.length(), place);
        }
    }
    best.1
}
