//! What a thread counts while it casts rays.

use std::sync::{Mutex, PoisonError};

use glam::DVec3;

use super::VisibleSet;
use crate::ray::Ray;

/// A transparent drawable on a ray's way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Passed {
    /// Number of the ray in its batch.
    pub ray: usize,
    pub drawable: u32,
    pub t: f64,
}

/// Where a drawable was seen.
#[derive(Clone, Copy, Debug, Default)]
struct Sighting {
    /// Place of the ray in the order of all rays.
    order: u64,
    /// World space.
    point: DVec3,
}

/// Counts, and where each drawable was seen first, if that is wanted.
#[derive(Default)]
pub(super) struct Tally {
    pub found: VisibleSet,
    /// The drawables of `found`, in the order in which they were met first: all that there is to merge, read or forget.
    seen: Vec<u32>,
    /// One for each drawable, of use only where `found` has it; none when nobody asks.
    sightings: Vec<Sighting>,
    /// Order of the first ray of this batch and sample.
    order: u64,
    /// What this batch has met.
    met: Met,
    hits_before: u64,
}

/// Drawables that a batch has met.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Met {
    #[default]
    Nothing,
    One(u32),
    Several,
}

/// Tallies of earlier queries, to be used again: clearing one costs what it has seen, making one what the scene has. Which
/// thread gets which does not matter.
#[derive(Default)]
pub(super) struct TallyPool {
    spare: Mutex<Vec<Tally>>,
}

impl TallyPool {
    /// An empty tally for a scene.
    pub fn take(&self, drawables: u32, with_sightings: bool) -> Tally {
        // A thread that panicked left whole tallies behind, or none.
        let spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let is_fit = |tally: &Tally| tally.found.visible.len() == drawables as usize;
        let mut tally = spare.filter(is_fit).unwrap_or_else(|| Tally::new(drawables));
        if with_sightings && tally.sightings.is_empty() {
            tally.sightings = vec![Sighting::default(); drawables as usize];
        }
        tally
    }

    /// Takes a tally back.
    pub fn give(&self, mut tally: Tally) {
        tally.clear();
        self.spare.lock().unwrap_or_else(PoisonError::into_inner).push(tally);
    }
}

impl Tally {
    fn new(drawables: u32) -> Self {
        Tally { found: VisibleSet::new(drawables), ..Tally::default() }
    }

    fn clear(&mut self) {
        for drawable in self.seen.drain(..) {
            self.found.visible[drawable as usize] = false;
            self.found.samples[drawable as usize] = 0;
        }
        (self.found.rays, self.found.weight, self.found.hits) = (0, 0, 0);
    }

    /// Is it wanted where each drawable was seen?
    pub fn has_sightings(&self) -> bool {
        !self.sightings.is_empty()
    }

    /// The drawables that were met, in no particular order, with where each was met first; nothing without sightings.
    pub fn sightings(&self) -> impl Iterator<Item = (u32, DVec3)> {
        self.seen.iter().filter_map(|&drawable| {
            self.sightings.get(drawable as usize).map(|sighting| (drawable, sighting.point))
        })
    }

    /// The drawables that were met, in no particular order, with their samples.
    pub fn samples(&self) -> impl Iterator<Item = (u32, u32)> {
        self.seen.iter().map(|&drawable| (drawable, self.found.samples[drawable as usize]))
    }

    /// Was a drawable met?
    pub fn has(&self, drawable: u32) -> bool {
        self.found.visible[drawable as usize]
    }

    /// The next rays are those of this sample of this batch.
    pub fn begin(&mut self, batch: usize, sample: u32) {
        self.order = (batch as u64) << 32 | u64::from(sample) << 8;
        self.met = Met::Nothing;
        self.hits_before = self.found.hits;
    }

    /// A drawable is visible; no sample.
    pub fn see(&mut self, drawable: u32, number: usize, ray: &Ray, t: f64) {
        let is_known = self.meet(drawable);
        self.met = match self.met {
            Met::Nothing => Met::One(drawable),
            Met::One(same) if same == drawable => self.met,
            _ => Met::Several,
        };
        if let Some(sighting) = self.sightings.get_mut(drawable as usize) {
            let order = self.order | number as u64;
            if !is_known || order < sighting.order {
                *sighting = Sighting { order, point: ray.at(t) };
            }
        }
    }

    /// A drawable is in the answer; returns whether it was before.
    #[inline]
    fn meet(&mut self, drawable: u32) -> bool {
        let is_known = std::mem::replace(&mut self.found.visible[drawable as usize], true);
        if !is_known {
            self.seen.push(drawable);
        }
        is_known
    }

    /// One more sample of a drawable.
    pub fn count(&mut self, drawable: u32, number: usize, ray: &Ray, t: f64) {
        let samples = &mut self.found.samples[drawable as usize];
        *samples = samples.saturating_add(1);
        self.see(drawable, number, ray, t);
    }

    /// Counts what one ray met: its first opaque drawable and, of the transparent hits, those before it.
    pub fn count_ray(
        &mut self,
        number: usize,
        ray: &Ray,
        through: &[Passed],
        first_opaque: Option<(u32, f64)>,
    ) {
        let end = first_opaque.map_or(f64::INFINITY, |(_, t)| t);
        let mut any = first_opaque.is_some();
        for hit in through.iter().filter(|hit| hit.ray == number && hit.t < end) {
            self.count(hit.drawable, number, ray, hit.t);
            any = true;
        }
        if let Some((drawable, t)) = first_opaque {
            self.count(drawable, number, ray, t);
        }
        self.found.hits += u64::from(any);
    }

    /// Did all `rays` since [`Tally::begin`] meet the same one drawable, or all nothing? No rays tell nothing.
    pub fn is_uniform(&self, rays: u64) -> bool {
        rays > 0
            && match self.met {
                Met::Nothing => true,
                Met::One(_) => self.found.hits - self.hits_before == rays,
                Met::Several => false,
            }
    }

    /// The same again for `rays` rays more, which need not be cast: only where those before were uniform.
    pub fn repeat(&mut self, rays: u64) {
        if let Met::One(drawable) = self.met {
            let samples = &mut self.found.samples[drawable as usize];
            *samples = samples.saturating_add(rays.min(u64::from(u32::MAX)) as u32);
            self.found.hits += rays;
        }
        self.found.weight += rays;
    }

    /// Adds what another thread counted.
    pub fn merge(&mut self, other: &Tally) {
        self.found.rays += other.found.rays;
        self.found.weight += other.found.weight;
        self.found.hits += other.found.hits;
        for &drawable in &other.seen {
            let is_known = self.meet(drawable);
            let index = drawable as usize;
            self.found.samples[index] = self.found.samples[index].saturating_add(other.found.samples[index]);
            if let (Some(mine), Some(theirs)) = (self.sightings.get_mut(index), other.sightings.get(index))
                && (!is_known || theirs.order < mine.order)
            {
                *mine = *theirs;
            }
        }
    }
}

#[cfg(test)]
impl Tally {
    /// As if so many rays had met drawables so often, the first of which has all the hits.
    pub fn of_samples(rays: u64, samples: &[u32]) -> Self {
        let mut tally = TallyPool::default().take(samples.len() as u32, true);
        (0..).zip(samples).filter(|&(_, &n)| n > 0).for_each(|(drawable, &n)| {
            tally.meet(drawable);
            tally.found.samples[drawable as usize] = n;
        });
        (tally.found.rays, tally.found.weight) = (rays, rays);
        tally.found.hits = samples.first().copied().unwrap_or(0).into();
        tally
    }
}
