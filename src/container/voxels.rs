//! The voxel sections: checked by the voxel core, compared with what [`Meta`] says of them.

use voxsight_voxel::dag::owners::OwnersIndex;
use voxsight_voxel::dag::{DagError, DagRef};

use super::error::{ContainerError, Damage};
use super::layout::SectionKind;
use super::meta::Meta;
use super::read::Container;

/// The voxel sections of a container.
pub(super) struct VoxelSections<'a> {
    pub nodes: &'a [u32],
    pub counts: &'a [u32],
    pub leaves: &'a [u64],
    pub owner_directory: &'a [[u64; 2]],
    pub owner_pages: &'a [u64],
}

impl VoxelSections<'_> {
    /// Checks every word, and returns the index for owner lookups.
    pub fn check(&self, meta: &Meta) -> Result<OwnersIndex, Damage> {
        let (dag, statistics) = DagRef::validate(&meta.dag_shape(), self.nodes, self.counts, self.leaves)
            .map_err(|error| damage(SectionKind::DagNodes, error))?;
        let found = (statistics.bricks, statistics.voxels);
        if found != (meta.dag.brick_count, meta.dag.voxel_count) {
            let expected = format!("{} bricks and {} voxels in the dag", found.0, found.1);
            return Err(Damage::section(SectionKind::Meta.name(), expected, format!("{:?}", meta.dag)));
        }
        // Checked against the sections before, and below 2^27.
        let drawables = meta.counts.drawables as u32;
        OwnersIndex::validate(self.owner_directory, self.owner_pages, dag.brick_count(), drawables)
            .map_err(|error| damage(SectionKind::OwnerPages, error))
    }
}

/// Checks that owners and voxels agree, in time bounded by the bytes of the owner pages.
pub(super) fn check_owner_masks(container: &Container) -> Result<(), ContainerError> {
    let checked = container.owners().check_masks(&container.dag());
    checked.map_err(|error| ContainerError::new(container.path(), damage(SectionKind::OwnerPages, error)))
}

fn damage(kind: SectionKind, error: DagError) -> Damage {
    match error {
        DagError::Broken { rule, place } => {
            Damage::section(kind.name(), rule, format!("otherwise at {place}"))
        }
        other => Damage::section(kind.name(), "voxels within the limits", other),
    }
}
