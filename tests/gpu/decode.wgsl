// What the vertex shader fetches and decodes, written down: for each corner its quantized coordinates and relative position,
// for each triangle its normal.

// The instance, word by word.
@group(0) @binding(4) var<storage, read> placed: array<u32>;
@group(0) @binding(5) var<storage, read_write> found: array<u32>;

fn vector(at: u32) -> vec3f {
    return vec3f(bitcast<f32>(placed[at]), bitcast<f32>(placed[at + 1u]), bitcast<f32>(placed[at + 2u]));
}

const TRIANGLE_WORDS: u32 = 21u;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let triangle = id.x;
    if triangle * TRIANGLE_WORDS >= arrayLength(&found) {
        return;
    }
    var instance: Instance;
    instance.column_x = vector(0u);
    instance.column_y = vector(3u);
    instance.column_z = vector(6u);
    instance.base = vec3i(vec3u(placed[9], placed[10], placed[11]));
    instance.fraction = vector(12u);
    instance.translation = vector(15u);
    instance.page = vec4u(placed[18], placed[19], placed[20], placed[21]);
    var q = corners_of(&instance, triangle);
    var at = triangle * TRIANGLE_WORDS;
    for (var corner = 0; corner < 3; corner++) {
        let position = position_of(&instance, q[corner]);
        for (var axis = 0; axis < 3; axis++) {
            found[at] = u32(q[corner][axis]);
            found[at + 3u] = bitcast<u32>(position[axis]);
            at++;
        }
        at += 3u;
    }
    let normal = face_normal(&instance, q);
    for (var axis = 0; axis < 3; axis++) {
        found[at] = bitcast<u32>(normal[axis]);
        at++;
    }
}
