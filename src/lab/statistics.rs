//! Distributions over views: mean, median, 95th percentile, worst and where.

use serde::Serialize;

/// A figure over all views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Distribution {
    /// Arithmetic mean.
    pub mean: f64,
    /// Middle value; of an even number of views the mean of the two in the middle.
    pub median: f64,
    /// Smallest value that at least 95 % of the views do not exceed.
    pub p95: f64,
    /// Largest value.
    pub worst: f64,
    /// The first view that has it.
    pub worst_view: usize,
    /// Views that have such a figure at all: a view without large drawables hides no share of them.
    pub views: usize,
}

impl Distribution {
    /// Of one value a view; zeros when there are none. Values must not be NaN.
    pub fn of(values: &[f64]) -> Self {
        Self::of_some(values.iter().copied().map(Some))
    }

    /// Of the views that have a value.
    pub fn of_some(values: impl IntoIterator<Item = Option<f64>>) -> Self {
        let values: Vec<(usize, f64)> =
            values.into_iter().enumerate().filter_map(|(view, value)| Some((view, value?))).collect();
        let mut sorted: Vec<f64> = values.iter().map(|&(_, value)| value).collect();
        sorted.sort_by(f64::total_cmp);
        let (Some(&worst), count) = (sorted.last(), sorted.len()) else { return Self::default() };
        let worst_view = values.iter().find(|&&(_, value)| value == worst).map_or(0, |&(view, _)| view);
        // Summed in rising order: the same sum whatever order the views come in.
        let mean = sorted.iter().sum::<f64>() / count as f64;
        Distribution {
            mean,
            median: median_of_sorted(&sorted),
            p95: nearest_rank(&sorted, 95),
            worst,
            worst_view,
            views: count,
        }
    }
}

/// Middle value of sorted ones, 0 of none.
fn median_of_sorted(sorted: &[f64]) -> f64 {
    let upper = sorted.len() / 2;
    match (sorted.get(upper), sorted.get(upper.wrapping_sub(1))) {
        (Some(&high), Some(&low)) if sorted.len().is_multiple_of(2) => 0.5 * (low + high),
        (Some(&middle), _) => middle,
        _ => 0.0,
    }
}

/// The value at rank ceil(percent / 100 n), counted from 1.
pub(crate) fn nearest_rank(sorted: &[f64], percent: usize) -> f64 {
    let rank = (sorted.len() * percent).div_ceil(100).max(1);
    sorted.get(rank - 1).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distributions_agree_with_counting() {
        for seed in 0..200u64 {
            let mut random = oorandom::Rand64::new(seed.into());
            let count = 1 + (seed as usize * 7) % 130;
            // Few distinct values, so that there are ties.
            let values: Vec<f64> = (0..count).map(|_| (random.rand_float() * 20.0).floor() / 8.0).collect();
            let found = Distribution::of(&values);
            let at_most = |limit: f64| values.iter().filter(|&&v| v <= limit).count();
            let below = |limit: f64| values.iter().filter(|&&v| v < limit).count();
            assert!((found.mean * count as f64 - values.iter().sum::<f64>()).abs() < 1e-9, "seed {seed}");
            assert!(values.contains(&found.p95), "seed {seed}");
            assert!(at_most(found.p95) * 100 >= 95 * count, "seed {seed}");
            assert!(below(found.p95) * 100 < 95 * count, "seed {seed}");
            assert!(2 * at_most(found.median) >= count && 2 * below(found.median) <= count, "seed {seed}");
            assert_eq!(at_most(found.worst), count, "seed {seed}");
            assert_eq!(values.iter().position(|&v| v == found.worst), Some(found.worst_view), "seed {seed}");
        }
    }

    #[test]
    fn small_cases_are_as_by_hand() {
        let found = Distribution::of(&[4.0, 1.0, 3.0, 2.0]);
        assert_eq!(
            (found.mean, found.median, found.p95, found.worst, found.worst_view),
            (2.5, 2.5, 4.0, 4.0, 0)
        );
        let some = Distribution::of_some([None, Some(2.0), None, Some(5.0), Some(5.0)]);
        assert_eq!((some.mean, some.worst, some.worst_view, some.views), (4.0, 5.0, 3, 3));
        let hundred: Vec<f64> = (1..=100).map(f64::from).collect();
        assert_eq!(Distribution::of(&hundred).p95, 95.0);
        assert_eq!(Distribution::of(&hundred).median, 50.5);
        assert_eq!(Distribution::of(&[]), Distribution::default());
    }
}
