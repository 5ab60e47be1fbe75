//! Streaming: what changes from frame to frame in a memory of fixed size, usually the GPU's (DESIGN.md, section 10; Peng and Cao
//! 2012 and Xue et al. 2016, section 5.2, send the difference of two frames as well).
//!
//! Each frame says what it wants: drawables at levels, with their samples. [`Streamer::frame`] works out which pages ought to be
//! resident, in order of importance and within the budget; takes pages that were loaded meanwhile; writes as many as a
//! frame may, in that order; and says at which level each drawable can be drawn now: the wanted one, or the nearest coarser that
//! is resident, or the nearest finer. What is resident stays until its room is needed, what was not used for longest goes
//! first. It never waits: reading and decoding is done by a [`Loader`]'s threads.
//!
//! The streamer is plain single-threaded code over a trait for the memory: the same code runs before a GPU and in tests.

mod loader;
pub mod page;
pub mod pool;
mod predict;
mod target;

use std::collections::{HashMap, HashSet};

pub use loader::{Loader, PageSource};
pub use page::{ContainerPages, PageLayout};
pub use predict::predicted;

use crate::lod::{Choice, System};
use pool::{ALIGNMENT, Move, Pool, padded};
use target::{Chosen, Wish, target};

/// Memory that pages are written into.
pub trait Memory {
    /// Writes bytes at a place.
    fn write(&mut self, offset: u64, bytes: &[u8]);

    /// Moves bytes to a lower place; the ranges may overlap.
    fn shift(&mut self, from: u64, to: u64, bytes: u64);
}

/// Plain memory, as long as the budget: for tests, and for programs without a GPU.
impl Memory for Vec<u8> {
    fn write(&mut self, offset: u64, bytes: &[u8]) {
        self[offset as usize..][..bytes.len()].copy_from_slice(bytes);
    }

    fn shift(&mut self, from: u64, to: u64, bytes: u64) {
        self.copy_within(from as usize..(from + bytes) as usize, to as usize);
    }
}

/// How much may be used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamSettings {
    /// Bytes of the memory: never more are used.
    pub budget: u64,
    /// Bytes written in one frame, at most, in whole [`pool::ALIGNMENT`]s (fewer than one are for plain memory). Moves inside the memory count as well, but the last move of a frame may exceed it.
    pub upload: u64,
    /// Share of the budget that the coarsest levels of what is in the frustum, but not visible, may take before finer levels of
    /// what is visible.
    pub reserve: f64,
    /// Bytes asked of the loader or loaded and not written yet, at most, but for one page.
    pub in_flight: u64,
}

impl Default for StreamSettings {
    fn default() -> Self {
        StreamSettings { budget: 256 << 20, upload: 8 << 20, reserve: 1.0 / 16.0, in_flight: 32 << 20 }
    }
}

/// A drawable at a level, and how many samples it got.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Priority {
    /// Which drawable, at which level.
    pub choice: Choice,
    /// The more, the sooner.
    pub samples: u32,
}

/// What a frame wants.
#[derive(Clone, Copy, Debug, Default)]
pub struct Frame<'a> {
    /// To be drawn now; each drawable once, in any order.
    pub wanted: &'a [Priority],
    /// In the frustum; most important first. Their coarsest levels are kept at hand.
    pub in_frustum: &'a [u32],
    /// Expected to be wanted soon, by a predicted camera or a known route.
    pub expected: &'a [Priority],
}

/// A page that was read and decoded, or why it could not be.
pub struct Loaded {
    /// Which page.
    pub page: u32,
    /// As it goes into memory; an error is told once, and the page is not asked for again.
    pub bytes: Result<Vec<u8>, LoadError>,
}

/// Why a page could not be had.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// Where it comes from says so.
    #[error(transparent)]
    Source(#[from] Box<dyn std::error::Error + Send + Sync>),
    /// It is not as long as it should be.
    #[error("expected a page of {expected} bytes, found {found}")]
    Length {
        /// By the page's layout.
        expected: u64,
        /// Of what came.
        found: u64,
    },
}

/// What a frame did.
#[derive(Debug, Default)]
pub struct FrameReport {
    /// What can be drawn, rising by drawable.
    pub drawn: Vec<Choice>,
    /// Of `drawn`, those at a coarser or finer level than wanted.
    pub substituted: u32,
    /// Wanted drawables of which nothing is resident.
    pub missing: u32,
    /// Drawables in `drawn` that were not drawn in the frame before.
    pub added: u32,
    /// Drawables that were drawn in the frame before and are not now.
    pub removed: u32,
    /// Drawables drawn at another level than in the frame before.
    pub changed: u32,
    /// Bytes written.
    pub written: u64,
    /// Bytes moved to join free pieces.
    pub moved: u64,
    /// Bytes of pages that were given up.
    pub evicted: u64,
    /// Bytes in use.
    pub resident: u64,
    /// All that ought to be resident is.
    pub is_complete: bool,
    /// Pages that could not be loaded, and why.
    pub failed: Vec<(u32, LoadError)>,
}

/// A page in memory.
#[derive(Clone, Copy, Debug)]
struct Resident {
    offset: u64,
    bytes: u64,
    /// Bytes written so far: it can be drawn when all are.
    filled: u64,
    /// Frame in which it was last drawn or wanted.
    used: u64,
}

impl Resident {
    fn is_whole(&self) -> bool {
        self.filled == self.bytes
    }
}

/// Pages that may be given up, those to go first at the end: longest unused.
struct Evictable {
    /// No wanted drawable can use them now.
    unused: Vec<u32>,
    /// Drawn in place of levels that are not there yet.
    stand_ins: Vec<u32>,
}

/// Keeps a memory filled with what frames want.
pub struct Streamer {
    settings: StreamSettings,
    pool: Pool,
    /// By page.
    resident: Vec<Option<Resident>>,
    /// Loaded, and not all written.
    loaded: HashMap<u32, Vec<u8>>,
    failed: HashSet<u32>,
    /// For each page the last frame in whose target it was.
    in_target: Vec<u64>,
    frame: u64,
    /// What was drawn in the frame before.
    last: Vec<Choice>,
    /// All that the frame before wanted was there: another one that wants the same has nothing to do.
    settled: Option<Settled>,
}

/// What a frame wanted, whatever its samples.
#[derive(PartialEq)]
struct Settled {
    wanted: Vec<Choice>,
    in_frustum: Vec<u32>,
    expected: Vec<Choice>,
}

impl Settled {
    fn of(frame: &Frame) -> Self {
        let choices = |wants: &[Priority]| wants.iter().map(|want| want.choice).collect();
        Settled {
            wanted: choices(frame.wanted),
            in_frustum: frame.in_frustum.to_vec(),
            expected: choices(frame.expected),
        }
    }

    fn is_of(&self, frame: &Frame) -> bool {
        let same = |kept: &[Choice], wants: &[Priority]| {
            kept.iter().copied().eq(wants.iter().map(|want| want.choice))
        };
        same(&self.wanted, frame.wanted)
            && self.in_frustum == frame.in_frustum
            && same(&self.expected, frame.expected)
    }
}

impl Streamer {
    /// With nothing resident.
    pub fn new(settings: StreamSettings) -> Self {
        Streamer {
            settings,
            pool: Pool::new(settings.budget),
            resident: Vec::new(),
            loaded: HashMap::new(),
            failed: HashSet::new(),
            in_target: Vec::new(),
            frame: 0,
            last: Vec::new(),
            settled: None,
        }
    }

    /// Where a page lies, if all of it is resident.
    pub fn offset_of(&self, page: u32) -> Option<u64> {
        self.page(page).filter(Resident::is_whole).map(|page| page.offset)
    }

    fn page(&self, page: u32) -> Option<Resident> {
        self.resident.get(page as usize).copied().flatten()
    }

    /// Is a page of this frame's target?
    fn is_wanted(&self, page: u32) -> bool {
        self.in_target.get(page as usize) == Some(&self.frame)
    }

    /// Does one frame, always of the same system. `bytes_of` tells the bytes of pages, `loaded` hands over what came from the
    /// loader. Returns what was
    /// done, and the pages to be loaded next, most important first.
    pub fn frame(
        &mut self,
        system: &dyn System,
        frame: &Frame,
        bytes_of: &dyn Fn(u32) -> u64,
        loaded: impl IntoIterator<Item = Loaded>,
        memory: &mut dyn Memory,
    ) -> (FrameReport, Vec<u32>) {
        let mut report = FrameReport::default();
        let mut loaded = loaded.into_iter().peekable();
        if loaded.peek().is_none() && self.settled.as_ref().is_some_and(|settled| settled.is_of(frame)) {
            report.drawn.clone_from(&self.last);
            report.resident = self.pool.capacity() - self.pool.free();
            report.is_complete = true;
            return (report, Vec::new());
        }
        self.frame += 1;
        let bytes_of = |page: u32| bytes_of(page).max(1);
        self.take(loaded, &bytes_of, &mut report);
        let reserve = (self.settings.reserve * self.settings.budget as f64) as u64;
        let pages = system.page_count() as usize;
        self.resident.resize(pages, None);
        self.in_target.resize(pages, 0);
        let mut chosen =
            Chosen { number: self.frame, in_target: &mut self.in_target, left: self.pool.capacity() };
        let wishes = target(system, frame, &bytes_of, reserve, &mut chosen);
        for wish in &wishes {
            if let Some(resident) = &mut self.resident[wish.page as usize] {
                resident.used = self.frame;
            }
        }
        let (in_target, number) = (&self.in_target, self.frame);
        self.loaded.retain(|&page, _| in_target.get(page as usize) == Some(&number));
        self.write(system, frame, &wishes, memory, &mut report);
        self.draw(system, frame, &mut report);
        report.resident = self.pool.capacity() - self.pool.free();
        let is_there = |wish: &Wish| self.offset_of(wish.page).is_some() || self.failed.contains(&wish.page);
        report.is_complete = wishes.iter().all(is_there);
        let requests = self.requests(&wishes);
        // Where something is substituted for want of room, room may still be made.
        let is_settled = report.is_complete && report.substituted == 0 && report.missing == 0;
        self.settled = is_settled.then(|| Settled::of(frame));
        (report, requests)
    }

    /// Takes what the loader brings.
    fn take(
        &mut self,
        loaded: impl IntoIterator<Item = Loaded>,
        bytes_of: &dyn Fn(u32) -> u64,
        report: &mut FrameReport,
    ) {
        for Loaded { page, bytes } in loaded {
            let expected = bytes_of(page);
            let bytes = bytes.and_then(|bytes| match bytes.len() as u64 == expected {
                true => Ok(bytes),
                false => Err(LoadError::Length { expected, found: bytes.len() as u64 }),
            });
            match bytes {
                Ok(_) if self.offset_of(page).is_some() => {}
                Ok(bytes) => {
                    self.loaded.insert(page, bytes);
                }
                Err(error) if self.failed.insert(page) => report.failed.push((page, error)),
                Err(_) => {}
            }
        }
    }

    /// Writes loaded pages, most important first, as many bytes as a frame may.
    fn write(
        &mut self,
        system: &dyn System,
        frame: &Frame,
        wishes: &[Wish],
        memory: &mut dyn Memory,
        report: &mut FrameReport,
    ) {
        // Pieces of pages are as long as copies on GPUs may be.
        let mut left = match self.settings.upload {
            upload if upload < ALIGNMENT => upload,
            upload => upload / ALIGNMENT * ALIGNMENT,
        };
        let mut evictable: Option<Evictable> = None;
        for wish in wishes {
            if left == 0 {
                return;
            }
            if !self.loaded.contains_key(&wish.page) {
                continue;
            }
            if self.page(wish.page).is_none() {
                let evictable = evictable.get_or_insert_with(|| self.evictable(system, frame));
                let Some(offset) = self.make_room(*wish, evictable, memory, &mut left, report) else {
                    // Room is being made: what is less important must not take it.
                    return;
                };
                let resident = Resident { offset, bytes: wish.bytes, filled: 0, used: self.frame };
                self.resident[wish.page as usize] = Some(resident);
            }
            let (Some(resident), Some(bytes)) =
                (&mut self.resident[wish.page as usize], self.loaded.get(&wish.page))
            else {
                continue;
            };
            let end = resident.bytes.min(resident.filled + left);
            // As long as the page is, by `take`.
            memory.write(resident.offset + resident.filled, &bytes[resident.filled as usize..end as usize]);
            left -= end - resident.filled;
            report.written += end - resident.filled;
            resident.filled = end;
            if resident.is_whole() {
                self.loaded.remove(&wish.page);
            }
        }
    }

    /// Finds room for a page: free, else of pages that nobody needs, else of stand-ins, else by moving pages together. `None`
    /// when the frame's bytes were used up by moves.
    fn make_room(
        &mut self,
        wish: Wish,
        evictable: &mut Evictable,
        memory: &mut dyn Memory,
        left: &mut u64,
        report: &mut FrameReport,
    ) -> Option<u64> {
        loop {
            if let Some(offset) = self.pool.allocate(wish.page, wish.bytes) {
                return Some(offset);
            }
            // What nobody needs goes before anything is moved: to read it again costs less, and mostly nobody will. The
            // target fits into the pool, so that what is not of it makes room enough.
            let gone = match evictable.unused.pop() {
                None if self.pool.free() < padded(wish.bytes) => Some(evictable.stand_ins.pop()?),
                unused => unused,
            };
            if let Some(page) = gone {
                if let Some(gone) = self.resident[page as usize].take() {
                    self.pool.release(gone.offset);
                    report.evicted += gone.bytes;
                }
                continue;
            }
            if *left == 0 {
                return None;
            }
            let Move { page, from, to, bytes } = self.pool.compact()?;
            memory.shift(from, to, bytes);
            if let Some(resident) = &mut self.resident[page as usize] {
                resident.offset = to;
            }
            // The last move of a frame may be longer than what is left of its bytes.
            *left = left.saturating_sub(bytes);
            report.moved += bytes;
        }
    }

    /// Pages that are not of the target.
    fn evictable(&self, system: &dyn System, frame: &Frame) -> Evictable {
        let best = |want: &Priority| {
            let level = self.best_level(system, want.choice)?;
            Some(system.level(want.choice.drawable, level).page)
        };
        let drawn: HashSet<u32> = frame.wanted.iter().filter_map(best).collect();
        let used = |(page, resident): (u32, &Option<Resident>)| Some((resident.as_ref()?.used, page));
        let all = (0..).zip(&self.resident).filter_map(used);
        let mut pages: Vec<(u64, u32)> = all.filter(|&(_, page)| !self.is_wanted(page)).collect();
        pages.sort_unstable_by(|a, b| b.cmp(a));
        let (stand_ins, unused) =
            pages.into_iter().map(|(_, page)| page).partition(|page| drawn.contains(page));
        Evictable { unused, stand_ins }
    }

    /// The level at which a drawable can be drawn: the wanted one, else the nearest coarser, else the nearest finer.
    fn best_level(&self, system: &dyn System, want: Choice) -> Option<u32> {
        let Choice { drawable, level } = want;
        let coarser = level..system.level_count(drawable);
        let finer = (0..level).rev();
        coarser.chain(finer).find(|&level| self.offset_of(system.level(drawable, level).page).is_some())
    }

    /// Says what can be drawn, and what is other than in the frame before.
    fn draw(&mut self, system: &dyn System, frame: &Frame, report: &mut FrameReport) {
        for want in frame.wanted {
            let drawable = want.choice.drawable;
            let Some(level) = self.best_level(system, want.choice) else {
                report.missing += 1;
                continue;
            };
            if let Some(resident) = &mut self.resident[system.level(drawable, level).page as usize] {
                resident.used = self.frame;
            }
            report.substituted += u32::from(level != want.choice.level);
            report.drawn.push(Choice { drawable, level });
        }
        report.drawn.sort_unstable();
        let mut before = self.last.iter().peekable();
        for now in &report.drawn {
            while before.next_if(|last| last.drawable < now.drawable).is_some() {
                report.removed += 1;
            }
            match before.next_if(|last| last.drawable == now.drawable) {
                None => report.added += 1,
                Some(last) => report.changed += u32::from(last.level != now.level),
            }
        }
        report.removed += before.count() as u32;
        self.last.clone_from(&report.drawn);
    }

    /// What the loader shall bring next: as much as may be in flight.
    fn requests(&self, wishes: &[Wish]) -> Vec<u32> {
        let mut in_flight: u64 = self.loaded.values().map(|bytes| bytes.len() as u64).sum();
        let mut requests = Vec::new();
        for wish in wishes {
            let is_needed = self.offset_of(wish.page).is_none()
                && !self.loaded.contains_key(&wish.page)
                && !self.failed.contains(&wish.page);
            if !is_needed {
                continue;
            }
            if in_flight > 0 && in_flight + wish.bytes > self.settings.in_flight {
                break;
            }
            in_flight += wish.bytes;
            requests.push(wish.page);
        }
        requests
    }
}
