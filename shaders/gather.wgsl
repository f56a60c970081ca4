// Light that visible strand points have from the sky (all lights but narrow ones), from other strands and from the head; and
// the same at places on the head. From each point paths leave along directions that its own fibre draws (fibre_draw.wgsl).
// What escapes sees the sky. Where a path meets the head, the head's radiance counts. Where it meets a strand, one narrow
// light is drawn by its energy, looked for by a ray and taken in closed form, and the path goes on. At the last strand the sky
// is one of the lights that may be drawn, and what comes along the path's next direction from other strands is the field's.
// Narrow lights reach the points themselves in shade.wgsl.
//
//   aim or aim_head → (cast_nearest → meet → cast_any → shine) for each strand → sum → even_out; casts are in cast.wgsl
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
    ordinate_share: f32, // radiance over what the field has along the nearest ordinate
    parts: u32,
    event: u32,         // strands that paths have met
    strands: u32,       // after which the field stands for what comes
    judged: u32,        // strands after which a trial compares the field with what it goes on to find
}

// Twice the same. lavapipe compiles a shader anew, in 10 ms, at each dispatch where a branch looks at a uniform, but for one
// at an index that it cannot foresee.
@group(1) @binding(0) var<uniform> gathers: array<Gather, 2>;
var<private> gather: Gather;
@group(1) @binding(1) var<storage, read> strand_points: array<vec4f>;
@group(1) @binding(2) var<storage, read> strand_ends: array<vec2u>;     // of each point: first and last of its strand
@group(1) @binding(3) var<storage, read_write> paths: array<Path>;
@group(1) @binding(4) var painted: texture_2d<u32>;
@group(1) @binding(5) var<uniform> queues: Queues;
// For `aim` alone, for `aim_head` alone, then for `meet` and `shine`, of which `meet` has as many storage buffers as WebGPU's
// default limits allow.
@group(2) @binding(0) var<storage, read> seen: array<u32>;              // points
@group(2) @binding(6) var<storage, read> head_places: array<HeadPlace>;
@group(2) @binding(1) var<storage, read_write> hits: Hits;
@group(2) @binding(2) var<storage, read> lights: array<Light>;
@group(2) @binding(3) var<storage, read> head_radiance: array<vec4f>;   // corner by corner of the head's triangles
@group(2) @binding(4) var field: texture_3d<f32>;
@group(2) @binding(5) var field_sampler: sampler;
@group(2) @binding(7) var correction: texture_3d<f32>;                 // by what the field is to be multiplied
@group(2) @binding(8) var sky_map: texture_2d<f32>;                    // radiance, and the nearest ordinate

// Texels of an edge of `sky_map`.
const SKY_SIDE = 128.0;

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

// A place on a fibre, and a viewer.
struct Meeting {
    axis_point: vec3f,
    radius: f32,
    frame: FibreFrame,
    own: vec2u,         // first and last point of the strand
    fibre: Fibre,
    theta_o: f32,
    o: vec2f,           // (cos φ_o, sin φ_o)
}

// Of a path with the strand that it has met.
fn meeting(path: Path, hit: vec4u) -> Meeting {
    let place = path.origin + bitcast<f32>(hit.y) * path.direction;
    let a = strand_points[2u * hit.x];
    let b = strand_points[2u * hit.x + 2u];
    let edge = b.xyz - a.xyz;
    let s = clamp(dot(place - a.xyz, edge) / max(dot(edge, edge), 1e-30), 0.0, 1.0);
    let near = hit.x + u32(s > 0.5);
    let u = normalize(mix(strand_points[2u * hit.x + 1u].xyz, strand_points[2u * hit.x + 3u].xyz, s));
    let frame = fibre_frame(u, strand_points[2u * near + 1u].w);
    var fibre = fibre_of(near);
    for (var mode = 0; mode < 3; mode++) {
        // Light that is passed on is not more than came.
        fibre.tint[mode] = min(fibre.tint[mode], vec3f(1.0));
    }
    return Meeting(a.xyz + s * edge, 0.5 * mix(a.w, b.w, s), frame, strand_ends[near], fibre,
        inclination(frame, -path.direction), across(frame, -path.direction));
}

// The path that leaves a fibre along `direction`, on that side of it.
fn leave(there: Meeting, direction: vec3f, most: f32, weight: vec3f, id: u32, draw: vec2u) -> Path {
    let origin = fibre_surface(there.axis_point, there.radius, there.frame.u, direction);
    return Path(origin, most, direction, CLEAR_RADII * there.radius, weight, id, there.own, draw);
}

const FAR = 1e29;

// A point a thread.
@compute @workgroup_size(64)
fn aim(@builtin(global_invocation_id) id: vec3u) {
    gather = gathers[id.z];
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
    var there = Meeting(here.xyz, 0.5 * here.w, frame, own, fibre, theta_o, o);
    let lobes = draw_lobes(fibre, strand.factors, theta_o);
    for (var k = 0u; k < gather.paths; k++) {
        let n = vec2u(own.x, (point - own.x) * gather.paths + k);
        // Up to half a segment to either side.
        let aside = number(n, ALONG) - 0.5;
        let back = (aside < 0.0 && point > own.x) || point == own.y;
        let other = select(min(point + 1u, own.y), max(point, own.x + 1u) - 1u, back);
        there.axis_point = mix(here.xyz, strand_points[2u * other].xyz, abs(aside));
        let drawn = draw(fibre, lobes, theta_o, phi_o, numbers(n, FIRST));
        let direction = direction_at(frame, drawn.theta_i, drawn.phi_i);
        let most = select(0.0, FAR, brightest(drawn.weight) > 0.0);
        let path = id.x * gather.paths + k;
        paths[path] = leave(there, direction, most, drawn.weight, path, n);
    }
}

// A place on the head a thread: directions by their cosine, so that the mean over paths times π is irradiance.
@compute @workgroup_size(64)
fn aim_head(@builtin(global_invocation_id) id: vec3u) {
    gather = gathers[id.z];
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
        let path = id.x * gather.paths + k;
        paths[path] = Path(place.position, FAR, direction, 0.0, vec3f(1.0), path, vec2u(), n);
    }
}

// A path a thread, which goes on and looks for a light that it draws. What is found at once is added to what it found.
@compute @workgroup_size(64)
fn meet(@builtin(global_invocation_id) id: vec3u) {
    gather = gathers[id.z];
    if (id.x >= queues.onward.count) {
        return;
    }
    let all = gather.count * gather.paths;
    let path = paths[(gather.event & 1u) * all + id.x];
    let hit = hits.list[id.x];
    let strand_met = hit.x < HIT_HEAD;
    let first = gather.event == 0u;
    var found = bitcast<vec3f>(hits.list[2u * all + path.id].xyz);
    // What it finds from here on is what the field stands for.
    for (var judged = gather.event == gather.judged; judged; judged = false) {
        hits.list[4u * all + path.id] = vec4u(bitcast<vec3u>(found), KNOWN);
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
        let there = meeting(path, hit);
        let strand = strand_at(there.fibre, there.theta_o);
        let lobes = draw_lobes(there.fibre, strand.factors, there.theta_o);
        let phi_o = atan2_accurate(there.o.y, there.o.x);
        let drawn = draw(there.fibre, lobes, there.theta_o, phi_o, numbers(path.draw, SECOND));
        let direction = direction_at(there.frame, drawn.theta_i, drawn.phi_i);
        let carried = path.weight * drawn.weight;

        // The last strand sees the sky by the ray that others have for narrow lights, and the field for what is beyond.
        let last = gather.event + 1u >= gather.strands;
        var narrow_chance = 0.0;
        for (var some = gather.first_ordinate > 0u; some; some = false) {
            narrow_chance = lights[gather.first_ordinate - 1u].end;
        }
        let among = select(narrow_chance, 1.0, last);
        let index = drawn_light(number(path.draw, LIGHT) * among);
        let light = lights[index];
        let u_lobe = vec2f(number(path.draw, LOBE), number(path.draw, LOBE + 1u));
        var toward = Aim(lobe_direction(light.direction, light.lambda, u_lobe), FAR);
        if LAMPS {
            for (var lamp = index < gather.lamps; lamp; lamp = false) {
                let side = vec3f(light.side[0], light.side[1], light.side[2]);
                toward = lamp_aim(light.direction, light.lambda, side, there.axis_point, u_lobe);
            }
        }
        var lit = path.weight * (among / light.chance);
        for (var wide = index >= gather.first_ordinate; wide; wide = false) {
            toward = Aim(direction, FAR);
            lit = select(vec3f(), carried * sky_along(direction) / max(1.0 - narrow_chance, 1e-20), last);
        }
        let looked_for = among > 0.0 && brightest(lit) > 0.0;
        shadow = leave(there, toward.direction, select(0.0, toward.distance, looked_for), lit, path.id, vec2u(id.x, index));
        let judged = gather.event + 1u == gather.judged;
        for (var beyond = last || judged; beyond; beyond = false) {
            let cell = field_cell(gather.grid, there.axis_point);
            let corrected = textureSampleLevel(correction, field_sampler, cell / gather.grid.dims, 0.0).rgb;
            let tail = carried * gather.ordinate_share * field_at(gather.grid, cell, nearest_ordinate(direction));
            found += select(vec3f(), tail * corrected, last);
            let steps = vec3u(cell * CELL_STEPS);
            foretold = vec4u(bitcast<vec3u>(tail), KNOWN | steps.x | (steps.y << 10u) | (steps.z << 20u));
        }
        // Of what a trial goes on to find, paths that bring little end by chance.
        var kept = 1.0;
        for (var trial = gather.event >= gather.judged; trial; trial = false) {
            kept = min(1.0, brightest(carried) / brightest(path.weight));
        }
        let goes_on = !last && brightest(carried) > 0.0 && number(path.draw, ROULETTE) < kept;
        onward = leave(there, direction, select(0.0, FAR, goes_on), carried / max(kept, 1e-6), path.id, path.draw);
    }
    for (var judged = gather.event + 1u == gather.judged; judged; judged = false) {
        hits.list[3u * all + path.id] = foretold;
    }
    hits.list[2u * all + path.id] = vec4u(bitcast<vec3u>(found), 0u);
    if (onward.most > 0.0) {
        let slot = atomicAdd(&hits.onward.count, 1u);
        atomicMax(&hits.onward.workgroups, slot / 64u + 1u);
        paths[(1u - (gather.event & 1u)) * all + slot] = onward;
    }
    if (shadow.most > 0.0) {
        let slot = atomicAdd(&hits.shadows.count, 1u);
        atomicMax(&hits.shadows.workgroups, slot / 64u + 1u);
        paths[2u * all + slot] = shadow;
    }
}

// What an open ray to a light brings, a ray a thread. It comes after the rays, since nine of ten end at a strand.
@compute @workgroup_size(64)
fn shine(@builtin(global_invocation_id) id: vec3u) {
    gather = gathers[id.z];
    if (id.x >= queues.open.count) {
        return;
    }
    let all = gather.count * gather.paths;
    let ray = paths[2u * all + hits.list[all + id.x].x];
    var found = bitcast<vec3f>(hits.list[2u * all + ray.id].xyz);
    var share = vec3f(1.0);
    for (var narrow = ray.draw.y < gather.first_ordinate; narrow; narrow = false) {
        let there = meeting(paths[(gather.event & 1u) * all + ray.draw.x], hits.list[ray.draw.x]);
        var light = lights[ray.draw.y];
        if LAMPS {
            for (var lamp = ray.draw.y < gather.lamps; lamp; lamp = false) {
                light = lamp_from(light, there.axis_point);
            }
        }
        let o = there.o;
        let d = across(there.frame, light.direction);
        let strand = strand_at(there.fibre, there.theta_o);
        exponent_max = EXPONENT_MAX;
        let m = single_scattering(there.fibre, there.theta_o, inclination(there.frame, light.direction),
            atan2_accurate(o.y * d.x - o.x * d.y, dot(o, d)), o.x * d.x - o.y * d.y, light.lambda);
        share = light.rgb * sum_of(strand.factors, m);
    }
    found += ray.weight * share;
    hits.list[2u * all + ray.id] = vec4u(bitcast<vec3u>(found), 0u);
}

// Marks what a path has written of the field.
const KNOWN = 0x80000000u;
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

// Where the octahedral map of the sky has a direction, in texels. Twin: src/gpu/sky_map.rs, where it is made.
fn sky_place(direction: vec3f) -> vec2f {
    let n = direction / (abs(direction.x) + abs(direction.y) + abs(direction.z));
    let folded = (1.0 - abs(n.zx)) * select(vec2f(-1.0), vec2f(1.0), n.xz >= vec2f());
    return 0.5 * SKY_SIDE * (select(n.xz, folded, n.y < 0.0) + 1.0);
}

// Radiance of the sky.
fn sky_along(direction: vec3f) -> vec3f {
    let place = clamp(sky_place(direction) - 0.5, vec2f(), vec2f(SKY_SIDE - 1.0));
    let first = vec2u(min(place, vec2f(SKY_SIDE - 2.0)));
    let f = place - vec2f(first);
    return mix(
        mix(textureLoad(sky_map, first, 0).rgb, textureLoad(sky_map, first + vec2u(1u, 0u), 0).rgb, f.x),
        mix(textureLoad(sky_map, first + vec2u(0u, 1u), 0).rgb, textureLoad(sky_map, first + vec2u(1u), 0).rgb, f.x),
        f.y);
}

// The ordinate, among ordinates, that is nearest to a direction.
fn nearest_ordinate(direction: vec3f) -> u32 {
    let texel = min(vec2u(sky_place(direction)), vec2u(u32(SKY_SIDE) - 1u));
    return u32(textureLoad(sky_map, texel, 0).w);
}
