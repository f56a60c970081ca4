//! Exact transmittance: rays cast through the real strands, to measure what `reach` approximates.

use glam::{Vec3, Vec3A};
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::{BvhBuildParams, aabb::Aabb, cwbvh::CwBvh, ray::Ray, triangle::Triangle};
use rayon::prelude::*;

use super::Reach;
use crate::hair::Hair;
use crate::head::Head;
use crate::srbf::{SrbfLight, sample_lobe};

/// Strands as capsules, and the head's triangles, each under a BVH.
pub struct RealStrands<'a> {
    hair: &'a Hair,
    /// Diameter at each point, world units.
    diameters: &'a [f32],
    /// First point of each segment.
    segments: Vec<u32>,
    strands: CwBvh,
    triangles: Vec<Triangle>,
    head: Option<CwBvh>,
}

impl<'a> RealStrands<'a> {
    pub fn new(hair: &'a Hair, diameters: &'a [f32], head: Option<&Head>) -> Self {
        let segments: Vec<u32> = hair
            .offsets
            .windows(2)
            .flat_map(|pair| pair[0]..pair[1].saturating_sub(1).max(pair[0]))
            .collect();
        let boxes: Vec<Aabb> = segments
            .iter()
            .map(|&s| {
                let s = s as usize;
                let (a, b) = (Vec3A::from(hair.points[s]), Vec3A::from(hair.points[s + 1]));
                let r = 0.5 * diameters[s].max(diameters[s + 1]);
                Aabb { min: a.min(b) - r, max: a.max(b) + r }
            })
            .collect();
        let triangles: Vec<Triangle> = head.map_or(Vec::new(), |head| {
            let corner = |i: u32| Vec3A::from(head.positions[i as usize]);
            let triangle =
                |t: &[u32; 3]| Triangle { v0: corner(t[0]), v1: corner(t[1]), v2: corner(t[2]) };
            head.triangles.iter().map(triangle).collect()
        });
        let build = BvhBuildParams::fast_build;
        let mut time = Default::default();
        let strands = build_cwbvh(&boxes, build(), &mut time);
        let head = (!triangles.is_empty()).then(|| build_cwbvh(&triangles, build(), &mut time));
        RealStrands { hair, diameters, segments, strands, triangles, head }
    }

    /// Whether a ray from `origin` that belongs to strand point `own` reaches the sky.
    fn escapes(&self, own: usize, origin: Vec3, omega: Vec3) -> bool {
        let ray = Ray::new_inf(origin.into(), omega.into());
        let clear = self.strands.ray_traverse_miss(ray, |_, id| {
            let s = self.segments[self.strands.primitive_indices[id] as usize] as usize;
            // A fibre does not block its own light: that is the scattering function's part.
            if s.abs_diff(own) <= 1 {
                return f32::INFINITY;
            }
            let radius = 0.25 * (self.diameters[s] + self.diameters[s + 1]);
            let gap =
                ray_segment_distance(origin, omega, self.hair.points[s], self.hair.points[s + 1]);
            if gap < radius { 0.0 } else { f32::INFINITY }
        });
        clear
            && self.head.as_ref().is_none_or(|head| {
                head.ray_traverse_miss(ray, |ray, id| {
                    self.triangles[head.primitive_indices[id] as usize].intersect(ray)
                })
            })
    }

    /// T̃ of `light` at point `own`: the share of `rays` over the lobe, from random places on the
    /// segment that starts there, that reach the sky.
    pub fn transmittance(&self, own: usize, light: &SrbfLight, rays: usize) -> f64 {
        let a = self.hair.points[own];
        let b = self.hair.points.get(own + 1).copied().unwrap_or(a);
        // The next point may belong to the next strand.
        let last = self.hair.offsets.binary_search(&(own as u32 + 1)).is_ok();
        let b = if last { a } else { b };
        let radius = 0.5 * self.diameters[own];
        let directions = sample_lobe(light, rays);
        let open = directions
            .iter()
            .enumerate()
            .filter(|(k, omega)| {
                let omega = omega.as_vec3();
                let (across, _) = omega.any_orthonormal_pair();
                // Van der Corput along the segment, an additive recurrence across the fibre.
                let along = (*k as u32).reverse_bits() as f32 / u32::MAX as f32;
                let aside = 2.0 * ((*k as f32 * 0.618_034).fract() - 0.5);
                let origin = a.lerp(b, along) + radius * (omega + aside * across);
                self.escapes(own, origin, omega)
            })
            .count();
        open as f64 / directions.len() as f64
    }

    /// Mean |ΔT̃| over up to `pairs` pairs of a point and a light, drawn evenly: `reach[j][k]` is what
    /// [`super::transport`] gave for light j at point `points[k]`; lights in the world frame.
    pub fn mean_abs_delta_t(
        &self,
        points: &[u32],
        lights: &[SrbfLight],
        reach: &[Vec<u32>],
        pairs: usize,
    ) -> f64 {
        let count = pairs.min(points.len() * lights.len());
        if count == 0 {
            return 0.0;
        }
        let errors: Vec<f64> = (0..count)
            .into_par_iter()
            .map(|pair| {
                let k = (pair as u64 * points.len() as u64 / count as u64) as usize;
                // A multiplicative hash, so that neighbours along a strand meet different lights.
                let j = (((pair as u64 * 2_654_435_761) >> 16) % lights.len() as u64) as usize;
                let exact = self.transmittance(points[k] as usize, &lights[j], RAYS);
                (f64::from(Reach::unpack(reach[j][k]).direct) - exact).abs()
            })
            .collect();
        errors.iter().sum::<f64>() / count as f64
    }
}

/// Rays for one T̃: their own noise is 0.016 at most.
const RAYS: usize = 1024;

/// Least distance between the ray from `o` along unit `d` and the segment `a`…`b`.
fn ray_segment_distance(o: Vec3, d: Vec3, a: Vec3, b: Vec3) -> f32 {
    let (edge, to) = (b - a, o - a);
    let (ee, de, dt, et) = (edge.dot(edge), d.dot(edge), d.dot(to), edge.dot(to));
    let denominator = ee - de * de;
    let mut s =
        if denominator > 1e-9 * ee { ((et - de * dt) / denominator).clamp(0.0, 1.0) } else { 0.5 };
    let t = (s * de - dt).max(0.0);
    if ee > 0.0 {
        s = ((et + t * de) / ee).clamp(0.0, 1.0);
    }
    let t = (s * de - dt).max(0.0);
    (o + d * t).distance(a + edge * s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_between_a_ray_and_a_segment() {
        let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
        assert!((ray_segment_distance(Vec3::ZERO, z, x - y, x + y) - 1.0).abs() < 1e-6);
        assert!((ray_segment_distance(Vec3::ZERO, z, -z, -2.0 * z) - 1.0).abs() < 1e-6, "behind");
        assert!((ray_segment_distance(Vec3::ZERO, z, x, x + z) - 1.0).abs() < 1e-6, "parallel");
        assert!(ray_segment_distance(Vec3::ZERO, z, z - x, z + x) < 1e-6, "crossing");
    }
}
