//! Bit arithmetic on 64-bit masks of 4x4x4 cells, bit x + 4 y + 16 z, and on 16-bit masks of 4x4 columns.

/// Columns along z (bit x + 4 y) to cells.
#[inline(always)]
pub(crate) fn spread_xy(mask: u16) -> u64 {
    u64::from(mask) * 0x0001_0001_0001_0001
}

/// Columns along y (bit x + 4 z) to cells.
#[inline(always)]
pub(crate) fn spread_xz(mask: u16) -> u64 {
    let m = u64::from(mask);
    let rows = (m & 0xf) | (m & 0xf0) << 12 | (m & 0xf00) << 24 | (m & 0xf000) << 36;
    rows * 0x1111
}

/// Columns along x (bit y + 4 z) to cells.
#[inline(always)]
pub(crate) fn spread_yz(mask: u16) -> u64 {
    let mut m = u64::from(mask);
    m = (m | m << 24) & 0x0000_00ff_0000_00ff;
    m = (m | m << 12) & 0x000f_000f_000f_000f;
    m = (m | m << 6) & 0x0303_0303_0303_0303;
    m = (m | m << 3) & 0x1111_1111_1111_1111;
    m * 0xf
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
    (flip & 1) * 0b11 | (flip >> 1 & 1) * 0b1100 | (flip >> 2 & 1) * 0b11_0000
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
