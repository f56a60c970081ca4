//! What a strand sends out along every ordinate, of what comes along every ordinate and from every light.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DVec3, Vec3A};
use rayon::prelude::*;

use crate::scattering::azimuthal::wrap;
use crate::scattering::fast::Fast;
use crate::scattering::xu::Modes;
use crate::srbf::{SrbfLight, lobe_integral};

/// Places of a table over θ_o, θ_j and |φ| of what a strand makes of an ordinate.
const THETAS: usize = 25;
const PHIS: usize = 25;

/// RGB of one tangent.
pub(super) struct Exchange {
    tangent: DVec3,
    /// θ and φ against every ordinate.
    outward: Vec<(f64, f64)>,
    /// `of_ordinates[o·D + i]`: radiance against ordinate o of unit radiance along all of ordinate i. A row sums to
    /// the fibre's albedo.
    pub of_ordinates: Vec<Vec3A>,
    /// `of_lights[j·D + o]`: of light j.
    pub of_lights: Vec<Vec3A>,
}

/// θ and φ of a direction about a tangent; φ counts from any axis.
fn angles(t: DVec3, omega: DVec3) -> (f64, f64) {
    let (x, y) = t.any_orthonormal_pair();
    (t.dot(omega).clamp(-1.0, 1.0).asin(), omega.dot(y).atan2(omega.dot(x)))
}

/// 𝓜 of all modes for a lobe of bandwidth `lambda`. How an eccentric fibre is turned about its axis is not known
/// of a cell: φ_o+φ_j counts as 90°, halfway between its axes.
fn scattered(
    fast: &Fast,
    factors: &Modes,
    theta_o: f64,
    theta_j: f64,
    phi: f64,
    lambda: f64,
) -> [f64; 3] {
    fast.single_scattering(theta_o, theta_j, phi, 0.0, lambda).times(factors).sum()
}

fn rgb(value: [f64; 3]) -> Vec3A {
    Vec3A::from(value.map(|v| v as f32))
}

/// 𝓜 of an ordinate's lobe at places of (θ_o, θ_j, |φ|).
pub(super) struct Table(Vec<Vec3A>);

impl Table {
    fn new(fast: &Fast, lambda: f64) -> Table {
        let theta = |k: usize| PI * (k as f64 / (THETAS - 1) as f64 - 0.5);
        let rows = (0..THETAS * THETAS).into_par_iter().flat_map_iter(|row| {
            let (theta_o, theta_j) = (theta(row / THETAS), theta(row % THETAS));
            let factors = fast.factors(theta_o);
            (0..PHIS).map(move |k| {
                let phi = PI * k as f64 / (PHIS - 1) as f64;
                rgb(scattered(fast, &factors, theta_o, theta_j, phi, lambda))
            })
        });
        Table(rows.collect())
    }

    fn at(&self, theta_o: f64, theta_j: f64, phi: f64) -> Vec3A {
        let place = |x: f64, count: usize| {
            let x = x * (count - 1) as f64;
            let first = (x as usize).min(count - 2);
            (first, (x - first as f64) as f32)
        };
        let (a, fa) = place((theta_o + FRAC_PI_2) / PI, THETAS);
        let (b, fb) = place((theta_j + FRAC_PI_2) / PI, THETAS);
        let (k, fk) = place(phi.abs() / PI, PHIS);
        let row = |a: usize, b: usize| {
            let i = (a * THETAS + b) * PHIS + k;
            self.0[i].lerp(self.0[i + 1], fk)
        };
        row(a, b).lerp(row(a, b + 1), fb).lerp(row(a + 1, b).lerp(row(a + 1, b + 1), fb), fa)
    }
}

impl Exchange {
    /// Adds to `sent`, against every ordinate, what becomes of a lobe along `direction` that is as wide as an ordinate's
    /// and whose peak is `rgb`.
    pub(super) fn add_lobe(&self, table: &Table, direction: DVec3, rgb: Vec3A, sent: &mut [Vec3A]) {
        let (theta_j, phi_j) = angles(self.tangent, direction);
        for (sent, &(theta_o, phi_o)) in sent.iter_mut().zip(&self.outward) {
            *sent += rgb * table.at(theta_o, theta_j, wrap(phi_o - phi_j));
        }
    }
}

/// An [`Exchange`] for each pair of a tangent and the place of its fibre, and a [`Table`] for each fibre. `lights` are
/// not ordinates.
pub(super) fn exchanges(
    fibres: &[Fast],
    pairs: &[(DVec3, usize)],
    ordinates: &[SrbfLight],
    lights: &[SrbfLight],
) -> (Vec<Exchange>, Vec<Table>) {
    let count = ordinates.len();
    let lambda = ordinates.first().map_or(1.0, |one| one.lambda);
    let tables: Vec<_> = fibres.iter().map(|fast| Table::new(fast, lambda)).collect();
    let exchange = |&(t, fibre): &(DVec3, usize)| {
        let (fast, table) = (&fibres[fibre], &tables[fibre]);
        let seen = |light: &SrbfLight| angles(t, light.direction);
        let lobes: Vec<_> = ordinates.iter().map(seen).collect();
        let outward: Vec<_> = ordinates.iter().map(|one| angles(t, -one.direction)).collect();
        let mut of_ordinates = Vec::with_capacity(count * count);
        for &(theta_o, phi_o) in &outward {
            let first = of_ordinates.len();
            of_ordinates.extend(
                lobes
                    .iter()
                    .map(|&(theta_j, phi_j)| table.at(theta_o, theta_j, wrap(phi_o - phi_j))),
            );
            // Lobes overlap, and a strand must make of even light just what it does not keep.
            let row = &mut of_ordinates[first..];
            let sum: Vec3A = row.iter().sum();
            let scale = rgb(fast.albedo(theta_o)) / sum.max(Vec3A::splat(f32::MIN_POSITIVE));
            row.iter_mut().for_each(|value| *value *= scale);
        }
        let factors: Vec<_> = outward.iter().map(|&(theta_o, _)| fast.factors(theta_o)).collect();
        let of_light = |light: &SrbfLight| {
            let (theta_j, phi_j) = seen(light);
            let values = outward.iter().zip(&factors).map(|(&(theta_o, phi_o), factors)| {
                let phi = wrap(phi_o - phi_j);
                let value = scattered(fast, factors, theta_o, theta_j, phi, light.lambda);
                rgb(value) * rgb(light.rgb)
            });
            values.collect::<Vec<_>>()
        };
        let of_lights = lights.iter().flat_map(of_light).collect();
        Exchange { tangent: t, outward, of_ordinates, of_lights }
    };
    (pairs.par_iter().map(exchange).collect(), tables)
}

/// By what a lobe's peak is multiplied so that as many as there are ordinates, spread over the sphere, add up to 1.
pub(super) fn share(ordinates: &[SrbfLight]) -> f64 {
    ordinates
        .first()
        .map_or(0.0, |one| 4.0 * PI / ordinates.len() as f64 / lobe_integral(one.lambda))
}
