//! How far an answer is from the reference: the two errors of visibility, never blended into one score.

use serde::Serialize;

use super::VisibleSet;

/// Wrongly hidden among the drawables that cover at least so many reference pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ClassError {
    /// Least reference pixels of a drawable in this class.
    pub at_least_px: f64,
    /// Drawables of this class in the reference.
    pub reference: u64,
    /// Of those, how many the answer lacks.
    pub wrongly_hidden: u64,
}

impl ClassError {
    /// Wrongly hidden as a fraction; 0 when the class is empty.
    pub fn rate(&self) -> f64 {
        ratio(self.wrongly_hidden, self.reference)
    }
}

/// Errors of one answer for one view. V* = drawables with at least one reference sample, V = the answer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Accuracy {
    /// |V*|.
    pub reference: u64,
    /// |V|.
    pub answer: u64,
    /// Triangles (level 0) of V.
    pub answer_triangles: u64,
    /// |V* \ V|: visible drawables that the answer would not draw.
    pub wrongly_hidden: u64,
    /// |V \ V*|: drawables that would be drawn for nothing.
    pub needlessly_drawn: u64,
    /// Triangles (level 0) of those.
    pub needless_triangles: u64,
    /// Reference samples on drawables that the answer lacks, as a fraction of all reference samples on drawables: what
    /// the user would see missing.
    pub lost_pixels: f64,
    /// Wrongly hidden by how many pixels the drawable covers.
    pub classes: Vec<ClassError>,
    /// Mean relative error of the sample counts over drawables with at least 64 reference pixels; `None` when there is
    /// none, or the answer has no samples.
    pub sample_count_error: Option<f64>,
}

impl Accuracy {
    /// |V* \ V| / |V*|; 0 when nothing is visible.
    pub fn wrongly_hidden_rate(&self) -> f64 {
        ratio(self.wrongly_hidden, self.reference)
    }

    /// |V \ V*| / |V|; 0 when the answer is empty.
    pub fn needlessly_drawn_rate(&self) -> f64 {
        ratio(self.needlessly_drawn, self.answer)
    }

    /// Triangles drawn for nothing as a fraction of all that are drawn; 0 when the answer is empty.
    pub fn needless_triangle_rate(&self) -> f64 {
        ratio(self.needless_triangles, self.answer_triangles)
    }
}

fn ratio(part: u64, whole: u64) -> f64 {
    if whole == 0 { 0.0 } else { part as f64 / whole as f64 }
}

/// Pixel classes that are always reported.
const CLASSES_PX: [f64; 3] = [1.0, 4.0, 16.0];
/// Sample counts are compared from this many reference pixels on.
const COUNT_ERROR_FROM_PX: f64 = 64.0;

/// Compares an answer with a reference of the same camera. `pixels` is the number of pixels of the image, `triangles`
/// gives a drawable's level-0 triangles.
pub fn accuracy(
    reference: &VisibleSet,
    answer: &VisibleSet,
    pixels: u64,
    triangles: impl Fn(u32) -> u32,
) -> Accuracy {
    assert_eq!(reference.samples.len(), answer.samples.len(), "answers of two different scenes");
    let reference_per_pixel = reference.weight as f64 / pixels as f64;
    let answer_per_pixel = answer.weight as f64 / pixels as f64;
    let mut result = Accuracy {
        reference: 0,
        answer: 0,
        answer_triangles: 0,
        wrongly_hidden: 0,
        needlessly_drawn: 0,
        needless_triangles: 0,
        lost_pixels: 0.0,
        classes: CLASSES_PX
            .map(|at_least_px| ClassError { at_least_px, reference: 0, wrongly_hidden: 0 })
            .to_vec(),
        sample_count_error: None,
    };
    let (mut samples, mut lost) = (0u64, 0u64);
    let (mut count_error, mut counted) = (0.0, 0u64);
    for (drawable, (&seen, &visible)) in reference.samples.iter().zip(&answer.visible).enumerate() {
        let drawn_triangles = if visible { u64::from(triangles(drawable as u32)) } else { 0 };
        result.answer += u64::from(visible);
        result.answer_triangles += drawn_triangles;
        if seen == 0 {
            result.needlessly_drawn += u64::from(visible);
            result.needless_triangles += drawn_triangles;
            continue;
        }
        let hidden = !visible;
        result.reference += 1;
        result.wrongly_hidden += u64::from(hidden);
        samples += u64::from(seen);
        lost += if hidden { u64::from(seen) } else { 0 };
        let seen_px = f64::from(seen) / reference_per_pixel;
        for class in result.classes.iter_mut().filter(|class| seen_px >= class.at_least_px) {
            class.reference += 1;
            class.wrongly_hidden += u64::from(hidden);
        }
        if seen_px >= COUNT_ERROR_FROM_PX && answer.weight > 0 {
            let answer_px = f64::from(answer.samples[drawable]) / answer_per_pixel;
            count_error += (answer_px - seen_px).abs() / seen_px;
            counted += 1;
        }
    }
    result.lost_pixels = ratio(lost, samples);
    result.sample_count_error = (counted > 0).then(|| count_error / counted as f64);
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(weight: u64, samples: &[u32]) -> VisibleSet {
        VisibleSet {
            // What an answer cost is no part of its errors.
            rays: weight / 3,
            weight,
            hits: weight,
            samples: samples.to_vec(),
            visible: samples.iter().map(|&n| n > 0).collect(),
        }
    }

    #[test]
    fn both_errors_are_counted_apart() {
        // 1000 pixels, 16 reference rays each. Drawables: seen by both, lost (8 px), lost (half a pixel), needless, unseen.
        let reference = set(16_000, &[12_000, 128, 8, 0, 0]);
        let answer = set(1000, &[700, 0, 0, 3, 0]);
        let found = accuracy(&reference, &answer, 1000, |drawable| 5 + 10 * drawable);
        assert_eq!((found.reference, found.answer), (3, 2));
        assert_eq!((found.wrongly_hidden, found.needlessly_drawn), (2, 1));
        assert_eq!((found.answer_triangles, found.needless_triangles), (40, 35));
        assert!((found.lost_pixels - 136.0 / 12_136.0).abs() < 1e-15);
        let classes: Vec<_> = found.classes.iter().map(|c| (c.reference, c.wrongly_hidden)).collect();
        assert_eq!(classes, [(2, 1), (2, 1), (1, 0)]);
        // 750 pixels in truth, 700 found.
        assert!((found.sample_count_error.unwrap() - 50.0 / 750.0).abs() < 1e-12);
        assert!((found.wrongly_hidden_rate() - 2.0 / 3.0).abs() < 1e-15);
        assert_eq!(found.needlessly_drawn_rate(), 0.5);
    }

    #[test]
    fn the_reference_has_no_error_against_itself() {
        let reference = set(1600, &[1000, 1, 0, 17]);
        let found = accuracy(&reference, &reference, 100, |_| 1);
        assert_eq!((found.wrongly_hidden, found.needlessly_drawn, found.lost_pixels), (0, 0, 0.0));
        assert_eq!(found.sample_count_error, None);
    }

    #[test]
    fn empty_views_divide_by_nothing() {
        let nothing = set(100, &[0, 0]);
        let found = accuracy(&nothing, &nothing, 100, |_| 1);
        assert_eq!(
            (found.wrongly_hidden_rate(), found.needlessly_drawn_rate(), found.lost_pixels),
            (0.0, 0.0, 0.0)
        );
    }
}
