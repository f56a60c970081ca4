//! Transmittance without approximation: rays cast through the real strands.
//!
//! T̃ of a lobe is the share of its rays that reach the sky. T_f (Xu 2011, Eq 4; Zinke et al. 2008) is, over
//! its rays, the mean of d_f ∏_k ā_f(θ_k) over the fibres k that a ray crosses, 0 for a ray that crosses none:
//! what arrives directly is T̃'s.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::tracer::skin::Skin;
use super::tracer::strands::{NO_STRAND, StrandBvh, StrandRay, Strands};
use crate::hair::normals;
use crate::head::HeadRays;
use crate::scattering::dual::D_F;
use crate::scene::Lens;
use crate::srbf::{SrbfLight, sample_lobe};
use crate::stage::Geometry;
use crate::transport::TransmittanceMoments;
use crate::transport::draws::{self, Block, HeadLight, HeadVertex, TracedLight, Words};

/// Rays for one T̃: their own noise is 0.03 at most, and that of a pixel's mean a third of it.
const RAYS: usize = 256;

/// A ray that has crossed so many fibres counts as lost: 0.9^256 is 2e-12.
const CROSSINGS_MAX: usize = 256;

/// 0.75^n and 0.5^n are below 1e-3, a twentieth of what a ray's own noise is.
const QUARTER_FAINT: i32 = 24;
const HALF_FAINT: i32 = 10;

/// Strands and head as rays on the CPU meet them: the twin of shaders/occlusion.wgsl and, on a CPU's adapter, what stands
/// in its place.
pub struct StrandRays {
    strands: StrandBvh,
    head: Option<HeadRays>,
}

impl StrandRays {
    pub fn new(stage: &Geometry) -> StrandRays {
        let Geometry { hair, diameters, frames, head, center, .. } = stage;
        StrandRays {
            strands: StrandBvh::new(hair, diameters, frames, 1, *center),
            head: head.as_ref().map(|head| HeadRays::new(head, *center)),
        }
    }

    /// Irradiance that a light of radiance 1 brings to a place on the head; rays start `lift` above it, within a square of
    /// `spread` a side.
    pub fn irradiance(
        &self,
        vertex: &HeadVertex,
        [lift, spread]: [f32; 2],
        one: &HeadLight,
    ) -> f32 {
        let HeadVertex { position, normal, .. } = *vertex;
        let above = position + lift * normal;
        let (x, y) = normals(normal);
        let light = &one.light;
        let mut sum = 0.0;
        for k in 0..light.rays {
            let [across, down, _] = draws::draw_of(1, 0, k).map(|draw| spread * (draw - 0.5));
            let origin = above + across * x + down * y;
            let aim = draws::aim(light, origin, draws::draw_of(one.wide * vertex.seed, 0, k));
            let cosine = normal.dot(aim.direction);
            if cosine <= 0.0 || aim.distance <= 0.0 {
                continue;
            }
            let from =
                |origin| StrandRay::along(origin, 0.0, NO_STRAND, aim.direction, aim.distance);
            // The place stands for what is about it, but the surface would shade itself.
            let open = !self.head.as_ref().is_some_and(|head| head.occluded(&from(above).ray))
                && !self.strands.occluded(&from(origin));
            sum += if open { cosine } else { 0.0 };
        }
        let energy = if one.energy < 0.0 { draws::solid_angle(light, above) } else { one.energy };
        energy * sum / light.rays as f32
    }

    /// What a ray between strands meets first: twin of `cast_nearest` of shaders/cast.wgsl.
    pub fn cast_nearest(&self, ray: &StrandRay) -> Met {
        let mut ray = *ray;
        let mut met = Met::Nothing;
        if let Some((point, path)) =
            self.strands.closest(&ray).map(|(id, t)| (self.strands.segment(id), t))
        {
            met = Met::Strand { point, path };
            ray.ray.tmax = path;
        }
        if let Some(head) = &self.head
            && let Some((id, path)) = head.closest(&ray.ray)
        {
            let weights = head.weights(id, Vec3::from(ray.ray.origin + path * ray.ray.direction));
            met = Met::Head { triangle: head.triangle(id).1 as u32, path, weights };
        }
        met
    }

    /// Whether nothing stands in the way of a ray between strands: twin of `cast_any`.
    pub fn cast_any(&self, ray: &StrandRay) -> bool {
        !self.strands.occluded(ray)
            && !self.head.as_ref().is_some_and(|head| head.occluded(&ray.ray))
    }

    /// Adds the rays that each of `lights` asks for to its words of a block of `points`; `counts`: whether to count strands.
    pub fn trace(
        &self,
        stage: &Geometry,
        block: &Block,
        points: u32,
        lights: &[TracedLight],
        counts: bool,
        words: &mut [Words],
    ) {
        let strand = stage.hair.offsets.partition_point(|&first| first <= block.own[0]) - 1;
        for (light, words) in lights.iter().zip(words) {
            for _ in 0..light.rays {
                self.trace_one(stage, block, points, strand as u32, light, counts, words);
            }
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn trace_one(
        &self,
        stage: &Geometry,
        block: &Block,
        points: u32,
        strand: u32,
        light: &TracedLight,
        counts: bool,
        words: &mut Words,
    ) {
        let Geometry { hair, diameters, frames, center, .. } = stage;
        let number = (block.point - block.own[0]) / points;
        let draw = draws::draw_of(block.own[0], number, words[0] >> 16);
        let (point, other, part) = block.place(points, draw[2]);
        let [at, to] = [point, other].map(|i| hair.points[i as usize] - *center);
        let origin = at.lerp(to, part);
        let aim = draws::aim(light, origin, draw);
        let (radius, u) = (0.5 * diameters[point as usize], frames.tangents[point as usize]);
        let leave = |omega: Vec3, most: f32| {
            let across = aim.direction.reject_from_normalized(u).normalize_or_zero();
            StrandRay::along(origin + radius * across, radius, strand, omega, most)
        };
        let ray = leave(aim.direction, aim.distance);
        let seen =
            |ray: &StrandRay| !self.head.as_ref().is_some_and(|head| head.occluded(&ray.ray));
        let counted = counts.then(|| {
            let left = f32::from(u8::from(aim.distance > 0.0 && seen(&ray)));
            let strands = self.strands.count(&ray, false);
            let behind = self.strands.count(&leave(-aim.direction, f32::INFINITY), true);
            [left, left * 0.75f32.powi(strands as i32), 0.5f32.powi(behind as i32)]
        });
        let open = aim.distance > 0.0 && !self.strands.occluded(&ray) && seen(&ray);
        draws::add(words, open, counted);
    }
}

/// What a ray between strands met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Met {
    Nothing,
    /// First point of a segment.
    Strand {
        point: u32,
        path: f32,
    },
    /// Weights of the triangle's corners.
    Head {
        triangle: u32,
        path: f32,
        weights: [f32; 3],
    },
}

/// The real strands and head of a stage.
pub struct RealStrands<'a> {
    stage: &'a Geometry,
    strands: Strands<'a>,
    skin: Option<Skin<'a>>,
}

/// How the transmittances of a frame differ from the exact ones: ΔT̃ = T̃ of the frame − T̃ by rays, for lights that shine.
/// Above 0 the frame is too bright.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeltaT {
    /// Mean ΔT̃ over pixels; all lights count alike.
    pub mean: f64,
    /// Mean |ΔT̃| over pixels, of each the mean over the points that its samples see; all lights count alike.
    pub mean_abs: f64,
    /// The same over mean T̃, each light weighted by its energy.
    pub weighted_abs: f64,
    /// Mean ΔT̃ where light arrives, that is, over pairs of a point and a light whose exact T̃ is above [`LIT`], each light
    /// weighted by its energy; None where there is no such pair.
    pub mean_lit: Option<f64>,
}

/// What one pixel, or one pair of a point and a light, adds to [`DeltaT`].
#[derive(Clone, Copy, Default)]
struct Judged {
    exact: f64,
    delta: f64,
    /// Weights by which lights count alike, and by their energy.
    alike: f64,
    energy: f64,
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

    /// Rays along the lobe from evenly spread places on the strand, up to half a segment to either side of point `own`.
    fn rays(&self, own: usize, light: &SrbfLight, count: usize) -> Vec<StrandRay> {
        let Geometry { hair, diameters, center, .. } = self.stage;
        let strand = hair.offsets.partition_point(|&first| first as usize <= own) - 1;
        let [begin, end] = [strand, strand + 1].map(|at| hair.offsets[at] as usize);
        let place = |point: usize| hair.points[point.clamp(begin, end - 1)] - *center;
        let at = place(own);
        let aside = |way: f32| {
            let inward = own > begin && (way < 0.0 || own + 1 == end);
            place(if inward { own - 1 } else { own + 1 })
        };
        let u = self.stage.frames.tangents[own].as_dvec3();
        sample_lobe(light, count)
            .into_iter()
            .enumerate()
            .map(|(k, omega)| {
                // Van der Corput along the segment.
                let along = (k as u32).reverse_bits() as f32 / u32::MAX as f32;
                let radius = 0.5 * f64::from(diameters[own]);
                let way = along - 0.5;
                let place = at.lerp(aside(way), way.abs());
                StrandRay::leaving(place.as_dvec3(), radius, u, strand as u32, omega)
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

    /// What rays drawn at random find of a light, here by `rays` that are spread evenly.
    pub fn moments(&self, own: usize, light: &SrbfLight, rays: usize) -> TransmittanceMoments {
        let toward = self.rays(own, light, rays);
        let mut moments = TransmittanceMoments::default();
        for ray in toward.iter().filter(|ray| !self.meets_head(ray)) {
            let crossings = self.crossings(ray, QUARTER_FAINT);
            moments.visibility += 1.0;
            moments.t_quarter += 0.75f32.powi(crossings);
            moments.t1 += f32::from(u8::from(crossings == 0));
        }
        let away = SrbfLight { direction: -light.direction, ..*light };
        for ray in self.rays(own, &away, rays) {
            moments.back += 0.5f32.powi(self.crossings(&ray, HALF_FAINT));
        }
        let share = |sum: f32| sum / rays as f32;
        TransmittanceMoments {
            t1: share(moments.t1),
            t_quarter: share(moments.t_quarter),
            visibility: share(moments.visibility),
            back: share(moments.back),
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

    /// The points that the samples of a pixel see, with their shares: of `PIXEL_RAYS` rays through it.
    fn seen(&self, lens: &Lens, [x, y]: [u32; 2]) -> Vec<(u32, f64)> {
        const ACROSS: u32 = 4;
        let mut seen: Vec<(u32, f64)> = Vec::new();
        for k in 0..ACROSS * ACROSS {
            let at = |pixel: u32, k: u32, size: u32| {
                let place = f64::from(pixel) + (f64::from(k) + 0.5) / f64::from(ACROSS);
                2.0 * place / f64::from(size) - 1.0
            };
            let across = at(x, k % ACROSS, lens.size[0]);
            let down = at(y, k / ACROSS, lens.size[1]);
            let direction = (lens.forward + across * lens.right - down * lens.up).normalize();
            let ray = StrandRay::free(lens.eye.as_vec3(), direction.as_vec3());
            let Some(id) = self.strands.closest(&ray) else { continue };
            let at = self.strands.fibre_point(id, &ray);
            let distance = at.axis_point.distance(lens.eye) as f32;
            let skin = self.skin.as_ref().and_then(|skin| skin.closest(&ray.ray));
            if skin.is_some_and(|(_, t)| t < distance) {
                continue;
            }
            let along = f64::from(at.along);
            for (point, share) in [(at.point, 1.0 - along), (at.point + 1, along)] {
                match seen.iter_mut().find(|seen| seen.0 == point) {
                    Some(seen) => seen.1 += share,
                    None => seen.push((point, share)),
                }
            }
        }
        seen
    }

    /// ΔT̃ of a frame through `lens`, over some `pixels` that hair covers, each with a light that shines: `t[j][k]` is the
    /// frame's T̃ of light j (world frame) at strand point `points[k]`. None where nothing is seen or shines.
    ///
    /// Which pixels and lights are drawn depends on the view and the lights alone: pixels by a golden-ratio sequence, and
    /// lights by another, half of them evenly and half by energy. Each is weighted by what its light's chance was, so that
    /// figures of different releases compare.
    pub fn delta_t(
        &self,
        lens: &Lens,
        points: &[u32],
        lights: &[SrbfLight],
        t: impl Fn(usize, usize) -> f64 + Sync,
        pixels: usize,
    ) -> Option<DeltaT> {
        let energies: Vec<f64> = lights.iter().map(|l| l.energy().iter().sum()).collect();
        let mut shining: Vec<usize> = (0..lights.len()).filter(|&j| energies[j] > 0.0).collect();
        shining.sort_by(|&a, &b| energies[b].total_cmp(&energies[a]));
        let mut place_of = vec![usize::MAX; self.stage.hair.points.len()];
        points.iter().enumerate().for_each(|(k, &point)| place_of[point as usize] = k);
        let whole: f64 = energies.iter().sum();
        let even = 1.0 / shining.len() as f64;
        let chance = |j: usize| 0.5 * even + 0.5 * energies[j] / whole;
        if shining.is_empty() || points.is_empty() {
            return None;
        }
        let count = u64::from(lens.size[0]) * u64::from(lens.size[1]);
        let golden = |k: u64, step: f64| (k as f64 * step).fract();
        let judge = |k: u64| {
            let pixel = (golden(k, 0.5 * (5f64.sqrt() - 1.0)) * count as f64) as u32;
            let seen = self.seen(lens, [pixel % lens.size[0], pixel / lens.size[0]]);
            let known = |&(point, share): &(u32, f64)| {
                let place = place_of[point as usize];
                (place != usize::MAX).then_some((point as usize, place, share))
            };
            let seen: Vec<(usize, usize, f64)> = seen.iter().filter_map(known).collect();
            let mut left = golden(k, 0.754_877_666_246_693);
            let drawn = shining.iter().copied().find(|&j| {
                left -= chance(j);
                left < 0.0
            });
            let j = drawn.unwrap_or(shining[shining.len() - 1]);
            let weights = [even / chance(j), energies[j] / chance(j)];
            let total: f64 = seen.iter().map(|seen| seen.2).sum();
            let mut mean = Judged { alike: weights[0], energy: weights[1], ..Judged::default() };
            let mut lit = [0.0; 2];
            for (point, place, share) in seen {
                let exact = self.transmittance(point, &lights[j], RAYS);
                let delta = t(j, place) - exact;
                mean.exact += share / total * exact;
                mean.delta += share / total * delta;
                if exact > LIT {
                    lit = [lit[0] + weights[1] * share, lit[1] + weights[1] * share * delta];
                }
            }
            (total > 0.0).then_some((mean, lit))
        };
        // Half of all pixels may show no hair.
        let judged = (0..16 * pixels as u64).into_par_iter().filter_map(judge);
        let judged: Vec<(Judged, [f64; 2])> = judged.take_any(pixels).collect();
        let sum = |of: fn(&Judged) -> f64| judged.iter().map(|(one, _)| of(one)).sum::<f64>();
        let alike = sum(|one| one.alike);
        let lit = [0, 1].map(|k| judged.iter().map(|(_, lit)| lit[k]).sum::<f64>());
        (alike > 0.0).then(|| DeltaT {
            mean: sum(|one| one.alike * one.delta) / alike,
            mean_abs: sum(|one| one.alike * one.delta.abs()) / alike,
            weighted_abs: sum(|one| one.energy * one.delta.abs())
                / sum(|one| one.energy * one.exact).max(f64::MIN_POSITIVE),
            mean_lit: (lit[0] > 0.0).then(|| lit[1] / lit[0]),
        })
    }
}
