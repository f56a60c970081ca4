//! OpenEXR in: one colour layer of a file, as a picture of linear RGB.
//!
//! The picture is the display window: pixels outside the data window are black, data outside the
//! display window is cropped away. Where the two windows do not meet, the data window is the
//! picture. EXR colour is premultiplied by alpha, so RGB is the light itself and alpha is left
//! unread. Only the chosen layer's largest resolution level is decoded, block by block and in
//! parallel: other layers, deep parts and mip levels cost nothing.

use std::collections::HashSet;
use std::io::Cursor;

use anyhow::{Result, anyhow, bail, ensure};
use exr::block::UncompressedBlock;
use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock, CompressedTileBlock};
use exr::block::reader::ChunksReader;
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::attribute::{Compression, EnvironmentMap, IntegerBounds, SampleType};
use exr::meta::header::Header;
use half::f16;
use rayon::prelude::*;

use super::{Environment, SourceInfo, check_pixels};
use crate::file::catch_panic;

pub const MAGIC: [u8; 4] = exr::meta::magic_number::BYTES;

/// One compressed block may claim this many bytes at most once unpacked: a 16384 wide DWAB block of
/// 256 lines and 20 float channels is 0.3 GiB.
const MAX_BLOCK_BYTES: usize = 1 << 30;
/// Blocks decoded at once hold about this many bytes.
const BATCH_BYTES: usize = 1 << 28;
/// The last segment of a layer's name that marks the finished colour among its siblings.
const BEAUTY: [&str; 6] = ["", "rgb", "rgba", "combined", "beauty", "color"];

/// The first colour layer of an EXR file, as stored: NaN, Inf and negatives are still in it.
/// Errors, one line each without the file's name: damaged or cut short, a claimed size that the
/// file cannot hold or above [`super::MAX_PIXELS`], no colour channels, a cube map, a codec that
/// the decoder lacks.
pub fn read(bytes: &[u8]) -> Result<(Environment, SourceInfo)> {
    catch_panic(|| read_unguarded(bytes))
        .unwrap_or_else(|_| bail!("is damaged: the EXR decoder broke off; export the file again"))
}

fn read_unguarded(bytes: &[u8]) -> Result<(Environment, SourceInfo)> {
    let reader = exr::block::read(Cursor::new(bytes), false).map_err(damaged)?;
    let layer = choose_layer(reader.headers())?;
    let header = reader.headers()[layer.part].clone();
    check_size(bytes.len(), reader.headers(), &header)?;
    if header.own_attributes.environment_map == Some(EnvironmentMap::Cube) {
        bail!("is a cube map; convert it to lat-long (equirectangular) first");
    }

    let mut canvas = Canvas::new(&header);
    let mut chunks = reader
        .filter_chunks(false, |_, tile, block| {
            block.layer == layer.part && tile.is_largest_resolution_level()
        })
        .map_err(damaged)?;
    let meta = chunks.meta_data().clone();
    let blocks = chunks.expected_chunk_count();
    let batch = (BATCH_BYTES / block_bytes(&header).max(1)).clamp(1, 256);
    let mut seen = HashSet::new();
    loop {
        let compressed =
            chunks.by_ref().take(batch).collect::<Result<Vec<_>, _>>().map_err(damaged)?;
        if compressed.is_empty() {
            break;
        }
        let decoded: Vec<_> = compressed
            .into_par_iter()
            .map(|chunk| catch_panic(|| decompress(chunk, &meta)))
            .collect();
        for block in decoded {
            let block = block
                .map_err(|_| {
                    anyhow!(
                        "is damaged: a block of pixels cannot be unpacked; export the file again"
                    )
                })?
                .map_err(damaged)?;
            ensure!(
                block.index.layer == layer.part && block.index.level == Vec2(0, 0),
                "is damaged: its offset table points at another layer's pixels; \
                 export the file again"
            );
            seen.insert(block.index.pixel_position);
            canvas.paste(&block, &header, &layer)?;
        }
    }
    ensure!(
        seen.len() == blocks,
        "is damaged: {} of {blocks} blocks of pixels are missing; export the file again",
        blocks - seen.len()
    );
    Ok((canvas.picture, describe(&header, &layer)))
}

/// Where the colour is: a part of the file and its channels for R, G and B (one thrice where it is
/// grey).
struct ColourLayer {
    part: usize,
    /// Empty for unprefixed channels of an unnamed part.
    name: String,
    rgb: [usize; 3],
}

/// RGB before grey, finished colour (unnamed, or named as in [`BEAUTY`]) before other layers, then
/// file order. Grey is a Y that is no part of an XYZ triple, or an R alone.
fn choose_layer(headers: &[Header]) -> Result<ColourLayer> {
    let mut best: Option<((u8, bool), ColourLayer)> = None;
    for (part, header) in headers.iter().enumerate().filter(|(_, h)| !h.deep) {
        let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
        let split = |name: &'_ str| match name.rsplit_once('.') {
            Some((prefix, channel)) => (prefix.to_owned(), channel.to_ascii_uppercase()),
            None => (String::new(), name.to_ascii_uppercase()),
        };
        let split: Vec<_> = names.iter().map(|name| split(name)).collect();
        for (prefix, _) in &split {
            let channel = |wanted: &str| split.iter().position(|(p, c)| p == prefix && c == wanted);
            let (kind, rgb) = match (channel("R"), channel("G"), channel("B"), channel("Y")) {
                (Some(r), Some(g), Some(b), _) => (0, [r, g, b]),
                (None, None, None, Some(y)) if channel("X").is_none() => (1, [y; 3]),
                (Some(r), None, None, None) => (2, [r; 3]),
                _ => continue,
            };
            let part_name = header.own_attributes.layer_name.as_ref().map(|name| name.to_string());
            let name = [part_name.as_deref().unwrap_or(""), prefix]
                .into_iter()
                .filter(|name| !name.is_empty())
                .collect::<Vec<_>>()
                .join(".");
            let last = name.rsplit('.').next().unwrap_or("").to_ascii_lowercase();
            let rank = (kind, !BEAUTY.contains(&last.as_str()));
            if best.as_ref().is_none_or(|(best_rank, _)| rank < *best_rank) {
                best = Some((rank, ColourLayer { part, name, rgb }));
            }
        }
    }
    best.map(|(_, layer)| layer).ok_or_else(|| {
        let deep = headers.iter().any(|h| h.deep);
        let names: Vec<String> = headers
            .iter()
            .flat_map(|h| h.channels.list.iter().map(|c| c.name.to_string()))
            .take(12)
            .collect();
        anyhow!(
            "has no {}colour to light with: need R, G and B, or Y, or R alone; its channels are {}",
            if deep { "flat (not deep) " } else { "" },
            names.join(", ")
        )
    })
}

/// Refuses a header that claims more than we take or than the file can hold, before anything is
/// allocated.
fn check_size(file_bytes: usize, headers: &[Header], header: &Header) -> Result<()> {
    for size in [header.layer_size, header.shared_attributes.display_window.size] {
        check_pixels(size.0, size.1)?;
    }
    // Each block of pixels takes 8 bytes in the offset table and 8 before its data.
    let blocks = headers.iter().fold(0usize, |sum, h| sum.saturating_add(h.chunk_count));
    ensure!(
        blocks.saturating_mul(16) <= file_bytes,
        "claims {} × {} pixels in {blocks} blocks, \
         more than its {file_bytes} bytes can hold: it is cut short or damaged",
        header.layer_size.0,
        header.layer_size.1
    );
    ensure!(
        block_bytes(header) <= MAX_BLOCK_BYTES,
        "packs {} bytes into one block of pixels, more than can be read: \
         save it with smaller tiles or fewer channels",
        block_bytes(header)
    );
    Ok(())
}

fn block_bytes(header: &Header) -> usize {
    let Vec2(width, height) = header.max_block_pixel_size();
    width.saturating_mul(height).saturating_mul(header.channels.bytes_per_pixel)
}

/// One block of pixels. The decoder allocates what a DWA block's own header claims, and a failed
/// allocation cannot be caught: so those claims are held against the block's size first.
fn decompress(chunk: Chunk, meta: &MetaData) -> exr::error::Result<UncompressedBlock> {
    use exr::error::Error;
    let header = meta
        .headers
        .get(chunk.layer_index)
        .ok_or(Error::Invalid("block of an unknown layer".into()))?;
    if let Compression::DWAA(_) | Compression::DWAB(_) = header.compression {
        let block = &chunk.compressed_block;
        let (CompressedBlock::ScanLine(CompressedScanLineBlock {
            compressed_pixels_le: bytes,
            ..
        })
        | CompressedBlock::Tile(CompressedTileBlock { compressed_pixels_le: bytes, .. })) = block
        else {
            return Err(Error::NotSupported("deep data".into()));
        };
        let tile = header.get_block_data_indices(block)?;
        let Vec2(width, height) = header.get_absolute_block_pixel_coordinates(tile)?.size;
        let raw = width * height * header.channels.bytes_per_pixel;
        // Coefficients fill whole squares of 8 × 8, and runs may lengthen what they code badly.
        let largest = 4
            * width.next_multiple_of(8)
            * height.next_multiple_of(8)
            * header.channels.bytes_per_pixel;
        let claims = bytes
            .chunks_exact(8)
            .take(11)
            .map(|counter| u64::from_le_bytes(counter.try_into().expect("chunks of 8")));
        // A block as long as its pixels is stored plainly, without counters.
        if bytes.len() != raw && claims.into_iter().any(|claim| claim > largest as u64) {
            return Err(Error::Invalid("a DWA block claims more than it can hold".into()));
        }
    }
    UncompressedBlock::decompress_chunk(chunk, meta, false)
}

/// The picture under its window, filled block by block.
struct Canvas {
    picture: Environment,
    /// The data window's corner in the picture; may lie outside of it.
    data_x: i64,
    data_y: i64,
}

impl Canvas {
    fn new(header: &Header) -> Self {
        let data = header.data_window();
        let display = header.shared_attributes.display_window;
        let meet = |axis: fn(IntegerBounds) -> (i64, i64)| {
            let ((data_start, data_end), (start, end)) = (axis(data), axis(display));
            data_start < end && start < data_end
        };
        let x =
            |b: IntegerBounds| (i64::from(b.position.0), i64::from(b.position.0) + b.size.0 as i64);
        let y =
            |b: IntegerBounds| (i64::from(b.position.1), i64::from(b.position.1) + b.size.1 as i64);
        let window = if meet(x) && meet(y) { display } else { data };
        Self {
            picture: Environment {
                width: window.size.0,
                height: window.size.1,
                pixels: vec![[0.0; 3]; window.size.0 * window.size.1],
            },
            data_x: i64::from(data.position.0) - i64::from(window.position.0),
            data_y: i64::from(data.position.1) - i64::from(window.position.1),
        }
    }

    /// Copies the block's colour to where it meets the picture. A block holds its rows one after
    /// another, and in each row its channels one after another.
    fn paste(
        &mut self,
        block: &UncompressedBlock,
        header: &Header,
        layer: &ColourLayer,
    ) -> Result<()> {
        let Vec2(block_width, block_height) = block.index.pixel_size;
        let channels = &header.channels.list;
        let row_bytes = block_width * header.channels.bytes_per_pixel;
        ensure!(
            block.data.len() == row_bytes * block_height,
            "is damaged: a block of pixels has the wrong size; export the file again"
        );
        let left = self.data_x + block.index.pixel_position.0 as i64;
        let top = self.data_y + block.index.pixel_position.1 as i64;
        let columns = 0.max(-left)..(block_width as i64).min(self.picture.width as i64 - left);
        for (row, line) in block.data.chunks_exact(row_bytes.max(1)).enumerate() {
            let y = top + row as i64;
            if y < 0 || y >= self.picture.height as i64 || columns.is_empty() {
                continue;
            }
            let start = y as usize * self.picture.width + (left + columns.start) as usize;
            let target = &mut self.picture.pixels[start..];
            for (component, &channel) in layer.rgb.iter().enumerate() {
                let sample_type = channels[channel].sample_type;
                let size = sample_type.bytes_per_sample();
                let offset: usize = channels[..channel]
                    .iter()
                    .map(|c| c.sample_type.bytes_per_sample() * block_width)
                    .sum();
                let samples =
                    &line[offset..][columns.start as usize * size..columns.end as usize * size];
                for (pixel, sample) in target.iter_mut().zip(samples.chunks_exact(size)) {
                    pixel[component] = to_f32(sample_type, sample);
                }
            }
        }
        Ok(())
    }
}

/// A stored sample, native-endian as the decoder leaves it. Integers are taken as plain numbers.
fn to_f32(sample_type: SampleType, bytes: &[u8]) -> f32 {
    match (sample_type, bytes) {
        (SampleType::F16, &[a, b]) => f16::from_ne_bytes([a, b]).to_f32(),
        (SampleType::F32, &[a, b, c, d]) => f32::from_ne_bytes([a, b, c, d]),
        (SampleType::U32, &[a, b, c, d]) => u32::from_ne_bytes([a, b, c, d]) as f32,
        _ => unreachable!("chunks_exact hands out whole samples"),
    }
}

fn describe(header: &Header, layer: &ColourLayer) -> SourceInfo {
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
    let unread = header.channels.list.len() - rgb.len();
    let mut notes = Vec::new();
    if unread > 0 {
        notes.push(format!("left unread beside these: {unread} of its channels"));
    }
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
        format: "OpenEXR",
        channels: channels.collect::<Vec<_>>().join(", "),
        layer: layer.name.clone(),
        compression: match header.compression {
            Compression::Uncompressed => "none",
            Compression::RLE => "RLE",
            Compression::ZIP1 => "ZIPS",
            Compression::ZIP16 => "ZIP",
            Compression::PIZ => "PIZ",
            Compression::PXR24 => "PXR24",
            Compression::B44 => "B44",
            Compression::B44A => "B44A",
            Compression::DWAA(_) => "DWAA",
            Compression::DWAB(_) => "DWAB",
            Compression::HTJ2K32 | Compression::HTJ2K256 => "HTJ2K",
        },
        notes,
    }
}

fn damaged(error: exr::error::Error) -> anyhow::Error {
    match error {
        exr::error::Error::NotSupported(what) => {
            anyhow!("cannot be read: {what}; save it as a flat ZIP or PIZ file")
        }
        error => anyhow!("is damaged or cut short ({error}); export the file again"),
    }
}
