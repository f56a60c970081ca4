// Rays against strands and head under one hierarchy. Layout: src/bvh.rs and src/transport/occlusion.rs; twin of what
// counts as met: src/reference/tracer/strands.rs, one piece a segment.

struct Node {
    corner_steps: vec4u,    // f32 corner; exponents of steps, and bits of the children that are nodes
    first_x: vec4u,         // first node, first item; lower sides along x
    x_y: vec4u,             // upper sides along x; lower sides along y
    y_z: vec4u,
    z_order: vec4u,         // upper sides along z; the axis that children follow, and their number times 4
}

@group(0) @binding(0) var<storage, read> bvh: array<Node>;
@group(0) @binding(1) var<storage, read> items: array<u32>;
@group(0) @binding(2) var<storage, read> strand_points: array<vec4f>;   // position, diameter; tangent, twist
@group(0) @binding(3) var<storage, read> shapes: array<vec4f>;          // item by item: two ends with radii, or three corners

// An item of strands: the first point of a segment, and whether the strand begins or ends with it; of the head: a triangle.
const PLACE = 0x3fffffffu;
const ROOT = 0x40000000u;
const TIP = 0x80000000u;

struct Ray {
    origin: vec3f,
    direction: vec3f,   // unit
    inverse: vec3f,     // of the direction
    most: f32,          // nothing beyond counts
    clear: f32,         // path over which the points own.x to own.y are missed
    own: vec2u,
}

// A ray on its way through a tree.
struct Walk {
    // A node's first child that is one, and bits: children to be visited, all that are nodes, the axis they follow.
    now: vec2u,
    top: u32,
    over: bool,
    stack: array<vec2u, 32>,
}

// Items whose boxes a ray enters.
struct Leaves {
    bits: u32,          // of a node's children
    items: u32,         // of its children that are items
    first: u32,
}

// What a ray meets.
struct Met {
    strands: u32,
    behind: u32,        // strands on the other side of its origin
    head: bool,
}

// Whether to count all strands, on both sides, and not just to find whether anything is met.
override COUNT_STRANDS: bool = false;

fn ray_from(origin: vec3f, direction: vec3f, most: f32, clear: f32, own: vec2u) -> Ray {
    // No axis is quite at a right angle, so that nothing is 0 times infinity.
    let steep = select(direction, vec3f(1e-12), abs(direction) < vec3f(1e-12));
    return Ray(origin, direction, 1.0 / steep, most, clear, own);
}

// From a fibre about `axis_point` along unit `u`, on the side that `direction` leaves by.
fn ray_leaving(axis_point: vec3f, radius: f32, u: vec3f, own: vec2u, direction: vec3f, most: f32) -> Ray {
    let origin = fibre_surface(axis_point, radius, u, direction);
    return ray_from(origin, direction, most, CLEAR_RADII * radius, own);
}

// Before the root of a tree, as if it were a lone child.
fn walk_from(root: u32) -> Walk {
    var walk: Walk;
    walk.now = vec2u(root, 0x101u);
    return walk;
}

// Visits one node.
fn visit(ray: Ray, walk: ptr<function, Walk>) -> Leaves {
    var now = (*walk).now;
    // Nearer children first.
    let waiting = now.y & 255u;
    let slot = select(firstTrailingBit(waiting), firstLeadingBit(waiting), ray.direction[now.y >> 16u] < 0.0);
    let at = now.x + countOneBits(((now.y >> 8u) & 255u) & ((1u << slot) - 1u));
    now.y &= ~(1u << slot);
    (*walk).stack[(*walk).top] = now;
    var top = select((*walk).top, (*walk).top + 1u, (now.y & 255u) != 0u);
    let node = bvh[at];
    let steps = bitcast<vec3f>(((vec3u(node.corner_steps.w) >> vec3u(0u, 8u, 16u)) & vec3u(255u)) << vec3u(23u));
    let scale = ray.inverse * steps;
    let shift = (bitcast<vec3f>(node.corner_steps.xyz) - ray.origin) * ray.inverse;
    let nodes = node.corner_steps.w >> 24u;
    let low = array(vec3u(node.first_x.z, node.x_y.z, node.y_z.z), vec3u(node.first_x.w, node.x_y.w, node.y_z.w));
    let high = array(vec3u(node.x_y.x, node.y_z.x, node.z_order.x), vec3u(node.x_y.y, node.y_z.y, node.z_order.y));
    let back = ray.inverse < vec3f();
    var met = four_enter(select(low[0], high[0], back), select(high[0], low[0], back), scale, shift, ray.most);
    met |= four_enter(select(low[1], high[1], back), select(high[1], low[1], back), scale, shift, ray.most) << 4u;
    met &= (1u << (node.z_order.z >> 2u)) - 1u;
    now = vec2u(node.first_x.x, (met & nodes) | (nodes << 8u) | ((node.z_order.z & 3u) << 16u));
    let end = (now.y & 255u) == 0u;
    (*walk).over = end && top == 0u;
    top = select(top, max(top, 1u) - 1u, end);
    (*walk).now = select(now, (*walk).stack[top], end);
    (*walk).top = top;
    return Leaves(met & ~nodes, ~nodes, node.first_x.y);
}

// The first of the leaves, among items.
fn item_of(leaves: Leaves) -> u32 {
    let before = (leaves.bits & (0u - leaves.bits)) - 1u;
    return leaves.first + countOneBits(before & leaves.items);
}

// `head`: the root of the head's tree, and the first of its shapes; 0 without one. Strands come first: the more there are, the fewer rays are left.
fn trace(ray: Ray, head: vec2u) -> Met {
    var met = Met(0u, 0u, false);
    var walk = walk_from(0u);
    while (!walk.over) {
        var leaves = visit(ray, &walk);
        for (; leaves.bits != 0u; leaves.bits &= leaves.bits - 1u) {
            let t = meets_segment(ray, item_of(leaves));
            met.strands += u32(t > 0.0);
            met.behind += u32(t < 0.0);
            if (!COUNT_STRANDS && t > 0.0) {
                return met;
            }
        }
    }
    met.head = meets_head(ray, head);
    return met;
}

fn meets_head(ray: Ray, head: vec2u) -> bool {
    if (head.x == 0u) {
        return false;
    }
    var walk = walk_from(head.x);
    while (!walk.over) {
        var leaves = visit(ray, &walk);
        for (; leaves.bits != 0u; leaves.bits &= leaves.bits - 1u) {
            if (meets_triangle(ray, head.y + 3u * item_of(leaves)).x > 0.0) {
                return true;
            }
        }
    }
    return false;
}

// Of four children of a node, a byte each of their nearer sides along x, y and z and of their farther ones: bits of those
// that the ray enters.
fn four_enter(nearer: vec3u, farther: vec3u, scale: vec3f, shift: vec3f, most: f32) -> u32 {
    let near = greater(greater(bytes_of(nearer.x) * scale.x + shift.x, bytes_of(nearer.y) * scale.y + shift.y),
        greater(bytes_of(nearer.z) * scale.z + shift.z, vec4f(select(0.0, -1e30, COUNT_STRANDS))));
    let far = lesser(lesser(bytes_of(farther.x) * scale.x + shift.x, bytes_of(farther.y) * scale.y + shift.y),
        lesser(bytes_of(farther.z) * scale.z + shift.z, vec4f(most)));
    let enters = select(vec4u(), vec4u(1u, 2u, 4u, 8u), near <= far);
    return enters.x | enters.y | enters.z | enters.w;
}

// By way of signed numbers, which CPUs convert at once.
fn bytes_of(word: u32) -> vec4f {
    return vec4f(vec4i((vec4u(word) >> vec4u(0u, 8u, 16u, 24u)) & vec4u(255u)));
}

// In place of `max` and `min`, which look for NaN.
fn greater(a: vec4f, b: vec4f) -> vec4f {
    return select(b, a, a > b);
}

fn lesser(a: vec4f, b: vec4f) -> vec4f {
    return select(b, a, a < b);
}

// The path to where a ray enters a segment, negative where that is on the other side of its origin; 0 of a miss.
fn meets_segment(ray: Ray, item: u32) -> f32 {
    let a = shapes[2u * item];
    let b = shapes[2u * item + 1u];
    let offset = a.xyz - ray.origin;
    let edge = b.xyz - a.xyz;
    let along = dot(offset, ray.direction);
    let edge_along = dot(edge, ray.direction);
    // Across the ray, the ray is a point and the axis a shorter edge.
    let aside = offset - along * ray.direction;
    let slant = edge - edge_along * ray.direction;
    let slant2 = max(dot(slant, slant), 1e-30);
    let unbound = -dot(aside, slant) / slant2;
    let s = clamp(unbound, 0.0, 1.0);
    let radius = mix(a.w, b.w, s);
    let miss = aside + s * slant;
    let inside2 = radius * radius - dot(miss, miss);
    var met = 0.0;
    for (var near = inside2 > 0.0; near; near = false) {
        let inside = sqrt(inside2);
        // Along the cylinder, but within the piece however small the angle between ray and axis.
        let deep = select(inside, min(inside * sqrt(1.0 + edge_along * edge_along / slant2), inside + abs(edge_along)),
            s == unbound);
        let t = along + s * edge_along - deep;
        let place = items[item];
        let point = place & PLACE;
        let own = abs(t) < ray.clear && point >= ray.own.x && point < ray.own.y;
        // At root and tip a strand is cut flat.
        let cut = (s < unbound && (place & TIP) != 0u) || (s > unbound && (place & ROOT) != 0u);
        // Of two pieces that meet, the later one has the joint.
        let twice = COUNT_STRANDS && s < unbound;
        met = select(0.0, t, !own && !cut && !twice && t < ray.most);
    }
    return met;
}

// The path to a triangle, 0 of a miss, and the weights of its second and third corner there. Möller and Trumbore 1997; from
// either side.
fn meets_triangle(ray: Ray, first: u32) -> vec3f {
    let corner = shapes[first].xyz;
    let p = shapes[first + 1u].xyz - corner;
    let q = shapes[first + 2u].xyz - corner;
    let across = cross(ray.direction, q);
    let scale = 1.0 / dot(p, across);
    let offset = ray.origin - corner;
    let u = scale * dot(offset, across);
    let side = cross(offset, p);
    let v = scale * dot(ray.direction, side);
    let t = scale * dot(q, side);
    return select(vec3f(), vec3f(t, u, v), u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t < ray.most);
}
