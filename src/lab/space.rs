//! Where there is room for an eye: rays against the voxels. The same on every machine, as the rays are.

use glam::DVec3;
use voxsight_voxel::raycast::{GridRay, Next, RayCaster};

use crate::container::Meta;
use crate::visibility::QueryScene;

/// Eye height of a person, metres.
const PERSON_M: f64 = 1.7;
/// A person's size stays within these fractions of the scene's diagonal, whatever unit the file claims: a person of
/// 1.7 mm or 1.7 km sees nothing worth measuring.
const PERSON_IN_SCENE: (f64, f64) = (1.0 / 1000.0, 1.0 / 20.0);

/// What is free around a point. Hidden drawables and clip planes are not looked at: voxels are voxels.
#[derive(Clone, Copy)]
pub struct Space<'a> {
    scene: QueryScene<'a>,
    caster: RayCaster<'a>,
    /// Low corner of the model, world.
    pub min: DVec3,
    /// High corner.
    pub max: DVec3,
    /// Length 1.
    pub up: DVec3,
    /// Eye height of a person, world units: 1.7 m, but never out of proportion to the scene.
    pub person: f64,
}

/// The first occupied voxel along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstVoxel {
    /// World units from the ray's origin, 0 inside an occupied voxel.
    pub distance: f64,
    /// The voxel's first owner, a drawable.
    pub owner: Option<u32>,
}

impl<'a> Space<'a> {
    /// The space of an opened scene.
    pub fn new(scene: QueryScene<'a>, meta: &Meta) -> Self {
        let (min, max) = (DVec3::from(meta.bounds.min), DVec3::from(meta.bounds.max));
        let diagonal = (max - min).length();
        let person = (PERSON_M / meta.settings.metres_per_unit)
            .clamp(diagonal * PERSON_IN_SCENE.0, diagonal * PERSON_IN_SCENE.1);
        Space { scene, caster: RayCaster::new(scene.dag), min, max, up: meta.settings.up.unit(), person }
    }

    /// Is the point in an occupied voxel?
    pub fn is_occupied(&self, point: DVec3) -> bool {
        self.scene.dag.is_occupied(self.scene.grid.grid_from_world(point).floor().as_ivec3().to_array())
    }

    /// What is met first in a direction (length 1).
    pub fn first_voxel(&self, origin: DVec3, direction: DVec3) -> Option<FirstVoxel> {
        let grid = self.scene.grid;
        let mut first = None;
        self.caster.cast(&GridRay::new(grid.grid_from_world(origin), direction), |hit| {
            let owners = self.scene.owners.of_brick(hit.brick_ordinal(), hit.brick_mask());
            let owner = owners.of_voxel(hit.bit()).next();
            first = Some(FirstVoxel { distance: hit.t().max(0.0) * grid.voxel_size, owner });
            Next::End
        });
        first
    }

    /// Free length in a direction (length 1), world units; infinite when nothing is met.
    pub fn clearance(&self, origin: DVec3, direction: DVec3) -> f64 {
        self.first_voxel(origin, direction).map_or(f64::INFINITY, |first| first.distance)
    }

    /// A unit vector by its angle in the ground plane and its height above it, radians.
    pub fn direction(&self, yaw: f64, pitch: f64) -> DVec3 {
        let side = DVec3::new(self.up.y, self.up.z, self.up.x);
        let level = side * libm::cos(yaw) + self.up.cross(side) * libm::sin(yaw);
        level * libm::cos(pitch) + self.up * libm::sin(pitch)
    }
}
