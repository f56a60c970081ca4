// Visibility: which strand or triangle each sample sees, and where on it.
//
// A segment of a strand is a camera-facing ribbon along the cubic Hermite curve through its two points, with
// the tangents its neighbours share, so ribbons join without gaps. Ribbons keep their true width, however
// thin: over the samples of a pixel (4 a pass, jittered from pass to pass) a strand covers its share, and
// depth orders strands sample by sample.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> strand_points: array<vec4f>;   // position, diameter; tangent, twist
@group(0) @binding(2) var<storage, read> segments: array<u32>;          // first point of each segment, last of each run

struct Vertex {
    @builtin(position) clip: vec4f,
    @location(0) @interpolate(flat) id: u32,    // the segment's first point; of an odd one the fraction runs back
    @location(1) fraction: vec2f,
}

// Left and right of the curve in turn, at the start of each piece; the end of a segment is the start of the next, which
// follows it in the list, or of a segment that is not drawn, where a strand ends. Indices join them: one indexed draw is
// four times as fast as an instance a segment on lavapipe.
@vertex
fn hair_vertex(@builtin(vertex_index) index: u32) -> Vertex {
    let entry = index / (2u * view.pieces);
    let piece = index / 2u % view.pieces;
    let first = segments[entry];
    let a = strand_points[2u * first];
    let b = strand_points[2u * first + 2u];
    let chord = distance(a.xyz, b.xyz);
    let tangent_a = chord * strand_points[2u * first + 1u].xyz;
    let tangent_b = chord * strand_points[2u * first + 3u].xyz;
    let s = f32(piece) / f32(view.pieces);
    let r = 1.0 - s;
    let center = r * r * (1.0 + 2.0 * s) * a.xyz + s * r * r * tangent_a
        + s * s * (3.0 - 2.0 * s) * b.xyz - s * s * r * tangent_b;
    let slope = 6.0 * s * r * (b.xyz - a.xyz)
        + r * (1.0 - 3.0 * s) * tangent_a + s * (3.0 * s - 2.0) * tangent_b;
    // What follows the last point of a strand is not its own.
    let along = select(slope, strand_points[2u * first + 1u].xyz, piece == 0u);
    let across = cross(along, view.eye - center);
    // Seen end on, a strand has no width to speak of; any side will do.
    let side = across / max(length(across), 1e-30);
    let half_width = 0.5 * view.widened * mix(a.w, b.w, s);
    let offset = select(-half_width, half_width, (index & 1u) == 1u);
    // Back and forth, since a vertex is the end of one segment and the start of the next.
    return Vertex(
        view.clip_from_pos * vec4f(center + offset * side, 1.0),
        first,
        vec2f(select(s, r, (first & 1u) == 1u), 0.0),
    );
}

@fragment
fn hair_fragment(in: Vertex) -> @location(0) vec4u {
    let s = select(in.fraction.x, 1.0 - in.fraction.x, (in.id & 1u) == 1u);
    return encode_seen(HAIR, in.id, vec2f(s, 0.0));
}

@group(0) @binding(3) var<storage, read> head_positions: array<vec4f>;
@group(0) @binding(4) var<storage, read> head_corners: array<u32>;

// Barycentrics of a place within the triangle, at its edge too: beyond it they would be less than 0.
struct HeadVertex {
    @builtin(position) clip: vec4f,
    @location(0) @interpolate(flat) id: u32,
    @location(1) @interpolate(perspective, centroid) fraction: vec2f,
}

@vertex
fn head_vertex(@builtin(vertex_index) vertex: u32) -> HeadVertex {
    let corner = vertex % 3u;
    let clip = view.clip_from_pos * vec4f(head_positions[head_corners[vertex]].xyz, 1.0);
    return HeadVertex(clip, vertex / 3u, vec2f(f32(corner == 1u), f32(corner == 2u)));
}

@fragment
fn head_fragment(in: HeadVertex) -> @location(0) vec4u {
    return encode_seen(HEAD, in.id, in.fraction);
}
