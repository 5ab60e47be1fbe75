//! Memory of the GPU: one space of addresses over up to [`SLABS`] buffers, since a shader can bind only so many bytes of each.

use std::iter;

use wgpu::{Buffer, BufferDescriptor, BufferUsages, CommandEncoder};

use super::context::{Context, GpuError};
use crate::streaming::Memory;

/// Buffers that a space is made of, at most; shaders bind them all.
pub const SLABS: usize = 4;

/// Bytes are copied inside the memory through a buffer of this size.
const BOUNCE: u64 = 1 << 20;

/// A space of addresses. Shaders read it word by word (`pool_word` of `shaders/page.wgsl`, and its like).
#[derive(Debug)]
pub struct Slabs {
    buffers: Vec<Buffer>,
    /// log2 of the words of a slab.
    shift: u32,
    bytes: u64,
}

/// A piece of a space: slab, offset there, bytes.
type Piece = (usize, u64, u64);

impl Slabs {
    /// Makes one.
    ///
    /// # Errors
    ///
    /// More than [`SLABS`] buffers of what the adapter binds.
    pub fn new(context: &Context, what: &'static str, bytes: u64) -> Result<Self, GpuError> {
        let bytes = bytes.next_multiple_of(4).max(4);
        // A power of two, so that shaders find a slab by shifting.
        let largest = 1u64 << context.most_bound().max(4).ilog2();
        let slab = bytes.next_power_of_two().min(largest);
        // Addresses are 32-bit numbers of words.
        let most = (SLABS as u64 * largest).min(4 << 32);
        if bytes > most {
            return Err(GpuError::TooLarge { adapter: context.name.clone(), what, bytes, most });
        }
        let buffers = (0..bytes.div_ceil(slab)).map(|index| {
            context.device.create_buffer(&BufferDescriptor {
                label: Some(what),
                size: slab.min(bytes - index * slab),
                usage: BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            })
        });
        Ok(Slabs { buffers: buffers.collect(), shift: slab.ilog2() - 2, bytes })
    }

    /// What shaders need to know: the values of `NAME_SHIFT`, log2 of the words of a slab, and `NAME_SLABS`.
    pub fn constants<'n>(&self, [shift, slabs]: [&'n str; 2]) -> [(&'n str, f64); 2] {
        // A single slab is not looked for: another size of it is no other shader.
        let own = if self.buffers.len() > 1 { self.shift } else { 0 };
        [(shift, own.into()), (slabs, self.buffers.len() as f64)]
    }

    /// Bytes of all slabs.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// One buffer for each of [`SLABS`] bindings; those that are not there are the first again.
    pub fn bindings(&self) -> [wgpu::BindingResource<'_>; SLABS] {
        [0, 1, 2, 3].map(|i| self.buffers.get(i).unwrap_or(&self.buffers[0]).as_entire_binding())
    }

    fn slab_bytes(&self) -> u64 {
        4 << self.shift
    }

    /// The pieces of a range, none across two slabs or longer than `longest`.
    fn pieces(&self, offset: u64, bytes: u64, longest: u64) -> impl Iterator<Item = Piece> {
        let (slab, end) = (self.slab_bytes(), offset + bytes);
        let mut at = offset;
        iter::from_fn(move || {
            let length = (end - at).min(slab - at % slab).min(longest);
            let piece = (length > 0).then_some(((at / slab) as usize, at % slab, length));
            at += length;
            piece
        })
    }

    /// Copies all of it back, and waits.
    ///
    /// # Errors
    ///
    /// The driver reports one.
    pub fn read(&self, context: &Context) -> Result<Vec<u8>, GpuError> {
        let slabs: Result<Vec<Vec<u8>>, GpuError> =
            self.buffers.iter().map(|slab| context.read(slab)).collect();
        Ok(slabs?.concat())
    }

    /// Writes at once, before what is submitted later.
    pub fn write(&self, context: &Context, offset: u64, bytes: &[u8]) {
        let mut rest = bytes;
        for (slab, at, length) in self.pieces(offset, bytes.len() as u64, u64::MAX) {
            let (now, later) = rest.split_at(length as usize);
            context.queue.write_buffer(&self.buffers[slab], at, now);
            rest = later;
        }
    }
}

/// What is to be done with a memory, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// Bytes that wait in the staging memory.
    Write { offset: u64, staged: u64, bytes: u64 },
    /// To a lower place.
    Shift { from: u64, to: u64, bytes: u64 },
}

/// Copies that a flush recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Copies {
    /// Commands.
    pub count: u32,
    /// Bytes from the CPU.
    pub bytes: u64,
}

/// Memory that pages are streamed into: what a frame writes waits until [`PagedMemory::flush`].
#[derive(Debug)]
pub struct PagedMemory {
    slabs: Slabs,
    bounce: Buffer,
    staged: Vec<u8>,
    steps: Vec<Step>,
}

impl PagedMemory {
    /// As long as a streamer's budget.
    ///
    /// # Errors
    ///
    /// As [`Slabs::new`].
    pub fn new(context: &Context, budget: u64) -> Result<Self, GpuError> {
        let slabs = Slabs::new(context, "bytes of memory for geometry", budget)?;
        let bounce = context.device.create_buffer(&BufferDescriptor {
            label: Some("bounce"),
            size: BOUNCE,
            usage: BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        Ok(PagedMemory { slabs, bounce, staged: Vec::new(), steps: Vec::new() })
    }

    /// Where pages lie.
    pub fn slabs(&self) -> &Slabs {
        &self.slabs
    }

    /// Writes a page by itself, at once: how it is done without gathering what changes.
    pub fn write_alone(&self, context: &Context, offset: u64, bytes: &[u8]) {
        self.slabs.write(context, offset, bytes);
        context.queue.submit([]);
    }

    /// Records the copies that a frame asked for, in their order.
    pub fn flush(&mut self, context: &Context, encoder: &mut CommandEncoder) -> Copies {
        let mut copies = Copies { count: 0, bytes: self.staged.len() as u64 };
        let staging =
            (!self.staged.is_empty()).then(|| context.buffer("pages", &self.staged, BufferUsages::COPY_SRC));
        for step in self.steps.drain(..) {
            match (step, &staging) {
                (Step::Write { offset, staged, bytes }, Some(staging)) => {
                    let mut from = staged;
                    for (slab, at, length) in self.slabs.pieces(offset, bytes, u64::MAX) {
                        encoder.copy_buffer_to_buffer(staging, from, &self.slabs.buffers[slab], at, length);
                        from += length;
                        copies.count += 1;
                    }
                }
                // Nothing was staged, so nothing is to be written.
                (Step::Write { .. }, None) => {}
                (Step::Shift { from, to, bytes }, _) => {
                    // Upwards, piece by piece: a piece lands below what is read after it.
                    let mut done = 0;
                    for (slab, at, length) in self.slabs.pieces(from, bytes, BOUNCE) {
                        encoder.copy_buffer_to_buffer(&self.slabs.buffers[slab], at, &self.bounce, 0, length);
                        let mut bounced = 0;
                        for (slab, at, length) in self.slabs.pieces(to + done, length, BOUNCE) {
                            let target = &self.slabs.buffers[slab];
                            encoder.copy_buffer_to_buffer(&self.bounce, bounced, target, at, length);
                            bounced += length;
                            copies.count += 1;
                        }
                        done += length;
                    }
                }
            }
        }
        self.staged.clear();
        copies
    }
}

impl Memory for PagedMemory {
    fn write(&mut self, offset: u64, bytes: &[u8]) {
        let staged = self.staged.len() as u64;
        self.staged.extend_from_slice(bytes);
        self.steps.push(Step::Write { offset, staged, bytes: bytes.len() as u64 });
    }

    fn shift(&mut self, from: u64, to: u64, bytes: u64) {
        self.steps.push(Step::Shift { from, to, bytes });
    }
}
