//! Speed against error: what a run says must hold of any machine, so nothing here judges a time.

use std::f64::consts::PI;
use std::sync::atomic::AtomicBool;

use hairlight::gpu::Gpu;
use hairlight::gpu::probe::{INPUTS, run};
use hairlight::measure::bench::integrals::Set;
use hairlight::measure::bench::method::{BASELINE, METHODS, Method, exact_single};
use hairlight::measure::bench::statistics::{Spread, pareto, rms};
use hairlight::measure::bench::{self, Bench, Effort, Groom};
use hairlight::measure::plot::{Axis, Bars, Part, Plot};
use hairlight::probe::{Quantity, Request};
use hairlight::progress::{Clock, Reporting};
use hairlight::reference::integral::{Light, srbf_integral};
use hairlight::reference::marschner::Marschner;
use hairlight::reference::model::Direction;
use hairlight::scattering::fibre::Fibre;
use hairlight::scattering::tables;
use hairlight::scene::{Bcsdf, Scene};

fn cpu() -> Gpu {
    Gpu::new("cpu").expect("a CPU adapter (lavapipe)")
}

/// The baseline with every lobe half as wide again: it must be seen to be worse.
fn wrong() -> Method {
    Method {
        setting: "wrong",
        data: |_, fibre, tables| {
            let other = Fibre { beta: fibre.beta.map(|b| 1.5 * b), ..*fibre };
            METHODS[BASELINE].data(&other, tables)
        },
        ..METHODS[BASELINE]
    }
}

#[test]
fn the_front_is_what_nothing_beats() {
    let points = [[1.0, 9.0], [2.0, 4.0], [3.0, 4.0], [4.0, 1.0], [5.0, 5.0], [2.0, 4.0]];
    assert_eq!(pareto(&points), [true, true, false, true, false, true]);
    assert_eq!(pareto(&[]), Vec::<bool>::new());
    let spread = Spread::of(&[5.0, 1.0, 3.0, 2.0, 4.0]);
    assert_eq!((spread.lower, spread.median, spread.upper), (2.0, 3.0, 4.0));
    assert_eq!(rms([3.0, 4.0].into_iter()), 12.5f64.sqrt());
}

#[test]
fn bars_are_stacked_end_to_end() {
    let part = |name: &str, values: &[f64]| Part {
        name: name.to_owned(),
        colour: [0; 3],
        values: values.to_vec(),
    };
    let bars = Bars {
        title: "causes".to_owned(),
        x: Axis::linear("error", 0.0, 8.0, 2.0),
        bars: vec!["one".to_owned(), "two".to_owned()],
        parts: vec![part("a", &[1.0, 2.0]), part("b", &[0.5, 0.0]), part("c", &[2.0, 4.0])],
    };
    assert_eq!(bars.spans(0), [[0.0, 1.0], [1.0, 1.5], [1.5, 3.5]]);
    assert_eq!(bars.most(), 6.0);
    let plot = Plot::Bars { panels: vec![bars] };
    let csv = String::from_utf8(plot.csv().unwrap()).unwrap();
    assert_eq!(csv.lines().count(), 7, "{csv}");
    let svg = plot.svg();
    // One for the page, and one a part and bar.
    assert_eq!(svg.matches("<rect").count(), 7, "{svg}");
    assert!(!plot.png(&svg).unwrap().is_empty());
}

/// The quadrature that stands in for a method's single scattering, and its negative control.
#[test]
fn exact_wgsl_is_the_exact_integral() {
    let gpu = cpu();
    let fibre = Fibre {
        eta: 1.55,
        sigma_a: [0.0, 0.6, 3.0],
        alpha: [-7.5, 3.75, 11.25].map(f64::to_radians),
        beta: [7.5, 3.75, 15.0].map(f64::to_radians),
        w_c: 0.2,
        eccentricity: 1.0,
        tint: Fibre::UNTINTED,
    };
    let model = Marschner::new(&fibre);
    let at = |i: u32| {
        let u = sobol_burley::sample_4d(i, 0, 7).map(f64::from);
        let theta_o = 1.4 * (2.0 * u[0] - 1.0);
        let theta_j = (-theta_o + 0.8 * (2.0 * u[1] - 1.0)).clamp(-1.4, 1.4);
        [theta_o, theta_j, PI * (2.0 * u[2] - 1.0), 0.03 * 30f64.powf(u[3])]
    };
    let points: Vec<[f64; 4]> = (0..96).map(at).collect();
    let inputs: Vec<[f32; INPUTS]> = points
        .iter()
        .map(|&[o, j, phi, lambda]| [o, j, phi, 1.0, lambda, 0.0, 0.0, 0.0].map(|x| x as f32))
        .collect();
    let exact: Vec<[[f64; 3]; 3]> = points
        .iter()
        .map(|&[o, theta, phi, lambda]| {
            let light = Light { theta, phi: -phi, lambda };
            [0, 1, 2].map(|p| srbf_integral(&model, p, &Direction::new(o, 0.0), &light).value)
        })
        .collect();
    // Relative L2 of each mode and colour.
    let errors = |fibre: &Fibre| -> Vec<f64> {
        let data = exact_single(Bcsdf::Marschner, fibre).expect("a shader of this model");
        let request = Request { quantity: Quantity::SingleScattering, integrator: data.integrator };
        let values = run(&gpu, request.statement(), &data, &inputs).expect("the probe runs");
        (0..9)
            .map(|k| {
                let [mut apart, mut whole] = [0.0; 2];
                for (value, exact) in values.iter().zip(&exact) {
                    let exact = exact[k / 3][k % 3];
                    apart += (f64::from(value[k]) - exact).powi(2);
                    whole += exact * exact;
                }
                (apart / whole).sqrt()
            })
            .collect()
    };
    let found = errors(&fibre);
    println!("relative L2 of R, TT, TRT by colour: {found:.5?}");
    assert!(found.iter().all(|e| *e < 1e-3), "{found:.5?}");
    let other = Fibre { eta: 1.01 * fibre.eta, sigma_a: fibre.sigma_a.map(|s| s + 0.05), ..fibre };
    let off = errors(&other);
    println!("of a fibre one percent off: {off:.5?}");
    assert!(off.iter().all(|e| *e > 1e-3), "{off:?}");
}

#[test]
fn a_wrong_setting_ranks_worse() {
    let (gpu, tables) = (cpu(), tables::build());
    let set = Set::new(&METHODS[BASELINE], 8, &|_| true).expect("not cancelled");
    let errors = |method: &Method| {
        let modes = set.judge(&gpu, method, &tables).expect("the probe runs");
        println!("{}: {:.4?}", method.label(), modes.each_ref().map(|m| (m.rms, m.worst)));
        modes.map(|mode| mode.rms)
    };
    let (right, wrong) = (errors(&METHODS[BASELINE]), errors(&wrong()));
    for mode in 0..3 {
        assert!(wrong[mode] > 1.2 * right[mode], "mode {mode}: {wrong:?} against {right:?}");
    }
    assert!(Set::new(&METHODS[BASELINE], 2, &|_| false).is_none());
}

/// The default method.
fn fast() -> Method {
    *METHODS.iter().find(|method| method.name == "fast").expect("it is measured")
}

fn measured(methods: &[Method], grooms: &[Groom], effort: &Effort) -> Bench {
    static GO_ON: AtomicBool = AtomicBool::new(false);
    let mut clock = Clock::new(Reporting { quiet: true, cancelled: &GO_ON, told: None });
    bench::measure(cpu(), methods, grooms, effort, true, &mut clock).unwrap()
}

/// A whole run, small: every figure is there and is a number, and the frames' errors are told apart.
#[test]
fn a_tiny_run_measures_everything() {
    let effort = Effort {
        points: 1,
        timed: 1024,
        rounds: 2,
        size: [32, 32],
        samples: 4,
        frame_rounds: 1,
        pictures: &[("blond", "overcast")],
        truth_samples: 16,
        traced: &[1, 4],
        rays: 2,
        lights: &[4],
        strands: 1000,
        ..Effort::QUICK
    };
    let mut bob = Scene::default();
    bob.hair.strands = effort.strands;
    bob.environment.lights = Some(4);
    let groom = Groom { name: "bob".to_owned(), scene: bob };
    let methods = [Method { by_cause: false, ..METHODS[0] }, fast()];
    let bench = measured(&methods, &[groom], &effort);
    let image = &bench.images[0];
    println!("{image:#?}");
    assert_eq!((image.frames.len(), image.traced.len(), image.causes.len()), (2, 2, 1));
    assert_eq!((bench.integrals.rows.len(), bench.integrals.brute_force.len()), (2, 4));
    let causes = &image.causes[0];
    assert_eq!(causes.whole, image.frames[1].error, "frames repeat to the bit");
    for part in &causes.parts {
        assert!(part.alone.is_finite() && part.alone >= 0.0, "{part:?}");
    }
    // Integrals within 1 % are a small cause, which takes a renderer that sums every light whatever it costs.
    let integral = causes.parts.iter().find(|part| part.name == "scattering integral").unwrap();
    assert!(integral.alone < 0.01 && image.lights > 20, "{integral:?}");
    assert!(image.frames.iter().all(|row| row.shade_ms.median > 0.0 && row.error < 1.0));
    assert!(image.traced[0].error > image.traced[1].error, "more samples, less noise");
    assert!(bench.integrals.brute_force[0].modes[0] > bench.integrals.brute_force[3].modes[0]);
}

/// Causes of both grooms, three colours under three maps: the README's table, a row a picture.
#[test]
#[ignore = "by hand, minutes, with ../shared/data: prints the README's table of causes"]
fn by_hand_causes_over_colours_and_maps() {
    let effort = Effort {
        points: 1,
        timed: 1024,
        rounds: 1,
        size: [64, 64],
        frame_rounds: 1,
        pictures: Effort::FULL.pictures,
        traced: &[1],
        strands: 3000,
        ..Effort::QUICK
    };
    let mut bob = Scene::default();
    bob.hair.strands = effort.strands;
    let mut sintel = Scene::default();
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data");
    sintel.hair.source = format!("{data}/hair/sintel.hair");
    sintel.head.source = format!("{data}/head/sintel.obj");
    let grooms = [("bob", bob), ("sintel", sintel)]
        .map(|(name, scene)| Groom { name: name.to_owned(), scene });
    let methods = [METHODS[BASELINE], fast()];
    let bench = measured(&methods, &grooms, &effort);
    for image in &bench.images {
        let causes: Vec<String> = image
            .causes
            .iter()
            .map(|c| {
                let parts = c.parts.iter().map(|part| format!("{:.1}", 100.0 * part.alone));
                format!("{:.0} | {}", 100.0 * c.whole, parts.collect::<Vec<_>>().join(" / "))
            })
            .collect();
        println!("| {} | {} |", image.name(), causes.join(" | "));
    }
    // Multiple scattering was the largest cause.
    let multiple = |k: usize| {
        let of = bench.images.iter().map(|image| image.causes[k].parts[4].alone.powi(2));
        (of.sum::<f64>() / bench.images.len() as f64).sqrt()
    };
    println!("multiple scattering, rms: xu {:.3}, fast {:.3}", multiple(0), multiple(1));
    assert!(multiple(1) < multiple(0));
}
