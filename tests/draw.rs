//! Directions drawn from a fibre against its closed-form scattering of SRBFs.

use std::f64::consts::PI;

use hairlight::gpu::method::MethodData;
use hairlight::scattering::{
    azimuthal::wrap,
    draw::Drawn,
    fast::{Fast, Tables},
    fibre::{Fibre, linked_alpha},
    gaussian::concentration,
    model::Model,
};
use rayon::prelude::*;

use super::wgsl::{self, Case, check, cpu, worst};

/// Four numbers of an even sequence in [0, 1).
fn even(k: u32) -> [f64; 4] {
    // Powers of the root of x⁵ = x + 1 (Roberts 2018).
    const STEP: f64 = 0.856_674_883_854_502_9;
    [1, 2, 3, 4].map(|i| (0.5 + STEP.powi(i) * f64::from(k)).fract())
}

fn fibre(sigma_a: [f64; 3], beta_r_deg: f64, eccentricity: f64) -> Fibre {
    let alpha = linked_alpha(f64::to_radians(-3.0));
    Fibre { alpha, ..wgsl::fibre(sigma_a, beta_r_deg, eccentricity) }
}

fn direction(theta: f64, phi: f64) -> [f64; 3] {
    [theta.sin(), theta.cos() * phi.cos(), theta.cos() * phi.sin()]
}

/// Relative L2 over lights and channels of what `count` draws make of SRBFs, against closed form; and how far the mean
/// weight is from what even light gives.
fn errors(fast: &Fast, theta_o: f64, phi_o: f64, count: u32, seen: fn(Drawn) -> Drawn) -> [f64; 2] {
    let draws: Vec<Drawn> = (0..count)
        .into_par_iter()
        .filter_map(|k| fast.draw(theta_o, phi_o, even(k)))
        .map(seen)
        .collect();
    let factors = fast.factors(theta_o);
    let (mut apart, mut whole) = (0.0, 0.0);
    for k in 0..60u32 {
        let [a, b, ..] = even(k);
        let (theta_j, phi_j) = ((2.0 * a - 1.0).asin(), PI * (2.0 * b - 1.0));
        let lambda = [0.3, 0.6, 1.0][k as usize % 3];
        let center = direction(theta_j, phi_j);
        let kappa = concentration(lambda);
        let mut drawn = [0.0; 3];
        for one in &draws {
            let omega = direction(one.theta_i, one.phi_i);
            let cosine: f64 = omega.iter().zip(center).map(|(a, b)| a * b).sum();
            let light = (kappa * (cosine - 1.0)).exp() / f64::from(count);
            (0..3).for_each(|c| drawn[c] += light * one.weight[c]);
        }
        let phi = wrap(phi_o - phi_j);
        let cos_sum = (phi_o + phi_j).cos();
        let closed = fast.single_scattering(theta_o, theta_j, phi, cos_sum, lambda);
        let closed = closed.times(&factors).sum();
        for c in 0..3 {
            apart += (drawn[c] - closed[c]).powi(2);
            whole += closed[c].powi(2);
        }
    }
    let sum: f64 = draws.iter().map(|one| one.weight.iter().sum::<f64>()).sum();
    let albedo: f64 = fast.albedo(theta_o).iter().sum();
    [(apart / whole).sqrt(), sum / f64::from(count) / albedo - 1.0]
}

#[test]
fn drawn_directions_scatter_as_the_closed_form_does() {
    let mirrored = |one: Drawn| Drawn { theta_i: -one.theta_i, ..one };
    for model in [Model::Marschner, Model::Deon] {
        for (sigma_a, beta, eccentricity) in [
            ([0.0; 3], 7.5, 1.0),
            ([0.1, 0.3, 0.9], 7.5, 1.0),
            ([0.5, 1.0, 2.0], 15.0, 1.0),
            ([0.1, 0.3, 0.9], 7.5, 0.85),
        ] {
            let fibre = fibre(sigma_a, beta, eccentricity);
            let tables = Tables::new(&fibre, model, 4);
            let fast = Fast::new(&fibre, model, &tables);
            for theta_o in [0.1, -0.7, 1.1] {
                let [error, even] = errors(&fast, theta_o, 0.4, 1 << 17, |one| one);
                let [control, _] = errors(&fast, theta_o, 0.4, 1 << 14, mirrored);
                println!(
                    "{model:?}, σ_a {sigma_a:?}, β {beta}°, a {eccentricity}, θ_o {theta_o}: {:.2} % off, even light \
                     {:+.2} %; mirrored {:.0} %",
                    100.0 * error,
                    100.0 * even,
                    100.0 * control
                );
                assert!(error < 0.02, "{error}");
                assert!(even.abs() < 0.03, "{even}");
                assert!(control > 0.1, "{control}");
            }
        }
    }
}

#[test]
fn draws_of_clear_hair_weigh_alike() {
    for model in [Model::Marschner, Model::Deon] {
        let noise = |sigma_a: [f64; 3]| {
            let fibre = fibre(sigma_a, 7.5, 1.0);
            let tables = Tables::new(&fibre, model, 4);
            let fast = Fast::new(&fibre, model, &tables);
            let count = 1 << 14;
            let draw = |k: u32| {
                let [a, b, c, d] = even(k);
                fast.draw(0.3, 0.4, [a, b, c, d]).map_or(0.0, |one| one.weight[1])
            };
            let [sum, squares] =
                (0..count).map(draw).fold([0.0; 2], |s, w| [s[0] + w, s[1] + w * w]);
            (f64::from(count) * squares / (sum * sum) - 1.0).sqrt()
        };
        let (clear, dark) = (noise([0.0; 3]), noise([0.5, 1.0, 2.0]));
        println!("{model:?}: standard deviation over mean, clear {clear:.2}, dark {dark:.2}");
        // A lobe drawn by its energy, before the offset, has 1.5 of clear hair.
        assert!(clear < 0.3, "{clear}");
        // The control: of dark hair what is left depends on the offset.
        assert!(dark > 0.3, "{dark}");
    }
}

/// A draw as its weight, and its direction times that: a draw that carries no light has none.
const DRAW: &str = "let by = factors(fibre, energy_compensation(fibre, x[0].x));
    let d = draw(fibre, draw_lobes(fibre, by, x[0].x), x[0].x, x[0].y, vec4f(x[0].zw, x[1].xy));
    y[0] = vec4f(d.weight, d.weight.x * d.theta_i);
    y[1] = d.weight.x * vec4f(cos(d.phi_i), sin(d.phi_i), 0.0, 0.0);";

#[test]
fn the_shader_draws_as_its_twin_does() {
    let gpu = cpu();
    for model in [Model::Marschner, Model::Deon] {
        for eccentricity in [1.0, 0.85] {
            let fibre = fibre([0.1, 0.3, 0.9], 7.5, eccentricity);
            let nodes = model.nodes() as usize;
            let tables = Tables::new(&fibre, model, nodes);
            let fast = Fast::new(&fibre, model, &tables);
            let twin = |x: [f64; 8]| {
                let Some(one) = fast.draw(x[0], x[1], [x[2], x[3], x[4], x[5]]) else {
                    return vec![0.0; 6];
                };
                let [r, g, b] = one.weight;
                vec![r, g, b, r * one.theta_i, r * one.phi_i.cos(), r * one.phi_i.sin()]
            };
            let case = Case {
                name: "draw",
                statement: DRAW,
                relative: 4e-3,
                floor: 4e-3,
                input: |u| {
                    [2.6 * (u[0] - 0.5), PI * (2.0 * u[1] - 1.0), u[2], u[3], u[4], u[5], 0.0, 0.0]
                },
                twin: &twin,
            };
            let data = MethodData::fast(&fibre, model, model.nodes()).as_general();
            check(&gpu, &data, std::slice::from_ref(&case), 2048);
            let other = Fibre { eta: 1.03 * fibre.eta, ..fibre };
            let other = MethodData::fast(&other, model, model.nodes()).as_general();
            assert!(worst(&gpu, &other, &case, 512).0 > 1.0, "it does not feel η");
        }
    }
}
