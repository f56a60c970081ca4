//! Pictures out: tone mapping and PNG for eyes, linear EXR for measurement, whole or not at all.

use std::path::Path;

use anyhow::{Result, bail};
use image::ImageEncoder;
use rayon::prelude::*;

use crate::environment::Environment;
use crate::file::write_whole;
use crate::gpu::frame::Frame;
use crate::openexr;

/// Linear Rec. 709 luminance.
pub fn luminance(rgb: [f32; 3]) -> f32 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

/// A filmic curve: the Naka–Rushton response x^n/(x^n + s^n), which keeps middle grey (0.18), gives n =
/// 1.25 of contrast round it, and bends white so gently that eight times middle grey is still 0.75 and no
/// finite radiance burns out.
fn film(x: f32) -> f32 {
    const CONTRAST: f32 = 1.25;
    const GREY: f32 = 0.18;
    let x = (x.max(0.0) / GREY).powf(CONTRAST);
    // s^n = grey^n (1 − grey)/grey, so that film(grey) = grey.
    x / (x + (1.0 - GREY) / GREY)
}

/// Linear radiance to display-referred linear RGB in 0…1. A tenth of luminance is mixed in, so that
/// saturated highlights turn lighter rather than clip to a primary.
pub fn tone_map(rgb: [f32; 3]) -> [f32; 3] {
    let grey = luminance(rgb);
    rgb.map(|c| film(c + 0.1 * (grey - c)))
}

/// sRGB transfer function, 0…1 to a byte.
pub fn srgb8(linear: f32) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded).round() as u8
}

/// Tone-mapped sRGB bytes of a premultiplied pixel, with straight alpha, as PNG has it.
fn display(pixel: [f32; 4], scale: f32) -> [u8; 4] {
    let [r, g, b, alpha] = pixel;
    if alpha <= 0.0 {
        return [0; 4];
    }
    let rgb = tone_map([r, g, b].map(|c| c * scale / alpha)).map(srgb8);
    [rgb[0], rgb[1], rgb[2], (255.0 * alpha.clamp(0.0, 1.0)).round() as u8]
}

/// What a frame can be written as.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Format {
    Png,
    Exr,
}

impl Format {
    /// By the path's extension, in any case.
    pub fn of(path: &Path) -> Result<Format> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        match extension.to_lowercase().as_str() {
            "png" => Ok(Format::Png),
            "exr" => Ok(Format::Exr),
            _ => bail!("{}: the extension says no format: name it .png or .exr", path.display()),
        }
    }
}

/// Writes a frame by its extension: `.png` tone mapped after multiplying by `scale`, `.exr` in linear
/// f32 as it is (R, G, B, A premultiplied, and `hair`, the coverage by hair).
pub fn write_frame(path: &Path, frame: &Frame, scale: f32) -> Result<()> {
    match Format::of(path)? {
        Format::Png => write_display(path, frame.size, &frame.pixels, scale),
        Format::Exr => {
            let plane = |c: usize| frame.pixels.iter().map(|p| p[c]).collect();
            let colors = ["R", "G", "B", "A"].into_iter().enumerate();
            let mut channels: Vec<_> = colors.map(|(c, name)| (name, plane(c))).collect();
            channels.push(("hair", frame.hair_coverage.clone()));
            openexr::write(path, frame.size, channels, &[])
        }
    }
}

/// Premultiplied linear pixels as sRGB with straight alpha, tone mapped after multiplying by `scale`.
pub fn display_bytes(pixels: &[[f32; 4]], scale: f32) -> Vec<u8> {
    pixels.par_iter().flat_map_iter(|&p| display(p, scale)).collect()
}

/// Writes premultiplied linear pixels as a PNG, tone mapped after multiplying by `scale`.
pub fn write_display(
    path: &Path,
    [width, height]: [u32; 2],
    pixels: &[[f32; 4]],
    scale: f32,
) -> Result<()> {
    write_png(path, &display_bytes(pixels, scale), width, height, image::ExtendedColorType::Rgba8)
}

/// Writes sRGB bytes as a PNG.
pub fn write_png_rgba(path: &Path, [width, height]: [u32; 2], rgba: &[u8]) -> Result<()> {
    write_png(path, rgba, width, height, image::ExtendedColorType::Rgba8)
}

/// Writes a picture in sRGB.
pub fn write_png_rgb(path: &Path, picture: &image::RgbImage) -> Result<()> {
    let (width, height) = picture.dimensions();
    write_png(path, picture.as_raw(), width, height, image::ExtendedColorType::Rgb8)
}

/// Writes a lat-long map as a tone-mapped PNG, exposed so that its mean luminance is middle grey.
pub fn write_png_map(path: &Path, map: &Environment) -> Result<()> {
    let mean = luminance(map.mean_radiance().map(|c| c as f32));
    let scale = if mean > 0.0 { 0.18 / mean } else { 1.0 };
    let bytes: Vec<u8> = map
        .pixels
        .par_iter()
        .flat_map_iter(|p| tone_map(p.map(|c| c * scale)).map(srgb8))
        .collect();
    write_png(path, &bytes, map.width as u32, map.height as u32, image::ExtendedColorType::Rgb8)
}

fn write_png(
    path: &Path,
    bytes: &[u8],
    width: u32,
    height: u32,
    color: image::ExtendedColorType,
) -> Result<()> {
    write_whole(path, |file| {
        let encoder = image::codecs::png::PngEncoder::new(std::io::BufWriter::new(file));
        encoder.write_image(bytes, width, height, color).map_err(Into::into)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_film_curve_keeps_grey_and_never_burns_out() {
        assert!((film(0.18) - 0.18).abs() < 1e-6);
        assert!(film(0.0) == 0.0 && film(1e4) < 1.0 && film(4.0) > film(3.9));
        assert!((film(1.44) - 0.747).abs() < 0.001, "{}", film(1.44));
    }
}
