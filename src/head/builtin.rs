//! The builtin head: a sculpted mannequin with neck and shoulders, made from a signed distance
//! function.
//!
//! The surface is the zero set of a smooth union of ellipsoids and round cones (polynomial smooth
//! minimum), so that the same function shapes the mesh, tells hair where skin is, and gives exact
//! normals. It is meshed by naive surface nets (Gibson 1998) over a grid that is fine at the face
//! and coarse at the shoulders; vertices are then moved onto the zero set by Newton steps.
//!
//! Frame: metres, y up, the face looks along +z. The head spans y = −0.115 (chin) to 0.115 (crown),
//! the eyes are at y ≈ 0, the bust ends at y = −0.33. It is symmetric in x.

use super::Head;
use glam::{Vec3, vec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Lower and upper corner of a box that holds the whole builtin head, in metres.
pub const HEAD_BOUNDS: [Vec3; 2] = [vec3(-0.23, -0.345, -0.15), vec3(0.23, 0.13, 0.13)];

/// The hairline: height in metres of the lower edge of the scalp at azimuths from the face (0°) by
/// way of the temple (40°), sideburn (78°) and ear (95°) to the nape (180°).
const HAIRLINE: [[f32; 2]; 14] = [
    [0.0, 0.070],
    [20.0, 0.073],
    [36.0, 0.077],
    [48.0, 0.066],
    [58.0, 0.040],
    [68.0, 0.008],
    [76.0, -0.012],
    [84.0, 0.010],
    [92.0, 0.027],
    [103.0, 0.020],
    [113.0, -0.020],
    [126.0, -0.062],
    [150.0, -0.080],
    [180.0, -0.084],
];

/// Signed distance in metres from `p` to the builtin head, negative inside.
///
/// A bound rather than the exact distance: ellipsoids and smooth unions bend it by up to some 20 %
/// away from the surface; its sign and zero set are exact.
pub fn head_distance(p: Vec3) -> f32 {
    let m = vec3(p.x.abs(), p.y, p.z);
    let body = smooth_union(bare_head(m), bust(m), 0.035);
    smooth_union(body, ear(m), 0.006)
}

/// Unit normal of the builtin head's distance at `p`, outward, by central differences.
pub fn head_normal(p: Vec3) -> Vec3 {
    gradient(p).normalize_or(Vec3::Y)
}

/// How far in metres, measured upward, a point of the surface lies within the scalp; negative
/// outside it.
pub fn scalp_depth(p: Vec3) -> f32 {
    let azimuth = p.x.abs().atan2(p.z + 0.015).to_degrees();
    let after = HAIRLINE.partition_point(|k| k[0] < azimuth).clamp(1, HAIRLINE.len() - 1);
    let ([a0, y0], [a1, y1]) = (HAIRLINE[after - 1], HAIRLINE[after]);
    let t = ((azimuth - a0) / (a1 - a0)).clamp(0.0, 1.0);
    let above_hairline = p.y - (y0 + (y1 - y0) * t * t * (3.0 - 2.0 * t));
    above_hairline.min(ear(vec3(p.x.abs(), p.y, p.z)) - 0.004)
}

/// The builtin head as a closed mesh of some 20,000 triangles, counter-clockwise seen from outside.
pub fn builtin_head() -> Head {
    let [low, high] = HEAD_BOUNDS;
    let axes = [
        graded_axis(low.x, high.x, |x| match x.abs() {
            ..0.045 => 0.0034,
            ..0.098 => 0.0046,
            _ => 0.014,
        }),
        graded_axis(low.y, high.y, |y| match y {
            ..-0.125 => 0.013,
            ..0.035 => 0.0034,
            _ => 0.0075,
        }),
        graded_axis(low.z, high.z, |z| match z {
            ..-0.045 => 0.0080,
            ..0.055 => 0.0050,
            _ => 0.0030,
        }),
    ];
    let mut head = surface_nets(&axes);
    head.positions.par_iter_mut().for_each(|p| *p = project(*p));
    head.normals = head.positions.par_iter().map(|&p| head_normal(p)).collect();
    head
}

/// Skull, face and neck without ears; `m` has x ≥ 0.
fn bare_head(m: Vec3) -> f32 {
    let cranium = ellipsoid(m, vec3(0.0, 0.029, -0.018), vec3(0.0765, 0.0865, 0.096));
    let face = ellipsoid(m, vec3(0.0, -0.022, 0.030), vec3(0.060, 0.082, 0.0585));
    let forehead = ellipsoid(m, vec3(0.0, 0.044, 0.020), vec3(0.061, 0.052, 0.0595));
    let mut d = smooth_union(smooth_union(cranium, forehead, 0.025), face, 0.035);

    let jaw = cone(m, [0.043, -0.056, 0.004], 0.013, [0.008, -0.096, 0.066], 0.012);
    d = smooth_union(d, jaw, 0.028);
    let chin = ellipsoid(m, vec3(0.0, -0.098, 0.075), vec3(0.014, 0.014, 0.0155));
    d = smooth_union(d, chin, 0.018);
    let cheekbone = ellipsoid(m, vec3(0.041, -0.023, 0.053), vec3(0.019, 0.014, 0.021));
    d = smooth_union(d, cheekbone, 0.028);
    let cheek = ellipsoid(m, vec3(0.029, -0.054, 0.040), vec3(0.023, 0.028, 0.030));
    d = smooth_union(d, cheek, 0.03);
    let muzzle = ellipsoid(m, vec3(0.0, -0.064, 0.064), vec3(0.029, 0.030, 0.0245));
    d = smooth_union(d, muzzle, 0.025);

    let socket = ellipsoid(m, vec3(0.030, 0.001, 0.102), vec3(0.021, 0.012, 0.018));
    d = smooth_difference(d, socket, 0.022);
    let brow_y = 0.020 - 6.0 * (m.x - 0.028).powi(2);
    let brow = cone(m - Vec3::Y * brow_y, [0.010, 0.0, 0.0805], 0.005, [0.046, 0.0, 0.0615], 0.004);
    d = smooth_union(d, brow, 0.020);
    d = smooth_union(d, closed_eye(m), 0.006);
    d = smooth_union(d, nose(m), 0.008);
    d = lips(d, m);

    let neck = cone(m, [0.0, -0.055, -0.028], 0.047, [0.0, -0.22, -0.046], 0.051);
    let mastoid = cone(m, [0.049, -0.060, -0.030], 0.009, [0.014, -0.222, 0.000], 0.010);
    smooth_union(d, smooth_union(neck, mastoid, 0.022), 0.025)
}

/// A lowered eyelid over the eyeball, with the lid's edge as a shallow step.
fn closed_eye(m: Vec3) -> f32 {
    let ball = ellipsoid(m, vec3(0.0305, -0.001, 0.0700), vec3(0.0160, 0.0115, 0.0130));
    let edge_y = -0.0060 + 18.0 * (m.x - 0.0305).powi(2);
    let upper_lid = ((m.y - edge_y) / 0.0045).clamp(0.0, 1.0);
    ball - 0.0008 * upper_lid * upper_lid * (3.0 - 2.0 * upper_lid)
}

fn nose(m: Vec3) -> f32 {
    let bridge = cone(m, [0.0, 0.016, 0.0790], 0.0060, [0.0, -0.034, 0.1000], 0.0078);
    let tip = ellipsoid(m, vec3(0.0, -0.0365, 0.1025), vec3(0.0092, 0.0084, 0.0098));
    let wing = ellipsoid(m, vec3(0.0112, -0.0400, 0.0925), vec3(0.0057, 0.0062, 0.0100));
    let root = ellipsoid(m, vec3(0.0, -0.034, 0.082), vec3(0.0120, 0.014, 0.016));
    let whole = smooth_union(smooth_union(bridge, tip, 0.010), wing, 0.006);
    smooth_union(whole, root, 0.008)
}

/// Two rolls; the line of the mouth is the seam between them.
fn lips(d: f32, m: Vec3) -> f32 {
    let bow = 0.0015 * (1.0 - (m.x / 0.007).powi(2)).max(0.0);
    let upper =
        cone(m + Vec3::Y * bow, [0.0, -0.0660, 0.0912], 0.0042, [0.0215, -0.0705, 0.0842], 0.0014);
    let lower = cone(m, [0.0, -0.0752, 0.0897], 0.0052, [0.0205, -0.0714, 0.0842], 0.0014);
    let both = smooth_union(upper, lower, 0.0025);
    smooth_union(d, both, 0.0065)
}

fn ear(m: Vec3) -> f32 {
    // Leaning back at the top and standing off the skull at the rear.
    let q = m - vec3(0.0750, -0.014, -0.018);
    let (lean_sin, lean_cos) = 0.20_f32.sin_cos();
    let q = vec3(q.x, lean_cos * q.y - lean_sin * q.z, lean_sin * q.y + lean_cos * q.z);
    let (flare_sin, flare_cos) = 0.42_f32.sin_cos();
    let q = vec3(flare_cos * q.x + flare_sin * q.z, q.y, flare_cos * q.z - flare_sin * q.x);
    let narrowing = 1.0 + 9.0 * (-q.y).max(0.0);
    let q = vec3(q.x, q.y, q.z * narrowing);
    let shell = ellipsoid(q, Vec3::ZERO, vec3(0.0085, 0.0315, 0.0190));
    let hollow = ellipsoid(q, vec3(0.0105, 0.002, 0.0025), vec3(0.0082, 0.0225, 0.0120));
    smooth_difference(shell, hollow, 0.006) * 0.8
}

fn bust(m: Vec3) -> f32 {
    let trapezius = cone(m, [0.0, -0.150, -0.058], 0.034, [0.135, -0.232, -0.045], 0.030);
    let chest = ellipsoid(m, vec3(0.0, -0.315, -0.030), vec3(0.165, 0.100, 0.082));
    let shoulder = ellipsoid(m, vec3(0.158, -0.268, -0.042), vec3(0.046, 0.058, 0.050));
    let collarbone = cone(m, [0.014, -0.232, 0.014], 0.008, [0.140, -0.226, -0.022], 0.006);
    let d = smooth_union(chest, trapezius, 0.05);
    let d = smooth_union(smooth_union(d, shoulder, 0.05), collarbone, 0.022);
    smooth_difference(d, m.y + 0.33, 0.012)
}

/// Distance bound of an ellipsoid with the given centre and radii.
fn ellipsoid(p: Vec3, center: Vec3, radii: Vec3) -> f32 {
    let q = (p - center) / radii;
    let k = q.length();
    let slope = (q / radii).length();
    if slope < 1e-9 { -radii.min_element() } else { k * (k - 1.0) / slope }
}

/// Distance of a cone with round ends: radius `ra` at `a`, `rb` at `b` (linear between).
fn cone(p: Vec3, a: [f32; 3], ra: f32, b: [f32; 3], rb: f32) -> f32 {
    let (a, b) = (Vec3::from(a), Vec3::from(b));
    let axis = b - a;
    let t = ((p - a).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
    (p - a - axis * t).length() - (ra + (rb - ra) * t)
}

/// Union whose seam is rounded over a width `k` (quadratic polynomial smooth minimum).
fn smooth_union(a: f32, b: f32, k: f32) -> f32 {
    let h = (k - (a - b).abs()).max(0.0);
    a.min(b) - h * h / (4.0 * k)
}

/// `a` without `b`, its edge rounded over a width `k`.
fn smooth_difference(a: f32, b: f32, k: f32) -> f32 {
    -smooth_union(-a, b, k)
}

fn gradient(p: Vec3) -> Vec3 {
    const STEP: f32 = 4e-4;
    let slope = |axis: Vec3| head_distance(p + axis * STEP) - head_distance(p - axis * STEP);
    vec3(slope(Vec3::X), slope(Vec3::Y), slope(Vec3::Z)) / (2.0 * STEP)
}

/// Moves a point near the surface onto it.
fn project(mut p: Vec3) -> Vec3 {
    for _ in 0..3 {
        let g = gradient(p);
        p -= g * (head_distance(p) / g.length_squared().max(0.1));
    }
    p
}

fn graded_axis(low: f32, high: f32, spacing: impl Fn(f32) -> f32) -> Vec<f32> {
    let mut axis = vec![low];
    let mut at = low;
    while at < high {
        at += spacing(at);
        axis.push(at);
    }
    axis
}

/// Signed distances at the corners of a grid, x fastest: exact within a cell of the surface; farther out the sign alone is.
fn distances(axes: &[Vec<f32>; 3]) -> Vec<f32> {
    const BLOCK: usize = 4;
    let n = [axes[0].len(), axes[1].len(), axes[2].len()];
    let widest = axes.iter().flat_map(|axis| axis.windows(2).map(|w| w[1] - w[0]));
    let margin = 3f32.sqrt() * widest.fold(0.0, f32::max);
    let of_layer = |block: usize| {
        let z = block * BLOCK..n[2].min((block + 1) * BLOCK);
        let mut layer = vec![0.0; n[0] * n[1] * z.len()];
        for y0 in (0..n[1]).step_by(BLOCK) {
            for x0 in (0..n[0]).step_by(BLOCK) {
                let (x, y) = (x0..n[0].min(x0 + BLOCK), y0..n[1].min(y0 + BLOCK));
                let at = |x: usize, y: usize, z: usize| vec3(axes[0][x], axes[1][y], axes[2][z]);
                let ends = [at(x.start, y.start, z.start), at(x.end - 1, y.end - 1, z.end - 1)];
                let middle = 0.5 * (ends[0] + ends[1]);
                let far = head_distance(middle);
                // The distance is bent by a fifth at most; half leaves room.
                let is_far = far.abs() > 1.5 * (ends[0].distance(middle) + margin);
                for z in z.clone() {
                    for y in y.clone() {
                        for x in x.clone() {
                            let place = ((z - block * BLOCK) * n[1] + y) * n[0] + x;
                            layer[place] = if is_far { far } else { head_distance(at(x, y, z)) };
                        }
                    }
                }
            }
        }
        layer
    };
    (0..n[2].div_ceil(BLOCK)).into_par_iter().flat_map_iter(of_layer).collect()
}

/// Naive surface nets over a grid of given coordinates: one vertex for each cell that the surface
/// crosses, one quad for each grid edge that it crosses. Normals are left empty.
fn surface_nets(axes: &[Vec<f32>; 3]) -> Head {
    let n = [axes[0].len(), axes[1].len(), axes[2].len()];
    let index = |c: [usize; 3]| (c[2] * n[1] + c[1]) * n[0] + c[0];
    let corner = |c: [usize; 3]| vec3(axes[0][c[0]], axes[1][c[1]], axes[2][c[2]]);
    let coords = |i: usize| [i % n[0], i / n[0] % n[1], i / (n[0] * n[1])];
    let distance = distances(axes);

    let mut head = Head::default();
    let mut vertex_of = HashMap::new();
    for i in 0..distance.len() {
        let c = coords(i);
        if (0..3).any(|k| c[k] + 1 == n[k]) {
            continue;
        }
        let (mut sum, mut crossings) = (Vec3::ZERO, 0.0);
        for (from, axis) in CELL_EDGES {
            let a = [c[0] + from[0], c[1] + from[1], c[2] + from[2]];
            let mut b = a;
            b[axis] += 1;
            let (da, db) = (distance[index(a)], distance[index(b)]);
            if (da < 0.0) != (db < 0.0) {
                sum += corner(a).lerp(corner(b), da / (da - db));
                crossings += 1.0;
            }
        }
        if crossings > 0.0 {
            vertex_of.insert(i, head.positions.len() as u32);
            head.positions.push(sum / crossings);
        }
    }

    for i in 0..distance.len() {
        let c = coords(i);
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            if c[axis] + 1 == n[axis] || c[u] == 0 || c[v] == 0 {
                continue;
            }
            let mut next = c;
            next[axis] += 1;
            let inside = distance[i] < 0.0;
            if inside == (distance[index(next)] < 0.0) {
                continue;
            }
            let cell = |du: usize, dv: usize| {
                let mut around = c;
                around[u] -= du;
                around[v] -= dv;
                vertex_of.get(&index(around)).copied()
            };
            // A crossed edge of an outermost cell has no four neighbours; the bounds leave room for
            // none.
            let (Some(a), Some(b), Some(c), Some(d)) =
                (cell(1, 1), cell(0, 1), cell(0, 0), cell(1, 0))
            else {
                continue;
            };
            let quad = if inside { [a, b, c, d] } else { [a, d, c, b] };
            head.triangles.push([quad[0], quad[1], quad[2]]);
            head.triangles.push([quad[0], quad[2], quad[3]]);
        }
    }
    head
}

/// The twelve edges of a cell: lower corner and axis.
const CELL_EDGES: [([usize; 3], usize); 12] = [
    ([0, 0, 0], 0),
    ([0, 1, 0], 0),
    ([0, 0, 1], 0),
    ([0, 1, 1], 0),
    ([0, 0, 0], 1),
    ([1, 0, 0], 1),
    ([0, 0, 1], 1),
    ([1, 0, 1], 1),
    ([0, 0, 0], 2),
    ([1, 0, 0], 2),
    ([0, 1, 0], 2),
    ([1, 1, 0], 2),
];
