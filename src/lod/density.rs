//! Triangle density: as many triangles a pixel everywhere as the budget allows (Xue et al. 2016, section 4.2 and eq. 3).
//!
//! The density of a drawable at a level is its triangles divided by the pixels that it covers. Everything visible starts at its
//! coarsest level. To make a drawable one level finer is a *step*; its density is that which the drawable has after it. Steps
//! are taken in rising order of density until one does not fit into the budget: then nobody was refused a level coarser, for
//! its pixels, than what somebody else got. Steps that nobody needs are not offered: those to levels finer than one whose
//! geometric error already projects below a share of a pixel, and those beyond the greatest density.
//!
//! A drawable's steps rise in density, so that any first part of the sorted steps leaves it at one of its levels. Sorting is not
//! needed: the longest part that fits is found by partitioning (weighted quickselect), in time proportional to the number of steps.

use std::cmp::{Ordering, Reverse};

use super::{Candidate, Choice, Selection, System};

/// How finely things shall be drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DensitySettings {
    /// Most triangles of all drawables together.
    pub budget: u64,
    /// Below this many triangles a pixel a drawable is made finer, budget permitting, even if its error is small enough.
    pub least_density: f64,
    /// No drawable is made finer than this.
    pub greatest_density: f64,
    /// A level whose geometric error projects to no more than this is fine enough, pixels.
    pub pixel_error: f64,
    /// Drawables with fewer pixels are not drawn. 0 draws all that is visible.
    pub least_pixels: f64,
    /// A drawable keeps its last level as long as the density that decides is within this factor (at least 1) of one that
    /// would choose that level.
    pub hysteresis: f64,
}

impl Default for DensitySettings {
    fn default() -> Self {
        DensitySettings {
            budget: 4_000_000,
            least_density: 0.0,
            greatest_density: f64::INFINITY,
            pixel_error: 0.5,
            least_pixels: 0.0,
            hysteresis: 1.25,
        }
    }
}

/// One drawable a level finer.
#[derive(Clone, Copy, Debug)]
struct Step {
    density: f64,
    /// Index into the candidates.
    candidate: u32,
    /// The level after it.
    level: u32,
    /// Triangles that it adds.
    triangles: u32,
}

impl Step {
    /// The order in which steps are taken. Of one drawable the coarser level comes first.
    fn order(&self, other: &Self) -> Ordering {
        let key = |step: &Self| (step.candidate, Reverse(step.level));
        self.density.total_cmp(&other.density).then_with(|| key(self).cmp(&key(other)))
    }
}

/// Chooses levels for candidates that rise by drawable; `last` is the selection of the frame before, if there was one.
pub fn select(
    system: &dyn System,
    candidates: &[Candidate],
    settings: &DensitySettings,
    last: Option<&Selection>,
) -> Selection {
    debug_assert!(candidates.is_sorted_by(|a, b| a.drawable < b.drawable), "candidates rise by drawable");
    let mut found = Selection::default();
    let enough = |candidate: &&Candidate| candidate.pixels >= settings.least_pixels;
    let mut drawn: Vec<Candidate> = candidates.iter().filter(enough).copied().collect();
    found.below_threshold = (candidates.len() - drawn.len()) as u32;
    found.beyond_budget = leave_out(system, &mut drawn, settings.budget);
    let coarsest = |candidate: &Candidate| system.level_count(candidate.drawable) - 1;
    let triangles = |candidate: &Candidate, level: u32| system.level(candidate.drawable, level).triangles;
    let base: u64 = drawn.iter().map(|c| u64::from(triangles(c, coarsest(c)))).sum();

    let mut steps: Vec<Step> = Vec::new();
    // Where not even the coarsest levels fit, what is left over makes nobody finer.
    let to_refine = if found.beyond_budget == 0 { drawn.as_slice() } else { &[] };
    for (number, candidate) in (0..).zip(to_refine) {
        steps.extend(steps_of(system, candidate, number, settings));
    }
    let taken = longest_fitting(&mut steps, settings.budget.saturating_sub(base));
    let mut levels: Vec<u32> = drawn.iter().map(coarsest).collect();
    for step in &steps[..taken] {
        let level = &mut levels[step.candidate as usize];
        *level = (*level).min(step.level);
    }
    if let Some(last) = last
        && found.beyond_budget == 0
    {
        // The density that decides: that of the first step that was refused.
        let refused = steps[taken..].iter().map(|step| step.density).fold(f64::INFINITY, f64::min);
        keep_levels(system, &drawn, settings, refused, last, &mut levels);
    }
    for (candidate, level) in drawn.iter().zip(levels) {
        found.push(system, Choice { drawable: candidate.drawable, level });
    }
    found
}

/// Pixels of a drawable that may be seen though no sample met it: fewer than a sample stands for in any query of sense.
const UNSEEN_PIXELS: f64 = 0.1;

/// Triangles a pixel.
fn density(candidate: &Candidate, triangles: u32) -> f64 {
    f64::from(triangles) / candidate.pixels.max(UNSEEN_PIXELS)
}

/// Leaves out drawables until the coarsest levels of all others fit into the budget: those with fewest pixels a triangle.
fn leave_out(system: &dyn System, drawn: &mut Vec<Candidate>, budget: u64) -> u32 {
    let coarsest = |c: &Candidate| system.level(c.drawable, system.level_count(c.drawable) - 1).triangles;
    let mut sum: u64 = drawn.iter().map(|c| u64::from(coarsest(c))).sum();
    if sum <= budget {
        return 0;
    }
    let before = drawn.len();
    drawn.sort_by(|a, b| {
        density(a, coarsest(a)).total_cmp(&density(b, coarsest(b))).then(a.drawable.cmp(&b.drawable))
    });
    while sum > budget
        && let Some(last) = drawn.pop()
    {
        sum -= u64::from(coarsest(&last));
    }
    drawn.sort_by_key(|candidate| candidate.drawable);
    (before - drawn.len()) as u32
}

/// The steps that a drawable may take, finer and finer.
fn steps_of(
    system: &dyn System,
    candidate: &Candidate,
    number: u32,
    settings: &DensitySettings,
) -> impl Iterator<Item = Step> {
    let level = |level: u32| system.level(candidate.drawable, level);
    let step = move |finer: u32| {
        let (coarse, fine) = (level(finer + 1), level(finer));
        let density = density(candidate, fine.triangles);
        let is_fine_enough = coarse.error * candidate.pixels_per_unit <= settings.pixel_error;
        let is_wanted = !is_fine_enough || density <= settings.least_density;
        (is_wanted && density <= settings.greatest_density).then_some(Step {
            density,
            candidate: number,
            level: finer,
            triangles: fine.triangles - coarse.triangles,
        })
    };
    (0..system.level_count(candidate.drawable) - 1).rev().map_while(step)
}

/// Moves the first steps, in the order in which they are taken, to the front: as many as fit into the budget together, up to the
/// first that does not. Returns their number.
fn longest_fitting(steps: &mut [Step], budget: u64) -> usize {
    // Steps before `low` are taken; those from `high` on are not.
    let (mut low, mut high, mut left) = (0, steps.len(), budget);
    while low < high {
        let middle = (high - low) / 2;
        let part = &mut steps[low..high];
        part.select_nth_unstable_by(middle, Step::order);
        let weight: u64 = part[..=middle].iter().map(|step| u64::from(step.triangles)).sum();
        if weight <= left {
            left -= weight;
            low += middle + 1;
        } else {
            high = low + middle;
        }
    }
    low
}

/// Lets drawables keep their last levels where these are about right, without leaving the budget.
fn keep_levels(
    system: &dyn System,
    drawn: &[Candidate],
    settings: &DensitySettings,
    deciding: f64,
    last: &Selection,
    levels: &mut [u32],
) {
    let band = settings.hysteresis.max(1.0);
    let fresh = levels.to_vec();
    let mut kept_finer: Vec<usize> = Vec::new();
    let mut sum = 0u64;
    for (i, candidate) in drawn.iter().enumerate() {
        if let Some(before) = last.level_of(candidate.drawable)
            && before < system.level_count(candidate.drawable)
        {
            let finest = level_at(system, candidate, settings, deciding * band, settings.pixel_error / band);
            let coarsest =
                level_at(system, candidate, settings, deciding / band, settings.pixel_error * band);
            if (finest..=coarsest).contains(&before) {
                levels[i] = before;
                if before < fresh[i] {
                    kept_finer.push(i);
                }
            }
        }
        sum += u64::from(system.level(candidate.drawable, levels[i]).triangles);
    }
    // Those kept finer than they should be give way, the densest first.
    let triangles = |i: usize, level: u32| system.level(drawn[i].drawable, level).triangles;
    let density_of = |i: usize| density(&drawn[i], triangles(i, levels[i]));
    let mut densities: Vec<(f64, usize)> = kept_finer.iter().map(|&i| (density_of(i), i)).collect();
    densities.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    for (_, i) in densities {
        if sum <= settings.budget {
            break;
        }
        sum = sum - u64::from(triangles(i, levels[i])) + u64::from(triangles(i, fresh[i]));
        levels[i] = fresh[i];
    }
}

/// The level of a drawable if steps below a density are taken.
fn level_at(
    system: &dyn System,
    candidate: &Candidate,
    settings: &DensitySettings,
    deciding: f64,
    pixel_error: f64,
) -> u32 {
    let settings = DensitySettings { pixel_error, ..*settings };
    let taken = steps_of(system, candidate, 0, &settings).take_while(|step| step.density < deciding);
    taken.last().map_or(system.level_count(candidate.drawable) - 1, |step| step.level)
}
