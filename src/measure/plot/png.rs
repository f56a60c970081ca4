//! The SVG's pixels, small enough to be committed.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};

use anyhow::{Result, anyhow};
use resvg::{tiny_skia, usvg};

use super::svg::INK;
use super::{Colour, Plot};

/// Pixels of the PNG for each of the plot's.
const PNG_SCALE: f32 = 1.25;

impl Plot {
    /// The PNG of this plot's `svg`, [`PNG_SCALE`] times as large. Curves make do with 64 colours, which
    /// saves half of the bytes and more; swatches and bars keep their own.
    pub fn png(&self, svg: &str) -> Result<Vec<u8>> {
        static FONTS: LazyLock<Arc<usvg::fontdb::Database>> = LazyLock::new(|| {
            let mut fonts = usvg::fontdb::Database::new();
            fonts.load_font_data(epaint_default_fonts::UBUNTU_LIGHT.to_vec());
            Arc::new(fonts)
        });
        let options = usvg::Options {
            fontdb: FONTS.clone(),
            // The only face at hand is light: a hair's outline gives it the weight of a regular one.
            style_sheet: Some(format!("text {{ stroke: {INK}; stroke-width: 0.3px }}")),
            ..usvg::Options::default()
        };
        let tree = usvg::Tree::from_str(svg, &options)?;
        let [width, height] =
            [tree.size().width(), tree.size().height()].map(|n| (n * PNG_SCALE) as u32);
        let mut canvas = tiny_skia::Pixmap::new(width, height)
            .ok_or_else(|| anyhow!("a plot cannot have {width} × {height} pixels"))?;
        let scale = tiny_skia::Transform::from_scale(PNG_SCALE, PNG_SCALE);
        resvg::render(&tree, scale, &mut canvas.as_mut());
        let pixels: Vec<Colour> =
            canvas.pixels().iter().map(|p| [p.red(), p.green(), p.blue()]).collect();
        let palette = match self {
            Plot::Swatches { .. } | Plot::Bars { .. } => None,
            _ => Some(commonest(&pixels, 64)),
        };
        png(&pixels, width, height, palette)
    }
}

/// A picture as PNG: a few colours as a palette, else RGB.
fn png(
    pixels: &[Colour],
    width: u32,
    height: u32,
    palette: Option<Vec<Colour>>,
) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_compression(png::Compression::High);
    // Lines on white pack best as they are.
    encoder.set_filter(png::Filter::NoFilter);
    match palette {
        Some(palette) => {
            encoder.set_color(png::ColorType::Indexed);
            encoder.set_palette(palette.as_flattened());
            encoder.write_header()?.write_image_data(&nearest(pixels, &palette))?;
        }
        None => {
            encoder.set_color(png::ColorType::Rgb);
            encoder.write_header()?.write_image_data(pixels.as_flattened())?;
        }
    }
    Ok(bytes)
}

/// The `count` ≤ 256 commonest colours.
fn commonest(pixels: &[Colour], count: usize) -> Vec<Colour> {
    let mut counts: BTreeMap<Colour, usize> = BTreeMap::new();
    pixels.iter().for_each(|&p| *counts.entry(p).or_default() += 1);
    let mut palette: Vec<Colour> = counts.keys().copied().collect();
    palette.sort_by_key(|colour| Reverse(counts[colour]));
    palette.truncate(count);
    palette
}

/// For each pixel the colour of the palette that is nearest.
fn nearest(pixels: &[Colour], palette: &[Colour]) -> Vec<u8> {
    let distance = |a: &Colour, b: &Colour| -> u32 {
        (0..3).map(|c| u32::from(a[c].abs_diff(b[c])).pow(2)).sum()
    };
    let mut found: BTreeMap<Colour, u8> = BTreeMap::new();
    let index = |pixel: &Colour| {
        let by_distance = |&k: &usize| distance(&palette[k], pixel);
        *found
            .entry(*pixel)
            .or_insert_with(|| (0..palette.len()).min_by_key(by_distance).unwrap_or(0) as u8)
    };
    pixels.iter().map(index).collect()
}
