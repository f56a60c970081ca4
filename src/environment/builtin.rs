//! The built-in maps, made by formula: `studio`, `sunset`, `overcast`, `night`.
//!
//! Each is scaled to a stated mean luminance (Rec. 709, weighted by solid angle), so that a groom
//! under one compares with a groom under another at the same exposure. Sun and moon are discs of
//! 0.53° whose energy is exact at any resolution: pixels hold the covered share, scaled so that the
//! disc's solid angle comes out as 2π(1 − cos r). The subject's head is at the origin, the usual
//! camera on +z looking along −z.

use std::f64::consts::{PI, TAU};

use anyhow::{Result, anyhow};
use glam::DVec3;
use rayon::prelude::*;

use super::{Environment, SourceInfo, luminance, uv_to_direction};

const WIDTH: usize = 512;
const HEIGHT: usize = 256;
/// Samples along each side of a pixel.
const SUBSAMPLES: usize = 2;
/// Angular radius of the sun and, near enough, of the moon.
const DISC_RADIUS: f64 = 0.2666 * PI / 180.0;

struct Builtin {
    name: &'static str,
    mean_luminance: f64,
    make: fn() -> Environment,
}

const BUILTINS: [Builtin; 4] = [
    Builtin { name: "studio", mean_luminance: 1.0, make: studio },
    Builtin { name: "sunset", mean_luminance: 0.8, make: sunset },
    Builtin { name: "overcast", mean_luminance: 1.0, make: overcast },
    Builtin { name: "night", mean_luminance: 0.15, make: night },
];

/// The built-in map of this name; the same bits each time on one machine.
pub fn build(name: &str) -> Result<(Environment, SourceInfo)> {
    let builtin = BUILTINS.iter().find(|b| b.name == name).ok_or_else(|| {
        let names = BUILTINS.map(|b| format!("builtin:{}", b.name));
        anyhow!("is no built-in map; choose one of {}", names.join(", "))
    })?;
    let mut environment = (builtin.make)();
    let scale = (builtin.mean_luminance / luminance(environment.mean_radiance().into())) as f32;
    for value in environment.pixels.as_flattened_mut() {
        *value *= scale;
    }
    let info = SourceInfo {
        format: "built-in",
        channels: "RGB".to_owned(),
        compression: "none",
        ..SourceInfo::default()
    };
    Ok((environment, info))
}

/// A photographer's room: a large soft key in front on the left, a dim fill on the right, two tall
/// rims and a top light behind, before a backdrop with a pool of light. Walls and floor are lit by
/// the panels (one bounce, plus a constant for the rest).
fn studio() -> Environment {
    let warm = DVec3::new(1.05, 0.99, 0.90);
    let neutral = DVec3::new(1.0, 1.0, 1.0);
    let cool = DVec3::new(0.92, 0.99, 1.10);
    let panels = [
        Panel::new(DVec3::new(-1.45, 0.95, 1.55), 0.80, 0.80, 13.0 * warm),
        Panel::new(DVec3::new(2.25, 0.25, 1.15), 0.75, 1.00, 2.6 * neutral),
        Panel::new(DVec3::new(-2.05, 0.45, -1.45), 0.22, 1.05, 15.0 * cool),
        Panel::new(DVec3::new(2.00, 0.45, -1.55), 0.22, 1.05, 15.0 * cool),
        Panel::new(DVec3::new(0.00, 1.75, -0.55), 0.50, 0.30, 9.0 * neutral),
    ];
    let (low, high) = (DVec3::new(-3.4, -1.6, -3.2), DVec3::new(3.4, 2.6, 4.2));
    render(|direction| {
        for panel in &panels {
            // Panels do not overlap as seen from the head.
            let share = panel.coverage(direction);
            if share > 0.99 {
                return panel.seen(direction);
            }
        }
        let point = exit_point(direction, low, high);
        let backdrop = point.z < low.z + 1e-9;
        let (normal, albedo) = if backdrop {
            (DVec3::Z, 0.30)
        } else if point.y < low.y + 1e-9 {
            (DVec3::Y, 0.08)
        } else if point.y > high.y - 1e-9 {
            (-DVec3::Y, 0.07)
        } else if point.z > high.z - 1e-9 {
            (-DVec3::Z, 0.12)
        } else {
            (DVec3::new(-point.x.signum(), 0.0, 0.0), 0.12)
        };
        let irradiance: DVec3 = panels.iter().map(|panel| panel.irradiance(point, normal)).sum();
        let mut radiance = albedo / PI * irradiance + DVec3::new(0.018, 0.019, 0.021);
        if backdrop {
            let pool = ((point.x / 1.5).powi(2) + ((point.y + 0.1) / 1.25).powi(2)) * -0.5;
            radiance += 0.35 * pool.exp() * neutral;
        }
        for panel in &panels {
            radiance = radiance.lerp(panel.seen(direction), panel.coverage(direction));
        }
        radiance
    })
}

/// A softbox that faces the origin: a rectangle with rounded corners, soft edges and a brighter
/// middle.
struct Panel {
    centre: DVec3,
    right: DVec3,
    up: DVec3,
    half_width: f64,
    half_height: f64,
    radiance: DVec3,
}

impl Panel {
    fn new(centre: DVec3, half_width: f64, half_height: f64, radiance: DVec3) -> Self {
        let right = centre.cross(DVec3::Y).normalize();
        let up = right.cross(centre).normalize();
        Self { centre, right, up, half_width, half_height, radiance }
    }

    /// Where a ray from the origin meets the panel's plane, in its own axes from its centre.
    fn hit(&self, direction: DVec3) -> Option<(f64, f64)> {
        let along = direction.dot(self.centre) / self.centre.length_squared();
        (along > 0.0).then(|| {
            let offset = direction / along - self.centre;
            (offset.dot(self.right), offset.dot(self.up))
        })
    }

    /// 1 on the panel, 0 off it, soft over the last 5 cm.
    fn coverage(&self, direction: DVec3) -> f64 {
        const ROUNDING: f64 = 0.10;
        let Some((x, y)) = self.hit(direction) else {
            return 0.0;
        };
        let (dx, dy) =
            (x.abs() - self.half_width + ROUNDING, y.abs() - self.half_height + ROUNDING);
        let distance = dx.max(0.0).hypot(dy.max(0.0)) + dx.max(dy).min(0.0) - ROUNDING;
        1.0 - smoothstep(-0.05, 0.0, distance)
    }

    fn seen(&self, direction: DVec3) -> DVec3 {
        self.hit(direction).map_or(DVec3::ZERO, |(x, y)| {
            let (x, y) = (x / self.half_width, y / self.half_height);
            self.radiance * (0.62 + 0.38 * (-1.2 * (x * x + y * y)).exp())
        })
    }

    /// Irradiance on a wall, from 3 × 3 samples over the panel's front.
    fn irradiance(&self, point: DVec3, normal: DVec3) -> DVec3 {
        let facing = -self.centre.normalize();
        let area = 4.0 * self.half_width * self.half_height;
        let mut sum = 0.0;
        for y in [-2.0 / 3.0, 0.0, 2.0 / 3.0] {
            for x in [-2.0 / 3.0, 0.0, 2.0 / 3.0] {
                let source =
                    self.centre + x * self.half_width * self.right + y * self.half_height * self.up;
                let to_source = source - point;
                let squared = to_source.length_squared();
                let cosines = normal.dot(to_source).max(0.0) * facing.dot(-to_source).max(0.0);
                sum += cosines / (squared * squared);
            }
        }
        0.8 * self.radiance * area * sum / 9.0
    }
}

/// Where a ray from the origin leaves a box around it.
fn exit_point(direction: DVec3, low: DVec3, high: DVec3) -> DVec3 {
    let distance = (0..3)
        .filter(|&axis| direction[axis] != 0.0)
        .map(|axis| (if direction[axis] > 0.0 { high[axis] } else { low[axis] }) / direction[axis])
        .fold(f64::INFINITY, f64::min);
    distance * direction
}

/// A clear evening: the sun 7° above far hills, behind the subject on the right, thin clouds, dry
/// ground.
fn sunset() -> Environment {
    let sun = DVec3::new(0.62, 0.123, -0.78).normalize();
    let sun_colour = DVec3::new(1.0, 0.60, 0.27);
    let ground_light = DVec3::new(0.85, 0.62, 0.45);
    let mut environment = render(|direction| {
        let azimuth_cos = on_ring(direction).dot(on_ring(sun));
        let toward_sun = (0.5 + 0.5 * azimuth_cos).powf(1.6);
        let sky = |height: f64| {
            let zenith = DVec3::new(0.055, 0.105, 0.24);
            let middle =
                DVec3::new(0.19, 0.20, 0.27).lerp(DVec3::new(0.52, 0.37, 0.27), toward_sun);
            let horizon =
                DVec3::new(0.36, 0.24, 0.27).lerp(DVec3::new(1.9, 0.80, 0.24), toward_sun);
            let sun_angle = direction.dot(sun).clamp(-1.0, 1.0).acos();
            let glow = 9.0 * (-sun_angle / 0.045).exp() * DVec3::new(1.0, 0.68, 0.36)
                + 1.6 * (-sun_angle / 0.22).exp() * DVec3::new(1.0, 0.58, 0.25);
            zenith.lerp(middle, (-height / 0.38).exp()).lerp(horizon, (-height / 0.10).exp()) + glow
        };
        let elevation = direction.y;
        let ridge = |base: f64, height: f64, frequency: f64, seed: f64| {
            base + height * (fbm(on_ring(direction) * frequency + seed) - 0.5)
        };
        if elevation > 0.15 || elevation > ridge(0.050, 0.13, 3.0, 11.0) {
            let clear = sky(elevation);
            // Streaks on a layer overhead, stretched along x.
            let layer = DVec3::new(direction.x * 0.55, 0.0, direction.z * 1.5) / (elevation + 0.10);
            let streaks = fbm(layer * 0.9 + 5.0 + 0.8 * fbm(layer * 0.5));
            let cover = smoothstep(0.50, 0.78, streaks) * smoothstep(0.03, 0.16, elevation);
            let lit =
                DVec3::new(0.30, 0.23, 0.28).lerp(DVec3::new(1.7, 0.82, 0.38), toward_sun.powi(2));
            clear.lerp(lit + 0.3 * clear, 0.75 * cover)
        } else {
            let haze = sky(0.0);
            let soil = DVec3::new(0.10, 0.085, 0.065) * ground_light;
            if elevation > 0.0 && elevation > ridge(0.022, 0.06, 7.0, 47.0) {
                soil.lerp(haze, 0.34)
            } else if elevation > 0.0 {
                (0.7 * soil).lerp(haze, 0.16)
            } else {
                let texture = 0.6 + 0.8 * fbm(direction / (0.06 - elevation) * 1.5);
                let distance_haze =
                    0.12 * (elevation / 0.03).exp() + 0.04 * (elevation / 0.25).exp();
                (soil * texture).lerp(haze, distance_haze)
            }
        }
    });
    // 5.5 units of irradiance facing the sun: a little over half of the map's light, as at this
    // height.
    add_disc(&mut environment, sun, 5.5 * sun_colour);
    environment
}

/// The CIE standard overcast sky, L = L_zenith (1 + 2 sin elevation)/3, faintly mottled, over grey
/// ground of albedo 0.2 that it lights (E = 7π/9 L_zenith).
fn overcast() -> Environment {
    let sky_colour = DVec3::new(0.965, 1.0, 1.06);
    let ground_colour = DVec3::new(0.205, 0.20, 0.185);
    render(|direction| {
        let elevation = direction.y;
        let layer = DVec3::new(direction.x, 0.3, direction.z) / (elevation.abs() + 0.35);
        let mottling = 1.0 + 0.30 * (fbm(layer * 1.6 + 3.0) - 0.5);
        let sky = sky_colour * mottling * (1.0 + 2.0 * elevation.max(0.0)) / 3.0;
        let texture = 0.9 + 0.2 * fbm(direction / (0.08 + elevation.abs()) * 1.3 + 9.0);
        let distance_haze = 0.35 * (elevation.min(0.0) / 0.04).exp();
        let ground = (ground_colour * sky_colour * 7.0 / 9.0 * texture)
            .lerp(sky_colour / 3.0, distance_haze);
        ground.lerp(sky, smoothstep(-0.006, 0.006, elevation))
    })
}

/// A street at night: a dim blue sky with a moon in front on the left, a skyline with lit windows,
/// and warm lamps that light the ground below them.
fn night() -> Environment {
    const GROUND: f64 = -1.6;
    let moon = DVec3::new(-0.50, 0.62, 0.60).normalize();
    let lamp_colour = DVec3::new(1.0, 0.60, 0.26);
    // Positions in metres from the head; each is a globe of 12 cm.
    let lamps = [
        DVec3::new(2.6, 1.35, -2.3),
        DVec3::new(-3.8, 1.45, -3.4),
        DVec3::new(4.6, 1.40, 2.6),
        DVec3::new(-1.6, 1.55, -8.5),
        DVec3::new(-7.5, 1.55, 3.5),
    ];
    let (lamp_radius, lamp_radiance) = (0.12, 260.0);
    let mut environment = render(|direction| {
        let elevation = direction.y;
        let azimuth = (direction.x.atan2(-direction.z) / TAU).rem_euclid(1.0);
        let city_glow = 0.5 + 0.5 * (TAU * (azimuth - 0.08)).cos();
        let mut radiance = if elevation > skyline(azimuth) {
            let zenith = DVec3::new(0.008, 0.013, 0.030);
            let horizon =
                DVec3::new(0.032, 0.043, 0.072) + 0.10 * city_glow * DVec3::new(1.0, 0.56, 0.28);
            let moon_angle = direction.dot(moon).clamp(-1.0, 1.0).acos();
            let halo = 0.35 * (-moon_angle / 0.03).exp() + 0.03 * (-moon_angle / 0.25).exp();
            zenith.lerp(horizon, (-elevation / 0.16).exp())
                + halo * DVec3::new(0.75, 0.86, 1.0)
                + star(direction)
        } else if elevation > -0.02 {
            DVec3::new(0.010, 0.011, 0.014) + window(azimuth, elevation)
        } else {
            let point = direction * GROUND / elevation;
            let irradiance: f64 = lamps
                .iter()
                .map(|&lamp| {
                    let to_lamp = lamp - point;
                    let intensity = lamp_radiance * PI * lamp_radius * lamp_radius;
                    intensity * to_lamp.y / to_lamp.length_squared().powf(1.5)
                })
                .sum();
            let texture = 0.7 + 0.6 * fbm(point * 2.5);
            let asphalt = 0.07 * texture / PI;
            asphalt * (irradiance * lamp_colour + DVec3::new(0.10, 0.13, 0.22))
        };
        for lamp in lamps {
            let distance = lamp.length();
            let angle = direction.dot(lamp / distance).clamp(-1.0, 1.0).acos();
            let radius = lamp_radius / distance;
            let globe = 1.0 - smoothstep(0.8 * radius, 1.2 * radius, angle);
            radiance +=
                lamp_colour * (lamp_radiance * globe + 0.5 * (-angle / (2.0 * radius)).exp());
        }
        radiance
    });
    add_disc(&mut environment, moon, 0.55 * DVec3::new(0.78, 0.88, 1.0));
    environment
}

/// Height of the houses (as y of a direction) over azimuth in turns.
fn skyline(azimuth: f64) -> f64 {
    let house = (azimuth * 34.0).floor();
    let gap = hash(house as i64, 7, 1) < 0.22;
    if gap { 0.025 } else { 0.06 + 0.20 * hash(house as i64, 3, 2).powf(1.5) }
}

/// Light of the lit windows in the houses.
fn window(azimuth: f64, elevation: f64) -> DVec3 {
    let (column, row) = (azimuth * 238.0, elevation * 42.0);
    let (x, y) = (column.rem_euclid(1.0), row.rem_euclid(1.0));
    let cell = (column.floor() as i64, row.floor() as i64);
    let below_roof = elevation < skyline(azimuth) - 0.015;
    let inside =
        (0.25..0.8).contains(&x) && (0.2..0.75).contains(&y) && elevation > 0.015 && below_roof;
    if !inside || hash(cell.0, cell.1, 3) > 0.24 {
        return DVec3::ZERO;
    }
    let warmth = hash(cell.0, cell.1, 4);
    let colour = DVec3::new(1.0, 0.66, 0.34)
        .lerp(DVec3::new(0.85, 0.92, 1.0), (2.0 * warmth - 1.2).max(0.0));
    colour * (0.25 + 1.1 * hash(cell.0, cell.1, 5).powi(2))
}

/// Light of the stars: one in a few of the cells, a third of a degree each way.
fn star(direction: DVec3) -> DVec3 {
    let polar = direction.y.clamp(-1.0, 1.0).acos();
    let row = (polar / PI * 512.0).floor();
    let columns = (1024.0 * polar.sin()).ceil().max(1.0);
    let column = (columns * (0.5 + direction.x.atan2(-direction.z) / TAU)).floor();
    let brightness = smoothstep(0.998, 1.0, hash(column as i64, row as i64, 6));
    DVec3::new(0.9, 0.95, 1.0) * 0.25 * brightness
}

/// Samples `radiance` over every pixel.
fn render(radiance: impl Fn(DVec3) -> DVec3 + Sync) -> Environment {
    let samples = (SUBSAMPLES * SUBSAMPLES) as f64;
    let pixels = (0..WIDTH * HEIGHT)
        .into_par_iter()
        .map(|index| {
            let (column, row) = (index % WIDTH, index / WIDTH);
            let sum: DVec3 = subsamples(column, row, SUBSAMPLES).map(&radiance).sum();
            (sum / samples).as_vec3().to_array()
        })
        .collect();
    Environment::new(WIDTH, HEIGHT, pixels)
}

/// Directions on a regular grid within a pixel.
fn subsamples(column: usize, row: usize, side: usize) -> impl Iterator<Item = DVec3> {
    (0..side * side).map(move |index| {
        let x = column as f64 + (index % side) as f64 / side as f64 + 0.5 / side as f64;
        let y = row as f64 + (index / side) as f64 / side as f64 + 0.5 / side as f64;
        uv_to_direction([x / WIDTH as f64, y / HEIGHT as f64])
    })
}

/// Adds a disc of [`DISC_RADIUS`] that brings `irradiance` to a surface facing it.
fn add_disc(environment: &mut Environment, centre: DVec3, irradiance: DVec3) {
    const SIDE: usize = 32;
    let reach = (DISC_RADIUS + TAU / WIDTH as f64).cos();
    let mut covered = Vec::new();
    for row in 0..HEIGHT {
        for column in 0..WIDTH {
            if environment.pixel_direction(column, row).dot(centre) > reach {
                let inside = subsamples(column, row, SIDE)
                    .filter(|direction| direction.dot(centre) > DISC_RADIUS.cos())
                    .count();
                let share = inside as f64 / (SIDE * SIDE) as f64;
                covered.push((row * WIDTH + column, share, environment.solid_angle(row)));
            }
        }
    }
    let solid_angle: f64 = covered.iter().map(|(_, share, solid_angle)| share * solid_angle).sum();
    for (index, share, _) in covered {
        let added = irradiance * share / solid_angle;
        for (value, added) in environment.pixels[index].iter_mut().zip(added.to_array()) {
            *value += added as f32;
        }
    }
}

fn smoothstep(start: f64, end: f64, x: f64) -> f64 {
    let t = ((x - start) / (end - start)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The direction's azimuth as a point on the unit circle, for noise that closes around the horizon.
fn on_ring(direction: DVec3) -> DVec3 {
    DVec3::new(direction.x, 0.0, direction.z).normalize_or_zero()
}

/// Fractal value noise in [0, 1] with mean near 0.5: five octaves.
fn fbm(point: DVec3) -> f64 {
    let (mut sum, mut amplitude, mut scale) = (0.0, 0.5, 1.0);
    for octave in 0..5 {
        sum += amplitude * value_noise(point * scale + 17.0 * f64::from(octave));
        amplitude *= 0.5;
        scale *= 2.03;
    }
    sum / (1.0 - amplitude * 2.0)
}

fn value_noise(point: DVec3) -> f64 {
    let cell = point.floor();
    let t = point - cell;
    let t = t * t * (3.0 - 2.0 * t);
    let (x, y, z) = (cell.x as i64, cell.y as i64, cell.z as i64);
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let edge = |y: i64, z: i64| mix(hash(x, y, z), hash(x + 1, y, z), t.x);
    let face = |z: i64| mix(edge(y, z), edge(y + 1, z), t.y);
    mix(face(z), face(z + 1), t.z)
}

/// A number in [0, 1) from three integers (the mixing of SplitMix64).
fn hash(x: i64, y: i64, z: i64) -> f64 {
    let mut bits = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f)
        ^ (z as u64).wrapping_mul(0x1656_67b1_9e37_79f9);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}
