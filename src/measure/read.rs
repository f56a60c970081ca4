//! Linear pictures in: what `capture` and `reference` write, and EXR frames of other tools.

use std::path::Path;

use anyhow::{Context, Result, ensure};

use crate::file::read_picture_bytes;
use crate::gpu::frame::Frame;
use crate::openexr::{ExrFile, MAGIC};
use crate::reference::tracer::film::Film;

/// A linear picture, row by row from the top left.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// What messages and reports call it: its file's name, and its layer where that has a name.
    pub name: String,
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Radiance, premultiplied by coverage.
    pub rgb: Vec<[f32; 3]>,
    /// Coverage by anything, 0…1.
    pub alpha: Option<Vec<f32>>,
    /// Coverage by hair, 0…1.
    pub hair: Option<Vec<f32>>,
    /// Variance of each pixel's mean, the square of its standard error.
    pub variance: Option<Vec<[f32; 3]>>,
}

impl Picture {
    /// Reads an EXR file as [`crate::openexr`] does: the colour of the layer of this name, or of the finished picture,
    /// and beside it where they are there A, `hair` and `variance.R`, `.G`, `.B`. `flag` is what names a layer.
    ///
    /// Errors, one line with the file's name: no EXR file, or those of [`ExrFile`]. NaN and infinity are read as they
    /// are.
    pub fn read_layer(path: &Path, layer: Option<&str>, flag: &str) -> Result<Picture> {
        let read = || -> Result<Picture> {
            let bytes = read_picture_bytes(path)?;
            ensure!(
                bytes.starts_with(&MAGIC),
                "is no EXR file: compare linear frames, written with -o NAME.exr"
            );
            let file = ExrFile::open(&bytes)?;
            let layer = file.choose(layer, flag)?;
            let beside = ["A", "hair", "variance.R", "variance.G", "variance.B"];
            let [a, hair, variance @ ..] =
                beside.map(|name| file.channel(layer.part, &format!("{}{name}", layer.prefix)));
            let [r, g, b] = layer.rgb.map(Some);
            let [vr, vg, vb] = variance;
            let planes = file.pixels(layer.part, [r, g, b, a, hair, vr, vg, vb])?;
            let plane = |there: Option<usize>, k: usize| {
                there.map(|_| planes.pixels.iter().map(|p| p[k]).collect())
            };
            let triple = |k: usize| planes.pixels.iter().map(move |p| [p[k], p[k + 1], p[k + 2]]);
            Ok(Picture {
                name: match layer.name.as_str() {
                    "" => path.display().to_string(),
                    layer => format!("{} ({layer})", path.display()),
                },
                size: [planes.width, planes.height],
                rgb: triple(0).collect(),
                alpha: plane(a, 3),
                hair: plane(hair, 4),
                variance: variance.iter().all(Option::is_some).then(|| triple(5).collect()),
            })
        };
        read().with_context(|| path.display().to_string())
    }

    /// [`Self::read_layer`] of the finished picture.
    pub fn read(path: &Path) -> Result<Picture> {
        Self::read_layer(path, None, "a layer's name")
    }

    /// What a path-traced film holds.
    pub fn of_film(film: &Film, name: &str) -> Picture {
        let count = 0..film.pixels.len();
        let mean: Vec<[f64; 4]> = count.clone().map(|i| film.mean(i)).collect();
        Picture {
            name: name.to_owned(),
            size: film.size.map(|n| n as usize),
            rgb: mean.iter().map(|p| [0, 1, 2].map(|c| p[c] as f32)).collect(),
            alpha: Some(mean.iter().map(|p| p[3] as f32).collect()),
            hair: Some(count.clone().map(|i| film.hair_coverage(i) as f32).collect()),
            variance: Some(count.map(|i| film.variance(i).map(|v| v as f32)).collect()),
        }
    }

    pub fn of_frame(frame: &Frame) -> Picture {
        Picture {
            name: "the frame".to_owned(),
            size: frame.size.map(|n| n as usize),
            rgb: frame.pixels.iter().map(|&[r, g, b, _]| [r, g, b]).collect(),
            alpha: Some(frame.pixels.iter().map(|p| p[3]).collect()),
            hair: Some(frame.hair_coverage.clone()),
            variance: None,
        }
    }
}
