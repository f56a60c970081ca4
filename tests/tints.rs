//! Tinted lobes: shaders against their twins, integrals and frames against the exact tinted model, and light that hair
//! must not make.

use std::f64::consts::SQRT_2;
use std::path::Path;

use eframe::egui::accesskit::Role;
use eframe::egui::{self, Key, Modifiers};
use egui_kittest::kittest::Queryable;
use hairlight::editor::Document;
use hairlight::editor::lobes::{Lobes, Subject};
use hairlight::gpu::method::{Integrator, MethodData};
use hairlight::light::HairMedium;
use hairlight::measure::compare::compare;
use hairlight::measure::read::Picture;
use hairlight::reference::integral::{Light, srbf_integral};
use hairlight::reference::model::{Direction, FibreModel};
use hairlight::reference::{deon::Deon, marschner::Marschner};
use hairlight::scattering::dual::AverageTable;
use hairlight::scattering::fast::{Fast, Tables};
use hairlight::scattering::fibre::Fibre;
use hairlight::scattering::model::Model;
use hairlight::scattering::xu::{Modes, Xu};
use hairlight::scattering::{azimuth_table::Mode, azimuthal::Energy};
use hairlight::scene::{Bcsdf, Energies, FibreSpec, PRESETS, RenderSpec, Scene};
use hairlight::srbf::split_wide;
use hairlight::stage::Geometry;
use tempfile::tempdir;

use super::chi_square::Uniform;
use super::editor::{editor, key, look, seen, small, window};
use super::fast::places;
use super::frames::{captured, write_unit_map};
use super::wgsl::{Case, check, cpu, fibre, scattering_input, worst};

use crate::paint::referenced;

/// R three times as bright, TT gone, TRT red.
const TINT: [[f64; 3]; 3] = [[3.0; 3], [0.0; 3], [1.0, 0.1, 0.05]];
const FLAGS: [&str; 6] = ["--intensity-r", "3", "--intensity-tt", "0", "--tint-trt", "1,0.1,0.05"];

fn tinted(fibre: &Fibre, tint: [[f64; 3]; 3]) -> Fibre {
    Fibre { tint, ..*fibre }
}

#[test]
fn shaders_equal_their_twins() {
    const STATEMENT: &str = "let strand = strand_at(fibre, x[0].x);
        let m = single_scattering(fibre, x[0].x, x[0].y, x[0].z, x[0].w, x[1].x);
        y[0] = vec4f(sum_of(strand.factors, m), 0.0);";
    let gpu = cpu();
    let bare = fibre([0.1, 0.3, 0.7], 7.5, 1.0);
    let own = tinted(&bare, [[2.5, 2.0, 0.5], [0.3, 0.6, 0.9], [1.0, 0.1, 4.0]]);
    let tables = [Model::Marschner, Model::Deon].map(|model| Tables::new(&own, model, 3));
    let fasts = [Model::Marschner, Model::Deon].map(|m| Fast::new(&own, m, &tables[m as usize]));
    let (xu, averages) = (Xu::new(&own, 4, Energy::Quadrature), AverageTable::new(&own, 4));
    let twin = |integrator: Integrator, x: [f64; 8]| {
        let [o, j, phi, cos_sum, lambda, ..] = x;
        let (modes, factors) = match integrator {
            Integrator::Fast(model) => {
                let fast = &fasts[model as usize];
                (fast.single_scattering(o, j, phi, cos_sum, lambda), fast.factors(o))
            }
            Integrator::Xu => {
                let factors = Modes::factors(&own, averages.sample(o).energy);
                (xu.single_scattering(o, j, phi, cos_sum, lambda), factors)
            }
        };
        modes.times(&factors).sum().to_vec()
    };
    let data = |integrator, fibre: &Fibre| match integrator {
        Integrator::Fast(model) => MethodData::fast(fibre, model, 3),
        Integrator::Xu => MethodData::xu(fibre, 4, Energies::Quadrature),
    };
    for integrator in
        [Integrator::Fast(Model::Marschner), Integrator::Fast(Model::Deon), Integrator::Xu]
    {
        let case = [Case {
            name: "sum_of",
            statement: STATEMENT,
            relative: 3e-3,
            // Of modes up to 4 times as bright.
            floor: 8e-4,
            input: scattering_input,
            twin: &|x| twin(integrator, x),
        }];
        check(&gpu, &data(integrator, &own), &case, 1024);
        let (excess, _) = worst(&gpu, &data(integrator, &bare), &case[0], 256);
        assert!(excess > 10.0, "{integrator:?}: the control, untinted, passes: {excess}");
    }
}

/// All lobes together, RGB, against the tinted exact model.
#[test]
fn fast_is_as_near_to_the_exact_integrals_tinted_as_not() {
    let bare = fibre([0.1, 0.3, 0.7], 7.5, 1.0);
    for model in [Model::Marschner, Model::Deon] {
        let tables = Tables::new(&bare, model, model.nodes() as usize);
        let error = |shown: &Fibre, exact: &Fibre| {
            let fast = Fast::new(shown, model, &tables);
            let exact: Box<dyn FibreModel> = match model {
                Model::Marschner => Box::new(Marschner::new(exact)),
                Model::Deon => Box::new(Deon::conserving(exact, exact.w_c / SQRT_2, 4)),
            };
            let (mut off, mut whole) = (0.0, 0.0);
            for [theta_o, theta_j, phi] in places(40) {
                let light = Light { theta: theta_j, phi, lambda: 0.3 };
                let o = Direction::new(theta_o, 0.0);
                let modes = fast.single_scattering(theta_o, theta_j, phi, 1.0, 0.3);
                let got = modes.times(&Modes::factors(shown, [1.0; 3])).sum();
                let lobes = (0..exact.lobes()).map(|p| srbf_integral(&*exact, p, &o, &light).value);
                let wanted = lobes.fold([0.0; 3], |sum, one| [0, 1, 2].map(|c| sum[c] + one[c]));
                off += (0..3).map(|c| (got[c] - wanted[c]).powi(2)).sum::<f64>();
                whole += wanted.iter().map(|x| x * x).sum::<f64>();
            }
            (off / whole).sqrt()
        };
        let own = tinted(&bare, TINT);
        let (even, with, control) = (error(&bare, &bare), error(&own, &own), error(&bare, &own));
        println!(
            "{model:?}: untinted {even:.4}, tinted {with:.4}; untinted for tinted {control:.2}"
        );
        assert!(even < 0.01 && with < 0.01, "{model:?}: {even} {with}");
        assert!(control > 0.5, "{model:?}: {control}");
    }
}

#[test]
fn plotted_lobes_are_tinted() {
    let fibre = FibreSpec { intensity_r: 3.0, tint_trt: [1.0, 0.1, 0.05], ..FibreSpec::default() };
    let of = Subject { fibre, render: RenderSpec::default(), theta_i: 0.3 };
    let untinted = Subject { fibre: FibreSpec::default(), ..of.clone() };
    let (shaded, exact) = (Lobes::shaded(&of).unwrap(), Lobes::exact(&of));
    let (apart, far) = (shaded.apart(&exact), shaded.apart(&Lobes::exact(&untinted)));
    println!("{apart:.4?}; off untinted ones {far:.2?}");
    assert!(
        apart.into_iter().flatten().all(|off| off < 0.02) && apart[..3].iter().all(Option::is_some)
    );
    // R and TRT are others, TT is what it was.
    assert!(far[0].unwrap() > 1.0 && far[1].unwrap() < 0.02 && far[2].unwrap() > 0.3);
}

#[test]
fn modes_are_compiled_by_how_bright_they_are_tinted() {
    let modes = |tint| {
        let bare = fibre([2.0, 4.0, 8.0], 7.5, 1.0);
        MethodData::fast(&tinted(&bare, tint), Model::Marschner, 2).modes
    };
    let [grey, dark] = [[1.0; 3], [0.0; 3]];
    // Dark hair's TRT is too faint to be seen.
    assert_eq!(modes(Fibre::UNTINTED), 0b011);
    assert_eq!(modes([[0.01; 3], [0.01; 3], [4.0; 3]]), 0b111);
    assert_eq!(modes([grey, dark, grey]), 0b001);
    assert_eq!(modes([dark, grey, dark]), 0b010);
    assert_eq!(modes([dark; 3]), 0);
    let clear = fibre([0.0; 3], 7.5, 1.0);
    let tables = Tables::new(&clear, Model::Deon, 3);
    let share = |tint| Fast::new(&tinted(&clear, tint), Model::Deon, &tables).share_of(Mode::Trrt);
    assert!(share([grey, grey, dark]) == 0.0 && share(Fibre::UNTINTED) > 1.0 / 512.0);
}

/// Dual scattering of `xu` is of light that goes on: tints above 1 are none, others dim it.
#[test]
fn averages_never_make_light() {
    let clear = fibre([0.0; 3], 7.5, 1.0);
    let [bare, bright, dim] =
        [Fibre::UNTINTED, [[4.0; 3]; 3], [[1.0; 3], [0.5; 3], [1.0, 0.1, 0.0]]]
            .map(|tint| AverageTable::new(&tinted(&clear, tint), 4));
    for theta in [-1.2, -0.4, 0.0, 0.7, 1.5] {
        let [bare, bright, dim] = [&bare, &bright, &dim].map(|table| table.sample(theta));
        assert_eq!(bare, bright);
        for c in 0..3 {
            assert!(dim.a_f[c] < bare.a_f[c] && dim.a_b[c] <= bare.a_b[c]);
            assert!(dim.big_a_b[c] <= bare.big_a_b[c]);
        }
        assert_eq!(dim.energy, bare.energy, "energy is made up for untinted");
    }
}

/// White hair in even light: light between strands is never more than untinted, and that of brighter lobes the same.
#[test]
fn light_between_strands_is_never_more_than_untinted() {
    let mut scene = Scene::default();
    scene.hair.strands = 2000;
    let stage = Geometry::load(&scene).unwrap();
    let even = hairlight::srbf::SrbfLight { direction: glam::DVec3::Y, lambda: 1e4, rgb: [1.0; 3] };
    let medium = HairMedium::new(&stage, true);
    let lit = medium.bring(&stage, split_wide(&[even]), &[0], &|_| true).unwrap();
    let clear = Fibre { sigma_a: [0.0; 3], ..scene.fibre.resolve() };
    for model in [Model::Marschner, Model::Deon] {
        let field = |tint| {
            let method = MethodData::fast(&tinted(&clear, tint), model, model.nodes());
            lit.field(&stage, &medium, &method, &|_| true).unwrap().expect("a field").radiance
        };
        let bare = field(Fibre::UNTINTED);
        assert!(field([[4.0; 3], [1.0; 3], [2.0; 3]]) == bare, "{model:?}: brighter lobes");
        let dim = field([[1.0; 3], [0.9, 1.0, 0.5], [0.5; 3]]);
        let sum = |field: &[(glam::Vec3A, f32)], c: usize| {
            field.iter().map(|(l, _)| f64::from(l[c])).sum::<f64>()
        };
        let shares = [0, 1, 2].map(|c| sum(&dim, c) / sum(&bare, c));
        // Rounds end at 0.2 % of what still moves; in the dark, f32 rounds.
        let most = bare.iter().zip(&dim).map(|((a, _), (b, _))| (*b - *a * 1.01).max_element());
        let most = most.fold(f32::MIN, f32::max);
        println!("{model:?}: {shares:.3?} of untinted light; above it by {most:.1e}");
        assert!(most < 1e-6 && shares.iter().all(|share| *share < 0.95), "{model:?}: {most}");
    }
}

const HAIR: [&str; 5] = ["--strands=2000", "--size", "40x30", "--background", "transparent"];

fn read(folder: &Path, name: &str) -> Picture {
    Picture::read(&folder.join(name)).unwrap()
}

/// Towards the eye all of a lobe's intensity counts, between strands no more than 1: hair whose lobes are all four
/// times as bright is just that, however much light goes round in it.
#[test]
fn four_times_every_lobe_is_four_times_the_picture() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    write_unit_map(path);
    let hair = [&HAIR[..], &["--env", "unit.exr", "--preset", "white"]].concat();
    let every = |x: &'static str| {
        ["--intensity-r", x, "--intensity-tt", x, "--intensity-trt", x, "--head", "none"]
    };
    // Random ends would fall elsewhere.
    let shallow = ["--spp", "4", "--max-depth", "3"];
    let ways = [
        ("marschner", false),
        ("deon", false),
        ("marschner", true),
        ("deon", true),
        ("chiang", true),
    ];
    for (bcsdf, traced) in ways {
        let picture = |x: &'static str| {
            let own = [&hair[..], &every(x), &["--bcsdf", bcsdf, "-o", "picture.exr"]].concat();
            match traced {
                true => referenced(path, &[&own[..], &shallow].concat()),
                false => captured(path, &own),
            }
            read(path, "picture.exr")
        };
        let [one, four, half] = ["1", "4", "0.5"].map(picture);
        let sum = |of: &Picture| of.rgb.iter().map(|p| f64::from(p[1])).sum::<f64>();
        let pairs = |of: &Picture| -> Vec<(f32, f32)> {
            let flat = |of: &Picture| of.rgb.as_flattened().to_vec();
            flat(&one).into_iter().zip(flat(of)).collect()
        };
        let off = pairs(&four).into_iter().map(|(a, b)| (4.0 * a - b).abs()).fold(0.0, f32::max);
        let dimmed = sum(&half) / sum(&one);
        let name = if traced { "path traced" } else { "frame" };
        println!("{name}, {bcsdf}: 4 × off by {off:.1e}; half of every lobe leaves {dimmed:.3}");
        assert!(off < 1e-5, "{name}, {bcsdf}: {off}");
        // The control: what is below 1 counts between strands too.
        assert!(dimmed < 0.4, "{name}, {bcsdf}: {dimmed}");
        // A furnace sends back no more for it anywhere.
        assert!(pairs(&half).into_iter().all(|(a, b)| b <= a), "{name}, {bcsdf}");
    }
}

#[test]
fn a_tinted_frame_is_as_near_to_its_truth_as_an_untinted_one() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    for bcsdf in ["marschner", "deon"] {
        let look = [&HAIR[..], &["--env", "builtin:overcast", "--bcsdf", bcsdf]].concat();
        let make = |own: &[&str], name: &str| {
            referenced(path, &[&look[..], own, &["--spp", "64", "-o", "truth.exr"]].concat());
            let samples = ["--samples", "64", "-o", name];
            captured(path, &[&look[..], own, &samples].concat());
            read(path, "truth.exr")
        };
        let (even, with) = (make(&[], "even.exr"), make(&FLAGS, "tinted.exr"));
        let error = |frame: &str, truth: &Picture| {
            let report = compare(&read(path, frame), truth).unwrap();
            (report.error(), report.mean_ratio.map(Option::unwrap))
        };
        let (own, untinted) = (error("tinted.exr", &with), error("even.exr", &even));
        let control = error("even.exr", &with);
        println!("{bcsdf}: tinted {own:.3?}, untinted {untinted:.3?}; for the other {control:.3?}");
        assert!(own.0 < 1.3 * untinted.0, "{bcsdf}: {own:?} {untinted:?}");
        assert!(own.1.into_iter().zip(untinted.1).all(|(a, b)| (a / b - 1.0).abs() < 0.12));
        assert!(control.0 > 2.5 * own.0, "{bcsdf}: {control:?}");
    }
}

/// Lobes are drawn by how bright they are tinted, so that a path keeps its weight.
#[test]
fn draws_follow_tints() {
    // Relative variance at one h of what a draw of `drawn` carries of `shown`, the mean over channels of f_cos/pdf.
    let spread = |shown: &dyn FibreModel, drawn: &dyn FibreModel, h: f64| {
        let (mut random, o) = (Uniform(5), Direction::new(0.4, -1.0));
        let weights: Vec<f64> = (0..10_000)
            .map(|_| {
                let Some(sample) = drawn.sample(&o, h, random.array()) else { return 0.0 };
                let f_cos = shown.evaluate(&o, &sample.direction, h).f_cos;
                f_cos.iter().sum::<f64>() / sample.value.pdf
            })
            .collect();
        let mean = weights.iter().sum::<f64>() / weights.len() as f64;
        let squares = weights.iter().map(|w| (w - mean).powi(2)).sum::<f64>();
        squares / weights.len() as f64 / (mean * mean)
    };
    let bare = fibre([0.1, 0.3, 0.7], 7.5, 1.0);
    let own = tinted(&bare, TINT);
    let deon = |fibre: &Fibre| Deon::conserving(fibre, fibre.w_c / SQRT_2, 4);
    let models: [(&str, [Box<dyn FibreModel>; 2]); 2] = [
        ("marschner", [&bare, &own].map(|f| Box::new(Marschner::compensated(f)) as _)),
        ("deon", [&bare, &own].map(|f| Box::new(deon(f)) as _)),
    ];
    for (name, [bare, own]) in &models {
        for h in [-0.7, 0.1, 0.5] {
            let (even, with) = (spread(&**bare, &**bare, h), spread(&**own, &**own, h));
            let control = spread(&**own, &**bare, h);
            println!(
                "{name} at {h}: variance untinted {even:.3}, tinted {with:.3}; by untinted draws {control:.2}"
            );
            assert!(with < 0.1 && control > 10.0 * with, "{name}: {with} {control}");
        }
    }
}

#[test]
fn presets_are_untinted() {
    let mut fibre = FibreSpec { model: Bcsdf::Deon, ..FibreSpec::default() };
    (fibre.tint_r, fibre.intensity_trt) = ([0.2, 0.3, 0.4], 2.0);
    assert_ne!(fibre.resolve().tint, Fibre::UNTINTED);
    for preset in PRESETS {
        let mut fibre = fibre.clone();
        fibre.set_preset(preset);
        assert_eq!(fibre.resolve().tint, Fibre::UNTINTED, "{}", preset.name);
    }
    let resolved = FibreSpec { tint_tt: [0.5, 1.0, 0.0], intensity_tt: 4.0, ..fibre }.resolve();
    assert_eq!(resolved.tint, [[0.2, 0.3, 0.4], [2.0, 4.0, 0.0], [2.0; 3]]);
    assert_eq!(resolved.passed_on().tint, [[0.2, 0.3, 0.4], [1.0, 1.0, 0.0], [1.0; 3]]);
}

#[test]
fn an_intensity_is_found_by_its_name_set_and_undone() {
    let mut window = window(Document::new(small(), None));
    window.set_size(egui::Vec2::new(1100.0, 1400.0));
    window.run_steps(3);
    for name in [
        "R: reflection off the surface",
        "TT: light passing through",
        "TRT: inner reflection, the second highlight",
    ] {
        window.get_by_label(name);
    }
    let before = editor(&window).document.scene.clone();
    seen(&mut window);
    let bare = super::editor::picture(&window);
    window.get_by_role_and_label(Role::SpinButton, "intensity R").focus();
    window.step();
    key(&mut window, Modifiers::COMMAND, Key::A);
    window.event(egui::Event::Text("3".to_owned()));
    window.step();
    key(&mut window, Modifiers::NONE, Key::Enter);
    seen(&mut window);
    assert_eq!(editor(&window).document.scene.fibre.intensity_r, 3.0);
    assert!(super::editor::apart(&super::editor::picture(&window), &bare).1 > 0.05);
    window.get_by_label("Reset intensity R");
    look(&mut window, "lobes.png");
    key(&mut window, Modifiers::NONE, Key::Escape);
    key(&mut window, Modifiers::COMMAND, Key::Z);
    seen(&mut window);
    assert!(editor(&window).document.scene == before, "undone");
    // The control: another field's name reaches another field.
    window.get_by_role_and_label(Role::SpinButton, "intensity TRT");
    assert!(window.query_by_label("Reset intensity R").is_none());
}
