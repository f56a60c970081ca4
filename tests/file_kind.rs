//! What a file is, by its content: for `info`, and in every reader's refusal.

use std::fs;
use std::path::Path;

use hairlight::file_kind::{FileKind, Role, text};
use hairlight::scene::Scene;
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
