//! Pixels of one triangle of a [`Batch`]: f32 edge functions, sixteen pixels at a time, in one of three shapes.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x4, f32x16, mask32x16};

use super::image::DepthImage;
use super::setup::{Batch, DOUBT, linear};
use crate::occlusion::mesh::LANES;
use crate::occlusion::view::FARTHEST;

/// Places of sixteen pixels: of a row, and of a 4 x 4 block.
#[derive(Clone, Copy)]
pub(super) struct Places<S: Simd> {
    in_row: f32x16<S>,
    block_column: f32x16<S>,
    block_row: f32x16<S>,
}

impl<S: Simd> Places<S> {
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        let place = |f: fn(usize) -> usize| {
            let places: [f32; LANES] = std::array::from_fn(|i| f(i) as f32);
            f32x16::from_slice(simd, &places)
        };
        Places { in_row: place(|i| i), block_column: place(|i| i % 4), block_row: place(|i| i / 4) }
    }
}

/// The functions of one triangle, taken out of its batch: per column, per row, at the first pixel.
struct Functions {
    edges: [[f32; 3]; 3],
    nearness: [f32; 3],
}

/// Draws the triangle of a lane.
#[inline(always)]
pub(super) fn fill<S: Simd>(simd: S, places: Places<S>, batch: &Batch, lane: usize, image: &mut DepthImage) {
    let (left, right) = (batch.left[lane] as usize, batch.right[lane] as usize);
    let (top, bottom) = (batch.top[lane] as usize, batch.bottom[lane] as usize);
    let functions = Functions {
        edges: batch.edges.map(|edge| edge.map(|values| values[lane])),
        nearness: batch.nearness.map(|values| values[lane]),
    };
    image.touch(top, bottom);
    let (wide, tall) = (right - left, bottom - top);
    if wide < 4 && tall < 4 {
        block(simd, places, &functions, batch, lane, (left, top), image);
    } else if wide < LANES {
        rows(simd, places, &functions, batch, lane, (left, top), tall, image);
    } else {
        spans(simd, places, &functions, batch, lane, (left, top), (wide, tall), image);
    }
}

/// Which pixels the f32 functions say are inside, and which of them they are not sure of.
#[inline(always)]
fn inside<S: Simd>(simd: S, edges: [f32x16<S>; 3]) -> (mask32x16<S>, u64) {
    let least = edges[0].min(edges[1]).min(edges[2]);
    let sure = least.simd_gt(f32x16::splat(simd, 2.0 * DOUBT));
    let maybe = least.simd_ge(f32x16::splat(simd, 0.0)).to_bitmask();
    (sure, maybe & !sure.to_bitmask())
}

/// At most 4 x 4 pixels.
#[inline(always)]
fn block<S: Simd>(
    simd: S,
    places: Places<S>,
    functions: &Functions,
    batch: &Batch,
    lane: usize,
    (left, top): (usize, usize),
    image: &mut DepthImage,
) {
    let splat = |value| f32x16::splat(simd, value);
    let at = |f: [f32; 3]| places.block_column * splat(f[0]) + places.block_row * splat(f[1]) + splat(f[2]);
    let (sure, doubtful) = inside(simd, functions.edges.map(at));
    if doubtful == 0 && sure.to_bitmask() == 0 {
        return;
    }
    let nearness = at(functions.nearness);
    let drawn = sure.select(nearness, splat(FARTHEST));
    let start = top * image.stride + left;
    let stride = image.stride;
    let quarters: [f32; LANES] = *drawn;
    for row in 0..4 {
        let texels = &mut image.texels[start + row * stride..start + row * stride + 4];
        let drawn = f32x4::from_slice(simd, &quarters[4 * row..4 * row + 4]);
        f32x4::from_slice(simd, texels).max(drawn).store_slice(texels);
    }
    if doubtful != 0 {
        let all: [f32; LANES] = *nearness;
        settle(batch, lane, doubtful, |i| (left + i % 4, top + i / 4), &all, image);
    }
}

/// Rows of at most sixteen pixels.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "one triangle, all of it")]
fn rows<S: Simd>(
    simd: S,
    places: Places<S>,
    functions: &Functions,
    batch: &Batch,
    lane: usize,
    (left, top): (usize, usize),
    tall: usize,
    image: &mut DepthImage,
) {
    let splat = |value| f32x16::splat(simd, value);
    let columns = functions.edges.map(|f| places.in_row * splat(f[0]));
    let nearness_columns = places.in_row * splat(functions.nearness[0]);
    for row in 0..=tall {
        let down = row as f32;
        let at_row = |f: [f32; 3]| splat(f[2] + f[1] * down);
        let [a, b, c] = functions.edges.map(at_row);
        let (sure, doubtful) = inside(simd, [columns[0] + a, columns[1] + b, columns[2] + c]);
        let nearness = nearness_columns + at_row(functions.nearness);
        put(simd, sure, doubtful, nearness, batch, lane, (left, top + row), image);
    }
}

/// Rows of any length: between the crossings of the edges.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "one triangle, all of it")]
fn spans<S: Simd>(
    simd: S,
    places: Places<S>,
    functions: &Functions,
    batch: &Batch,
    lane: usize,
    (left, top): (usize, usize),
    (wide, tall): (usize, usize),
    image: &mut DepthImage,
) {
    let splat = |value| f32x16::splat(simd, value);
    let columns = functions.edges.map(|f| places.in_row * splat(f[0]));
    let nearness_columns = places.in_row * splat(functions.nearness[0]);
    for row in 0..=tall {
        let down = row as f32;
        let at_row = |f: [f32; 3]| f[2] + f[1] * down;
        let edges = functions.edges.map(at_row);
        // Wider than any rounding of the quotient by far.
        let (mut from, mut to) = (0.0f32, wide as f32);
        for (edge, [per_column, ..]) in edges.iter().zip(functions.edges) {
            let crossing = -edge / per_column;
            if per_column > 0.0 {
                from = from.max(crossing - 1.0);
            } else if per_column < 0.0 {
                to = to.min(crossing + 1.0);
            }
        }
        if from > to {
            continue;
        }
        let nearness_row = at_row(functions.nearness);
        for start in (from as usize..=to as usize).step_by(LANES) {
            let along = start as f32;
            let at = |k: usize| columns[k] + splat(edges[k] + functions.edges[k][0] * along);
            let (sure, doubtful) = inside(simd, [at(0), at(1), at(2)]);
            let nearness = nearness_columns + splat(nearness_row + functions.nearness[0] * along);
            put(simd, sure, doubtful, nearness, batch, lane, (left + start, top + row), image);
        }
    }
}

/// Writes sixteen pixels of a row.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "one run of pixels, all of it")]
fn put<S: Simd>(
    simd: S,
    sure: mask32x16<S>,
    doubtful: u64,
    nearness: f32x16<S>,
    batch: &Batch,
    lane: usize,
    (column, row): (usize, usize),
    image: &mut DepthImage,
) {
    let start = row * image.stride + column;
    let texels = &mut image.texels[start..start + LANES];
    let drawn = sure.select(nearness, f32x16::splat(simd, FARTHEST));
    f32x16::from_slice(simd, texels).max(drawn).store_slice(texels);
    if doubtful != 0 {
        let all: [f32; LANES] = *nearness;
        settle(batch, lane, doubtful, |i| (column + i, row), &all, image);
    }
}

/// Decides in f64 what f32 left in doubt.
#[cold]
#[inline(never)]
fn settle(
    batch: &Batch,
    lane: usize,
    doubtful: u64,
    place: impl Fn(usize) -> (usize, usize),
    nearness: &[f32; LANES],
    image: &mut DepthImage,
) {
    for (i, &nearness) in nearness.iter().enumerate().filter(|(i, _)| doubtful >> i & 1 == 1) {
        let (column, row) = place(i);
        let (right, bottom) = (batch.right[lane] as usize, batch.bottom[lane] as usize);
        let covers = |edge: &[[f64; LANES]; 3]| {
            linear(&edge.map(|values| values[lane]), column as f64, row as f64) >= 0.0
        };
        if column <= right && row <= bottom && batch.exact.iter().all(covers) {
            let texel = &mut image.texels[row * image.stride + column];
            *texel = texel.max(nearness);
        }
    }
}
