// Follows rays between strands. Twin: StrandRays::cast_nearest and cast_any of src/reference/transmittance.rs.

struct Cast {
    count: u32,
    pad: u32,
    head: vec2u,        // root of the head's tree, and first of its shapes; 0 without one
}

@group(0) @binding(4) var<storage, read> paths: array<Path>;
@group(0) @binding(5) var<storage, read_write> hits: array<vec4u>;
@group(0) @binding(6) var<uniform> rays: Cast;

// What each ray meets first.
@compute @workgroup_size(64)
fn cast_nearest(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= rays.count) {
        return;
    }
    let path = paths[id.x];
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
    hits[id.x] = hit;
}

// Adds what the rays of second slots bring, where nothing stands in their way, to the first words of their hits.
@compute @workgroup_size(64)
fn cast_any(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= rays.count) {
        return;
    }
    let place = rays.count + id.x;
    let path = paths[place];
    for (var there = path.most > 0.0; there; there = false) {
        let met = trace(ray_from(path.origin, path.direction, path.most, path.clear, path.own), rays.head);
        let open = !met.head && met.strands == 0u;
        let found = bitcast<vec4f>(hits[place]) + vec4f(select(vec3f(), path.weight, open), 0.0);
        hits[place] = bitcast<vec4u>(found);
    }
}
