//! Xu et al. 2011.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, FRAC_PI_6, PI};

use anyhow::Result;
use glam::DVec2;
use rayon::prelude::*;

use super::{Progress, integral};
use crate::measure::plot::{Axis, COLOURS, Curves, Plot, Series, Stroke};
use crate::reference::integral::azimuthal_integral;
use crate::reference::marschner::Marschner;
use crate::reference::model::{Detector, Direction, FibreModel, Section};
use crate::scattering::azimuthal::{
    Energy, Fitter, effective_absorption, inverse_eta_prime, taylor_coefficients, wrap,
};
use crate::scattering::fibre::Fibre;
use crate::scattering::fresnel::fresnel;
use crate::scattering::gaussian::{concentration, g, g_circular, product};
use crate::scattering::longitudinal::{linear_quadrature, longitudinal_bandwidth, projection};

/// Light brown hair of β_R = 7.5° without tilt.
const FIBRE: Fibre = Fibre {
    eta: 1.55,
    sigma_a: [0.3; 3],
    alpha: [0.0; 3],
    beta: [7.5f64.to_radians(), 3.75f64.to_radians(), 15f64.to_radians()],
    w_c: 0.15,
    eccentricity: 1.0,
    tint: Fibre::UNTINTED,
};

/// The four parts of Fig 3.
pub fn fits(_: Progress) -> Result<Plot> {
    let panels = vec![tt_fit(), trt_fit(), transmittance_fit(), outer_integrands()];
    Ok(Plot::Curves { panels, per_row: 2 })
}

const THETA_D: [(f64, &str); 3] =
    [(0.0, "θ_d = 0°"), (FRAC_PI_6, "θ_d = 30°"), (FRAC_PI_3, "θ_d = 60°")];

fn on_cone(theta_d: f64) -> Section {
    Section { theta_i: -theta_d, theta_o: theta_d, phi_h: 0.0 }
}

/// For each θ_d the exact N_p and its fit, dashed.
fn against_exact(p: usize, range: [f64; 2], fit: impl Fn(f64, f64) -> f64) -> Vec<Series> {
    let model = Marschner::new(&FIBRE);
    let pairs = THETA_D.iter().enumerate().flat_map(|(k, &(theta_d, name))| {
        let exact = Series::sampled(name, COLOURS[k], range, 301, |phi| {
            model.azimuthal(p, wrap(phi), &on_cone(theta_d))[0]
        });
        let fit = Series::sampled(format!("{name}, fit"), COLOURS[k], range, 301, |phi| {
            fit(theta_d, phi)
        });
        [exact, fit.stroke(Stroke::Dashed).unlisted()]
    });
    pairs.collect()
}

fn tt_fit() -> Curves {
    let fitter = Fitter::new(&FIBRE, Energy::Quadrature);
    Curves {
        title: "N_TT, and one Gaussian (dashed)".to_owned(),
        x: Axis::degrees("azimuth φ", 60.0, 300.0, 60.0),
        y: Axis::linear("1/rad", 0.0, 0.4, 0.1),
        series: against_exact(1, [FRAC_PI_3, 5.0 * FRAC_PI_3], |theta_d, phi| {
            fitter.fit(FIBRE.eta, theta_d).tt(phi, g_circular)[0]
        }),
    }
}

fn trt_fit() -> Curves {
    let fitter = Fitter::new(&FIBRE, Energy::Quadrature);
    Curves {
        title: "N_TRT, and three Gaussians (dashed)".to_owned(),
        x: Axis::degrees("azimuth φ", -120.0, 120.0, 60.0),
        y: Axis::linear("1/rad", 0.0, 0.06, 0.02),
        series: against_exact(2, [-2.0 * FRAC_PI_3, 2.0 * FRAC_PI_3], |theta_d, phi| {
            fitter.fit(FIBRE.eta, theta_d).trt(phi, g_circular)[0]
        }),
    }
}

/// T over h at θ_d = 0 against its fourth-order expansion.
fn transmittance_fit() -> Curves {
    let q = inverse_eta_prime(FIBRE.eta, 0.0);
    let pairs = [0.2, 0.6, 1.0].into_iter().enumerate().flat_map(|(k, sigma_a)| {
        let absorption = effective_absorption(sigma_a, FIBRE.eta, 0.0);
        let name = format!("σ_a = {sigma_a}");
        let exact = Series::sampled(&name, COLOURS[k], [-1.0, 1.0], 201, |h| {
            (-2.0 * absorption * (1.0 - (h * q).powi(2)).sqrt()).exp()
        });
        let a = taylor_coefficients(1.0, absorption, q);
        let name = format!("{name}, expansion");
        let taylor = Series::sampled(name, COLOURS[k], [-1.0, 1.0], 201, |h| {
            a[0] + a[1] * h * h + a[2] * h.powi(4)
        });
        [exact, taylor.stroke(Stroke::Dashed).unlisted()]
    });
    Curves {
        title: "T, and its expansion (dashed)".to_owned(),
        x: Axis::linear("offset h", -1.0, 1.0, 0.5),
        y: Axis::linear("transmittance", 0.0, 0.8, 0.2),
        series: pairs.collect(),
    }
}

/// 𝒩_t cos²θ_i/cos²θ_d at θ_o = 0 for a light of λ′_j = 0.5 in front and behind, each over its peak.
fn outer_integrands() -> Curves {
    let exact = Marschner::new(&FIBRE);
    let cases =
        [("R, front", 0, 0.0), ("R, behind", 0, PI), ("TT, behind", 1, PI), ("TRT, front", 2, 0.0)];
    let series = cases.into_iter().enumerate().map(|(k, (name, mode, phi))| {
        let kappa = concentration(0.5);
        let range = [-FRAC_PI_2, FRAC_PI_2];
        let mut series = Series::sampled(name, COLOURS[k], range, 121, |theta_i| {
            azimuthal_integral(&exact, mode, theta_i, &Direction::new(0.0, phi), 0.0, kappa).0[0]
                * projection(theta_i, 0.0)
        });
        let peak = series.points.iter().map(|p| p[1]).fold(0.0, f64::max);
        series.points.iter_mut().for_each(|p| p[1] /= peak);
        series
    });
    Curves {
        title: "What the quadrature integrates".to_owned(),
        x: Axis::degrees("inclination θ_i", -90.0, 90.0, 30.0),
        y: Axis::linear("over its peak", 0.0, 1.0, 0.25),
        series: series.collect(),
    }
}

/// Relative L2 error of ∫ g·f dθ_i by m segments, over 75 pairs of a view and a light of λ_j = 0.3.
pub fn quadrature(_: Progress) -> Result<Plot> {
    const SEGMENTS: [u32; 10] = [2, 3, 4, 5, 6, 7, 8, 10, 12, 16];
    const LAMBDA_J: f64 = 0.3;
    let model = Marschner::new(&FIBRE);
    let angles = [-60.0, -30.0, 0.0, 30.0, 60.0].map(f64::to_radians);
    let series: Vec<Series> = ["R", "TT", "TRT"]
        .into_par_iter()
        .enumerate()
        .map(|(mode, name)| {
            let lambda_m = longitudinal_bandwidth(FIBRE.beta[mode]);
            let (mut errors, mut norm) = ([0.0; SEGMENTS.len()], 0.0);
            for (theta_o, theta_j) in angles.iter().flat_map(|&o| angles.map(|j| (o, j))) {
                for phi in [0.0, FRAC_PI_2, PI] {
                    let lobe = product(theta_j, LAMBDA_J, -theta_o, lambda_m);
                    let inner = |theta_i: f64| {
                        let kappa =
                            concentration(LAMBDA_J) * (theta_i.cos() * theta_j.cos()).max(0.0);
                        let o = Direction::new(theta_o, phi);
                        azimuthal_integral(&model, mode, theta_i, &o, 0.0, kappa).0[0]
                            * projection(theta_i, theta_o)
                    };
                    let breaks = [-6.0, -2.0, 0.0, 2.0, 6.0]
                        .map(|k| (lobe.mu + k * lobe.lambda).clamp(-FRAC_PI_2, FRAC_PI_2));
                    let exact = lobe.amplitude
                        * integral(&breaks, |theta| g(theta, lobe.mu, lobe.lambda) * inner(theta));
                    norm += exact * exact;
                    for (error, m) in errors.iter_mut().zip(SEGMENTS) {
                        let nodes = linear_quadrature(lobe.mu, lobe.lambda, m);
                        let sum: f64 = nodes
                            .filter(|node| node.weight > 0.0)
                            .map(|node| node.weight * inner(node.theta))
                            .sum();
                        *error += (lobe.amplitude * sum - exact).powi(2);
                    }
                }
            }
            let points =
                SEGMENTS.iter().zip(errors).map(|(&m, e)| [f64::from(m), (e / norm).sqrt()]);
            Series::new(name, COLOURS[mode], points.collect())
        })
        .collect();
    Ok(Plot::Curves {
        panels: vec![Curves {
            title: "Quadrature over θ_i by m segments".to_owned(),
            x: Axis::linear("segments m", 2.0, 16.0, 2.0),
            y: Axis::log("relative L2 error", 1e-3, 0.3, 10.0),
            series,
        }],
        per_row: 1,
    })
}

/// N_TRT in the normal plane for a viewer at three azimuths from the axis of an ellipse.
pub fn eccentricity(_: Progress) -> Result<Plot> {
    const A: f64 = 0.9;
    let clear = Fibre { sigma_a: [0.0; 3], ..FIBRE };
    let round = Marschner::new(&clear);
    let elliptic = Marschner::new(&Fibre { eccentricity: A, ..clear });
    let section = |phi_h: f64| Section { theta_i: 0.0, theta_o: 0.0, phi_h };
    let range = [-FRAC_PI_2, FRAC_PI_2];
    let panels = [0.0, 30.0, 60.0, 90.0].map(|degrees| {
        let phi_o = f64::to_radians(degrees);
        let paths = ellipse_paths(clear.eta, A, phi_o);
        let detector = Detector::Circular { kappa: concentration(clear.w_c) };
        let traced = Series::sampled("traced ellipse", COLOURS[0], range, 241, |phi| {
            paths.iter().map(|path| path.weight * detector.density(wrap(phi - path.azimuth))).sum()
        });
        let model = Series::sampled("through η*", COLOURS[1], range, 241, |phi| {
            elliptic.azimuthal(2, phi, &section(phi_o + 0.5 * phi))[0]
        });
        let circle = Series::sampled("round", COLOURS[6], range, 241, |phi| {
            round.azimuthal(2, phi, &section(0.0))[0]
        });
        Curves {
            title: format!("N_TRT seen from {degrees}° to the axis"),
            x: Axis::degrees("azimuth φ", -90.0, 90.0, 30.0),
            y: Axis::linear("1/rad", 0.0, 0.25, 0.05),
            series: vec![circle, model.stroke(Stroke::Dashed), traced],
        }
    });
    Ok(Plot::Curves { panels: panels.to_vec(), per_row: 2 })
}

/// One TRT path: its exit azimuth from φ_o, and its share of the light.
struct EllipsePath {
    azimuth: f64,
    weight: f64,
}

/// TRT paths of light from `phi_o` through a smooth clear ellipse with the semi-axes `a` along φ = 0 and 1
/// across, evenly over asin h. That is how η* means it: a < 1 has η* < η along φ_h = 0, which spreads the
/// caustic, and so does the flat side of this ellipse.
fn ellipse_paths(eta: f64, a: f64, phi_o: f64) -> Vec<EllipsePath> {
    const COUNT: usize = 4000;
    let axes = DVec2::new(a, 1.0);
    let towards = -DVec2::from_angle(phi_o);
    let across = towards.perp();
    // Half of the width seen.
    let width = (axes * across).length();
    let step = PI / COUNT as f64;
    (0..COUNT)
        .filter_map(|k| {
            let gamma = -FRAC_PI_2 + (k as f64 + 0.5) * step;
            let start = across * (width * gamma.sin()) - towards * 4.0;
            let (azimuth, attenuation) = trt(eta, axes, start, towards)?;
            let weight = 0.5 * attenuation * gamma.cos() * step;
            Some(EllipsePath { azimuth: azimuth - phi_o, weight })
        })
        .collect()
}

/// The azimuth at which a ray leaves after T, R and T, and what is left of it; none if it is held inside.
fn trt(eta: f64, axes: DVec2, start: DVec2, direction: DVec2) -> Option<(f64, f64)> {
    // On the unit circle that the axes shrink to.
    let hit = |from: DVec2, along: DVec2, enter: bool| {
        let (p, d) = (from / axes, along / axes);
        let (b, c) =
            (p.dot(d) / d.length_squared(), (p.length_squared() - 1.0) / d.length_squared());
        let root = (b * b - c).max(0.0).sqrt();
        let point = from + along * (if enter { -b - root } else { -b + root });
        (point, (point / (axes * axes)).normalize())
    };
    let (point, normal) = hit(start, direction, true);
    let cos_i = -direction.dot(normal);
    let mut left = 1.0 - fresnel(cos_i, eta);
    let inside = refract(direction, normal, eta.recip())?;
    let (point, normal) = hit(point, inside, false);
    // From inside the reflectance is that of the refracted ray outside.
    left *= refract(inside, -normal, eta).map_or(1.0, |out| fresnel(out.dot(normal), eta));
    let inside = inside.reflect(normal);
    let (_, normal) = hit(point, inside, false);
    let out = refract(inside, -normal, eta)?;
    left *= 1.0 - fresnel(out.dot(normal), eta);
    Some((out.to_angle(), left))
}

/// Snell's law for a `normal` against the ray; `ratio` is the index before over that behind.
fn refract(direction: DVec2, normal: DVec2, ratio: f64) -> Option<DVec2> {
    let cos_i = -direction.dot(normal);
    let sin2_t = ratio * ratio * (1.0 - cos_i * cos_i);
    (sin2_t < 1.0).then(|| direction * ratio + normal * (ratio * cos_i - (1.0 - sin2_t).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scattering::azimuthal::energies;
    use crate::scattering::quadrature::GaussLegendre;

    #[test]
    fn rays_in_a_circle_are_marschners_trt() {
        let model = Marschner::new(&Fibre { sigma_a: [0.0; 3], ..FIBRE });
        let detector = Detector::Circular { kappa: concentration(FIBRE.w_c) };
        let [_, _, energy] = energies(&GaussLegendre::new(24), FIBRE.eta, 0.0, 0.0);
        let off = |a: f64| {
            let paths = ellipse_paths(FIBRE.eta, a, 0.4);
            let sum: f64 = paths.iter().map(|path| path.weight).sum();
            let section = Section { theta_i: 0.0, theta_o: 0.0, phi_h: 0.0 };
            let exact = |phi: f64| model.azimuthal(2, phi, &section)[0];
            let apart = [-0.6, -0.2, 0.0, 0.3].map(|phi| {
                let share = |p: &EllipsePath| p.weight * detector.density(wrap(phi - p.azimuth));
                (paths.iter().map(share).sum::<f64>() - exact(phi)).abs() / exact(0.0)
            });
            apart.into_iter().fold((sum / energy - 1.0).abs(), f64::max)
        };
        println!("TRT by rays: {:.1e} off in a circle, {:.2} in an ellipse", off(1.0), off(0.9));
        assert!(off(1.0) < 1e-9 && off(0.9) > 0.1);
    }
}
