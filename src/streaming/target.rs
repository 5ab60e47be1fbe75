//! Which pages ought to be resident: what fits, in order of importance.

use super::pool::padded;
use super::{Frame, Priority};
use crate::lod::System;

/// A page that ought to be resident.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Wish {
    pub page: u32,
    pub bytes: u64,
}

/// Chooses from all that a frame wants: in order, what fits. A page that does not is left out, and smaller ones after it may
/// still fit.
///
/// First the coarsest levels of what is visible, so that nothing is absent; then those of what is in the frustum, in a small
/// reserve of their own, so that nothing will be; then the wanted levels, most samples first; then what is expected to
/// be wanted soon.
pub(super) fn target(
    system: &dyn System,
    frame: &Frame,
    bytes_of: &dyn Fn(u32) -> u64,
    reserve: u64,
    chosen: &mut Chosen,
) -> Vec<Wish> {
    let page = |drawable: u32, level: u32| system.level(drawable, level).page;
    let coarsest = |drawable: u32| page(drawable, system.level_count(drawable) - 1);
    let mut wishes = Vec::new();
    let by_samples = |wants: &[Priority]| {
        let mut order: Vec<Priority> = wants.to_vec();
        order.sort_unstable_by(|a, b| b.samples.cmp(&a.samples).then(a.choice.cmp(&b.choice)));
        order
    };
    let (wanted, expected) = (by_samples(frame.wanted), by_samples(frame.expected));
    for want in &wanted {
        wishes.extend(chosen.add(coarsest(want.choice.drawable), bytes_of));
    }
    let mut left = reserve;
    for &drawable in frame.in_frustum {
        let page = coarsest(drawable);
        if chosen.has(page) || padded(bytes_of(page)) > left {
            continue;
        }
        if let Some(wish) = chosen.add(page, bytes_of) {
            left -= padded(wish.bytes);
            wishes.push(wish);
        }
    }
    for want in wanted.iter().chain(&expected) {
        wishes.extend(chosen.add(page(want.choice.drawable, want.choice.level), bytes_of));
    }
    wishes
}

/// Which pages are chosen, and how much room is left.
pub(super) struct Chosen<'a> {
    /// Of this frame.
    pub number: u64,
    /// For each page the last frame that chose it.
    pub in_target: &'a mut [u64],
    /// Bytes.
    pub left: u64,
}

impl Chosen<'_> {
    fn has(&self, page: u32) -> bool {
        self.in_target[page as usize] == self.number
    }

    /// Adds a page if it is new and fits.
    fn add(&mut self, page: u32, bytes_of: &dyn Fn(u32) -> u64) -> Option<Wish> {
        if self.has(page) {
            return None;
        }
        let bytes = bytes_of(page);
        self.left = self.left.checked_sub(padded(bytes))?;
        self.in_target[page as usize] = self.number;
        Some(Wish { page, bytes })
    }
}
