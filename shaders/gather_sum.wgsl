// From paths to radiance at points: the mean over a point's paths, evened out with neighbours on its strand, whose numbers
// continue each other.

struct GatherSum {
    first: u32,         // of `seen`
    count: u32,
    paths: u32,         // of a point
    pad: u32,
}

@group(0) @binding(0) var<uniform> sums: GatherSum;
@group(0) @binding(1) var<storage, read> seen: array<u32>;
@group(0) @binding(3) var<storage, read_write> hits: Hits;
@group(0) @binding(4) var<storage, read_write> means: array<vec4f>;     // of each point; w: 1 where it is known
@group(0) @binding(5) var<storage, read> strand_ends: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> radiance: array<vec4f>;

// A point a thread.
@compute @workgroup_size(64)
fn sum(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= sums.count) {
        return;
    }
    var total = vec3f();
    for (var k = 0u; k < sums.paths; k++) {
        total += bitcast<vec3f>(hits.list[sums.paths * (2u * sums.count + id.x) + k].xyz);
    }
    means[seen[sums.first + id.x]] = vec4f(total / f32(sums.paths), 1.0);
}

// Points to either side that count, the less the farther they are.
const REACH = 4u;

@compute @workgroup_size(64)
fn even_out(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= sums.count) {
        return;
    }
    let point = seen[sums.first + id.x];
    let own = strand_ends[point];
    var total = vec4f();
    let first = max(point, own.x + REACH) - REACH;
    for (var other = first; other <= min(point + REACH, own.y); other++) {
        let apart = max(point, other) - min(point, other);
        total += f32(REACH + 1u - apart) * means[other];
    }
    radiance[point] = vec4f(total.rgb / total.w, 1.0);
}
