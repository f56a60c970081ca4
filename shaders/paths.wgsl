// Rays between strands, one slot each, as gather.wgsl aims them and cast.wgsl follows them.
// Layout: src/gpu/uniforms.rs.

struct Path {
    origin: vec3f,
    most: f32,          // nothing beyond counts; 0 of a slot without a ray
    direction: vec3f,   // unit
    clear: f32,         // path over which the points own.x to own.y are missed
    weight: vec3f,      // by what the radiance that the ray finds is multiplied, RGB
    id: u32,            // place among paths that are followed together
    own: vec2u,         // first and last point of the strand that the ray leaves
    draw: vec2u,        // the sequence of the path's numbers, and its place there
}

// Of `all` paths that are followed together, those that go on from a strand lie in the first third of the list, after the next
// in the second, and so on in turn; rays to the lights that they draw lie in the last third, and their numbers are the
// path's place in its third, and the light's.

// Things of a list, as a dispatch has them.
struct Queue {
    workgroups: vec3u,  // of a thread for each
    count: u32,
}

struct Queues {
    onward: Queue,      // paths that go on
    shadows: Queue,     // rays to the lights that they draw
    open: Queue,        // those of them that nothing stands in the way of
}

// A queue that grows.
struct Growing {
    workgroups: atomic<u32>,
    one_y: u32,
    one_z: u32,
    count: atomic<u32>,
}

// `list` has `all` entries of each kind: what the rays of paths that go on have met; which rays to lights are open; by id, of
// all paths, what they found, RGB; and two more of those that judge the field.
struct Hits {
    onward: Growing,
    shadows: Growing,
    open: Growing,
    list: array<vec4u>,
}

// What a ray met, in four words: the first point of a segment, or a triangle of the head with HIT_HEAD, or HIT_NOTHING;
// the path to it, f32; the weights of the triangle's second and third corner, f32.
const HIT_NOTHING = 0xffffffffu;
const HIT_HEAD = 0x80000000u;
