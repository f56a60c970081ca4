//! d'Eon et al. 2011.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use anyhow::Result;

use super::{Progress, integral};
use crate::measure::plot::{Axis, COLOURS, Curves, Plot, Series, Stroke, Swatches, ramp};
use crate::reference::deon::Deon;
use crate::reference::longitudinal::{Inclination, Longitudinal};
use crate::reference::model::{FibreModel, Section};
use crate::scattering::fibre::Fibre;
use crate::scattering::longitudinal::{longitudinal, projection};
use crate::scene::Pigment;

/// A clear, round fibre without tilt, β = 10°.
const WHITE: Fibre = Fibre {
    eta: 1.55,
    sigma_a: [0.0; 3],
    alpha: [0.0; 3],
    beta: [10f64.to_radians(); 3],
    w_c: 0.1,
    eccentricity: 1.0,
    tint: Fibre::UNTINTED,
};

/// What Fig 3 plots: all light is reflected, so that the albedo is ∫M over θ_r alone. β is the standard
/// deviation of θ_h, and M_p has v = (2β)².
pub fn total_reflectance(_: Progress) -> Result<Plot> {
    const BETAS: [f64; 5] = [5.0, 10.0, 20.0, 30.0, 40.0];
    let breaks = |theta: f64, beta: f64| {
        let mut breaks = vec![-FRAC_PI_2, FRAC_PI_2];
        breaks.extend([-6.0, -2.0, 0.0, 2.0, 6.0].map(|k| k * 2.0 * beta - theta));
        breaks.retain(|b| b.abs() <= FRAC_PI_2);
        breaks.sort_by(f64::total_cmp);
        breaks
    };
    // Eq 3–5 as printed: g(β; θ_h) is twice the Gaussian of unit integral over θ_i.
    let gaussian = |theta: f64, beta: f64| {
        integral(&breaks(theta, beta), |r| {
            2.0 * longitudinal(r, theta, 0.0, beta) * projection(r, theta)
        })
    };
    let conserving = |theta: f64, beta: f64| {
        let (m, o) = (Longitudinal::new(4.0 * beta * beta), Inclination::new(theta));
        integral(&breaks(theta, beta), |r| m.density(&Inclination::new(r), &o) * r.cos())
    };
    let range = [0.0, 89.5f64.to_radians()];
    let mut series = Vec::new();
    for (k, beta) in BETAS.into_iter().enumerate() {
        let colour = ramp(k as f64 / (BETAS.len() - 1) as f64);
        series.push(Series::sampled(
            format!("Gaussian, β = {beta}°"),
            colour,
            range,
            180,
            |theta| gaussian(theta, beta.to_radians()),
        ));
    }
    for beta in BETAS {
        let name = format!("M_p, β = {beta}°");
        let f = |theta| conserving(theta, beta.to_radians());
        series.push(
            Series::sampled(name, COLOURS[2], range, 60, f).stroke(Stroke::Dashed).unlisted(),
        );
    }
    // All lie on one line: one name is enough.
    let all = Series::new("M_p of Eq 7, the same β", COLOURS[2], Vec::new());
    series.push(all.stroke(Stroke::Dashed));
    Ok(Plot::Curves {
        panels: vec![Curves {
            title: "Light returned by a fibre that reflects all of it".to_owned(),
            x: Axis::degrees("inclination θ_i", 0.0, 90.0, 15.0),
            y: Axis::linear("total reflectance", 0.0, 3.0, 0.5),
            series,
        }],
        per_row: 1,
    })
}

/// ½∫A_p dh on the specular cone of `theta`, RGB.
fn energy(model: &Deon, p: usize, theta: f64) -> [f64; 3] {
    let section = Section { theta_i: -theta, theta_o: theta, phi_h: 0.0 };
    [0, 1, 2].map(|c| {
        integral(&[0.0, 0.5, 1.0, 1.3, 1.5, FRAC_PI_2], |gamma| {
            model.path(p, gamma.sin(), &section).attenuation[c] * gamma.cos()
        })
    })
}

/// The energies of a clear fibre's lobes, added up.
pub fn white_fibre(_: Progress) -> Result<Plot> {
    const NAMES: [&str; 5] = ["R", "R + TT", "… + TRT", "… + TRRT", "… + TRRRT"];
    let model = Deon::new(&WHITE, 0.1, NAMES.len());
    let series = NAMES.iter().enumerate().map(|(last, &name)| {
        let range = [0.0, FRAC_PI_2];
        Series::sampled(name, COLOURS[last], range, 181, |theta| {
            (0..=last).map(|p| energy(&model, p, theta)[0]).sum()
        })
    });
    Ok(Plot::Curves {
        panels: vec![Curves {
            title: "A white fibre, lobe by lobe".to_owned(),
            x: Axis::degrees("inclination θ_i", 0.0, 90.0, 15.0),
            y: Axis::linear("total reflectance", 0.0, 1.0, 0.2),
            series: series.collect(),
        }],
        per_row: 1,
    })
}

/// N_TT at θ_d = 0.8, β_TT = 25°, without absorption.
pub fn wrapped_detector(_: Progress) -> Result<Plot> {
    let (theta_d, beta) = (0.8, 25f64.to_radians());
    let section = Section { theta_i: -theta_d, theta_o: theta_d, phi_h: 0.0 };
    let model = Deon::new(&WHITE, beta, 4);
    // Φ brought into [−π, π] but no images of it: light that crosses ±π is lost.
    let cut = |phi: f64| {
        integral(&[-FRAC_PI_2, -1.4, 0.0, 1.4, FRAC_PI_2], |gamma| {
            let path = model.path(1, gamma.sin(), &section);
            // Φ(0) is π from one side and −π from the other.
            let azimuth = path.azimuth - if gamma < 0.0 { TAU } else { 0.0 };
            let x = (phi - azimuth) / beta;
            let density = (-0.5 * x * x).exp() / (TAU.sqrt() * beta);
            0.5 * path.attenuation[0] * density * gamma.cos()
        })
    };
    let series = vec![
        Series::sampled("wrapped detector (Eq 11)", COLOURS[0], [-PI, PI], 361, |phi| {
            model.azimuthal(1, phi, &section)[0]
        }),
        Series::sampled("Gaussian that ends at ±180°", COLOURS[1], [-PI, PI], 361, cut)
            .stroke(Stroke::Dashed),
    ];
    Ok(Plot::Curves {
        panels: vec![Curves {
            title: "N_TT of a clear fibre, θ_d = 0.8, β_TT = 25°".to_owned(),
            x: Axis::degrees("azimuth φ", -180.0, 180.0, 45.0),
            y: Axis::linear("N_TT, 1/rad", 0.0, 0.5, 0.1),
            series,
        }],
        per_row: 1,
    })
}

/// Mixtures from pure eumelanin to pure pheomelanin.
const MIXTURES: [(&str, f64); 5] =
    [("eumelanin", 0.0), ("3 : 1", 0.25), ("1 : 1", 0.5), ("1 : 3", 0.75), ("pheomelanin", 1.0)];

/// σ_a per radius of a total concentration, of which `share` is pheomelanin.
fn melanin(concentration: f64, share: f64) -> [f64; 3] {
    let [eumelanin, pheomelanin] = [1.0 - share, share].map(|s| s * concentration);
    Pigment::Melanin { eumelanin, pheomelanin }.sigma_a()
}

/// exp(−σ_a x) of a concentration of 1 over x radii.
pub fn melanin_strips(_: Progress) -> Result<Plot> {
    const COLUMNS: usize = 120;
    const THICKEST: f64 = 6.0;
    let strip = |share: f64| {
        let at = |k: usize| THICKEST * (k as f64 + 0.5) / COLUMNS as f64;
        (0..COLUMNS).map(|k| melanin(at(k), share).map(|s| (-s).exp())).collect()
    };
    Ok(Plot::Swatches {
        panels: vec![Swatches {
            title: "Light through melanin, RGB cross-sections of §6.1".to_owned(),
            x_label: "thickness × concentration".to_owned(),
            columns: ["0.5", "1.5", "2.5", "3.5", "4.5", "5.5"].map(str::to_owned).to_vec(),
            rows: MIXTURES.map(|(name, _)| name.to_owned()).to_vec(),
            colours: MIXTURES.map(|(_, share)| strip(share)).to_vec(),
            row_height: 44.0,
            gap: 0.0,
        }],
    })
}

/// The light that one fibre sends on at θ_o = 0, and a deep mass that scatters evenly with that albedo (van
/// de Hulst's closed form of 1980 for a half space under even light).
pub fn melanin_grid(_: Progress) -> Result<Plot> {
    const CONCENTRATIONS: [f64; 8] = [0.0, 0.05, 0.15, 0.3, 0.6, 1.3, 3.0, 8.0];
    let single = |share: f64, concentration: f64| {
        let fibre = Fibre { sigma_a: melanin(concentration, share), ..WHITE };
        let model = Deon::new(&fibre, 0.2, 4);
        (0..model.lobes())
            .map(|p| energy(&model, p, 0.0))
            .fold([0.0; 3], |sum, e| std::array::from_fn(|c| sum[c] + e[c]))
    };
    let rows = MIXTURES.map(|(_, share)| CONCENTRATIONS.map(|c| single(share, c)).to_vec());
    let mass = |albedo: f64| {
        let s = (1.0 - albedo).max(0.0).sqrt();
        (1.0 - s) * (1.0 - 0.139 * s) / (1.0 + 1.17 * s)
    };
    let panel = |title: &str, colours: Vec<Vec<[f64; 3]>>| Swatches {
        title: title.to_owned(),
        x_label: "melanin, per radius".to_owned(),
        columns: CONCENTRATIONS.map(|c| c.to_string()).to_vec(),
        rows: MIXTURES.map(|(name, _)| name.to_owned()).to_vec(),
        colours,
        row_height: 40.0,
        gap: 3.0,
    };
    let deep = rows.iter().map(|row| row.iter().map(|a| a.map(mass)).collect()).collect();
    Ok(Plot::Swatches {
        panels: vec![
            panel("One fibre under even light", rows.to_vec()),
            panel("A deep mass of such fibres", deep),
        ],
    })
}
