//! The curves of this bench: power laws, each with its exponent in the legend.

use voxsight::lab::chart::{Curve, Point};

/// Points by rising x, and what they are.
pub struct PowerLaw {
    pub name: String,
    pub points: Vec<(f64, f64)>,
}

/// Points at the end of a curve that its slope in the legend is of: the start is often another law's.
pub const AT_THE_END: usize = 3;

impl PowerLaw {
    /// Exponent p of the power law y = c x^p, least squares over the logarithms of the last `count` points.
    pub fn slope(&self, count: usize) -> f64 {
        let last = &self.points[self.points.len().saturating_sub(count)..];
        let n = last.len() as f64;
        let logs: Vec<(f64, f64)> = last.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
        let (x_mean, y_mean) =
            (logs.iter().map(|l| l.0).sum::<f64>() / n, logs.iter().map(|l| l.1).sum::<f64>() / n);
        let covariance: f64 = logs.iter().map(|(x, y)| (x - x_mean) * (y - y_mean)).sum();
        covariance / logs.iter().map(|(x, _)| (x - x_mean).powi(2)).sum::<f64>()
    }

    /// For a chart.
    pub fn curve(&self, colour: usize) -> Curve {
        let point = |&(x, y): &(f64, f64)| Point { x, y, label: String::new() };
        Curve {
            name: format!("{}: x^{:.2} at the end", self.name, self.slope(AT_THE_END)),
            colour,
            is_dashed: false,
            points: self.points.iter().map(point).collect(),
        }
    }
}
