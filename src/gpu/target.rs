//! Textures that a frame is drawn into, and how they are read back.

use bytemuck::Pod;
use wgpu::{Extent3d, Texture, TextureFormat, TextureUsages, TextureView};

use super::context::{Context, GpuError};

/// Of the depth buffer.
pub const DEPTH: TextureFormat = TextureFormat::Depth32Float;
/// Of drawables, [`NOBODY`] where nothing is.
pub const DRAWABLE: TextureFormat = TextureFormat::R32Uint;
/// Of normals, `shaders/octahedral.wgsl`.
pub const NORMAL: TextureFormat = TextureFormat::R32Uint;
/// Of colours, sRGB bytes as they are.
pub const COLOUR: TextureFormat = TextureFormat::Rgba8Unorm;
/// Of the picture, likewise.
pub const PICTURE: TextureFormat = TextureFormat::Rgba8Unorm;

/// Of weighted sums over transparent surfaces.
pub const GLASS_SUM: TextureFormat = TextureFormat::Rgba16Float;
/// Of what comes through them.
pub const GLASS_THROUGH: TextureFormat = TextureFormat::R8Unorm;

/// Where nothing is drawn.
pub use crate::render::NOBODY;

/// A texture of a frame.
#[derive(Clone, Debug)]
pub struct Target {
    texture: Texture,
    /// All of it.
    pub view: TextureView,
}

impl Target {
    fn new(context: &Context, label: &str, format: TextureFormat, size: (u32, u32)) -> Self {
        let texture = context.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: TextureUsages::RENDER_ATTACHMENT
                | TextureUsages::TEXTURE_BINDING
                | TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = texture.create_view(&Default::default());
        Target { texture, view }
    }

    /// Copies it back, row by row, and waits. `T` is a texel.
    ///
    /// # Errors
    ///
    /// The driver reports one.
    ///
    /// # Panics
    ///
    /// `T` is not as long as a texel.
    pub fn read<T: Pod>(&self, context: &Context) -> Result<Vec<T>, GpuError> {
        let (width, height) = (self.texture.width(), self.texture.height());
        let texel = self.texture.format().block_copy_size(None).unwrap_or(0);
        assert_eq!(size_of::<T>(), texel as usize, "a texel");
        let row = (width * texel).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let staging = context.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read back"),
            size: u64::from(row) * u64::from(height),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = context.device.create_command_encoder(&Default::default());
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
        encoder.copy_texture_to_buffer(
            self.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &staging, layout },
            self.texture.size(),
        );
        context.queue.submit([encoder.finish()]);
        let bytes = context.read_mapped(&staging)?;
        let rows = bytes.chunks(row as usize).map(|row| &row[..(width * texel) as usize]);
        Ok(rows.flat_map(bytemuck::pod_collect_to_vec::<u8, T>).collect())
    }
}

/// The textures of a frame.
#[derive(Clone, Debug)]
pub struct Targets {
    /// Columns, rows.
    pub size: (u32, u32),
    /// Reverse-Z.
    pub depth: Target,
    /// Drawables.
    pub drawable: Target,
    /// Normals.
    pub normal: Target,
    /// Colours.
    pub colour: Target,
    /// Weighted sums over transparent surfaces.
    pub glass_sum: Target,
    /// What comes through them.
    pub glass_through: Target,
    /// What is shown.
    pub picture: Target,
}

impl Targets {
    /// For pictures of this size.
    ///
    /// # Errors
    ///
    /// Larger than the adapter's textures.
    pub fn new(context: &Context, size: (u32, u32)) -> Result<Self, GpuError> {
        let most = context.device.limits().max_texture_dimension_2d;
        if size.0.max(size.1) > most {
            return Err(GpuError::TooLarge {
                adapter: context.name.clone(),
                what: "pixels of a side of the picture",
                bytes: size.0.max(size.1).into(),
                most: most.into(),
            });
        }
        let target = |label, format| Target::new(context, label, format, size);
        Ok(Targets {
            size,
            depth: target("depth", DEPTH),
            drawable: target("drawable", DRAWABLE),
            normal: target("normal", NORMAL),
            colour: target("colour", COLOUR),
            glass_sum: target("glass sum", GLASS_SUM),
            glass_through: target("glass through", GLASS_THROUGH),
            picture: target("picture", PICTURE),
        })
    }
}
