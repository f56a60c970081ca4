//! The judge and the figures.

use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, Vec2,
    WritableImage,
};
use hairlight::measure::compare::{Weight, compare, difference_picture};
use hairlight::measure::figures;
use hairlight::measure::read::Picture;
use tempfile::tempdir;

/// A smooth picture with hair in its left half and something else in its right.
fn picture() -> Picture {
    let size = [32, 16];
    let at = |i: usize| ((i % size[0]) as f32, (i / size[0]) as f32);
    let count = size[0] * size[1];
    Picture {
        name: "truth.exr".to_owned(),
        size,
        rgb: (0..count)
            .map(|i| {
                let (x, y) = at(i);
                [0.3 + 0.02 * x, 0.2 + 0.01 * y, 0.1 + 0.004 * (x + y)]
            })
            .collect(),
        alpha: Some(vec![1.0; count]),
        hair: Some((0..count).map(|i| if at(i).0 < 16.0 { 0.5 } else { 0.0 }).collect()),
        variance: None,
    }
}

fn changed(change: impl Fn(usize, &mut [f32; 3])) -> Picture {
    let mut picture = picture();
    picture.name = "frame.exr".to_owned();
    picture.rgb.iter_mut().enumerate().for_each(|(i, pixel)| change(i, pixel));
    picture
}

fn error<T: std::fmt::Debug>(result: anyhow::Result<T>) -> String {
    let error = format!("{:#}", result.unwrap_err());
    println!("{error}");
    assert!(!error.contains('\n'), "{error}");
    error
}

/// Writes planes of 32 × 16 as an EXR layer whose data window starts at `corner`.
fn write_exr(path: &Path, corner: [i32; 2], planes: &[(&str, Vec<f32>)]) {
    let list = planes
        .iter()
        .map(|(name, values)| AnyChannel::new(*name, FlatSamples::F32(values.clone())))
        .collect();
    let mut layer = Layer::new(
        Vec2(32, 16),
        LayerAttributes::default(),
        Encoding::FAST_LOSSLESS,
        AnyChannels::sort(list),
    );
    layer.attributes.layer_position = Vec2(corner[0], corner[1]);
    let mut image = Image::from_layer(layer);
    image.attributes.display_window.position = Vec2(0, 0);
    image.write().to_file(path).unwrap();
}

fn plane(of: impl Fn(usize) -> f32) -> Vec<f32> {
    (0..32 * 16).map(of).collect()
}

// The judge.

#[test]
fn a_picture_is_no_error_from_itself() {
    let report = compare(&picture(), &picture()).unwrap();
    println!("{report}");
    for value in [report.relative_l2, report.relative_mse, report.max_abs, report.flip_p99] {
        assert_eq!(value, 0.0);
    }
    assert_eq!((report.flip_mean, report.mean_ratio), (0.0, [Some(1.0); 3]));
    assert_eq!((report.pixels, report.weight), (256, Weight::Hair));
    assert_eq!((report.coverage_difference, report.noise), (Some(0.0), None));
}

#[test]
fn a_known_scale_is_found() {
    let report = compare(&changed(|_, p| p[1] *= 1.25), &picture()).unwrap();
    // By hand: only green differs, by a quarter of itself.
    let squares = |channels: std::ops::Range<usize>| -> f64 {
        let hair = picture().rgb.into_iter().enumerate().filter(|(i, _)| i % 32 < 16);
        hair.flat_map(|(_, p)| p[channels.clone()].to_vec()).map(|v| f64::from(v).powi(2)).sum()
    };
    let expected = (0.0625 * squares(1..2) / squares(0..3)).sqrt();
    println!("{report}expected relative L2 {expected:.6}");
    assert!((report.relative_l2 - expected).abs() < 1e-6 * expected);
    let ratios = report.mean_ratio.map(Option::unwrap);
    assert!((ratios[1] - 1.25).abs() < 1e-6 && ratios[0] == 1.0 && ratios[2] == 1.0);
    assert!((report.max_abs - 0.25 * 0.35).abs() < 1e-6, "{}", report.max_abs);
    assert_eq!(report.max_abs_at[1], 15);
    assert!(report.flip_mean > 0.01 && report.flip_p99 >= report.flip_mean);
    assert!(report.relative_mse > 0.0 && report.relative_mse < 0.0625 / 3.0);

    // The exposure of both changes nothing but the greatest difference.
    let (mut a, mut b) = (changed(|_, p| p[1] *= 1.25), picture());
    a.rgb.iter_mut().chain(&mut b.rgb).for_each(|p| *p = p.map(|v| 64.0 * v));
    let bright = compare(&a, &b).unwrap();
    assert!((bright.relative_l2 / report.relative_l2 - 1.0).abs() < 1e-6);
    assert!((bright.relative_mse / report.relative_mse - 1.0).abs() < 1e-6);
    assert!((bright.flip_mean - report.flip_mean).abs() < 1e-3);
}

#[test]
fn only_hair_counts() {
    let beside = compare(&changed(|i, p| p[0] += (i % 32 / 16) as f32), &picture()).unwrap();
    assert_eq!((beside.relative_l2, beside.flip_mean, beside.max_abs), (0.0, 0.0, 0.0));
    // The same where there is hair must be seen; and it is where alpha alone is known.
    let within = compare(&changed(|i, p| p[0] += 1.0 - (i % 32 / 16) as f32), &picture()).unwrap();
    assert!(within.relative_l2 > 1.0 && within.flip_mean > 0.1, "{within}");
    let mut truth = picture();
    truth.hair = None;
    let alpha = compare(&changed(|i, p| p[0] += (i % 32 / 16) as f32), &truth).unwrap();
    assert_eq!((alpha.weight, alpha.pixels), (Weight::Alpha, 512));
    assert!(alpha.relative_l2 > 0.5, "{alpha}");
    truth.alpha = None;
    assert_eq!(compare(&picture(), &truth).unwrap().weight, Weight::Everything);
    // Half the hair in one of the two.
    let mut thin = picture();
    thin.hair.as_mut().unwrap().iter_mut().for_each(|h| *h *= 0.5);
    assert_eq!(compare(&thin, &picture()).unwrap().coverage_difference, Some(0.5));
}

/// Noise of known variance is told from a bias: uniform noise of ±√3 s has standard deviation s.
#[test]
fn noise_is_told_from_bias() {
    let sigma = 0.02;
    let mut state = 1u32;
    let mut uniform = move || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let noisy = |bias: f32, uniform: &mut dyn FnMut() -> f32| {
        let mut frame = picture();
        for value in frame.rgb.as_flattened_mut() {
            *value += bias + sigma * 12f32.sqrt() * (uniform() - 0.5);
        }
        frame
    };
    let mut truth = picture();
    truth.variance = Some(vec![[sigma * sigma; 3]; 512]);
    let pure = compare(&noisy(0.0, &mut uniform), &truth).unwrap();
    let biased = compare(&noisy(0.05, &mut uniform), &truth).unwrap();
    println!("{pure}{biased}");
    let [pure, biased] = [pure, biased].map(|r| r.noise.unwrap());
    // 768 values: the mean square is within 3.2 % of its expectation at one standard error (a uniform
    // number's fourth moment is 1.8), three of which are allowed.
    assert!((pure.share - 1.0).abs() < 0.1, "{}", pure.share);
    assert!(biased.share < 0.2, "{}", biased.share);
    let norm = biased.relative_l2 / f64::from(sigma);
    assert!((biased.relative_l2_without / (0.05 * norm) - 1.0).abs() < 0.1);
}

#[test]
fn what_cannot_be_compared_is_said() {
    let mut small = picture();
    small.size = [16, 32];
    let message = error(compare(&small, &picture()));
    assert!(message.contains("16 × 32") && message.contains("32 × 16"), "{message}");
    let message = error(compare(&changed(|i, p| p[1] /= (i != 35) as u8 as f32), &picture()));
    assert!(message.contains("frame.exr: G is inf at pixel (3, 1)"), "{message}");
    let mut truth = picture();
    truth.rgb[64][2] = f32::NAN;
    let message = error(difference_picture(&picture(), &truth));
    assert!(message.contains("truth.exr: B is NaN at pixel (0, 2)"), "{message}");
    assert!(error(compare(&picture(), &changed(|_, p| *p = [0.0; 3]))).contains("black"));
    let mut bald = picture();
    bald.hair = Some(vec![0.0; 512]);
    assert!(error(compare(&picture(), &bald)).contains("no pixel has any hair"));
}

#[test]
fn the_difference_picture_shows_where_and_which_way() {
    let frame = changed(|i, p| {
        *p = p.map(|v| match i % 32 {
            0..5 => 2.0 * v,
            11..16 => 0.0,
            _ => v,
        })
    });
    let shown = difference_picture(&frame, &picture()).unwrap();
    assert_eq!(shown.dimensions(), (4 * 36 - 4, 16));
    let signed = |x: u32| shown.get_pixel(72 + x, 8).0;
    assert!(signed(2)[0] > signed(2)[2] && signed(13)[2] > signed(13)[0]);
    assert_eq!((signed(8), signed(20)), ([0; 3], [0; 3]));
    let flip = |x: u32| shown.get_pixel(108 + x, 8).0.iter().map(|&v| u32::from(v)).sum::<u32>();
    assert!(flip(13) > 200 && flip(24) < 20, "{} {}", flip(13), flip(24));
}

#[test]
fn exr_files_are_read_by_channel_name() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("frame.exr");
    let ours = ["A", "B", "G", "R", "hair", "variance.B", "variance.G", "variance.R"];
    let plane_of = |k: usize| plane(move |i| k as f32 + 0.001 * i as f32);
    let planes: Vec<_> = ours.iter().enumerate().map(|(k, &name)| (name, plane_of(k))).collect();
    write_exr(&path, [0, 0], &planes);
    let read = Picture::read(&path).unwrap();
    assert_eq!((read.size, read.name.as_str()), ([32, 16], path.to_str().unwrap()));
    assert_eq!(read.rgb[100], [3.1, 2.1, 1.1]);
    assert_eq!((read.alpha.unwrap()[1], read.hair.unwrap()[2]), (0.001, 4.002));
    assert_eq!(read.variance.unwrap()[0], [7.0, 6.0, 5.0]);

    // Another tool's: layers by name, no hair, and a data window off the display window's corner.
    let named =
        ["View.Combined.A", "View.Combined.B", "View.Combined.G", "View.Combined.R", "View.Z"];
    let planes: Vec<_> = named.iter().enumerate().map(|(k, &n)| (n, plane_of(k))).collect();
    write_exr(&path, [2, 1], &planes);
    let read = Picture::read(&path).unwrap();
    assert!(read.name.ends_with("(View.Combined)") && read.hair.is_none());
    assert_eq!((read.rgb[33], read.rgb[34]), ([0.0; 3], [3.0, 2.0, 1.0]));

    write_exr(&path, [0, 0], &[("R", plane_of(0)), ("G", plane_of(1)), ("Z", plane_of(2))]);
    let message = error(Picture::read(&path));
    assert!(message.contains("frame.exr") && message.contains("G, R, Z"), "{message}");
    std::fs::write(&path, b"\x89PNG").unwrap();
    assert!(error(Picture::read(&path)).contains("no EXR file"));
    write_exr(&path, [0, 0], &planes);
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    assert!(error(Picture::read(&path)).contains("cut short"));
    assert!(error(Picture::read(&folder.path().join("none.exr"))).contains("none.exr"));
}

/// What every compositor reads: scanlines from the top down, ZIP compressed.
#[test]
fn exr_files_are_written_as_zip_scanlines() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("frame.exr");
    let planes = ["R", "G", "B", "hair"].map(|name| (name, plane(|i| 0.25 * i as f32)));
    hairlight::openexr::write(&path, [32, 16], planes.to_vec(), &[("a.note", "text".into())])
        .unwrap();
    /// Version flags, and attributes: name, type, value.
    fn header(bytes: &[u8]) -> (u32, Vec<(String, String, Vec<u8>)>) {
        let text = |at: &mut usize| {
            let end = *at + bytes[*at..].iter().position(|&b| b == 0).unwrap();
            let text = String::from_utf8(bytes[*at..end].to_vec()).unwrap();
            *at = end + 1;
            text
        };
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let mut at = 8;
        let mut all = Vec::new();
        loop {
            let name = text(&mut at);
            if name.is_empty() {
                return (word(4), all);
            }
            let kind = text(&mut at);
            let size = word(at) as usize;
            all.push((name, kind, bytes[at + 4..at + 4 + size].to_vec()));
            at += 4 + size;
        }
    }
    // The numbers of the format's own documentation.
    let wanted = |bytes: &[u8]| {
        let (version, attributes) = header(bytes);
        let value = |name: &str| {
            attributes.iter().find(|(n, ..)| n == name).map(|(_, _, value)| value.as_slice())
        };
        let (zip, increasing_y) = ([3u8], [0u8]);
        version == 2
            && value("compression") == Some(&zip)
            && value("lineOrder") == Some(&increasing_y)
            && value("tiles").is_none()
    };
    assert!(wanted(&std::fs::read(&path).unwrap()));
    assert_eq!(Picture::read(&path).unwrap().rgb[100], [25.0; 3]);
    // Negative control: tiles of runs, as files were written before.
    write_exr(&path, [0, 0], &planes);
    assert!(!wanted(&std::fs::read(&path).unwrap()));
}

// The figures.

/// Draws figures into a folder and reads their numbers: the last two columns of each CSV row.
fn drawn(folder: &Path, name: &str) -> Vec<(String, [f64; 2])> {
    figures::write(&[name.to_owned()], folder, &|_| true).unwrap();
    let read = |extension| std::fs::read(folder.join(name).with_extension(extension)).unwrap();
    let png = image::load_from_memory(&read("png")).unwrap();
    assert!(png.width() >= 900 && read("png").len() <= 60_000, "{name}: {}", read("png").len());
    let svg = String::from_utf8(read("svg")).unwrap();
    assert!(svg.starts_with("<svg") && !svg.contains("NaN") && !svg.contains("inf"), "{name}");
    let csv = String::from_utf8(read("csv")).unwrap();
    csv.lines()
        .skip(1)
        .map(|line| {
            let (rest, y) = line.rsplit_once(',').unwrap();
            let (series, x) = rest.rsplit_once(',').unwrap();
            let number = |text: &str| text.parse::<f64>().unwrap();
            assert!(number(x).is_finite() && number(y).is_finite(), "{name}: {line}");
            (series.to_owned(), [number(x), number(y)])
        })
        .collect()
}

/// What figures show holds of their numbers, and each is a whole picture. Those by the path tracer and the
/// slow quadrature are left to the command.
#[test]
fn figures_show_what_they_say() {
    let folder = tempdir().unwrap();
    let at = |rows: &[(String, [f64; 2])], series: &str, x: f64| {
        let of = rows.iter().filter(|row| row.0.ends_with(series));
        let apart = |p: &[f64; 2]| (p[0] - x).abs();
        let nearest = of.min_by(|a, b| apart(&a.1).total_cmp(&apart(&b.1)));
        nearest.unwrap_or_else(|| panic!("no {series}")).1[1]
    };

    let rows = drawn(folder.path(), "deon_3");
    let conserving: Vec<f64> =
        rows.iter().filter(|row| row.0.contains("M_p")).map(|row| row.1[1]).collect();
    let worst = conserving.iter().map(|m| (m - 1.0).abs()).fold(0.0, f64::max);
    let gaussian = at(&rows, "\"Gaussian, β = 10°\"", 0.0);
    println!("M_p is {worst:.0e} off 1; a Gaussian of β = 10° returns {gaussian:.3}");
    // 1.83: computed apart from this code.
    assert!(conserving.len() == 300 && worst < 1e-6 && (gaussian - 1.83).abs() < 0.01);

    let rows = drawn(folder.path(), "deon_5");
    for (series, expected) in [("R", [0.075, 0.688]), ("R + TT", [0.937, 0.791])] {
        let found = [0.0, 85f64.to_radians()].map(|x| at(&rows, &format!(",{series}"), x));
        println!("{series}: {found:.3?}");
        assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 0.005));
    }

    let rows = drawn(folder.path(), "deon_6");
    let whole = at(&rows, "(Eq 11)", 3.2);
    let half = at(&rows, "±180°", 3.2) / whole;
    println!("straight ahead {half:.3} of N_TT are left where the detector ends");
    assert!((half - 0.5).abs() < 0.01);

    for name in ["deon_9", "deon_10", "xu_3", "pbrt_9_46", "pbrt_9_52", "pbrt_9_53", "pbrt_9_54"] {
        assert!(drawn(folder.path(), name).len() > 30, "{name}");
    }
}

#[test]
fn figures_are_named_and_documented() {
    let folder = tempdir().unwrap();
    let message = error(figures::write(&["xu_33".to_owned()], folder.path(), &|_| true));
    assert!(message.contains("xu_33") && message.contains("xu_3,"), "{message}");
    let nowhere = folder.path().join("none");
    assert!(error(figures::write(&[], &nowhere, &|_| true)).contains("no such folder"));
    assert_eq!(error(figures::write(&[], folder.path(), &|_| false)), "cancelled");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    let docs = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/figures.md");
    let docs = std::fs::read_to_string(docs).unwrap();
    for figure in &figures::FIGURES {
        let link = format!("(../assets/figures/{}.png)", figure.name);
        assert!(docs.contains(&link), "docs/figures.md does not show {}", figure.name);
    }
}
