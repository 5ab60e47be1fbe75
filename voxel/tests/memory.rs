//! The limit of memory, alone in a process so that its peak means something.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

mod common;

use common::{Soup, unit_grid};
use voxsight_voxel::voxelize::{Settings, VoxelizeError, voxelize_into};

/// Highest resident memory of this process so far, bytes.
fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    line.trim().strip_suffix("kB").unwrap().trim().parse::<u64>().unwrap() * 1024
}

#[test]
fn wires_across_a_large_grid_end_near_the_limit() {
    let (log2, side) = (13, 256u64 << 13);
    let mut random = oorandom::Rand64::new(1);
    let mut wire = || {
        let mut end = || [0; 3].map(|_: i32| random.rand_range(0..side) as i32);
        let (mut a, mut b) = (end(), end());
        (a[0], b[0]) = (0, side as i32);
        [a, b, b]
    };
    // In one drawable, whose parts a task cannot leave out, and in many.
    let wires: Vec<_> = (0..3000).map(|_| wire()).collect();
    for soup in [Soup(vec![wires.clone()]), Soup(wires.into_iter().map(|w| vec![w]).collect())] {
        for task_bricks in [Settings::default().task_bricks, u64::MAX] {
            let before = peak();
            let limit = 16 << 20;
            let settings = Settings {
                memory: Some(limit),
                task_bricks,
                task_triangles: u64::MAX,
                ..Settings::default()
            };
            let error = voxelize_into(&unit_grid(log2), &soup, &settings, &mut Vec::new()).unwrap_err();
            let told =
                matches!(error, VoxelizeError::Memory { limit: l, used } if l == limit && used > limit);
            assert!(told, "{error}");
            let grown = (peak() - before) >> 20;
            assert!(grown < 96, "{task_bricks} bricks a task: {grown} MiB more with a limit of 16");
        }
    }
}
