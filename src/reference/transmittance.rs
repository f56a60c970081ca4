//! Transmittance without approximation: rays cast through the real strands.
//!
//! T̃ of a lobe is the share of its rays that reach the sky. T_f (Xu 2011, Eq 4; Zinke et al. 2008) is, over
//! its rays, the mean of d_f ∏_k ā_f(θ_k) over the fibres k that a ray crosses, 0 for a ray that crosses none:
//! what arrives directly is T̃'s.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::tracer::skin::Skin;
use super::tracer::strands::{StrandRay, Strands};
use crate::scattering::dual::D_F;
use crate::srbf::{SrbfLight, sample_lobe};
use crate::stage::Geometry;
use crate::transport::Reach;

/// Rays for one T̃: their own noise is 0.016 at most.
const RAYS: usize = 1024;

/// A ray that has crossed so many fibres counts as lost: 0.9^256 is 2e-12.
const CROSSINGS_MAX: usize = 256;

/// 0.75^n and 0.5^n are below 1e-3, a twentieth of what a ray's own noise is.
const QUARTER_FAINT: i32 = 24;
const HALF_FAINT: i32 = 10;

/// The real strands and head of a stage.
pub struct RealStrands<'a> {
    stage: &'a Geometry,
    strands: Strands<'a>,
    skin: Option<Skin<'a>>,
}

/// How the transmittances of a frame differ from the exact ones: ΔT̃ = T̃ of the frame − T̃ by rays, over pairs of a
/// seen point and a light that shines. Above 0 the frame is too bright.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeltaT {
    /// Mean ΔT̃; all lights count alike.
    pub mean: f64,
    /// Mean |ΔT̃|; all lights count alike.
    pub mean_abs: f64,
    /// Mean |ΔT̃| over mean T̃, each light weighted by its energy.
    pub weighted_abs: f64,
    /// Mean ΔT̃ where light arrives, that is, over pairs of an exact T̃ above [`LIT`], each light weighted by its
    /// energy; None where there is no such pair.
    pub mean_lit: Option<f64>,
}

/// A pair is lit if its exact T̃ is above this.
const LIT: f64 = 0.7;

impl<'a> RealStrands<'a> {
    pub fn new(stage: &'a Geometry) -> Self {
        let Geometry { hair, diameters, frames, head, head_albedo, center, .. } = stage;
        RealStrands {
            stage,
            strands: Strands::new(hair, diameters, frames, 1, *center),
            skin: head.as_ref().map(|head| Skin::new(head, *head_albedo, *center)),
        }
    }

    /// Rays along the lobe from evenly spread places on the segment that starts at strand point `own`.
    fn rays(&self, own: usize, light: &SrbfLight, count: usize) -> Vec<StrandRay> {
        let Geometry { hair, diameters, center, .. } = self.stage;
        let strand = hair.offsets.partition_point(|&first| first as usize <= own) - 1;
        let end = hair.offsets[strand + 1] as usize;
        let other = if own + 1 < end { own + 1 } else { own };
        let (a, b) = (hair.points[own] - *center, hair.points[other] - *center);
        let u = self.stage.frames.tangents[own].as_dvec3();
        sample_lobe(light, count)
            .into_iter()
            .enumerate()
            .map(|(k, omega)| {
                // Van der Corput along the segment.
                let along = (k as u32).reverse_bits() as f32 / u32::MAX as f32;
                let radius = 0.5 * f64::from(diameters[own]);
                StrandRay::leaving(a.lerp(b, along).as_dvec3(), radius, u, strand as u32, omega)
            })
            .collect()
    }

    fn meets_head(&self, ray: &StrandRay) -> bool {
        self.skin.as_ref().is_some_and(|skin| skin.occluded(&ray.ray))
    }

    /// T̃ of `light` at strand point `own`.
    pub fn transmittance(&self, own: usize, light: &SrbfLight, rays: usize) -> f64 {
        let rays = self.rays(own, light, rays);
        let open = |ray: &&StrandRay| !self.strands.occluded(ray) && !self.meets_head(ray);
        rays.iter().filter(open).count() as f64 / rays.len() as f64
    }

    /// What [`crate::transport`] finds in its volume, here of the real strands: with n the fibres that a ray
    /// crosses, e^{−sτ} becomes (1−s)^n, of the same mean where crossings are Poisson.
    pub fn reach(&self, own: usize, light: &SrbfLight, rays: usize) -> Reach {
        let toward = self.rays(own, light, rays);
        let mut reach = Reach::default();
        for ray in toward.iter().filter(|ray| !self.meets_head(ray)) {
            let crossings = self.crossings(ray, QUARTER_FAINT);
            reach.open += 1.0;
            reach.quarter += 0.75f32.powi(crossings);
            reach.direct += f32::from(u8::from(crossings == 0));
        }
        let away = SrbfLight { direction: -light.direction, ..*light };
        for ray in self.rays(own, &away, rays) {
            reach.beyond += 0.5f32.powi(self.crossings(&ray, HALF_FAINT));
        }
        let share = |sum: f32| sum / rays as f32;
        Reach {
            direct: share(reach.direct),
            quarter: share(reach.quarter),
            open: share(reach.open),
            beyond: share(reach.beyond),
        }
    }

    /// Fibres that a ray crosses, counted up to `most`.
    fn crossings(&self, ray: &StrandRay, most: i32) -> i32 {
        let mut ray = *ray;
        for count in 0..most {
            match self.strands.closest(&ray) {
                Some(id) => ray = ray.past(&self.strands.fibre_point(id, &ray)),
                None => return count,
            }
        }
        most
    }

    /// T_f of `light` at strand point `own`, RGB, for fibres of forward share `a_f`(θ), θ the inclination of the
    /// ray to the fibre it crosses.
    pub fn forward_transmittance(
        &self,
        own: usize,
        light: &SrbfLight,
        rays: usize,
        a_f: impl Fn(f64) -> [f64; 3],
    ) -> [f64; 3] {
        let rays = self.rays(own, light, rays);
        let mut sum = DVec3::ZERO;
        for first in rays.iter().filter(|ray| !self.meets_head(ray)) {
            let omega = DVec3::from(Vec3::from(first.ray.direction));
            let (mut ray, mut share) = (*first, DVec3::splat(D_F));
            let mut crossings = 0;
            while let Some(id) = self.strands.closest(&ray)
                && crossings < CROSSINGS_MAX
            {
                let at = self.strands.fibre_point(id, &ray);
                share *= DVec3::from(a_f(omega.dot(at.frame.x_axis).clamp(-1.0, 1.0).asin()));
                ray = ray.past(&at);
                crossings += 1;
            }
            if (1..CROSSINGS_MAX).contains(&crossings) {
                sum += share;
            }
        }
        (sum / rays.len() as f64).to_array()
    }

    /// ΔT̃ over `pairs` pairs of a point and a light that shines: `t[j][k]` is the frame's T̃ of light j (world frame)
    /// at strand point `points[k]`. None where nothing is seen or shines.
    ///
    /// Which pairs are drawn depends on points and lights alone, not on their order: places evenly along the points,
    /// and lights by a golden-ratio sequence, half of them evenly and half by energy. Each pair is weighted by what
    /// its light's chance was, so that figures of different releases compare.
    pub fn delta_t(
        &self,
        points: &[u32],
        lights: &[SrbfLight],
        t: impl Fn(usize, usize) -> f64 + Sync,
        pairs: usize,
    ) -> Option<DeltaT> {
        let energies: Vec<f64> = lights.iter().map(|l| l.energy().iter().sum()).collect();
        let mut shining: Vec<usize> = (0..lights.len()).filter(|&j| energies[j] > 0.0).collect();
        shining.sort_by(|&a, &b| energies[b].total_cmp(&energies[a]));
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_unstable_by_key(|&k| points[k]);
        let whole: f64 = energies.iter().sum();
        let even = 1.0 / shining.len() as f64;
        let chance = |j: usize| 0.5 * even + 0.5 * energies[j] / whole;
        if shining.is_empty() || points.is_empty() {
            return None;
        }
        let drawn = (0..pairs).into_par_iter().map(|pair| {
            let k = order[pair * points.len() / pairs];
            let mut left = (pair as f64 * 0.5 * (5f64.sqrt() - 1.0)).fract();
            let drawn = shining.iter().copied().find(|&j| {
                left -= chance(j);
                left < 0.0
            });
            let j = drawn.unwrap_or(shining[shining.len() - 1]);
            let exact = self.transmittance(points[k] as usize, &lights[j], RAYS);
            (exact, t(j, k) - exact, even / chance(j), energies[j] / chance(j))
        });
        let drawn: Vec<(f64, f64, f64, f64)> = drawn.collect();
        let sum = |of: fn(&(f64, f64, f64, f64)) -> f64| drawn.iter().map(of).sum::<f64>();
        let alike = sum(|d| d.2);
        let lit = sum(|d| if d.0 > LIT { d.3 } else { 0.0 });
        let lit_delta = sum(|d| if d.0 > LIT { d.3 * d.1 } else { 0.0 });
        Some(DeltaT {
            mean: sum(|d| d.2 * d.1) / alike,
            mean_abs: sum(|d| d.2 * d.1.abs()) / alike,
            weighted_abs: sum(|d| d.3 * d.1.abs()) / sum(|d| d.3 * d.0).max(f64::MIN_POSITIVE),
            mean_lit: (lit > 0.0).then_some(lit_delta / lit),
        })
    }
}
