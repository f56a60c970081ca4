//! What a scene lacks costs nothing, and leaving it out changes nothing.

use hairlight::environment;
use hairlight::gpu::frame::{Background, NEGLIGIBLE, Parts, Renderer};
use hairlight::gpu::method::MethodData;
use hairlight::light::{HairMedium, LitHair};
use hairlight::scattering::model::Model;
use hairlight::scene::{FibreSpec, Lens, PRESETS, Scene};
use hairlight::srbf::{self, SrbfLight};
use hairlight::stage::{Geometry, shaded_lights};
use serde_json::Value;
use tempfile::tempdir;

use crate::frames::{captured, json, write_unit_map};
use crate::wgsl::cpu;

/// The rows of the table: what each scene lacks that the one before has.
const ROWS: [(&str, &[&str]); 6] = [
    ("all", &["--eccentricity", "1.2", "--preset", "blond"]),
    ("no head", &["--head", "none"]),
    ("no multiple scattering", &["--scattering", "single"]),
    ("round fibres", &["--eccentricity", "1"]),
    ("black hair", &["--preset", "black"]),
    ("uniform light", &["--env", "unit.exr"]),
];

const COLUMNS: [&str; 10] = [
    "head_vertices",
    "transport_looks",
    "rays",
    "paths",
    "lights",
    "pairs_lit",
    "single_evaluations",
    "field_rounds",
    "lobes",
    "bytes",
];

#[test]
fn counts_fall_with_each_feature_that_a_scene_lacks_and_repeat_exactly() {
    let folder = tempdir().unwrap();
    write_unit_map(folder.path());
    let scene = "--hair builtin:bob --strands 1500 --size 96x72 --samples 4 --lights 12 \
                 --stats figures.json -o frame.exr";
    let mut arguments: Vec<&str> = scene.split_whitespace().collect();
    println!("| scene | points | {} |", COLUMNS.join(" | ").replace('_', " "));
    println!("| --- |{}", " --- |".repeat(COLUMNS.len() + 1));
    let mut rows: Vec<Value> = Vec::new();
    for (name, more) in ROWS {
        // The last flag of a kind holds, but for presets, which come first.
        arguments.extend(more);
        let work = || {
            captured(folder.path(), &arguments);
            json(&folder.path().join("figures.json"))["work"].clone()
        };
        let row = work();
        if rows.is_empty() {
            assert_eq!(row, work(), "twice");
        }
        let cells: Vec<String> = COLUMNS.iter().map(|&c| row[c].to_string()).collect();
        println!("| {name} | {} | {} |", row["points_shaded"], cells.join(" | "));
        rows.push(row);
    }
    let falls = |row: usize, columns: &[&str]| {
        for column in columns {
            let per_point = |row: &Value| {
                row[column].as_f64().unwrap() / row["points_shaded"].as_f64().unwrap()
            };
            let (before, after) = (per_point(&rows[row - 1]), per_point(&rows[row]));
            assert!(after < 0.99 * before, "{}: {column} {before} to {after}", ROWS[row].0);
        }
    };
    // Without a head more points are seen and more light reaches each: only transport falls.
    falls(1, &["head_vertices", "transport_looks"]);
    falls(2, &["transport_looks", "field_rounds", "bytes"]);
    falls(3, &["bytes"]);
    falls(4, &["lobes"]);
    // All of it is sky.
    falls(5, &["rays", "pairs_lit", "single_evaluations", "lobes", "bytes"]);
}

/// A small scene on the GPU.
struct Shot {
    stage: Geometry,
    medium: HairMedium,
    lens: Lens,
    points: Vec<u32>,
}

impl Shot {
    fn new() -> (Shot, Renderer) {
        let mut scene = Scene::default();
        scene.hair.strands = 6000;
        scene.output.size = [96, 72];
        let stage = Geometry::load(&scene).unwrap();
        let lens = stage.camera(&scene).unwrap().lens(stage.center, scene.output.size);
        let method = MethodData::fast(&FibreSpec::default().resolve(), Model::Marschner, 2);
        let mut renderer = Renderer::new(cpu(), &method, &stage).unwrap();
        let points = renderer.visible_points(&[lens], stage.pieces(&lens), 4).unwrap();
        let medium = HairMedium::new(&stage, true);
        (Shot { stage, medium, lens, points }, renderer)
    }

    fn light(&self, lights: &[SrbfLight]) -> LitHair {
        let lights = lights.to_vec();
        self.medium.bring(&self.stage, lights, &self.points, &|_| true).unwrap()
    }

    fn pixels(&self, renderer: &mut Renderer, parts: Parts) -> Vec<[f32; 4]> {
        renderer.render(&self.lens, 4, Background::Transparent, parts).unwrap().pixels
    }
}

fn fitted(map: &str, count: usize) -> Vec<SrbfLight> {
    let map = environment::load(&format!("builtin:{map}")).unwrap().environment;
    let fit = srbf::fit(&map, count, &|_| true).unwrap();
    shaded_lights(&fit.lights, &Scene::default())
}

fn fibre(preset: &str, eccentricity: f64) -> FibreSpec {
    let mut fibre = FibreSpec::default();
    fibre.set_preset(PRESETS.iter().find(|p| p.name == preset).unwrap());
    fibre.eccentricity = eccentricity;
    fibre
}

fn relative_l2(a: &[[f32; 4]], truth: &[[f32; 4]]) -> f64 {
    let square = |v: f32| f64::from(v) * f64::from(v);
    let pairs = || a.iter().flatten().zip(truth.iter().flatten());
    let difference: f64 = pairs().map(|(a, b)| square(a - b)).sum();
    (difference / pairs().map(|(_, b)| square(*b)).sum::<f64>()).sqrt()
}

const ALL: Parts = Parts { single: true, global: true, local: true };
const SINGLE: Parts = Parts { single: true, global: false, local: false };

/// Compilers order sums differently; black hair's TRT, which is left out, is as little.
const ROUNDING: f64 = 1e-6;

#[test]
fn a_specialised_pipeline_shows_what_the_general_one_shows() {
    let (shot, mut renderer) = Shot::new();
    // Light from behind too: TT is there what black hair has most of.
    let lit = shot.light(&fitted("sunset", 6));
    let mut pixels = |data: &MethodData, parts| {
        let field = lit.field(&shot.stage, &shot.medium, data, &|_| true).unwrap();
        let at = (&shot.stage, &shot.medium);
        lit.show(at, &mut renderer, data, field.as_ref(), 1.0, &|_| true).unwrap();
        shot.pixels(&mut renderer, parts)
    };
    for (name, preset, eccentricity, parts) in [
        ("round", "blond", 1.0, ALL),
        ("elliptic", "blond", 1.2, ALL),
        ("single", "blond", 1.0, SINGLE),
        ("black", "black", 1.0, ALL),
        ("black single", "black", 1.0, SINGLE),
        ("no R", "blond", 1.0, ALL),
    ] {
        let mut of = fibre(preset, eccentricity);
        of.intensity_r = if name == "no R" { 0.0 } else { 1.0 };
        let data = MethodData::fast(&of.resolve(), Model::Marschner, 2);
        let general = pixels(&data.clone().as_general(), parts);
        let error = relative_l2(&pixels(&data, parts), &general);
        println!("{name}: modes {:b}, relative L2 {error:.1e}", data.modes);
        assert!(error <= ROUNDING, "{name}: {error}");
        // Without the brightest mode that the fibre has beyond R, or without multiple scattering.
        let fewer = MethodData { modes: data.modes & 0b101, ..data.clone() };
        let lacking = relative_l2(&pixels(&fewer, parts), &general);
        let single = relative_l2(&pixels(&data, SINGLE), &general);
        println!("  wrongly without TT: {lacking:.1e}, without multiple scattering: {single:.1e}");
        assert!(lacking > 100.0 * ROUNDING, "{name}: {lacking}");
        assert!(!parts.multiple() || single > 100.0 * ROUNDING, "{name}: {single}");
    }
}

#[test]
fn lights_that_cannot_matter_are_left_out_unseen() {
    let (shot, mut renderer) = Shot::new();
    for (map, preset) in [("studio", "brown"), ("night", "blond")] {
        let lights = fitted(map, 24);
        let data = MethodData::fast(&fibre(preset, 1.0).resolve(), Model::Marschner, 2);
        let lit = shot.light(&lights);
        let field = lit.field(&shot.stage, &shot.medium, &data, &|_| true).unwrap();
        let mut taken = |negligible: f64| {
            renderer.negligible = negligible;
            let at = (&shot.stage, &shot.medium);
            lit.show(at, &mut renderer, &data, field.as_ref(), 1.0, &|_| true).unwrap();
            let done = renderer.count(&shot.lens, 4, ALL).unwrap();
            (shot.pixels(&mut renderer, ALL), done)
        };
        let (whole, all) = taken(0.0);
        let (pixels, some) = taken(NEGLIGIBLE);
        let (crude, few) = taken(30.0 * NEGLIGIBLE);
        let (error, control) = (relative_l2(&pixels, &whole), relative_l2(&crude, &whole));
        let share = some.lobes as f64 / all.lobes as f64;
        println!(
            "{map}, {preset}: {share:.2} of the lobes, relative L2 {error:.1e}; crude {control:.1e}"
        );
        assert!(error < 1e-3, "{map}: {error}");
        assert!(share <= 1.0 && few.lobes < all.lobes, "{map}: {share}");
        assert!(control > 5.0 * error, "{map}: {control}");
    }
}
