//! Pictures of a method's worst view: what there is to see, and what is left when only the method's answer is drawn,
//! with lost pixels in red.

use glam::DVec3;
use image::{Rgb, RgbImage, imageops};
use rayon::prelude::*;

use crate::camera::CameraRays;
use crate::filter::Filter;
use crate::loaded::LoadedScene;
use crate::progress::Progress;
use crate::render::{Lighting, RenderScene, RenderSettings, Shadows, render};
use crate::visibility::{QueryScene, QuerySettings, VisibleSet};

/// Reference samples of each pixel that fall on drawables which the answer lacks, row by row.
///
/// Casts the rays of the reference once more, so that the sum is just the reference's samples that were lost. `None`
/// when cancelled.
pub fn lost_samples_by_pixel(
    scene: &QueryScene,
    camera: &CameraRays,
    reference: &QuerySettings,
    answer: &VisibleSet,
    progress: &dyn Progress,
) -> Option<Vec<u32>> {
    let (width, height) = camera.size();
    let is_lost = |drawable: u32| u32::from(!answer.visible[drawable as usize]);
    let pixel = |column: u32, row: u32| {
        let (mut lost, mut through) = (0, Vec::new());
        for sample in 0..reference.rays_per_pixel.samples() {
            let (x, y) = reference.jitter.offset(reference.first_sample + sample, column, row);
            through.clear();
            let ray = camera.ray(f64::from(column) + x, f64::from(row) + y);
            let opaque = scene.exact.closest_through(&ray, scene.filter, |hit| through.push(hit));
            let end = opaque.map_or(f64::INFINITY, |hit| hit.t);
            lost += through.iter().filter(|hit| hit.t < end).map(|hit| is_lost(hit.drawable)).sum::<u32>();
            lost += opaque.map_or(0, |hit| is_lost(hit.drawable));
        }
        lost
    };
    let rows: Option<Vec<Vec<u32>>> = (0..height)
        .into_par_iter()
        .map(|row| (!progress.is_cancelled()).then(|| (0..width).map(|column| pixel(column, row)).collect()))
        .collect();
    rows.map(|rows| rows.into_iter().flatten().collect())
}

/// The pictures of a view. All but `lost_pixels` may be written to files.
pub struct WorstPictures {
    /// What there is to see.
    pub reference: RgbImage,
    /// What is seen when only the answer is drawn; lost pixels red, everything else paler, a frame where most is lost.
    pub answer: RgbImage,
    /// The frame's part of `reference`, and of the answer as drawn, with lost pixels red: side by side, enlarged.
    pub detail: RgbImage,
    /// Pixels with a lost sample.
    pub lost_pixels: u64,
}

/// Samples per pixel of the pictures.
const SAMPLES: u32 = 4;
/// Side of the detail, pixels of the view (less in a smaller view).
const DETAIL: u32 = 64;
/// Side of an enlarged detail.
const DETAIL_SHOWN: u32 = 384;
/// Between the two details.
const GAP: u32 = 12;
const RED: [u8; 3] = [230, 0, 25];
/// The frame around the detail; seen on light and dark.
const FRAME: Rgb<u8> = Rgb([230, 0, 25]);

/// Draws the pictures of a view. `None` when cancelled.
pub fn worst_pictures(
    scene: &LoadedScene,
    camera: &CameraRays,
    reference: &QuerySettings,
    answer: &VisibleSet,
    progress: &dyn Progress,
) -> Option<WorstPictures> {
    let lost = lost_samples_by_pixel(&scene.query(), camera, reference, answer, progress)?;
    let settings = RenderSettings {
        samples_per_pixel: SAMPLES,
        lighting: Lighting::headlight(),
        shadows: Shadows::None,
        up: scene.scene().meta().settings.up.unit(),
        seed: 0,
    };
    let whole = render(&scene.picture(), camera, &settings, progress)?;
    let filter = only(answer, scene.query().filter);
    let drawn = RenderScene { query: QueryScene { filter: &filter, ..scene.query() }, ..scene.picture() };
    let drawn = render(&drawn, camera, &settings, progress)?;

    let share =
        |x: u32, y: u32| f64::from(lost[(y * camera.size().0 + x) as usize]) / reference.rays_per_pixel.get();
    let corner = densest(&lost, camera.size());
    let side = detail_side(camera.size());
    let part = |image: &RgbImage| {
        let part = imageops::crop_imm(image, corner.0, corner.1, side, side).to_image();
        imageops::resize(&part, DETAIL_SHOWN, DETAIL_SHOWN, imageops::FilterType::Nearest)
    };
    let detail = beside(&part(&whole), &part(&marked(&drawn, share, false)));
    let mut answer = marked(&drawn, share, true);
    if lost.iter().any(|&samples| samples > 0) {
        frame(&mut answer, corner, side);
    }
    let lost_pixels = lost.iter().filter(|&&samples| samples > 0).count() as u64;
    Some(WorstPictures { reference: whole, answer, detail, lost_pixels })
}

/// Hides what is not in the answer, besides what was hidden before.
fn only(answer: &VisibleSet, before: &Filter) -> Filter {
    let mut filter = before.clone();
    for (drawable, &visible) in (0..).zip(&answer.visible) {
        if !visible {
            filter.set_hidden(drawable, true);
        }
    }
    filter
}

/// A picture with lost pixels in red, the redder the more of them is lost, but never less than half.
fn marked(drawn: &RgbImage, share: impl Fn(u32, u32) -> f64, pale: bool) -> RgbImage {
    RgbImage::from_fn(drawn.width(), drawn.height(), |x, y| {
        let ground = DVec3::from(drawn.get_pixel(x, y).0.map(f64::from));
        let ground = if pale { DVec3::splat(0.55 * 255.0) + 0.45 * grey(ground) } else { ground };
        let share = share(x, y);
        let red = if share > 0.0 { 0.5 + 0.5 * share.min(1.0) } else { 0.0 };
        Rgb(ground.lerp(DVec3::from(RED.map(f64::from)), red).to_array().map(|c| c.round() as u8))
    })
}

/// Luma of Rec. 709.
fn grey(colour: DVec3) -> DVec3 {
    DVec3::splat(colour.dot(DVec3::new(0.2126, 0.7152, 0.0722)))
}

fn detail_side((width, height): (u32, u32)) -> u32 {
    DETAIL.min(width).min(height)
}

/// Low corner of the square of [`detail_side`] in which most is lost; of several the first. The middle when nothing is.
fn densest(lost: &[u32], (width, height): (u32, u32)) -> (u32, u32) {
    let side = detail_side((width, height));
    // Sums of everything left of and above a corner.
    let stride = width as usize + 1;
    let mut sums = vec![0u64; stride * (height as usize + 1)];
    for (y, row) in lost.chunks_exact(width as usize).enumerate() {
        let mut before = 0;
        for (x, &samples) in row.iter().enumerate() {
            before += u64::from(samples);
            sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + before;
        }
    }
    let at = |x: u32, y: u32| sums[y as usize * stride + x as usize];
    let sum = |x: u32, y: u32| at(x + side, y + side) + at(x, y) - at(x + side, y) - at(x, y + side);
    let corners = (0..=height - side).flat_map(|y| (0..=width - side).map(move |x| (x, y)));
    let most = corners.clone().map(|(x, y)| sum(x, y)).max().unwrap_or(0);
    if most == 0 {
        return ((width - side) / 2, (height - side) / 2);
    }
    // What is lost should lie in the middle of the square: the middle of all squares that hold as much.
    let best: Vec<(u32, u32)> = corners.filter(|&(x, y)| sum(x, y) == most).collect();
    best[best.len() / 2]
}

/// A frame two pixels wide around a square.
fn frame(image: &mut RgbImage, (left, top): (u32, u32), side: u32) {
    let (right, bottom) = (left + side - 1, top + side - 1);
    for i in 0..2 {
        for x in left..=right {
            image.put_pixel(x, top + i, FRAME);
            image.put_pixel(x, bottom - i, FRAME);
        }
        for y in top..=bottom {
            image.put_pixel(left + i, y, FRAME);
            image.put_pixel(right - i, y, FRAME);
        }
    }
}

fn beside(left: &RgbImage, right: &RgbImage) -> RgbImage {
    let mut both = RgbImage::from_pixel(left.width() + GAP + right.width(), left.height(), Rgb([255; 3]));
    imageops::replace(&mut both, left, 0, 0);
    imageops::replace(&mut both, right, i64::from(left.width() + GAP), 0);
    both
}

/// As a page shows it: at most so wide.
pub fn at_most_wide(image: &RgbImage, width: u32) -> RgbImage {
    if image.width() <= width {
        return image.clone();
    }
    let height = (u64::from(image.height()) * u64::from(width)).div_ceil(u64::from(image.width())) as u32;
    imageops::resize(image, width, height, imageops::FilterType::Triangle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_detail_is_where_most_is_lost() {
        let size = (200, 150);
        let mut lost = vec![0; 200 * 150];
        assert_eq!(densest(&lost, size), (68, 43));
        lost[20 * 200 + 30] = 5;
        lost[100 * 200 + 150] = 3;
        lost[101 * 200 + 152] = 3;
        let (x, y) = densest(&lost, size);
        assert!(x <= 150 && 152 < x + DETAIL && y <= 100 && 101 < y + DETAIL, "{x} {y}");
        let tiny = densest(&[0, 0, 0, 7, 0, 0], (3, 2));
        assert!(tiny.0 <= 1 && tiny.1 == 0);
    }
}
