//! Who owns which voxels, in the GPU's memory, as `shaders/owners.wgsl` reads it: pages and their directory in one space of addresses.

use bytemuck::{Pod, Zeroable};
use voxsight_voxel::dag::{DagRef, OwnersRef};

use super::context::{Context, GpuError};
use super::memory::Slabs;
use super::shader::OWNERS_CONSTANTS;

/// `Owners` of `shaders/owners.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
#[allow(missing_docs, reason = "told where shaders read them")]
pub struct OwnersUniform {
    pub pages: u32,
    pub directory_at: u32,
    pub padding_0: u32,
    pub padding_1: u32,
}

/// Owners that shaders can read.
#[derive(Debug)]
pub struct GpuOwners {
    slabs: Slabs,
    uniform: wgpu::Buffer,
}

impl GpuOwners {
    /// Copies the owners of a DAG.
    ///
    /// # Errors
    ///
    /// More than the adapter can hold; more bricks than 32 bits count.
    pub fn new(context: &Context, dag: &DagRef, owners: &OwnersRef) -> Result<Self, GpuError> {
        let too_many = |bytes: u64| GpuError::TooLarge {
            adapter: context.name.clone(),
            what: "bricks, or words of their owners",
            bytes,
            most: u32::MAX.into(),
        };
        if dag.brick_count() > u32::MAX.into() {
            return Err(too_many(dag.brick_count()));
        }
        let (directory, pages) = owners.arrays();
        // In words of 32 bits.
        let directory_at = u32::try_from(2 * pages.len()).map_err(|_| too_many(2 * pages.len() as u64))?;
        let directory: Vec<[u32; 2]> =
            directory.iter().map(|&[ordinal, word]| [ordinal as u32, 2 * word as u32]).collect();
        let (pages, directory): (&[u8], &[u8]) =
            (bytemuck::cast_slice(pages), bytemuck::cast_slice(&directory));
        let slabs =
            Slabs::new(context, "bytes of the owners of voxels", (pages.len() + directory.len()) as u64)?;
        slabs.write(context, 0, pages);
        slabs.write(context, pages.len() as u64, directory);
        let uniform =
            OwnersUniform { pages: (directory.len() / 8) as u32, directory_at, ..OwnersUniform::default() };
        let uniform = context.uniform("owners", &uniform);
        Ok(GpuOwners { slabs, uniform })
    }

    /// What `shaders/owners.wgsl` needs to know.
    pub fn constants(&self) -> [(&'static str, f64); 2] {
        self.slabs.constants(OWNERS_CONSTANTS)
    }

    /// Bytes of pages and directory.
    pub fn bytes(&self) -> u64 {
        self.slabs.bytes()
    }

    /// Bindings of group 2.
    pub fn bind(&self, context: &Context, layout: &wgpu::BindGroupLayout) -> wgpu::BindGroup {
        let resources = self.slabs.bindings().into_iter().chain([self.uniform.as_entire_binding()]);
        context.bind("owners", layout, resources)
    }
}
