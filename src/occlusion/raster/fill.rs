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
        const IN_ROW: [f32; LANES] =
            [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];
        const COLUMN: [f32; LANES] =
            [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0];
        const ROW: [f32; LANES] =
            [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0];
        Places {
            in_row: f32x16::from_slice(simd, &IN_ROW),
            block_column: f32x16::from_slice(simd, &COLUMN),
            block_row: f32x16::from_slice(simd, &ROW),
        }
    }
}

/// The functions of one triangle, taken out of its batch: per column, per row, at the first pixel.
struct Functions {
    edges: [[f32; 3]; 3],
    nearness: [f32; 3],
}

#[inline(always)]
fn of_lane(values: &[[f32; LANES]; 3], lane: usize) -> [f32; 3] {
    [values[0][lane], values[1][lane], values[2][lane]]
}

/// A function at the sixteen pixels of a block.
#[inline(always)]
fn in_block<S: Simd>(simd: S, places: &Places<S>, f: [f32; 3]) -> f32x16<S> {
    places.block_column * f32x16::splat(simd, f[0])
        + places.block_row * f32x16::splat(simd, f[1])
        + f32x16::splat(simd, f[2])
}

/// How much more a function is at the pixels of a row than at the first.
#[inline(always)]
fn in_row<S: Simd>(simd: S, places: &Places<S>, f: [f32; 3]) -> f32x16<S> {
    places.in_row * f32x16::splat(simd, f[0])
}

/// A function at the first pixel of a row.
#[inline(always)]
fn at_row(f: [f32; 3], down: f32) -> f32 {
    f[2] + f[1] * down
}

/// Draws the triangle of a lane.
#[inline(always)]
pub(super) fn fill<S: Simd>(simd: S, places: Places<S>, batch: &Batch, lane: usize, image: &mut DepthImage) {
    let (left, right) = (batch.left[lane] as usize, batch.right[lane] as usize);
    let (top, bottom) = (batch.top[lane] as usize, batch.bottom[lane] as usize);
    let functions = Functions {
        edges: [
            of_lane(&batch.edges[0], lane),
            of_lane(&batch.edges[1], lane),
            of_lane(&batch.edges[2], lane),
        ],
        nearness: of_lane(&batch.nearness, lane),
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
    let [a, b, c] = functions.edges;
    let edges = [in_block(simd, &places, a), in_block(simd, &places, b), in_block(simd, &places, c)];
    let (sure, doubtful) = inside(simd, edges);
    if doubtful == 0 && sure.to_bitmask() == 0 {
        return;
    }
    let nearness = in_block(simd, &places, functions.nearness);
    let drawn = sure.select(nearness, f32x16::splat(simd, FARTHEST));
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
    let [a, b, c] = functions.edges;
    let columns = [in_row(simd, &places, a), in_row(simd, &places, b), in_row(simd, &places, c)];
    let nearness_columns = in_row(simd, &places, functions.nearness);
    for row in 0..=tall {
        let down = row as f32;
        let edges = [
            columns[0] + f32x16::splat(simd, at_row(a, down)),
            columns[1] + f32x16::splat(simd, at_row(b, down)),
            columns[2] + f32x16::splat(simd, at_row(c, down)),
        ];
        let (sure, doubtful) = inside(simd, edges);
        let nearness = nearness_columns + f32x16::splat(simd, at_row(functions.nearness, down));
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
    let [a, b, c] = functions.edges;
    let columns = [in_row(simd, &places, a), in_row(simd, &places, b), in_row(simd, &places, c)];
    let nearness_columns = in_row(simd, &places, functions.nearness);
    for row in 0..=tall {
        let down = row as f32;
        let edges = [at_row(a, down), at_row(b, down), at_row(c, down)];
        let (mut from, mut to) = (0.0f32, wide as f32);
        for (edge, [per_column, ..]) in edges.iter().zip(functions.edges) {
            // A pixel more is wider than any rounding of the quotient by far.
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
        let nearness_row = at_row(functions.nearness, down);
        let (mut start, last) = (from as usize, to as usize);
        while start <= last {
            let along = start as f32;
            let here = [
                columns[0] + f32x16::splat(simd, edges[0] + a[0] * along),
                columns[1] + f32x16::splat(simd, edges[1] + b[0] * along),
                columns[2] + f32x16::splat(simd, edges[2] + c[0] * along),
            ];
            let (sure, doubtful) = inside(simd, here);
            let nearness =
                nearness_columns + f32x16::splat(simd, nearness_row + functions.nearness[0] * along);
            put(simd, sure, doubtful, nearness, batch, lane, (left + start, top + row), image);
            start += LANES;
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
