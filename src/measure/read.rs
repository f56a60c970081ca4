//! Linear pictures in: what `capture` and `reference` write, and EXR frames of other tools.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use exr::prelude::{FlatImage, Layer, ReadChannels, ReadLayers, read};

use crate::file::catch_panic;
use crate::gpu::frame::Frame;
use crate::reference::tracer::film::Film;

/// 16384 × 16384.
const MAX_PIXELS: usize = 1 << 28;

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
    /// Reads an EXR file of any channel order, sample type and number of layers: R, G and B, and where
    /// they are there A, `hair` and `variance.R`, `.G`, `.B`. Unnamed channels come before named layers
    /// (`ViewLayer.Combined.R`), of which the file's first with R, G and B is taken. The picture is the
    /// display window, 0 where there is no data.
    ///
    /// Errors, one line with the file's name: no EXR file, damaged, or a colour channel that is missing.
    /// NaN and infinity are read as they are.
    pub fn read(path: &Path) -> Result<Picture> {
        let mut picture = read_image(path)
            .and_then(|image| Picture::of(&image))
            .with_context(|| path.display().to_string())?;
        picture.name = match picture.name.as_str() {
            "" => path.display().to_string(),
            layer => format!("{} ({layer})", path.display()),
        };
        Ok(picture)
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

    /// The colour layer of a file; its name is the layer's.
    fn of(image: &FlatImage) -> Result<Picture> {
        let layers: Vec<Channels> = image.layer_data.iter().map(Channels::of).collect();
        let unnamed = layers.iter().filter_map(|layer| Some((layer, layer.colour("")?)));
        let named = layers.iter().flat_map(|layer| {
            layer.prefixes().filter_map(move |prefix| Some((layer, layer.colour(&prefix)?)))
        });
        let Some((layer, (prefix, rgb))) = unnamed.chain(named).next() else {
            let mut names: Vec<&str> =
                layers.iter().flat_map(|l| l.planes.keys().map(String::as_str)).collect();
            names.truncate(12);
            bail!("has no R, G and B to compare: its channels are {}", names.join(", "));
        };
        let window = Window::new(image, layer.source);
        let [width, height] = window.size;
        ensure!(
            width.checked_mul(height).is_some_and(|n| n <= MAX_PIXELS),
            "has {width} × {height} pixels, more than can be compared: crop it"
        );
        let plane = |name: &str| layer.planes.get(&format!("{prefix}{name}"));
        let variance = ["variance.R", "variance.G", "variance.B"].map(plane);
        Ok(Picture {
            name: [layer.name.as_str(), prefix.trim_end_matches('.')]
                .into_iter()
                .filter(|name| !name.is_empty())
                .collect::<Vec<_>>()
                .join("."),
            size: window.size,
            rgb: window.place(|i| rgb.map(|plane| plane[i])),
            alpha: plane("A").map(|plane| window.place(|i| plane[i])),
            hair: plane("hair").map(|plane| window.place(|i| plane[i])),
            variance: match variance {
                [Some(r), Some(g), Some(b)] => Some(window.place(|i| [r[i], g[i], b[i]])),
                _ => None,
            },
        })
    }
}

/// All of an EXR file. Errors, one line without the file's name: no EXR file, or damaged.
pub fn read_image(path: &Path) -> Result<FlatImage> {
    let bytes = std::fs::read(path)?;
    ensure!(
        bytes.starts_with(&exr::meta::magic_number::BYTES),
        "is no EXR file: compare linear frames, written with -o NAME.exr"
    );
    // The decoder panics on some damaged files.
    catch_panic(|| decode(&bytes))
        .map_err(|_| anyhow!("the decoder broke off"))
        .flatten()
        .map_err(|error| anyhow!("is damaged ({error}): write it again"))
}

fn decode(bytes: &[u8]) -> Result<FlatImage> {
    Ok(read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))?)
}

type ExrLayer = Layer<exr::prelude::AnyChannels<exr::prelude::FlatSamples>>;

/// The channels of one part of a file, by name.
struct Channels<'a> {
    source: &'a ExrLayer,
    name: String,
    planes: BTreeMap<String, Vec<f32>>,
}

impl<'a> Channels<'a> {
    fn of(source: &'a ExrLayer) -> Self {
        let name = source.attributes.layer_name.as_ref().map(ToString::to_string);
        let list = source.channel_data.list.iter();
        Channels {
            source,
            name: name.unwrap_or_default(),
            planes: list
                .map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect()))
                .collect(),
        }
    }

    /// Prefixes of channel names with their dot, those of variances left out.
    fn prefixes(&self) -> impl Iterator<Item = String> {
        self.planes
            .keys()
            .filter_map(|name| Some(format!("{}.", name.rsplit_once('.')?.0)))
            .filter(|prefix| !prefix.ends_with("variance."))
    }

    /// The prefix and its R, G and B.
    fn colour(&self, prefix: &str) -> Option<(String, [&Vec<f32>; 3])> {
        let plane = |name: &str| self.planes.get(&format!("{prefix}{name}"));
        Some((prefix.to_owned(), [plane("R")?, plane("G")?, plane("B")?]))
    }
}

/// Where a layer's data lies in the picture.
struct Window {
    size: [usize; 2],
    data_size: [usize; 2],
    /// The data's corner in the picture; may lie outside of it.
    corner: [i64; 2],
}

impl Window {
    fn new(image: &FlatImage, layer: &ExrLayer) -> Window {
        let display = image.attributes.display_window;
        let data = layer.attributes.layer_position;
        let apart = |data: i32, display: i32| i64::from(data) - i64::from(display);
        Window {
            size: [display.size.0, display.size.1],
            data_size: [layer.size.0, layer.size.1],
            corner: [apart(data.0, display.position.0), apart(data.1, display.position.1)],
        }
    }

    /// A value for each pixel of the picture, `at` the data's own index or the default.
    fn place<T: Default>(&self, at: impl Fn(usize) -> T) -> Vec<T> {
        let [width, height] = self.size;
        (0..width * height)
            .map(|i| {
                let x = (i % width) as i64 - self.corner[0];
                let y = (i / width) as i64 - self.corner[1];
                let inside = |v: i64, n: usize| usize::try_from(v).is_ok_and(|v| v < n);
                if inside(x, self.data_size[0]) && inside(y, self.data_size[1]) {
                    at(y as usize * self.data_size[0] + x as usize)
                } else {
                    T::default()
                }
            })
            .collect()
    }
}
