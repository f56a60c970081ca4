// The camera of one pass. Positions are relative to the groom's centre, so that f32 holds at any offset.

struct View {
    clip_from_pos: mat4x4f,     // reversed z, infinite far plane; this pass's jitter included
    eye: vec3f,
    pieces: u32,                // straight pieces drawn for each segment of a strand
    right: vec3f,               // half the image's width at unit distance
    background: u32,            // ENVIRONMENT, COLOR or TRANSPARENT
    up: vec3f,                  // half the image's height at unit distance
    environment_rotation_rad: f32,
    forward: vec3f,
    environment_scale: f32,
    background_rgb: vec3f,
    share: f32,                 // 1 / passes
    size: vec2u,                // pixels
    grid: u32,                  // the visibility buffer has grid × grid texels a pixel
    widened: f32,               // strands are drawn so many times wider than they are
}

const ENVIRONMENT = 0u;
const COLOR = 1u;
const TRANSPARENT = 2u;

// What a sample of the visibility buffer sees. Texels: id low 16 bits, id high 14 bits and kind << 14,
// then two fractions of 65535: (along the segment, unused) or barycentrics of the 2nd and 3rd corner.
const NOTHING = 0u;
const HAIR = 1u;
const HEAD = 2u;

struct Seen {
    kind: u32,
    id: u32,            // HAIR: the segment's first point; HEAD: the triangle
    fraction: vec2f,
}

fn encode_seen(kind: u32, id: u32, fraction: vec2f) -> vec4u {
    let f = vec2u(round(clamp(fraction, vec2f(0.0), vec2f(1.0)) * 65535.0));
    return vec4u(id & 0xffffu, (id >> 16u) | (kind << 14u), f);
}

fn decode_seen(texel: vec4u) -> Seen {
    return Seen(texel.y >> 14u, texel.x | ((texel.y & 0x3fffu) << 16u), vec2f(texel.zw) / 65535.0);
}
