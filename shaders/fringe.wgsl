// Points beside those that are seen show what the nearest of these has: what few samples look for and miss is drawn all the
// same, so that hair keeps its coverage.

@group(0) @binding(0) var<storage, read> fringe: array<vec2u>;      // point, and the nearest that is seen
@group(0) @binding(1) var<storage, read_write> radiance: array<vec4f>;

@compute @workgroup_size(64)
fn spread(@builtin(global_invocation_id) id: vec3u) {
    if (id.x < arrayLength(&fringe)) {
        radiance[fringe[id.x].x] = radiance[fringe[id.x].y];
    }
}
