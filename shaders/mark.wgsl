// Collects the strand points that any sample needs, each once, so that only those are shaded, and counts the samples that
// see each triangle of the head.

struct Needed {
    count: atomic<u32>,
    shaded: u32,            // how many of them are shaded
    points: array<u32>,
}

@group(0) @binding(0) var visibility: texture_multisampled_2d<u32>;
@group(0) @binding(1) var<storage, read_write> marks: array<atomic<u32>>;   // 1 once a point is listed
@group(0) @binding(2) var<storage, read_write> needed: Needed;
@group(0) @binding(3) var<storage, read_write> head_seen: array<atomic<u32>>;

fn mark_point(point: u32) {
    if (atomicLoad(&marks[point]) == 0u && atomicExchange(&marks[point], 1u) == 0u) {
        needed.points[atomicAdd(&needed.count, 1u)] = point;
    }
}

@compute @workgroup_size(8, 8)
fn mark(@builtin(global_invocation_id) pixel: vec3u) {
    let size = textureDimensions(visibility);
    if (any(pixel.xy >= size)) {
        return;
    }
    for (var i = 0; i < 4; i++) {
        let seen = decode_seen(textureLoad(visibility, pixel.xy, i));
        if (seen.kind == HAIR) {
            mark_point(seen.id);
            mark_point(seen.id + 1u);
        }
        if (seen.kind == HEAD) {
            atomicAdd(&head_seen[seen.id], 1u);
        }
    }
}
