//! Broken files: every reader gives what it reads, or one line that names the file, in time and without a panic.
//!
//! A format is its seeds, sound files that the test makes, and its reader. Mutations are drawn from a fixed seed, so
//! that a failure comes again; its file is kept. A few a format always run; `HAIRLIGHT_MUTATIONS=N` runs N of each.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use anyhow::Result;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer,
    LayerAttributes, LineOrder, Vec2, WritableImage,
};
use glam::{DVec3, Vec3};
use hairlight::field::Grid;
use hairlight::hair::hair_format::{HairFile, Header};
use hairlight::hair::{self, Hair, LoadOptions};
use hairlight::measure::read::Picture;
use hairlight::paint::{Channel, Paint};
use hairlight::scene::Scene;
use hairlight::srbf::{SrbfLight, to_json};
use hairlight::stage::Geometry;
use hairlight::transport::Occluders;
use hairlight::{environment, head};

/// Mutations of each format that always run, and of all formats together in the long run.
const FEW: usize = 200;
const MANY: usize = 10_000;
/// No file may take longer.
const LIMIT: Duration = Duration::from_secs(10);

type Read = Box<dyn Fn(&Path) -> Result<()> + Send + Sync>;

struct Format {
    /// What files are named by.
    extension: &'static str,
    /// Sound files.
    seeds: Vec<Vec<u8>>,
    read: Read,
}

fn format<T>(
    extension: &'static str,
    seeds: Vec<Vec<u8>>,
    read: impl Fn(&Path) -> Result<T> + Send + Sync + 'static,
) -> Format {
    Format { extension, seeds, read: Box::new(move |path| read(path).map(|_| ())) }
}

/// One line a reader.
fn formats() -> Vec<Format> {
    let groom = groom();
    vec![
        format("exr", exr_seeds(), |path| environment::load(text(path))),
        format("frame.exr", exr_seeds(), Picture::read),
        format("hdr", hdr_seeds(), |path| environment::load(text(path))),
        format("json", lights_seeds(), |path| environment::load(text(path))),
        format("hair", hair_seeds(), load_hair),
        format("tfx", tfx_seeds(), load_hair),
        format("obj", obj_seeds(), |path| head::load(text(path))),
        format("toml", toml_seeds(), Scene::read),
        format("paint", paint_seeds(&groom), move |path| Paint::read(path, &groom)),
    ]
}

/// Loads a groom, and makes of it what a count from its file could make endless.
fn load_hair(path: &Path) -> Result<()> {
    let loaded = hair::load(text(path), &LoadOptions::default())?;
    let stage = Geometry::new(loaded.hair, None, 0.01);
    let volume = stage.density(16);
    Grid::new(&stage, &Occluders { volume: &volume, head: None }, 8);
    Ok(())
}

fn text(path: &Path) -> &str {
    path.to_str().expect("paths of tests are UTF-8")
}

// Seeds.

fn exr_seeds() -> Vec<Vec<u8>> {
    use Compression::{B44, B44A, DWAA, DWAB, PIZ, PXR24, RLE, Uncompressed, ZIP1, ZIP16};
    let scanlines = [Uncompressed, RLE, ZIP1, ZIP16, PIZ, PXR24, B44, B44A, DWAA(None), DWAB(None)];
    let tiled = [Uncompressed, RLE, ZIP16, PIZ];
    let file = |compression, blocks, names: &[&str]| {
        let value = |i: usize| 0.1 * (i % 37) as f32 + (i % 29) as f32;
        let samples: Vec<f32> = (0..24 * 12).map(value).collect();
        let channels = names
            .iter()
            .map(|name| AnyChannel::new(*name, FlatSamples::F32(samples.clone())))
            .collect();
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let layer =
            Layer::new((24, 12), LayerAttributes::default(), encoding, AnyChannels::sort(channels));
        let mut bytes = std::io::Cursor::new(Vec::new());
        Image::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    };
    let scanlines = scanlines.map(|c| file(c, Blocks::ScanLines, &["B", "G", "R"]));
    let tiled = tiled.map(|c| file(c, Blocks::Tiles(Vec2(8, 8)), &["B", "G", "R"]));
    let layers =
        ["A", "B", "G", "R", "hair", "x.b", "x.g", "x.r", "variance.B", "variance.G", "variance.R"];
    let layers = file(ZIP16, Blocks::ScanLines, &layers);
    scanlines.into_iter().chain(tiled).chain([layers]).collect()
}

fn hdr_seeds() -> Vec<Vec<u8>> {
    let file = |size: &str, pixels: Vec<u8>| {
        let header = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1.5\n\n{size}\n");
        [header.as_bytes(), &pixels].concat()
    };
    let flat: Vec<u8> = (0..16 * 8).flat_map(|i| [i as u8, 200, 90, 128]).collect();
    // Runs and literals, plane by plane.
    let plane = [[128 + 10, 7].as_slice(), &[6, 1, 2, 3, 4, 5, 6]].concat();
    let line = [[2, 2, 0, 16].as_slice(), &plane.repeat(4)].concat();
    let old = [[80u8, 90, 100, 128], [1, 1, 1, 15]].concat();
    vec![
        file("-Y 8 +X 16", flat),
        file("-Y 8 +X 16", line.repeat(8)),
        file("+X 8 -Y 16", line.repeat(8)),
        file("+Y 8 -X 16", old.repeat(8)),
    ]
}

fn lights_seeds() -> Vec<Vec<u8>> {
    let light = |k: usize| SrbfLight {
        direction: DVec3::new(k as f64, 1.0, -0.5).normalize(),
        lambda: 0.1 + k as f64,
        rgb: [1.0, 0.5 * k as f64, 0.1],
    };
    vec![to_json(&[light(0)]).into_bytes(), to_json(&[0, 1, 2, 3].map(light)).into_bytes()]
}

fn groom() -> Hair {
    let strand = |k: usize| (0..5).map(move |i| Vec3::new(k as f32, 0.1 * i as f32, 0.0));
    let points: Vec<Vec3> = (0..6).flat_map(strand).collect();
    Hair {
        offsets: (0..=6).map(|k| 5 * k).collect(),
        thickness: Some(vec![0.01; points.len()]),
        color: Some(vec![[0.4, 0.3, 0.2]; points.len()]),
        points,
        ..Hair::default()
    }
}

fn hair_seeds() -> Vec<Vec<u8>> {
    let file = |hair| HairFile { hair, header: Header::default(), trailing_bytes: 0 };
    let bare = Hair { thickness: None, color: None, ..groom() };
    [groom(), bare].map(|hair| file(hair).to_bytes().unwrap()).to_vec()
}

fn tfx_seeds() -> Vec<Vec<u8>> {
    let mut bytes = 4f32.to_le_bytes().to_vec();
    bytes.extend([2u32, 3, 160, 0, 0, 256, 264].iter().flat_map(|word| word.to_le_bytes()));
    bytes.resize(160, 0);
    let numbers = (0..6 * 4 + 2 + 6 * 4).map(|i| 0.1 * i as f32);
    bytes.extend(numbers.flat_map(f32::to_le_bytes));
    vec![bytes]
}

fn obj_seeds() -> Vec<Vec<u8>> {
    let corners =
        "v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n";
    let faces = "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
    let with_normals = "vn 0 0 1\nvt 0 0\nf 1/1/1 2/1/1 3/1/1\nf -1//-1 -2//-1 -3//-1\n";
    vec![[corners, faces].concat().into(), [corners, with_normals, faces].concat().into()]
}

fn toml_seeds() -> Vec<Vec<u8>> {
    let changed = "[fibre]\npreset = \"red\"\n\n[camera]\nposition = [1, 2.5, 3e1]\n";
    vec![Scene::default().to_toml().into_bytes(), changed.as_bytes().to_vec()]
}

/// What a message quotes of a file may hold anything.
#[test]
fn what_is_quoted_of_a_file_stays_on_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let [scene, lights] = ["scene.toml", "lights.json"].map(|name| folder.path().join(name));
    let line = |result: Result<()>, path: &Path| {
        let again = |_: &Path| match &result {
            Ok(()) => Ok(()),
            Err(error) => Err(anyhow::anyhow!("{error:#}")),
        };
        let fault = fault(&again, path);
        assert!(result.is_err() && fault.is_none(), "{fault:?}");
    };
    for text in
        ["[\"a\\nb\"]\nx = 1\n", "[fibre]\n\"e\\u001bta\" = 1\n", "[fibre]\npreset = \"re\\nd\"\n"]
    {
        std::fs::write(&scene, text).unwrap();
        line(Scene::read(&scene).map(|_| ()), &scene);
    }
    for text in ["{\"a\\nb\":[]}", "{\"a\u{7f}b\":[]}"] {
        std::fs::write(&lights, text).unwrap();
        line(environment::load(self::text(&lights)).map(|_| ()), &lights);
    }
}

fn paint_seeds(groom: &Hair) -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("seed.paint");
    let mut paint = Paint::of_colors(groom).unwrap();
    paint.layer_mut(Channel::Roughness).set(3, [9.0, 0.0, 0.0], 0.5);
    paint.write(&path, groom).unwrap();
    vec![std::fs::read(path).unwrap()]
}

// Mutations.

/// SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Below `count`, which counts as 1 at least.
    fn below(&mut self, count: usize) -> usize {
        (self.next() % count.max(1) as u64) as usize
    }

    fn of<'a, T: ?Sized>(&mut self, choices: &[&'a T]) -> &'a T {
        choices[self.below(choices.len())]
    }

    /// A span of the bytes, rather short than long.
    fn span(&mut self, bytes: usize) -> std::ops::Range<usize> {
        let start = self.below(bytes);
        let most = [1, 8, 64, bytes][self.below(4)];
        start..(start + 1 + self.below(most)).min(bytes)
    }
}

/// One to four changes of a seed.
fn mutated(seeds: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let seed = random.below(seeds.len());
    let mut bytes = seeds[seed].clone();
    for _ in 0..1 + random.below(4) {
        let span = random.span(bytes.len());
        match random.below(9) {
            0 if !bytes.is_empty() => bytes[span.start] ^= 1 << random.below(8),
            1 => bytes.truncate(span.start),
            2 => _ = bytes.drain(span),
            3 => {
                let block = bytes[span.clone()].to_vec();
                bytes.splice(span.start..span.start, block);
            }
            4 => bytes[span].iter_mut().for_each(|byte| *byte = random.next() as u8),
            5 => {
                let many = 1 + random.below(16);
                let inserted = (0..many).map(|_| random.next() as u8).collect::<Vec<_>>();
                bytes.splice(span.start..span.start, inserted);
            }
            6 => {
                let extremes: [&[u8]; 12] = [
                    &[0; 4],
                    &[0xff; 4],
                    &[0xff, 0xff, 0xff, 0x7f],
                    &[0, 0, 0, 0x80],
                    &[0, 0, 0, 0x40],
                    &[0, 0, 0xc0, 0x7f],
                    &[0, 0, 0x80, 0x7f],
                    &[0, 0, 0x80, 0xff],
                    &[1, 0, 0, 0],
                    &[0xff; 8],
                    &[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f],
                    &[0xff; 2],
                ];
                let value = random.of(&extremes);
                let end = (span.start + value.len()).min(bytes.len());
                bytes[span.start..end].copy_from_slice(&value[..end - span.start]);
            }
            7 => {
                let other = &seeds[random.below(seeds.len())];
                bytes.truncate(span.start);
                bytes.extend(&other[random.below(other.len())..]);
            }
            _ => replace_number(&mut bytes, span.start, random),
        }
    }
    bytes
}

/// Puts another text in the place of the first number from `start` on.
fn replace_number(bytes: &mut Vec<u8>, start: usize, random: &mut Random) {
    let numeric = |byte: &u8| byte.is_ascii_digit() || b"+-.".contains(byte);
    let Some(first) = bytes[start..].iter().position(numeric).map(|at| start + at) else { return };
    let length = bytes[first..].iter().take_while(|byte| numeric(byte)).count();
    let texts = [
        "0",
        "-1",
        "1e999",
        "-1e999",
        "nan",
        "inf",
        "4294967296",
        "99999999999999999999",
        "",
        "1e-999",
        "\"",
        "{",
        "]",
        "\u{feff}",
        "[[[[[[[[",
        "1 1 1 1",
        "\r",
        "\\",
    ];
    bytes.splice(first..first + length, random.of(&texts).bytes());
}

/// What is wrong with how a reader took a file; None where all is well.
fn fault(read: &dyn Fn(&Path) -> Result<()>, path: &Path) -> Option<String> {
    match catch_unwind(AssertUnwindSafe(|| read(path))) {
        Err(panic) => {
            let text = panic.downcast_ref::<String>().cloned();
            let text = text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
            Some(format!("a panic: {}", text.unwrap_or_default()))
        }
        Ok(Ok(())) => None,
        Ok(Err(error)) => {
            let line = format!("{error:#}");
            if line.chars().any(|c| c.is_control()) {
                Some(format!("no single line: {line:?}"))
            } else {
                (!line.contains(text(path))).then(|| format!("does not name the file: {line}"))
            }
        }
    }
}

/// Gives a reader `count` mutated files, the same each time; the faults, and how many files were refused.
fn faults_of(format: Format, count: usize, folder: &Path) -> Vec<String> {
    let Format { extension, seeds, read } = format;
    let path_of = {
        let folder = folder.to_owned();
        move |i: usize| -> PathBuf { folder.join(format!("mutated_{i}.{extension}")) }
    };
    let (tell, told) = channel();
    let paths = path_of.clone();
    let worker = std::thread::spawn(move || {
        for (k, seed) in seeds.iter().enumerate() {
            let path = paths(k);
            std::fs::write(&path, seed).unwrap();
            read(&path).unwrap_or_else(|error| panic!("seed {k} is not sound: {error:#}"));
            std::fs::remove_file(path).unwrap();
        }
        let mut random = Random(extension.bytes().map(u64::from).sum());
        for i in 0..count {
            let path = paths(i);
            std::fs::write(&path, mutated(&seeds, &mut random)).unwrap();
            let fault = fault(&*read, &path);
            if fault.is_none() {
                std::fs::remove_file(&path).unwrap();
            }
            if tell.send(fault).is_err() {
                return;
            }
        }
    });
    let mut faults = Vec::new();
    for i in 0..count {
        // The first waits for the seeds too.
        match told.recv_timeout(LIMIT) {
            Ok(None) => {}
            Ok(Some(fault)) => faults.push(format!("{}: {fault}", path_of(i).display())),
            Err(RecvTimeoutError::Timeout) => {
                faults.push(format!("{}: not over after {LIMIT:?}", path_of(i).display()));
                return faults;
            }
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    if let Err(panic) = worker.join() {
        std::panic::resume_unwind(panic);
    }
    faults
}

fn run(count: usize) {
    // Files with faults are kept, to be looked at.
    let folder = tempfile::tempdir().unwrap().keep();
    let mut all = Vec::new();
    for format in formats() {
        let (extension, begun) = (format.extension, std::time::Instant::now());
        let faults = faults_of(format, count, &folder);
        println!("{extension}: {count} files, {} faults, {:.1?}", faults.len(), begun.elapsed());
        all.extend(faults);
    }
    assert!(all.is_empty(), "{} faults:\n{}", all.len(), all.join("\n"));
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn broken_files_give_one_line_each() {
    let asked = std::env::var("HAIRLIGHT_MUTATIONS").ok().and_then(|count| count.parse().ok());
    run(asked.unwrap_or(FEW));
}

#[test]
#[ignore = "minutes"]
fn ten_thousand_broken_files_give_one_line_each() {
    run(MANY.div_ceil(formats().len()));
}

/// Negative control: readers that panic, hang, say two lines or name no file are found out.
#[test]
fn readers_at_fault_are_found_out() {
    let folder = tempfile::tempdir().unwrap();
    let seeds = || vec![b"sound".to_vec()];
    let is_sound = |path: &Path| std::fs::read(path).unwrap() == b"sound";
    let readers: [(&str, Read); 3] = [
        (
            "a panic: off the end",
            Box::new(move |path| {
                assert!(is_sound(path), "off the end");
                Ok(())
            }),
        ),
        (
            "no single line",
            Box::new(move |path| {
                anyhow::ensure!(is_sound(path), "{}: one\ntwo", path.display());
                Ok(())
            }),
        ),
        (
            "does not name the file",
            Box::new(move |path| {
                anyhow::ensure!(is_sound(path), "something is wrong");
                Ok(())
            }),
        ),
    ];
    for (expected, read) in readers {
        let faults =
            faults_of(Format { extension: "txt", seeds: seeds(), read }, 20, folder.path());
        assert!(!faults.is_empty() && faults.iter().all(|f| f.contains(expected)), "{faults:?}");
    }
    let kinds: Vec<Vec<u8>> = {
        let mut random = Random(1);
        (0..50).map(|_| mutated(&exr_seeds(), &mut random)).collect()
    };
    let different: std::collections::HashSet<_> = kinds.iter().collect();
    assert!(different.len() > 45, "mutations repeat: {}", different.len());
}
