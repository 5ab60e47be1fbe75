// Rays of a list through the DAG.

struct Listed {
    base: vec3i,
    t_end: f32,
    fraction: vec3f,
    padding_0: u32,
    direction: vec3f,
    padding_1: u32,
}

@group(0) @binding(0) var<storage, read> rays: array<Listed>;
@group(0) @binding(1) var<storage, read_write> found: array<vec4i>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&rays) {
        return;
    }
    let listed = rays[id.x];
    let hit = first_hit(GridRay(listed.base, listed.fraction, listed.direction, listed.t_end));
    found[id.x] = vec4i(hit.voxel, select(0, 1, hit.is_hit));
}
