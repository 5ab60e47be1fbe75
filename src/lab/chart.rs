//! Charts with both axes logarithmic, where power laws are straight lines. Zeros have a line of their own below.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::prelude::*;

use super::svg::{INK, SvgError, colour, drawn};

/// One panel.
pub struct Chart {
    /// Above it.
    pub title: String,
    /// Below it.
    pub x: Axis,
    /// Beside it.
    pub y: Axis,
    /// With a legend at its right.
    pub curves: Vec<Curve>,
}

/// An axis. Values must be finite and not negative.
pub struct Axis {
    /// What it counts, and in what.
    pub label: String,
    /// How a number is written.
    pub name: fn(f64) -> String,
    /// Marks where the curves have points, instead of at powers of 10.
    pub marks_at_points: bool,
}

/// Points in the order in which they are joined.
pub struct Curve {
    /// For the legend.
    pub name: String,
    /// Which of the colours.
    pub colour: usize,
    /// Not a rival but something to compare with.
    pub is_dashed: bool,
    /// The points.
    pub points: Vec<Point>,
}

/// A point of a curve.
pub struct Point {
    /// Along the axis below.
    pub x: f64,
    /// Along the axis at the left.
    pub y: f64,
    /// Written beside it; may be empty.
    pub label: String,
}

/// Logarithms to base 10 along an axis; 0 is where `zero` says.
#[derive(Clone)]
struct Decades {
    log10: Range<f64>,
    marks: Vec<f64>,
    zero: Option<f64>,
}

impl Decades {
    fn around(values: impl Iterator<Item = f64> + Clone, marks_at_points: bool) -> Self {
        let positive = values.clone().filter(|&value| value > 0.0);
        let (low, high) = positive.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
        // Nothing above 0: any decade will do.
        let (low, high) = if high > 0.0 { (low.log10(), high.log10()) } else { (-1.0, 0.0) };
        let has_zero = values.clone().any(|value| value == 0.0);
        if marks_at_points {
            let mut marks: Vec<f64> = values.collect();
            marks.sort_by(f64::total_cmp);
            marks.dedup();
            return Decades { log10: low - 0.08..high + 0.08, marks, zero: None };
        }
        // Whole decades, at least one.
        let (first, last) = (low.floor(), high.ceil().max(low.floor() + 1.0));
        let decades = (first as i32..=last as i32).map(|decade| 10f64.powi(decade));
        if has_zero {
            let zero = first - 0.6;
            Decades {
                log10: zero..last,
                marks: std::iter::once(0.0).chain(decades).collect(),
                zero: Some(zero),
            }
        } else {
            Decades { log10: first..last, marks: decades.collect(), zero: None }
        }
    }
}

impl Ranged for Decades {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let log10 = self.zero.filter(|_| *value == 0.0).unwrap_or_else(|| value.log10());
        let share = (log10 - self.log10.start) / (self.log10.end - self.log10.start);
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.marks.clone()
    }

    fn range(&self) -> Range<f64> {
        let start = if self.zero.is_some() { 0.0 } else { 10f64.powf(self.log10.start) };
        start..10f64.powf(self.log10.end)
    }
}

impl ValueFormatter<f64> for Decades {
    fn format(value: &f64) -> String {
        value.to_string()
    }
}

/// Width of the legend.
const LEGEND: i32 = 190;
/// Height of a panel.
const HEIGHT: u32 = 400;

/// Draws the charts, `per_row` a row, as an SVG document.
///
/// # Errors
///
/// Drawing failed.
pub fn charts_svg(charts: &[Chart], width: u32, per_row: usize) -> Result<String, SvgError> {
    let rows = charts.len().div_ceil(per_row).max(1);
    drawn((width, HEIGHT * rows as u32), |area| {
        for (chart, panel) in charts.iter().zip(area.split_evenly((rows, per_row))) {
            let (plot, legend) = panel.split_horizontally(panel.dim_in_pixel().0 as i32 - LEGEND);
            draw_chart(chart, &plot)?;
            draw_legend(&chart.curves, &legend)?;
        }
        Ok(())
    })
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

fn draw_chart(chart: &Chart, panel: &Area) -> Result<(), SvgError> {
    let points = || chart.curves.iter().flat_map(|curve| &curve.points);
    let mut context = ChartBuilder::on(panel)
        .caption(&chart.title, ("sans-serif", 17))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(66)
        .build_cartesian_2d(
            Decades::around(points().map(|p| p.x), chart.x.marks_at_points),
            Decades::around(points().map(|p| p.y), chart.y.marks_at_points),
        )?;
    context
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(INK.mix(0.12))
        .x_desc(&chart.x.label)
        .y_desc(&chart.y.label)
        .x_label_formatter(&|&x| (chart.x.name)(x))
        .y_label_formatter(&|&y| (chart.y.name)(y))
        .draw()?;
    for (index, curve) in chart.curves.iter().enumerate() {
        let style = colour(curve.colour);
        // Curves often meet: their labels are on different sides.
        let label_at = [(7, -14), (-14, 5)][index % 2];
        let line = curve.points.iter().map(|p| (p.x, p.y));
        if curve.is_dashed {
            context.draw_series(DashedLineSeries::new(line, 6, 4, style.stroke_width(2)))?;
        } else {
            context.draw_series(LineSeries::new(line, style.stroke_width(2)))?;
        }
        for Point { x, y, label } in &curve.points {
            let at = EmptyElement::at((*x, *y));
            let dot = Circle::new((0, 0), 4, style.filled());
            let text = Text::new(label.clone(), label_at, ("sans-serif", 12).into_font().color(&style));
            context.draw_series(std::iter::once(at + dot + text))?;
        }
    }
    Ok(())
}

fn draw_legend(curves: &[Curve], area: &Area) -> Result<(), SvgError> {
    for (y, curve) in (0..).step_by(20).map(|y| y + 56).zip(curves) {
        let style = colour(curve.colour);
        let ends = if curve.is_dashed { vec![(0, 7), (11, 18)] } else { vec![(0, 18)] };
        for (from, to) in ends {
            area.draw(&PathElement::new([(from, y), (to, y)], style.stroke_width(2)))?;
        }
        area.draw(&Circle::new((9, y), if curve.is_dashed { 0 } else { 4 }, style.filled()))?;
        area.draw(&Text::new(curve.name.as_str(), (26, y - 6), ("sans-serif", 13)))?;
    }
    Ok(())
}
