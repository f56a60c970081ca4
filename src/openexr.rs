//! OpenEXR files in and out: layers, chosen channels as f32, and text attributes.
//!
//! A picture is its display window: pixels outside the data window are 0, data outside the display window is cropped
//! away. Where the two windows do not meet, the data window is the picture. EXR colour is premultiplied by alpha, so
//! RGB is the light itself. Only the largest resolution level of the part that is asked for is decoded, block by block
//! and in parallel: other parts, deep ones too, and mip levels cost nothing.

use std::collections::HashSet;
use std::io::Cursor;
use std::path::Path;

use anyhow::{Result, anyhow, bail, ensure};
use exr::block::UncompressedBlock;
use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock, CompressedTileBlock};
use exr::block::reader::{ChunksReader, Reader};
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::attribute::{
    AttributeValue, Compression, EnvironmentMap, IntegerBounds, SampleType, Text,
};
use exr::meta::header::Header;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Layer, LayerAttributes, WritableImage,
};
use half::f16;
use rayon::prelude::*;

use crate::file::{catch_panic, check_pixels, write_whole};

pub const MAGIC: [u8; 4] = exr::meta::magic_number::BYTES;

/// One compressed block may claim this many bytes at most once unpacked: a 16384 wide DWAB block of
/// 256 lines and 20 float channels is 0.3 GiB.
const MAX_BLOCK_BYTES: usize = 1 << 30;
/// Blocks decoded at once hold about this many bytes.
const BATCH_BYTES: usize = 1 << 26;
/// The last segment of a layer's name that marks the finished picture, the likeliest first.
const FINISHED: [&str; 7] = ["combined", "beauty", "composite", "rgba", "rgb", "color", "colour"];

/// An EXR file whose headers are read.
pub struct ExrFile<'a> {
    reader: Reader<Cursor<&'a [u8]>>,
    bytes: usize,
}

/// A colour of a file: R, G and B, or one channel thrice where it is grey.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorLayer {
    /// Which part of the file.
    pub part: usize,
    /// Part and prefix of the channels; empty for unprefixed channels of an unnamed part.
    pub name: String,
    /// What stands before the names of its channels, with its dot.
    pub prefix: String,
    /// Channels of the part.
    pub rgb: [usize; 3],
    kind: Kind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Rgb,
    /// A Y that is no part of an XYZ triple.
    Luminance,
    RedAlone,
}

/// Some channels of a picture, row by row from the top left.
pub struct Planes<const N: usize> {
    pub width: usize,
    pub height: usize,
    /// A value of each channel that was asked for; 0 of one that is not there.
    pub pixels: Vec<[f32; N]>,
}

impl<'a> ExrFile<'a> {
    /// Reads the headers of an EXR file.
    ///
    /// # Errors
    /// One line without the file's name: damaged or cut short.
    pub fn open(bytes: &'a [u8]) -> Result<Self> {
        let reader = guarded(|| exr::block::read(Cursor::new(bytes), false).map_err(damaged))?;
        Ok(Self { reader, bytes: bytes.len() })
    }

    pub fn header(&self, part: usize) -> &Header {
        &self.reader.headers()[part]
    }

    /// Everything that could be lit with or compared, in the order of the file: RGB, grey, or R alone.
    pub fn color_layers(&self) -> Vec<ColorLayer> {
        let parts = self.reader.headers().iter().enumerate().filter(|(_, header)| !header.deep);
        parts.flat_map(|(part, header)| layers_of(part, header)).collect()
    }

    /// The layer of this name, in any case, whole or its last segments; without a name the finished picture: RGB before
    /// grey, then what has no name, then the first that is named as in [`FINISHED`], then what is the only one.
    ///
    /// # Errors
    /// One line without the file's name: no colour, no such layer, or several and none is the finished picture. The
    /// last two list the layers; `flag` chooses one.
    pub fn choose(&self, name: Option<&str>, flag: &str) -> Result<ColorLayer> {
        let mut all = self.color_layers();
        ensure!(!all.is_empty(), self.without_color());
        if let Some(name) = name {
            let wanted = name.to_lowercase();
            let tail = format!(".{wanted}");
            let whole = all.iter().position(|layer| layer.name.to_lowercase() == wanted);
            let at = whole
                .or_else(|| all.iter().position(|l| l.name.to_lowercase().ends_with(&tail)))
                .ok_or_else(|| anyhow!("has no layer {name}: it has {}", names(&all)))?;
            return Ok(all.swap_remove(at));
        }
        let best = all.iter().map(|layer| layer.kind).min();
        all.retain(|layer| Some(layer.kind) == best);
        let one_part = self.reader.headers().len() == 1;
        let bare = |l: &ColorLayer| l.name.is_empty() || one_part && l.prefix.is_empty();
        let finished = || {
            FINISHED.iter().find_map(|&word| {
                all.iter().position(|layer| self.last_word(layer).eq_ignore_ascii_case(word))
            })
        };
        let at = all.iter().position(bare).or_else(finished).or((all.len() == 1).then_some(0));
        let at = at.ok_or_else(|| {
            anyhow!(
                "has several layers, none of them named as the finished picture: \
                 choose one with {flag}: {}",
                names(&all)
            )
        })?;
        Ok(all.swap_remove(at))
    }

    /// The last segment of a layer's name, that of a view such as `left` left out.
    fn last_word<'l>(&self, layer: &'l ColorLayer) -> &'l str {
        let view = self.header(layer.part).own_attributes.view_name.as_ref().map(Text::to_string);
        let mut words = layer.name.rsplit('.');
        let last = words.next().unwrap_or_default();
        if view.as_deref() == Some(last) { words.next().unwrap_or(last) } else { last }
    }

    fn without_color(&self) -> String {
        let headers = self.reader.headers();
        let names: Vec<String> = headers
            .iter()
            .flat_map(|h| h.channels.list.iter().map(|c| c.name.to_string()))
            .take(12)
            .collect();
        format!(
            "has no {}colour: it needs R, G and B (or red, green, blue), or Y, or R alone; its channels are {}",
            if headers.iter().any(|h| h.deep) { "flat (not deep) " } else { "" },
            names.join(", ")
        )
    }

    /// The place of a part's channel of this name.
    pub fn channel(&self, part: usize, name: &str) -> Option<usize> {
        self.header(part).channels.list.iter().position(|channel| channel.name.eq(name))
    }

    /// A text attribute of a part.
    pub fn text(&self, part: usize, name: &str) -> Option<String> {
        match self.header(part).own_attributes.other.get(&Text::from(name)) {
            Some(AttributeValue::Text(text)) => Some(text.to_string()),
            _ => None,
        }
    }

    /// Whether the part is the six sides of a cube.
    pub fn is_cube(&self, part: usize) -> bool {
        self.header(part).own_attributes.environment_map == Some(EnvironmentMap::Cube)
    }

    /// Some channels of a part as stored: NaN, infinities and negatives are still in them.
    ///
    /// # Errors
    /// One line without the file's name: damaged or cut short, a claimed size that the file cannot hold or above
    /// [`crate::file::MAX_PIXELS`], a codec that the decoder lacks.
    pub fn pixels<const N: usize>(
        self,
        part: usize,
        channels: [Option<usize>; N],
    ) -> Result<Planes<N>> {
        guarded(|| self.pixels_unguarded(part, channels))
    }

    fn pixels_unguarded<const N: usize>(
        self,
        part: usize,
        channels: [Option<usize>; N],
    ) -> Result<Planes<N>> {
        let header = self.header(part).clone();
        check_size(self.bytes, self.reader.headers(), &header)?;
        let mut canvas = Canvas::new(&header, channels);
        let mut chunks = self
            .reader
            .filter_chunks(false, |_, tile, block| {
                block.layer == part && tile.is_largest_resolution_level()
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
                .map(|chunk| {
                    let block = catch_panic(|| decompress(chunk, &meta))
                        .map_err(|_| {
                            anyhow!(
                                "is damaged: a block of pixels cannot be unpacked; export the file again"
                            )
                        })?
                        .map_err(damaged)?;
                    ensure!(
                        block.index.layer == part && block.index.level == Vec2(0, 0),
                        "is damaged: its offset table points at another layer's pixels; \
                         export the file again"
                    );
                    canvas.cut(&block, &header)
                })
                .collect();
            for cutting in decoded {
                let cutting = cutting?;
                seen.insert(cutting.position);
                canvas.paste(&cutting);
            }
        }
        ensure!(
            seen.len() == blocks,
            "is damaged: {} of {blocks} blocks of pixels are missing; export the file again",
            blocks - seen.len()
        );
        Ok(canvas.picture)
    }
}

fn guarded<T>(read: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_panic(read)
        .unwrap_or_else(|_| bail!("is damaged: the EXR decoder broke off; export the file again"))
}

/// Names of layers in a row.
fn names(layers: &[ColorLayer]) -> String {
    let names: Vec<&str> = layers.iter().map(ColorLayer::shown).collect();
    names.join(", ")
}

impl ColorLayer {
    /// What people read of its name.
    pub fn shown(&self) -> &str {
        if self.name.is_empty() { "(unnamed)" } else { &self.name }
    }
}

/// What a channel's name says it is, in any case and spelling; other names are none of these.
fn color_of(name: &str) -> Option<char> {
    match name.to_ascii_lowercase().as_str() {
        "r" | "red" => Some('R'),
        "g" | "green" => Some('G'),
        "b" | "blue" => Some('B'),
        "y" | "luminance" | "gray" | "grey" => Some('Y'),
        "x" => Some('X'),
        _ => None,
    }
}

fn layers_of(part: usize, header: &Header) -> Vec<ColorLayer> {
    let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
    let split: Vec<(&str, Option<char>)> = names
        .iter()
        .map(|name| name.split_at(name.rfind('.').map_or(0, |dot| dot + 1)))
        .map(|(prefix, channel)| (prefix, color_of(channel)))
        .collect();
    let part_name = header.own_attributes.layer_name.as_ref().map(Text::to_string);
    let part_name = part_name.as_deref().unwrap_or_default();
    let mut prefixes: Vec<&str> = Vec::new();
    for (prefix, _) in &split {
        // The variance of a colour is none.
        let variance = prefix.trim_end_matches('.').rsplit('.').next() == Some("variance");
        if !variance && !prefixes.contains(prefix) {
            prefixes.push(prefix);
        }
    }
    let of_prefix = |prefix: &str| {
        let channel =
            |wanted: char| split.iter().position(|&(p, c)| p == prefix && c == Some(wanted));
        let (kind, rgb) = match (channel('R'), channel('G'), channel('B'), channel('Y')) {
            (Some(r), Some(g), Some(b), _) => (Kind::Rgb, [r, g, b]),
            (None, None, None, Some(y)) if channel('X').is_none() => (Kind::Luminance, [y; 3]),
            (Some(r), None, None, None) => (Kind::RedAlone, [r; 3]),
            _ => return None,
        };
        let own = prefix.trim_end_matches('.');
        // Parts are often named as the channels in them are.
        let repeats = own == part_name
            || own.strip_prefix(part_name).is_some_and(|rest| rest.starts_with('.'));
        let name = match (part_name, own) {
            ("", own) => own.to_owned(),
            (part, "") => part.to_owned(),
            (_, own) if repeats => own.to_owned(),
            (part, own) => format!("{part}.{own}"),
        };
        Some(ColorLayer { part, name, prefix: prefix.to_owned(), rgb, kind })
    };
    prefixes.into_iter().filter_map(of_prefix).collect()
}

/// Refuses a header that claims more than we take or than the file can hold, before anything is
/// allocated.
fn check_size(file_bytes: usize, headers: &[Header], header: &Header) -> Result<()> {
    ensure!(
        header.channels.list.iter().all(|channel| channel.sampling == Vec2(1, 1)),
        "holds channels of a lower resolution than its own (subsampled), which cannot be read: \
         save it as full R, G and B"
    );
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
struct Canvas<const N: usize> {
    picture: Planes<N>,
    /// Place of each channel in a row of a block, in bytes a pixel, and its type.
    channels: [Option<(usize, SampleType)>; N],
    /// The data window's corner in the picture; may lie outside of it.
    data_x: i64,
    data_y: i64,
}

/// What of a block lies in the picture.
struct Cutting<const N: usize> {
    /// Of the block, in the data window.
    position: Vec2<usize>,
    /// Of its upper left pixel, in the picture.
    left: usize,
    top: usize,
    width: usize,
    pixels: Vec<[f32; N]>,
}

impl<const N: usize> Canvas<N> {
    fn new(header: &Header, channels: [Option<usize>; N]) -> Self {
        let data = header.data_window();
        let display = header.shared_attributes.display_window;
        let x = |b: IntegerBounds| span(b.position.0, b.size.0);
        let y = |b: IntegerBounds| span(b.position.1, b.size.1);
        let meet = |(a_start, a_end): (i64, i64), (b_start, b_end): (i64, i64)| {
            a_start < b_end && b_start < a_end
        };
        let overlap = meet(x(data), x(display)) && meet(y(data), y(display));
        let window = if overlap { display } else { data };
        let (width, height) = (window.size.0, window.size.1);
        let list = &header.channels.list;
        let bytes = |channel: usize| list[channel].sample_type.bytes_per_sample();
        Self {
            picture: Planes { width, height, pixels: vec![[0.0; N]; width * height] },
            channels: channels
                .map(|channel| channel.map(|c| ((0..c).map(bytes).sum(), list[c].sample_type))),
            data_x: i64::from(data.position.0) - i64::from(window.position.0),
            data_y: i64::from(data.position.1) - i64::from(window.position.1),
        }
    }

    /// Takes the channels out of a block, which holds its rows one after another, and in each row its channels one
    /// after another.
    fn cut(&self, block: &UncompressedBlock, header: &Header) -> Result<Cutting<N>> {
        let Vec2(block_width, block_height) = block.index.pixel_size;
        let row_bytes = block_width * header.channels.bytes_per_pixel;
        ensure!(
            block.data.len() == row_bytes * block_height,
            "is damaged: a block of pixels has the wrong size; export the file again"
        );
        let position = block.index.pixel_position;
        let within = |corner: i64, size: usize, whole: usize| {
            let (start, end) = (0.max(-corner), (size as i64).min(whole as i64 - corner));
            (start.min(end.max(0)) as usize, end.max(0) as usize)
        };
        let (left, top) = (self.data_x + position.0 as i64, self.data_y + position.1 as i64);
        let (first, last) = within(left, block_width, self.picture.width);
        let (above, below) = within(top, block_height, self.picture.height);
        let width = last - first;
        let mut pixels = vec![[0.0; N]; width * (below - above)];
        let lines = block.data.chunks_exact(row_bytes.max(1)).skip(above);
        for (row, line) in pixels.chunks_exact_mut(width.max(1)).zip(lines) {
            for (component, channel) in self.channels.iter().enumerate() {
                let Some((offset, sample_type)) = *channel else { continue };
                let size = sample_type.bytes_per_sample();
                let samples = &line[offset * block_width..][first * size..last * size];
                for (pixel, sample) in row.iter_mut().zip(samples.chunks_exact(size)) {
                    pixel[component] = to_f32(sample_type, sample);
                }
            }
        }
        let at = |corner: i64, skipped: usize| (corner + skipped as i64).max(0) as usize;
        Ok(Cutting { position, left: at(left, first), top: at(top, above), width, pixels })
    }

    fn paste(&mut self, cutting: &Cutting<N>) {
        for (row, line) in cutting.pixels.chunks_exact(cutting.width.max(1)).enumerate() {
            let start = (cutting.top + row) * self.picture.width + cutting.left;
            self.picture.pixels[start..start + cutting.width].copy_from_slice(line);
        }
    }
}

/// Start and end of a window along one axis.
fn span(start: i32, size: usize) -> (i64, i64) {
    (i64::from(start), i64::from(start) + size as i64)
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

/// What a compression is called.
pub fn compression_name(compression: Compression) -> &'static str {
    match compression {
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

/// Writes planes of f32 under their names, and text attributes, as an EXR file that every compositor reads: scanlines
/// from the top down, ZIP compressed.
pub fn write(
    path: &Path,
    [width, height]: [u32; 2],
    channels: Vec<(&str, Vec<f32>)>,
    attributes: &[(&str, String)],
) -> Result<()> {
    let channels = channels
        .into_iter()
        .map(|(name, values)| AnyChannel::new(name, FlatSamples::F32(values)))
        .collect();
    let mut layer_attributes = LayerAttributes::default();
    for (name, value) in attributes {
        let value = AttributeValue::Text(value.as_str().into());
        layer_attributes.other.insert((*name).into(), value);
    }
    let layer = Layer::new(
        Vec2(width as usize, height as usize),
        layer_attributes,
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(channels),
    );
    let image = exr::prelude::Image::from_layer(layer);
    write_whole(path, |file| {
        image.write().to_buffered(std::io::BufWriter::new(file)).map_err(Into::into)
    })
}
