//! The table of fields, from text to scene and back.

use std::path::Path;

use glam::{DVec3, Vec3};
use hairlight::scene::{
    Assignment, Camera, CameraSpec, FIELDS, Field, Kind, Orbit, PRESETS, Pigment, Scene, View,
    assembly_color, field_named, parse_assignment,
};

/// Valid values of a field as TOML literals, both ends of its range among them.
pub fn samples(field: &Field) -> Vec<String> {
    let text = |words: &[&str]| words.iter().map(|w| format!("\"{w}\"")).collect::<Vec<_>>();
    let mut values = match field.kind {
        Kind::Number { min, max } => vec![format!("{min:?}"), format!("{max:?}")],
        Kind::Integer { min, max } => vec![format!("{min}"), format!("{max}")],
        Kind::Choice(words) => text(words),
        Kind::Text => text(&["llvmpipe", "has \\\"quotes\\\" and = # signs"]),
        Kind::Target => text(&["20%", "0.5%", "50ms"]),
        Kind::Source { builtins, words } => {
            let builtin = builtins.iter().map(|name| format!("\"builtin:{name}\""));
            builtin.chain(text(words)).chain(text(&["a folder/file.x", "/ab.hair"])).collect()
        }
        Kind::Output(extensions) => extensions.iter().map(|e| format!("\"dir/a.{e}\"")).collect(),
        Kind::Vector { min, max } => vec![format!("[{min:?}, 0.125, {max:?}]")],
        Kind::Color { min, max, words } => {
            let numbers = [format!("[{min:?}, 0.3, {max:?}]"), "\"#8040c0\"".to_owned()];
            numbers.into_iter().chain(text(words)).collect()
        }
        Kind::Size { min, max } => vec![format!("[{min}, {max}]"), format!("\"{max}x{min}\"")],
    };
    values.extend(field.unset.map(|word| format!("\"{word}\"")));
    values
}

/// The scene that `key = literal` makes of the defaults.
pub fn scene_with(field: &Field, literal: &str) -> Scene {
    parse(&format!("{} = {literal}", field.key)).unwrap_or_else(|e| panic!("{}: {e}", field.key))
}

fn parse(text: &str) -> Result<Scene, String> {
    Scene::from_toml(text, "scene.toml", Path::new("")).map_err(|e| format!("{e:#}"))
}

fn error_of(text: &str) -> String {
    let error = parse(text).expect_err(text);
    assert_eq!(error.lines().count(), 1, "{error}");
    error
}

/// Levels of assignments over the defaults, each as `key=value` texts.
fn levels(levels: &[&[&str]]) -> Result<Scene, String> {
    let mut scene = Scene::default();
    for level in levels {
        let level: Result<Vec<Assignment>, String> =
            level.iter().map(|text| parse_assignment(text)).collect();
        scene.apply(level?).map_err(|e| e.to_string())?;
    }
    Ok(scene)
}

#[test]
fn every_field_reads_alike_from_a_file_and_from_set_and_prints_back() {
    for field in FIELDS {
        let mut scenes = Vec::new();
        for literal in samples(field) {
            let from_file = scene_with(field, &literal);
            let (table, name) = field.key.split_once('.').unwrap();
            assert_eq!(parse(&format!("[{table}]\n{name} = {literal}")).unwrap(), from_file);

            let typed = match literal.contains('\\') {
                true => literal.trim_matches('"').replace("\\\"", "\""),
                false => literal.clone(),
            };
            let from_set = levels(&[&[&format!("{}={typed}", field.key)]]).unwrap();
            assert_eq!(from_set, from_file, "{} = {literal}", field.key);

            let printed = from_file.to_toml();
            assert_eq!(parse(&printed).unwrap(), from_file, "{printed}");
            scenes.push(from_file);
        }
        // Else a field that sets nothing would pass.
        let differ = scenes.iter().any(|scene| *scene != Scene::default());
        assert!(differ || field.key == "render.method", "{} changes nothing", field.key);
    }
}

#[test]
fn keys_and_flags_are_unique_and_tables_contiguous() {
    for (i, field) in FIELDS.iter().enumerate() {
        for other in &FIELDS[i + 1..] {
            assert_ne!(field.key, other.key);
            assert_ne!(field.flag, other.flag);
            assert!(field.short.is_none() || field.short != other.short);
        }
    }
    let mut groups: Vec<&str> = FIELDS.iter().map(Field::group).collect();
    groups.dedup();
    let lamps = ["lamp1", "lamp2", "lamp3", "lamp4"];
    let ends = [&["hair", "head", "environment"][..], &["fibre", "camera", "render", "output"]];
    assert_eq!(groups, [ends[0], &lamps, ends[1]].concat());
}

#[test]
fn just_beyond_either_end_is_an_error_that_names_key_value_and_range() {
    for field in FIELDS {
        let beyond = match field.kind {
            Kind::Number { min, max } => [min.next_down(), max.next_up(), f64::NAN, f64::INFINITY]
                .map(|x| format!("{x:?}").to_lowercase())
                .to_vec(),
            Kind::Integer { min, max } => {
                vec![format!("{}", min - 1.0), format!("{}", max + 1.0), format!("{}", min + 0.5)]
            }
            Kind::Vector { min, max } | Kind::Color { min, max, .. } => vec![
                format!("[{:?}, 0.5, 0.5]", min.next_down()),
                format!("[0.5, 0.5, {:?}]", max.next_up()),
                "[0.5, 0.5]".to_owned(),
                "[0.5, 0.5, 0.5, 0.5]".to_owned(),
            ],
            Kind::Size { min, max } => vec![
                format!("[{}, 1]", min - 1.0),
                format!("[1, {}]", max + 1.0),
                "[1.5, 1]".to_owned(),
                "[1, 1, 1]".to_owned(),
            ],
            Kind::Target => {
                vec!["\"0%\"".into(), "\"-1ms\"".into(), "\"50\"".into(), "\"NaN%\"".into()]
            }
            _ => continue,
        };
        for literal in beyond {
            let error = error_of(&format!("\n{} = {literal}", field.key));
            let start = format!("scene.toml:2: `{}` must be {}, not ", field.key, field.expects());
            assert!(error.starts_with(&start), "{error}");
            assert!(field.parse(&literal).is_err(), "{} = {literal}", field.key);
        }
    }
    let expected = "scene.toml:1: `fibre.eta` must be a number from 1 to 3, not 0.5";
    assert_eq!(error_of("fibre.eta = 0.5"), expected);
}

#[test]
fn wrong_types_are_errors_that_name_the_key() {
    for field in FIELDS {
        for literal in ["true", "1979-05-27", "[[1]]", "\"\"", "[]", "{ x = 1 }"] {
            let error = error_of(&format!("{} = {literal}", field.key));
            assert!(error.contains(field.key), "{error}");
        }
    }
    assert!(error_of("fibre.eta = \"1.5\"").contains("not the text \"1.5\""));
    assert!(error_of("render.adapter = 1").contains("render.adapter"));
}

#[test]
fn unknown_keys_name_the_nearest() {
    for (unknown, near) in [
        ("fibre.etta", "fibre.eta"),
        ("eta", "fibre.eta"),
        ("fiber.eta", "fibre.eta"),
        ("fibre.colour", "fibre.color"),
        ("camera.fov", "camera.fov_deg"),
        ("outputs.size", "output.size"),
        ("environment.rotation", "environment.rotation_deg"),
        ("hair.strand_count", "hair.strands"),
        ("Fibre.Eta", "fibre.eta"),
    ] {
        let expected = format!("unknown key `{unknown}`; did you mean `{near}`?");
        assert_eq!(field_named(unknown).err(), Some(expected.clone()));
        assert_eq!(error_of(&format!("{unknown} = 1")), format!("scene.toml:1: {expected}"));
    }
    for field in FIELDS {
        let doubled = format!("{}{}", field.key, field.key.chars().last().unwrap());
        let error = field_named(&doubled).err().unwrap();
        assert!(error.ends_with(&format!("did you mean `{}`?", field.key)), "{error}");
    }
    for table in ["fibre = 3", "[[fibre]]\neta = 2"] {
        assert!(error_of(table).contains("`fibre` is a table of keys such as `fibre."));
    }
    assert!(error_of("[fibree]").contains("unknown key `fibree`"));
    assert!(parse("[fibre]").is_ok());
}

#[test]
fn bad_toml_is_one_line_with_its_place() {
    for (text, start) in [
        ("[fibre\neta = 2", "scene.toml:1:7: "),
        ("a = 1\n  b = = 2", "scene.toml:2:7: "),
        ("[fibre]\neta=1.5\neta=2", "scene.toml:3:1: "),
        ("fibre.eta = \"", "scene.toml:1:"),
        ("fibre.eta = 1.5.5", "scene.toml:1:"),
    ] {
        let error = error_of(text);
        assert!(error.starts_with(start), "{error}");
    }
    error_of(&format!("fibre.eta = {}", "[".repeat(100_000)));
    error_of(&format!("fibre.eta = {}", "9".repeat(1000)));
    error_of(&"a.".repeat(100_000));
}

#[test]
fn presets_come_first_in_their_level_and_replace_earlier_levels() {
    for preset in PRESETS {
        let scene = levels(&[&[&format!("fibre.preset={}", preset.name)]]).unwrap();
        assert_eq!(scene.fibre.preset, preset.name);
        assert_eq!(scene.fibre.pigment, preset.pigment);
        assert!((5.0..=10.0).contains(&scene.fibre.beta_r_deg), "{}", preset.name);
        assert!((-10.0..=-5.0).contains(&scene.fibre.alpha_r_deg), "{}", preset.name);
        assert!((0.1..=0.2).contains(&scene.fibre.w_c), "{}", preset.name);
        assert!(!preset.rationale.is_empty());
    }
    assert_eq!(levels(&[&["fibre.preset=brown"]]).unwrap(), Scene::default());

    let explicit_wins =
        levels(&[&["fibre.beta_r_deg=3", "fibre.preset=red", "fibre.eumelanin=2"]]).unwrap();
    assert_eq!(explicit_wins.fibre.beta_r_deg, 3.0);
    let red_pheomelanin = Pigment::Melanin { eumelanin: 2.0, pheomelanin: 1.5 };
    assert_eq!(explicit_wins.fibre.pigment, red_pheomelanin);

    let earlier = ["fibre.sigma_a=[1,2,3]", "fibre.beta_tt_deg=9", "fibre.eta=1.6"];
    let later_wins = levels(&[&earlier, &["fibre.preset=blond"]]).unwrap();
    let blond = levels(&[&["fibre.preset=blond", "fibre.eta=1.6"]]).unwrap();
    assert_eq!(later_wins, blond);
    assert_ne!(levels(&[&["fibre.preset=blond"], &earlier]).unwrap(), blond);
}

#[test]
fn one_level_states_a_thing_in_one_way_and_a_later_level_in_another() {
    for (first, second) in [
        ("fibre.sigma_a=[1,1,1]", "fibre.color=#804020"),
        ("fibre.sigma_a=[1,1,1]", "fibre.eumelanin=1"),
        ("fibre.pheomelanin=1", "fibre.color=#804020"),
        ("camera.position=[0,0,5]", "camera.azimuth_deg=3"),
        ("camera.distance=3", "camera.position=[0,0,5]"),
    ] {
        let error = levels(&[&[first, second]]).unwrap_err();
        for key in [first, second].map(|text| text.split('=').next().unwrap()) {
            assert!(error.contains(&format!("`{key}`")), "{error}");
        }
        let replaced = levels(&[&[first], &[second]]).unwrap();
        assert_eq!(replaced, levels(&[&[second]]).unwrap());
    }
    let melanin = levels(&[&["fibre.eumelanin=1", "fibre.pheomelanin=0.5"]]).unwrap();
    assert_eq!(melanin, levels(&[&["fibre.eumelanin=1"], &["fibre.pheomelanin=0.5"]]).unwrap());
    assert!(levels(&[&["camera.target=[0,1,0]", "camera.azimuth_deg=3"]]).is_ok());
    assert!(
        error_of("camera = { position = [0, 0, 5], distance = 3 }").contains("camera.distance")
    );
}

#[test]
fn colours_resolve_to_absorption_per_radius() {
    // d'Eon's cross-sections, by hand.
    let melanin = Pigment::Melanin { eumelanin: 2.0, pheomelanin: 0.5 }.sigma_a();
    assert_near(&melanin, &[0.9315, 1.594, 3.265], 1e-12);
    let absorption = [0.1, 0.2, 1000.0];
    assert_eq!(Pigment::Absorption(absorption).sigma_a(), absorption);
    // ((ln ((0.5 − 0.0236)/0.9764)) / 4.51)², and so on; darker than the sheen is black.
    let color = Pigment::Color([0.5, 0.1, 0.001]).sigma_a();
    let by_hand =
        [0.476_4f64, 0.076_4, 0.976_4e-3].map(|body| ((body / 0.976_4).ln() / 4.51).powi(2));
    assert_near(&color, &by_hand, 1e-9);
    assert_near(&assembly_color(color)[..2], &[0.5, 0.1], 1e-12);
    let luminance = |name: &str| {
        let preset = PRESETS.iter().find(|preset| preset.name == name).unwrap();
        preset.pigment.sigma_a().iter().sum::<f64>()
    };
    let darker = ["black", "red", "brown", "blond", "white"].map(luminance);
    assert!(darker[0] > darker[2] && darker[2] > darker[3] && darker[3] > darker[4]);
    assert_eq!(luminance("white"), 0.0);
}

#[test]
fn tt_and_trt_are_linked_to_r_unless_set_apart() {
    let fibre = |texts: &[&str]| levels(&[texts]).unwrap().fibre.resolve();
    let degrees = |xs: [f64; 3]| xs.map(f64::to_degrees);
    let linked = fibre(&["fibre.beta_r_deg=6", "fibre.alpha_r_deg=-8", "fibre.w_c=0.3"]);
    assert_near(&degrees(linked.beta), &[6.0, 3.0, 12.0], 1e-12);
    assert_near(&degrees(linked.alpha), &[-8.0, 4.0, 12.0], 1e-12);
    assert_eq!((linked.w_c, linked.eta, linked.eccentricity), (0.3, 1.55, 1.0));

    let apart = ["fibre.beta_r_deg=6", "fibre.beta_tt_deg=5", "fibre.alpha_trt_deg=1"];
    assert_near(&degrees(fibre(&apart).beta), &[6.0, 5.0, 12.0], 1e-12);
    assert_near(&degrees(fibre(&apart).alpha), &[-7.0, 3.5, 1.0], 1e-12);
    let relinked = levels(&[&apart, &["fibre.beta_tt_deg=linked"]]).unwrap().fibre.resolve();
    assert_near(&degrees(relinked.beta), &[6.0, 3.0, 12.0], 1e-12);

    assert_near(&degrees(fibre(&["fibre.beta_r_deg=45"]).beta), &[45.0, 22.5, 45.0], 1e-12);
}

#[test]
fn paths_in_a_file_start_at_the_file() {
    let text = "hair.source = 'a.hair'\nhead.source = 'none'\noutput.stats = 'b.json'";
    let scene = Scene::from_toml(text, "x.toml", Path::new("scenes")).unwrap();
    let under = |name: &str| Path::new("scenes").join(name).to_string_lossy().into_owned();
    assert_eq!(scene.hair.source, under("a.hair"));
    assert_eq!(scene.output.stats, Some(under("b.json")));
    // Neither words nor defaults are moved.
    assert_eq!(scene.head.source, "none");
    assert_eq!(scene.environment.source, "builtin:studio");
    assert_eq!(scene.output.path, "hairlight.png");
}

#[test]
fn the_builtin_maps_of_the_table_exist() {
    let Kind::Source { builtins, .. } = field_named("environment.source").unwrap().kind else {
        panic!("a source");
    };
    for name in builtins {
        assert!(hairlight::environment::load(&format!("builtin:{name}")).is_ok(), "{name}");
    }
    assert!(hairlight::environment::load("builtin:noon").is_err());
}

#[test]
fn the_builtin_head_goes_with_builtin_hair() {
    for (hair, head, expected) in [
        ("builtin:bob", "auto", Some("builtin")),
        ("a.hair", "auto", None),
        ("a.hair", "builtin", Some("builtin")),
        ("builtin:bob", "none", None),
        ("builtin:bob", "b.obj", Some("b.obj")),
    ] {
        let sources = [format!("hair.source={hair}"), format!("head.source={head}")];
        let scene = levels(&[&sources.each_ref().map(String::as_str)]).unwrap();
        assert_eq!(scene.head_source(), expected, "{hair}, {head}");
    }
}

#[test]
fn the_orbit_fills_its_share_of_the_tighter_side() {
    let (center, radius) = (Vec3::new(1.0, 2.0, 3.0), 0.25);
    for (aspect, fov_deg) in [(1.5, 30.0), (0.5, 30.0), (1.0, 90.0)] {
        let camera = CameraSpec { fov_deg, ..CameraSpec::default() };
        let camera = camera.resolve(center, radius, aspect).unwrap();
        let (high, wide) = outline(&camera, center.as_dvec3(), 0.25);
        let tan_half_fov = (fov_deg / 2.0).to_radians().tan();
        let filled = (high / tan_half_fov).max(wide / (tan_half_fov * aspect));
        assert!((filled - 0.85).abs() < 1e-3, "aspect {aspect}, fov {fov_deg}: {filled}");
    }
}

/// Greatest tangents of a sphere's points above and beside the view's axis.
fn outline(camera: &Camera, center: DVec3, radius: f64) -> (f64, f64) {
    let forward = (camera.target - camera.position).normalize();
    let right = forward.cross(camera.up);
    let mut greatest = (0.0f64, 0.0f64);
    for i in 0..200_000 {
        let y = 1.0 - 2.0 * (f64::from(i) + 0.5) / 200_000.0;
        let (sin, cos) = (f64::from(i) * 2.399_963_229_728_653).sin_cos();
        let on_sphere = DVec3::new((1.0 - y * y).sqrt() * cos, y, (1.0 - y * y).sqrt() * sin);
        let point = center + radius * on_sphere - camera.position;
        let depth = point.dot(forward);
        greatest.0 = greatest.0.max(point.dot(camera.up) / depth);
        greatest.1 = greatest.1.max(point.dot(right) / depth);
    }
    greatest
}

#[test]
fn cameras_stand_where_they_are_told() {
    let orbit = |azimuth_deg, elevation_deg| CameraSpec {
        view: View::Orbit(Orbit { azimuth_deg, elevation_deg, distance: Some(4.0) }),
        ..CameraSpec::default()
    };
    let at = |spec: CameraSpec| spec.resolve(Vec3::Y, 0.5, 1.5).unwrap();
    assert_vec_near(at(orbit(0.0, 0.0)).position, DVec3::new(0.0, 1.0, 2.0));
    assert_vec_near(at(orbit(90.0, 0.0)).position, DVec3::new(2.0, 1.0, 0.0));
    assert_vec_near(at(orbit(0.0, 90.0)).position, DVec3::new(0.0, 3.0, 0.0));
    assert_vec_near(at(orbit(0.0, 0.0)).turned(90.0).position, at(orbit(90.0, 0.0)).position);
    for (azimuth, elevation) in [(0.0, 90.0), (30.0, -90.0), (35.0, 5.0), (200.0, 60.0)] {
        let camera = at(orbit(azimuth, elevation));
        let forward = (camera.target - camera.position).normalize();
        assert!(camera.up.dot(forward).abs() < 1e-9, "{camera:?}");
        assert!((camera.up.length() - 1.0).abs() < 1e-9, "{camera:?}");
    }
    let fixed = CameraSpec {
        view: View::Position([1.0, 2.0, 3.0]),
        target: Some([1.0, 2.0, 0.0]),
        ..CameraSpec::default()
    };
    assert_vec_near(at(fixed).position, DVec3::new(1.0, 2.0, 3.0));
    assert_vec_near(at(fixed).target, DVec3::new(1.0, 2.0, 0.0));
    let nowhere = CameraSpec { target: Some([1.0, 2.0, 3.0]), ..fixed };
    assert!(nowhere.resolve(Vec3::Y, 0.5, 1.5).is_err());
}

fn assert_near(actual: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(actual.len(), expected.len());
    let near = actual.iter().zip(expected).all(|(a, e)| (a - e).abs() <= tolerance);
    assert!(near, "{actual:?} is not {expected:?}");
}

fn assert_vec_near(actual: DVec3, expected: DVec3) {
    assert_near(&actual.to_array(), &expected.to_array(), 1e-9);
}

#[test]
#[should_panic]
fn a_perturbed_vector_is_not_near() {
    assert_vec_near(DVec3::X, DVec3::new(1.0, 1e-8, 0.0));
}
