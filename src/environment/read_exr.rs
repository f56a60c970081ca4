//! OpenEXR in: one colour layer of a file as a map.

use anyhow::{Result, ensure};
use exr::meta::attribute::{IntegerBounds, SampleType};
use exr::meta::header::Header;

use super::{Environment, SourceInfo};
use crate::openexr::{ColorLayer, ExrFile, compression_name};

pub const FORMAT: &str = "OpenEXR";

/// A layer of an EXR file, as stored: NaN, Inf and negatives are still in it. None is the finished picture.
///
/// # Errors
/// One line without the file's name: those of [`ExrFile`], or a cube map.
pub fn read(bytes: &[u8], name: Option<&str>) -> Result<(Environment, SourceInfo)> {
    let file = ExrFile::open(bytes)?;
    let layers = file.color_layers();
    let layer = file.choose(name, "environment.layer (--env-layer)")?;
    ensure!(
        !file.is_cube(layer.part),
        "is a cube map; convert it to lat-long (equirectangular) first"
    );
    let mut info = describe(file.header(layer.part), &layer, &layers);
    if name.is_none() && !layer.name.is_empty() && layers.len() > 1 {
        let others = layers.iter().filter(|other| **other != layer).map(ColorLayer::shown);
        info.notes.push(format!(
            "its layer {} is taken; it also has {} (--env-layer chooses)",
            layer.name,
            others.collect::<Vec<_>>().join(", ")
        ));
    }
    let planes = file.pixels(layer.part, layer.rgb.map(Some))?;
    let (width, height, pixels) = (planes.width, planes.height, planes.pixels);
    Ok((Environment::new(width, height, pixels), info))
}

fn describe(header: &Header, layer: &ColorLayer, layers: &[ColorLayer]) -> SourceInfo {
    let mut rgb = layer.rgb.to_vec();
    rgb.dedup();
    let channels = rgb.iter().map(|&index| {
        let channel = &header.channels.list[index];
        let sample_type = match channel.sample_type {
            SampleType::F16 => "f16",
            SampleType::F32 => "f32",
            SampleType::U32 => "u32",
        };
        format!("{} {sample_type}", channel.name)
    });
    let mut channels = channels.collect::<Vec<_>>().join(", ");
    let unread = header.channels.list.len() - rgb.len();
    if unread > 0 {
        channels += &format!(" of {} channels", header.channels.list.len());
    }
    let mut notes = Vec::new();
    if header.shared_attributes.chromaticities.is_some_and(|c| {
        // Loose enough for Rec. 709 adapted to D50, as some tools write it; Adobe RGB and P3 are
        // beyond.
        let rec709 = [(0.64, 0.33), (0.30, 0.60), (0.15, 0.06)];
        [c.red, c.green, c.blue]
            .iter()
            .zip(rec709)
            .any(|(p, (x, y))| (p.0 - x).abs() > 0.025 || (p.1 - y).abs() > 0.025)
    }) {
        notes.push("its primaries are not Rec. 709; its colours are taken as they are".to_owned());
    }
    let data = header.data_window();
    let display = header.shared_attributes.display_window;
    if data != display {
        let window = |b: IntegerBounds| {
            format!("{} × {} at ({}, {})", b.size.0, b.size.1, b.position.0, b.position.1)
        };
        notes.push(format!(
            "data window {}, display window {}: \
             the display window is the picture, black where there is no data",
            window(data),
            window(display)
        ));
    }
    SourceInfo {
        format: FORMAT,
        channels,
        layer: layer.name.clone(),
        layers: layers.iter().map(|layer| layer.shown().to_owned()).collect(),
        compression: compression_name(header.compression),
        notes,
    }
}
