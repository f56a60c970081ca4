//! Light transport: how much of each light reaches each point. It knows geometry and lights alone, so
//! an edit of colour or roughness rebuilds nothing here.
//!
//! Xu 2011 takes the effective transmittance T̃(ω_j, λ_j) from Ren et al.'s convolution optical depth
//! maps, one a light, whose kernel is not public. Here every lobe is sampled by directions of equal weight;
//! for each, optical depth τ is read from one direction-aware density volume (`volume`, `sheared`) and the
//! head's visibility V from a depth map (`shadow`). Stored for each point and light are the means over the
//! lobe of V e^(−sτ) at s = 1 (T̃ itself), s = ¼ and s = 0, from which the shader finds the mean for any
//! s = 1 − ā_f: that is dual scattering's forward transmittance when crossings are Poisson, whatever the
//! colour. A fourth mean tells how much hair lies beyond the point, which local multiple scattering needs:
//! a lone strand has no neighbours to scatter light back.
//!
//! Measured by `capture --verify` against rays cast through the real strands: see README, "Limits".

pub mod near;
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

/// Cells along the longest edge of the density volume. On sintel without its head under 24 lights of city,
/// mean |ΔT̃| over all points is 0.057 at 64, 0.051 at 96, 0.048 at 128 and 0.043 at 256.
const RESOLUTION: usize = 96;
/// A query steps this many cells towards the light, so that a strand does not shade itself. Over the points that a
/// frame shows and all lights the mean ΔT̃ is −0.031, −0.011, +0.013 and +0.027 at ¼, ½, ¾ and 1, and mean |ΔT̃|
/// 0.081, 0.078, 0.081 and 0.084 (sintel with its head, san_giuseppe_bridge; builtin bob: 0.064, 0.064, 0.069,
/// 0.081).
const STEP_OUT: f32 = 0.5;
/// The head's shadow starts this share of its radius below the surface, so that roots are not shaded by
/// the scalp that they stand on.
const HEAD_BIAS: f32 = 0.03;
/// Most directions for one lobe: with [`STEP_OUT`] ¼, 4, 8, 12, 32 and 64 leave mean |ΔT̃| at 0.0451, 0.0435,
/// 0.0429, 0.0422 and 0.0417 (sintel with its head, san_giuseppe_bridge).
const MAX_DIRECTIONS: usize = 12;

/// Directions of [`Occluders::openness`].
const WAYS_OUT: usize = 24;

/// The means over a light's lobe at one point, each in 0…1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reach {
    /// T̃ = mean of V e^(−τ).
    pub direct: f32,
    /// Mean of V e^(−τ/4).
    pub quarter: f32,
    /// Mean of V: what the head leaves.
    pub open: f32,
    /// Mean of e^(−τ′/2), τ′ the optical depth beyond the point, away from the light.
    pub beyond: f32,
}

impl Reach {
    /// Square roots in 10, 8, 6 and 8 bits: errors of at most 0.001, 0.004, 0.016 and 0.004.
    /// shaders/shade.wgsl unpacks them.
    pub fn pack(self) -> u32 {
        let code = |v: f32, top: f32| (v.clamp(0.0, 1.0).sqrt() * top).round() as u32;
        code(self.direct, 1023.0)
            | code(self.quarter, 255.0) << 10
            | code(self.open, 63.0) << 18
            | code(self.beyond, 255.0) << 24
    }

    pub fn unpack(bits: u32) -> Reach {
        let value = |shift: u32, top: u32| ((bits >> shift & top) as f32 / top as f32).powi(2);
        Reach {
            direct: value(0, 1023),
            quarter: value(10, 255),
            open: value(18, 63),
            beyond: value(24, 255),
        }
    }
}

/// Directions of equal weight that stand for a lobe: one for a narrow light, 12 for a wide one.
pub fn lobe_directions(light: &SrbfLight) -> Vec<DVec3> {
    let count = (30.0 * light.lambda.powi(2)).ceil().clamp(1.0, MAX_DIRECTIONS as f64) as usize;
    sample_lobe(light, count)
}

/// How much transport is to know.
#[derive(Clone, Copy, Debug)]
pub struct Detail {
    /// Cells along the longest edge of the density volume.
    pub cells: usize,
    /// Whether light counts that more than one strand has scattered.
    pub multiple: bool,
}

impl Detail {
    pub const USUAL: Detail = Detail { cells: RESOLUTION, multiple: true };
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
    /// V, and τ towards the light and beyond, at `p` in cells.
    fn look(&self, p: Vec3) -> (f32, f32, f32) {
        let shear = &self.depth.shear;
        let open = self.shadow.as_ref().map_or(1.0, |s| s.visibility(shear.apply(p)));
        let (tau, beyond) = self.depth.tau(shear.apply(p + STEP_OUT * self.omega));
        (open, tau, beyond)
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

    /// One light (world frame): its reach at each of `points`; `Reach::beyond` is 0 unless asked for.
    pub fn reach(&self, light: &SrbfLight, points: &[Vec3], beyond: bool) -> Vec<Reach> {
        self.reach_and_irradiance(light, points, beyond, false, &|| true).unwrap_or_default().0
    }

    /// The irradiance that comes of a light (world frame) of radiance 1, whatever its own, through the hair to each
    /// vertex of the head.
    pub fn irradiance(&self, light: &SrbfLight) -> Vec<f32> {
        self.reach_and_irradiance(light, &[], false, true, &|| true).unwrap_or_default().1
    }

    /// None where `go_on`, asked before each direction, said no.
    fn reach_and_irradiance(
        &self,
        light: &SrbfLight,
        points: &[Vec3],
        beyond: bool,
        head: bool,
        go_on: &dyn Fn() -> bool,
    ) -> Option<(Vec<Reach>, Vec<f32>)> {
        let directions = lobe_directions(light);
        let weight = 1.0 / directions.len() as f32;
        let irradiance = lobe_integral(light.lambda) as f32 * weight;
        let mut means = vec![Reach::default(); points.len()];
        let lit = self.head.filter(|_| head);
        let vertices = lit.map_or(&[][..], |head| &head.positions);
        let normals = lit.map_or(&[][..], |head| &head.normals);
        let mut received = vec![0.0; vertices.len()];
        for way in self.ways(&directions) {
            if !go_on() {
                return None;
            }
            for (mean, &p) in means.iter_mut().zip(points) {
                let (open, tau, behind) = way.look(self.volume.to_cells(p));
                if beyond {
                    mean.beyond += weight * (-0.5 * behind).exp();
                }
                if open > 0.0 {
                    let quarter = (-0.25 * tau).exp();
                    mean.open += weight * open;
                    mean.quarter += weight * open * quarter;
                    mean.direct += weight * open * quarter.powi(4);
                }
            }
            for ((sum, normal), &p) in received.iter_mut().zip(normals).zip(vertices) {
                let cosine = normal.dot(way.omega);
                if cosine > 0.0 {
                    let (open, tau, _) = way.look(self.volume.to_cells(p));
                    *sum += irradiance * (open * (-tau).exp() * cosine);
                }
            }
        }
        Some((means, received))
    }
}

/// What one light brings, whatever its colour.
#[derive(Clone, Debug, Default)]
pub struct Brought {
    /// Packed [`Reach`] at each point.
    pub reach: Vec<u32>,
    /// T̃ at each sample.
    pub samples: Vec<f32>,
    /// Irradiance at each vertex of the head from a light of radiance 1; empty without a head.
    pub head: Vec<f32>,
    /// Look-ups of optical depth that this took: of a place along a direction.
    pub looks: u64,
}

/// Where light is brought to.
#[derive(Clone, Copy, Default)]
pub struct Places<'a> {
    pub points: &'a [Vec3],
    /// Of which T̃ alone is known.
    pub samples: &'a [Vec3],
    /// Whether to the head.
    pub head: bool,
    /// Whether [`Reach::beyond`] is wanted.
    pub beyond: bool,
}

/// The transport of each of `lights`; a black one has none: 0 at points and samples, nothing for the head. `tick` is
/// told the share done, again and again; false cancels, and the result is then None.
pub fn transport(
    occluders: &Occluders,
    lights: &[SrbfLight],
    to: &Places,
    tick: &(dyn Fn(f32) -> bool + Sync),
) -> Option<Vec<Brought>> {
    let places = [to.points, to.samples].concat();
    let done = AtomicUsize::new(0);
    let go_on = || tick(done.load(Ordering::Relaxed) as f32 / lights.len() as f32);
    let bring = |light: &SrbfLight| {
        if light.rgb == [0.0; 3] {
            let (reach, samples) = (vec![0; to.points.len()], vec![0.0; to.samples.len()]);
            return Some(Brought { reach, samples, ..Brought::default() });
        }
        let (reach, head) =
            occluders.reach_and_irradiance(light, &places, to.beyond, to.head, &go_on)?;
        let (of_points, of_samples) = reach.split_at(to.points.len());
        Some(Brought {
            reach: of_points.iter().map(|reach| reach.pack()).collect(),
            samples: of_samples.iter().map(|reach| reach.direct).collect(),
            looks: (lobe_directions(light).len() * (places.len() + head.len())) as u64,
            head,
        })
    };
    let each = |light| {
        let brought = bring(light);
        done.fetch_add(1, Ordering::Relaxed);
        brought.filter(|_| go_on())
    };
    lights.par_iter().map(each).collect()
}
