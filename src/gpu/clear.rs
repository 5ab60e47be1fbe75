//! Voxels that stop no light though they are occupied: all their owners are of glass, hidden, looked through or elsewhere.
//!
//! Shaders do not know who owns a voxel. The bricks in which such voxels are go into a hash table beside the DAG, which is looked
//! up where a ray meets a voxel, and is empty for most scenes. It is made anew when things are hidden or shown; the voxels are not.

use glam::{IVec3, UVec2};
use voxsight_voxel::dag::{DagRef, OwnersRef};

use super::twin::{bit_of, hash_of};

/// Marks a free slot, in the place of `z`.
const FREE: u32 = u32::MAX;

/// A slot: x and y of the brick (16 bits each), z, the mask's halves.
type Slot = [u32; 4];

/// A hash table with linear probing; no slots where every voxel casts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ClearBricks {
    slots: Vec<Slot>,
}

impl ClearBricks {
    /// Of a scene in which `casts` tells whether a drawable stops light.
    pub fn new(dag: &DagRef, owners: &OwnersRef, casts: impl Fn(u32) -> bool) -> Self {
        let mut found = Vec::new();
        dag.for_each_brick(|corner, ordinal, mask| {
            if owners.all_of_brick(ordinal).all(&casts) {
                return;
            }
            let stopping = owners.of_brick(ordinal, mask).masks().into_iter();
            let stopping = stopping.filter(|&(owner, _)| casts(owner)).fold(0, |all, (_, mask)| all | mask);
            let clear = mask & !stopping;
            if clear != 0 {
                found.push((corner, clear));
            }
        });
        Self::of(&found)
    }

    /// Of bricks: low corner, voxels that do not cast.
    fn of(found: &[([i32; 3], u64)]) -> Self {
        if found.is_empty() {
            return ClearBricks::default();
        }
        // Half full at most, so that probing ends soon, and at a free slot.
        let count = (2 * found.len()).next_power_of_two();
        let mut slots = vec![[0, FREE, 0, 0]; count];
        for &(corner, mask) in found {
            let key = key_of(IVec3::from(corner));
            let mut at = hash_of(key) as usize & (count - 1);
            while slots[at][1] != FREE {
                at = (at + 1) & (count - 1);
            }
            slots[at] = [key.x, key.y, mask as u32, (mask >> 32) as u32];
        }
        ClearBricks { slots }
    }

    /// Does this occupied voxel stop no light?
    pub fn is_clear(&self, voxel: IVec3) -> bool {
        let Some(last) = self.slots.len().checked_sub(1) else { return false };
        let key = key_of(voxel);
        let mut at = hash_of(key) as usize & last;
        loop {
            let [xy, z, low, high] = self.slots[at];
            if z == FREE {
                return false;
            }
            if (xy, z) == (key.x, key.y) {
                return (u64::from(low) | u64::from(high) << 32) >> bit_of(voxel) & 1 == 1;
            }
            at = (at + 1) & last;
        }
    }

    /// Slots less one, as shaders want it; 0 for none.
    pub(super) fn last_slot(&self) -> u32 {
        self.slots.len().saturating_sub(1) as u32
    }

    /// For a buffer, which cannot be empty.
    pub(super) fn contents(&self) -> Vec<Slot> {
        if self.slots.is_empty() { vec![[0, FREE, 0, 0]] } else { self.slots.clone() }
    }
}

fn key_of(voxel: IVec3) -> UVec2 {
    let brick = (voxel >> 2i32).as_uvec3();
    UVec2::new(brick.x | brick.y << 16, brick.z)
}
