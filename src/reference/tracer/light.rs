//! Distant light, an environment map as it is or the SRBFs that stand for it; and lamps, as they are.
//!
//! Map and SRBFs are sampled in proportion to their luminance, so that the density of a direction is its luminance over
//! the integral of luminance, whatever way it was drawn.

use std::f64::consts::{PI, TAU};

use anyhow::{Result, ensure};
use glam::{DVec3, Vec3};

use crate::environment::Environment;
use crate::image::luminance;
use crate::lamp::{Lamp, Sight};
use crate::scene::LAMPS;
use crate::srbf::{SrbfLight, direction_in_lobe};

/// Light from all around, and lamps, which neither shade nor are seen.
pub struct Light<'a> {
    source: Source<'a>,
    /// ∫ of luminance over the sphere.
    power: f64,
    /// At most [`LAMPS`].
    lamps: Vec<Lamp>,
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
    /// How far it may be seen from: infinite but for lamps near the hair.
    pub distance: f64,
}

/// ∫ of luminance that comes to a place from all around and from each lamp, and its sum.
pub struct Shares {
    far: f64,
    lamps: [f64; LAMPS],
    total: f64,
}

impl<'a> Light<'a> {
    /// The map, each pixel of one radiance, turned by `rotation_rad` about +y and multiplied by `scale`.
    ///
    /// # Errors
    /// One line, if the map's light is not finite or not positive.
    pub fn map(map: &'a Environment, rotation_rad: f64, scale: f64) -> Result<Light<'a>> {
        let (map, power) = Map::new(map, rotation_rad, scale);
        Light { source: Source::Map(map), power, lamps: Vec::new() }.checked("the environment map")
    }

    /// The sum of SRBF lights (world frame).
    ///
    /// # Errors
    /// One line, if the lights' energy is not finite or not positive.
    pub fn lobes(lights: &[SrbfLight]) -> Result<Light<'static>> {
        let (lobes, power) = Lobes::new(lights);
        Light { source: Source::Lobes(lobes), power, lamps: Vec::new() }.checked("the SRBF light")
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
        (pdf > 0.0).then_some(LightSample { direction, radiance, pdf, distance: f64::INFINITY })
    }

    /// The same with up to [`LAMPS`] lamps, where `center` is the origin.
    pub fn with_lamps(self, lamps: &[Lamp], center: Vec3) -> Self {
        let lamps = lamps.iter().take(LAMPS).map(|lamp| lamp.moved(-center.as_dvec3()));
        Light { lamps: lamps.collect(), ..self }
    }

    /// What comes to `p`: what [`Self::draw`] chooses by.
    pub fn shares(&self, p: DVec3) -> Shares {
        let of = |lamp: &Lamp| luminance_of(lamp.radiance.into()) * lamp.solid_angle(p);
        let lamps = std::array::from_fn(|k| self.lamps.get(k).map_or(0.0, of));
        let far = self.power;
        Shares { far, lamps, total: far + lamps.iter().sum::<f64>() }
    }

    /// The density with which [`Self::draw`] draws a direction of this distant radiance.
    pub fn far_pdf(&self, shares: &Shares, radiance: DVec3) -> f64 {
        if shares.total > 0.0 { self.pdf(radiance) * (shares.far / shares.total) } else { 0.0 }
    }

    /// Draws light that may come to `p`, all from afar or all of one lamp, by its share; None where there is none.
    pub fn draw(
        &self,
        p: DVec3,
        shares: &Shares,
        [choice, along]: [f64; 2],
    ) -> Option<LightSample> {
        if shares.total <= 0.0 {
            return None;
        }
        let mut left = choice * shares.total;
        for (lamp, &share) in self.lamps.iter().zip(&shares.lamps) {
            if left < share {
                let sight = lamp.draw(p, [(left / share).min(1.0 - f64::EPSILON), along])?;
                return Some(of_lamp(lamp, sight, share / shares.total));
            }
            left -= share;
        }
        let rest = if self.lamps.is_empty() { choice } else { left / shares.far };
        let far = self.sample([rest.clamp(0.0, 1.0 - f64::EPSILON), along])?;
        Some(LightSample { pdf: far.pdf * (shares.far / shares.total), ..far })
    }

    /// Lamps that shine on `p` from unit `omega`, with the density of [`Self::draw`].
    pub fn lamps_along(
        &self,
        p: DVec3,
        shares: &Shares,
        omega: DVec3,
    ) -> impl Iterator<Item = LightSample> {
        let met = self.lamps.iter().zip(shares.lamps).filter(|(_, share)| *share > 0.0);
        met.filter_map(move |(lamp, share)| {
            Some(of_lamp(lamp, lamp.meet(p, omega)?, share / shares.total))
        })
    }
}

fn of_lamp(lamp: &Lamp, sight: Sight, share: f64) -> LightSample {
    let Sight { direction, distance, pdf } = sight;
    LightSample { direction, radiance: lamp.radiance.into(), pdf: pdf * share, distance }
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
    /// Of luminance × solid angle.
    rows: Steps,
    /// Of luminance, row by row.
    columns: Vec<Steps>,
}

impl<'a> Map<'a> {
    /// The map, and ∫ of its luminance.
    fn new(map: &'a Environment, rotation_rad: f64, scale: f64) -> (Self, f64) {
        let sum =
            |pixels: &[[f32; 3]]| pixels.iter().map(|&p| f64::from(luminance(p))).sum::<f64>();
        let rows = map.pixels.chunks_exact(map.width);
        let powers: Vec<f64> = rows
            .clone()
            .enumerate()
            .map(|(row, p)| scale * sum(p) * map.solid_angle(row))
            .collect();
        let columns =
            rows.map(|p| Steps::new(p.iter().map(|&rgb| f64::from(luminance(rgb))))).collect();
        let edge = |row: usize| (PI * row as f64 / map.height as f64).cos();
        let edges = (0..=map.height).map(edge).collect();
        let rows = Steps::new(powers.iter().copied());
        let turn = rotation_rad.sin_cos();
        (Self { map, scale, turn, edges, rows, columns }, powers.iter().sum())
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
        let width = self.map.width;
        let (row, down) = self.rows.find(down);
        let (column, across) = self.columns[row].find(across);
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
    /// Of the lobes' luminance integrals.
    steps: Steps,
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
    /// The lobes, and ∫ of their luminance.
    fn new(lights: &[SrbfLight]) -> (Self, f64) {
        let powers: Vec<f64> =
            lights.iter().map(|light| luminance_of(DVec3::from(light.energy()))).collect();
        let steps = Steps::new(powers.iter().copied());
        let lobes = lights.iter().map(|light| Lobe {
            direction: light.direction.as_vec3(),
            falloff: (light.lambda * light.lambda).recip() as f32,
            rgb: DVec3::from(light.rgb).as_vec3(),
            light: *light,
        });
        (Self { steps, lobes: lobes.collect() }, powers.iter().sum())
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
        let (j, around) = self.steps.find(choice);
        let direction = direction_in_lobe(&self.lobes[j].light, [along, around]);
        (direction, self.radiance(direction))
    }
}

/// A choice among weighted entries, by the inverse of their running sums.
struct Steps {
    /// Running sums over the whole sum: rising to 1.
    ends: Vec<f32>,
    /// For each of as many equal parts of [0, 1) the first entry whose end lies above the part's start
    /// (Chen and Asau 1974), so that few ends are looked at.
    guide: Vec<u32>,
}

impl Steps {
    fn new(weights: impl ExactSizeIterator<Item = f64> + Clone) -> Steps {
        let count = weights.len();
        let whole: f64 = weights.clone().sum();
        let ends = weights.scan(0.0, |sum, weight| {
            *sum += weight;
            Some((*sum / whole) as f32)
        });
        let ends: Vec<f32> = ends.collect();
        let first = |part: usize| {
            let start = (part as f64 / count as f64) as f32;
            ends.partition_point(|&end| end <= start).min(count - 1) as u32
        };
        Steps { guide: (0..count).map(first).collect(), ends }
    }

    /// The entry for `u` in [0, 1), and where between its ends u lies, in [0, 1).
    fn find(&self, u: f64) -> (usize, f64) {
        let count = self.ends.len();
        let mut i = self.guide[((u * count as f64) as usize).min(count - 1)] as usize;
        while i + 1 < count && f64::from(self.ends[i]) <= u {
            i += 1;
        }
        let start = if i > 0 { f64::from(self.ends[i - 1]) } else { 0.0 };
        let share = (u - start) / (f64::from(self.ends[i]) - start);
        (i, if (0.0..1.0).contains(&share) { share } else { 0.5 })
    }
}
