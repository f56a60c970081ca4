// From what each sample sees to radiance: strands and head by interpolation of what was shaded at their
// points, averaged over passes in f32, then the background in what they leave free.

// What a scene lacks costs nothing: set when the pipeline is made.
override WITH_HEAD: bool = true;

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var visibility: texture_multisampled_2d<u32>;
@group(0) @binding(2) var<storage, read> radiance: array<vec4f>;        // at strand points
@group(0) @binding(3) var<storage, read> head_radiance: array<vec4f>;   // at head vertices, then at points of detail
@group(0) @binding(4) var<storage, read> head_corners: array<u32>;
@group(0) @binding(5) var environment: texture_2d<f32>;                 // lat-long, rgba32float
@group(0) @binding(6) var<storage, read_write> sum: array<vec4f>;       // premultiplied RGB and alpha
@group(0) @binding(7) var<storage, read_write> hair_sum: array<f32>;    // coverage by hair
@group(0) @binding(8) var<storage, read> detail: Detail;

// A triangular lattice of points in those triangles of the head where shadows begin and end (src/head/detail.rs).
struct Detail {
    across: u32,            // steps along an edge; 0 where no triangle has a lattice
    vertices: u32,          // its points come after these
    words: array<u32>,      // of each triangle: 0, or where in this list its points begin, row by row from the first edge
}

// What is rare stands in loops that run once: SIMD code on a CPU skips a loop that no lane enters, but walks
// through both sides of every `if`.

@compute @workgroup_size(8, 8)
fn resolve(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= view.size)) {
        return;
    }
    var color = vec3f(0.0);
    var covered = 0.0;
    var hair = 0.0;
    let texels = view.grid * view.grid;
    for (var i = 0u; i < 4u * texels; i++) {
        let texel = view.grid * id.xy + vec2u((i / 4u) % view.grid, i / 4u / view.grid);
        let seen = decode_seen(textureLoad(visibility, texel, i32(i % 4u)));
        for (var once = seen.kind == HAIR; once; once = false) {
            color += mix(radiance[seen.id].rgb, radiance[seen.id + 1u].rgb, seen.fraction.x);
            covered += 1.0;
            hair += 1.0;
        }
        for (var once = WITH_HEAD && seen.kind == HEAD; once; once = false) {
            var f = seen.fraction;
            let corner = 3u * seen.id;
            var at = vec3u(head_corners[corner], head_corners[corner + 1u], head_corners[corner + 2u]);
            var first = 0u;
            for (var some = detail.across > 0u; some; some = false) {
                first = detail.words[seen.id];
            }
            for (var fine = first > 0u; fine; fine = false) {
                let cell = cell_of(f);
                f = cell.fraction;
                for (var k = 0; k < 3; k++) {
                    at[k] = detail.vertices + detail.words[first + cell.points[k]];
                }
            }
            color += (1.0 - f.x - f.y) * head_radiance[at.x].rgb + f.x * head_radiance[at.y].rgb
                + f.y * head_radiance[at.z].rgb;
            covered += 1.0;
        }
    }
    let pixel = id.y * view.size.x + id.x;
    let share = view.share / f32(4u * texels);
    sum[pixel] += share * vec4f(color, covered);
    hair_sum[pixel] += share * hair;
}

struct Cell {
    points: vec3u,
    fraction: vec2f,        // barycentrics of the 2nd and 3rd
}

// The small triangle of a lattice that holds a place of these barycentrics.
fn cell_of(barycentrics: vec2f) -> Cell {
    let n = detail.across;
    let place = f32(n) * barycentrics;
    let j = min(u32(place.y), n - 1u);
    let i = min(u32(place.x), n - 1u - j);
    let f = place - vec2f(f32(i), f32(j));
    let row = j * (n + 1u) - j * (j - min(j, 1u)) / 2u + i;
    let above = row + n + 1u - j;
    // The last of a row has no neighbour that is turned over.
    if (f.x + f.y <= 1.0 || i + j + 1u >= n) {
        return Cell(vec3u(row, row + 1u, above), f);
    }
    return Cell(vec3u(above + 1u, above, row + 1u), 1.0 - f);
}

// After the last pass: the background in what strands and head leave free.
@compute @workgroup_size(8, 8)
fn backdrop(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= view.size)) {
        return;
    }
    let pixel = id.y * view.size.x + id.x;
    let front = sum[pixel];
    for (var once = front.a < 1.0 && view.background != TRANSPARENT; once; once = false) {
        var behind = view.background_rgb;
        for (var map = view.background == ENVIRONMENT; map; map = false) {
            let ndc = (vec2f(id.xy) + 0.5) / vec2f(view.size) * 2.0 - 1.0;
            behind = view.environment_scale
                * environment_radiance(view.forward + ndc.x * view.right - ndc.y * view.up);
        }
        sum[pixel] = vec4f(front.rgb + (1.0 - front.a) * behind, 1.0);
    }
}

// The map along a world direction: u = 0.5 + atan2(x, −z)/2π, v = arccos(y)/π, by a cubic B-spline, which
// has no negative lobes and hides the texels of a map that the lens magnifies.
fn environment_radiance(world: vec3f) -> vec3f {
    let c = cos(view.environment_rotation_rad);
    let s = sin(view.environment_rotation_rad);
    let d = normalize(vec3f(c * world.x - s * world.z, world.y, s * world.x + c * world.z));
    let size = vec2f(textureDimensions(environment));
    let horizontal = length(d.xz);
    let uv = vec2f(
        0.5 + select(0.0, atan2(d.x, -d.z), horizontal > 1e-7) / 6.2831853,
        select(f32(d.y < 0.0), atan2(horizontal, d.y) / 3.1415927, horizontal > 1e-7),
    );
    let at = uv * size - 0.5;
    let base = floor(at);
    let wx = b_spline(at.x - base.x);
    let wy = b_spline(at.y - base.y);
    var total = vec3f(0.0);
    let width = i32(size.x);
    for (var j = 0; j < 4; j++) {
        let y = clamp(i32(base.y) + j - 1, 0, i32(size.y) - 1);
        var row = vec3f(0.0);
        for (var i = 0; i < 4; i++) {
            let x = (i32(base.x) + i - 1 + 2 * width) % width;
            row += wx[i] * textureLoad(environment, vec2i(x, y), 0).rgb;
        }
        total += wy[j] * row;
    }
    return total;
}

fn b_spline(t: f32) -> vec4f {
    let r = 1.0 - t;
    return vec4f(
        r * r * r,
        4.0 + 3.0 * t * t * (t - 2.0),
        4.0 + 3.0 * r * r * (r - 2.0),
        t * t * t,
    ) / 6.0;
}
