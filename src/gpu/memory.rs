//! Memory of the GPU: one space of addresses over up to [`SLABS`] buffers, since a shader can bind only so many bytes of each.

use std::iter;

use wgpu::{Buffer, BufferDescriptor, BufferUsages, CommandEncoder};

use super::context::{Context, GpuError};
use crate::streaming::Memory;

/// Buffers that a space is made of, at most; shaders bind them all.
pub const SLABS: usize = 4;

/// Bytes are copied inside the memory through a buffer of this size.
const BOUNCE: u64 = 1 << 20;

/// Memory that grows begins with so much.
const LEAST_SLAB: u64 = 1 << 16;

/// A space of addresses. Shaders read it word by word (`pool_word` of `shaders/page.wgsl`, and its like).
#[derive(Debug)]
pub struct Slabs {
    buffers: Vec<Buffer>,
    /// log2 of the words of a slab.
    shift: u32,
    bytes: u64,
    what: &'static str,
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
        let mut slabs = Slabs { buffers: Vec::new(), shift: slab.ilog2() - 2, bytes, what };
        slabs.buffers =
            (0..bytes.div_ceil(slab)).map(|index| slabs.buffer(context, slabs.most(index))).collect();
        Ok(slabs)
    }

    /// Makes one that takes memory as it is needed. Until then nothing is cleared, which for much memory takes
    /// long. That there is room for all of it, and for what is copied from while it grows, is tried first; others may take it later.
    ///
    /// # Errors
    ///
    /// As [`Slabs::new`].
    pub fn growing(context: &Context, what: &'static str, bytes: u64) -> Result<Self, GpuError> {
        let mut slabs = Slabs::new(context, what, bytes)?;
        slabs.buffer(context, (slabs.most(0).next_power_of_two() / 2).max(4)).destroy();
        for index in 0..slabs.buffers.len() {
            let small = slabs.buffer(context, slabs.most(index as u64).min(LEAST_SLAB));
            std::mem::replace(&mut slabs.buffers[index], small).destroy();
        }
        Ok(slabs)
    }

    fn buffer(&self, context: &Context, size: u64) -> Buffer {
        context.device.create_buffer(&BufferDescriptor {
            label: Some(self.what),
            size,
            usage: BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        })
    }

    /// Bytes of a slab when it is as large as it gets.
    fn most(&self, index: u64) -> u64 {
        self.slab_bytes().min(self.bytes - index * self.slab_bytes())
    }

    /// Is less taken than addresses below `end` need? Slabs fill one after the other.
    fn must_grow(&self, end: u64) -> bool {
        let needed = |(index, buffer): (u64, &Buffer)| {
            end.saturating_sub(index * self.slab_bytes()).min(self.most(index)) > buffer.size()
        };
        (0..).zip(&self.buffers).any(needed)
    }

    /// Takes memory for addresses below `end`; what is there stays.
    fn reserve(&mut self, context: &Context, encoder: &mut CommandEncoder, end: u64) {
        for index in 0..self.buffers.len() {
            let most = self.most(index as u64);
            let needed = end.saturating_sub(index as u64 * self.slab_bytes()).min(most);
            let has = self.buffers[index].size();
            if needed > has {
                let larger = self.buffer(context, needed.next_power_of_two().min(most));
                encoder.copy_buffer_to_buffer(&self.buffers[index], 0, &larger, 0, has);
                self.buffers[index] = larger;
            }
        }
    }

    /// Bytes that are taken.
    pub fn taken(&self) -> u64 {
        self.buffers.iter().map(Buffer::size).sum()
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

    /// Copies all of it back, and waits; zeros where nothing was written.
    ///
    /// # Errors
    ///
    /// The driver reports one.
    pub fn read(&self, context: &Context) -> Result<Vec<u8>, GpuError> {
        let mut all = Vec::new();
        for (index, slab) in (0..).zip(&self.buffers) {
            all.extend(context.read(slab)?);
            all.resize((index * self.slab_bytes() + self.most(index)) as usize, 0);
        }
        Ok(all)
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
        let slabs = Slabs::growing(context, "bytes of memory for geometry", budget)?;
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
    pub fn write_alone(&mut self, context: &Context, offset: u64, bytes: &[u8]) {
        let end = offset + bytes.len() as u64;
        if self.slabs.must_grow(end) {
            let mut encoder = context.device.create_command_encoder(&Default::default());
            self.slabs.reserve(context, &mut encoder, end);
            context.queue.submit([encoder.finish()]);
        }
        self.slabs.write(context, offset, bytes);
        context.queue.submit([]);
    }

    /// Records the copies that a frame asked for, in their order.
    pub fn flush(&mut self, context: &Context, encoder: &mut CommandEncoder) -> Copies {
        let mut copies = Copies { count: 0, bytes: self.staged.len() as u64 };
        let staging =
            (!self.staged.is_empty()).then(|| context.buffer("pages", &self.staged, BufferUsages::COPY_SRC));
        let end = |step: &Step| match *step {
            Step::Write { offset, bytes, .. } => offset + bytes,
            Step::Shift { from, bytes, .. } => from + bytes,
        };
        self.slabs.reserve(context, encoder, self.steps.iter().map(end).max().unwrap_or(0));
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
