//! A budget of vertices shared out by a closed formula (Peng and Cao 2013, section 5, eq. 1).
//!
//! Drawable i may have `N w_i^(1/a) / sum w_j^(1/a)` vertices, `w_i = b (A_i / D_i) P_i^b`, `b = a - 1`: A_i pixels of the rectangle
//! around its projected box, D_i the least depth of the box, P_i its vertices at level 0. Drawables whose A_i is below the
//! pixel error threshold get none. (The factor b is the same for all and cancels.)
//!
//! We differ in two ways, since our levels are discrete: a drawable gets the finest level that its share allows, or its
//! coarsest where it allows none; and where these coarsest levels exceed N, those with the smallest shares are left out.

use super::{Candidate, Choice, Selection, System};

/// How vertices are shared out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VertexBudgetSettings {
    /// N: most vertices of all drawables together.
    pub budget: u64,
    /// a: how much size on the screen counts against what there is; the paper takes 3.
    pub exponent: f64,
    /// Drawables whose projected box has fewer pixels are not drawn.
    pub least_area: f64,
}

impl Default for VertexBudgetSettings {
    fn default() -> Self {
        VertexBudgetSettings { budget: 4_000_000, exponent: 3.0, least_area: 2.0 }
    }
}

/// Shares of the budget, one for each candidate; 0 below the threshold. Their sum is the budget, but for rounding, or 0.
pub fn shares(system: &dyn System, candidates: &[Candidate], settings: &VertexBudgetSettings) -> Vec<f64> {
    let exponent = settings.exponent.max(1.0);
    let root = |candidate: &Candidate| {
        if candidate.area < settings.least_area {
            return 0.0;
        }
        let vertices = f64::from(system.level(candidate.drawable, 0).vertices);
        // Whatever reaches the eye counts as at a thousandth of a unit before it.
        let weight = candidate.area / candidate.depth.max(1e-3) * vertices.powf(exponent - 1.0);
        weight.powf(exponent.recip())
    };
    let mut shares: Vec<f64> = candidates.iter().map(root).collect();
    let sum: f64 = shares.iter().sum();
    if sum > 0.0 {
        shares.iter_mut().for_each(|share| *share *= settings.budget as f64 / sum);
    }
    shares
}

/// Chooses levels for candidates that rise by drawable.
pub fn select(system: &dyn System, candidates: &[Candidate], settings: &VertexBudgetSettings) -> Selection {
    debug_assert!(candidates.is_sorted_by(|a, b| a.drawable < b.drawable), "candidates rise by drawable");
    let shares = shares(system, candidates, settings);
    let mut found = Selection::default();
    let mut drawn: Vec<(f64, Choice)> = Vec::new();
    for (candidate, share) in candidates.iter().zip(shares) {
        if share == 0.0 {
            found.below_threshold += 1;
            continue;
        }
        let drawable = candidate.drawable;
        let coarsest = system.level_count(drawable) - 1;
        let fits = |&level: &u32| f64::from(system.level(drawable, level).vertices) <= share;
        let level = (0..coarsest).find(fits).unwrap_or(coarsest);
        drawn.push((share, Choice { drawable, level }));
    }
    let vertices = |choice: &Choice| u64::from(system.level(choice.drawable, choice.level).vertices);
    let mut sum: u64 = drawn.iter().map(|(_, choice)| vertices(choice)).sum();
    if sum > settings.budget {
        drawn.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        while sum > settings.budget
            && let Some((_, choice)) = drawn.pop()
        {
            sum -= vertices(&choice);
            found.beyond_budget += 1;
        }
        drawn.sort_by_key(|(_, choice)| *choice);
    }
    drawn.into_iter().for_each(|(_, choice)| found.push(system, choice));
    found
}
