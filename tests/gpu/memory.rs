//! Memory over several buffers against one array of bytes.

use voxsight::gpu::memory::PagedMemory;
use voxsight::streaming::Memory;

use super::common::Random;
use super::context;

#[test]
fn writes_and_shifts_leave_what_an_array_would_hold() {
    let Some(context) = context() else { return };
    // Slabs of a power of two: small ones, so that most pieces lie across their borders, and one that holds more than the bounce
    // buffer copies at once.
    for (seed, slab, bytes) in [(1, 1 << 10, 3800), (2, 1 << 12, 1 << 14), (3, 4 << 20, 9 << 20)] {
        let mut random = Random::new(seed);
        let mut small = context.clone();
        small.limit_bindings(slab);
        let mut memory = PagedMemory::new(&small, bytes).unwrap();
        assert!(memory.slabs().taken() <= 3 << 16, "seed {seed}: little is taken before anything is there");
        let mut array = vec![0u8; bytes as usize];
        let (mut across, mut overlapping) = (0, 0);
        for round in 0..30 {
            let (mut steps, mut written) = (0, 0);
            for _ in 0..1 + random.below(6) {
                let at = |random: &mut Random, end: u64| 4 * u64::from(random.below((end / 4) as u32));
                if random.below(3) == 0 {
                    let offset = at(&mut random, bytes);
                    let length = (4 + at(&mut random, 1600)).min(bytes - offset);
                    let new: Vec<u8> = (0..length).map(|_| random.below(256) as u8).collect();
                    memory.write(offset, &new);
                    array[offset as usize..][..new.len()].copy_from_slice(&new);
                    written += length;
                } else {
                    let from = 4 + at(&mut random, bytes - 4);
                    let to = at(&mut random, from);
                    let length = (4 + at(&mut random, bytes)).min(bytes - from);
                    memory.shift(from, to, length);
                    array.copy_within(from as usize..(from + length) as usize, to as usize);
                    across += u32::from(from / slab != (from + length - 1) / slab);
                    overlapping += u32::from(to + length > from);
                }
                steps += 1;
            }
            let mut encoder = context.device.create_command_encoder(&Default::default());
            let copies = memory.flush(context, &mut encoder);
            context.queue.submit([encoder.finish()]);
            assert!(
                copies.bytes == written && copies.count >= steps,
                "seed {seed}, round {round}: {copies:?}"
            );
            assert!(memory.slabs().taken() <= bytes.max(1 << 16), "seed {seed}, round {round}");
            let found = memory.slabs().read(context).unwrap();
            assert!(found == array, "seed {seed}, round {round}: other bytes");
        }
        assert!(bytes <= 1 << 16 || memory.slabs().taken() > bytes / 2, "it has grown");
        assert!(across > 5 && overlapping > 5, "seed {seed}: {across} {overlapping}");
    }
}
