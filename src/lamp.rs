//! Lamps: lights placed by hand, as they are, and as the SRBF that each is from a place.
//!
//! From a place p a lamp covers a solid angle Ω, all of one radiance L. The SRBF that stands for it there has
//!
//! - its centre along the mean direction, ∫ω dω over its length,
//! - its energy: rgb · ∫G dω = L Ω,
//! - the mean cosine of a cone of Ω: coth κ − 1/κ = 1 − Ω/4π, κ = 2/λ².
//!
//! Sun and sphere are cones, and this is exact for them. A softbox covers two spherical triangles, whose Ω is in closed
//! form (Van Oosterom and Strackee 1983); its mean direction is that over four Gauss nodes; its λ is 2 % too small from
//! before it, 5 % from aside and 15 % beside its edge. tests/lamps.rs has all this against quadrature.
//! Twin: shaders/lamp.wgsl.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};

use crate::scene::{LampKind, LampSpec, Scene};
use crate::srbf::{SrbfLight, lobe_integral};

/// λ of a lamp's SRBF, at least and at most: hair blurs more than the one; the other is for places within a sphere.
const LAMBDA: [f64; 2] = [0.01, 2.0];
/// Most directions in which transport looks for a lamp, as for any lobe.
const MAX_DIRECTIONS: f64 = 12.0;

/// A lamp in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    pub shape: Shape,
    /// Unit vector from the middle of the hair.
    pub toward: DVec3,
    /// Of all its surface, linear RGB, exposure included.
    pub radiance: [f64; 3],
}

/// What shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A disc infinitely far away, of this angular radius in radians.
    Sun {
        angle: f64,
    },
    Sphere {
        center: DVec3,
        radius: f64,
    },
    /// A square that faces the middle of the hair and is dark behind.
    Softbox {
        center: DVec3,
        half: f64,
    },
}

/// A direction in which a lamp shines on a place.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    /// Unit vector towards the lamp.
    pub direction: DVec3,
    /// To its surface, world units; infinite of a sun.
    pub distance: f64,
    /// Density with which [`Lamp::draw`] draws the direction, 1/sr.
    pub pdf: f64,
}

impl Lamp {
    /// For hair within `radius` of `middle`; None for a lamp that is none or black.
    pub fn new(spec: &LampSpec, middle: Vec3, radius: f32, gain: f64) -> Option<Lamp> {
        let LampSpec { azimuth_deg, elevation_deg, distance, size, color, .. } = *spec;
        let (sin_azimuth, cos_azimuth) = azimuth_deg.to_radians().sin_cos();
        let (up, level) = elevation_deg.to_radians().sin_cos();
        let toward = DVec3::new(sin_azimuth * level, up, cos_azimuth * level).normalize();
        let unit = f64::from(radius);
        let center = middle.as_dvec3() + distance * unit * toward;
        // Irradiance over radiance at a surface that faces it from the middle.
        let (shape, share) = match spec.kind {
            LampKind::None => return None,
            LampKind::Sun => {
                let angle = size.to_radians();
                (Shape::Sun { angle }, PI * angle.sin().powi(2))
            }
            LampKind::Sphere => {
                let sin = (size / distance).min(1.0);
                (Shape::Sphere { center, radius: size * unit }, PI * sin * sin)
            }
            LampKind::Softbox => {
                let sin = size / size.hypot(distance);
                (Shape::Softbox { center, half: size * unit }, 4.0 * sin * sin.atan())
            }
        };
        let radiance = color.map(|c| gain * c * spec.irradiance / share);
        radiance.iter().any(|&c| c > 0.0).then_some(Lamp { shape, toward, radiance })
    }

    /// All of a scene's.
    pub fn all(scene: &Scene, middle: Vec3, radius: f32) -> impl Iterator<Item = Lamp> {
        let gain = 2f64.powf(scene.environment.exposure);
        scene.lamps.iter().filter_map(move |spec| Lamp::new(spec, middle, radius, gain))
    }

    /// Centre, radius or half a side, and for a softbox the unit vector along its level side, else 0: of what is near.
    pub fn place(&self) -> Option<(DVec3, f64, DVec3)> {
        match self.shape {
            Shape::Sun { .. } => None,
            Shape::Sphere { center, radius } => Some((center, radius, DVec3::ZERO)),
            Shape::Softbox { center, half } => Some((center, half, sides(self.toward).0)),
        }
    }

    /// Whether its place counts.
    pub fn is_near(&self) -> bool {
        !matches!(self.shape, Shape::Sun { .. })
    }

    /// The same, moved.
    pub fn moved(self, by: DVec3) -> Lamp {
        let shape = match self.shape {
            Shape::Sun { .. } => self.shape,
            Shape::Sphere { center, radius } => Shape::Sphere { center: center + by, radius },
            Shape::Softbox { center, half } => Shape::Softbox { center: center + by, half },
        };
        Lamp { shape, ..self }
    }

    /// Ω, the solid angle that shines on `p`, sr.
    pub fn solid_angle(&self, p: DVec3) -> f64 {
        match self.shape {
            Shape::Softbox { center, half } => {
                let depth = (center - p).dot(self.toward);
                let [a, b, c, d] = self.square(center, half).map(|corner| corner - p);
                // Edges of 2·half at right angles: one triple product for both triangles.
                let triple = 4.0 * half * half * depth.max(0.0);
                triangle(a, b, c, triple) + triangle(a, c, d, triple)
            }
            _ => TAU * self.drop(p),
        }
    }

    /// 1 − cosα of the cone that a sun or a sphere covers; 2 within a sphere.
    fn drop(&self, p: DVec3) -> f64 {
        match self.shape {
            Shape::Sphere { center, radius } => {
                let sin2 = radius * radius / p.distance_squared(center);
                if sin2 >= 1.0 { 2.0 } else { sin2 / (1.0 + (1.0 - sin2).sqrt()) }
            }
            Shape::Sun { angle } => 2.0 * (0.5 * angle).sin().powi(2),
            Shape::Softbox { .. } => unreachable!("covers no cone"),
        }
    }

    /// The corners of a square of `half` a side about `center`, in turn.
    fn square(&self, center: DVec3, half: f64) -> [DVec3; 4] {
        let (side, up) = sides(self.toward);
        let (x, y) = (half * side, half * up);
        [center - x - y, center + x - y, center + x + y, center - x + y]
    }

    /// The SRBF that it is from `p`: dark where it does not shine.
    pub fn lobe(&self, p: DVec3) -> SrbfLight {
        let omega = self.solid_angle(p);
        let direction = match self.shape {
            Shape::Sun { .. } => self.toward,
            Shape::Sphere { center, .. } => (center - p).try_normalize().unwrap_or(self.toward),
            Shape::Softbox { center, half } => {
                let nodes = self.square(center, half / 3f64.sqrt()).map(|node| node - p);
                let seen = nodes.map(|to| to / to.length_squared().powi(2).max(f64::MIN_POSITIVE));
                seen.iter().sum::<DVec3>().try_normalize().unwrap_or(self.toward)
            }
        };
        let lambda = bandwidth(omega / (4.0 * PI));
        let peak = omega / lobe_integral(lambda);
        SrbfLight { direction, lambda, rgb: self.radiance.map(|c| c * peak) }
    }

    /// A direction in which it shines on `p`, from two uniform numbers in [0, 1): evenly over the solid angle, or of a
    /// softbox over its square. None where it is dark there.
    pub fn draw(&self, p: DVec3, u: [f64; 2]) -> Option<Sight> {
        if let Shape::Softbox { center, half } = self.shape {
            let (side, up) = sides(self.toward);
            let [x, y] = u.map(|u| half * (2.0 * u - 1.0));
            return self.of_square(center + x * side + y * up - p, half);
        }
        let axis = match self.shape {
            Shape::Sphere { center, .. } => (center - p).try_normalize().unwrap_or(self.toward),
            _ => self.toward,
        };
        let all = self.drop(p);
        let drop = all * u[0];
        let (x, y) = axis.any_orthonormal_pair();
        let (sin, cos) = (TAU * u[1]).sin_cos();
        let across = (drop * (2.0 - drop)).max(0.0).sqrt();
        let direction = (axis * (1.0 - drop) + across * (x * cos + y * sin)).normalize();
        let distance = match self.shape {
            Shape::Sphere { center, radius } => enter(center - p, radius, direction).max(0.0),
            _ => f64::INFINITY,
        };
        Some(Sight { direction, distance, pdf: 1.0 / (TAU * all) })
    }

    /// What of it unit `omega` meets from `p`.
    pub fn meet(&self, p: DVec3, omega: DVec3) -> Option<Sight> {
        match self.shape {
            Shape::Softbox { center, half } => {
                let facing = omega.dot(self.toward);
                let distance = (center - p).dot(self.toward) / facing;
                if !(facing > 0.0 && distance > 0.0) {
                    return None;
                }
                let at = distance * omega;
                let (side, up) = sides(self.toward);
                let off = p + at - center;
                let within = off.dot(side).abs().max(off.dot(up).abs()) <= half;
                within.then(|| self.of_square(at, half)).flatten()
            }
            Shape::Sphere { center, radius } => {
                let to = center - p;
                let within = to.length_squared() <= radius * radius;
                let hit = within || to.dot(omega) > 0.0 && miss2(to, omega) <= radius * radius;
                let pdf = 1.0 / (TAU * self.drop(p));
                hit.then(|| Sight { direction: omega, distance: enter(to, radius, omega), pdf })
            }
            Shape::Sun { .. } => {
                let all = self.drop(p);
                let drop = 0.5 * (omega - self.toward).length_squared();
                let pdf = 1.0 / (TAU * all);
                (drop <= all).then_some(Sight { direction: omega, distance: f64::INFINITY, pdf })
            }
        }
    }

    /// A place of a square, seen along `to`.
    fn of_square(&self, to: DVec3, half: f64) -> Option<Sight> {
        let distance = to.length();
        let direction = to / distance;
        let facing = direction.dot(self.toward);
        let pdf = distance * distance / (facing * 4.0 * half * half);
        (facing > 0.0 && pdf.is_finite()).then_some(Sight { direction, distance, pdf })
    }

    /// Directions that stand for it at `p`, each with its share: one for a narrow lamp, 12 for a wide one; none where
    /// it is dark.
    pub fn directions(&self, p: DVec3) -> Vec<(Sight, f64)> {
        let lambda = self.lobe(p).lambda;
        let count = (30.0 * lambda * lambda).ceil().clamp(1.0, MAX_DIRECTIONS);
        let golden = 0.5 * (5f64.sqrt() - 1.0);
        let draw = |k: f64| {
            let u = [(k + 0.5) / count, (0.5 + golden * k).fract()];
            // A lone one goes to the middle.
            let u = if count == 1.0 && !matches!(self.shape, Shape::Softbox { .. }) {
                [0.0; 2]
            } else {
                u
            };
            self.draw(p, u)
        };
        let mut seen: Vec<(Sight, f64)> = (0..count as usize)
            .filter_map(|k| draw(k as f64))
            .map(|sight| (sight, 1.0 / sight.pdf))
            .collect();
        let total: f64 = seen.iter().map(|(_, weight)| weight).sum();
        seen.iter_mut().for_each(|(_, weight)| *weight /= total);
        seen
    }
}

/// Unit vectors along the sides of a square across `toward`, the first level.
fn sides(toward: DVec3) -> (DVec3, DVec3) {
    let level = toward.x.hypot(toward.z);
    let side =
        if level > 1e-6 { DVec3::new(toward.z / level, 0.0, -toward.x / level) } else { DVec3::X };
    (side, toward.cross(side))
}

/// The solid angle of a triangle of corners a, b, c and triple product `triple`.
fn triangle(a: DVec3, b: DVec3, c: DVec3, triple: f64) -> f64 {
    let [la, lb, lc] = [a, b, c].map(DVec3::length);
    2.0 * triple.atan2(la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb)
}

/// λ of the SRBF whose mean cosine is 1 − `spread`: 1/κ is `spread` but for e^−2κ, which a step of Newton's method takes
/// in. λ is within 0.2 % up to a spread of ½, the widest cone of a place outside a sphere.
fn bandwidth(spread: f64) -> f64 {
    let spread = spread.max(1e-9);
    let t = (-2.0 / spread).exp();
    let over = 2.0 * t / (1.0 - t);
    let slope = spread * spread - 4.0 * t / ((1.0 - t) * (1.0 - t));
    let kappa = 1.0 / spread - over / slope.max(1e-30);
    (2.0 / kappa.max(0.1)).sqrt().clamp(LAMBDA[0], LAMBDA[1])
}

/// Squared distance at which a ray along `omega` passes what lies at `to`.
fn miss2(to: DVec3, omega: DVec3) -> f64 {
    to.reject_from_normalized(omega).length_squared()
}

/// Distance along `omega` to the surface of a sphere at `to`; from within, to where it is left.
fn enter(to: DVec3, radius: f64, omega: DVec3) -> f64 {
    let along = to.dot(omega);
    let deep = (radius * radius - miss2(to, omega)).max(0.0).sqrt();
    if to.length_squared() <= radius * radius { along + deep } else { along - deep }
}
