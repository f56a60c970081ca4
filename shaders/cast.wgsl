// Follows rays between strands. Twin: StrandRays::cast_nearest and cast_any of src/reference/transmittance.rs.

struct Cast {
    first: u32,         // place of the first path that is cast
    all: u32,           // that are followed together
    head: vec2u,        // root of the head's tree, and first of its shapes; 0 without one
}

@group(0) @binding(4) var<storage, read> paths: array<Path>;
@group(0) @binding(5) var<storage, read_write> hits: Hits;
@group(0) @binding(6) var<uniform> rays: Cast;
@group(0) @binding(7) var<uniform> queues: Queues;

// What each ray meets first.
@compute @workgroup_size(64)
fn cast_nearest(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= queues.onward.count) {
        return;
    }
    let path = paths[rays.first + id.x];
    var hit = vec4u(HIT_NOTHING, 0u, 0u, 0u);
    for (var there = path.most > 0.0; there; there = false) {
        var ray = ray_from(path.origin, path.direction, path.most, path.clear, path.own);
        var walk = walk_from(0u);
        while (!walk.over) {
            var leaves = visit(ray, &walk);
            for (; leaves.bits != 0u; leaves.bits &= leaves.bits - 1u) {
                let item = item_of(leaves);
                let t = meets_segment(ray, item);
                for (var nearer = t > 0.0; nearer; nearer = false) {
                    ray.most = t;
                    hit = vec4u(items[item] & PLACE, bitcast<u32>(t), 0u, 0u);
                }
            }
        }
        if (rays.head.x != 0u) {
            walk = walk_from(rays.head.x);
            while (!walk.over) {
                var leaves = visit(ray, &walk);
                for (; leaves.bits != 0u; leaves.bits &= leaves.bits - 1u) {
                    let first = rays.head.y + 3u * item_of(leaves);
                    let met = meets_triangle(ray, first);
                    for (var nearer = met.x > 0.0; nearer; nearer = false) {
                        ray.most = met.x;
                        hit = vec4u(HIT_HEAD | u32(shapes[first].w), bitcast<vec3u>(met));
                    }
                }
            }
        }
    }
    hits.list[id.x] = hit;
}

// Lists the rays to lights that nothing stands in the way of.
@compute @workgroup_size(64)
fn cast_any(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= queues.shadows.count) {
        return;
    }
    let path = paths[rays.first + id.x];
    let met = trace(ray_from(path.origin, path.direction, path.most, path.clear, path.own), rays.head);
    for (var open = !met.head && met.strands == 0u; open; open = false) {
        let slot = atomicAdd(&hits.open.count, 1u);
        atomicMax(&hits.open.workgroups, slot / 64u + 1u);
        hits.list[rays.all + slot] = vec4u(id.x, 0u, 0u, 0u);
    }
}
