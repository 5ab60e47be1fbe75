//! Which objects a method lost, and how many pixels each of them cost.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::visibility::VisibleSet;

/// An object of which a view showed less than it should, or nothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LostObject {
    /// Index into the scene's objects.
    pub object: u32,
    /// What is missing of it: pixels of its lost drawables in the reference, of one view or of all together.
    pub pixels: f64,
    /// Views in which anything of it was lost.
    pub views: u64,
}

/// Reference samples on drawables that the answer lacks, by object.
pub fn lost_samples(
    reference: &VisibleSet,
    answer: &VisibleSet,
    object_of: impl Fn(u32) -> u32,
) -> BTreeMap<u32, u64> {
    let mut lost = BTreeMap::new();
    for (drawable, (&seen, &visible)) in (0..).zip(reference.samples.iter().zip(&answer.visible)) {
        if seen > 0 && !visible {
            *lost.entry(object_of(drawable)).or_default() += u64::from(seen);
        }
    }
    lost
}

/// Sums over views. Counts samples, so that the order of views cannot matter.
#[derive(Default)]
pub struct LostTotals(BTreeMap<u32, (u64, u64)>);

impl LostTotals {
    /// One more view.
    pub fn add(&mut self, lost: &BTreeMap<u32, u64>) {
        for (&object, &samples) in lost {
            let (views, total) = self.0.entry(object).or_default();
            *views += 1;
            *total += samples;
        }
    }

    /// All lost objects, most pixels first, then by id.
    pub fn sorted(&self, samples_per_pixel: f64) -> Vec<LostObject> {
        let objects = self.0.iter().map(|(&object, &(views, samples))| (object, views, samples));
        sorted(objects, samples_per_pixel)
    }
}

/// The lost objects of one view, most pixels first, then by id.
pub fn sorted_view(lost: &BTreeMap<u32, u64>, samples_per_pixel: f64) -> Vec<LostObject> {
    sorted(lost.iter().map(|(&object, &samples)| (object, 1, samples)), samples_per_pixel)
}

fn sorted(objects: impl Iterator<Item = (u32, u64, u64)>, samples_per_pixel: f64) -> Vec<LostObject> {
    let mut objects: Vec<_> = objects.collect();
    objects.sort_by_key(|&(object, _, samples)| (std::cmp::Reverse(samples), object));
    let pixels = |samples: u64| samples as f64 / samples_per_pixel;
    objects
        .into_iter()
        .map(|(object, views, samples)| LostObject { object, pixels: pixels(samples), views })
        .collect()
}
