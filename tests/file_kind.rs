//! What a file is, by its content: for `info`, and in every reader's refusal.

use std::fs;
use std::path::Path;

use glam::Vec3;
use hairlight::field::Grid;
use hairlight::file_kind::{FileKind, Role, text};
use hairlight::hair::hair_format::{HairFile, Header};
use hairlight::hair::{self, Hair};
use hairlight::head;
use hairlight::paint::{Channel, Paint};
use hairlight::scene::Scene;
use hairlight::stage::Geometry;
use hairlight::transport::Occluders;
use tempfile::tempdir;

use crate::cli::{run, stderr, stdout};

fn zip_of(name: &str) -> Vec<u8> {
    let mut bytes = b"PK\x03\x04".to_vec();
    bytes.resize(26, 0);
    bytes.extend((name.len() as u16).to_le_bytes());
    bytes.extend([0; 2]);
    bytes.extend(name.as_bytes());
    bytes
}

/// Two strands of two and three points.
fn usc() -> Vec<u8> {
    let mut bytes = 2u32.to_le_bytes().to_vec();
    for points in [2u32, 3] {
        bytes.extend(points.to_le_bytes());
        (0..3 * points).for_each(|i| bytes.extend((0.1 * i as f32).to_le_bytes()));
    }
    bytes
}

fn utf16(text: &str) -> Vec<u8> {
    std::iter::once(0xfeff).chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect()
}

/// Files that are not read, and words that say what each is.
fn foreign() -> Vec<(&'static str, Vec<u8>, &'static str)> {
    vec![
        ("a.abc", b"Ogawa\xff\x00\x01".to_vec(), "an Alembic cache"),
        ("b.abc", b"\x89HDF\r\n\x1a\n\0\0".to_vec(), "an HDF5 file, such as an old Alembic cache"),
        ("a.usda", b"#usda 1.0\n(\n)".to_vec(), "a USD scene as text"),
        ("bom.usda", b"\xef\xbb\xbf#usda 1.0\n(\n)".to_vec(), "a USD scene as text"),
        ("a.usdc", b"PXR-USDC\0\0".to_vec(), "a binary USD scene"),
        ("a.usdz", zip_of("scene.usdc"), "a packed USD scene"),
        ("a.npz", zip_of("strands.npy"), "NumPy arrays"),
        ("a.zip", zip_of("hair/a.hair"), "a zip archive"),
        ("a.glb", b"glTF\x02\0\0\0".to_vec(), "a binary glTF scene"),
        ("a.gltf", b"{ \"asset\": { \"version\": \"2.0\" } }".to_vec(), "a glTF scene"),
        ("a.fbx", b"Kaydara FBX Binary  \0".to_vec(), "an FBX scene"),
        ("a.ply", b"ply\nformat ascii 1.0\nend_header\n".to_vec(), "a PLY file"),
        ("b.ply", b"ply\r\nformat binary_little_endian 1.0\r\n\0\x01".to_vec(), "a PLY file"),
        ("a.tfx", b"version 2.0\nscale 1.0\n".to_vec(), "a text .tfx of TressFX 1 or 2"),
        ("a.hair", b"version https://git-lfs.github.com/spec/v1\n".to_vec(), "a Git LFS pointer"),
        ("a.html", b"<!DOCTYPE html>\n<html>".to_vec(), "a web page"),
        ("a.png", b"\x89PNG\r\n\x1a\n\0\0".to_vec(), "a PNG picture"),
        ("a.jpg", b"\xff\xd8\xff\xe0\0\x10JFIF".to_vec(), "a JPEG picture"),
        ("a.tif", b"II*\0\x08\0".to_vec(), "a TIFF picture"),
        ("a.data", usc(), "strands as the USC hair data set has them"),
        ("a.npy", b"\x93NUMPY\x01\0".to_vec(), "a NumPy array"),
        ("a.mtl", b"# materials\nnewmtl skin\n".to_vec(), "the materials of an OBJ mesh"),
        ("a.blend", b"BLENDER-v500".to_vec(), "a Blender file"),
        ("a.gz", b"\x1f\x8b\x08\0".to_vec(), "a gzip archive"),
        ("wide.txt", utf16("v 0 0 0\n")[2..].to_vec(), "UTF-16 text without a byte order mark"),
    ]
}

#[test]
fn every_reader_says_what_a_file_is_that_it_cannot_read() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    let refused = |arguments: &[&str]| {
        let output = run(path, arguments);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {}", stderr(&output));
        assert!(stdout(&output).is_empty(), "{arguments:?}");
        let error = stderr(&output);
        assert_eq!(error.lines().count(), 1, "{arguments:?}: {error}");
        error
    };
    for (name, bytes, what) in foreign() {
        fs::write(path.join(name), &bytes).unwrap();
        assert!(matches!(FileKind::of(&bytes), FileKind::Foreign(..)), "{name}");
        let told = refused(&["info", name]);
        let start = format!("error: {name}: is {what}");
        assert!(
            told.starts_with(&start) && told.contains("which cannot be given to Hairlight: "),
            "{told}"
        );
    }
    // One of each through each reader.
    for arguments in [
        &["capture", "-q", "--hair", "a.abc"][..],
        &["capture", "-q", "--head", "a.abc"],
        &["capture", "-q", "--env", "a.abc"],
        &["capture", "-q", "a.abc"],
        &["fit", "a.abc"],
        &["view", "a.abc"],
    ] {
        let told = refused(arguments);
        assert!(
            told.contains("a.abc") && told.contains("an Alembic cache"),
            "{arguments:?}: {told}"
        );
        assert!(told.contains("export"), "{arguments:?}: {told}");
    }
}

#[test]
fn files_of_another_role_are_told_where_to_be_given() {
    let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    for (bytes, kind, wanted, says) in [
        (
            &obj[..],
            FileKind::Obj,
            Role::Hair,
            "is not hair but a Wavefront OBJ mesh: give it with --head",
        ),
        (
            b"HAIR\0\0\0\0",
            FileKind::Hair,
            Role::Head,
            "is not a head but a .hair groom: give it with --hair",
        ),
        (b"#?RADIANCE\n", FileKind::Radiance, Role::Hair, "a Radiance picture: give it with --env"),
        (
            b"\x76\x2f\x31\x01\x02\0",
            FileKind::OpenExr,
            Role::Scene,
            "an OpenEXR picture: give it with --env",
        ),
        (b"[fibre]\neta = 1.5\n", FileKind::Scene, Role::Map, "a scene file (TOML)"),
        (b"HLPAINT\x01", FileKind::Paint, Role::Hair, "paint for a groom: give it with --paint"),
        (b"", FileKind::Empty, Role::Hair, "is empty: export it again"),
        (
            b"hello there\n",
            FileKind::Text,
            Role::Hair,
            "text of no kind that Hairlight knows: export the groom",
        ),
        (
            b"\x01\x02\x03\xfe\xff",
            FileKind::Unknown,
            Role::Map,
            "of no kind that Hairlight knows: convert it",
        ),
    ] {
        assert_eq!(FileKind::of(bytes), kind);
        assert!(kind.refusal(wanted).contains(says), "{}", kind.refusal(wanted));
    }
    // Beyond a mark, and in UTF-16, the same.
    assert_eq!(FileKind::of(&[b"\xef\xbb\xbf", &obj[..]].concat()), FileKind::Obj);
    assert_eq!(FileKind::of(&utf16("v 0 0 0\n")), FileKind::Obj);
    assert_eq!(FileKind::of(b"# a remark\r\rv 0 0 0\r"), FileKind::Obj);
    // Numbers that no strand has are no strands.
    let mut wrong = usc();
    wrong[8..12].copy_from_slice(&f32::NAN.to_le_bytes());
    assert_eq!(FileKind::of(&wrong), FileKind::Unknown);
}

#[test]
fn no_file_panics() {
    let mut files: Vec<Vec<u8>> = foreign().into_iter().map(|(_, bytes, _)| bytes).collect();
    files.push(zip_of(&"a".repeat(300)));
    for bytes in files {
        for length in 0..bytes.len() {
            FileKind::of(&bytes[..length]);
            FileKind::of(&[&bytes[length..], &[0, 1, 255]].concat());
        }
    }
}

#[test]
fn scenes_and_lights_are_read_past_a_byte_order_mark() {
    let folder = tempdir().unwrap();
    let path = folder.path();
    let scene = "[fibre]\r\neta = 1.7\r\n";
    let lights = "{\"lights\":[{\"direction\":[0,1,0],\"lambda\":0.5,\"rgb\":[1,1,1]}]}";
    let marked = |text: &str| [b"\xef\xbb\xbf", text.as_bytes()].concat();
    for (scene, lights) in [
        (scene.as_bytes().to_vec(), lights.as_bytes().to_vec()),
        (marked(scene), marked(lights)),
        (utf16(scene), utf16(lights)),
    ] {
        fs::write(path.join("s.toml"), scene).unwrap();
        fs::write(path.join("l.json"), lights).unwrap();
        assert_eq!(Scene::read(&path.join("s.toml")).unwrap().fibre.eta, 1.7);
        let info = run(path, &["info", "l.json"]);
        assert!(stdout(&info).contains("lights                1\n"), "{}", stderr(&info));
    }
    assert_eq!(text(b"\xffa"), None);
    assert!(Scene::read(Path::new("/nowhere.toml")).is_err());
}

/// Numbers that are the same at every run (Marsaglia 2003).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % end.max(1) as u64) as usize
    }

    /// The file with a few of its bytes changed, cut out, doubled, or put in.
    fn mutated(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        for _ in 0..=self.below(4) {
            let at = self.below(bytes.len());
            match self.below(7) {
                0 => bytes.truncate(at),
                1 => {
                    let end = (at + self.below(64)).min(bytes.len());
                    bytes.drain(at..end);
                }
                2 => {
                    let end = (at + self.below(64)).min(bytes.len());
                    let again = bytes[at..end].to_vec();
                    bytes.splice(at..at, again);
                }
                3 => {
                    let words: [&[u8]; 8] = [
                        b"-1",
                        b"1e38",
                        b"nan",
                        b"/",
                        b"\\\n",
                        b"\r",
                        b"99999999999",
                        b"\xff\xff\xff\x7f",
                    ];
                    let word = words[self.below(words.len())];
                    bytes.splice(at..at, word.iter().copied());
                }
                4 if at + 4 <= bytes.len() => {
                    let word =
                        [0, 1, 0x7f7f_ffff, 0x7f80_0000, 0xffff_ffff, 0x4b18_9680][self.below(6)];
                    bytes[at..at + 4].copy_from_slice(&u32::to_le_bytes(word));
                }
                _ => {
                    if let Some(byte) = bytes.get_mut(at) {
                        *byte = self.below(256) as u8;
                    }
                }
            }
            if bytes.is_empty() {
                break;
            }
        }
        bytes
    }
}

/// Strands around half a ball, with all that points can have.
fn groom() -> Hair {
    let mut hair = Hair { offsets: (0..=40).map(|s| 5 * s).collect(), ..Hair::default() };
    for k in 0..40 {
        let up = 1.0 - k as f32 / 40.0;
        let (sin, cos) = (2.4 * k as f32).sin_cos();
        let out = (1.0 - up * up).sqrt() * Vec3::new(cos, 0.0, sin) + up * Vec3::Y;
        hair.points.extend((0..5).map(|i| out * (1.0 + 0.1 * i as f32)));
    }
    let points = hair.points.len();
    hair.thickness = Some(vec![0.1; points]);
    hair.color = Some(vec![[0.5, 0.4, 0.3]; points]);
    hair.transparency = Some(vec![0.0; points]);
    hair
}

#[test]
fn no_mutated_file_panics_or_takes_long_and_errors_are_one_line() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("mutated");
    let name = path.to_str().unwrap();
    let hair = groom();
    let file = HairFile { hair: hair.clone(), header: Header::default(), trailing_bytes: 0 };
    let mut tfx = 4.0f32.to_le_bytes().to_vec();
    for word in [8u32, 5, 160, 0, 0, 0, 0] {
        tfx.extend(word.to_le_bytes());
    }
    tfx.resize(160, 0);
    for p in &hair.points[..40] {
        [p.x, p.y, p.z, 1.0].iter().for_each(|x| tfx.extend(x.to_le_bytes()));
    }
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvn 0 0 1\nf 1/1/1 3/1/1 2/1/1\nf 1 2 4 # b\nf -1 -2 -3\n";
    let lights = "{\"lights\":[{\"direction\":[0,1,0],\"lambda\":0.5,\"rgb\":[1,1,1]}]}";
    let mut paint = Paint::bare(hair.points.len());
    paint.layer_mut(Channel::Thickness).set(3, [2.0, 0.0, 0.0], 1.0);
    paint.write(&path, &hair).unwrap();
    let painted = fs::read(&path).unwrap();

    type Read<'a> = &'a dyn Fn(&[u8]) -> anyhow::Result<()>;
    let read_hair: Read = &|_| {
        let loaded = hair::load(name, &hair::LoadOptions::default())?;
        let stage = Geometry::new(loaded.hair, None, 0.01);
        let volume = stage.density(16);
        let occluders = Occluders { volume: &volume, head: None };
        Grid::new(&stage, &occluders, 8);
        Ok(())
    };
    let readers: [(&str, Vec<u8>, Read); 6] = [
        ("hair", file.to_bytes().unwrap(), read_hair),
        ("tfx", tfx, read_hair),
        ("obj", obj.into(), &|_| head::load(name).map(drop)),
        ("scene", Scene::default().to_toml().into(), &|_| Scene::read(&path).map(drop)),
        ("lights", lights.into(), &|bytes| {
            hairlight::srbf::from_json(&hairlight::file_kind::lossy_text(bytes)).map(drop)
        }),
        ("paint", painted, &|_| Paint::read(&path, &hair).map(drop)),
    ];
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    for (what, sound, read) in readers {
        fs::write(&path, &sound).unwrap();
        read(&sound).unwrap_or_else(|e| panic!("{what}: {e:#}"));
        let (mut good, mut bad) = (0, 0);
        for _ in 0..400 {
            let bytes = random.mutated(&sound);
            fs::write(&path, &bytes).unwrap();
            let begun = std::time::Instant::now();
            match read(&bytes) {
                Ok(()) => good += 1,
                Err(error) => {
                    bad += 1;
                    let line = format!("{error:#}");
                    // What a parser of JSON or TOML quotes is joined to one line by the program.
                    assert!(!line.is_empty() && line.len() < 2000, "{what}: {line}");
                    assert!(!line.contains('\n') || what == "lights", "{what}: {line}");
                }
            }
            assert!(begun.elapsed().as_secs() < 10, "{what} takes {:?}", begun.elapsed());
        }
        println!("{what}: {good} read, {bad} refused");
        assert!(bad > 20 && good + bad == 400, "{what}: {good} read, {bad} refused");
    }
}
