//! Where a head goes: under the roots of the hair.
//!
//! A file says neither its unit nor its axes. The likely ones are tried, and those hold with which the roots lie on the
//! surface.

use super::builtin::{builtin_head, head_distance, head_normal, scalp_depth};
use super::{Head, Up};
use crate::hair::median_distance;
use glam::{DMat4, DVec4, Vec3, Vec3A};
use obvhs::bvh2::{Bvh2, builder::build_bvh2_from_tris};
use obvhs::{BvhBuildParams, triangle::Triangle};
use rayon::prelude::*;

/// Units that files of one scene have of each other: equal, centimetres and metres, inches, decimetres, millimetres.
const UNITS: [f32; 9] = [1.0, 0.01, 100.0, 0.0254, 39.37, 0.1, 10.0, 0.001, 1000.0];
/// Roots that a fit looks at, at most.
const ROOTS: usize = 600;
/// A root lies on a surface that is no farther than this share of the roots' median distance from their middle: 8 mm on a
/// person.
const NEAR: f32 = 0.1;
/// Another unit or axis than the hair's own holds where at least this share of the roots lies on the head.
const FITS: f64 = 0.5;
/// By so much the share must be larger for another unit or axis than the hair's own, and for an axis beside the unit: a ball
/// fits by any.
const BETTER: f64 = 0.1;

/// From a head's own frame to the world: turned by `up`, multiplied by `scale`, then moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    pub up: Up,
    pub scale: f32,
    pub offset: Vec3,
}

impl Default for Placement {
    fn default() -> Self {
        Self { up: Up::Y, scale: 1.0, offset: Vec3::ZERO }
    }
}

impl Placement {
    pub fn to_world(&self, p: Vec3) -> Vec3 {
        self.scale * self.up.to_world(p) + self.offset
    }

    fn to_own(self, p: Vec3) -> Vec3 {
        self.up.from_world((p - self.offset) / self.scale)
    }
}

impl Head {
    /// Puts the head into the world.
    pub fn place(&mut self, placement: &Placement) {
        self.positions.iter_mut().for_each(|p| *p = placement.to_world(*p));
        self.normals.iter_mut().for_each(|n| *n = placement.up.to_world(*n));
    }
}

/// What a scene says of a head's place; None is to be found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wanted {
    pub up: Option<Up>,
    pub scale: Option<f32>,
    pub offset: Option<Vec3>,
}

/// A place for a head, and the share (0 to 1) of the roots that lie on its surface there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    pub placement: Placement,
    pub share: f64,
}

/// So many of the roots that they stand for all, and how near to a surface each has to lie.
fn sample(roots: &[Vec3]) -> (Vec<Vec3>, f32) {
    let (_, distance) = median_distance(roots.iter().copied());
    let stride = roots.len().div_ceil(ROOTS).max(1);
    (roots.iter().step_by(stride).copied().collect(), NEAR * distance)
}

/// A head's triangles, to be asked for what is near.
pub struct Surface {
    triangles: Vec<Triangle>,
    bvh: Bvh2,
}

impl Surface {
    pub fn new(head: &Head) -> Surface {
        let corner = |v: u32| Vec3A::from(head.positions[v as usize]);
        let triangle =
            |t: &[u32; 3]| Triangle { v0: corner(t[0]), v1: corner(t[1]), v2: corner(t[2]) };
        let triangles: Vec<Triangle> = head.triangles.iter().map(triangle).collect();
        let params = BvhBuildParams::fast_build();
        let bvh = build_bvh2_from_tris(&triangles, params, &mut Default::default());
        let triangles = bvh.primitive_indices.iter().map(|&i| triangles[i as usize]).collect();
        Surface { triangles, bvh }
    }

    /// Whether a triangle is no farther than `reach` from `p`.
    fn is_near(&self, p: Vec3, reach: f32) -> bool {
        let (p, reach2) = (Vec3A::from(p), reach * reach);
        let mut waiting = vec![0u32];
        while let Some(node) = waiting.pop().and_then(|at| self.bvh.nodes.get(at as usize)) {
            let aabb = node.aabb();
            if p.distance_squared(p.clamp(aabb.min, aabb.max)) > reach2 {
                continue;
            }
            let first = node.first_index;
            if node.prim_count == 0 {
                waiting.extend([first, first + 1]);
            } else {
                let own = &self.triangles[first as usize..(first + node.prim_count) as usize];
                if own.iter().any(|t| p.distance_squared(closest(t, p)) <= reach2) {
                    return true;
                }
            }
        }
        false
    }

    fn share(&self, roots: &[Vec3], near: f32, placement: &Placement) -> f64 {
        let on = |root: &&Vec3| self.is_near(placement.to_own(**root), near / placement.scale);
        roots.iter().filter(on).count() as f64 / roots.len().max(1) as f64
    }

    /// The place where most of the roots (world) lie on the surface, among likely units and axes of the head's file.
    /// `own` is where the transform of the hair puts it; it holds where no other is clearly better.
    pub fn fit(&self, roots: &[Vec3], own: &Placement, wanted: &Wanted) -> Fit {
        let (roots, near) = sample(roots);
        let scales = match wanted.scale {
            Some(scale) => vec![scale],
            None => UNITS.iter().map(|unit| unit * own.scale).collect(),
        };
        let ups = match wanted.up {
            Some(up) => vec![up],
            None => std::iter::once(own.up)
                .chain(Up::ALL.into_iter().filter(|&up| up != own.up))
                .collect(),
        };
        let offset = wanted.offset.unwrap_or(own.offset);
        let places: Vec<Placement> = ups
            .iter()
            .flat_map(|&up| scales.iter().map(move |&scale| Placement { up, scale, offset }))
            .collect();
        let shares: Vec<f64> =
            places.par_iter().map(|place| self.share(&roots, near, place)).collect();
        let mut best = 0;
        for (i, share) in shares.iter().enumerate() {
            let (one, other) = (&places[best], &places[i]);
            let more = if best == 0 || one.up != other.up { BETTER } else { 0.0 };
            if *share > shares[best] + more && *share >= FITS {
                best = i;
            }
        }
        Fit { placement: places[best], share: shares[best] }
    }
}

/// The point of a triangle that is closest to `p` (Ericson 2005, "Real-Time Collision Detection", 5.1.5).
fn closest(triangle: &Triangle, p: Vec3A) -> Vec3A {
    let Triangle { v0: a, v1: b, v2: c } = *triangle;
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    let (along, back) = (d4 - d3, d5 - d6);
    if va <= 0.0 && along >= 0.0 && back >= 0.0 {
        return b + (c - b) * (along / (along + back));
    }
    let whole = (va + vb + vc).recip();
    a + ab * (vb * whole) + ac * (vc * whole)
}

/// Steps of the fit of the builtin head at most; it ends with one that moves no skin by more than [`SETTLED`] (metres).
const STEPS: usize = 40;
const SETTLED: f32 = 1e-4;
/// Metres on the builtin head: a root farther away than this counts less.
const CLEAR: f32 = 0.01;
/// Metres: a root that is no farther away lies on the builtin head, which is no one's own.
const ROUGHLY: f32 = 0.02;
/// Roots beneath the skin count so many times as much as roots above it, since they hide hair.
const BENEATH: f32 = 3.0;
/// As strongly as roots 1 cm off the skin pull, the fit is held by a scale that is so much (in logarithm), and a place
/// that is so far (metres), from the first guess, by the spread of the roots.
const HELD_SCALE: f32 = 0.4;
const HELD_PLACE: f32 = 0.04;

/// The place of the builtin head under the roots (world): least squares of their distances to its skin, over scale and
/// offset.
pub fn fit_builtin(roots: &[Vec3], wanted: &Wanted) -> Fit {
    let up = wanted.up.unwrap_or_default();
    let (roots, _) = sample(roots);
    let roots: Vec<Vec3> = roots.into_iter().map(|p| up.from_world(p)).collect();
    let scalp = builtin_head().positions.into_iter().filter(|&p| scalp_depth(p) > 0.0);
    let scalp: Vec<Vec3> = scalp.collect();
    let (scalp_middle, scalp_distance) = median_distance(scalp.iter().copied());
    let (middle, distance) = median_distance(roots.iter().copied());
    let first = wanted.scale.unwrap_or(distance / scalp_distance).max(f32::MIN_POSITIVE);
    let mut scale = first;
    let mut offset = match wanted.offset {
        Some(offset) => up.from_world(offset),
        None => middle - scale * scalp_middle,
    };
    for _ in 0..STEPS {
        // Of the unknowns: change of the offset over the scale, change of the scale's logarithm.
        let (mut matrix, mut sum) = (DMat4::ZERO, DVec4::ZERO);
        let mut add = |row: DVec4, value: f64, weight: f64| {
            matrix += DMat4::from_cols(row * row.x, row * row.y, row * row.z, row * row.w) * weight;
            sum += weight * value * row;
        };
        for &root in &roots {
            let p = (root - offset) / scale;
            let (d, n) = (head_distance(p), head_normal(p));
            let side = if d < 0.0 { BENEATH } else { 1.0 };
            let weight = side / (d.abs() / CLEAR).max(1.0);
            add(n.extend(n.dot(p)).as_dvec4(), d.into(), weight.into());
        }
        let count = roots.len() as f64;
        let off = (middle - offset) / scale - scalp_middle;
        let held = |held: f32| count * f64::from((CLEAR / held).powi(2));
        for axis in 0..3 {
            add(DVec4::AXES[axis], off[axis].into(), held(HELD_PLACE));
        }
        add(DVec4::W, -f64::from((scale / first).ln()), held(HELD_SCALE));
        // What is said does not move.
        let free = |k: usize| if k < 3 { wanted.offset.is_none() } else { wanted.scale.is_none() };
        for k in (0..4).filter(|&k| !free(k)) {
            add(DVec4::AXES[k], 0.0, 1e12 * count);
        }
        let step = (matrix.inverse() * sum).as_vec4();
        if !step.is_finite() {
            break;
        }
        if wanted.offset.is_none() {
            offset += scale * step.truncate();
        }
        if wanted.scale.is_none() {
            scale *= step.w.clamp(-0.2, 0.2).exp();
        }
        if step.abs().max_element() < SETTLED {
            break;
        }
    }
    let near = |root: &&Vec3| head_distance((**root - offset) / scale).abs() <= ROUGHLY;
    let share = roots.iter().filter(near).count() as f64 / roots.len().max(1) as f64;
    let offset = wanted.offset.unwrap_or(up.to_world(offset));
    Fit { placement: Placement { up, scale, offset }, share }
}
