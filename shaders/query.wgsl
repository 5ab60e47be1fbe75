// The visibility query: for each ray the first voxel with an opaque owner ends it; all owners of the voxels up to there are seen. The
// twin of `gpu::twin::count`.

@group(0) @binding(0) var<storage, read> rays: array<ListedRay>;
// Two bits a drawable: 1 hidden, 2 transparent; sixteen in a word.
@group(0) @binding(1) var<storage, read> kinds: array<u32>;
// Samples of each drawable, then a bit for each that was seen, then the rays that met any.
@group(0) @binding(2) var<storage, read_write> tally: array<atomic<u32>>;
@group(0) @binding(3) var<uniform> query: Query;

// `gpu::query::ListedRay`.
struct ListedRay {
    base: vec3i,
    t_end: f32,
    fraction: vec3f,
    padding_0: u32,
    direction: vec3f,
    padding_1: u32,
}

// `gpu::query::QueryUniform`.
struct Query {
    rays: u32,
    // Rays of a row of workgroups.
    row: u32,
    drawables: u32,
    padding_0: u32,
}

const HIDDEN: u32 = 1u;
const TRANSPARENT: u32 = 2u;
// Transparent drawables that a ray counts once each; from then on each time that it meets one.
const MOST_PASSED: u32 = 16u;

@compute @workgroup_size(64)
fn count(@builtin(global_invocation_id) id: vec3u) {
    let number = id.y * query.row + id.x;
    if id.x >= query.row || number >= query.rays {
        return;
    }
    let ray = rays[number];
    var passed: array<u32, MOST_PASSED>;
    var passed_count = 0u;
    var has_met = false;
    var walk: Walk;
    var goes_on = begin(GridRay(ray.base, ray.fraction, ray.direction, ray.t_end), &walk);
    for (var step = 0u; goes_on && step < MOST_STEPS; step++) {
        var opaque = NOWHERE;
        if descend(&walk) {
            let rank = rank_of(walk.leaf, slot_of(walk.voxel, 0u));
            let packed = owners_of(ordinal_of(&walk), walk.leaf);
            for (var i = 0u; i < packed.count; i++) {
                if !owns(packed, i, rank) {
                    continue;
                }
                let owner = owner_at(packed, i);
                let kind = (kinds[owner >> 4u] >> (2u * (owner & 15u))) & 3u;
                if (kind & HIDDEN) != 0u {
                    continue;
                }
                has_met = true;
                atomicOr(&tally[query.drawables + (owner >> 5u)], 1u << (owner & 31u));
                if (kind & TRANSPARENT) != 0u {
                    var is_counted = false;
                    for (var p = 0u; p < passed_count; p++) {
                        is_counted |= passed[p] == owner;
                    }
                    if !is_counted {
                        atomicAdd(&tally[owner], 1u);
                        if passed_count < MOST_PASSED {
                            passed[passed_count] = owner;
                            passed_count++;
                        }
                    }
                } else if opaque == NOWHERE {
                    opaque = owner;
                }
            }
        }
        if opaque != NOWHERE {
            atomicAdd(&tally[opaque], 1u);
            break;
        }
        goes_on = advance(&walk);
    }
    if has_met {
        atomicAdd(&tally[query.drawables + (query.drawables + 31u) / 32u], 1u);
    }
}
