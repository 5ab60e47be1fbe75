//! What a coherent query knows of each drawable, and how it forgets.

use glam::DVec3;

use super::settings::CoherentSettings;
use crate::visibility::VisibleSet;
use crate::visibility::tally::Tally;

/// Sample counts are answered in fractions of a ray, since they decay: 256ths, or coarser ones when there are so many rays
/// that 256ths do not fit.
const PER_RAY: f64 = 256.0;

/// What is known of a drawable.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Known {
    /// Frame in which it was last seen, counted from 1; 0: never.
    pub seen: u32,
    /// Times that it was asked after in vain since.
    pub in_vain: u32,
    /// Decaying sum of its samples, in rays.
    samples: f64,
    /// Where it was last seen, world space.
    pub point: DVec3,
}

/// What is known of all drawables of a scene. What a frame costs here is what it sees and what is kept: a scene's other
/// drawables are looked at only for [`Memory::answer`], which has room for all of them.
#[derive(Default)]
pub(super) struct Memory {
    known: Vec<Known>,
    /// Drawables with [`Known::seen`] not 0. (Their order depends on threads, and nothing else on their order.)
    kept: Vec<u32>,
    /// Frames so far.
    pub frame: u32,
    /// Decaying sum of the rays, as [`Known::samples`].
    rays: f64,
    hits: f64,
}

/// What a frame learned: nothing is changed before all of it is there, so that a cancelled frame leaves no trace.
pub(super) struct Lesson<'t> {
    /// What the image's rays met.
    pub seen: &'t Tally,
    /// What the questions' rays met. They were aimed: they say what is there, not how much of it.
    pub met: &'t Tally,
    /// Drawables that were asked after.
    pub asked: &'t [u32],
    /// Drawables that cannot be kept, unless they were met after all.
    pub gone: &'t [u32],
    /// The view is that of the frame before: nothing decays.
    pub is_still: bool,
}

impl Memory {
    /// Of a scene with so many drawables.
    pub fn new(drawables: u32) -> Self {
        Memory { known: vec![Known::default(); drawables as usize], ..Memory::default() }
    }

    /// The drawables of the answer, with what is known of them.
    pub fn kept(&self) -> impl Iterator<Item = (u32, &Known)> {
        self.kept.iter().map(|&drawable| (drawable, &self.known[drawable as usize]))
    }

    /// Where a drawable was last seen.
    pub fn point(&self, drawable: u32) -> DVec3 {
        self.known[drawable as usize].point
    }

    /// A frame is over.
    pub fn learn(&mut self, lesson: &Lesson, settings: &CoherentSettings) {
        self.frame += 1;
        if !lesson.is_still {
            self.rays *= settings.decay;
            self.hits *= settings.decay;
            for &drawable in &self.kept {
                self.known[drawable as usize].samples *= settings.decay;
            }
        }
        for &drawable in lesson.asked {
            self.known[drawable as usize].in_vain += 1;
        }
        for tally in [lesson.met, lesson.seen] {
            for (drawable, point) in tally.sightings() {
                let known = &mut self.known[drawable as usize];
                if known.seen == 0 {
                    self.kept.push(drawable);
                }
                (known.seen, known.in_vain, known.point) = (self.frame, 0, point);
            }
        }
        for (drawable, samples) in lesson.seen.samples() {
            self.known[drawable as usize].samples += f64::from(samples);
        }
        self.rays += lesson.seen.found.weight as f64;
        self.hits += lesson.seen.found.hits as f64;
        self.forget(lesson, settings);
    }

    fn forget(&mut self, lesson: &Lesson, settings: &CoherentSettings) {
        let Memory { known, kept, frame, .. } = self;
        let mut forget = |drawable: u32, is_gone: bool| {
            let known = &mut known[drawable as usize];
            if is_gone && known.seen < *frame || known.in_vain >= settings.patience {
                *known = Known::default();
            }
        };
        lesson.gone.iter().for_each(|&drawable| forget(drawable, true));
        lesson.asked.iter().for_each(|&drawable| forget(drawable, false));
        kept.retain(|&drawable| known[drawable as usize].seen != 0);
    }

    /// The answer as it stands, for which `rays` were cast.
    pub fn answer(&self, rays: u64) -> VisibleSet {
        let mut found = VisibleSet::new(self.known.len() as u32);
        let scale = scale(self.rays);
        (found.rays, found.weight, found.hits) =
            (rays, (self.rays * scale) as u64, (self.hits * scale) as u64);
        for (drawable, known) in self.kept() {
            found.visible[drawable as usize] = true;
            found.samples[drawable as usize] = (known.samples * scale) as u32;
        }
        found
    }
}

/// Counts a ray in answers: a power of two, so that nothing is rounded that need not be, and so that `u32` holds a drawable
/// that all rays met.
fn scale(rays: f64) -> f64 {
    let mut scale = PER_RAY;
    while rays * scale > f64::from(u32::MAX) {
        scale *= 0.5;
    }
    scale
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::visibility::{RayMethod, RaysPerPixel};

    /// Frames of a still camera that sees `samples` of two drawables with `rays` rays.
    fn after_frames(frames: u32, rays: u64, samples: [u32; 2]) -> VisibleSet {
        let settings = CoherentSettings::new(RayMethod::Hybrid, RaysPerPixel::ONE);
        let mut memory = Memory::new(3);
        let (seen, met) =
            (Tally::of_samples(rays, &[samples[0], samples[1], 0]), Tally::of_samples(0, &[0; 3]));
        for _ in 0..frames {
            memory
                .learn(&Lesson { seen: &seen, met: &met, asked: &[], gone: &[], is_still: true }, &settings);
        }
        memory.answer(rays)
    }

    #[test]
    fn counts_keep_their_ratio_however_many_rays_there_are() {
        // A 4K image, one drawable on 3 of 4 pixels and one on a single pixel: 2^24 rays are passed in the third frame.
        let rays = 3840 * 2160;
        for frames in [1, 2, 3, 16, 1000, 100_000] {
            let found = after_frames(frames, rays, [3 * (rays / 4) as u32, 1]);
            let share = |samples: u32| f64::from(samples) / found.weight as f64;
            assert!((share(found.samples[0]) - 0.75).abs() < 1e-6, "{frames} frames: {found:?}");
            assert!((share(found.samples[1]) * rays as f64 - 1.0).abs() < 1e-2, "{frames} frames: {found:?}");
            assert_eq!((found.hits, found.samples[2]), (found.samples[0].into(), 0), "{frames} frames");
            assert_eq!(found.visible, [true, true, false]);
        }
        assert_eq!(after_frames(1, 1000, [500, 1]).samples, [500 * 256, 256, 0]);
    }
}
