//! The rays by which T̃ is found at strand points: which are drawn for a light, and from where. Twin of
//! shaders/transmittance.wgsl.

use std::f32::consts::TAU;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

use crate::hair::normals;
use crate::lamp::{Lamp, Shape};
use crate::srbf::SrbfLight;

/// Rays for a point of all lights together, at 64 samples a pixel.
pub const RAYS_A_POINT: f64 = 25.0;
/// Rays go as this power of a light's energy: the error of a sum of lights is least at ⅔, of those that shine where few
/// do at 1.
const POWER: f64 = 0.75;
/// Rays of a light for a block of points, at most.
const MOST_RAYS: f64 = 8.0;
/// Points that share the rays of a faint light, at most.
const MOST_POINTS: f64 = 16.0;

/// How many rays a light is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rays {
    /// For a block of points that follow each other on a strand.
    pub count: u32,
    /// Points of a block: a power of two.
    pub points: u32,
}

impl Rays {
    /// Shares out rays among lights of these powers (energies, in any unit), `times` as many as at 64 samples. Ordinates, if
    /// there are any, come last and have the same each, so that turned light leaves theirs as they were.
    pub fn of(powers: &[f64], ordinates: usize, times: f64) -> Vec<Rays> {
        let (own, even) = powers.split_at(powers.len() - ordinates);
        let mean = even.iter().sum::<f64>() / ordinates.max(1) as f64;
        let powers: Vec<f64> =
            own.iter().copied().chain(std::iter::repeat_n(mean, ordinates)).collect();
        let share = |power: &f64| power.powf(POWER);
        let whole: f64 = powers.iter().map(share).sum();
        let of = |power: &f64| {
            let wanted = RAYS_A_POINT * times * share(power) / whole.max(f64::MIN_POSITIVE);
            match wanted {
                0.75.. => {
                    let most = MOST_RAYS * times.max(1.0);
                    Rays { count: wanted.round().clamp(1.0, most) as u32, points: 1 }
                }
                _ => {
                    let points = (1.0 / wanted.max(1.0 / MOST_POINTS)).log2().round().exp2();
                    Rays { count: 1, points: points as u32 }
                }
            }
        };
        powers.iter().map(of).collect()
    }
}

/// A light as rays look for it: `TracedLight` of shaders/transmittance.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct TracedLight {
    /// Unit vector; of a lamp near the hair its centre, relative to that of the hair.
    pub direction: Vec3,
    /// Of a lamp a sphere's radius or half a side of a square.
    pub lambda: f32,
    /// Of a square: the unit vector along its level side; else 0.
    pub side: Vec3,
    /// 1 of a lamp.
    pub lamp: u32,
    /// Place among the words of a slot.
    pub column: u32,
    /// To be added.
    pub rays: u32,
    /// 1 to forget what is known.
    pub fresh: u32,
    pub pad: u32,
}

impl TracedLight {
    /// A lamp near the hair, whose centre is `middle` (world); None of a sun.
    pub fn near(lamp: &Lamp, middle: DVec3) -> Option<TracedLight> {
        let (place, size, side) = lamp.place()?;
        Some(TracedLight {
            direction: (place - middle).as_vec3(),
            lambda: size as f32,
            side: side.as_vec3(),
            lamp: 1,
            ..TracedLight::zeroed()
        })
    }

    /// A distant light.
    pub fn distant(light: &SrbfLight) -> TracedLight {
        TracedLight {
            direction: light.direction.as_vec3(),
            lambda: light.lambda as f32,
            ..TracedLight::zeroed()
        }
    }
}

/// Lights that places on the head look for by rays, at most.
pub const HEAD_LIGHTS: usize = 64;

/// A light that places on the head look for by rays: `HeadLight` of shaders/head_light.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct HeadLight {
    pub light: TracedLight,
    /// L_j, linear RGB.
    pub rgb: Vec3,
    /// E_j = ∫G_j dω; below 0 of a lamp near the hair, whose solid angle stands for it.
    pub energy: f32,
    /// 1 of a wide light: each vertex looks for it in directions of its own, and is evened out with those about it.
    pub wide: u32,
    pub pad: [u32; 3],
}

/// A place on the head: `HeadVertex` of shaders/head_light.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct HeadVertex {
    /// Relative to the hair's centre.
    pub position: Vec3,
    /// By which rays to wide lights are drawn.
    pub seed: u32,
    pub normal: Vec3,
    pub pad_2: u32,
    /// Bit by bit, from the lowest of the first, which lights are looked for.
    pub lights: [u32; 2],
    pub pad_3: [u32; 2],
}

impl HeadVertex {
    /// `position` relative to the hair's centre; `normal` of length 1.
    pub fn new(position: Vec3, normal: Vec3, seed: u32, lights: u64) -> HeadVertex {
        let lights = [lights as u32, (lights >> 32) as u32];
        HeadVertex { position, seed, normal, lights, ..HeadVertex::zeroed() }
    }

    pub fn looks_for(&self, light: usize) -> bool {
        self.lights[light / 32] >> (light % 32) & 1 == 1
    }
}

/// Points that follow each other on a strand and share their rays: `Block` of shaders/transmittance.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Block {
    /// The first of them, seen or not.
    pub point: u32,
    /// Place of its first seen point among all, times 32, and the number of those that are seen.
    pub members: u32,
    /// First and last point of the strand.
    pub own: [u32; 2],
}

impl Block {
    /// Places of the seen points.
    pub fn seen(&self) -> std::ops::Range<usize> {
        let first = (self.members >> 5) as usize;
        first..first + (self.members & 31) as usize
    }

    /// Where a ray of a block of `points` starts, on the axis: the point that is next, the one beyond, and the part of the
    /// way to it. `draw` in [0, 1): from half a segment before the first point to half a segment beyond the last.
    pub fn place(&self, points: u32, draw: f32) -> (u32, u32, f32) {
        let way = points as f32 * draw - 0.5;
        let point = (self.point + way.round_ties_even().max(0.0) as u32).min(self.own[1]);
        let aside = way - (point - self.point) as f32;
        let back = (aside < 0.0 && point > self.own[0]) || point == self.own[1];
        let other = if back { point.saturating_sub(1).max(self.own[0]) } else { point + 1 };
        (point, other, aside.abs().min(0.5))
    }
}

/// A direction to look for a light in, and how far; 0 where the light is dark.
#[derive(Clone, Copy, Debug)]
pub struct Aim {
    pub direction: Vec3,
    pub distance: f32,
}

/// Numbers in [0, 1) for ray `k` of a strand's block: two for the direction, one for the place. A lattice along the strand
/// and from ray to ray.
pub fn draw_of(strand: u32, block: u32, k: u32) -> [f32; 3] {
    const ALONG: [u32; 3] = [3_518_319_155, 2_882_110_345, 2_360_945_575];
    const AGAIN: [u32; 3] = [3_242_174_889, 2_447_445_413, 2_654_435_769];
    const SALT: [u32; 3] = [0, 0x5555_5555, 0xaaaa_aaaa];
    [0, 1, 2].map(|i| {
        let bits = hashed(strand ^ SALT[i])
            .wrapping_add(block.wrapping_mul(ALONG[i]))
            .wrapping_add(k.wrapping_mul(AGAIN[i]));
        (bits >> 8) as f32 * 2f32.powi(-24)
    })
}

/// PCG's permutation (O'Neill 2014).
pub fn hashed(key: u32) -> u32 {
    let state = key.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// Where to look for a light from `p`, relative to the hair's centre.
pub fn aim(light: &TracedLight, p: Vec3, [x, y, _]: [f32; 3]) -> Aim {
    match light.lamp {
        0 => {
            let half_lambda2 = 0.5 * light.lambda * light.lambda;
            let inner = 1.0 - x * (1.0 - (-2.0 / half_lambda2).exp());
            let drop = (-half_lambda2 * inner.ln()).clamp(0.0, 2.0);
            Aim { direction: about(light.direction, drop, y), distance: f32::INFINITY }
        }
        _ => lamp_aim(light.direction, light.lambda, light.side, p, [x, y]),
    }
}

/// Solid angle that a lamp near the hair covers from `p`, sr.
pub fn solid_angle(light: &TracedLight, p: Vec3) -> f32 {
    let (center, half) = (light.direction.as_dvec3(), f64::from(light.lambda));
    let shape = match light.side == Vec3::ZERO {
        true => Shape::Sphere { center, radius: half },
        false => Shape::Softbox { center, half },
    };
    let lamp = Lamp { shape, toward: center.normalize(), radiance: [1.0; 3] };
    lamp.solid_angle(p.as_dvec3()) as f32
}

/// At 1 − cosine `drop` and azimuth 2πu about `axis`.
fn about(axis: Vec3, drop: f32, u: f32) -> Vec3 {
    let (x, y) = normals(axis);
    let (sin, cos) = (TAU * u).sin_cos();
    let across = (drop * (2.0 - drop)).max(0.0).sqrt();
    (axis * (1.0 - drop) + across * (x * cos + y * sin)).normalize()
}

/// A direction in which a lamp near the hair shines on `p`, evenly over the solid angle that it covers.
fn lamp_aim(center: Vec3, size: f32, side: Vec3, p: Vec3, u: [f32; 2]) -> Aim {
    let to = center - p;
    let distance2 = to.length_squared().max(1e-30);
    if side == Vec3::ZERO {
        let sin2 = size * size / distance2;
        let all = if sin2 >= 1.0 { 2.0 } else { sin2 / (1.0 + (1.0 - sin2).max(0.0).sqrt()) };
        let direction = about(to / distance2.sqrt(), all * u[0], u[1]);
        let along = to.dot(direction);
        let deep = (size * size - (to - along * direction).length_squared()).max(0.0).sqrt();
        return Aim { direction, distance: if sin2 >= 1.0 { along + deep } else { along - deep } };
    }
    let normal = center.normalize();
    let up = normal.cross(side);
    let depth = to.dot(normal);
    // Evenly over the square, but for what the solid angle of a place there is less than that of the nearest.
    let nearest = [(-to).dot(side), (-to).dot(up)].map(|at| at.clamp(-size, size));
    let least = (to + nearest[0] * side + nearest[1] * up).length();
    let mut draw = u;
    let mut aim = Aim { direction: normal, distance: 0.0 };
    for tries in 0..8 {
        let [x, y] = draw.map(|draw| size * (2.0 * draw - 1.0));
        let toward = to + x * side + y * up;
        let distance = toward.length();
        aim.direction = toward / distance;
        aim.distance = if depth > 0.0 { distance } else { 0.0 };
        let chance = (97.0 * (draw[0] + draw[1]) + 0.618_034 * tries as f32).fract();
        if chance < (least / distance).powi(3) {
            break;
        }
        draw = [(draw[0] + 0.754_877_7).fract(), (draw[1] + 0.569_840_3).fract()];
    }
    aim
}

/// What is known of a pair of a point and a light: rays that were open, and all; and where strands are counted what packs
/// the rest of [`super::TransmittanceMoments`].
pub type Words = [u32; 2];

/// T̃: the share of rays that were open; 0 of none.
pub fn transmittance([counts, _]: Words) -> f64 {
    f64::from(counts & 0xffff) / f64::from((counts >> 16).max(1))
}

/// Adds a ray to words.
pub fn add(words: &mut Words, open: bool, counted: Option<[f32; 3]>) {
    words[0] += 0x1_0000 + u32::from(open);
    if let Some(own) = counted {
        let count = (words[0] >> 16) as f32;
        let before = unpack_means(words[1]);
        let means = [0, 1, 2].map(|i| before[i] + (own[i] - before[i]) / count);
        words[1] = pack_means(means);
    }
}

const MEANS_TOP: [f32; 3] = [255.0, 4095.0, 4095.0];

/// Means in 8, 12 and 12 bits.
pub fn pack_means(means: [f32; 3]) -> u32 {
    let [a, b, c] = [0, 1, 2].map(|i| (means[i].clamp(0.0, 1.0) * MEANS_TOP[i]).round() as u32);
    a | b << 8 | c << 20
}

pub fn unpack_means(bits: u32) -> [f32; 3] {
    let parts = [bits & 255, bits >> 8 & 4095, bits >> 20];
    [0, 1, 2].map(|i| parts[i] as f32 / MEANS_TOP[i])
}
