//! Distant light: an environment map as it is, or the SRBFs that stand for it.
//!
//! Both are sampled in proportion to their luminance, so that the density of a direction is its luminance over
//! the integral of luminance, whatever way it was drawn.

use std::f64::consts::{PI, TAU};

use anyhow::{Result, ensure};
use glam::{DVec3, Vec3};

use crate::environment::Environment;
use crate::image::luminance;
use crate::srbf::{SrbfLight, direction_in_lobe};

/// Light from all around.
pub struct Light<'a> {
    source: Source<'a>,
    /// ∫ of luminance over the sphere.
    power: f64,
}

enum Source<'a> {
    Map(Map<'a>),
    Lobes(Lobes),
}

/// A direction drawn.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit vector towards the light, world frame.
    pub direction: DVec3,
    /// Linear RGB from there.
    pub radiance: DVec3,
    /// Its density, 1/sr, > 0.
    pub pdf: f64,
}

impl<'a> Light<'a> {
    /// The map, each pixel of one radiance, turned by `rotation_rad` about +y and multiplied by `scale`.
    ///
    /// # Errors
    /// One line, if the map's light is not finite or not positive.
    pub fn map(map: &'a Environment, rotation_rad: f64, scale: f64) -> Result<Light<'a>> {
        let map = Map::new(map, rotation_rad, scale);
        let power = map.rows.last().copied().unwrap_or(0.0);
        Light { source: Source::Map(map), power }.checked("the environment map")
    }

    /// The sum of SRBF lights (world frame).
    ///
    /// # Errors
    /// One line, if the lights' energy is not finite or not positive.
    pub fn lobes(lights: &[SrbfLight]) -> Result<Light<'static>> {
        let lobes = Lobes::new(lights);
        let power = lobes.ends.last().copied().unwrap_or(0.0);
        Light { source: Source::Lobes(lobes), power }.checked("the SRBF light")
    }

    fn checked(self, name: &str) -> Result<Self> {
        ensure!(
            self.power.is_finite() && self.power >= 0.0,
            "{name} has a total luminance of {}: mend its NaN, infinite and negative values first",
            self.power
        );
        Ok(self)
    }

    /// Linear RGB radiance from unit `omega` (world frame).
    pub fn radiance(&self, omega: DVec3) -> DVec3 {
        match &self.source {
            Source::Map(map) => map.radiance(omega),
            Source::Lobes(lobes) => lobes.radiance(omega),
        }
    }

    /// Density of [`Self::sample`] at a direction of this radiance, 1/sr; 0 if there is no light at all.
    pub fn pdf(&self, radiance: DVec3) -> f64 {
        if self.power > 0.0 { luminance_of(radiance) / self.power } else { 0.0 }
    }

    /// Draws a direction from two uniform numbers in [0, 1); None where there is no light.
    pub fn sample(&self, u: [f64; 2]) -> Option<LightSample> {
        if self.power <= 0.0 {
            return None;
        }
        let (direction, radiance) = match &self.source {
            Source::Map(map) => map.sample(u),
            Source::Lobes(lobes) => lobes.sample(u),
        };
        let pdf = self.pdf(radiance);
        (pdf > 0.0).then_some(LightSample { direction, radiance, pdf })
    }
}

fn luminance_of(radiance: DVec3) -> f64 {
    luminance(radiance.as_vec3().to_array()).into()
}

struct Map<'a> {
    map: &'a Environment,
    scale: f64,
    /// Sine and cosine of the rotation.
    turn: (f64, f64),
    /// y of the rows' edges; length: height + 1.
    edges: Vec<f64>,
    /// Running sums of the rows' luminance × solid angle; length: height.
    rows: Vec<f64>,
    /// The same within each row, over the row's sum: rising to 1; length: width · height.
    columns: Vec<f32>,
}

impl<'a> Map<'a> {
    fn new(map: &'a Environment, rotation_rad: f64, scale: f64) -> Self {
        let mut rows = Vec::with_capacity(map.height);
        let mut columns = Vec::with_capacity(map.pixels.len());
        let mut power = 0.0;
        for (row, pixels) in map.pixels.chunks_exact(map.width).enumerate() {
            let total: f64 = pixels.iter().map(|&rgb| f64::from(luminance(rgb))).sum();
            let mut sum = 0.0;
            columns.extend(pixels.iter().map(|&rgb| {
                sum += f64::from(luminance(rgb));
                (sum / total) as f32
            }));
            power += scale * total * map.solid_angle(row);
            rows.push(power);
        }
        let edge = |row: usize| (PI * row as f64 / map.height as f64).cos();
        let edges = (0..=map.height).map(edge).collect();
        Self { map, scale, turn: rotation_rad.sin_cos(), edges, rows, columns }
    }

    fn pixel(&self, row: usize, column: usize) -> DVec3 {
        self.scale * Vec3::from(self.map.pixels[row * self.map.width + column]).as_dvec3()
    }

    fn radiance(&self, omega: DVec3) -> DVec3 {
        // As in shaders/resolve.wgsl. f32 errs by a thousandth of a pixel of the largest map.
        let (s, c) = self.turn;
        let x = (c * omega.x - s * omega.z) as f32;
        let z = (s * omega.x + c * omega.z) as f32;
        let u = 0.5 + x.atan2(-z) / std::f32::consts::TAU;
        let v = x.hypot(z).atan2(omega.y as f32) / std::f32::consts::PI;
        let column = (u * self.map.width as f32) as usize;
        let row = (v * self.map.height as f32) as usize;
        self.pixel(row.min(self.map.height - 1), column.min(self.map.width - 1))
    }

    fn sample(&self, [across, down]: [f64; 2]) -> (DVec3, DVec3) {
        let (width, height) = (self.map.width, self.map.height);
        let (row, down) = find(&self.rows, down * self.rows[height - 1]);
        let columns = &self.columns[row * width..(row + 1) * width];
        let (column, across) = find(columns, across);
        // Uniform in solid angle within the pixel.
        let y = self.edges[row] + down * (self.edges[row + 1] - self.edges[row]);
        let across = TAU * ((column as f64 + across) / width as f64 - 0.5);
        let (sin, cos) = across.sin_cos();
        let level = (1.0 - y * y).max(0.0).sqrt();
        let d = DVec3::new(level * sin, y, -level * cos);
        let (s, c) = self.turn;
        let world = DVec3::new(c * d.x + s * d.z, d.y, c * d.z - s * d.x);
        (world, self.pixel(row, column))
    }
}

struct Lobes {
    lobes: Vec<Lobe>,
    /// Running sums of the lobes' luminance integrals.
    ends: Vec<f64>,
}

struct Lobe {
    direction: Vec3,
    /// 1/λ².
    falloff: f32,
    rgb: Vec3,
    light: SrbfLight,
}

/// A lobe ends where it is e^−40 of its peak.
const LOBE_END: f32 = 40.0;

impl Lobes {
    fn new(lights: &[SrbfLight]) -> Self {
        let mut power = 0.0;
        let ends = lights.iter().map(|light| {
            power += luminance_of(DVec3::from(light.energy()));
            power
        });
        let lobes = lights.iter().map(|light| Lobe {
            direction: light.direction.as_vec3(),
            falloff: (light.lambda * light.lambda).recip() as f32,
            rgb: DVec3::from(light.rgb).as_vec3(),
            light: *light,
        });
        Self { ends: ends.collect(), lobes: lobes.collect() }
    }

    fn radiance(&self, omega: DVec3) -> DVec3 {
        let omega = omega.as_vec3();
        let mut sum = Vec3::ZERO;
        for lobe in &self.lobes {
            // By the chord, which keeps its digits where the lobe is narrow.
            let drop = (omega - lobe.direction).length_squared() * lobe.falloff;
            if drop < LOBE_END {
                sum += lobe.rgb * (-drop).exp();
            }
        }
        sum.as_dvec3()
    }

    fn sample(&self, [choice, along]: [f64; 2]) -> (DVec3, DVec3) {
        let (j, around) = find(&self.ends, choice * self.ends[self.ends.len() - 1]);
        let direction = direction_in_lobe(&self.lobes[j].light, [along, around]);
        (direction, self.radiance(direction))
    }
}

/// The first entry of rising `ends` above `value`, and where `value` lies between the one before and it, in
/// [0, 1).
fn find<T: Copy + Into<f64>>(ends: &[T], value: f64) -> (usize, f64) {
    let i = ends.partition_point(|&end| end.into() <= value).min(ends.len() - 1);
    let start = if i > 0 { ends[i - 1].into() } else { 0.0 };
    let share = (value - start) / (ends[i].into() - start);
    (i, if share < 1.0 { share } else { 0.5 })
}
