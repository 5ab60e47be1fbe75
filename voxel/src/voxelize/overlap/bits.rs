//! 64-bit masks of 4x4x4 cells, bit x + 4 y + 16 z: boxes, and cutting a mask at brick borders.

/// `f(0)`, `f(1)`, `f(2)`: one for each axis. `array::map` is not always inlined where the caller has a SIMD level.
#[inline(always)]
pub(super) fn per_axis<T>(f: impl Fn(usize) -> T) -> [T; 3] {
    [f(0), f(1), f(2)]
}

/// Bits `first` to `last`, both included, of those from 0 to `count - 1`; `count` is at most 16.
#[inline(always)]
pub(super) fn range_bits(first: i32, last: i32, count: i32) -> u32 {
    let from = first.clamp(0, count) as u32;
    let to = (last + 1).clamp(0, count) as u32;
    // Empty when `to <= from`.
    (1u32 << to).wrapping_sub(1) & !((1 << from) - 1)
}

/// Cells whose coordinates are in a set an axis: four bits each, higher ones are ignored.
#[inline(always)]
pub(super) fn box_mask(sets: [u32; 3]) -> u64 {
    const Y: [u64; 16] = box_table(4, 0x0001_0001_0001_0001);
    const Z: [u64; 16] = box_table(16, 1);
    let x = u64::from(sets[0] & 0xf) * 0x1111_1111_1111_1111;
    x & Y[(sets[1] & 0xf) as usize] & Z[(sets[2] & 0xf) as usize]
}

/// For each set of four: `stride` ones at `stride` times each member, times `copies`.
const fn box_table(stride: u32, copies: u64) -> [u64; 16] {
    let mut table = [0; 16];
    let mut set = 0;
    while set < 16 {
        let mut member = 0;
        while member < 4 {
            if set >> member & 1 == 1 {
                table[set] |= (((1 << stride) - 1) << (stride * member)) * copies;
            }
            member += 1;
        }
        set += 1;
    }
    table
}

/// Cuts the mask of a 4x4x4 window whose low corner is any voxel into the masks of the bricks that it straddles, and
/// visits those that are not empty. `last` is the last voxel of the window that may be set, relative to `corner`.
#[inline(always)]
pub(super) fn split_window(
    corner: [i32; 3],
    last: [i32; 3],
    mask: u64,
    visit: &mut impl FnMut([i32; 3], u64),
) {
    let offset = per_axis(|k| corner[k] & 3);
    let brick = per_axis(|k| corner[k] & !3);
    let straddles = per_axis(|k| offset[k] + last[k] > 3);
    if straddles == [false; 3] {
        // A window that starts inside a brick and does not leave it: its bits move up.
        visit(brick, mask << (offset[0] + 4 * offset[1] + 16 * offset[2]));
        return;
    }
    for z in 0..=i32::from(straddles[2]) {
        for y in 0..=i32::from(straddles[1]) {
            for x in 0..=i32::from(straddles[0]) {
                let at = [x, y, z];
                // Voxels of the window in this brick, and where its low corner lies in the brick.
                let from = per_axis(|k| offset[k] - 4 * at[k]);
                let part = mask & box_mask(per_axis(|k| range_bits(-from[k], 3 - from[k], 4)));
                let moved = from[0] + 4 * from[1] + 16 * from[2];
                let part = if moved >= 0 { part << moved } else { part >> -moved };
                if part != 0 {
                    visit(per_axis(|k| brick[k] + 4 * at[k]), part);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask_of(inside: impl Fn(i32, i32, i32) -> bool) -> u64 {
        (0..64).filter(|b| inside(b & 3, b >> 2 & 3, b >> 4)).fold(0, |mask, b| mask | 1 << b)
    }

    #[test]
    fn box_masks_hold_the_cells_between_their_corners() {
        for first in -2..6 {
            for last in first - 2..6 {
                let sets = [range_bits(first, last, 4), 0x1f6, range_bits(last - 1, last, 4)];
                let expected = mask_of(|x, y, z| {
                    (first..=last).contains(&x) && (1..=2).contains(&y) && (last - 1..=last).contains(&z)
                });
                assert_eq!(box_mask(sets), expected, "{first} {last}");
            }
        }
    }

    #[test]
    fn a_split_window_keeps_every_voxel_where_it_was() {
        let mut random = oorandom::Rand64::new(11);
        for round in 0..4000 {
            let corner = [0; 3].map(|_: i32| random.rand_range(0..12) as i32);
            let last = [0; 3].map(|_: i32| random.rand_range(0..4) as i32);
            let mask = (random.rand_u64() & random.rand_u64()) & box_mask(last.map(|c| range_bits(0, c, 4)));
            let mut found = Vec::new();
            let mut bricks = Vec::new();
            split_window(corner, last, mask, &mut |brick, part| {
                assert!(brick.iter().all(|c| c % 4 == 0), "seed 11, round {round}: {brick:?}");
                assert!(!bricks.contains(&brick), "seed 11, round {round}: {brick:?} comes twice");
                bricks.push(brick);
                for b in (0..64).filter(|b| part >> b & 1 == 1) {
                    found.push([brick[0] + (b & 3), brick[1] + (b >> 2 & 3), brick[2] + (b >> 4)]);
                }
            });
            let mut expected: Vec<_> = (0..64)
                .filter(|b| mask >> b & 1 == 1)
                .map(|b| [corner[0] + (b & 3), corner[1] + (b >> 2 & 3), corner[2] + (b >> 4)])
                .collect();
            found.sort_unstable();
            expected.sort_unstable();
            assert_eq!(found, expected, "seed 11, round {round}: {corner:?} {mask:x}");
        }
    }
}
