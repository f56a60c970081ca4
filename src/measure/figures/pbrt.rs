//! pbrt-v4 §9.9.

use std::f64::consts::{FRAC_PI_2, PI};

use anyhow::Result;

use super::Progress;
use crate::measure::plot::{Axis, COLOURS, Curves, Plot, Polar, Series, Stroke, ramp};
use crate::reference::chiang::Chiang;
use crate::reference::longitudinal::{Inclination, Longitudinal};
use crate::reference::model::{Detector, FibreModel, Section};
use crate::scattering::azimuthal::{exit_azimuth, inverse_eta_prime, wrap};

const ETA: f64 = 1.55;

/// M_p against θ_i, v = 0.02, and the specular cones.
pub fn longitudinal(_: Progress) -> Result<Plot> {
    let m = Longitudinal::new(0.02);
    let mut series = Vec::new();
    for (k, theta_o) in [-1.0, -1.3, -1.4].into_iter().enumerate() {
        let o = Inclination::new(theta_o);
        let name = format!("θ_o = {theta_o}").replace('-', "−");
        series.push(Series::sampled(&name, COLOURS[k], [0.5, 0.5 * PI], 300, |theta_i| {
            m.density(&Inclination::new(theta_i), &o)
        }));
        let cone = vec![[-theta_o, 0.0], [-theta_o, 28.0]];
        let cone = Series::new(format!("{name}, specular cone"), COLOURS[k], cone);
        series.push(cone.stroke(Stroke::Dashed).unlisted());
    }
    Ok(Plot::Curves {
        panels: vec![Curves {
            title: "M_p of v = 0.02, and the specular cones (dashed)".to_owned(),
            x: Axis::linear("inclination θ_i, radians", 0.5, 0.5 * PI, 0.2),
            y: Axis::linear("M_p", 0.0, 28.0, 4.0),
            series,
        }],
        per_row: 1,
    })
}

/// Φ(p, h) of R, TT and TRT at θ_d = 0.
pub fn exit_azimuths(_: Progress) -> Result<Plot> {
    let q = inverse_eta_prime(ETA, 0.0);
    let series = ["R", "TT", "TRT"].into_iter().enumerate().map(|(p, name)| {
        // R and TRT turn about 0, TT about π.
        let turn = if p == 2 { 2.0 * PI } else { 0.0 };
        let phi = |gamma| exit_azimuth(p as u32, gamma, q) - turn;
        let mut series = Series::sampled(name, COLOURS[p], [-FRAC_PI_2, FRAC_PI_2], 241, phi);
        series.points.iter_mut().for_each(|point| point[0] = point[0].sin());
        series
    });
    Ok(Plot::Curves {
        panels: vec![Curves {
            title: "Where light that meets the fibre at h leaves, η = 1.55".to_owned(),
            x: Axis::linear("offset h", -1.0, 1.0, 0.5),
            y: Axis::degrees("azimuth Φ(p, h)", -180.0, 300.0, 60.0),
            series: series.collect(),
        }],
        per_row: 1,
    })
}

/// The trimmed logistic of three scales.
pub fn trimmed_logistic(_: Progress) -> Result<Plot> {
    let series = [0.1, 0.2, 0.5, 1.0].into_iter().enumerate().map(|(k, scale)| {
        let detector = Detector::Logistic { scale };
        let colour = ramp(k as f64 / 3.0);
        Series::sampled(format!("s = {scale}"), colour, [-PI, PI], 401, |x| detector.density(x))
    });
    Ok(Plot::Curves {
        panels: vec![Curves {
            title: "The logistic density trimmed to ±π".to_owned(),
            x: Axis::degrees("azimuth from Φ(p, h)", -180.0, 180.0, 45.0),
            y: Axis::linear("density, 1/rad", 0.0, 2.5, 0.5),
            series: series.collect(),
        }],
        per_row: 1,
    })
}

/// N_TT of a fibre of β_n = 0.1 that is met at h, the viewer to the right.
pub fn azimuthal_lobes(_: Progress) -> Result<Plot> {
    let model = Chiang::new(0.3, 0.1, 0.0, ETA, [0.0; 3]);
    let section = Section { theta_i: 0.0, theta_o: 0.0, phi_h: 0.0 };
    let detector = model.detector(1);
    let panels = [-0.5, 0.3].map(|h| {
        let centre = model.path(1, h, &section).azimuth;
        Polar {
            title: format!("TT at h = {h}, β_n = 0.1").replace('-', "−"),
            radius: 12.0,
            ring: 4.0,
            series: vec![
                Series::sampled("N_TT", COLOURS[0], [-PI, PI], 1441, |phi| {
                    detector.density(wrap(phi - centre))
                })
                .unlisted(),
            ],
        }
    });
    Ok(Plot::Polar { panels: panels.to_vec() })
}
