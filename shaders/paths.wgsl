// Rays between strands, one slot each, as gather.wgsl aims them and cast.wgsl follows them.
// Layout: src/gpu/uniforms.rs.

struct Path {
    origin: vec3f,
    most: f32,          // nothing beyond counts; 0 of a slot without a ray
    direction: vec3f,   // unit
    clear: f32,         // path over which the points own.x to own.y are missed
    weight: vec3f,      // by what the radiance that the ray finds is multiplied, RGB
    pad: u32,
    own: vec2u,         // first and last point of the strand that the ray leaves
    draw: vec2u,        // the sequence of the path's numbers, and its place there
}

// What a ray met, in four words: the first point of a segment, or a triangle of the head with HIT_HEAD, or HIT_NOTHING;
// the path to it, f32; the weights of the triangle's second and third corner, f32.
const HIT_NOTHING = 0xffffffffu;
const HIT_HEAD = 0x80000000u;
