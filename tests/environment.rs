//! The environment room: the lat-long mapping, the files it reads, mending, and the built-in maps.

use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use exr::prelude::{
    AnyChannel, AnyChannels, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes,
    WritableImage,
};
use glam::DVec3;
use hairlight::environment::{
    Environment, LightMeter, Loaded, direction_to_uv, load, load_layer, uv_to_direction,
};
use hairlight::measure::read::Picture;
use hairlight::srbf::{SrbfLight, fit, radiance, write_json};

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data")
}

fn load_path(path: &Path) -> anyhow::Result<Loaded> {
    load(path.to_str().expect("test paths are UTF-8"))
}

/// Writes one EXR layer of f32 channels, each made by a function of the pixel index.
fn write_exr(path: &Path, size: (usize, usize), channels: &[(&str, &dyn Fn(usize) -> f32)]) {
    let mut list: Vec<_> = channels
        .iter()
        .map(|(name, value)| {
            let samples = (0..size.0 * size.1).map(value).collect();
            AnyChannel::new(*name, FlatSamples::F32(samples))
        })
        .collect();
    list.sort_by(|a, b| a.name.cmp(&b.name));
    let layer = Layer::new(
        size,
        LayerAttributes::default(),
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(list.into()),
    );
    Image::from_layer(layer).write().to_file(path).unwrap();
}

fn close(a: f64, b: f64, relative: f64) -> bool {
    (a - b).abs() <= relative * b.abs()
}

#[test]
fn the_mapping_is_an_inverse_pair_that_looks_where_the_convention_says() {
    for (direction, uv) in
        [(DVec3::NEG_Z, [0.5, 0.5]), (DVec3::X, [0.75, 0.5]), (DVec3::NEG_X, [0.25, 0.5])]
    {
        let got = direction_to_uv(direction);
        assert!(
            (got[0] - uv[0]).abs() < 1e-15 && (got[1] - uv[1]).abs() < 1e-15,
            "{direction}: {got:?}"
        );
    }
    assert_eq!(direction_to_uv(DVec3::Y)[1], 0.0);
    assert_eq!(direction_to_uv(DVec3::NEG_Y)[1], 1.0);
    for i in 0..=200 {
        for j in 1..200 {
            let uv = [(f64::from(i) + 0.37) / 201.0, f64::from(j).powi(3) / 8e6];
            let direction = uv_to_direction(uv);
            let back = direction_to_uv(direction);
            assert!((direction.length() - 1.0).abs() < 1e-14);
            assert!(
                (back[0] - uv[0]).abs() < 1e-14 && (back[1] - uv[1]).abs() < 1e-14,
                "{uv:?} → {back:?}"
            );
            // Negative control: a mirrored map is not the inverse.
            let mirrored = direction_to_uv(DVec3::new(-direction.x, direction.y, direction.z));
            assert!((mirrored[0] - uv[0]).abs() > 1e-4);
        }
    }
}

#[test]
fn solid_angles_sum_to_the_sphere_at_every_size() {
    for (width, height) in [(1, 1), (2, 1), (255, 127), (64, 128), (4096, 1), (1024, 512)] {
        let map = Environment::new(width, height, vec![[0.25, 0.5, 1.0]; width * height]);
        let sum: f64 = (0..height).map(|row| map.solid_angle(row) * width as f64).sum();
        assert!(close(sum, 4.0 * PI, 1e-12), "{width} × {height}: {sum}");
        let mean = map.mean_radiance();
        assert!(close(mean[0], 0.25, 1e-12) && close(mean[2], 1.0, 1e-12));
    }
}

#[test]
fn radiance_is_bilinear_wraps_around_and_holds_at_the_poles() {
    let (width, height) = (8, 4);
    let pixels =
        (0..width * height).map(|i| [(i % width) as f32, (i / width) as f32, 1.0]).collect();
    let map = Environment::new(width, height, pixels);
    for (column, row) in [(0, 0), (3, 2), (7, 3)] {
        let got = map.radiance(map.pixel_direction(column, row));
        assert!(
            (got[0] - column as f64).abs() < 1e-12 && (got[1] - row as f64).abs() < 1e-12,
            "{got:?}"
        );
    }
    // Between the last column and the first, and midway between two rows.
    let seam = map.radiance(uv_to_direction([0.0, 0.5]));
    assert!((seam[0] - 3.5).abs() < 1e-9 && (seam[1] - 1.5).abs() < 1e-9, "{seam:?}");
    assert!((map.radiance(DVec3::Y)[1]).abs() < 1e-12);
    assert!((map.radiance(DVec3::NEG_Y)[1] - 3.0).abs() < 1e-12);
}

#[test]
fn the_hash_tells_content_and_shape_apart() {
    let map = load("builtin:studio").unwrap().environment;
    let mut nudged = map.clone();
    nudged.pixels[77][1] += 1e-3;
    let turned = Environment::new(map.height, map.width, map.pixels.clone());
    assert_eq!(map.content_hash(), load("builtin:studio").unwrap().environment.content_hash());
    assert_ne!(map.content_hash(), nudged.content_hash());
    assert_ne!(map.content_hash(), turned.content_hash());
}

#[test]
fn mending_follows_its_rule_and_counts() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broken.exr");
    let (width, height) = (8, 4);
    let index = |column: usize, row: usize| row * width + column;
    let red = |i: usize| match i {
        i if i == index(0, 1) => f32::NAN,
        i if i == index(4, 2) => f32::INFINITY,
        i if i == index(5, 2) => 3.4e38,
        i if i == index(6, 2) => f32::NEG_INFINITY,
        i if i == index(2, 3) => -3890.0,
        i if i == index(3, 0) => 50.0,
        i if i % width == 7 => 4.0,
        _ => 2.0,
    };
    write_exr(&path, (width, height), &[("R", &red), ("G", &|_| 1.0), ("B", &|_| 0.0)]);
    let Loaded { environment, mended, .. } = load_path(&path).unwrap();
    assert_eq!((mended.nan, mended.inf, mended.negative), (1, 3, 1));
    let red_at = |column, row| environment.pixels[index(column, row)][0];
    // The mean of five 2s and, around the seam, three 4s, by the solid angle of rows 0, 1 and 2.
    let (outer, inner) = (environment.solid_angle(0), environment.solid_angle(1));
    let mean = (outer * (2.0 + 2.0 + 4.0) + inner * (2.0 + 4.0) + inner * (2.0 + 2.0 + 4.0))
        / (3.0 * outer + 5.0 * inner);
    assert!(close(f64::from(red_at(0, 1)), mean, 1e-6), "{} {mean}", red_at(0, 1));
    assert_eq!([red_at(4, 2), red_at(5, 2), red_at(6, 2), red_at(2, 3)], [50.0, 50.0, 0.0, 0.0]);
    assert_eq!(environment.pixels[index(0, 1)][1..], [1.0, 0.0]);
    assert_eq!(mended.mean_after, environment.mean_radiance());
    // The −3890 stands in the mean before and is gone from the one after; untouched channels keep
    // theirs.
    let weight = environment.solid_angle(3) / (4.0 * PI);
    assert!(mended.mean_before[0] < 0.9 * -3890.0 * weight && mended.mean_after[0] > 2.0);
    assert!(close(mended.mean_before[1], mended.mean_after[1], 1e-12));

    // Negative control: a sound map is left bit for bit.
    write_exr(&path, (width, height), &[("R", &|i| i as f32), ("G", &|_| 1e9), ("B", &|_| 0.0)]);
    let sound = load_path(&path).unwrap();
    assert!(!sound.mended.any());
    assert!(
        sound.environment.pixels.iter().enumerate().all(|(i, rgb)| *rgb == [i as f32, 1e9, 0.0])
    );

    write_exr(&path, (width, height), &[("R", &|_| f32::NAN), ("G", &|_| 1.0), ("B", &|_| 1.0)]);
    expect_line(load_path(&path), &path, "every red value is NaN");
    write_exr(&path, (width, height), &[("R", &|_| -0.01), ("G", &|_| 0.0), ("B", &|_| 0.0)]);
    assert!(load_path(&path).unwrap().environment.pixels.iter().all(|rgb| *rgb == [0.0; 3]));
}

/// The result must be an error of one line that starts with the path and contains `reason`.
fn expect_line(result: anyhow::Result<Loaded>, path: &Path, reason: &str) {
    let error = result.map(|_| ()).expect_err("should not load");
    let line = format!("{error:#}");
    assert!(line.starts_with(path.to_str().unwrap()) && !line.contains('\n'), "{line}");
    assert!(line.contains(reason), "{line} lacks '{reason}'");
}

#[test]
fn the_finished_colour_is_chosen_among_channels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("layers.exr");
    let one: &dyn Fn(usize) -> f32 = &|_| 1.0;
    let two: &dyn Fn(usize) -> f32 = &|_| 2.0;
    type Case<'a> = (&'a [(&'a str, &'a dyn Fn(usize) -> f32)], Option<&'a str>);
    let cases: [Case; 7] = [
        (&[("R", two), ("G", two), ("B", two), ("A", one), ("Z", one)], Some("")),
        (
            &[
                ("albedo.R", one),
                ("albedo.G", one),
                ("albedo.B", one),
                ("R", two),
                ("G", two),
                ("B", two),
            ],
            Some(""),
        ),
        (
            &[
                ("View.Albedo.R", one),
                ("View.Albedo.G", one),
                ("View.Albedo.B", one),
                ("View.Combined.R", two),
                ("View.Combined.G", two),
                ("View.Combined.B", two),
            ],
            Some("View.Combined"),
        ),
        (&[("Y", two), ("Z", one)], Some("")),
        (&[("normal.X", one), ("normal.Y", one), ("normal.Z", one), ("R", two)], Some("")),
        (&[("X", one), ("Y", one), ("Z", one)], None),
        (&[("R", one), ("G", one)], None),
    ];
    for (channels, layer) in cases {
        write_exr(&path, (4, 2), channels);
        match layer {
            Some(layer) => {
                let loaded = load_path(&path).unwrap();
                assert_eq!(loaded.source.layer, layer);
                assert!(loaded.environment.pixels.iter().all(|rgb| *rgb == [2.0; 3]), "{layer}");
            }
            None => expect_line(load_path(&path), &path, "no colour"),
        }
    }
}

/// Layers that stand beside each other: which is taken, by a map and by `compare` alike, and how another is chosen.
#[test]
fn of_several_layers_the_finished_picture_is_taken_or_the_named_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("layers.exr");
    let write = |names: &[&str]| {
        // Channels of a layer have its place for a value.
        let values: Vec<Box<dyn Fn(usize) -> f32>> =
            (0..names.len()).map(|k| Box::new(move |_| k as f32) as Box<_>).collect();
        let channels: Vec<(String, &dyn Fn(usize) -> f32)> = names
            .iter()
            .zip(&values)
            .flat_map(|(name, value)| {
                let spelled = match name.split_once(':') {
                    Some((prefix, letters)) => {
                        letters.split(',').map(|l| format!("{prefix}{l}")).collect::<Vec<_>>()
                    }
                    None => ["R", "G", "B"].map(|l| format!("{name}{l}")).to_vec(),
                };
                spelled.into_iter().map(move |name| (name, &**value))
            })
            .collect();
        let channels: Vec<(&str, &dyn Fn(usize) -> f32)> =
            channels.iter().map(|(name, value)| (name.as_str(), *value)).collect();
        write_exr(&path, (4, 2), &channels);
    };
    let taken = |layer: Option<&str>| {
        let source = path.to_str().unwrap();
        let map = load_layer(source, layer).map(|loaded| loaded.environment.pixels[0]);
        let picture = Picture::read_layer(&path, layer, "--frame-layer").map(|p| p.rgb[0]);
        match (map, picture) {
            (Ok(map), Ok(picture)) => {
                assert_eq!(map, picture);
                Ok(map[0])
            }
            (Err(map), Err(picture)) => {
                for error in [&map, &picture] {
                    let line = format!("{error:#}");
                    assert!(line.starts_with(source) && !line.contains('\n'), "{line}");
                }
                assert!(!format!("{picture:#}").contains("environment.layer"), "{picture:#}");
                Err(format!("{map:#}"))
            }
            (map, picture) => panic!("a map {map:?}, a picture {picture:?}"),
        }
    };
    // What is written, and which of it is taken.
    let cases: [(&[&str], f32); 10] = [
        (&["Albedo.", ""], 1.0),
        (&["AOV.", "Main.Combined."], 1.0),
        (&["DiffCol.", "composite."], 1.0),
        (&["beauty.", "a.Combined.", "composite."], 1.0),
        (&["albedo.", "view.RGBA."], 1.0),
        (&["env."], 0.0),
        (&[":red,green,blue"], 0.0),
        (&["View.Combined.:Red,Green,Blue"], 0.0),
        (&["c.:r,g,b"], 0.0),
        (&["depth.:Y", "noisy."], 1.0),
    ];
    for (names, expected) in cases {
        write(names);
        assert_eq!(taken(None), Ok(expected), "{names:?}");
    }
    write(&["AOV.", "Main.DiffCol."]);
    let line = taken(None).unwrap_err();
    assert!(line.ends_with("AOV, Main.DiffCol") && line.contains("--env-layer"), "{line}");
    assert_eq!(taken(Some("aov")), Ok(0.0));
    assert_eq!(taken(Some("DiffCol")), Ok(1.0));
    let line = taken(Some("Beauty")).unwrap_err();
    assert!(line.contains("no layer Beauty") && line.ends_with("AOV, Main.DiffCol"), "{line}");
    // A name that only ends alike is no layer's.
    assert!(taken(Some("Col")).is_err());
    // Files without layers have none of that name.
    let line = format!("{:#}", load_layer("builtin:studio", Some("AOV")).unwrap_err());
    assert!(line.contains("has no layers"), "{line}");
}

/// The decoder would ask for 2⁴⁶ bytes, which no handler survives.
#[test]
fn a_dwa_block_that_claims_the_moon_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("claim.exr");
    let samples = FlatSamples::F32((0..64 * 32).map(|i| i as f32).collect());
    let channels = ["B", "G", "R"].map(|name| AnyChannel::new(name, samples.clone()));
    let layer = Layer::new(
        (64, 32),
        LayerAttributes::default(),
        Encoding { compression: Compression::DWAB(None), ..Encoding::SMALL_LOSSLESS },
        AnyChannels::sort(channels.into_iter().collect()),
    );
    Image::from_layer(layer).write().to_file(&path).unwrap();
    assert!(load_path(&path).is_ok());

    let mut bytes = std::fs::read(&path).unwrap();
    // One block, so one offset, which points right behind itself.
    let table = (0..bytes.len() - 8)
        .find(|&at| bytes[at..at + 8] == (at as u64 + 8).to_le_bytes())
        .expect("an offset table of one entry");
    // The block: its y, its length, then eleven counters of which the tenth is the number of DC
    // values.
    let dc_count = table + 8 + 8 + 9 * 8;
    bytes[dc_count..dc_count + 8].copy_from_slice(&(1u64 << 46).to_le_bytes());
    std::fs::write(&path, &bytes).unwrap();
    expect_line(load_path(&path), &path, "claims more than it can hold");
}

#[test]
fn radiance_files_are_read_and_bad_ones_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tiny.hdr");
    let pixels = [[128u8, 64, 32, 129], [128, 128, 128, 136]].concat();
    for signature in ["#?RADIANCE", "#?RGBE"] {
        let header = format!("{signature}\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2.0\n\n-Y 1 +X 2\n");
        let whole = [header.as_bytes(), &pixels].concat();
        std::fs::write(&path, &whole).unwrap();
        let loaded = load_path(&path).unwrap();
        assert_eq!(loaded.environment.pixels, [[1.0, 0.5, 0.25], [128.0; 3]]);
        assert_eq!(loaded.source.format, "Radiance");
        assert!(loaded.source.notes.iter().any(|note| note.contains("EXPOSURE")));
        std::fs::write(&path, &whole[..whole.len() - 1]).unwrap();
        expect_line(load_path(&path), &path, "cut short");
    }
    let refuse = |text: &str, reason| {
        std::fs::write(&path, text).unwrap();
        expect_line(load_path(&path), &path, reason);
    };
    refuse("#?RADIANCE\n\n-Y 60000 +X 120000\n", "up to 16384 × 8192");
    refuse("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 2\n", "XYZ");
    refuse("P6 2 1", "is not a lat-long map but text of no kind that Hairlight knows: convert it");
    refuse("", "is empty");
    expect_line(load_path(folder.path()), folder.path(), "cannot be read");
    expect_line(load("builtin:sunrise"), Path::new("builtin:sunrise"), "builtin:sunset");
}

/// The same picture stored from each corner, by rows and by columns, in all three packings, with either line end.
#[test]
fn radiance_files_are_read_from_every_orientation() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("turned.hdr");
    let (width, height) = (12, 9);
    // Every pixel another; equal neighbours make runs.
    let pixel = |x: usize, y: usize| [100 + (x / 2 * 2) as u8, 120 + y as u8, 90, 129u8];
    let expected: Vec<[f32; 3]> = (0..width * height)
        .map(|i| pixel(i % width, i / width))
        .map(|[r, g, b, _]| [r, g, b].map(|v| f32::from(v) / 128.0))
        .collect();
    let planes = |line: &[[u8; 4]]| -> Vec<u8> {
        let mut bytes = vec![2, 2, 0, line.len() as u8];
        for channel in 0..4 {
            for pair in line.chunks(2) {
                match *pair {
                    [a, b] if a[channel] == b[channel] => bytes.extend([130, a[channel]]),
                    _ => {
                        bytes.push(pair.len() as u8);
                        bytes.extend(pair.iter().map(|p| p[channel]));
                    }
                }
            }
        }
        bytes
    };
    let runs = |line: &[[u8; 4]]| -> Vec<u8> {
        let pair = |pair: &[[u8; 4]]| match *pair {
            [a, b] if a == b => [a, [1, 1, 1, 1]].concat(),
            _ => pair.concat(),
        };
        line.chunks(2).flat_map(pair).collect()
    };
    let flat = |line: &[[u8; 4]]| -> Vec<u8> { line.concat() };
    type Pack<'a> = &'a dyn Fn(&[[u8; 4]]) -> Vec<u8>;
    let packings: [Pack; 3] = [&planes, &runs, &flat];
    let mut seen = 0;
    for (sign_y, sign_x) in [("-", "+"), ("-", "-"), ("+", "+"), ("+", "-")] {
        let y_of = |i: usize| if sign_y == "-" { i } else { height - 1 - i };
        let x_of = |i: usize| if sign_x == "+" { i } else { width - 1 - i };
        for by_rows in [true, false] {
            let lines: Vec<Vec<[u8; 4]>> = match by_rows {
                true => (0..height)
                    .map(|j| (0..width).map(|i| pixel(x_of(i), y_of(j))).collect())
                    .collect(),
                false => (0..width)
                    .map(|i| (0..height).map(|j| pixel(x_of(i), y_of(j))).collect())
                    .collect(),
            };
            let (y, x) = (format!("{sign_y}Y {height}"), format!("{sign_x}X {width}"));
            let size = if by_rows { format!("{y} {x}") } else { format!("{x} {y}") };
            for (packing, end) in packings.iter().zip(["\n", "\r\n", "\n"]) {
                let header = ["#?RADIANCE", "FORMAT=32-bit_rle_rgbe", "", &size, ""].join(end);
                let pixels: Vec<u8> = lines.iter().flat_map(|line| packing(line)).collect();
                std::fs::write(&path, [header.as_bytes(), &pixels].concat()).unwrap();
                let map = load_path(&path).unwrap_or_else(|e| panic!("{size}: {e:#}")).environment;
                assert_eq!((map.width, map.height), (width, height), "{size}");
                assert!(map.pixels == expected, "{size}");
                seen += 1;
                // Negative control: what lacks a byte is not taken.
                std::fs::write(&path, [header.as_bytes(), &pixels[1..]].concat()).unwrap();
                let spoiled = load_path(&path).map(|loaded| loaded.environment.pixels);
                assert!(spoiled.is_err() || spoiled.unwrap() != expected, "{size}");
            }
        }
    }
    assert_eq!(seen, 24);
    // Lines shorter than 8 pixels are never in planes, whatever they begin with.
    let header = "#?RADIANCE\n\n-Y 1 +X 2\n";
    std::fs::write(&path, [header.as_bytes(), &[2, 2, 0, 136, 8, 8, 8, 136]].concat()).unwrap();
    let map = load_path(&path).unwrap().environment;
    assert_eq!(map.pixels, [[2.0, 2.0, 0.0], [8.0; 3]]);
    for size in ["-Y 2 -Y 3", "Y 2 X 3", "-Y two +X 3", "-Y 2", ""] {
        std::fs::write(&path, format!("#?RADIANCE\n\n{size}\n")).unwrap();
        expect_line(load_path(&path), &path, "where its size should");
    }
}

/// Lights as `fit` writes them are a map too: their sum, which stands for them as they are.
#[test]
fn a_list_of_lights_is_a_map() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lights.json");
    let light = |x: f64, lambda: f64, rgb| SrbfLight {
        direction: DVec3::new(x, 0.4, -0.6).normalize(),
        lambda,
        rgb,
    };
    // The narrowest is far below a pixel.
    let lights = [light(1.0, 0.5, [1.0, 2.0, 3.0]), light(-1.0, 0.001, [4e4, 3e4, 2e4])];
    write_json(&lights, &path).unwrap();
    let Loaded { environment: map, mended, source } = load_path(&path).unwrap();
    assert!(!mended.any() && source.to_string().starts_with("lights, 2 lights"), "{source}");
    let away = DVec3::new(0.3, -0.2, 0.9).normalize();
    for (seen, sum) in map.radiance(away).iter().zip(radiance(&lights, away)) {
        assert!(close(*seen, sum, 1e-3), "{seen} {sum}");
    }
    let energy = |c: usize| lights.iter().map(|light| light.energy()[c]).sum::<f64>();
    for (c, mean) in map.mean_radiance().iter().enumerate() {
        assert!(close(mean * 4.0 * PI, energy(c), 1e-3), "{mean} {}", energy(c));
    }
    // However many are asked for.
    let fitted = fit(&map, 40, &|_| true).unwrap();
    assert_eq!(fitted.lights, lights);
    assert!(fitted.relative_l2_blurred_0_30 < 1e-3, "{}", fitted.relative_l2_blurred_0_30);
    // Negative control: the same pixels from elsewhere are fitted.
    let plain = Environment::new(map.width, map.height, map.pixels.clone());
    assert_ne!(fit(&plain, 2, &|_| true).unwrap().lights, lights);

    for (text, reason) in [
        ("{\"lights\":[]}", "0 lights"),
        ("\u{feff} {\"light\":[]}", "is no list of lights"),
        ("{\"a\\nb\":[]}", "is no list of lights"),
        ("[1]", "is not a lat-long map but"),
    ] {
        std::fs::write(&path, text).unwrap();
        expect_line(load_path(&path), &path, reason);
    }
}

#[test]
fn a_black_map_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.exr");
    let zero: &dyn Fn(usize) -> f32 = &|_| 0.0;
    let faint: &dyn Fn(usize) -> f32 = &|i| if i == 3 { 1e-30 } else { 0.0 };
    let black = |green| {
        write_exr(&path, (4, 2), &[("R", zero), ("G", green), ("B", zero)]);
        load_path(&path).unwrap().notes().iter().any(|note| note.contains("black"))
    };
    assert!(black(zero) && !black(faint));
}

/// A map in other units is that map: what is far above it is broken, not what is far above 1.
#[test]
fn maps_of_every_brightness_are_sound() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.exr");
    for level in [1e-30f32, 1.0, 1e20, 1e30] {
        let value = |i: usize| level * (1.0 + i as f32);
        write_exr(&path, (4, 2), &[("R", &value), ("G", &value), ("B", &value)]);
        let Loaded { environment, mended, .. } = load_path(&path).unwrap();
        assert!(!mended.any(), "{level:e}: {mended}");
        assert_eq!(environment.pixels[7], [8.0 * level; 3]);
    }
    let spark = |i: usize| if i == 5 { 1e30 } else { 1.0 };
    write_exr(&path, (4, 2), &[("R", &spark), ("G", &spark), ("B", &spark)]);
    assert_eq!(load_path(&path).unwrap().mended.inf, 3);
}

#[test]
fn builtin_maps_are_sound_and_as_bright_as_stated() {
    for (name, mean_luminance) in
        [("studio", 1.0), ("sunset", 0.8), ("overcast", 1.0), ("night", 0.15)]
    {
        let Loaded { environment, mended, .. } = load(&format!("builtin:{name}")).unwrap();
        assert!(!mended.any(), "{name}: {mended}");
        assert!(environment.pixels.as_flattened().iter().all(|&v| v > 0.0 && v.is_finite()));
        let [r, g, b] = environment.mean_radiance();
        assert!(close(0.2126 * r + 0.7152 * g + 0.0722 * b, mean_luminance, 1e-5), "{name}");
    }
}

#[test]
fn the_overcast_sky_is_the_cie_one() {
    let map = load("builtin:overcast").unwrap().environment;
    let green = |elevation: f64| {
        // The mean around the horizon: mottling averages out.
        (0..360)
            .map(|step| {
                map.radiance(uv_to_direction([f64::from(step) / 360.0, 0.5 - elevation / PI]))[1]
            })
            .sum::<f64>()
            / 360.0
    };
    let zenith = green(PI / 2.0);
    for degrees in [10.0, 30.0, 60.0] {
        let expected = (1.0 + 2.0 * f64::to_radians(degrees).sin()) / 3.0;
        let ratio = green(degrees.to_radians()) / zenith;
        // 5 % for the mottling, of which the zenith is one sample.
        assert!(close(ratio, expected, 0.05), "{degrees}°: {ratio} {expected}");
        assert!(!close(ratio, 1.0, 0.05) || degrees > 80.0);
    }
}

#[test]
fn the_suns_energy_is_in_its_disc() {
    let map = load("builtin:sunset").unwrap().environment;
    let brightest = (0..map.pixels.len())
        .max_by(|&a, &b| map.pixels[a][0].total_cmp(&map.pixels[b][0]))
        .unwrap();
    let sun = map.pixel_direction(brightest % map.width, brightest / map.width);
    let irradiance = |degrees: f64| {
        let mut sum = 0.0;
        for (index, rgb) in map.pixels.iter().enumerate() {
            let direction = map.pixel_direction(index % map.width, index / map.width);
            if direction.dot(sun) > degrees.to_radians().cos() {
                sum += f64::from(rgb[0]) * map.solid_angle(index / map.width);
            }
        }
        sum
    };
    // A pixel is 0.7°: all of the disc lies within 1.4° of the brightest one, and a ring beyond
    // adds little.
    let total = map.mean_radiance()[0] * 4.0 * PI;
    let share = irradiance(1.4) / total;
    assert!((0.4..0.7).contains(&share), "{share}");
    assert!(irradiance(2.8) < 1.03 * irradiance(1.4));
}

#[test]
#[ignore = "needs ../shared/data"]
fn every_odd_exr_gives_a_map_or_one_clear_line() {
    /// What a file must give: a map of this size, or a line with these words.
    #[derive(Clone, Copy)]
    enum Expect {
        Map(usize, usize),
        Line(&'static str),
    }
    use Expect::{Line, Map};
    let normal = Map(256, 128);
    let exceptions = [
        ("all_black", Map(128, 64)),
        ("all_nan", Line("nothing to light with")),
        ("bitflip_01", Line("damaged")),
        ("bitflip_02", Line("damaged")),
        ("bitflip_03", Line("damaged")),
        ("bitflip_04", Line("damaged")),
        ("bitflip_05", Line("damaged")),
        ("bitflip_06", Line("damaged")),
        ("bitflip_07", Line("damaged")),
        ("bitflip_08", Line("damaged")),
        ("bitflip_09", Line("damaged")),
        ("bitflip_10", Line("is not a lat-long map but of no kind that Hairlight knows")),
        ("bitflip_11", Line("damaged")),
        ("claimed_64k_x_32k", Line("65536 × 32768")),
        ("display_window_crop", Map(128, 64)),
        ("empty", Line("is empty")),
        ("huge_claimed_dims", Line("damaged")),
        ("inverted_window", Line("damaged")),
        ("magic_only", Line("cut short")),
        ("max_float", Line("nothing to light with")),
        ("not_exr_png", Line("is not a lat-long map but a PNG picture")),
        ("odd_255x127", Map(255, 127)),
        ("one_hot_pixel_1e9", Map(512, 256)),
        ("portrait_64x128", Map(64, 128)),
        ("square_128", Map(128, 128)),
        ("strip_4096x1", Map(4096, 1)),
        ("text", Line("is not a lat-long map but text of no kind")),
        ("tiny_1x1", Map(1, 1)),
        ("tiny_2x1", Map(2, 1)),
        ("trunc_half", Line("cut short")),
        ("trunc_header", Line("cut short")),
        ("trunc_last_byte", Line("cut short")),
        ("trunc_offsets", Line("cut short")),
    ];
    let mut files: Vec<_> =
        data().join("exr-odd").read_dir().unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(files.len() > exceptions.len());
    for path in files {
        let stem = path.file_stem().unwrap().to_str().unwrap();
        let expected =
            exceptions.iter().find(|(name, _)| *name == stem).map_or(normal, |(_, e)| *e);
        match expected {
            Map(width, height) => {
                let map = load_path(&path).unwrap().environment;
                assert_eq!((map.width, map.height), (width, height), "{stem}");
                assert!(
                    map.pixels.as_flattened().iter().all(|v| v.is_finite() && *v >= 0.0),
                    "{stem}"
                );
            }
            Line(reason) => expect_line(load_path(&path), &path, reason),
        }
    }
}

/// The same picture was written in every codec and type: each must come out close to the plain f32
/// one.
#[test]
#[ignore = "needs ../shared/data"]
fn every_codec_gives_the_same_picture() {
    let read =
        |stem: &str| load_path(&data().join(format!("exr-odd/{stem}.exr"))).unwrap().environment;
    let plain = read("comp_none_f32");
    let difference = |map: &Environment| {
        let squares = |rgb: [f32; 3], other: [f32; 3]| -> f64 {
            (0..3).map(|c| f64::from(rgb[c] - other[c]).powi(2)).sum()
        };
        let error: f64 = map.pixels.iter().zip(&plain.pixels).map(|(a, b)| squares(*a, *b)).sum();
        let norm: f64 = plain.pixels.iter().map(|a| squares(*a, [0.0; 3])).sum();
        (error / norm).sqrt()
    };
    // B44 keeps 6 bits of each block's range, DWA drops what the eye does not see; the rest only
    // rounds to f16.
    for (codec, bound) in [
        ("none", 5e-4),
        ("rle", 5e-4),
        ("zips", 5e-4),
        ("zip", 5e-4),
        ("piz", 5e-4),
        ("pxr24", 5e-4),
        ("b44", 0.05),
        ("b44a", 0.05),
        ("dwaa", 0.05),
        ("dwab", 0.05),
    ] {
        for sample_type in ["f16", "f32"] {
            let error = difference(&read(&format!("comp_{codec}_{sample_type}")));
            assert!(error <= bound, "{codec} {sample_type}: {error}");
        }
    }
    for stem in [
        "tiled_32",
        "extra_aovs",
        "layer_prefixed_only",
        "multipart_depth_first",
        "mixed_types_R16_G32_B16",
    ] {
        assert!(difference(&read(stem)) <= 5e-4, "{stem}");
    }
    // Negative control: one column out of place is far outside every bound.
    let mut shifted = plain.clone();
    shifted.pixels.rotate_right(1);
    assert!(difference(&shifted) > 0.05, "{}", difference(&shifted));

    // Windows: the crop lies where the display window puts it, black around it.
    let cropped = read("data_window_crop");
    for row in 0..128 {
        for column in 0..256 {
            let inside = (64..192).contains(&column) && (32..96).contains(&row);
            assert!(inside || cropped.pixels[row * 256 + column] == [0.0; 3]);
        }
    }
    assert!(cropped.pixels[64 * 256 + 128] != [0.0; 3]);
    let window = read("display_window_crop");
    let full = read("comp_zip_f16");
    assert_eq!(window.pixels[5 * 128 + 9], full.pixels[37 * 256 + 73]);
}

#[test]
#[ignore = "needs ../shared/data"]
fn every_real_map_loads_whole() {
    let files: Vec<_> = data().join("env").read_dir().unwrap().map(|e| e.unwrap().path()).collect();
    assert_eq!(files.len(), 16);
    for path in files {
        let Loaded { environment, mended, source } = load_path(&path).unwrap();
        assert_eq!((environment.width, environment.height), (1024, 512));
        assert!(source.notes.is_empty(), "{source}");
        for (before, after) in mended.mean_before.iter().zip(mended.mean_after) {
            // The files' small negatives are compression noise.
            assert!(close(after, *before, 1e-5), "{}: {mended}", path.display());
        }
    }
}

#[test]
fn the_meter_sees_a_sphere_as_the_camera_does() {
    let map = |light: &dyn Fn(DVec3) -> f32| {
        let (width, height) = (128, 64);
        let mut map = Environment { width, height, pixels: Vec::new(), lights: Vec::new() };
        let places = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        map.pixels = places.map(|(x, y)| [light(map.pixel_direction(x, y)); 3]).collect();
        map
    };
    let meter = |light: &dyn Fn(DVec3) -> f32| LightMeter::new(&map(light));
    let eyes = [DVec3::Z, DVec3::NEG_X, DVec3::Y, DVec3::new(0.6, 0.48, -0.64)];
    let even = meter(&|_| 3.0);
    for eye in eyes {
        assert!((even.luminance(eye) - 3.0).abs() < 0.01, "{eye}: {}", even.luminance(eye));
    }
    // By hand: under light of 1 from the half around z, a normal at an angle α from z sees (1 + cos α)/2.
    let half = meter(&|omega| if omega.z > 0.0 { 1.0 } else { 0.0 });
    let steps = 10_000u32;
    let logarithm = |k: usize| {
        let cosine = (1.0 - (k as f64 + 0.5) / f64::from(steps)).sqrt();
        (0.5 * (1.0 + cosine)).ln()
    };
    let by_hand = ((0..steps as usize).map(logarithm).sum::<f64>() / f64::from(steps)).exp();
    let by_hand = (by_hand * 0.5).sqrt();
    let front = half.luminance(DVec3::Z);
    assert!((front - by_hand).abs() < 0.01, "{front}, by hand {by_hand}");
    // From behind and from the side less is seen, and never so little that exposure has no bound.
    let (side, back) = (half.luminance(DVec3::X), half.luminance(DVec3::NEG_Z));
    assert!(front > 1.15 * side && side > 1.15 * back, "{front} {side} {back}");
    let lamp = map(&|omega| if omega.z > 0.99 { 1e4 } else { 0.0 });
    let behind = LightMeter::new(&lamp).luminance(DVec3::NEG_Z) / lamp.mean_radiance()[0];
    assert!((behind - 0.1f64.sqrt()).abs() < 0.02, "{behind}");
    assert_eq!(meter(&|_| 0.0).luminance(DVec3::Z), 0.0);
}
