//! Charts with both axes logarithmic, where power laws are straight lines; the slope of each in the legend.

use std::path::Path;

use plotters::coord::ranged1d::{KeyPointHint, Ranged};
use plotters::prelude::*;

/// One panel.
pub struct Chart {
    pub title: String,
    pub x_label: &'static str,
    pub y_label: &'static str,
    /// How a number on the x axis is written.
    pub x_name: fn(f64) -> String,
    pub curves: Vec<Curve>,
}

/// Points by rising x, and what they are.
pub struct Curve {
    pub name: String,
    pub points: Vec<(f64, f64)>,
}

impl Curve {
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
}

/// An axis of powers of 10, or of the points themselves.
struct Decades {
    log10: std::ops::Range<f64>,
    /// Where marks are; powers of 10 when empty.
    marks: Vec<f64>,
}

impl Ranged for Decades {
    type FormatOption = plotters::coord::ranged1d::NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let share = (value.log10() - self.log10.start) / (self.log10.end - self.log10.start);
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        if !self.marks.is_empty() {
            return self.marks.clone();
        }
        let (first, last) = (self.log10.start.ceil() as i32, self.log10.end.floor() as i32);
        (first..=last).map(|decade| 10f64.powi(decade)).collect()
    }

    fn range(&self) -> std::ops::Range<f64> {
        10f64.powf(self.log10.start)..10f64.powf(self.log10.end)
    }
}

impl plotters::coord::ranged1d::ValueFormatter<f64> for Decades {
    fn format(value: &f64) -> String {
        value.to_string()
    }
}

/// Points at the end of a curve that its slope in the legend is of: the start is often another law's.
pub const AT_THE_END: usize = 3;

const COLOURS: [RGBColor; 4] =
    [RGBColor(0, 90, 160), RGBColor(210, 90, 0), RGBColor(0, 130, 80), RGBColor(130, 60, 150)];

/// Writes the charts, two a row.
pub fn write_svg(path: &Path, charts: &[Chart]) -> Result<(), Box<dyn std::error::Error>> {
    let rows = charts.len().div_ceil(2);
    let area = SVGBackend::new(path, (1100, 400 * rows as u32)).into_drawing_area();
    area.fill(&WHITE)?;
    for (chart, panel) in charts.iter().zip(area.split_evenly((rows, 2))) {
        let xs = chart.curves.iter().flat_map(|curve| curve.points.iter().map(|p| p.0));
        let ys = chart.curves.iter().flat_map(|curve| curve.points.iter().map(|p| p.1));
        let (x_low, x_high) = extremes(xs);
        let (y_low, y_high) = extremes(ys);
        let x_axis =
            Decades { log10: x_low.log10() - 0.08..x_high.log10() + 0.08, marks: marks(&chart.curves) };
        // Whole decades, and room for the legend above the curves.
        let y_axis =
            Decades { log10: y_low.log10().floor()..(y_high.log10() + 0.6).ceil(), marks: Vec::new() };
        let mut context = ChartBuilder::on(&panel)
            .caption(&chart.title, ("sans-serif", 17))
            .margin(12)
            .x_label_area_size(38)
            .y_label_area_size(62)
            .build_cartesian_2d(x_axis, y_axis)?;
        context
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .x_desc(chart.x_label)
            .y_desc(chart.y_label)
            .x_label_formatter(&|&x| (chart.x_name)(x))
            .y_label_formatter(&|&y| if y < 1.0 { format!("{y}") } else { format!("{y:.0}") })
            .draw()?;
        for (curve, colour) in chart.curves.iter().zip(COLOURS) {
            context
                .draw_series(LineSeries::new(curve.points.iter().copied(), colour.stroke_width(2)))?
                .label(format!("{}: x^{:.2} at the end", curve.name, curve.slope(AT_THE_END)))
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
            context.draw_series(curve.points.iter().map(|&p| Circle::new(p, 3, colour.filled())))?;
        }
        context
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperLeft)
            .background_style(WHITE.mix(0.9))
            .border_style(BLACK.mix(0.3))
            .draw()?;
    }
    area.present()?;
    Ok(())
}

fn extremes(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, 0.0), |(low, high), v| (v.min(low), v.max(high)))
}

/// Where any curve has a point.
fn marks(curves: &[Curve]) -> Vec<f64> {
    let mut marks: Vec<f64> = curves.iter().flat_map(|curve| curve.points.iter().map(|p| p.0)).collect();
    marks.sort_by(f64::total_cmp);
    marks.dedup();
    marks
}
