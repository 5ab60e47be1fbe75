//! 64-bit masks of 4x4x4 cells, bit x + 4 y + 16 z: columns to cells, boxes, and cutting a mask at brick borders.

/// Columns along x (bit y + 4 z) to cells.
#[inline(always)]
pub(super) fn spread_yz(columns: u64) -> u64 {
    let mut m = columns;
    m = (m | m << 24) & 0x0000_00ff_0000_00ff;
    m = (m | m << 12) & 0x000f_000f_000f_000f;
    m = (m | m << 6) & 0x0303_0303_0303_0303;
    m = (m | m << 3) & 0x1111_1111_1111_1111;
    m * 0xf
}

/// Columns along y (bit x + 4 z) to cells.
#[inline(always)]
pub(super) fn spread_xz(columns: u64) -> u64 {
    let mut m = columns;
    m = (m | m << 24) & 0x0000_00ff_0000_00ff;
    m = (m | m << 12) & 0x000f_000f_000f_000f;
    m * 0x1111
}

/// Columns along z (bit x + 4 y) to cells.
#[inline(always)]
pub(super) fn spread_xy(columns: u64) -> u64 {
    columns * 0x0001_0001_0001_0001
}

/// Cells from `first` to `last`, both included; each is clamped to 0 ..= 3.
#[inline(always)]
pub(super) fn box_mask(first: [i32; 3], last: [i32; 3]) -> u64 {
    let low = first.map(|c| c.clamp(0, 3) as u32);
    let past = last.map(|c| 3 - c.clamp(0, 3) as u32);
    let x = (0xf << low[0]) & (0xf >> past[0]);
    let y = (0xffff << (4 * low[1])) & (0xffff >> (4 * past[1]));
    let z = (u64::MAX << (16 * low[2])) & (u64::MAX >> (16 * past[2]));
    (x * 0x1111_1111_1111_1111) & (y * 0x0001_0001_0001_0001) & z
}

/// Cuts the mask of a 4x4x4 window whose low corner is any voxel into the masks of the bricks that it straddles, and
/// visits those that are not empty. `last` is the last voxel of the window that may be set, relative to `corner`.
#[inline(always)]
pub(super) fn split_window(corner: [i32; 3], last: [i32; 3], mask: u64, visit: &mut impl FnMut([i32; 3], u64)) {
    let offset = corner.map(|c| c & 3);
    let brick = corner.map(|c| c & !3);
    let straddles = [0, 1, 2].map(|k| offset[k] + last[k] > 3);
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
                let from = [0, 1, 2].map(|k| offset[k] - 4 * at[k]);
                let part = mask & box_mask(from.map(|f| -f), from.map(|f| 3 - f));
                let moved = from[0] + 4 * from[1] + 16 * from[2];
                let part = if moved >= 0 { part << moved } else { part >> -moved };
                if part != 0 {
                    visit([0, 1, 2].map(|k| brick[k] + 4 * at[k]), part);
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
    fn every_column_goes_to_its_four_cells() {
        for bit in 0..16 {
            let (a, b) = (bit & 3, bit >> 2);
            assert_eq!(spread_xy(1 << bit), mask_of(|x, y, _| (x, y) == (a, b)));
            assert_eq!(spread_xz(1 << bit), mask_of(|x, _, z| (x, z) == (a, b)));
            assert_eq!(spread_yz(1 << bit), mask_of(|_, y, z| (y, z) == (a, b)));
        }
        let mut random = oorandom::Rand64::new(5);
        for round in 0..1000 {
            let columns = random.rand_range(0..1 << 16);
            let has = |a: i32, b: i32| columns >> (a + 4 * b) & 1 == 1;
            assert_eq!(spread_xy(columns), mask_of(|x, y, _| has(x, y)), "seed 5, round {round}");
            assert_eq!(spread_xz(columns), mask_of(|x, _, z| has(x, z)), "seed 5, round {round}");
            assert_eq!(spread_yz(columns), mask_of(|_, y, z| has(y, z)), "seed 5, round {round}");
        }
    }

    #[test]
    fn box_masks_hold_the_cells_between_their_corners() {
        for low in 0..4 {
            for high in low..4 {
                for outside in [0, 5] {
                    let (low_x, high_x) = (low - if low == 0 { outside } else { 0 }, high);
                    let mask = box_mask([low_x, 0, low], [high_x, 3, high]);
                    let between = |c| (low..=high).contains(&c);
                    assert_eq!(mask, mask_of(|x, _, z| between(x) && between(z)), "{low} {high} {outside}");
                    let mask = box_mask([0, low, 0], [3, high + outside, 7]);
                    let to = if outside == 0 { high } else { 3 };
                    assert_eq!(mask, mask_of(|_, y, _| (low..=to).contains(&y)), "{low} {high} {outside}");
                }
            }
        }
    }

    #[test]
    fn a_split_window_keeps_every_voxel_where_it_was() {
        let mut random = oorandom::Rand64::new(11);
        for round in 0..4000 {
            let corner = [0; 3].map(|_: i32| random.rand_range(0..12) as i32);
            let last = [0; 3].map(|_: i32| random.rand_range(0..4) as i32);
            let mask = (random.rand_u64() & random.rand_u64()) & box_mask([0; 3], last);
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
