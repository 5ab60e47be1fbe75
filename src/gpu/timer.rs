//! How long passes take on the GPU, by its own clock.

use wgpu::{Buffer, BufferUsages, CommandEncoder, QuerySet};

use super::context::{Context, GpuError};

/// Passes of a frame, at most.
const MOST: u32 = 16;

/// A frame that is being recorded, pass after pass.
#[derive(Debug)]
pub struct Recording<'a> {
    /// Whose frame.
    pub context: &'a Context,
    /// What passes are recorded into.
    pub encoder: &'a mut CommandEncoder,
    /// Times them.
    pub timer: &'a mut Timer,
}

/// Times the passes of a frame; does nothing where the adapter cannot.
#[derive(Debug)]
pub struct Timer {
    sets: Option<(QuerySet, Buffer)>,
    names: Vec<&'static str>,
    /// Nanoseconds a tick.
    period: f64,
}

impl Timer {
    /// Made once, used every frame.
    pub fn new(context: &Context) -> Self {
        let sets = context.has_timestamps.then(|| {
            let set = context.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("times"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * MOST,
            });
            let buffer = context.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("times"),
                size: u64::from(2 * MOST) * 8,
                usage: BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            });
            (set, buffer)
        });
        Timer { sets, names: Vec::new(), period: f64::from(context.queue.get_timestamp_period()) }
    }

    /// Forgets the passes before.
    pub fn begin(&mut self) {
        self.names.clear();
    }

    fn next(&mut self, name: &'static str) -> Option<(&QuerySet, u32)> {
        let (set, _) = self.sets.as_ref()?;
        let index = 2 * self.names.len() as u32;
        (index < 2 * MOST).then(|| {
            self.names.push(name);
            (set, index)
        })
    }

    /// For a render pass.
    pub fn render_pass(&mut self, name: &'static str) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let (query_set, index) = self.next(name)?;
        Some(wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(index),
            end_of_pass_write_index: Some(index + 1),
        })
    }

    /// For a compute pass.
    pub fn compute_pass(&mut self, name: &'static str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let (query_set, index) = self.next(name)?;
        Some(wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(index),
            end_of_pass_write_index: Some(index + 1),
        })
    }

    /// Records what [`Timer::read`] needs, after the last pass.
    pub fn end(&self, encoder: &mut CommandEncoder) {
        if let Some((set, buffer)) = &self.sets
            && !self.names.is_empty()
        {
            encoder.resolve_query_set(set, 0..2 * self.names.len() as u32, buffer, 0);
        }
    }

    /// Milliseconds of each pass; waits for them.
    ///
    /// # Errors
    ///
    /// The driver reports one.
    pub fn read(&self, context: &Context) -> Result<Vec<(&'static str, f64)>, GpuError> {
        let Some((_, buffer)) = &self.sets else { return Ok(Vec::new()) };
        let ticks: Vec<u64> = bytemuck::pod_collect_to_vec(&context.read(buffer)?);
        let pairs =
            ticks.chunks_exact(2).map(|pair| pair[1].saturating_sub(pair[0]) as f64 * self.period * 1e-6);
        Ok(self.names.iter().copied().zip(pairs).collect())
    }
}
