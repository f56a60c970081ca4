//! A light meter: how bright a grey card would be in the hair's place, as the camera would see it.

use std::f64::consts::PI;

use glam::DVec3;

use super::{Environment, luminance};

/// Longest side of the map that is metered: a diffuse surface blurs light over a quarter turn.
const SIDE: usize = 64;
/// Places on the sphere that are metered.
const PLACES: usize = 64;
/// A place on the sphere counts as no darker than this share of the map's mean: light from behind alone would ask for
/// an endless exposure.
const DARKEST: f64 = 0.1;

/// Meters the light of a map on a diffuse sphere in the hair's place.
#[derive(Clone, Debug)]
pub struct LightMeter {
    /// Direction of each pixel of a smaller map, and its luminance times its solid angle.
    light: Vec<(DVec3, f64)>,
}

impl LightMeter {
    pub fn new(map: &Environment) -> LightMeter {
        let small = map.shrunk(SIDE);
        let pixel = |(i, rgb): (usize, &[f32; 3])| {
            let (column, row) = (i % small.width, i / small.width);
            let light = luminance(rgb.map(f64::from).into()) * small.solid_angle(row);
            (small.pixel_direction(column, row), light)
        };
        LightMeter { light: small.pixels.iter().enumerate().map(pixel).collect() }
    }

    /// What to expose for, seen from the unit direction `eye` in the map's own frame: halfway, in stops, between a sphere
    /// of albedo 1 (Lambert), as the geometric mean over its disc, so that its shadows count as much as what is lit,
    /// and the mean radiance of the map. Exposed for the sphere alone, hair that is lit from behind would lose the
    /// colour of its rim; for the mean alone, it would be black before it. 1 under a map of 1; 0 under a black one.
    pub fn luminance(&self, eye: DVec3) -> f64 {
        let mean = self.light.iter().map(|(_, light)| light).sum::<f64>() / (4.0 * PI);
        if mean == 0.0 {
            return 0.0;
        }
        let (across, up) = eye.any_orthonormal_pair();
        let logarithms = (0..PLACES).map(|i| {
            // A sunflower: places of equal area on the disc.
            let radius = ((i as f64 + 0.5) / PLACES as f64).sqrt();
            let (sin, cos) = (i as f64 * PI * (3.0 - 5f64.sqrt())).sin_cos();
            let normal = radius * (cos * across + sin * up) + (1.0 - radius * radius).sqrt() * eye;
            let lit = self.light.iter().map(|(omega, light)| omega.dot(normal).max(0.0) * light);
            (lit.sum::<f64>() / PI).max(DARKEST * mean).ln()
        });
        let sphere = (logarithms.sum::<f64>() / PLACES as f64).exp();
        (sphere * mean).sqrt()
    }
}
