// The shadow pass (Xue et al. 2016, section 4.3): from what each pixel shows, jittered rays through the voxels towards the sun, and
// into the sky as far as it is occluded. They start and end as `render::shadow` says for voxels.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> shadow: Shadow;
@group(0) @binding(2) var depths: texture_depth_2d;
@group(0) @binding(3) var drawables: texture_2d<u32>;
@group(0) @binding(4) var normals: texture_2d<u32>;
// Rays that nothing stopped, of all samples so far: towards the sun, into the sky.
@group(0) @binding(6) var<storage, read_write> free: array<vec2u>;
// Where there are several sets of voxels: rays of this dispatch that those before have stopped, two bits a sample.
@group(0) @binding(7) var<storage, read_write> stopped: array<u32>;

// `gpu::shadow::ShadowUniform`.
struct Shadow {
    // Grid position of the eye: whole voxels and the rest.
    eye_voxel: vec3i,
    voxels_per_unit: f32,
    eye_fraction: vec3f,
    // Samples before this frame's.
    first_sample: u32,
    // Towards the sun.
    sun: vec3f,
    // 1 - cos of half the angle across it.
    sun_cap: f32,
    // Of this frame.
    samples: u32,
    has_sun: u32,
    has_sky: u32,
    // How far away things still take light of the sky, voxels.
    reach: f32,
    // Of several sets of voxels, is this the first, is it the last?
    is_first: u32,
    is_last: u32,
    padding_0: u32,
    padding_1: u32,
}

const NOBODY: u32 = 0xffffffffu;
// Farther than any grid is wide.
const ENDLESS: f32 = 1e6;
// Height above its surface at which a ray has left that surface's own voxels, in voxels, for each unit of |n.x| + |n.y| + |n.z|.
const HEIGHT: f32 = 1.0078125;
const TAU: f32 = 6.2831853;

fn hash(x: u32) -> u32 {
    var h = x;
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return h ^ (h >> 16u);
}

// Two numbers from 0 to 1: the R2 sequence, moved by as much for all samples of a pixel and purpose, in 32-bit fractions.
fn numbers(pixel: u32, purpose: u32, sample: u32) -> vec2f {
    let seed = hash(pixel * 2u + purpose);
    let point = vec2u(seed, hash(seed)) + sample * vec2u(3242174889u, 2447445414u);
    return vec2f(point >> vec2u(8u)) / 16777216.0;
}

// Two directions at right angles to one of length 1 (Duff et al. 2017), and one around it: `lift` is 1 - cos of the angle to it.
fn around(axis: vec3f, lift: f32, turn: f32) -> vec3f {
    let sign = select(-1.0, 1.0, axis.z >= 0.0);
    let a = -1.0 / (sign + axis.z);
    let b = axis.x * axis.y * a;
    let side = vec3f(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x);
    let other = vec3f(b, sign + axis.y * axis.y * a, -axis.y);
    let radius = sqrt(max(lift * (2.0 - lift), 0.0));
    return axis * (1.0 - lift) + (side * cos(TAU * turn) + other * sin(TAU * turn)) * radius;
}

// Does anything stop a ray? It starts at `lifted`, in voxels from the eye.
fn is_stopped(lifted: vec3f, direction: vec3f, end: f32) -> bool {
    var start = lifted;
    var t_end = end;
    if HAS_CLIP {
        let range = kept(lifted, direction, end, shadow.voxels_per_unit);
        if range.x > range.y {
            return false;
        }
        start += direction * range.x;
        t_end = range.y - range.x;
    }
    start += shadow.eye_fraction;
    let whole = floor(start);
    return first_hit(GridRay(shadow.eye_voxel + vec3i(whole), start - whole, direction, t_end)).is_hit;
}

@compute @workgroup_size(8, 8)
fn trace(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= view.width || id.y >= view.height {
        return;
    }
    let index = id.y * view.width + id.x;
    let pixel = vec2i(id.xy);
    if textureLoad(drawables, pixel, 0).x == NOBODY {
        return;
    }
    let depth = depth_of(view, textureLoad(depths, pixel, 0));
    let normal = octahedral_unpack(textureLoad(normals, pixel, 0).x);
    let point = point_at(view, vec2f(id.xy) + 0.5, depth);
    let height = HEIGHT * (abs(normal.x) + abs(normal.y) + abs(normal.z));
    let lifted = point * shadow.voxels_per_unit + normal * height;
    var bits = 0u;
    if shadow.is_first == 0u {
        bits = stopped[index];
    }
    for (var i = 0u; i < shadow.samples; i++) {
        let sample = shadow.first_sample + i;
        if shadow.has_sun != 0u && (bits & (1u << (2u * i))) == 0u {
            let u = numbers(index, 0u, sample);
            let direction = around(shadow.sun, u.x * shadow.sun_cap, u.y);
            if dot(normal, direction) <= 0.0 || is_stopped(lifted, direction, ENDLESS) {
                bits |= 1u << (2u * i);
            }
        }
        if shadow.has_sky != 0u && (bits & (2u << (2u * i))) == 0u {
            // Evenly in cos^2.
            let u = numbers(index, 1u, sample);
            let direction = around(normal, 1.0 - sqrt(1.0 - u.x), u.y);
            if is_stopped(lifted, direction, shadow.reach) {
                bits |= 2u << (2u * i);
            }
        }
    }
    if shadow.is_last == 0u {
        stopped[index] = bits;
        return;
    }
    var sums = select(free[index], vec2u(0u), shadow.first_sample == 0u);
    let kinds = vec2u(shadow.has_sun, shadow.has_sky);
    for (var i = 0u; i < shadow.samples; i++) {
        sums += kinds * (vec2u(1u) - ((vec2u(bits) >> vec2u(2u * i, 2u * i + 1u)) & vec2u(1u)));
    }
    free[index] = sums;
}
