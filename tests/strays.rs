//! Points far out, strands stored the other way round, and other habits of grooms.

use std::time::{Duration, Instant};

use glam::{Vec3, vec3};
use hairlight::field::{self, Grid};
use hairlight::hair::hair_format::{HairFile, Header};
use hairlight::hair::{self, Hair, LoadOptions, LoadedHair, is_reversed, reverse};
use hairlight::stage::Geometry;
use hairlight::transport::Occluders;
use hairlight::transport::volume::Volume;

/// A tuft on a ball: strands that leave it outward and droop.
fn tuft() -> Hair {
    let mut hair = Hair { offsets: (0..=400).map(|s| 12 * s).collect(), ..Hair::default() };
    for k in 0..400 {
        let up = 1.0 - k as f32 / 400.0;
        let (sin, cos) = (2.399_963_2 * k as f32).sin_cos();
        let out = (1.0 - up * up).sqrt() * vec3(cos, 0.0, sin) + up * Vec3::Y;
        let along = (0..12).map(|i| 0.1 * i as f32);
        hair.points.extend(along.map(|t| (1.0 + 0.4 * t) * out - 1.2 * t * t * Vec3::Y));
    }
    hair
}

fn load(hair: &Hair, options: &LoadOptions) -> LoadedHair {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hair");
    let file = HairFile { hair: hair.clone(), header: Header::default(), trailing_bytes: 0 };
    file.write(&path).unwrap();
    hair::load(path.to_str().unwrap(), options).unwrap()
}

fn notes(loaded: &LoadedHair) -> Vec<&str> {
    loaded.assumed.iter().chain(&loaded.mended.notes).map(String::as_str).collect()
}

/// All hair of a volume: Σ d l.
fn amount(volume: &Volume) -> f64 {
    let trace = |cell: &[f32; 6]| f64::from(cell[0] + cell[1] + cell[2]);
    volume.cells.iter().map(trace).sum::<f64>() * f64::from(volume.cell).powi(3)
}

#[test]
fn a_point_far_out_costs_no_time_and_changes_no_light() {
    let sound = Geometry::new(tuft(), None, 0.01);
    let right = amount(&sound.density(96));
    for far in [1e3, 1e7, 1e9, 1e17f32] {
        let mut point = tuft();
        point.points[200 * 12 + 5] = vec3(far, 3.0, 2.0);
        let mut strand = tuft();
        strand.points.extend([vec3(0.0, 0.5, 0.0), vec3(0.3, -far, 0.1)]);
        strand.offsets.push(strand.points.len() as u32);
        let mut across = tuft();
        across.points.extend([vec3(-far, -0.4, -far), vec3(far, 0.3, far)]);
        across.offsets.push(across.points.len() as u32);
        for (name, hair) in [("a point", point), ("a strand", strand), ("across", across)] {
            let begun = Instant::now();
            assert_eq!(
                hair.strays().iter().filter(|&&stray| stray).count(),
                1,
                "{name} at {far:e}"
            );
            let stage = Geometry::new(hair.clone(), None, 0.01);
            let volume = stage.density(96);
            let larger = volume.cell / sound.density(96).cell;
            assert!((larger - 1.0).abs() < 0.02, "{name} at {far:e}: {larger}");
            let off = (amount(&volume) / right - 1.0).abs();
            assert!(off < 0.01, "{name} at {far:e}: {off}");
            let occluders = Occluders { volume: &volume, head: None };
            let grid = Grid::new(&stage, &occluders, field::CELLS);
            assert!(!grid.hairy.is_empty());
            assert!(grid.samples.iter().all(|p| p.is_finite() && p.length() < 3.0));
            occluders.openness(&hair.points);
            assert!(begun.elapsed() < Duration::from_secs(5), "{name} at {far:e}");

            let told = load(&hair, &LoadOptions::default());
            let strays: Vec<_> = notes(&told).into_iter().filter(|n| n.contains("stray")).collect();
            assert_eq!(strays.len(), 1, "{name} at {far:e}: {:?}", notes(&told));
            assert!(strays[0].starts_with("1 strand"), "{strays:?}");
            assert_eq!(told.hair.points.len(), hair.points.len(), "strays stay");
        }
    }
    assert!(!notes(&load(&tuft(), &LoadOptions::default())).iter().any(|n| n.contains("stray")));
    let mut twice = tuft();
    twice.points.extend_from_within(..);
    twice.offsets.extend((401..=800).map(|s| 12 * s));
    let doubled = amount(&Geometry::new(twice, None, 0.01).density(96));
    assert!((doubled / right - 2.0).abs() < 0.01, "the comparison sees other hair");
}

#[test]
fn pieces_of_a_segment_add_up_to_what_lies_in_the_volume() {
    let volume = Volume::empty(Vec3::ZERO, Vec3::ONE, 34);
    let measure = |a: Vec3, b: Vec3| {
        let (mut length, mut most) = (0.0, 0.0f32);
        volume.pieces([a, b], 2.0, |piece| {
            length += piece.within / piece.count;
            most = most.max(piece.place.distance(a.lerp(b, piece.along)));
        });
        (length, most)
    };
    // Within, all of it; the box is two cells wider on each side.
    let edge = 1.0 + 4.0 / 32.0;
    for (a, b, expected) in [
        (vec3(0.1, 0.2, 0.3), vec3(0.9, 0.8, 0.7), vec3(0.8, 0.6, 0.4).length()),
        (vec3(0.5, 0.5, -10.0), vec3(0.5, 0.5, 10.0), edge),
        (vec3(0.5, -1e7, 0.5), vec3(0.5, 1e7, 0.5), edge),
        (vec3(0.5, 0.5, 0.5), vec3(0.5, 3e9, 0.5), 0.5 * edge),
        (vec3(-5.0, 4.0, 0.5), vec3(5.0, 4.0, 0.5), 0.0),
        (vec3(1e7, 3.0, 2.0), vec3(1e7, 4.0, 2.0), 0.0),
    ] {
        let (length, off) = measure(a, b);
        assert!((length - expected).abs() < 0.02, "{a} {b}: {length} for {expected}");
        // f32 has no more digits than that along the way.
        assert!(off <= 2e-7 * a.distance(b), "{a} {b}: {off}");
    }
}

#[test]
fn strands_from_tip_to_root_are_turned_around_with_all_they_have() {
    let mut right = tuft();
    right.thickness = Some((0..right.points.len()).map(|i| 0.2 - 0.01 * (i % 12) as f32).collect());
    right.color =
        Some((0..right.points.len()).map(|i| [(i % 12) as f32 / 12.0, 0.5, 0.25]).collect());
    right.transparency = Some((0..right.points.len()).map(|i| (i % 12) as f32 / 24.0).collect());
    let mut stored = right.clone();
    reverse(&mut stored);
    assert_ne!(stored, right);
    let told = |loaded: &LoadedHair| notes(loaded).iter().any(|n| n.contains("from tip to root"));
    let advice = |loaded: &LoadedHair| notes(loaded).iter().any(|n| n.contains("--up -y"));

    let loaded = load(&stored, &LoadOptions::default());
    assert_eq!(loaded.hair, right);
    assert!(told(&loaded) && !advice(&loaded), "{:?}", notes(&loaded));
    let loaded = load(&right, &LoadOptions::default());
    assert_eq!(loaded.hair, right);
    assert!(!told(&loaded), "{:?}", notes(&loaded));

    // As the user says.
    let with = |hair: &Hair, reverse| {
        load(hair, &LoadOptions { reverse: Some(reverse), ..Default::default() })
    };
    assert_eq!(with(&stored, false).hair, stored);
    assert!(advice(&with(&stored, false)), "it does look as if it stood on its head");
    assert_eq!(with(&right, true).hair, stored);

    // In doubt, no: straight down from half a ball, both ends are alike. Nor is it advised to turn it upside down.
    let mut doubtful = tuft();
    for strand in doubtful.points.chunks_exact_mut(12) {
        let root = strand[0];
        strand.iter_mut().enumerate().for_each(|(i, p)| *p = root - 0.1 * i as f32 * Vec3::Y);
    }
    reverse(&mut doubtful);
    let loaded = load(&doubtful, &LoadOptions::default());
    assert!(!told(&loaded), "{:?}", notes(&loaded));
    let both: Vec<_> = notes(&loaded).into_iter().filter(|n| n.contains("may be meant")).collect();
    assert!(both.len() == 1 && both[0].contains("--reverse yes or --up -y"), "{both:?}");
}

#[test]
fn builtin_grooms_are_known_the_right_way_round() {
    for style in hair::groom::STYLES {
        let options = hair::groom::GroomOptions { strands: 2_000, ..Default::default() };
        let right = hair::groom::grow(style, &options).unwrap();
        assert!(!is_reversed(&right, None), "{style}");
        let mut stored = right.clone();
        reverse(&mut stored);
        // The ends of a tail lie on no ball, and neither do its roots leave theirs outward: that is doubtful.
        assert_eq!(is_reversed(&stored, None), style != "ponytail", "{style}");
    }
}

#[test]
fn colours_from_0_to_255_are_taken_as_such() {
    let with = |color: &dyn Fn(usize) -> [f32; 3]| {
        let mut hair = tuft();
        hair.color = Some((0..hair.points.len()).map(color).collect());
        hair
    };
    let told = |loaded: &LoadedHair| notes(loaded).iter().filter(|n| n.contains("255")).count();
    for color in [[200.0, 120.0, 60.0], [3.0, 2.0, 2.0], [255.0, 0.5, 0.0]] {
        let loaded = load(&with(&|_| color), &LoadOptions::default());
        assert_eq!(told(&loaded), 1, "{:?}", notes(&loaded));
        assert_eq!(loaded.hair.color.unwrap()[7], color.map(|c| c / 255.0));
        assert_eq!(loaded.mended.mended, 0);
    }
    // Colours up to 1, a little above, and one that is beyond all reason.
    for color in [[0.8, 0.4, 0.2], [1.3, 0.9, 0.5], [1.0, 1.0, 0.0]] {
        let loaded = load(&with(&|_| color), &LoadOptions::default());
        assert_eq!(told(&loaded), 0, "{:?}", notes(&loaded));
        assert_eq!(loaded.hair.color.unwrap()[7], color.map(|c| c.min(1.0)));
    }
    let one = |i: usize| if i == 9 { [2.0, 0.5, 0.5] } else { [0.5; 3] };
    assert_eq!(told(&load(&with(&one), &LoadOptions::default())), 0);
}

#[test]
fn thickness_that_is_no_number_is_one_clear_line() {
    let mut hair = tuft();
    hair.thickness = Some(vec![-1.0; hair.points.len()]);
    let loaded = load(&hair, &LoadOptions::default());
    assert_eq!(loaded.hair.thickness, None);
    let told: Vec<_> = notes(&loaded).into_iter().filter(|n| n.contains("thickness")).collect();
    assert_eq!(
        told,
        [
            "4800 thicknesses, which are all, NaN, infinite or negative: strands taper to 0.3 of their width \
                       at the tip"
        ]
    );

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hair");
    let header = Header { default_thickness: f32::NAN, ..Header::default() };
    HairFile { hair: tuft(), header, trailing_bytes: 0 }.write(&path).unwrap();
    let loaded = hair::load(path.to_str().unwrap(), &LoadOptions::default()).unwrap();
    assert!(hair::fibre_diameter(&loaded.hair).diameter > 0.0);
    let told: Vec<_> = notes(&loaded).into_iter().filter(|n| n.contains("NaN")).collect();
    assert_eq!(told, ["a default of the header is NaN or infinite: none is used"]);
}

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data");

#[test]
#[ignore = "needs ../shared/data"]
fn no_groom_of_the_data_is_taken_the_wrong_way_round() {
    let file =
        |name: &str| hair::load(&format!("{DATA}/{name}.hair"), &LoadOptions::default()).unwrap();
    let mut known = 0;
    for name in [
        "long_straight_60k",
        "sintel",
        "tressfx_ponytail",
        "vitruvian_bob",
        "vitruvian_combover_zoro_d",
        "vitruvian_eve",
        "vitruvian_scenehair_1_o4saken",
    ] {
        let right = file(&format!("hair/{name}"));
        assert!(!notes(&right).iter().any(|n| n.contains("tip to root")), "{name}");
        assert!(!is_reversed(&right.hair, None), "{name}");
        let mut stored = right.hair;
        reverse(&mut stored);
        let found = is_reversed(&stored, None);
        println!("{name} from tip to root: {found}");
        known += usize::from(found);
    }
    assert!(known >= 6, "{known} of 7 are known");
    let (base, stored) = (file("odd/hair/base"), file("odd/hair/reversed"));
    assert_eq!(stored.hair, base.hair);
    assert!(!notes(&stored).iter().any(|n| n.contains("--up -y")), "{:?}", notes(&stored));
}
