//! The adapter, its device, and what goes wrong with them.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use bytemuck::Pod;
use wgpu::{Adapter, Backends, Device, Features, Instance, InstanceDescriptor, Limits, PollType, Queue};

/// What to do where no adapter is found.
const INSTALL: &str = "install a graphics driver, or a software one (Debian, Ubuntu: apt-get install mesa-vulkan-drivers libvulkan1)";

/// Why the GPU cannot be used, or could not do what was asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// No driver, or none that works.
    #[error("no GPU was found ({0}): {INSTALL}")]
    NoAdapter(String),
    /// There are others.
    #[error("no GPU is named \"{wanted}\"; there are {found:?}. Without any, {INSTALL}")]
    NotNamed {
        /// As asked for.
        wanted: String,
        /// Those there are.
        found: Vec<String>,
    },
    /// The adapter lacks what everything here is built on.
    #[error(
        "{adapter} lacks {what}, which is needed: update its driver, or choose another adapter with WGPU_ADAPTER_NAME"
    )]
    Lacks {
        /// Its name.
        adapter: String,
        /// What is missing.
        what: String,
    },
    /// The device does not start.
    #[error("{adapter} does not start: {reason}")]
    Device {
        /// The adapter's name.
        adapter: String,
        /// As the driver says.
        reason: String,
    },
    /// Something is larger than the adapter can hold.
    #[error("{what}: {bytes}; {adapter} takes at most {most}")]
    TooLarge {
        /// The adapter's name.
        adapter: String,
        /// Of what.
        what: &'static str,
        /// That many, mostly bytes: `what` tells.
        bytes: u64,
        /// At most so many.
        most: u64,
    },
    /// The driver refused or lost something on the way.
    #[error("the GPU failed: {0}")]
    Failed(String),
}

/// Which adapter to take, and how to use it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ContextSettings {
    /// Part of the adapter's name, any case; `None`: what the environment variable `WGPU_ADAPTER_NAME` names, or else the fastest.
    pub adapter: Option<String>,
    /// Do without indirect draws, as adapters without first instances in them must.
    pub direct_draws: bool,
}

/// A device and its queue. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Context {
    /// Makes buffers, textures, pipelines.
    pub device: Device,
    /// Takes work.
    pub queue: Queue,
    /// The adapter's name.
    pub name: String,
    /// Its kind: discrete, integrated, CPU ...
    pub kind: wgpu::DeviceType,
    /// Indirect draws may say with which instance they begin.
    pub has_indirect: bool,
    /// Passes can be timed.
    pub has_timestamps: bool,
    most_bound: u64,
    fault: Arc<Mutex<Option<GpuError>>>,
    lost: Arc<OnceLock<String>>,
}

impl Context {
    /// Finds an adapter and starts it.
    ///
    /// # Errors
    ///
    /// There is none, or it does not do.
    pub fn new(settings: &ContextSettings) -> Result<Self, GpuError> {
        let backends = backends();
        let descriptor =
            InstanceDescriptor { backends, ..InstanceDescriptor::new_without_display_handle_from_env() };
        let instance = Instance::new(descriptor);
        let adapter = pollster::block_on(find_adapter(&instance, backends, settings))?;
        Self::with_adapter(&adapter, settings)
    }

    fn with_adapter(adapter: &Adapter, settings: &ContextSettings) -> Result<Self, GpuError> {
        let name = adapter.get_info().name;
        let descriptor = device_descriptor(adapter)?;
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| GpuError::Device { adapter: name, reason: error.to_string() })?;
        Ok(Self::of_device(adapter, device, queue, settings))
    }

    /// Of a device that somebody else has started, as [`device_descriptor`] says. Its errors are told here from now on.
    pub fn of_device(adapter: &Adapter, device: Device, queue: Queue, settings: &ContextSettings) -> Self {
        let (info, offered) = (adapter.get_info(), device.features());
        let fault = Arc::new(Mutex::new(None));
        let told = Arc::clone(&fault);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| note(&told, error.to_string())));
        let lost = Arc::new(OnceLock::new());
        let told = Arc::clone(&lost);
        device.set_device_lost_callback(move |reason, text| {
            if reason != wgpu::DeviceLostReason::Destroyed {
                // The first reason is the one.
                let _ = told.set(format!("the device is lost: {text}"));
            }
        });
        let limits = device.limits();
        let bound = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        Context {
            has_indirect: offered.contains(Features::INDIRECT_FIRST_INSTANCE) && !settings.direct_draws,
            has_timestamps: offered.contains(Features::TIMESTAMP_QUERY),
            most_bound: bound,
            kind: info.device_type,
            name: info.name,
            device,
            queue,
            fault,
            lost,
        }
    }

    /// Makes a buffer with these contents. A buffer that cannot be had is told by [`Context::check`], as all that fails there.
    pub fn buffer<T: Pod>(&self, label: &str, contents: &[T], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let contents: &[u8] = bytemuck::cast_slice(contents);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: contents.len() as u64,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.queue.write_buffer(&buffer, 0, contents);
        buffer
    }

    /// Makes a uniform buffer.
    pub fn uniform<T: Pod>(&self, label: &str, contents: &T) -> wgpu::Buffer {
        self.buffer(label, std::slice::from_ref(contents), wgpu::BufferUsages::UNIFORM)
    }

    /// Binds resources, numbered as they come.
    pub fn bind<'r>(
        &self,
        label: &str,
        layout: &wgpu::BindGroupLayout,
        resources: impl IntoIterator<Item = wgpu::BindingResource<'r>>,
    ) -> wgpu::BindGroup {
        let entries: Vec<wgpu::BindGroupEntry> = (0..)
            .zip(resources)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let label = Some(label);
        self.device.create_bind_group(&wgpu::BindGroupDescriptor { label, layout, entries: &entries })
    }

    /// Can so many bytes of something be bound at once?
    ///
    /// # Errors
    ///
    /// No.
    pub(super) fn check_bound(&self, what: &'static str, bytes: u64) -> Result<(), GpuError> {
        let most = self.most_bound;
        let too_large = || GpuError::TooLarge { adapter: self.name.clone(), what, bytes, most };
        (bytes <= most).then_some(()).ok_or_else(too_large)
    }

    /// Keeps an error for [`Context::check`], where it cannot be returned.
    pub(super) fn keep(&self, error: GpuError) {
        self.fault.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }

    /// Bytes of one storage buffer, at most.
    pub fn most_bound(&self) -> u64 {
        self.most_bound
    }

    /// Binds no more bytes of a storage buffer than these, for tests of what is paged: a space takes more slabs then.
    pub fn limit_bindings(&mut self, most: u64) {
        self.most_bound = self.most_bound.min(most);
    }

    /// Tells the first thing that went wrong since it was last asked: drivers report when they notice, not where it happened.
    ///
    /// # Errors
    ///
    /// The driver has reported one.
    pub fn check(&self) -> Result<(), GpuError> {
        self.check_alive()?;
        self.fault.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }

    /// A lost device is told again and again: nothing works any more.
    fn check_alive(&self) -> Result<(), GpuError> {
        self.lost.get().map_or(Ok(()), |lost| Err(GpuError::Failed(lost.clone())))
    }

    /// Lets the driver tell what it has done; with [`PollType::wait_indefinitely`], waits until that is all.
    ///
    /// # Errors
    ///
    /// The driver has reported one.
    pub(super) fn poll(&self, how: PollType) -> Result<(), GpuError> {
        // `wgpu` panics when it waits for a lost device: where that is known, it is not asked.
        self.check_alive()?;
        self.device.poll(how).map_err(|error| GpuError::Failed(error.to_string()))?;
        self.check()
    }

    /// Waits until all submitted work is done.
    ///
    /// # Errors
    ///
    /// The driver reports one.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.poll(PollType::wait_indefinitely())
    }

    /// Copies a buffer back and waits for it.
    ///
    /// # Errors
    ///
    /// The driver reports one.
    pub fn read(&self, buffer: &wgpu::Buffer) -> Result<Vec<u8>, GpuError> {
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read back"),
            size: buffer.size(),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
        self.queue.submit([encoder.finish()]);
        self.read_mapped(&staging)
    }

    /// Waits for a buffer that can be mapped, and copies it.
    ///
    /// # Errors
    ///
    /// The driver reports one.
    pub fn read_mapped(&self, staging: &wgpu::Buffer) -> Result<Vec<u8>, GpuError> {
        let (tell, told) = std::sync::mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            // Nobody listens any more only when waiting has failed, which is told.
            let _ = tell.send(result);
        });
        self.wait()?;
        let failed = |reason: String| GpuError::Failed(reason);
        told.recv().map_err(|e| failed(e.to_string()))?.map_err(|e| failed(e.to_string()))?;
        let bytes = staging.get_mapped_range(..).map_err(|e| failed(e.to_string()))?.to_vec();
        staging.unmap();
        Ok(bytes)
    }
}

/// Keeps the first fault: what follows is mostly its consequence.
fn note(fault: &Mutex<Option<GpuError>>, text: String) {
    fault.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(GpuError::Failed(text));
}

/// What is looked for: what `WGPU_BACKEND` says, else Vulkan, Metal, Direct3D 12. OpenGL takes long to start where nobody wants it, and is
/// not tested.
pub fn backends() -> Backends {
    Backends::from_env().unwrap_or(Backends::PRIMARY)
}

async fn find_adapter(
    instance: &Instance,
    backends: Backends,
    settings: &ContextSettings,
) -> Result<Adapter, GpuError> {
    let named = settings.adapter.clone().or_else(|| std::env::var("WGPU_ADAPTER_NAME").ok());
    let Some(wanted) = named.filter(|name| !name.is_empty()) else {
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        };
        return instance.request_adapter(&options).await.map_err(|e| GpuError::NoAdapter(e.to_string()));
    };
    let adapters = instance.enumerate_adapters(backends).await;
    let names: Vec<String> = adapters.iter().map(|adapter| adapter.get_info().name).collect();
    let is_wanted =
        |adapter: &Adapter| adapter.get_info().name.to_lowercase().contains(&wanted.to_lowercase());
    adapters.into_iter().find(is_wanted).ok_or(GpuError::NotNamed { wanted, found: names })
}

/// What is asked of a device: what the adapter has of what is used here.
///
/// # Errors
///
/// The adapter lacks what is needed.
pub fn device_descriptor(adapter: &Adapter) -> Result<wgpu::DeviceDescriptor<'static>, GpuError> {
    let wanted = Features::INDIRECT_FIRST_INSTANCE | Features::TIMESTAMP_QUERY;
    Ok(wgpu::DeviceDescriptor {
        label: Some("voxsight"),
        required_features: adapter.features() & wanted,
        required_limits: needed_limits(&adapter.limits(), &adapter.get_info().name)?,
        ..Default::default()
    })
}

/// The adapter's own limits, so that nothing is refused that it can do.
fn needed_limits(offered: &Limits, name: &str) -> Result<Limits, GpuError> {
    let lacks = |what: String| Err(GpuError::Lacks { adapter: name.to_owned(), what });
    if offered.max_storage_buffers_per_shader_stage < 8 {
        return lacks("8 storage buffers a shader".to_owned());
    }
    if offered.max_color_attachments < 3 {
        return lacks("3 colour attachments".to_owned());
    }
    Ok(offered.clone())
}
