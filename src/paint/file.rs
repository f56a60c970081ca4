//! Paint as a file, `.paint`: beside the scene that names it, for the groom that it was painted on.
//!
//! Little-endian. `HLPAINT` and a version byte; the groom's hash (32 bytes); points and layers (u32 each); a hash of
//! what follows (32 bytes); then, deflated (zlib), each layer: its channel's place (one byte), and plane by plane
//! the halves of its values and weights.

use std::io::{Read, Write};
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use flate2::{Compression, read::ZlibDecoder, write::ZlibEncoder};
use half::f16;

use super::{Channel, Layer, Paint};
use crate::file::write_whole;
use crate::file_kind::{FileKind, Role};
use crate::hair::Hair;

/// The first bytes of a `.paint` file.
pub const MAGIC: &[u8; 7] = b"HLPAINT";
const VERSION: u8 = 1;
const HASH: usize = blake3::OUT_LEN;
const HEAD: usize = MAGIC.len() + 1 + HASH + 8 + HASH;

/// What paint belongs to: strands and their places.
fn identity(hair: &Hair) -> [u8; HASH] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(bytemuck::cast_slice(&hair.offsets));
    hasher.update(bytemuck::cast_slice(&hair.points));
    *hasher.finalize().as_bytes()
}

impl Paint {
    /// Writes the file, whole or not at all.
    pub fn write(&self, path: &Path, hair: &Hair) -> Result<()> {
        let bytes = self.encode(hair).with_context(|| path.display().to_string())?;
        write_whole(path, |file| Ok(file.write_all(&bytes)?))
    }

    /// Reads paint for `hair`.
    ///
    /// # Errors
    /// One line that names the file: it cannot be read, is no paint, is damaged, or is of another groom.
    pub fn read(path: &Path, hair: &Hair) -> Result<Paint> {
        let attempt = || Self::decode(&std::fs::read(path).context("cannot be read")?, hair);
        attempt().with_context(|| path.display().to_string())
    }

    fn encode(&self, hair: &Hair) -> Result<Vec<u8>> {
        ensure!(
            self.points == hair.points.len(),
            "the paint is of other hair: save again in a moment"
        );
        let mut packer = ZlibEncoder::new(Vec::new(), Compression::default());
        for layer in self.layers() {
            packer.write_all(&[layer.channel as u8])?;
            let row = layer.channel.width() + 1;
            for k in 0..row {
                let plane: Vec<u16> =
                    layer.texels.iter().skip(k).step_by(row).map(|v| v.to_bits()).collect();
                packer.write_all(bytemuck::cast_slice(&plane))?;
            }
        }
        let packed = packer.finish()?;
        let mut bytes = Vec::with_capacity(HEAD + packed.len());
        bytes.extend(MAGIC);
        bytes.push(VERSION);
        bytes.extend(identity(hair));
        bytes.extend((self.points as u32).to_le_bytes());
        bytes.extend((self.layers().len() as u32).to_le_bytes());
        bytes.extend(blake3::hash(&packed).as_bytes());
        bytes.extend(packed);
        Ok(bytes)
    }

    fn decode(bytes: &[u8], hair: &Hair) -> Result<Paint> {
        ensure!(bytes.starts_with(MAGIC), FileKind::of(bytes).refusal(Role::Paint));
        let version = bytes.get(MAGIC.len()).copied().unwrap_or(0);
        ensure!(
            version == VERSION,
            "is paint of version {version}; this Hairlight reads version {VERSION}: use the one that wrote it"
        );
        ensure!(bytes.len() > HEAD, "is cut short: copy it again");
        let (head, packed) = bytes.split_at(HEAD);
        let (groom, rest) = head[MAGIC.len() + 1..].split_at(HASH);
        let count = |at: usize| {
            u32::from_le_bytes([rest[at], rest[at + 1], rest[at + 2], rest[at + 3]]) as usize
        };
        let (points, layers) = (count(0), count(4));
        ensure!(
            points == hair.points.len(),
            "was painted on another groom, of {points} points; this one has {}: name the groom it belongs to",
            hair.points.len()
        );
        ensure!(
            groom == identity(hair),
            "was painted on another groom of {points} points (or another length, scale or up axis): name the one it \
             belongs to"
        );
        ensure!(rest[8..] == *blake3::hash(packed).as_bytes(), "is damaged: copy it again");
        ensure!(
            layers <= Channel::ALL.len(),
            "has more layers than there are channels: copy it again"
        );
        let mut planes = ZlibDecoder::new(packed);
        let mut paint = Paint::bare(points);
        for _ in 0..layers {
            let mut place = [0];
            planes.read_exact(&mut place)?;
            let Some(&channel) = Channel::ALL.get(usize::from(place[0])) else {
                bail!("has a channel that this Hairlight does not know");
            };
            let mut layer = Layer::new(channel, points);
            let row = channel.width() + 1;
            let mut plane = vec![0; 2 * points];
            for k in 0..row {
                planes.read_exact(&mut plane)?;
                let (halves, _) = plane.as_chunks::<2>();
                let values = halves.iter().map(|&bytes| f16::from_le_bytes(bytes));
                for (texel, value) in layer.texels.iter_mut().skip(k).step_by(row).zip(values) {
                    *texel = value;
                }
            }
            for point in 0..points {
                let (value, weight) = layer.at(point);
                ensure!(
                    weight.is_finite() && value.iter().all(|v| v.is_finite()),
                    "has numbers that are not finite: paint it anew"
                );
                layer.set(point, value, weight);
            }
            *paint.layer_mut(channel) = layer;
        }
        Ok(paint)
    }
}
