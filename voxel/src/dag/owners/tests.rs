//! Packed owners against plain lists.

use super::*;

/// Bricks with their masks and owners, as an assembly has them: long runs, a few neighbours that touch, crowds.
fn random_bricks(random: &mut oorandom::Rand64, count: usize, drawables: u32) -> Vec<(u64, Vec<(u32, u64)>)> {
    let mut bricks = Vec::new();
    let mut near: Vec<u32> = Vec::new();
    while bricks.len() < count {
        if near.len() < 2 || random.rand_range(0..20) == 0 {
            let base = random.rand_range(0..drawables.into()) as u32;
            near = (0..random.rand_range(2..12)).map(|i| (base + 7 * i as u32) % drawables).collect();
        }
        let mask = random.rand_u64() & random.rand_u64() | 1 << random.rand_range(0..64);
        let pick = |random: &mut oorandom::Rand64| near[random.rand_range(0..near.len() as u64) as usize];
        let owners = match random.rand_range(0..10) {
            0..5 => vec![(pick(random), mask)],
            5..8 => {
                let several = if random.rand_range(0..50) == 0 {
                    drawables.min(300)
                } else {
                    random.rand_range(2..5) as u32
                };
                let mut set: Vec<u32> = match several {
                    ..5 => (0..several).map(|_| pick(random)).collect(),
                    _ => (0..several).collect(),
                };
                set.sort_unstable();
                set.dedup();
                let mut owners: Vec<(u32, u64)> =
                    set.into_iter().map(|d| (d, mask & random.rand_u64())).collect();
                owners.retain(|owner| owner.1 != 0);
                if owners.is_empty() { vec![(pick(random), mask)] } else { owners }
            }
            8 => {
                let mut set = [pick(random), pick(random)].map(|d| (d, mask)).to_vec();
                set.sort_unstable();
                set.dedup();
                set
            }
            _ => Vec::new(),
        };
        let owners = match owners.is_empty() {
            // The brick before, again.
            true => {
                bricks.last().map_or_else(|| vec![(0, mask)], |(_, owners): &(u64, Vec<_>)| owners.clone())
            }
            false => owners,
        };
        let union = owners.iter().fold(0, |union, (_, mask)| union | mask);
        bricks.push((union, owners));
    }
    bricks
}

fn pack(bricks: &[(u64, Vec<(u32, u64)>)], end_page_after: usize) -> OwnerTable {
    let mut builder = OwnerBuilder::default();
    for (i, (_, owners)) in bricks.iter().enumerate() {
        match owners[..] {
            [(drawable, _)] => builder.push_one(drawable),
            _ => builder.push(owners),
        }
        if (i + 1) % end_page_after == 0 {
            builder.end_page();
        }
    }
    builder.end_page();
    OwnerTable { directory: builder.directory, pages: builder.pages }
}

#[test]
fn packed_owners_are_those_that_were_pushed() {
    for seed in 0..12 {
        let mut random = oorandom::Rand64::new(seed);
        let drawables = [1, 2, 40, 5000, 1 << 27, u32::MAX][seed as usize % 6];
        let bricks = random_bricks(&mut random, 3000, drawables);
        let table = pack(&bricks, [1, 97, usize::MAX][seed as usize % 3]);
        let count = bricks.len() as u64;
        let index = OwnersIndex::validate(&table.directory, &table.pages, count, drawables).unwrap();
        let packed = OwnersRef::new(&table.directory, &table.pages, &index);
        for (ordinal, (mask, owners)) in bricks.iter().enumerate() {
            let of_brick = packed.of_brick(ordinal as u64, *mask);
            assert_eq!(of_brick.masks(), *owners, "seed {seed}, brick {ordinal}");
            assert!(of_brick.all().eq(owners.iter().map(|o| o.0)), "seed {seed}, brick {ordinal}");
            assert!(packed.all_of_brick(ordinal as u64).eq(of_brick.all()), "seed {seed}, brick {ordinal}");
            for bit in (0..64).filter(|bit| mask >> bit & 1 == 1) {
                let expected = owners.iter().filter(|o| o.1 >> bit & 1 == 1).map(|o| o.0);
                assert!(of_brick.of_voxel(bit).eq(expected), "seed {seed}, brick {ordinal}, voxel {bit}");
            }
        }
    }
}

#[test]
fn runs_and_ordinals_beyond_32_bits_are_found() {
    let mut builder = OwnerBuilder::default();
    let mut firsts = Vec::new();
    for drawable in 0..1000 {
        firsts.push(builder.bricks);
        builder.push_one(drawable);
        // As if the same one had been pushed that often.
        builder.bricks += (1 << 34) + u64::from(drawable * drawable);
    }
    builder.end_page();
    let (directory, pages) = (builder.directory, builder.pages);
    assert!(builder.bricks > 1 << 43);
    let index = OwnersIndex::validate(&directory, &pages, builder.bricks, 1000).unwrap();
    let packed = OwnersRef::new(&directory, &pages, &index);
    let owner = |ordinal| packed.of_brick(ordinal, 1).all().next();
    for (drawable, &first) in firsts.iter().enumerate() {
        let drawable = drawable as u32;
        assert_eq!(owner(first), Some(drawable));
        assert_eq!(owner(first + (1 << 34)), Some(drawable));
        assert_eq!(first.checked_sub(1).and_then(owner), drawable.checked_sub(1));
    }
}

#[test]
fn any_changed_bit_is_refused_or_safe_to_read() {
    let mut refused = 0;
    let mut changed = 0;
    for seed in 0..4 {
        let mut random = oorandom::Rand64::new(seed);
        let bricks = random_bricks(&mut random, 60, 40);
        let table = pack(&bricks, 25);
        let words = table.pages.len() + 2 * table.directory.len();
        for word in 0..words {
            for bit in 0..64 {
                let mut forged = table.clone();
                match word.checked_sub(forged.pages.len()) {
                    None => forged.pages[word] ^= 1 << bit,
                    Some(at) => forged.directory[at / 2][at % 2] ^= 1 << bit,
                }
                changed += 1;
                let Ok(index) = OwnersIndex::validate(&forged.directory, &forged.pages, 60, 40) else {
                    refused += 1;
                    continue;
                };
                let packed = OwnersRef::new(&forged.directory, &forged.pages, &index);
                for (ordinal, (mask, _)) in bricks.iter().enumerate() {
                    let of_brick = packed.of_brick(ordinal as u64, *mask);
                    let union = of_brick.masks().iter().fold(0, |union, &(drawable, mask)| {
                        assert!(drawable < 40, "seed {seed}, word {word}, bit {bit}");
                        union | mask
                    });
                    assert_eq!(union, *mask, "seed {seed}, word {word}, bit {bit}, brick {ordinal}");
                    assert!((0..64).all(|bit| of_brick.of_voxel(bit).all(|drawable| drawable < 40)));
                }
            }
        }
    }
    assert!(refused > changed / 4, "{refused} of {changed} refused");
}

#[test]
fn random_words_never_panic() {
    let mut random = oorandom::Rand64::new(6);
    for round in 0..20_000 {
        let words: Vec<u64> = (0..random.rand_range(0..12))
            .map(|_| {
                random.rand_u64()
                    & if round % 2 == 0 { u64::MAX } else { random.rand_u64() & random.rand_u64() }
            })
            .collect();
        // Almost always refused; that it comes back is the point.
        if let Ok(index) = OwnersIndex::validate(&[[0, 0]], &words, 5, 1 << 31) {
            let packed = OwnersRef::new(&[[0, 0]], &words, &index);
            (0..5).for_each(|ordinal| assert!(packed.of_brick(ordinal, 77).all().count() > 0));
        }
    }
}
