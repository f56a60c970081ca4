//! Radiance `.hdr` in: RGBE pixels as linear RGB.
//!
//! EXPOSURE and COLORCORR lines are not undone (as in most renderers); a note says so.

use std::io::Cursor;

use anyhow::{Result, anyhow, ensure};
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;

use super::{Environment, SourceInfo, check_pixels};

/// Files say `#?RADIANCE` or `#?RGBE`.
pub const MAGIC: &[u8] = b"#?";

/// Errors, one line each without the file's name: damaged or cut short, XYZE pixels, too large,
/// turned or mirrored rows (anything but `-Y height +X width`).
pub fn read(bytes: &[u8]) -> Result<(Environment, SourceInfo)> {
    let damaged = |error: image::ImageError| {
        anyhow!("is damaged or cut short ({error}); export the file again")
    };
    let xyze = b"FORMAT=32-bit_rle_xyze";
    let header = &bytes[..bytes.len().min(1 << 16)];
    ensure!(
        !header.windows(xyze.len()).any(|text| text == xyze),
        "holds XYZ colours; convert it to RGBE first"
    );
    // Strict mode would refuse the `#?RGBE` signature.
    let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(damaged)?;
    let metadata = decoder.metadata();
    let (width, height) = (metadata.width as usize, metadata.height as usize);
    check_pixels(width, height)?;
    let mut pixels = vec![[0f32; 3]; width * height];
    decoder.read_image(bytemuck::cast_slice_mut(&mut pixels)).map_err(damaged)?;

    let mut notes = Vec::new();
    if let Some(exposure) = metadata.exposure.filter(|&e| e != 1.0) {
        notes.push(format!("its EXPOSURE of {exposure} is not undone"));
    }
    if metadata.color_correction.is_some_and(|c| c != (1.0, 1.0, 1.0)) {
        notes.push("its COLORCORR is not undone".to_owned());
    }
    let info = SourceInfo {
        format: "Radiance",
        channels: "RGBE".to_owned(),
        layer: String::new(),
        compression: "RLE",
        notes,
    };
    Ok((Environment { width, height, pixels }, info))
}
