//! The `fast` method against the exact integrals, its shaders against their twins.

use std::f64::consts::{PI, SQRT_2};

use hairlight::gpu::{Gpu, method::MethodData};
use hairlight::reference::integral::{Light, srbf_integral};
use hairlight::reference::{
    deon::Deon,
    marschner::Marschner,
    model::{Direction, FibreModel},
};
use hairlight::scattering::{
    azimuth_table::Mode,
    azimuthal::Energy,
    fast::{Fast, Tables},
    fibre::Fibre,
    longitudinal,
    model::Model,
    xu::{Modes, Xu},
};
use hairlight::scene::Energies;
use rayon::prelude::*;

use super::wgsl::{Case, SINGLE, check, cpu, low_discrepancy, scattering_input, worst};

fn fibre(eta: f64, sigma_a: f64, beta_r_deg: f64) -> Fibre {
    let radians = |x: [f64; 3]| x.map(f64::to_radians);
    Fibre {
        eta,
        sigma_a: [sigma_a; 3],
        alpha: radians([-7.5, 3.75, 11.25]),
        beta: radians([beta_r_deg, 0.5 * beta_r_deg, 2.0 * beta_r_deg]),
        w_c: 0.2,
        eccentricity: 1.0,
        tint: Fibre::UNTINTED,
    }
}

/// A method's values of R, TT, TRT and longer paths, first channel.
fn first(modes: Modes) -> [f64; 4] {
    [modes.r[0], modes.tt[0], modes.trt[0], modes.longer[0]]
}

/// Relative L2 error of R, TT, TRT and longer paths over `places` (θ_o, θ_j, φ) of one setting; 0 of what a fibre
/// lacks.
fn error(
    model: &dyn FibreModel,
    lambda_j: f64,
    places: &[[f64; 3]],
    method: impl Fn([f64; 3]) -> Modes + Sync,
) -> [f64; 4] {
    let sums: Vec<[[f64; 2]; 4]> = places
        .par_iter()
        .map(|&[theta_o, theta_j, phi]| {
            let o = Direction::new(theta_o, 0.0);
            let light = Light { theta: theta_j, phi, lambda: lambda_j };
            let got = first(method([theta_o, theta_j, phi]));
            std::array::from_fn(|p| {
                let lobes = if p < 3 { p..p + 1 } else { 3..model.lobes() };
                let exact: f64 = lobes.map(|p| srbf_integral(model, p, &o, &light).value[0]).sum();
                [(got[p] - exact).powi(2), exact * exact]
            })
        })
        .collect();
    std::array::from_fn(|p| {
        let sum = |k: usize| sums.iter().map(|s| s[p][k]).sum::<f64>();
        if sum(1) > 0.0 { (sum(0) / sum(1)).sqrt() } else { sum(0) }
    })
}

/// θ_o and θ_j to ±75°, the light where M_t can see it as often as not.
pub(super) fn places(count: usize) -> Vec<[f64; 3]> {
    let limit = 75f64.to_radians();
    let at = |i: usize| {
        let u = low_discrepancy(i);
        let theta_o = limit * (2.0 * u[0] - 1.0);
        let near = (-theta_o + 1.6 * (u[1] - 0.5)).clamp(-limit, limit);
        let theta_j = if i.is_multiple_of(2) { near } else { limit * (2.0 * u[1] - 1.0) };
        [theta_o, theta_j, PI * (2.0 * u[2] - 1.0)]
    };
    (0..count).map(at).collect()
}

/// Prints and returns the root mean square and the worst over settings, R, TT, TRT and longer paths each.
fn summary(name: &str, errors: &[[f64; 4]]) -> [[f64; 4]; 2] {
    let rms = std::array::from_fn(|p| {
        (errors.iter().map(|e| e[p] * e[p]).sum::<f64>() / errors.len() as f64).sqrt()
    });
    let worst = std::array::from_fn(|p| errors.iter().map(|e| e[p]).fold(0.0, f64::max));
    let percent = |x: [f64; 4]| x.map(|x| format!("{:.2}", 100.0 * x)).join(" / ");
    println!("{name}: rms {} %, worst {} %", percent(rms), percent(worst));
    [rms, worst]
}

/// The grid of the paper's error: settings (η, σ_a, β_R, λ_j).
fn settings(etas: &[f64], absorptions: &[f64], betas: &[f64]) -> Vec<(Fibre, f64)> {
    let mut settings = Vec::new();
    for &eta in etas {
        for &sigma_a in absorptions {
            for &beta in betas {
                for lambda_j in [0.1, 0.3, 0.6, 1.0] {
                    settings.push((fibre(eta, sigma_a, beta), lambda_j));
                }
            }
        }
    }
    settings
}

fn errors_of_fast(
    model: Model,
    settings: &[(Fibre, f64)],
    places: &[[f64; 3]],
    nodes: usize,
) -> Vec<[f64; 4]> {
    let tables: Vec<(f64, Tables)> = [1.45, 1.55, 1.65]
        .map(|eta| (eta, Tables::new(&fibre(eta, 0.0, 7.5), model, nodes)))
        .into();
    settings
        .iter()
        .map(|(fibre, lambda_j)| {
            let (_, tables) = tables.iter().find(|(eta, _)| *eta == fibre.eta).expect("a table");
            let fast = Fast::new(fibre, model, tables);
            let exact: Box<dyn FibreModel> = match model {
                Model::Marschner => Box::new(Marschner::new(fibre)),
                Model::Deon => Box::new(Deon::conserving(fibre, fibre.w_c / SQRT_2, 4)),
            };
            error(&*exact, *lambda_j, places, |[o, j, phi]| {
                fast.single_scattering(o, j, phi, 1.0, *lambda_j)
            })
        })
        .collect()
}

fn errors_of_xu(settings: &[(Fibre, f64)], places: &[[f64; 3]]) -> Vec<[f64; 4]> {
    settings
        .iter()
        .map(|(fibre, lambda_j)| {
            let xu = Xu::new(fibre, 4, Energy::Quadrature);
            error(&Marschner::new(fibre), *lambda_j, places, |[o, j, phi]| {
                xu.single_scattering(o, j, phi, 1.0, *lambda_j)
            })
        })
        .collect()
}

#[test]
fn fast_is_within_a_percent_where_the_paper_is_within_ten() {
    let places = places(60);
    let settings = settings(&[1.45, 1.65], &[0.0, 1.0, 3.0], &[7.5]);
    let [xu, _] = summary("xu m = 4", &errors_of_xu(&settings, &places));
    let errors = errors_of_fast(Model::Marschner, &settings, &places, 2);
    let [rms, worst] = summary("fast, 2 nodes", &errors);
    for p in 0..3 {
        assert!(rms[p] < 0.01 && worst[p] < 0.03, "mode {p}: {} {}", rms[p], worst[p]);
        assert!(xu[p] > 0.02, "the control, xu, passes in mode {p}: {}", xu[p]);
    }
}

#[test]
fn fast_of_deon_is_within_a_percent() {
    let places = places(60);
    let settings = settings(&[1.45, 1.65], &[0.0, 1.0, 3.0], &[7.5]);
    let nodes = Model::Deon.nodes() as usize;
    let errors = errors_of_fast(Model::Deon, &settings, &places, nodes);
    let [rms, worst] = summary("deon, 3 nodes", &errors);
    for p in 0..3 {
        assert!(rms[p] < 0.01 && worst[p] < 0.03, "lobe {p}: {} {}", rms[p], worst[p]);
    }
    // Longer paths where they can be seen, in clear fibres.
    let clear = settings.iter().zip(&errors).filter(|((f, _), _)| f.sigma_a[0] == 0.0);
    let [rms, worst] = summary("of clear fibres", &clear.map(|(_, e)| *e).collect::<Vec<_>>());
    assert!(rms[3] < 0.01 && worst[3] < 0.03, "longer: {} {}", rms[3], worst[3]);
    let dark = fibre(1.65, 1.0, 7.5);
    let tables = Tables::new(&dark, Model::Deon, nodes);
    let share = |f: &Fibre| Fast::new(f, Model::Deon, &tables).share_of(Mode::Trrt);
    let (of_dark, of_clear) = (share(&dark), share(&fibre(1.65, 0.0, 7.5)));
    println!("longer paths have {of_dark:.1e} of σ_a = 1, {of_clear:.1e} of clear");
    assert!(of_dark < 1.0 / 512.0 && of_clear > 1.0 / 512.0);
    // The control: Marschner's fibre is another.
    let other = errors_of_fast(Model::Deon, &settings[..4], &places, 2);
    let tables = Tables::new(&settings[0].0, Model::Marschner, 2);
    let wrong =
        error(&Deon::conserving(&settings[0].0, 0.2 / SQRT_2, 4), 0.3, &places, |[o, j, phi]| {
            Fast::new(&settings[0].0, Model::Marschner, &tables)
                .single_scattering(o, j, phi, 1.0, 0.3)
        });
    println!("2 nodes {:?}, Marschner's {wrong:?}", other[1]);
    assert!(wrong.iter().all(|e| *e > 0.03));
}

#[test]
#[ignore = "by hand, minutes: the whole grid of the paper's error"]
fn by_hand_the_whole_grid() {
    let places = places(40);
    let all = settings(&[1.45, 1.55, 1.65], &[0.0, 0.2, 0.6, 1.0, 3.0], &[5.0, 7.5, 10.0]);
    let runs = [2, 3, 4].map(|nodes| (Model::Marschner, nodes)).into_iter();
    for (model, nodes) in runs.chain([(Model::Deon, 3), (Model::Deon, 4)]) {
        let errors = errors_of_fast(model, &all, &places, nodes);
        let [rms, worst] = summary(&format!("{model:?}, {nodes} nodes"), &errors);
        for lambda in 0..4 {
            let some: Vec<_> = errors.iter().skip(lambda).step_by(4).copied().collect();
            summary(&format!("  λ_j = {}", [0.1, 0.3, 0.6, 1.0][lambda]), &some);
        }
        // Longer paths are too faint to be seen where they are further off.
        assert!(rms[..3].iter().all(|&e| e < 0.01) && worst[..3].iter().all(|&e| e < 0.03));
    }
    let dark = settings(&[1.45, 1.55, 1.65], &[8.0, 20.0], &[7.5]);
    let errors = errors_of_fast(Model::Marschner, &dark, &places, 2);
    summary("Marschner, 2 nodes, σ_a 8 and 20", &errors);
}

#[test]
fn shaders_equal_their_twins() {
    let gpu: Gpu = cpu();
    let coloured = |beta: f64, sigma_a: [f64; 3], eccentricity: f64| Fibre {
        sigma_a,
        eccentricity,
        ..fibre(1.55, 0.0, beta)
    };
    for (model, fibre) in [
        (Model::Marschner, coloured(7.5, [0.0, 0.3, 1.5], 1.0)),
        (Model::Marschner, coloured(3.0, [2.0, 4.0, 11.0], 1.0)),
        (Model::Marschner, coloured(12.0, [0.1, 0.2, 0.4], 0.9)),
        (Model::Deon, coloured(7.5, [0.0, 0.3, 1.5], 1.0)),
        (Model::Deon, coloured(12.0, [0.1, 0.2, 0.4], 0.9)),
    ] {
        let tables = Tables::new(&fibre, model, 3);
        let fast = Fast::new(&fibre, model, &tables);
        // 16-bit tables are the same on both sides: what is left is f32, and 8e-4 of each 2π I₀e.
        let case = |name, statement, twin| Case {
            name,
            statement,
            relative: if model == Model::Deon { 3e-3 } else { 2e-3 },
            floor: 1e-5,
            input: scattering_input,
            twin,
        };
        let whole = |modes: Modes| [modes.r, modes.tt, modes.trt, modes.longer].concat();
        let single = |x: [f64; 8]| whole(fast.single_scattering(x[0], x[1], x[2], x[3], x[4]));
        let energy = |x: [f64; 8]| fast.energy_compensation(x[0]).to_vec();
        let cases = [
            case("single_scattering", SINGLE, &single as &dyn Fn([f64; 8]) -> Vec<f64>),
            case(
                "energy_compensation",
                "y[0] = vec4f(energy_compensation(fibre, x[0].x), 0.0);",
                &energy,
            ),
        ];
        check(&gpu, &MethodData::fast(&fibre, model, 3).as_general(), &cases, 2048);
        // The control: another fibre.
        let other = MethodData::fast(&Fibre { eta: 1.57, ..fibre }, model, 3);
        for case in &cases {
            let (excess, _) = worst(&gpu, &other, case, 512);
            let constant = model == Model::Deon && case.name == "energy_compensation";
            assert!(excess > 1.0 || constant, "{} does not feel η", case.name);
        }
    }
}

/// Nanoseconds of one core for a call of `statement`'s loop body, by the difference of two loop lengths.
fn cost(gpu: &Gpu, method: &MethodData, body: &str) -> f64 {
    let inputs: Vec<[f32; 8]> =
        (0..16_384).map(|i| scattering_input(low_discrepancy(i)).map(|x| x as f32)).collect();
    let time = |count: u32| {
        let statement = format!(
            "var sum = vec3f(); for (var i = 0u; i < {count}u; i++) {{ let d = 0.01 * f32(i); {body} }}
            y[0] = vec4f(sum, 0.0);"
        );
        let begun = std::time::Instant::now();
        hairlight::gpu::probe::run(gpu, &statement, method, &inputs).expect("the probe runs");
        begun.elapsed().as_secs_f64()
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from) as f64;
    1e9 * cores * (time(40) - time(8)) / (32.0 * inputs.len() as f64)
}

#[test]
#[ignore = "by hand: prints what a point and light costs beside xu"]
fn by_hand_cost_beside_xu() {
    let gpu = cpu();
    let fibre = Fibre { sigma_a: [0.1, 0.3, 0.7], ..fibre(1.55, 0.0, 7.5) };
    let single = "let m = single_scattering(fibre, x[0].x, x[0].y + d, x[0].z + d, x[0].w, x[1].x); sum += m.r + m.tt + m.trt + m.longer;";
    let global = "let m = global_scattering(fibre, x[0].x, x[0].y + d, x[0].z + d, x[1].x); sum += m.r + m.tt + m.trt + m.longer;";
    let dual = "let a = averages(x[0].x + d); sum += a.a_f + a.a_b + a.beta_f2;
        sum += local_scattering_direct(fibre, x[0].x, x[0].y + d, x[0].z + d, x[1].x);
        sum += local_scattering_forward(fibre, x[0].x, x[0].y + d, x[0].z + d, x[1].x);";
    let xu = MethodData::xu(&fibre, 4, Energies::Quadrature);
    let rows = [
        ("fast 2", MethodData::fast(&fibre, Model::Marschner, 2)),
        ("fast 3", MethodData::fast(&fibre, Model::Marschner, 3)),
        ("deon 2", MethodData::fast(&fibre, Model::Deon, 2)),
        ("deon 3", MethodData::fast(&fibre, Model::Deon, 3)),
    ];
    for _ in 0..3 {
        let [s, g, d] = [single, global, dual].map(|body| cost(&gpu, &xu, body));
        println!("xu m=4: single {s:.0}, global {g:.0}, averages and local {d:.0} ns");
        for (name, method) in &rows {
            println!("{name}: single {:.0} ns", cost(&gpu, method, single));
        }
    }
}

#[test]
fn energy_compensation_is_the_renderers() {
    let fibre = fibre(1.55, 0.0, 7.5);
    let tables = Tables::new(&fibre, Model::Marschner, 3);
    let fast = Fast::new(&fibre, Model::Marschner, &tables);
    let clear = hairlight::scattering::azimuthal::ClearEnergies::new(1.55);
    for theta_o in [-1.4, -0.7, 0.0, 0.5, 1.2] {
        let got = fast.energy_compensation(theta_o);
        for (t, got) in got.into_iter().enumerate() {
            // Dense: the paper's rule with many segments does not converge, so by Gauss–Legendre.
            let rule = hairlight::scattering::quadrature::GaussLegendre::new(64);
            let (low, high) = longitudinal::lobe_range(theta_o, fibre.alpha[t], fibre.beta[t]);
            let kept: f64 = rule.integrate(low, high, |theta_i| {
                longitudinal::longitudinal(theta_i, theta_o, fibre.alpha[t], fibre.beta[t])
                    * longitudinal::projection(theta_i, theta_o)
                    * clear.at(0.5 * (theta_o - theta_i))[t]
            });
            let want = (clear.at(theta_o)[t] / kept).min(longitudinal::COMPENSATION_MAX);
            println!("C_{t}({theta_o}) {got:.4}, exact {want:.4}");
            assert!((got / want - 1.0).abs() < 0.02, "C_{t}({theta_o}): {got} {want}");
        }
    }
}
