// Light that visible strand points have from the sky (all lights but narrow ones), from other strands and from the head; and
// the same at places on the head. From each point paths leave along directions that its own fibre draws (fibre_draw.wgsl).
// What escapes sees the sky. Where a path meets the head, the head's radiance counts. Where it meets a strand, one narrow
// light is drawn by its energy, taken in closed form and looked for by a ray, and the path goes on. At the last strand the sky
// is one of the lights that may be drawn, and what comes along the path's next direction from other strands is the field's.
// Narrow lights reach the points themselves in shade.wgsl.
//
//   aim or aim_head → (cast_nearest → meet → cast_any) for each strand → sum → even_out; casts are in cast.wgsl
//
// Numbers are a lattice that is fixed to the strand and continues from point to point, so that frames of another view have
// the same noise and neighbours even it out.

// A place on the head that paths leave.
struct HeadPlace {
    position: vec3f,
    seed: u32,
    normal: vec3f,
    pad: u32,
}

struct Gather {
    eye: vec3f,
    paths: u32,         // of a point
    grid: FieldGrid,
    first: u32,         // of `seen`, in this batch
    count: u32,
    lights: u32,
    lamps: u32,
    first_ordinate: u32,
    ordinates: u32,
    ordinate_share: f32, // radiance over what the field has along the nearest ordinate
    parts: u32,
    sky: u32,           // lights that come after the others, to be seen together
    event: u32,         // strands that paths have met
    strands: u32,       // after which the field stands for what comes
    judged: u32,        // strands after which a trial compares the field with what it goes on to find
}

@group(1) @binding(0) var<uniform> gather: Gather;
@group(1) @binding(1) var<storage, read> strand_points: array<vec4f>;
@group(1) @binding(2) var<storage, read> strand_ends: array<vec2u>;     // of each point: first and last of its strand
@group(1) @binding(3) var<storage, read_write> paths: array<Path>;
@group(1) @binding(4) var painted: texture_2d<u32>;
// For `aim` alone, for `aim_head` alone, then for `meet` alone, which has as many storage buffers as WebGPU's default limits
// allow.
@group(2) @binding(0) var<storage, read> seen: array<u32>;              // points
@group(2) @binding(6) var<storage, read> head_places: array<HeadPlace>;
@group(2) @binding(1) var<storage, read_write> hits: array<vec4u>;
@group(2) @binding(2) var<storage, read> lights: array<Light>;
@group(2) @binding(3) var<storage, read> head_radiance: array<vec4f>;   // corner by corner of the head's triangles
@group(2) @binding(4) var field: texture_3d<f32>;
@group(2) @binding(5) var field_sampler: sampler;
@group(2) @binding(7) var correction: texture_3d<f32>;                 // by what the field is to be multiplied

// Fractions of 2³² by which the numbers of a strand go on: for the place and the first direction the roots of x⁶ = x + 1
// (Roberts 2018), then of square roots of primes.
const STEPS = array<u32, 13>(3785032106u, 3335640776u, 2939605022u, 2590590015u, 2283013049u, 1779033703u, 3144134277u,
    1013904242u, 2773480762u, 1359893119u, 2600822924u, 528734635u, 1541459225u);
const ALONG = 0u;
const FIRST = 1u;
const LIGHT = 5u;
const LOBE = 6u;
const SECOND = 8u;
const ROULETTE = 12u;

// Number `d` of a path, in [0, 1). `draw`: a sequence, such as a strand's, and a place there. Past the first strand numbers are
// random.
fn number(draw: vec2u, d: u32) -> f32 {
    let salt = 0x9e3779b9u * (d + 1u);
    var bits = hashed(draw.x ^ salt) + draw.y * STEPS[d];
    if (gather.event > 0u) {
        bits = hashed(hashed(draw.x ^ salt ^ (0x85ebca6bu * gather.event)) + draw.y);
    }
    return f32(bits >> 8u) * 5.9604645e-8;
}

fn numbers(draw: vec2u, d: u32) -> vec4f {
    return vec4f(number(draw, d), number(draw, d + 1u), number(draw, d + 2u), number(draw, d + 3u));
}

// The path that leaves a fibre along `direction`, on that side of it.
fn leave(axis_point: vec3f, radius: f32, u: vec3f, own: vec2u, direction: vec3f, most: f32, weight: vec3f, draw: vec2u) -> Path {
    let origin = fibre_surface(axis_point, radius, u, direction);
    return Path(origin, most, direction, CLEAR_RADII * radius, weight, 0u, own, draw);
}

const FAR = 1e29;

// A point a thread.
@compute @workgroup_size(64)
fn aim(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= gather.count) {
        return;
    }
    let point = seen[gather.first + id.x];
    let own = strand_ends[point];
    let here = strand_points[2u * point];
    let turn = strand_points[2u * point + 1u];
    let frame = fibre_frame(turn.xyz, turn.w);
    let to_eye = normalize(gather.eye - here.xyz);
    let theta_o = inclination(frame, to_eye);
    let o = across(frame, to_eye);
    let phi_o = atan2_accurate(o.y, o.x);
    let fibre = fibre_of(point);
    let strand = strand_at(fibre, theta_o);
    let lobes = draw_lobes(fibre, strand.factors, theta_o);
    for (var k = 0u; k < gather.paths; k++) {
        let n = vec2u(own.x, (point - own.x) * gather.paths + k);
        // Up to half a segment to either side.
        let aside = number(n, ALONG) - 0.5;
        let back = (aside < 0.0 && point > own.x) || point == own.y;
        let other = select(min(point + 1u, own.y), max(point, own.x + 1u) - 1u, back);
        let place = mix(here.xyz, strand_points[2u * other].xyz, abs(aside));
        let drawn = draw(fibre, lobes, theta_o, phi_o, numbers(n, FIRST));
        let direction = direction_at(frame, drawn.theta_i, drawn.phi_i);
        let most = select(0.0, FAR, brightest(drawn.weight) > 0.0);
        paths[id.x * gather.paths + k] = leave(place, 0.5 * here.w, turn.xyz, own, direction, most, drawn.weight, n);
    }
}

// A place on the head a thread: directions by their cosine, so that the mean over paths times π is irradiance.
@compute @workgroup_size(64)
fn aim_head(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= gather.count) {
        return;
    }
    let place = head_places[gather.first + id.x];
    let x = any_normal(place.normal);
    let y = cross(place.normal, x);
    for (var k = 0u; k < gather.paths; k++) {
        let n = vec2u(place.seed, k);
        let u = numbers(n, FIRST);
        let out = sqrt(u.x);
        let direction = normalize(out * (cos(TWO_PI * u.y) * x + sin(TWO_PI * u.y) * y) + sqrt(1.0 - u.x) * place.normal);
        paths[id.x * gather.paths + k] = Path(place.position, FAR, direction, 0.0, vec3f(1.0), 0u, vec2u(), n);
    }
}

// A path a thread. Each has two slots: of the ray that goes on, and of the ray to the light that was drawn, with what it
// would bring. What is found at once is added to the second slot's hit.
@compute @workgroup_size(64)
fn meet(@builtin(global_invocation_id) id: vec3u) {
    let all = gather.count * gather.paths;
    if (id.x >= all) {
        return;
    }
    let path = paths[id.x];
    let hit = hits[id.x];
    let strand_met = hit.x < HIT_HEAD;
    let first = gather.event == 0u;
    var found = vec3f();
    if (!first) {
        found = bitcast<vec3f>(hits[all + id.x].xyz);
    }
    // What it finds from here on is what the field stands for.
    for (var judged = gather.event == gather.judged; judged; judged = false) {
        hits[3u * all + id.x] = vec4u(bitcast<vec3u>(found), 0u);
    }
    var foretold = vec4u();
    var shadow = path;
    shadow.most = 0.0;
    var onward = shadow;
    let single = (gather.parts & SINGLE) != 0u;
    let multiple = (gather.parts & (GLOBAL | LOCAL)) != 0u;
    let alive = path.most > 0.0;
    for (var open = alive && hit.x == HIT_NOTHING && select(multiple, single, first) && gather.event != gather.judged; open; open = false) {
        found += path.weight * sky_along(path.direction);
    }
    for (var skin = alive && multiple && !strand_met && hit.x != HIT_NOTHING; skin; skin = false) {
        let corner = 3u * (hit.x & ~HIT_HEAD);
        let f = bitcast<vec2f>(hit.zw);
        found += path.weight * ((1.0 - f.x - f.y) * head_radiance[corner].rgb + f.x * head_radiance[corner + 1u].rgb
            + f.y * head_radiance[corner + 2u].rgb);
    }
    for (var met = alive && multiple && strand_met; met; met = false) {
        let place = path.origin + bitcast<f32>(hit.y) * path.direction;
        let a = strand_points[2u * hit.x];
        let b = strand_points[2u * hit.x + 2u];
        let edge = b.xyz - a.xyz;
        let s = clamp(dot(place - a.xyz, edge) / max(dot(edge, edge), 1e-30), 0.0, 1.0);
        let near = hit.x + u32(s > 0.5);
        let axis_point = a.xyz + s * edge;
        let radius = 0.5 * mix(a.w, b.w, s);
        let u = normalize(mix(strand_points[2u * hit.x + 1u].xyz, strand_points[2u * hit.x + 3u].xyz, s));
        let frame = fibre_frame(u, strand_points[2u * near + 1u].w);
        let own = strand_ends[near];
        var fibre = fibre_of(near);
        for (var mode = 0; mode < 3; mode++) {
            // Light that is passed on is not more than came.
            fibre.tint[mode] = min(fibre.tint[mode], vec3f(1.0));
        }
        let theta_o = inclination(frame, -path.direction);
        let o = across(frame, -path.direction);
        let strand = strand_at(fibre, theta_o);
        let lobes = draw_lobes(fibre, strand.factors, theta_o);
        let drawn = draw(fibre, lobes, theta_o, atan2_accurate(o.y, o.x), numbers(path.draw, SECOND));
        let direction = direction_at(frame, drawn.theta_i, drawn.phi_i);
        let carried = path.weight * drawn.weight;

        // The last strand sees the sky by the ray that others have for narrow lights, and the field for what is beyond.
        let last = gather.event + 1u >= gather.strands;
        var narrow_chance = 0.0;
        for (var some = gather.first_ordinate > 0u; some; some = false) {
            narrow_chance = lights[gather.first_ordinate - 1u].end;
        }
        let among = select(narrow_chance, 1.0, last);
        let index = drawn_light(number(path.draw, LIGHT) * among);
        var light = lights[index];
        let u_lobe = vec2f(number(path.draw, LOBE), number(path.draw, LOBE + 1u));
        var toward = Aim(lobe_direction(light.direction, light.lambda, u_lobe), FAR);
        if LAMPS {
            for (var lamp = index < gather.lamps; lamp; lamp = false) {
                toward = lamp_aim(light.direction, light.lambda, vec3f(light.side[0], light.side[1], light.side[2]), axis_point,
                    u_lobe);
                light = lamp_from(light, axis_point);
            }
        }
        var lit = vec3f();
        for (var narrow = index < gather.first_ordinate && among > 0.0; narrow; narrow = false) {
            let d = across(frame, light.direction);
            exponent_max = EXPONENT_MAX;
            let m = single_scattering(fibre, theta_o, inclination(frame, light.direction),
                atan2_accurate(o.y * d.x - o.x * d.y, dot(o, d)), o.x * d.x - o.y * d.y, light.lambda);
            lit = path.weight * light.rgb * sum_of(strand.factors, m) * (among / light.chance);
        }
        for (var wide = last && index >= gather.first_ordinate; wide; wide = false) {
            toward = Aim(direction, FAR);
            lit = carried * sky_along(direction) / max(1.0 - narrow_chance, 1e-20);
        }
        shadow = leave(axis_point, radius, u, own, toward.direction, select(0.0, toward.distance, brightest(lit) > 0.0), lit,
            path.draw);
        let judged = gather.event + 1u == gather.judged;
        for (var beyond = last || judged; beyond; beyond = false) {
            let cell = field_cell(gather.grid, axis_point);
            let corrected = textureSampleLevel(correction, field_sampler, cell / gather.grid.dims, 0.0).rgb;
            let tail = carried * gather.ordinate_share * field_at(gather.grid, cell, nearest_ordinate(direction));
            found += select(vec3f(), tail * corrected, last);
            let steps = vec3u(cell * CELL_STEPS);
            foretold = vec4u(bitcast<vec3u>(tail), steps.x | (steps.y << 10u) | (steps.z << 20u));
        }
        // Of what a trial goes on to find, paths that bring little end by chance.
        var kept = 1.0;
        for (var trial = gather.event >= gather.judged; trial; trial = false) {
            kept = min(1.0, brightest(carried) / brightest(path.weight));
        }
        let goes_on = !last && brightest(carried) > 0.0 && number(path.draw, ROULETTE) < kept;
        onward = leave(axis_point, radius, u, own, direction, select(0.0, FAR, goes_on), carried / max(kept, 1e-6), path.draw);
    }
    for (var judged = gather.event + 1u == gather.judged; judged; judged = false) {
        hits[2u * all + id.x] = foretold;
    }
    paths[id.x] = onward;
    paths[all + id.x] = shadow;
    hits[all + id.x] = vec4u(bitcast<vec3u>(found), 0u);
}

// Parts of a cell in which a place is told: of 32 cells as 10 bits.
const CELL_STEPS = 32.0;

fn brightest(rgb: vec3f) -> f32 {
    return max(rgb.x, max(rgb.y, rgb.z));
}

// The place of a light, by its chance.
fn drawn_light(u: f32) -> u32 {
    var low = 0u;
    var high = gather.lights - 1u;
    while (low < high) {
        let middle = (low + high) / 2u;
        let above = u >= lights[middle].end;
        low = select(low, middle + 1u, above);
        high = select(middle, high, above);
    }
    return low;
}

// Radiance of the sky.
fn sky_along(direction: vec3f) -> vec3f {
    var sky = vec3f();
    for (var i = gather.lights; i < gather.lights + gather.sky; i++) {
        let light = lights[i];
        let apart = direction - light.direction;
        sky += light.rgb * exp(-dot(apart, apart) / (light.lambda * light.lambda));
    }
    return sky;
}

// The ordinate, among ordinates, that is nearest to a direction.
fn nearest_ordinate(direction: vec3f) -> u32 {
    var best = 0u;
    var most = -2.0;
    for (var i = 0u; i < gather.ordinates; i++) {
        let cosine = dot(direction, lights[gather.first_ordinate + i].direction);
        best = select(best, i, cosine > most);
        most = max(most, cosine);
    }
    return best;
}
