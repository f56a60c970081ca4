//! The exact integrals and dual-scattering averages against product rules, limits and figures from elsewhere.

use std::cell::Cell;
use std::f64::consts::{FRAC_PI_2, PI};

use hairlight::reference::{
    adaptive::{Tolerance, integrate},
    averages::{Averages, averages, lobe_shares},
    chiang::Chiang,
    deon::Deon,
    integral::{Light, albedo, far_field_pdf, lobe_albedo, srbf_integral},
    marschner::Marschner,
    model::{Direction, FibreModel, Section},
};
use hairlight::scattering::{
    azimuthal::wrap, dual::AverageTable, fibre::Fibre, gaussian, quadrature::GaussLegendre,
};

use super::reference_models::Mixed;

/// Marschner's ratios of α and β; angles in degrees.
fn fibre(sigma_a: f64, alpha_r: f64, beta_r: f64) -> Fibre {
    let [alpha, beta] = [alpha_r, beta_r].map(f64::to_radians);
    Fibre {
        eta: 1.55,
        sigma_a: [sigma_a, 0.5 * sigma_a, 2.0 * sigma_a],
        alpha: [alpha, -0.5 * alpha, -1.5 * alpha],
        beta: [beta, 0.5 * beta, 2.0 * beta],
        w_c: 0.2,
        eccentricity: 1.0,
        tint: Fibre::UNTINTED,
    }
}

/// A composite rule of `panels` × 16 points.
fn composite(low: f64, high: f64, panels: usize, mut f: impl FnMut(f64) -> f64) -> f64 {
    let rule = GaussLegendre::new(16);
    let step = (high - low) / panels as f64;
    let starts = (0..panels).map(|k| low + step * k as f64);
    starts.flat_map(|a| rule.on(a, a + step).collect::<Vec<_>>()).map(|(x, w)| w * f(x)).sum()
}

/// exp(−|ω−ω_j|²/λ²) from the vectors themselves.
fn g(light: &Light, i: &Direction) -> f64 {
    let apart = (i.vector() - Direction::new(light.theta, light.phi).vector()).length_squared();
    (-apart / (light.lambda * light.lambda)).exp()
}

/// ∫G_j S_p cosθ_i dω as it is written, first channel.
fn direct(model: &dyn FibreModel, p: usize, o: &Direction, light: &Light, panels: usize) -> f64 {
    let reach = 6.2 * light.lambda;
    let low = (light.theta - reach).max(-FRAC_PI_2);
    let high = (light.theta + reach).min(FRAC_PI_2);
    composite(low, high, panels, |theta_i| {
        let section =
            |phi_i: f64| Section { theta_i, theta_o: o.theta(), phi_h: 0.5 * (phi_i + o.phi) };
        let m = model.longitudinal(p, theta_i, o.theta()) * theta_i.cos();
        // Past these m is below 1e-12 of its peak.
        if m < 1e-12 {
            return 0.0;
        }
        // N_R has a kink at φ = π.
        m * composite(o.phi - PI, o.phi + PI, 2 * panels, |phi_i| {
            let g = g(light, &Direction::new(theta_i, phi_i));
            if g < 1e-14 {
                return 0.0;
            }
            g * model.azimuthal(p, wrap(phi_i - o.phi), &section(phi_i))[0]
        })
    })
}

#[test]
fn the_adaptive_rule_reaches_what_it_says() {
    // f, its breaks, its integral.
    type Case<'a> = (&'a str, &'a dyn Fn(f64) -> f64, &'a [f64], f64);
    let narrow = 1e-3 * PI.sqrt();
    let cases: [Case; 6] = [
        ("polynomial", &|x| x.powi(31) + 1.0, &[0.0, 1.0], 1.0 / 32.0 + 1.0),
        ("narrow peak", &|x| (-((x - 0.3) / 1e-3).powi(2)).exp(), &[-1.0, 0.3, 1.0], narrow),
        ("1/√x", &|x| x.powf(-0.5), &[0.0, 1.0], 2.0),
        ("kink", &|x| (x - 0.123).abs(), &[0.0, 1.0], 0.5 * (0.123 * 0.123 + 0.877 * 0.877)),
        ("wave", &|x| (200.0 * x).sin(), &[0.0, 3.0], (1.0 - 600f64.cos()) / 200.0),
        ("step", &|x| f64::from(x > 0.7), &[0.0, 1.0], 0.3),
    ];
    for (name, f, breaks, want) in cases {
        for relative in [1e-4, 1e-8, 1e-11] {
            let calls = Cell::new(0);
            let got = integrate(breaks, Tolerance { relative, absolute: 1e-300 }, |x| {
                calls.set(calls.get() + 1);
                [f(x), 2.0 * f(x)]
            });
            let off = (got.value[0] - want).abs();
            println!(
                "{name} to {relative:.0e}: off by {off:.1e}, said {:.1e}, {} calls",
                got.error[0],
                calls.get()
            );
            assert!(got.excess <= 1.0, "{name} {relative}: {got:?}");
            assert!(off <= got.error[0] + 1e-13 * want.abs(), "{name} {relative}: said too little");
            assert!((got.value[1] - 2.0 * got.value[0]).abs() <= 1e-12 * want.abs());
        }
    }
    // Controls: what cannot be reached is said, and takes bounded time.
    let noise = |x: f64| [(1e9 * x).sin().signum()];
    let got = integrate(&[0.0, 1.0], Tolerance { relative: 1e-8, absolute: 0.0 }, noise);
    assert!(got.excess > 1.0, "{got:?}");
    let empty = integrate(&[1.0], Tolerance { relative: 1e-8, absolute: 0.0 }, |x| [x]);
    assert_eq!((empty.value, empty.excess), ([0.0], 0.0));
}

/// Panels over θ_i and γ fine enough for nine digits, with the light's integral in closed form.
#[test]
fn marschner_integrals_hold_to_1e8() {
    let (mut worst, mut worst_said) = (0f64, 0f64);
    for (sigma_a, theta_o, theta_j, phi_j, lambda) in [
        (0.0, 0.3, -0.2, 1.5, 0.3),
        (0.6, -1.1, 1.2, 0.5, 0.2),
        (0.6, 0.2, -0.4, 3.0, 3.0),
        (5.0, 0.9, -0.7, 0.4, 1.0),
        // η′ = 2 at θ_d = 0.606.
        (0.1, 0.606, -0.606, 0.2, 0.3),
    ] {
        let model = Marschner::new(&fibre(sigma_a, -7.5, 7.5));
        let (o, light) =
            (Direction::new(theta_o, 0.0), Light { theta: theta_j, phi: phi_j, lambda });
        for p in 0..3 {
            let want = composite(-FRAC_PI_2, FRAC_PI_2, 40, |theta_i| {
                let section = Section { theta_i, theta_o, phi_h: 0.0 };
                let m = model.longitudinal(p, theta_i, theta_o) * theta_i.cos();
                let sharpness = gaussian::concentration(lambda);
                let g = gaussian::g_circular(theta_i - theta_j, sharpness);
                if m * g < 1e-30 {
                    return 0.0;
                }
                let kappa = sharpness * theta_i.cos() * theta_j.cos();
                m * g
                    * composite(-FRAC_PI_2, FRAC_PI_2, 24, |gamma| {
                        let path = model.path(p, gamma.sin(), &section);
                        let light =
                            model.detector(p).times_light(wrap(phi_j - path.azimuth), kappa);
                        0.5 * gamma.cos() * path.attenuation[0] * light
                    })
            });
            let got = srbf_integral(&model, p, &o, &light);
            let off = (got.value[0] / want - 1.0).abs();
            worst = worst.max(off);
            worst_said = worst_said.max(got.error[0] / got.value[0]);
            assert!(off < 1e-8 && got.excess <= 1.0, "{p} {theta_o} {lambda}: {off:e} {got:?}");
            let control = Light { lambda: lambda * (1.0 + 1e-6), ..light };
            let control = srbf_integral(&model, p, &o, &control).value[0];
            assert!((control / want - 1.0).abs() > 1e-8, "a λ_j off by 1e-6 passes");
        }
    }
    println!("against panels: off by {worst:.1e}, said {worst_said:.1e}");
}

/// Against the integral as it is written, by the models' own N_p over φ.
#[test]
fn every_model_agrees_with_the_plain_double_integral() {
    let fibre = fibre(0.4, -3.0, 10.0);
    let models: [(&str, Box<dyn FibreModel>); 4] = [
        ("marschner", Box::new(Marschner::new(&fibre))),
        ("eccentric", Box::new(Marschner::new(&Fibre { eccentricity: 0.9, ..fibre }))),
        ("deon", Box::new(Deon::new(&fibre, 0.3, 3))),
        ("chiang", Box::new(Chiang::new(0.4, 0.5, -0.05, 1.55, [0.4; 3]))),
    ];
    let (o, light) = (Direction::new(0.4, 1.0), Light { theta: -0.2, phi: 3.2, lambda: 0.5 });
    for (name, model) in &models {
        // Only TRT knows the ellipse.
        for p in if *name == "eccentric" { 2..3 } else { 0..model.lobes() } {
            let panels = if model.lobes() == 3 { 3 } else { 2 };
            let want = direct(&**model, p, &o, &light, panels);
            let got = srbf_integral(&**model, p, &o, &light);
            let off = (got.value[0] / want - 1.0).abs();
            println!("{name}, lobe {p}: {want:.8e}, off by {off:.1e}");
            assert!(off < 1e-6 && got.excess <= 1.0, "{name}, lobe {p}: {got:?} against {want}");
            let control = srbf_integral(&**model, p, &o, &Light { phi: 3.21, ..light });
            let uniform = p == 3;
            let moved = (control.value[0] / want - 1.0).abs();
            assert!(moved > 1e-6 || uniform, "{name}, lobe {p}: φ_j is not felt");
        }
    }
}

/// A light of λ → 0 sees S·cosθ_i at one point: πλ² of it.
#[test]
fn the_narrowest_lights_see_the_function_itself() {
    let lambda = 0.003;
    let fibre = fibre(0.3, -7.5, 7.5);
    let models: [Box<dyn FibreModel>; 3] = [
        Box::new(Marschner::new(&fibre)),
        Box::new(Deon::new(&fibre, 0.14, 4)),
        Box::new(Chiang::new(0.3, 0.3, -0.13, 1.55, fibre.sigma_a)),
    ];
    let o = Direction::new(0.4, 0.3);
    let energy = gaussian::srbf_integral(lambda);
    let mut worst = 0f64;
    for model in &models {
        for (theta_j, phi_j) in [(-0.5, 3.3), (-0.3, 0.5), (-0.2, -2.4)] {
            let i = Direction::new(theta_j, phi_j);
            let want = model.f_cos(&o, &i)[0];
            let of = |phi: f64| -> f64 {
                let light = Light { theta: theta_j, phi, lambda };
                (0..model.lobes()).map(|p| srbf_integral(&**model, p, &o, &light).value[0]).sum()
            };
            let off = (of(phi_j) / (energy * want) - 1.0).abs();
            worst = worst.max(off);
            assert!(off < 5e-4, "{theta_j} {phi_j}: {off:e}");
            assert!((of(phi_j + 0.05) / (energy * want) - 1.0).abs() > 5e-4);
        }
    }
    println!("λ_j = 0.003: within {worst:.1e} of πλ² S cosθ_i");
}

#[test]
fn hard_cases_converge_and_stay_finite() {
    let mut worst = 0f64;
    for sigma_a in [0.0, 20.0] {
        for (alpha, beta) in [(0.0, 0.1), (-10.0, 20.0)] {
            let fibre = fibre(sigma_a, alpha, beta);
            let models: [Box<dyn FibreModel>; 3] = [
                Box::new(Marschner::new(&fibre)),
                Box::new(Marschner::new(&Fibre { w_c: 0.0, ..fibre })),
                Box::new(Deon::new(&fibre, 0.05, 3)),
            ];
            for (theta_o, theta_j, phi, lambda) in [
                (0.3, -0.3, PI, 0.003),
                (0.606, -0.606, 0.0, 0.003),
                (1.57, -1.57, 0.1, 0.003),
                (FRAC_PI_2, FRAC_PI_2, 1.0, 0.5),
                (-1.5, 1.2, 0.7, 3.0),
            ] {
                for model in &models {
                    let light = Light { theta: theta_j, phi, lambda };
                    let o = Direction::new(theta_o, 0.0);
                    for p in 0..3 {
                        let got = srbf_integral(&**model, p, &o, &light);
                        worst = worst.max(got.excess);
                        let fine = got.value.iter().all(|v| (0.0..4.0).contains(v));
                        assert!(fine && got.excess <= 1.0, "{theta_o} {lambda} {p}: {got:?}");
                    }
                }
            }
        }
    }
    println!("hard cases: {worst:.2} of the promised error at worst");
    // What is not done says so.
    let bare = Fibre { w_c: 0.0, eccentricity: 0.9, ..fibre(0.1, 0.0, 5.0) };
    let light = Light { theta: 0.1, phi: 0.2, lambda: 0.3 };
    let got = srbf_integral(&Marschner::new(&bare), 2, &Direction::new(0.0, 0.0), &light);
    assert!(got.excess > 1.0 && got.value[0].is_nan(), "{got:?}");
}

/// Figures from an independent script: R, +TT, +TRT, +TRRT of a smooth clear fibre of η = 1.55.
#[test]
fn albedo_is_the_known_total_reflectance() {
    let smooth = Fibre { beta: [2e-3; 3], ..fibre(0.0, 0.0, 5.0) };
    let model = Deon::new(&smooth, 0.1, 4);
    for (degrees, known) in [
        (0.0, [0.075, 0.937, 0.992, 0.998]),
        (75.0, [0.360, 0.785, 0.922, 0.969]),
        (85.0, [0.688, 0.791, 0.859, 0.904f64]),
    ] {
        let o = Direction::new(f64::to_radians(degrees), 0.0);
        let mut sum = 0.0;
        for (p, known) in known.into_iter().enumerate() {
            sum += lobe_albedo(&model, p, &o).value[0];
            println!("{degrees}°, lobes up to {p}: {sum:.4}, known {known}");
            assert!((sum - known).abs() < 8e-4, "{degrees}°, {p}: {sum}");
        }
        let whole = albedo(&model, &o);
        println!("{degrees}°: all lobes 1 − {:.1e}", 1.0 - whole.value[0]);
        assert!((whole.value[0] - 1.0).abs() < 1e-4, "{whole:?}");
    }
    // A very wide light is an even one.
    let model = Marschner::new(&fibre(0.3, -5.0, 10.0));
    let o = Direction::new(0.5, 0.0);
    let wide = |lambda| -> f64 {
        let light = Light { theta: 0.4, phi: 1.0, lambda };
        (0..3).map(|p| srbf_integral(&model, p, &o, &light).value[0]).sum()
    };
    let even = albedo(&model, &o).value[0];
    assert!((wide(1e4) / even - 1.0).abs() < 1e-7, "{} {even}", wide(1e4));
    assert!((wide(10.0) / even - 1.0).abs() > 1e-3, "the control: λ_j = 10 is even light");
}

#[test]
fn the_far_field_density_is_the_mean_over_h() {
    let fibre = fibre(0.3, -5.0, 8.0);
    let models: [Box<dyn FibreModel>; 2] =
        [Box::new(Marschner::new(&fibre)), Box::new(Deon::new(&fibre, 0.1, 3))];
    for model in &models {
        let (o, i) = (Direction::new(0.4, 0.1), Direction::new(-0.3, 0.6));
        let got = far_field_pdf(&**model, &o, &i);
        let count = 20_000;
        let at = |k: usize| 2.0 * (k as f64 + 0.5) / count as f64 - 1.0;
        let want =
            (0..count).map(|k| model.evaluate(&o, &i, at(k)).pdf).sum::<f64>() / count as f64;
        println!("pdf {:.8}, mean of {count} h {want:.8}", got.value[0]);
        assert!((got.value[0] / want - 1.0).abs() < 1e-5 && got.excess <= 1.0, "{got:?} {want}");
        assert!((model.evaluate(&o, &i, 0.3).pdf / want - 1.0).abs() > 1e-5, "h is not felt");
    }
}

fn averages_of(model: &dyn FibreModel, fibre: &Fibre, theta: f64) -> Averages {
    let shape: Vec<_> = fibre.alpha.into_iter().zip(fibre.beta).collect();
    averages(model, &shape, theta)
}

/// ā_f and ā_b of one lobe as they are defined, first channel: the mean over the half circle that the light
/// comes from of what leaves into either half of the sphere.
fn defined(model: &dyn FibreModel, p: usize, theta: f64) -> [f64; 2] {
    const HALF: usize = 120;
    let step = PI / HALF as f64;
    let mut shares = [0.0; 2];
    for (theta_o, weight) in GaussLegendre::new(40).on(-FRAC_PI_2, FRAC_PI_2) {
        let section = Section { theta_i: theta, theta_o, phi_h: 0.7 };
        let m = weight * theta_o.cos() * model.longitudinal(p, theta, theta_o);
        if m < 1e-9 {
            continue;
        }
        let n: Vec<f64> =
            (0..2 * HALF).map(|k| model.azimuthal(p, wrap(step * k as f64), &section)[0]).collect();
        for (phi_i, phi_o) in (0..HALF).flat_map(|i| (0..HALF).map(move |o| (i, o))) {
            // The forward half begins half a turn after the one that the light comes from.
            for (side, apart) in [(0, HALF), (1, 0)] {
                let value = n[(apart + phi_o + 2 * HALF - phi_i) % (2 * HALF)];
                shares[side] += m * value * step * step / PI;
            }
        }
    }
    shares
}

#[test]
fn shares_equal_their_definition() {
    let fibre = fibre(0.3, -5.0, 10.0);
    let models: [Box<dyn FibreModel>; 2] =
        [Box::new(Marschner::new(&fibre)), Box::new(Deon::new(&fibre, 0.3, 3))];
    for model in &models {
        for (p, theta) in [(0, 0.7), (1, 0.2), (2, -0.4)] {
            let want = defined(&**model, p, theta);
            let got = lobe_shares(&**model, p, theta);
            let off = [0, 1].map(|side| (got.value[3 * side] / want[side] - 1.0).abs());
            println!("lobe {p} at {theta}: {want:.6?}, off by {off:.5?}");
            assert!(off[0].max(off[1]) < 2e-3 && got.excess <= 1.0, "{got:?} {want:?}");
            let control = lobe_shares(&**model, p, theta + 0.3).value;
            assert!((control[0] / want[0] - 1.0).abs() > 2e-3, "θ is not felt");
        }
    }
}

/// White hair under a Gaussian M: what an independent script found for 85°, and no more than there was light.
#[test]
fn white_hair_loses_light_at_grazing_by_the_definition() {
    let even = Fibre { beta: [10f64.to_radians(); 3], ..fibre(0.0, 0.0, 10.0) };
    let of = |degrees: f64| {
        let a = averages_of(&Marschner::new(&even), &even, degrees.to_radians());
        a.a_f[0] + a.a_b[0]
    };
    println!(
        "β = 10°: ā_f+ā_b {:.4} at 0°, {:.4} at 60°, {:.4} at 85°",
        of(0.0),
        of(60.0),
        of(85.0)
    );
    // The other's h was not ours, to a part in 200.
    assert!((of(85.0) - 0.365).abs() < 2e-3);
    assert!((of(84.0) - 0.365).abs() > 2e-3, "the control: another angle passes");
    assert!((0..90).step_by(15).all(|degrees| of(f64::from(degrees)) < 1.0));
}

/// Zinke's formulas from the averages that they take, with mistakes seen in public code as controls.
#[test]
fn formulas_are_as_printed() {
    for sigma_a in [0.0, 0.3] {
        let fibre = fibre(sigma_a, -5.0, 8.0);
        let a = averages_of(&Marschner::new(&fibre), &fibre, 0.4);
        let near = |got: f64, want: f64| (got - want).abs() <= 1e-12 * want.abs();
        for c in 0..3 {
            let (f, b) = (a.a_f[c], a.a_b[c]);
            let (f2, b2, d) = (f * f, b * b, 1.0 - f * f);
            let sum = |side: usize, of: [f64; 3]| -> f64 {
                (0..3).map(|p| a.lobes[p][side][c] * of[p]).sum()
            };
            let (alpha_f, alpha_b) = (sum(0, fibre.alpha) / f, sum(1, fibre.alpha) / b);
            let beta2 = fibre.beta.map(|beta| beta * beta);
            let (beta_f2, beta_b2) = (sum(0, beta2) / f, sum(1, beta2) / b);
            assert!(near(a.alpha_f[c], alpha_f) && near(a.alpha_b[c], alpha_b), "{a:?}");
            assert!(near(a.beta_f[c].powi(2), beta_f2) && near(a.beta_b[c].powi(2), beta_b2));
            // Weighted by channels instead of lobes.
            let whole: f64 = a.a_f.iter().sum();
            let wrong = (0..3).map(|k| a.a_f[k] * fibre.alpha[k]).sum::<f64>() / whole;
            assert!(!near(a.alpha_f[c], wrong));

            let a_1 = b * f2 / d;
            assert!(near(a.big_a_b_two_terms[c], a_1 + b * b2 * f2 / d.powi(3)));
            assert!(!near(a.big_a_b_two_terms[c], a_1 + b * b2 * f2 / d.powi(2)));
            // The whole series as layers that add up.
            let layers = (0..5000).fold(0.0, |r, _| b + f2 * r / (1.0 - b * r)) - b;
            assert!((a.big_a_b[c] - layers).abs() < 1e-9, "{} {layers}", a.big_a_b[c]);
            assert!(a.big_a_b[c] > a.big_a_b_two_terms[c]);

            let own = alpha_b * (1.0 - 2.0 * b2 / (d * d));
            let other = alpha_f * (2.0 * d * d + 4.0 * f2 * b2) / d.powi(3);
            assert!(near(a.delta_b[c], own + other) && !near(a.delta_b[c], own * other));

            let (beta_f, beta_b) = (beta_f2.sqrt(), beta_b2.sqrt());
            let spread = |three: f64| {
                let width = b * (2.0 * beta_f2 + beta_b2).sqrt()
                    + b * b2 * (2.0 * beta_f2 + three * beta_b2).sqrt();
                (1.0 + 0.7 * f2) * width / (b + b * b2 * (2.0 * beta_f + 3.0 * beta_b))
            };
            assert!(near(a.sigma_b[c], spread(3.0)) && !near(a.sigma_b[c], spread(1.0)));
        }
    }
    // A fibre that lets all light through has nothing to divide by.
    let clear = Fibre { eta: 1.0, ..fibre(0.0, -5.0, 2.0) };
    let a = averages_of(&Marschner::new(&clear), &clear, 0.0);
    let all = [a.alpha_b, a.beta_b, a.big_a_b, a.big_a_b_two_terms, a.delta_b, a.sigma_b];
    assert!(all.as_flattened().iter().all(|x| x.is_finite()), "{a:?}");
}

/// The renderer's averages weigh with flux of unit integral: the definition's lose light that these keep.
#[test]
fn the_renderers_averages_are_near_the_exact_ones_off_grazing() {
    let mut worst = [0f64; 2];
    for (name, sigma_a) in [("white", 0.0), ("blond", 0.25), ("black", 11.0)] {
        let fibre = Fibre { sigma_a: [sigma_a; 3], ..fibre(0.0, 0.0, 7.5) };
        let (model, table) = (Marschner::new(&fibre), AverageTable::new(&fibre, 4));
        for degrees in [0.0, 30.0, 60.0, 85.0f64] {
            let theta = degrees.to_radians();
            let (want, got) = (averages_of(&model, &fibre, theta), table.sample(theta));
            let off = [got.a_f[0] / want.a_f[0], got.a_b[0] / want.a_b[0]].map(|x| x - 1.0);
            println!(
                "{name} {degrees}°: ā_f {:.4} (renderer {:+.1} %), ā_b {:.4} ({:+.1} %), Ā_b {:.4} ({:.4})",
                want.a_f[0],
                100.0 * off[0],
                want.a_b[0],
                100.0 * off[1],
                want.big_a_b[0],
                got.big_a_b[0]
            );
            let k = usize::from(degrees > 45.0);
            worst[k] = off.iter().fold(worst[k], |w, x| w.max(x.abs()));
        }
    }
    assert!(worst[0] < 0.04, "{worst:?}");
    assert!(worst[1] > 0.5, "the control: at 85° they are said to differ");
}

#[test]
fn a_cosine_series_is_the_integral() {
    let model = Deon::conserving(&fibre(0.3, -5.0, 8.0), 0.14, 4);
    let other = Deon::conserving(&fibre(0.3, -5.0, 8.0), 0.142, 4);
    // Without its series.
    let plain = Mixed(model.clone(), model.clone());
    let (mut worst, mut control) = (0f64, 0f64);
    for (theta_o, theta, phi, lambda) in [
        (0.4, -0.3, 0.2, 0.3),
        (-1.2, 1.0, 2.9, 0.05),
        (0.0, 0.2, -1.5, 1.0),
        (1.5, -1.4, 0.7, 0.1),
    ] {
        let (o, light) = (Direction::new(theta_o, 0.0), Light { theta, phi, lambda });
        for p in 0..model.lobes() {
            let exact = srbf_integral(&plain, p, &o, &light).value[1];
            // A series ends at 1e-13 of the lobe's energy, whatever of it gets to φ.
            let whole = srbf_integral(&plain, p, &o, &Light { lambda: 10.0, ..light });
            let scale = exact.max(1e-4 * lambda * whole.value[1]);
            let off = |m| (srbf_integral(m, p, &o, &light).value[1] - exact).abs() / scale;
            worst = worst.max(off(&model));
            control = control.max(off(&other));
        }
    }
    println!("{worst:.1e} off, of another blur {control:.1e}");
    assert!(worst < 2e-8 && control > 1e-4);
}
