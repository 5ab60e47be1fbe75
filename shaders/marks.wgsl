// What is selected or highlighted: four bits a drawable, eight in a word.

@group(1) @binding(1) var<storage, read> marks: array<u32>;

// `gpu::marks`.
const SELECTED: u32 = 1u;
const HIGHLIGHTED: u32 = 2u;
const SELECTION: vec3f = vec3f(1.0, 0.45, 0.0);
const HIGHLIGHT: vec3f = vec3f(0.15, 0.55, 1.0);

// None where nobody is: no list is that long.
fn mark_of(drawable: u32) -> u32 {
    if (drawable >> 3u) >= arrayLength(&marks) {
        return 0u;
    }
    return (marks[drawable >> 3u] >> (4u * (drawable & 7u))) & 15u;
}
