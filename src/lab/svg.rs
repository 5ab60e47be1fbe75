//! SVG documents by plotters, and the colours of all charts.

use plotters::coord::Shift;
use plotters::prelude::*;

/// Drawing failed.
#[derive(Debug, thiserror::Error)]
#[error("cannot draw a chart: {0}")]
pub struct SvgError(String);

impl<E: std::error::Error + Send + Sync> From<DrawingAreaErrorKind<E>> for SvgError {
    fn from(error: DrawingAreaErrorKind<E>) -> Self {
        SvgError(error.to_string())
    }
}

/// Colour of text and axes; pages turn it, and [`PAPER`], around in the dark.
pub const INK: RGBColor = BLACK;
/// Colour of the ground.
pub const PAPER: RGBColor = WHITE;

/// Told apart by people with any kind of colour vision, on white and on dark grey: Okabe and Ito, "Color Universal
/// Design", 2008, the light ones darkened a little, and two more.
const COLOURS: [RGBColor; 9] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 148, 108),
    RGBColor(194, 103, 157),
    RGBColor(190, 130, 0),
    RGBColor(60, 160, 215),
    RGBColor(110, 75, 165),
    RGBColor(125, 80, 55),
    RGBColor(128, 128, 128),
];
/// The grey one: for what is compared with.
pub const GREY: usize = COLOURS.len() - 1;

/// The colour of a number; numbers past the last begin again, without the grey.
pub fn colour(index: usize) -> RGBColor {
    if index == GREY { COLOURS[GREY] } else { COLOURS[index % GREY] }
}

/// Draws a document of this size in pixels.
///
/// # Errors
///
/// What `draw` returns.
pub fn drawn(
    size: (u32, u32),
    draw: impl FnOnce(&DrawingArea<SVGBackend, Shift>) -> Result<(), SvgError>,
) -> Result<String, SvgError> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        area.fill(&PAPER)?;
        draw(&area)?;
        area.present()?;
    }
    Ok(text)
}
