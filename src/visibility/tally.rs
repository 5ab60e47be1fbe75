//! What a thread counts while it casts rays.

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
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    /// Place of the ray in the order of all rays.
    order: u64,
    /// World space.
    pub point: DVec3,
}

/// Counts, and where each drawable was seen first, if that is wanted.
pub(super) struct Tally {
    pub found: VisibleSet,
    /// One for each drawable that was seen; `None` when nobody asks.
    pub sightings: Option<Vec<Option<Sighting>>>,
    /// Order of the first ray of this batch and sample.
    order: u64,
    /// What this batch has met.
    met: Met,
    hits_before: u64,
}

/// Drawables that a batch has met.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Met {
    Nothing,
    One(u32),
    Several,
}

impl Tally {
    pub fn new(drawables: u32, with_sightings: bool) -> Self {
        Tally {
            found: VisibleSet::new(drawables),
            sightings: with_sightings.then(|| vec![None; drawables as usize]),
            order: 0,
            met: Met::Nothing,
            hits_before: 0,
        }
    }

    /// The next rays are those of this sample of this batch.
    pub fn begin(&mut self, batch: usize, sample: u32) {
        self.order = (batch as u64) << 32 | u64::from(sample) << 8;
        self.met = Met::Nothing;
        self.hits_before = self.found.hits;
    }

    /// A drawable is visible; no sample.
    pub fn see(&mut self, drawable: u32, number: usize, ray: &Ray, t: f64) {
        self.found.visible[drawable as usize] = true;
        self.met = match self.met {
            Met::Nothing => Met::One(drawable),
            Met::One(same) if same == drawable => self.met,
            _ => Met::Several,
        };
        if let Some(sightings) = &mut self.sightings {
            let order = self.order | number as u64;
            let sighting = &mut sightings[drawable as usize];
            if sighting.is_none_or(|before| order < before.order) {
                *sighting = Some(Sighting { order, point: ray.at(t) });
            }
        }
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

    /// When all `rays` of this batch met the same one drawable, or all nothing: counts them `times` again.
    pub fn repeat_if_uniform(&mut self, rays: u64, times: u64) -> bool {
        let hits = self.found.hits - self.hits_before;
        match self.met {
            Met::Nothing => {}
            Met::One(drawable) if hits == rays => {
                let samples = &mut self.found.samples[drawable as usize];
                *samples = samples.saturating_add((hits * times).min(u64::from(u32::MAX)) as u32);
                self.found.hits += hits * times;
            }
            _ => return false,
        }
        self.found.rays += rays * times;
        true
    }

    pub fn merge(&mut self, other: Tally) {
        self.found.merge(&other.found);
        if let (Some(mine), Some(theirs)) = (&mut self.sightings, other.sightings) {
            for (mine, theirs) in mine.iter_mut().zip(theirs) {
                if theirs.is_some_and(|theirs| mine.is_none_or(|mine| theirs.order < mine.order)) {
                    *mine = theirs;
                }
            }
        }
    }
}
