//! The papers' plots, redrawn from our own numbers. A file a paper; each function gives a [`Plot`], which
//! holds its numbers.

mod deon;
mod hery;
mod pbrt;
mod xu;

use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};

use super::plot::Plot;
use crate::file::write_whole;
use crate::reference::adaptive::{Tolerance, integrate};

/// Hears what share is done, in [0, 1], and says whether to go on.
pub type Progress<'a> = &'a (dyn Fn(f32) -> bool + Sync);

/// A figure by its name.
pub struct Figure {
    /// What its files are called.
    pub name: &'static str,
    /// One line on what it shows.
    pub shows: &'static str,
    /// Its numbers; the error is "cancelled".
    pub plot: fn(Progress) -> Result<Plot>,
}

/// All figures, by paper and number.
pub static FIGURES: [Figure; 14] = [
    Figure {
        name: "deon_3",
        shows: "Gaussian M makes and loses light, M_p does neither",
        plot: deon::total_reflectance,
    },
    Figure {
        name: "deon_5",
        shows: "What R, TT, TRT and TRRT return of a white fibre's light",
        plot: deon::white_fibre,
    },
    Figure {
        name: "deon_6",
        shows: "N_TT with a detector that is wrapped round the circle, and one that is not",
        plot: deon::wrapped_detector,
    },
    Figure {
        name: "deon_9",
        shows: "Light through mixtures of the two melanins, by thickness",
        plot: deon::melanin_strips,
    },
    Figure {
        name: "deon_10",
        shows: "Colours of hair by melanin: one fibre, and a deep mass of them",
        plot: deon::melanin_grid,
    },
    Figure {
        name: "hery_1",
        shows: "Error of sampling R against sampling the light, by the width of R",
        plot: hery::error_by_width,
    },
    Figure {
        name: "hery_4",
        shows: "Error of sampling R, the light, and both, by the number of samples",
        plot: hery::error_by_samples,
    },
    Figure {
        name: "xu_3",
        shows: "Fits of N_TT, N_TRT and T against the exact ones, and what is integrated over θ_i",
        plot: xu::fits,
    },
    Figure {
        name: "xu_4",
        shows: "Eccentricity through η* against rays traced in an ellipse",
        plot: xu::eccentricity,
    },
    Figure {
        name: "xu_5",
        shows: "Error of the quadrature over θ_i by its number of segments",
        plot: xu::quadrature,
    },
    Figure {
        name: "pbrt_9_46",
        shows: "M_p: its peak lies off the specular cone",
        plot: pbrt::longitudinal,
    },
    Figure {
        name: "pbrt_9_52",
        shows: "Φ(p, h): where light that enters at h leaves",
        plot: pbrt::exit_azimuths,
    },
    Figure { name: "pbrt_9_53", shows: "The trimmed logistic", plot: pbrt::trimmed_logistic },
    Figure {
        name: "pbrt_9_54",
        shows: "N_TT round the fibre for two places on its width",
        plot: pbrt::azimuthal_lobes,
    },
];

/// Writes figures as NAME.svg, NAME.png and NAME.csv: those named, or all for no name.
///
/// Errors: a name that is none, a folder that is not there, "cancelled".
pub fn write(names: &[String], folder: &Path, progress: Progress) -> Result<()> {
    for name in names {
        let known = FIGURES.each_ref().map(|f| f.name);
        ensure!(
            known.contains(&name.as_str()),
            "{name}: no figure has this name; there are {}",
            known.join(", ")
        );
    }
    ensure!(folder.is_dir(), "{}: no such folder: make it first", folder.display());
    let wanted: Vec<&Figure> =
        FIGURES.iter().filter(|f| names.is_empty() || names.iter().any(|n| n == f.name)).collect();
    for (done, figure) in wanted.iter().enumerate() {
        let share = |of_this: f32| progress((done as f32 + of_this) / wanted.len() as f32);
        if !share(0.0) {
            bail!("cancelled");
        }
        let plot = (figure.plot)(&share)?;
        let svg = plot.svg();
        let bytes = |extension, bytes: &[u8]| {
            let path = folder.join(figure.name).with_extension(extension);
            write_whole(&path, |file| Ok(file.write_all(bytes)?))
        };
        let picture = plot.png(&svg).context(figure.name)?;
        bytes("png", &picture)?;
        bytes("svg", svg.as_bytes())?;
        bytes("csv", &plot.csv()?)?;
    }
    progress(1.0);
    Ok(())
}

/// ∫f over the breaks' range, to 1e-7.
fn integral(breaks: &[f64], f: impl Fn(f64) -> f64) -> f64 {
    let tolerance = Tolerance { relative: 1e-7, absolute: 1e-9 };
    integrate(breaks, tolerance, |x| [f(x)]).value[0]
}
