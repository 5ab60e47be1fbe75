// Rays through the voxel DAG, from cell to cell: the twin of `gpu::twin`, step by step and in f32, after the scalar reference of
// the voxel core (`voxel/src/raycast/reference.rs`), which decides in f64.

// log2 of the words of a slab.
override DAG_SHIFT: u32;
// Slabs there are: with one, no shader looks for the right one.
override DAG_SLABS: u32;

@group(1) @binding(0) var<storage, read> dag_0: array<u32>;
@group(1) @binding(1) var<storage, read> dag_1: array<u32>;
@group(1) @binding(2) var<storage, read> dag_2: array<u32>;
@group(1) @binding(3) var<storage, read> dag_3: array<u32>;
@group(1) @binding(4) var<uniform> dag: Dag;
// Bricks in which voxels are that cast no shadow: x and y of the corner, z and the mask; slots of a hash table.
@group(1) @binding(5) var<storage, read> clear_bricks: array<vec4u>;

// `gpu::dag::DagUniform`.
struct Dag {
    // Word of the root.
    root: u32,
    // Height of the root; a node of height h covers 4^(h+1) voxels a side.
    height: u32,
    // Voxels a side of the grid; 0 where nothing is in it.
    side: i32,
    // Word of the first leaf mask.
    leaves_at: u32,
    // Slots of `clear_bricks` less one, a power of two less one; 0 where every voxel casts.
    clear_slots: u32,
    // Word of the first brick count, and the first word of a node that has one.
    counts_at: u32,
    counts_from: u32,
    padding_0: u32,
}

// A ray of grid space: whole voxels and the rest of its origin apart, so that the rest keeps all its digits.
struct GridRay {
    base: vec3i,
    // 0 to 1.
    fraction: vec3f,
    direction: vec3f,
    // In lengths of the direction.
    t_end: f32,
}

// Where a ray is.
struct Walk {
    base: vec3i,
    fraction: vec3f,
    direction: vec3f,
    inverse: vec3f,
    rises: vec3<bool>,
    t_end: f32,
    voxel: vec3i,
    // Of the node that `voxel` is looked up in; 0: `leaf` is the mask of its brick.
    height: u32,
    leaf: vec2u,
    nodes: array<u32, MAX_STACK>,
}

// Height of the root over the largest grid, and a slot for the leaf.
const MAX_STACK: u32 = 9u;
// Stands for 1/0: larger than any other reciprocal, and still finite after every product.
const PARALLEL: f32 = 1.2676506e30;
// Components below this fraction of the largest are taken as 0.
const NEGLIGIBLE: f32 = 9.3132257e-10;
// No ray crosses as many cells: a guard against what cannot happen, since a shader that does not end takes the machine with it.
const MOST_STEPS: u32 = 1u << 20u;

fn dag_word(at: u32) -> u32 {
    if DAG_SLABS == 1u {
        return dag_0[at];
    }
    let inside = at & ((1u << DAG_SHIFT) - 1u);
    switch at >> DAG_SHIFT {
        case 0u: { return dag_0[inside]; }
        case 1u: { return dag_1[inside]; }
        case 2u: { return dag_2[inside]; }
        default: { return dag_3[inside]; }
    }
}

// Where the ray meets planes at these coordinates.
fn at_planes(walk: ptr<function, Walk>, planes: vec3i) -> vec3f {
    return (vec3f(planes - (*walk).base) - (*walk).fraction) * (*walk).inverse;
}

// The same of one axis.
fn at_plane(walk: ptr<function, Walk>, axis: u32, plane: i32) -> f32 {
    return (f32(plane - (*walk).base[axis]) - (*walk).fraction[axis]) * (*walk).inverse[axis];
}

fn smallest(v: vec3f) -> f32 {
    return min(min(v.x, v.y), v.z);
}

fn largest(v: vec3f) -> f32 {
    return max(max(v.x, v.y), v.z);
}

// Cuts a ray to the grid and re-bases it at its entry. False when it passes by.
fn enter(ray: GridRay, walk: ptr<function, Walk>) -> bool {
    let size = abs(ray.direction);
    let most = largest(size);
    if dag.side == 0 || !(most > 0.0) {
        return false;
    }
    let parallel = size < vec3f(most * NEGLIGIBLE);
    (*walk).base = ray.base;
    (*walk).fraction = ray.fraction;
    (*walk).direction = select(ray.direction, vec3f(0.0), parallel);
    (*walk).inverse = select(1.0 / ray.direction, vec3f(PARALLEL), parallel);
    (*walk).rises = (*walk).inverse > vec3f(0.0);
    let low = at_planes(walk, vec3i(0));
    let high = at_planes(walk, vec3i(dag.side));
    // A ray in a plane of the grid's own border or outside of it meets nothing.
    let within = (ray.base >= vec3i(0)) & (ray.base < vec3i(dag.side));
    if any(parallel & !within) {
        return false;
    }
    let nearest = select(min(low, high), vec3f(-PARALLEL), parallel);
    let farthest = select(max(low, high), vec3f(PARALLEL), parallel);
    let t_in = max(largest(nearest), 0.0);
    let t_out = min(smallest(farthest), ray.t_end);
    if !(t_in <= t_out) {
        return false;
    }
    if t_in > 0.0 {
        let entry = (*walk).fraction + t_in * (*walk).direction;
        let whole = floor(entry);
        let base = (*walk).base + vec3i(whole);
        let beyond = base >= vec3i(dag.side);
        let below = base < vec3i(0);
        (*walk).fraction = select(entry - whole, vec3f(0.0), beyond | below);
        (*walk).base = clamp(base, vec3i(0), vec3i(dag.side));
    }
    (*walk).t_end = t_out - t_in;
    return true;
}

// The voxel in which the ray starts; may lie outside the grid where it only touches it.
fn start(walk: ptr<function, Walk>) -> vec3i {
    let is_below = ((*walk).fraction == vec3f(0.0)) & !(*walk).rises;
    return (*walk).base - select(vec3i(0), vec3i(1), is_below);
}

// Index of a child or a voxel.
fn slot_of(voxel: vec3i, shift: u32) -> u32 {
    let digits = (vec3u(voxel) >> vec3u(shift)) & vec3u(3u);
    return digits.x | (digits.y << 2u) | (digits.z << 4u);
}

fn has_bit(mask: vec2u, bit: u32) -> bool {
    return ((select(mask.x, mask.y, bit >= 32u) >> (bit & 31u)) & 1u) == 1u;
}

// Set bits below this one.
fn rank_of(mask: vec2u, bit: u32) -> u32 {
    let below = (1u << (bit & 31u)) - 1u;
    if bit >= 32u {
        return countOneBits(mask.x) + countOneBits(mask.y & below);
    }
    return countOneBits(mask.x & below);
}

// Coordinate of the voxel that the ray is in just after `t`, from the voxel `before` on, in the cell at `low`.
fn coordinate_after(walk: ptr<function, Walk>, axis: u32, t: f32, before: i32, low: i32, size: i32) -> i32 {
    // A guess that rounding can make wrong, then the planes decide.
    let guess = (*walk).base[axis] + i32(floor((*walk).fraction[axis] + t * (*walk).direction[axis]));
    var c: i32;
    if (*walk).rises[axis] {
        c = clamp(guess, before, low + size - 1);
        while c > before && at_plane(walk, axis, c) > t {
            c--;
        }
        while c < low + size - 1 && at_plane(walk, axis, c + 1) <= t {
            c++;
        }
    } else {
        c = clamp(guess, low, before);
        while c < before && at_plane(walk, axis, c + 1) > t {
            c++;
        }
        while c > low && at_plane(walk, axis, c) <= t {
            c--;
        }
    }
    return c;
}

fn is_outside(voxel: vec3i) -> bool {
    return any(voxel < vec3i(0)) || any(voxel >= vec3i(dag.side));
}

// Does a voxel, of a brick with such voxels, cast no shadow? Linear probing; 2^32 - 1 marks a free slot.
fn is_clear(voxel: vec3i) -> bool {
    if dag.clear_slots == 0u {
        return false;
    }
    let brick = vec3u(voxel) >> vec3u(2u);
    let key = vec2u(brick.x | (brick.y << 16u), brick.z);
    var slot = hash_of(key) & dag.clear_slots;
    var entry = clear_bricks[slot];
    while entry.y != 0xffffffffu && any(entry.xy != key) {
        slot = (slot + 1u) & dag.clear_slots;
        entry = clear_bricks[slot];
    }
    return entry.y != 0xffffffffu && has_bit(entry.zw, slot_of(voxel, 0u));
}

fn hash_of(key: vec2u) -> u32 {
    var h = key.x * 0x9e3779b1u ^ key.y * 0x85ebca77u;
    h ^= h >> 15u;
    h *= 0xc2b2ae3du;
    return h ^ (h >> 13u);
}

// Sets out. False when the ray passes the grid by.
fn begin(ray: GridRay, walk: ptr<function, Walk>) -> bool {
    if !enter(ray, walk) {
        return false;
    }
    (*walk).voxel = start(walk);
    (*walk).height = dag.height;
    (*walk).nodes[dag.height] = dag.root;
    return !is_outside((*walk).voxel);
}

// Goes down to the smallest cell that holds the voxel. True where it is an occupied voxel, false where it is empty.
fn descend(walk: ptr<function, Walk>) -> bool {
    loop {
        let bit = slot_of((*walk).voxel, 2u * (*walk).height);
        if (*walk).height == 0u {
            return has_bit((*walk).leaf, bit);
        }
        let node = (*walk).nodes[(*walk).height];
        let mask = vec2u(dag_word(node), dag_word(node + 1u));
        if !has_bit(mask, bit) {
            break;
        }
        let child = dag_word(node + 2u + rank_of(mask, bit));
        (*walk).height--;
        if (*walk).height > 0u {
            (*walk).nodes[(*walk).height] = child;
        } else {
            let at = dag.leaves_at + 2u * child;
            (*walk).leaf = vec2u(dag_word(at), dag_word(at + 1u));
        }
    }
    return false;
}

// Crosses the nearest plane of the cell, and every other that the ray meets at the same t. False at the end of the ray.
fn advance(walk: ptr<function, Walk>) -> bool {
    let size = 1i << (2u * (*walk).height);
    let before = (*walk).voxel;
    let low = before & vec3i(-size);
    let exits = at_planes(walk, select(low, low + size, (*walk).rises));
    let t = smallest(exits);
    if t > (*walk).t_end {
        return false;
    }
    for (var axis = 0u; axis < 3u; axis++) {
        if exits[axis] <= t {
            (*walk).voxel[axis] = select(low[axis] - 1, low[axis] + size, (*walk).rises[axis]);
        } else if size > 1 {
            (*walk).voxel[axis] = coordinate_after(walk, axis, t, before[axis], low[axis], size);
        }
    }
    if is_outside((*walk).voxel) {
        return false;
    }
    // Up to the node that holds both.
    let changed = before ^ (*walk).voxel;
    (*walk).height = max((*walk).height, firstLeadingBit(u32(changed.x | changed.y | changed.z)) / 2u);
    return true;
}

// Ordinal of the brick of an occupied voxel, in depth-first order.
fn ordinal_of(walk: ptr<function, Walk>) -> u32 {
    var before = 0u;
    for (var height = 1u; height <= dag.height; height++) {
        let node = (*walk).nodes[height];
        let mask = vec2u(dag_word(node), dag_word(node + 1u));
        let rank = rank_of(mask, slot_of((*walk).voxel, 2u * height));
        if height == 1u {
            before += rank;
        } else {
            before += dag_word(dag.counts_at + (node + 2u + rank - dag.counts_from));
        }
    }
    return before;
}

struct Hit {
    is_hit: bool,
    voxel: vec3i,
}

// The first voxel on a ray that casts a shadow.
fn first_hit(ray: GridRay) -> Hit {
    var walk: Walk;
    var goes_on = begin(ray, &walk);
    for (var step = 0u; goes_on && step < MOST_STEPS; step++) {
        if descend(&walk) && !is_clear(walk.voxel) {
            return Hit(true, walk.voxel);
        }
        goes_on = advance(&walk);
    }
    return Hit(false, vec3i(0));
}
