//! Textures that a frame is drawn into, and how they are read back.

use std::sync::mpsc::{Receiver, TryRecvError, channel};

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

    /// Copies it back; does not wait. (All of it: no piece of a depth buffer can be copied alone.)
    pub fn read_later(&self, context: &Context) -> TextureRead {
        let (width, height) = (self.texture.width(), self.texture.height());
        let texel = self.texture.format().block_copy_size(None).unwrap_or(0);
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
        let to = wgpu::TexelCopyBufferInfo { buffer: &staging, layout };
        encoder.copy_texture_to_buffer(self.texture.as_image_copy(), to, self.texture.size());
        context.queue.submit([encoder.finish()]);
        let (tell, mapped) = channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            // Nobody wants to know any more.
            let _ = tell.send(result);
        });
        TextureRead { staging, mapped, row, width, height, texel }
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
        let read = self.read_later(context);
        context.wait()?;
        // Another thread's poll may be about to tell it.
        loop {
            if let Some(texels) = read.take(context)? {
                return Ok(texels);
            }
            std::thread::yield_now();
        }
    }
}

/// A texture on its way back.
#[derive(Debug)]
pub struct TextureRead {
    staging: wgpu::Buffer,
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
    row: u32,
    width: u32,
    height: u32,
    texel: u32,
}

impl TextureRead {
    /// The texels row by row, when they are there. `T` is a texel.
    ///
    /// # Errors
    ///
    /// The driver reports one; they were taken before.
    ///
    /// # Panics
    ///
    /// `T` is not as long as a texel.
    pub fn take<T: Pod>(&self, context: &Context) -> Result<Option<Vec<T>>, GpuError> {
        assert_eq!(size_of::<T>(), self.texel as usize, "a texel");
        context.poll(wgpu::PollType::Poll)?;
        let failed = |reason: String| GpuError::Failed(reason);
        match self.mapped.try_recv() {
            Err(TryRecvError::Empty) => return Ok(None),
            Err(TryRecvError::Disconnected) => return Err(failed("texels were taken twice".into())),
            Ok(mapped) => mapped.map_err(|error| failed(error.to_string()))?,
        }
        let bytes = self.staging.get_mapped_range(..).map_err(|error| failed(error.to_string()))?;
        let rows = bytes.chunks(self.row as usize).take(self.height as usize);
        let texels = rows.map(|row| &row[..(self.width * self.texel) as usize]);
        Ok(Some(texels.flat_map(bytemuck::pod_collect_to_vec::<u8, T>).collect()))
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
