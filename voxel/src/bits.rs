//! Bit arithmetic on 64-bit masks of 4x4x4 cells, bit x + 4 y + 16 z, and on 16-bit masks of 4x4 columns.

/// Columns along z (bit x + 4 y) to cells.
#[inline(always)]
pub(crate) fn spread_xy(mask: u16) -> u64 {
    u64::from(mask) * 0x0001_0001_0001_0001
}

/// Half of a column mask (two rows) to half of the cells, by the functions below.
type Spread = [u32; 256];

/// Columns along y, bits x + 4 z of two z, to the cells of these z.
static SPREAD_Y: Spread = {
    let mut spread = [0; 256];
    let mut mask = 0;
    while mask < 256 {
        spread[mask] = ((mask as u32 & 0xf) * 0x1111) | ((mask as u32 >> 4) * 0x1111_0000);
        mask += 1;
    }
    spread
};

/// Columns along x, bits y + 4 z of two z, to the cells of these z.
static SPREAD_X: Spread = {
    let mut spread = [0; 256];
    let mut mask = 0;
    while mask < 256 {
        let mut bit = 0;
        while bit < 8 {
            spread[mask] |= ((mask as u32 >> bit & 1) * 0xf) << (4 * bit);
            bit += 1;
        }
        mask += 1;
    }
    spread
};

/// Both halves.
#[inline(always)]
fn spread(table: &Spread, mask: u16) -> u64 {
    let [low, high] = mask.to_le_bytes();
    u64::from(table[low as usize]) | u64::from(table[high as usize]) << 32
}

/// Columns along y (bit x + 4 z) to cells.
#[inline(always)]
pub(crate) fn spread_xz(mask: u16) -> u64 {
    spread(&SPREAD_Y, mask)
}

/// Columns along x (bit y + 4 z) to cells.
#[inline(always)]
pub(crate) fn spread_yz(mask: u16) -> u64 {
    spread(&SPREAD_X, mask)
}

/// Mirrors the cells along the axes whose bit is set in `flip` (x, y, z = 1, 2, 4).
#[inline(always)]
pub(crate) fn mirror(mask: u64, flip: u32) -> u64 {
    // Exchanges neighbouring groups of `width` bits, the lower ones named by `low`.
    let swap = |m: u64, low: u64, width: u32| (m & low) << width | m >> width & low;
    let mut m = mask;
    if flip & 1 != 0 {
        m = swap(swap(m, 0x5555_5555_5555_5555, 1), 0x3333_3333_3333_3333, 2);
    }
    if flip & 2 != 0 {
        m = swap(swap(m, 0x0f0f_0f0f_0f0f_0f0f, 4), 0x00ff_00ff_00ff_00ff, 8);
    }
    if flip & 4 != 0 {
        m = swap(m, 0x0000_ffff_0000_ffff, 16).rotate_left(32);
    }
    m
}

/// [`mirror`] for when `flip` changes from call to call.
#[inline(always)]
pub(crate) fn mirror_without_branches(mask: u64, flip: u32) -> u64 {
    let pick = |along: u32, a: u64, b: u64| {
        let all = u64::from(flip >> along & 1).wrapping_neg();
        (a & all) | (b & !all)
    };
    let m = pick(0, mirror(mask, 1), mask);
    let m = pick(1, mirror(m, 2), m);
    pick(2, mirror(m, 4), m)
}

/// What to XOR a cell's index with to mirror it along the axes of `flip`.
#[inline(always)]
pub(crate) fn mirror_slot(flip: u32) -> u32 {
    ((flip & 1) * 0b11) | ((flip >> 1 & 1) * 0b1100) | ((flip >> 2 & 1) * 0b11_0000)
}

/// The positions of the set bits, rising.
pub(crate) struct SetBits(pub u64);

impl Iterator for SetBits {
    type Item = u32;

    #[inline(always)]
    fn next(&mut self) -> Option<u32> {
        let bit = self.0.trailing_zeros();
        self.0 &= self.0.wrapping_sub(1);
        (bit < 64).then_some(bit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(is_set: impl Fn(u32, u32, u32) -> bool) -> u64 {
        (0..64).filter(|&b| is_set(b & 3, b >> 2 & 3, b >> 4)).fold(0, |m, b| m | 1 << b)
    }

    #[test]
    fn spreads_repeat_a_column_mask_along_its_axis() {
        let mut random = oorandom::Rand32::new(5);
        for _ in 0..1000 {
            let mask = random.rand_u32() as u16;
            let has = |a: u32, b: u32| mask >> (a + 4 * b) & 1 == 1;
            assert_eq!(spread_xy(mask), cells(|x, y, _| has(x, y)));
            assert_eq!(spread_xz(mask), cells(|x, _, z| has(x, z)));
            assert_eq!(spread_yz(mask), cells(|_, y, z| has(y, z)));
        }
    }

    #[test]
    fn mirrored_masks_hold_the_mirrored_cells() {
        let mut random = oorandom::Rand64::new(6);
        for _ in 0..1000 {
            let mask = random.rand_u64();
            for flip in 0..8 {
                let mirrored =
                    (0..64).filter(|b| mask >> b & 1 == 1).fold(0, |m, b| m | 1 << (b ^ mirror_slot(flip)));
                assert_eq!(mirror(mask, flip), mirrored, "{mask:x} {flip}");
                assert_eq!(mirror_without_branches(mask, flip), mirrored, "{mask:x} {flip}");
            }
        }
    }
}
