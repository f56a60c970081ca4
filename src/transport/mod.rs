//! Light transport: how much of each light reaches each place. It knows geometry and lights alone, so an edit of colour or
//! roughness rebuilds nothing here.
//!
//! Xu 2011 takes the effective transmittance T̃(ω_j, λ_j) from Ren et al.'s convolution optical depth maps, one a light,
//! whose kernel is not public. Here T̃ at the strand points that frames show is the share of rays, drawn from the light's
//! lobe, that nothing stands in the way of (`draws`, `occlusion`). Measured by `capture --verify`: see README, "Limits".
//!
//! What strands make of each other's light needs T̃ at places inside the hair, where a mean over many strands will do: every
//! lobe is sampled by directions of equal weight; for each, optical depth τ is read from one direction-aware density volume
//! (`volume`, `sheared`) and the head's visibility V from a depth map (`shadow`).

pub mod draws;
pub mod near;
pub mod occlusion;
pub mod shadow;
pub mod sheared;
pub mod volume;

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::head::Head;
use crate::srbf::{SrbfLight, lobe_integral, sample_lobe};
use shadow::HeadShadow;
use sheared::OpticalDepth;
use volume::Volume;

/// Cells along the longest edge of the density volume.
pub const CELLS: usize = 48;
/// A query steps this many cells towards the light, so that a strand does not shade itself.
const STEP_OUT: f32 = 0.5;
/// The head's shadow starts this share of its radius below the surface, so that roots are not shaded by
/// the scalp that they stand on.
const HEAD_BIAS: f32 = 0.03;
/// Most directions for one lobe.
const MAX_DIRECTIONS: usize = 6;

/// Directions of [`Occluders::openness`].
const WAYS_OUT: usize = 24;

/// The means over a light's lobe at one point, each in 0…1: with n the strands that a ray crosses towards the light, n′ those
/// that it crosses away from it, and V what the head leaves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TransmittanceMoments {
    /// T̃ = mean of V [n = 0].
    pub t1: f32,
    /// Mean of V 0.75^n.
    pub t_quarter: f32,
    /// Mean of V.
    pub visibility: f32,
    /// Mean of 0.5^n′.
    pub back: f32,
}

impl TransmittanceMoments {
    /// As the words that shading reads, T̃ to 1/4095.
    pub fn words(self) -> draws::Words {
        let open = (self.t1.clamp(0.0, 1.0) * 4095.0).round() as u32;
        [open | 4095 << 16, draws::pack_means([self.visibility, self.t_quarter, self.back])]
    }
}

/// Directions of equal weight that stand for a lobe: one for a narrow light, 2 for an ordinate, 6 for a wide one.
pub fn lobe_directions(light: &SrbfLight) -> Vec<DVec3> {
    let count = (12.0 * light.lambda.powi(2)).ceil().clamp(1.0, MAX_DIRECTIONS as f64) as usize;
    sample_lobe(light, count)
}

/// What stands in the light's way.
pub struct Occluders<'a> {
    pub volume: &'a Volume,
    pub head: Option<&'a Head>,
}

/// What stands between the points and one direction.
struct Way {
    omega: Vec3,
    depth: OpticalDepth,
    shadow: Option<HeadShadow>,
}

impl Way {
    /// V, and τ towards the light, at `p` in cells.
    fn look(&self, p: Vec3) -> (f32, f32) {
        let shear = &self.depth.shear;
        let open = self.shadow.as_ref().map_or(1.0, |s| s.visibility(shear.apply(p)));
        let tau = self.depth.tau(shear.apply(p + STEP_OUT * self.omega));
        (open, tau)
    }
}

impl Occluders<'_> {
    fn ways(&self, directions: &[DVec3]) -> impl Iterator<Item = Way> {
        let head = self.head.map(|head| {
            let cells: Vec<Vec3> =
                head.positions.iter().map(|&p| self.volume.to_cells(p)).collect();
            let low = cells.iter().copied().fold(Vec3::INFINITY, Vec3::min);
            let high = cells.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
            (cells, &head.triangles, HEAD_BIAS * 0.5 * (high - low).min_element())
        });
        directions.iter().map(move |omega| {
            let omega = omega.as_vec3();
            let depth = OpticalDepth::new(self.volume, omega);
            let shadow =
                head.as_ref().map(|(v, t, bias)| HeadShadow::new(v, t, &depth.shear, *bias));
            Way { omega, depth, shadow }
        })
    }

    /// The share of all directions in which the head does not lie, from each of `points`.
    pub fn openness(&self, points: &[Vec3]) -> Vec<f32> {
        let even = SrbfLight { direction: DVec3::Y, lambda: 1e4, rgb: [1.0; 3] };
        let mut open = vec![0.0; points.len()];
        for way in self.ways(&sample_lobe(&even, WAYS_OUT)) {
            open.par_iter_mut().zip(points).for_each(|(open, &p)| {
                *open += way.look(self.volume.to_cells(p)).0 / WAYS_OUT as f32;
            });
        }
        open
    }

    /// T̃ of one light (world frame) at each of `points`.
    pub fn transmittance(&self, light: &SrbfLight, points: &[Vec3]) -> Vec<f32> {
        self.receive(light, points, false, &|| true).unwrap_or_default().0
    }

    /// The irradiance that comes of a light (world frame) of radiance 1, whatever its own, through the hair to each
    /// vertex of the head.
    pub fn irradiance(&self, light: &SrbfLight) -> Vec<f32> {
        self.receive(light, &[], true, &|| true).unwrap_or_default().1
    }

    /// None where `go_on`, asked before each direction, said no.
    fn receive(
        &self,
        light: &SrbfLight,
        points: &[Vec3],
        head: bool,
        go_on: &dyn Fn() -> bool,
    ) -> Option<(Vec<f32>, Vec<f32>)> {
        let directions = lobe_directions(light);
        let weight = 1.0 / directions.len() as f32;
        let irradiance = lobe_integral(light.lambda) as f32 * weight;
        let mut means = vec![0.0; points.len()];
        let lit = self.head.filter(|_| head);
        let vertices = lit.map_or(&[][..], |head| &head.positions);
        let normals = lit.map_or(&[][..], |head| &head.normals);
        let mut received = vec![0.0; vertices.len()];
        for way in self.ways(&directions) {
            if !go_on() {
                return None;
            }
            for (mean, &p) in means.iter_mut().zip(points) {
                let (open, tau) = way.look(self.volume.to_cells(p));
                if open > 0.0 {
                    *mean += weight * open * (-tau).exp();
                }
            }
            for ((sum, normal), &p) in received.iter_mut().zip(normals).zip(vertices) {
                let cosine = normal.dot(way.omega);
                if cosine > 0.0 {
                    let (open, tau) = way.look(self.volume.to_cells(p));
                    *sum += irradiance * (open * (-tau).exp() * cosine);
                }
            }
        }
        Some((means, received))
    }
}

/// What one light brings to the inside of the hair, whatever its colour.
#[derive(Clone, Debug, Default)]
pub struct Brought {
    /// T̃ at each sample of the grid of multiple scattering.
    pub samples: Vec<f32>,
    /// Irradiance at each vertex of the head from a light of radiance 1; empty without a head.
    pub head: Vec<f32>,
    /// Look-ups of optical depth that this took: of a place along a direction.
    pub looks: u64,
}

/// The transport of each of `lights` to `samples` and to the head; a black one has none: 0 at samples, nothing for the head.
/// `tick` is told the share done, again and again; false cancels, and the result is then None.
pub fn transport(
    occluders: &Occluders,
    lights: &[SrbfLight],
    samples: &[Vec3],
    tick: &(dyn Fn(f32) -> bool + Sync),
) -> Option<Vec<Brought>> {
    let done = AtomicUsize::new(0);
    let go_on = || tick(done.load(Ordering::Relaxed) as f32 / lights.len() as f32);
    let bring = |light: &SrbfLight| {
        if light.rgb == [0.0; 3] {
            return Some(Brought { samples: vec![0.0; samples.len()], ..Brought::default() });
        }
        let (of_samples, head) = occluders.receive(light, samples, true, &go_on)?;
        let looks = (lobe_directions(light).len() * (samples.len() + head.len())) as u64;
        Some(Brought { samples: of_samples, looks, head })
    };
    let each = |light| {
        let brought = bring(light);
        done.fetch_add(1, Ordering::Relaxed);
        brought.filter(|_| go_on())
    };
    lights.par_iter().map(each).collect()
}
