//! Transport of lamps near the hair, which each place sees in directions of its own.
//!
//! From every place a few rays go to the lamp, as it covers its solid angle: optical depth by a march through the density
//! volume, the head's visibility by its triangles, both no farther than the lamp.

use glam::Vec3;
use obvhs::ray::Ray;
use rayon::prelude::*;

use super::volume::Volume;
use super::{Brought, HEAD_BIAS, STEP_OUT};
use crate::head::{Head, HeadRays};
use crate::lamp::{Lamp, Sight};

/// To the head a march starts this many cells towards the lamp: unlike sheared sums it has no blur but the cells' own.
const SEEN: f32 = 0.125;

/// Places that a lamp is brought to between two looks at whether to go on.
const PLACES_A_TICK: usize = 4096;

/// What stands in the way of a lamp.
pub struct Between<'a> {
    pub volume: &'a Volume,
    pub head: Option<(&'a Head, &'a HeadRays)>,
    /// The origin of the head's rays.
    pub center: Vec3,
}

/// What one lamp is from a place.
#[derive(Clone, Copy, Default)]
struct Received {
    /// T̃.
    t: f32,
    /// Irradiance at a normal, of a lamp of radiance 1.
    irradiance: f32,
    looks: u64,
}

impl Between<'_> {
    /// V, and τ up to the lamp, from `p` (world) but for the first `start` cells.
    fn look(&self, p: Vec3, sight: &Sight, start: f32) -> (f32, f32) {
        let omega = sight.direction.as_vec3();
        let distance = sight.distance as f32;
        let open = self.head.is_none_or(|(_, rays)| {
            // Roots are not shaded by the scalp that they stand on.
            let skip = HEAD_BIAS * 0.5 * rays.size().min_element();
            let from = p - self.center + skip * omega;
            distance <= skip
                || !rays.occluded(&Ray::new(from.into(), omega.into(), 0.0, distance - skip))
        });
        if !open {
            return (0.0, 0.0);
        }
        let length = distance / self.volume.cell - start;
        (1.0, self.volume.march(self.volume.to_cells(p) + start * omega, omega, length))
    }

    /// At `p`, and at a surface across `normal` if there is one.
    fn receive(&self, lamp: &Lamp, p: Vec3, normal: Option<Vec3>, start: f32) -> Received {
        let place = p.as_dvec3();
        let sights = lamp.directions(place);
        let mut received = Received { looks: sights.len() as u64, ..Received::default() };
        let solid_angle = if normal.is_some() { lamp.solid_angle(place) as f32 } else { 0.0 };
        for (sight, weight) in &sights {
            let weight = *weight as f32;
            let cosine = normal.map_or(1.0, |normal| normal.dot(sight.direction.as_vec3()));
            if cosine <= 0.0 {
                continue;
            }
            let (open, tau) = self.look(p, sight, start);
            let through = weight * open * (-tau).exp();
            received.t += through;
            received.irradiance += solid_angle * through * cosine;
        }
        received
    }
}

/// The transport of each of `lamps`, none of them a sun; see [`super::transport`]. `tick` is asked whether to go on.
pub fn transport(
    between: &Between,
    lamps: &[Lamp],
    samples: &[Vec3],
    tick: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<Brought>> {
    let head = between.head.map(|(head, _)| head);
    let vertices = head.map_or(&[][..], |head| &head.positions);
    let normals = head.map_or(&[][..], |head| &head.normals);
    let bring = |lamp: &Lamp| {
        let mut of_samples = Vec::with_capacity(samples.len());
        for places in samples.chunks(PLACES_A_TICK) {
            let of = |p: &Vec3| between.receive(lamp, *p, None, STEP_OUT);
            of_samples.par_extend(places.par_iter().map(of));
            if !tick() {
                return None;
            }
        }
        let of_head: Vec<_> = (vertices.par_iter().zip(normals))
            .map(|(&p, &normal)| between.receive(lamp, p, Some(normal), SEEN))
            .collect();
        Some(Brought {
            looks: of_samples.iter().chain(&of_head).map(|received| received.looks).sum(),
            samples: of_samples.iter().map(|received| received.t).collect(),
            head: of_head.iter().map(|received| received.irradiance).collect(),
        })
    };
    lamps.iter().map(bring).collect()
}
