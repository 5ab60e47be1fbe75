// Pages of geometry as `streaming::page` lays them out, and the instances that draw them.

// log2 of the words of a slab.
override POOL_SHIFT: u32;
// Slabs there are: with one, no shader looks for the right one.
override POOL_SLABS: u32;

@group(0) @binding(0) var<storage, read> pool_0: array<u32>;
@group(0) @binding(1) var<storage, read> pool_1: array<u32>;
@group(0) @binding(2) var<storage, read> pool_2: array<u32>;
@group(0) @binding(3) var<storage, read> pool_3: array<u32>;
// One drawable in one frame: `gpu::instance::Instance`, a vertex buffer that steps by instance (software drivers read storage lane
// by lane: from there it took most of a frame). *Relative* space has the world's axes and the eye as its origin.
struct Instance {
    // Relative space from steps of the part's grid: columns.
    @location(0) column_x: vec3f,
    @location(1) column_y: vec3f,
    @location(2) column_z: vec3f,
    // Added to the quantized coordinates, exactly.
    @location(3) base: vec3i,
    // Below a step; added after `base`.
    @location(4) fraction: vec3f,
    @location(5) translation: vec3f,
    // Words of the first vertex and of the first index in the pool; bits of an index; the drawable.
    @location(6) page: vec4u,
    // sRGB, 8 bits each, red lowest.
    @location(7) colour: u32,
}

fn pool_word(at: u32) -> u32 {
    if POOL_SLABS == 1u {
        return pool_0[at];
    }
    let inside = at & ((1u << POOL_SHIFT) - 1u);
    switch at >> POOL_SHIFT {
        case 0u: { return pool_0[inside]; }
        case 1u: { return pool_1[inside]; }
        case 2u: { return pool_2[inside]; }
        default: { return pool_3[inside]; }
    }
}

// Quantized coordinates of a vertex: three u16 that begin at an even byte.
fn quantized(instance: ptr<function, Instance>, vertex: u32) -> vec3i {
    let half = 3u * vertex;
    let word = (*instance).page.x + (half >> 1u);
    let low = pool_word(word);
    let high = pool_word(word + 1u);
    let odd = (half & 1u) == 1u;
    let x = select(low & 0xffffu, low >> 16u, odd);
    let y = select(low >> 16u, high & 0xffffu, odd);
    let z = select(high & 0xffffu, high >> 16u, odd);
    return vec3i(vec3u(x, y, z));
}

// One of the indices of a page.
fn corner_index(instance: ptr<function, Instance>, number: u32) -> u32 {
    let bits = (*instance).page.z;
    let word = (*instance).page.y + ((number * bits) >> 5u);
    let shift = (number * bits) & 31u;
    var index = pool_word(word) >> shift;
    if shift + bits > 32u {
        index |= pool_word(word + 1u) << (32u - shift);
    }
    return index & ((1u << bits) - 1u);
}

// Relative position of a vertex. Sums of steps are exact as far as f32 holds whole numbers, so that what is near the eye is as
// exact as its distance, wherever the part's origin lies.
fn position_of(instance: ptr<function, Instance>, q: vec3i) -> vec3f {
    let steps = vec3f((*instance).base + q) + (*instance).fraction;
    let turned = (*instance).column_x * steps.x + (*instance).column_y * steps.y + (*instance).column_z * steps.z;
    return turned + (*instance).translation;
}

// a b - c d of whole numbers up to 2^17: as exact as f32 can say it, also where the products cancel.
fn difference_of_products(a: i32, b: i32, c: i32, d: i32) -> f32 {
    let high = (a >> 8u) * b - (c >> 8u) * d;
    let low = (a & 0xff) * b - (c & 0xff) * d;
    return f32(high) * 256.0 + f32(low);
}

// Cross product of two edges in steps.
fn cross_of_steps(a: vec3i, b: vec3i) -> vec3f {
    return vec3f(
        difference_of_products(a.y, b.z, a.z, b.y),
        difference_of_products(a.z, b.x, a.x, b.z),
        difference_of_products(a.x, b.y, a.y, b.x),
    );
}

// Of a triangle, on the side from which its corners are counter-clockwise; its largest component is 1 or -1; zero where it has no
// area. Cross products turn with the cofactors of the columns.
fn face_normal(instance: ptr<function, Instance>, q: array<vec3i, 3>) -> vec3f {
    let crossed = cross_of_steps(q[1] - q[0], q[2] - q[0]);
    let x = cross((*instance).column_y, (*instance).column_z);
    let y = cross((*instance).column_z, (*instance).column_x);
    let z = cross((*instance).column_x, (*instance).column_y);
    let normal = x * crossed.x + y * crossed.y + z * crossed.z;
    let size = max(max(abs(normal.x), abs(normal.y)), abs(normal.z));
    return select(normal / size, vec3f(0.0), size == 0.0);
}

// Quantized corners of a triangle.
fn corners_of(instance: ptr<function, Instance>, triangle: u32) -> array<vec3i, 3> {
    return array<vec3i, 3>(
        quantized(instance, corner_index(instance, 3u * triangle)),
        quantized(instance, corner_index(instance, 3u * triangle + 1u)),
        quantized(instance, corner_index(instance, 3u * triangle + 2u)),
    );
}
