// What the vertex shader fetches and decodes, written down: for each corner its quantized coordinates and relative position,
// for each triangle its normal.

@group(0) @binding(5) var<storage, read_write> found: array<u32>;

const TRIANGLE_WORDS: u32 = 21u;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let triangle = id.x;
    if triangle * TRIANGLE_WORDS >= arrayLength(&found) {
        return;
    }
    var instance = instances[0];
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
