//! Heads: what OBJ files say in other ways, which way a mesh faces, and where it goes beneath the roots.

use std::path::Path;

use glam::{Vec3, vec3};
use hairlight::hair::hair_format::{HairFile, Header};
use hairlight::hair::{self, Hair};
use hairlight::head::{self, Head, LoadedHead, Placement, Up, builtin};
use hairlight::scene::{Reverse, Scene};
use hairlight::stage::Geometry;
use tempfile::{TempDir, tempdir};

use crate::cli::{hairlight, stderr};
use crate::frames::captured;

fn load(bytes: &[u8]) -> anyhow::Result<LoadedHead> {
    let folder = tempdir().unwrap();
    let path = folder.path().join("head.obj");
    std::fs::write(&path, bytes).unwrap();
    head::load(path.to_str().unwrap())
}

fn sound(bytes: &[u8]) -> LoadedHead {
    load(bytes).unwrap_or_else(|e| panic!("{e:#}"))
}

/// The corners of all triangles, in order.
fn corners(head: &Head) -> Vec<[Vec3; 3]> {
    head.triangles.iter().map(|t| t.map(|v| head.positions[v as usize])).collect()
}

const CUBE: &str = "# a cube\nv -1 -1 -1\nv -1 -1 1\nv -1 1 -1\nv -1 1 1\nv 1 -1 -1\nv 1 -1 1\nv 1 1 -1\nv 1 1 1\n\
    f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n";

#[test]
fn an_obj_reads_alike_however_it_is_written() {
    let cube = corners(&sound(CUBE.as_bytes()).head);
    assert_eq!(cube.len(), 12);
    // The first line is a place: a mark before it must not take it away.
    let bare = CUBE.split_once('\n').unwrap().1;
    let utf16 = |unit: fn(u16) -> [u8; 2]| -> Vec<u8> {
        std::iter::once(0xfeff).chain(bare.encode_utf16()).flat_map(unit).collect()
    };
    let counted_back = "v -1 -1 -1\nv -1 -1 1\nv -1 1 -1\nv -1 1 1\nvt 0 0\nvt 1 0\nvn -1 0 0\nf -4/-2 -3/-1 -1/-1 -2/-2\n\
        v 1 -1 -1\nv 1 -1 1\nv 1 1 -1\nv 1 1 1\nvt 0 1\nf -4/-3 -2/1 -1/2 -3/-1\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n";
    let ways: [(&str, Vec<u8>); 14] = [
        ("a byte order mark", [b"\xef\xbb\xbf", bare.as_bytes()].concat()),
        ("UTF-16, little endian", utf16(u16::to_le_bytes)),
        ("UTF-16, big endian", utf16(u16::to_be_bytes)),
        ("CR LF", CUBE.replace('\n', "\r\n").into()),
        ("CR alone", CUBE.replace('\n', "\r").into()),
        (
            "continued lines",
            bare.replace(" 1 -1\n", " 1 \\\n -1\n").replace("f 1 2 ", "f 1 2 \\\n").into(),
        ),
        (
            "continued lines, CR LF",
            bare.replace("f 1 2 ", "f 1 2\\\n").replace('\n', "\r\n").into(),
        ),
        ("a remark that ends in a backslash", CUBE.replace("# a cube", "# C:\\heads\\").into()),
        ("a name that ends in a backslash", CUBE.replace("# a cube", "g C:\\heads\\").into()),
        ("remarks after faces", CUBE.replace("\nf", " # a corner\nf").into()),
        (
            "NaN where no face is",
            CUBE.replace("f 1 2", "v -nan(ind) 1.#QNAN nan\nv -1.#IND00 0 0\nf 1 2").into(),
        ),
        (
            "weights and colours",
            bare.replace("1\nv", "1 1.0\nv").replace("-1\nf", "-1 0.5 0.5 0.5\nf").into(),
        ),
        ("places and textures counted back from each face", counted_back.into()),
        ("tabs", bare.replace(' ', "\t").into()),
    ];
    for (name, bytes) in ways {
        let loaded = load(&bytes).unwrap_or_else(|e| panic!("{name}: {e:#}"));
        assert_eq!(corners(&loaded.head), cube, "{name}");
        assert_eq!(loaded.dropped_triangles, 0, "{name}");
    }
    // The comparison sees a face that is not there, and a NaN that a face uses.
    assert_ne!(corners(&sound(CUBE.replace("f 2 6 8 4\n", "").as_bytes()).head), cube);
    let used = sound(CUBE.replace("v 1 1 1", "v 1 -nan(ind) 1").as_bytes());
    assert_eq!(used.dropped_triangles, 6);
    assert!(used.notes()[0].starts_with("head: 6 triangles left out"), "{:?}", used.notes());
    assert!(load(CUBE.replace("v 1 1 1", "v 1 one 1").as_bytes()).is_err());
}

#[test]
fn a_vertex_far_away_does_not_make_the_head_small() {
    let far = sound(format!("{CUBE}v 1e9 1e9 1e9\nf 1 2 9\n").as_bytes());
    assert_eq!(corners(&far.head), corners(&sound(CUBE.as_bytes()).head));
    assert_eq!(far.dropped_triangles, 1);
    // What is large is no stray.
    assert_eq!(sound(format!("{CUBE}v 60 60 60\nf 1 2 9\n").as_bytes()).dropped_triangles, 0);
}

/// A closed ball, or its upper half, as an OBJ whose faces point outward; of `normals`, with those.
fn ball(
    center: Vec3,
    radius: f32,
    half: bool,
    normals: Option<f32>,
    first: usize,
) -> (String, usize) {
    let (rings, around) = (if half { 8 } else { 16 }, 24);
    let mut text = String::new();
    for ring in 0..=rings {
        for k in 0..around {
            let (sin, cos) = (std::f32::consts::PI * ring as f32 / 16.0).sin_cos();
            // All vertices of a pole are at one place.
            let sin = if ring == 16 { 0.0 } else { sin };
            let (x, z) = (std::f32::consts::TAU * k as f32 / around as f32).sin_cos();
            let n = vec3(sin * x, cos, sin * z);
            let p = center + radius * n;
            text += &format!("v {} {} {}\n", p.x, p.y, p.z);
            if let Some(side) = normals {
                text += &format!("vn {} {} {}\n", side * n.x, side * n.y, side * n.z);
            }
        }
    }
    for ring in 0..rings {
        for k in 0..around {
            let at = |ring: usize, k: usize| first + ring * around + k % around + 1;
            let quad = [at(ring, k), at(ring + 1, k), at(ring + 1, k + 1), at(ring, k + 1)];
            let corner = |v: usize| match normals {
                Some(_) => format!(" {v}//{v}"),
                None => format!(" {v}"),
            };
            text += &format!("f{}\n", quad.map(corner).concat());
        }
    }
    (text, first + (rings + 1) * around)
}

/// Faces whose number `inward` picks, turned around.
fn turned(obj: &str, inward: impl Fn(usize) -> bool) -> String {
    let mut face = 0;
    let line = |line: &str| {
        let Some(words) = line.strip_prefix("f ") else { return format!("{line}\n") };
        face += 1;
        if !inward(face) {
            return format!("{line}\n");
        }
        let words: Vec<&str> = words.split_whitespace().rev().collect();
        format!("f {}\n", words.join(" "))
    };
    obj.lines().map(line).collect()
}

/// The share of normals that point away from `center`.
fn outward(head: &Head, center: Vec3) -> f32 {
    let out = head.positions.iter().zip(&head.normals);
    let out = out.filter(|(p, n)| (**p - center).dot(**n) > 0.0).count();
    out as f32 / head.positions.len() as f32
}

#[test]
fn meshes_face_outward_whatever_their_file_says() {
    let center = vec3(3.0, -2.0, 0.5);
    for half in [false, true] {
        for normals in [None, Some(1.0), Some(-1.0)] {
            let (obj, _) = ball(center, 0.3, half, normals, 0);
            let ways: [(&str, &dyn Fn(usize) -> bool); 3] =
                [("as it is", &|_| false), ("inside out", &|_| true), ("mixed", &|i| i % 3 == 0)];
            for (name, inward) in ways {
                let loaded = sound(turned(&obj, inward).as_bytes());
                assert_eq!(outward(&loaded.head, center), 1.0, "half {half}, {normals:?}, {name}");
                let faces = corners(&loaded.head);
                let out = faces.iter().filter(|[a, b, c]| {
                    (*b - *a).cross(*c - *a).dot((*a + *b + *c) / 3.0 - center) > 0.0
                });
                assert_eq!(out.count(), faces.len(), "half {half}, {normals:?}, {name}");
                assert_eq!(loaded.turned_triangles > 0, name != "as it is", "{name}");
                assert_eq!(loaded.turned_normals > 0, normals == Some(-1.0), "{name}");
                let told = loaded.notes().iter().any(|note| note.contains("faced inward"));
                assert_eq!(told, name != "as it is", "{:?}", loaded.notes());
            }
        }
    }
}

#[test]
fn parts_of_a_mesh_are_turned_apart_from_each_other() {
    // An eye beside a bust, either of them inside out; a lash, which is flat, follows the rest.
    let (bust, after) = ball(Vec3::ZERO, 1.0, true, None, 0);
    let (eye, after) = ball(vec3(0.0, 0.3, 2.0), 0.1, false, None, after);
    let lash = format!("v 0 0 3\nv 1 0 3\nv 1 1 3\nf {} {} {}\n", after + 1, after + 2, after + 3);
    let flat = |loaded: &LoadedHead| {
        let last = loaded.head.triangles.last().unwrap().map(|v| loaded.head.positions[v as usize]);
        (last[1] - last[0]).cross(last[2] - last[0]).z
    };
    let whole = sound(format!("{bust}{eye}{lash}").as_bytes());
    assert_eq!(whole.turned_triangles, 0);
    assert!(flat(&whole) > 0.0);
    let eye_out = sound(format!("{bust}{}{lash}", turned(&eye, |_| true)).as_bytes());
    assert_eq!(eye_out.turned_triangles, 720);
    let out = |at: &dyn Fn(&Vec3) -> bool, center: Vec3| {
        let places = eye_out.head.positions.iter().zip(&eye_out.head.normals);
        places.filter(|(p, _)| at(p)).all(|(p, n)| (*p - center).dot(*n) > 0.0)
    };
    assert!(out(&|p| (1.5..2.5).contains(&p.z), vec3(0.0, 0.3, 2.0)));
    assert!(out(&|p| p.z < 1.5, -0.01 * Vec3::Y));
    assert!(flat(&eye_out) > 0.0);
    let all = sound(turned(&format!("{bust}{eye}{lash}"), |_| true).as_bytes());
    assert_eq!(all.turned_triangles, all.head.triangles.len());
    assert!(flat(&all) > 0.0);
    // The inside of a mouth faces its own middle, as it should: a tenth of the area has no say of its own.
    let (mouth, _) = ball(vec3(0.0, 0.2, 0.7), 0.1, true, None, after + 3);
    let mouth = sound(format!("{bust}{eye}{lash}{}", turned(&mouth, |_| true)).as_bytes());
    assert_eq!(mouth.turned_triangles, 0);
}

/// A head of no symmetry but left and right, centred near its file's origin, as OBJ in a file's frame.
fn lopsided(own: &Placement) -> String {
    let head = builtin::builtin_head();
    let own_of = |p: Vec3| {
        let p = (p - own.offset) / own.scale;
        let [x, y, z] = Vec3::AXES.map(|axis| own.up.to_world(axis));
        vec3(x.dot(p), y.dot(p), z.dot(p))
    };
    let mut text = String::new();
    for p in head.positions.iter().map(|&p| own_of(p)) {
        text += &format!("v {} {} {}\n", p.x, p.y, p.z);
    }
    for [a, b, c] in &head.triangles {
        text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
    }
    text
}

/// Roots of builtin hair at the place of the builtin head, strands of two points, each the other way round if `reversed`.
fn stubble(reversed: bool) -> Hair {
    let groom = hair::groom::GroomOptions { strands: 2_000, ..Default::default() };
    let grown = hair::groom::grow("straight", &groom).unwrap();
    let points = grown.polylines().flat_map(|p| {
        let ends = [p[0], p[p.len() / 2]];
        if reversed { [ends[1], ends[0]] } else { ends }
    });
    let points: Vec<Vec3> = points.collect();
    let offsets = (0..=points.len() as u32 / 2).map(|s| 2 * s).collect();
    Hair { points, offsets, ..Hair::default() }
}

struct Files {
    folder: TempDir,
}

impl Files {
    fn new(hair: Hair, head: &str) -> Files {
        let folder = tempdir().unwrap();
        let file = HairFile { hair, header: Header::default(), trailing_bytes: 0 };
        file.write(&folder.path().join("a.hair")).unwrap();
        std::fs::write(folder.path().join("a.obj"), head).unwrap();
        Files { folder }
    }

    fn scene(&self) -> Scene {
        let path = |name: &str| self.folder.path().join(name).to_str().unwrap().to_owned();
        let mut scene = Scene::default();
        scene.hair.source = path("a.hair");
        scene.head.source = path("a.obj");
        scene
    }
}

/// Of heads on a stage, where folds are split.
fn farthest(a: &Head, b: &Head) -> f32 {
    let [a, b] = [a, b].map(|head| {
        let mut head = head.clone();
        head.split_folds();
        head
    });
    assert_eq!(a.positions.len(), b.positions.len());
    let apart = a.positions.iter().zip(&b.positions).map(|(a, b)| a.distance(*b));
    apart.fold(0.0, f32::max)
}

#[test]
fn a_head_in_other_units_or_axes_is_put_beneath_the_roots() {
    let own = Placement::default();
    let right = Geometry::load(&Files::new(stubble(false), &lopsided(&own)).scene()).unwrap();
    assert!(!right.notes.iter().any(|note| note.contains("head")), "{:?}", right.notes);
    let right = right.head.unwrap();
    for (up, scale) in [
        (Up::Y, 0.01),
        (Up::Z, 1.0),
        (Up::Z, 0.01),
        (Up::NegX, 0.0254),
        (Up::Y, 1000.0),
        (Up::NegY, 39.37),
    ] {
        let files = Files::new(stubble(false), &lopsided(&Placement { up, scale, ..own }));
        let stage = Geometry::load(&files.scene()).unwrap();
        let off = farthest(stage.head.as_ref().unwrap(), &right);
        assert!(off < 1e-4, "{up}, {scale}: {off}");
        let told = stage.notes.iter().find(|note| note.contains("head: ")).expect("a note");
        assert!(told.contains(&format!("{up} is up, the scale {scale}")), "{told}");

        // With the hair's own transform, which the units are relative to.
        let mut scene = files.scene();
        scene.hair.scale = 10.0;
        let grown = Geometry::load(&scene).unwrap().head.unwrap();
        let tenfold = Head {
            positions: right.positions.iter().map(|&p| 10.0 * p).collect(),
            ..right.clone()
        };
        assert!(farthest(&grown, &tenfold) < 1e-3, "{up}, {scale}");

        // What is said holds, however wrong.
        scene.hair.scale = 1.0;
        (scene.head.up, scene.head.scale) = (Some(Up::X), Some(0.5));
        scene.head.offset = Some([1.0, 2.0, 3.0]);
        let mut said = head::load(&scene.head.source).unwrap().head;
        said.place(&Placement { up: Up::X, scale: 0.5, offset: vec3(1.0, 2.0, 3.0) });
        said.split_folds();
        let stage = Geometry::load(&scene).unwrap();
        assert_eq!(stage.head.unwrap(), said);
        // Of what is not said, the rest is found.
        scene.head = hairlight::scene::HeadSpec { source: scene.head.source, ..Default::default() };
        scene.head.scale = Some(f64::from(scale));
        assert!(farthest(&Geometry::load(&scene).unwrap().head.unwrap(), &right) < 1e-4);
    }
}

#[test]
fn a_head_that_lies_beneath_no_root_is_told_of() {
    let away = Placement { offset: vec3(0.0, -40.0, 0.0), ..Placement::default() };
    let files = Files::new(stubble(false), &lopsided(&away));
    let stage = Geometry::load(&files.scene()).unwrap();
    let told: Vec<_> = stage.notes.iter().filter(|note| note.starts_with("head: ")).collect();
    assert_eq!(told.len(), 1, "{:?}", stage.notes);
    assert!(told[0].contains("--head-offset") && told[0].contains("0 % of the roots"), "{told:?}");
    let mut scene = files.scene();
    scene.head.offset = Some([0.0, -40.0, 0.0]);
    let stage = Geometry::load(&scene).unwrap();
    assert!(!stage.notes.iter().any(|note| note.starts_with("head: ")), "{:?}", stage.notes);
}

#[test]
fn the_builtin_head_is_fitted_beneath_a_files_roots_or_refused() {
    let place = |p: Vec3| 25.0 * p + vec3(3.0, 160.0, -4.0);
    let mut moved = stubble(false);
    moved.points.iter_mut().for_each(|p| *p = place(*p));
    let files = Files::new(moved, "");
    let mut scene = files.scene();
    scene.head.source = "builtin".to_owned();
    let stage = Geometry::load(&scene).unwrap();
    let fitted = stage.head.as_ref().unwrap();
    let mut right = builtin::builtin_head();
    right.positions.iter_mut().for_each(|p| *p = place(*p));
    // Within 1.5 cm on a head of 25 cm.
    let scalp = |head: &Head| head.positions.iter().map(|p| p.y).fold(f32::MIN, f32::max);
    assert!(
        (scalp(fitted) - scalp(&right)).abs() < 25.0 * 0.01,
        "{} {}",
        scalp(fitted),
        scalp(&right)
    );
    assert!(farthest(fitted, &right) < 25.0 * 0.03, "{}", farthest(fitted, &right));
    assert!(stage.notes.iter().any(|note| note.contains("of the roots lie on it")));
    // At the file's own origin it would be nowhere near.
    scene.head.offset = Some([0.0; 3]);
    scene.head.scale = Some(1.0);
    let mut own = builtin::builtin_head();
    own.split_folds();
    assert_eq!(Geometry::load(&scene).unwrap().head.unwrap(), own);

    // A bush has no head.
    let mut bush = stubble(false);
    let coordinate = |i: usize, p: u32| (i as u32).wrapping_mul(p) as f32 / u32::MAX as f32;
    for (i, ends) in bush.points.chunks_exact_mut(2).enumerate() {
        ends[0] = [2_654_435_761, 2_246_822_519, 3_266_489_917].map(|p| coordinate(i, p)).into();
        ends[1] = ends[0] + 0.1 * Vec3::Y;
    }
    let files = Files::new(bush, "");
    let mut scene = files.scene();
    scene.head.source = "builtin".to_owned();
    let error = format!("{:#}", Geometry::load(&scene).err().expect("refused"));
    assert!(error.contains("the builtin head does not fit") && error.contains("a.hair"), "{error}");
    assert_eq!(error.lines().count(), 1);
}

#[test]
fn the_roots_on_a_head_tell_strands_from_tip_to_root() {
    let head = lopsided(&Placement::default());
    let right = Geometry::load(&Files::new(stubble(false), &head).scene()).unwrap();
    let files = Files::new(stubble(true), &head);
    let found = Geometry::load(&files.scene()).unwrap();
    assert_eq!(found.hair.points, right.hair.points);
    let told = |stage: &Geometry| stage.notes.iter().any(|note| note.contains("from tip to root"));
    assert!(told(&found) && !told(&right), "{:?}", found.notes);
    assert!(!found.notes.iter().any(|note| note.contains("may be meant")), "{:?}", found.notes);
    let mut scene = files.scene();
    scene.hair.reverse = Reverse::No;
    assert_ne!(Geometry::load(&scene).unwrap().hair.points, right.hair.points);
}

/// Mean of the pixels of a linear picture that show the head alone.
fn head_mean(path: &Path) -> [f32; 3] {
    let picture = hairlight::measure::read::Picture::read(path).unwrap();
    let (alpha, hair) = (picture.alpha.as_ref().unwrap(), picture.hair.as_ref().unwrap());
    let (mut sum, mut count) = ([0.0; 3], 0.0f32);
    for (i, rgb) in picture.rgb.iter().enumerate() {
        if alpha[i] > 0.999 && hair[i] == 0.0 {
            (0..3).for_each(|c| sum[c] += rgb[c]);
            count += 1.0;
        }
    }
    assert!(count > 50.0, "{count} pixels show the head");
    sum.map(|s| s / count)
}

#[test]
fn the_head_has_the_colour_that_the_scene_says_in_frames_and_in_the_tracer() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    let scene = [
        "--hair",
        "builtin:straight",
        "--strands",
        "1000",
        "--length",
        "0.2",
        "--size",
        "60x40",
        "--env",
        "builtin:overcast",
        "--lights",
        "8",
        "--background",
        "transparent",
        "--preset",
        "black",
    ];
    let means = |color: &str| {
        captured(
            path,
            &[&scene[..], &["--head-color", color, "--samples", "4", "-o", "f.exr"]].concat(),
        );
        let traced = hairlight(path)
            .args(
                [
                    &["reference", "-q"],
                    &scene[..],
                    &["--head-color", color, "--spp", "16", "-o", "t.exr"],
                ]
                .concat(),
            )
            .output()
            .unwrap();
        assert!(traced.status.success(), "{}", stderr(&traced));
        [head_mean(&path.join("f.exr")), head_mean(&path.join("t.exr"))]
    };
    let [white, grey] = [means("0.8,0.8,0.8"), means("0.2,0.4,0.8")];
    for (side, (white, grey)) in ["frame", "tracer"].iter().zip(white.iter().zip(&grey)) {
        // Light from head to head and hair counts a little more than once.
        let ratio = [0, 1, 2].map(|c| grey[c] / white[c]);
        println!("{side}: {ratio:?}");
        assert!((ratio[0] - 0.25).abs() < 0.05, "{side}: {ratio:?}");
        assert!((ratio[1] - 0.5).abs() < 0.06, "{side}: {ratio:?}");
        assert!((ratio[2] - 1.0).abs() < 0.02, "{side}: {ratio:?}");
    }
}

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data");

#[test]
#[ignore = "needs ../shared/data"]
fn heads_of_the_data_are_found_in_other_units_and_axes() {
    let folder = tempdir().unwrap();
    for (hair, head) in [
        ("sintel", "sintel"),
        ("vitruvian_combover_zoro_d", "vitruvian_bust"),
        ("vitruvian_bob", "vitruvian_bust"),
    ] {
        let path = format!("{DATA}/head/{head}.obj");
        let mut scene = Scene::default();
        scene.hair.source = format!("{DATA}/hair/{hair}.hair");
        scene.head.source = path.clone();
        let right = Geometry::load(&scene).unwrap();
        assert!(!right.notes.iter().any(|n| n.contains("% of the roots")), "{:?}", right.notes);
        assert!(!right.notes.iter().any(|n| n.contains("tip to root")), "{:?}", right.notes);
        let text = std::fs::read_to_string(&path).unwrap();
        for (up, scale) in [(Up::Y, 0.01), (Up::Z, 1.0), (Up::Z, 0.0254)] {
            let own = Placement { up, scale, offset: Vec3::ZERO };
            let line = |line: &str| {
                let numbers = line.strip_prefix("v ").map(|rest| {
                    let p: Vec<f32> =
                        rest.split_whitespace().take(3).map(|w| w.parse().unwrap()).collect();
                    own.up.from_world(Vec3::from_slice(&p) / own.scale)
                });
                let normal = line.strip_prefix("vn ").map(|_| String::new());
                match numbers {
                    Some(p) => format!("v {} {} {}\n", p.x, p.y, p.z),
                    None => normal.unwrap_or_else(|| format!("{line}\n")),
                }
            };
            let plain = text.lines().map(line).collect::<String>();
            // Normals are left out: they would have to be turned as well.
            let plain = plain.replace("//", "/");
            let file = folder.path().join("head.obj");
            std::fs::write(&file, plain).unwrap();
            scene.head.source = file.to_str().unwrap().to_owned();
            let stage = Geometry::load(&scene).unwrap();
            let told = stage.notes.iter().find(|note| note.contains("% of the roots"));
            let expected = format!("{up} is up, the scale {scale}");
            assert!(told.is_some_and(|note| note.contains(&expected)), "{hair}: {:?}", stage.notes);
        }
    }
    for hair in ["sintel", "vitruvian_eve", "tressfx_ponytail", "long_straight_60k"] {
        let mut scene = Scene::default();
        scene.hair.source = format!("{DATA}/hair/{hair}.hair");
        scene.head.source = "builtin".to_owned();
        let stage = Geometry::load(&scene).unwrap();
        assert!(stage.notes.iter().any(|n| n.contains("of the roots lie on it")), "{hair}");
    }
}

#[test]
#[ignore = "needs ../shared/data"]
fn odd_heads_of_the_data_are_the_base_one() {
    let load = |name: &str| head::load(&format!("{DATA}/odd/obj/{name}.obj")).unwrap();
    let base = corners(&load("base").head);
    for name in
        ["bom_v_spare", "continuation", "cr_only", "inline_comment", "utf16", "head_outlier"]
    {
        assert_eq!(corners(&load(name).head), base, "{name}");
    }
    assert_eq!(corners(&load("cube_bom").head), corners(&load("cube_plain").head));
    let inverted = load("inverted");
    assert_eq!(inverted.turned_triangles, base.len());
    assert_eq!(outward(&inverted.head, Vec3::ZERO), 1.0);
    assert_eq!(outward(&load("negative_interleaved").head, Vec3::ZERO), 1.0);
    assert!(load("ngon").head.triangles.len() > base.len() / 2);
}
