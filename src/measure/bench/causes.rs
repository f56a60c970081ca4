//! Why a frame is not the truth: each cause by the exact part in its place alone.
//!
//! With F the frame, T the truth, and ‖·‖ `compare`'s norm relative to T:
//!
//! - light fit: T traced under the fitted lights, T_s. Alone ‖T_s−T‖, remaining ‖F−T_s‖.
//! - transmittance: that by many rays, evenly spread (`RealStrands::moments`); that to the grid of multiple scattering
//!   stays and is its own.
//! - scattering integral: single scattering of narrow lights by dense quadrature (shaders/exact.wgsl), of the sky by
//!   gathered paths.
//! - coverage: the traced share of hair and head in each pixel.
//!   For these three, with F′ the frame that has the exact part: alone ‖F−F′‖, remaining ‖F′−T‖.
//! - multiple scattering: what is left, ‖F*−T_s‖, when all the others are exact (F*). The light that the head
//!   sends into the hair, which frames have in part at most, is in it; so is what lies between shaded points.
//!   `single` says how much of it that is: the same with one scattering event alone on both sides.
//!
//! Noise of traced pictures is taken out by their variances. Errors alone do not add up to the whole: causes
//! of opposite sign cancel.

use anyhow::Result;
use serde::Serialize;

use super::images::{ALL, Asked, Lit, NONE, SINGLE, View};
use crate::field::Field;
use crate::gpu::frame::Parts;
use crate::gpu::method::MethodData;
use crate::measure::compare::compare;
use crate::measure::read::Picture;
use crate::progress::Clock;
use crate::reference::Models;

/// Names of [`Causes::parts`], in order.
pub const CAUSES: [&str; 5] =
    ["light fit", "coverage", "transmittance", "scattering integral", "multiple scattering"];

/// One cause of a frame's error. Both relative to the truth.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Cause {
    pub name: &'static str,
    /// The error that it makes alone.
    pub alone: f64,
    /// What remains with this part exact and all others as they are.
    pub remaining: Option<f64>,
}

/// All causes of one method's frame.
#[derive(Clone, Debug, Serialize)]
pub struct Causes {
    pub method: String,
    /// The frame's error as it is.
    pub whole: f64,
    pub parts: Vec<Cause>,
    /// One scattering event alone under the fitted lights: the frame as it is, and with T̃ and integrals exact.
    pub single: f64,
    pub single_exact: f64,
}

/// A picture to be taken apart.
pub(super) struct Subject<'a> {
    pub method: String,
    pub data: &'a MethodData,
    pub field: Option<&'a Field>,
    pub lit: &'a Lit<'a>,
    pub truth: &'a Picture,
    pub model: &'a OfModel,
}

/// What the methods of one model share: the truth under the fitted lights, and single scattering by exact integrals.
pub(super) struct OfModel {
    fitted: Picture,
    fitted_single: Picture,
    /// By the frame's T̃ and by the exact one; None where no shader has them.
    exact_single: Option<[Picture; 2]>,
}

impl OfModel {
    /// `exact`: the model's single scattering by dense quadrature; `field`: of the method that is judged. Leaves another method set in the view.
    pub fn new(
        view: &mut View,
        models: &Models,
        (exact, field): (Option<MethodData>, Option<&Field>),
        lit: &Lit,
        samples: u32,
        clock: &Clock,
    ) -> Result<OfModel> {
        let truth = |max_depth| {
            let asked = Asked { models, light: &lit.fitted, max_depth, seed: 2 };
            clock.watch("truth by lights", |progress| view.truth(&asked, samples, progress))
        };
        let (fitted, fitted_single) = (truth(u32::MAX)?, truth(1)?);
        let mut singles = None;
        if let Some(data) = exact {
            view.show(&lit.hair, &data, field)?;
            let by_transport = shot(view, SINGLE)?;
            view.show_exact(lit, &data, field)?;
            singles = Some([by_transport, shot(view, SINGLE)?]);
        }
        Ok(OfModel { fitted, fitted_single, exact_single: singles })
    }
}

fn shot(view: &mut View, parts: Parts) -> Result<Picture> {
    Ok(Picture::of_frame(&view.render(parts)?.0))
}

/// Finds the causes; the view keeps the method and lights of a frame.
pub(super) fn measure(view: &mut View, subject: &Subject) -> Result<Causes> {
    let Subject { ref method, data, field, lit, truth, model } = *subject;
    let OfModel { fitted, fitted_single, exact_single } = model;
    view.show_exact(lit, data, field)?;
    let by_rays = shot(view, ALL)?;
    let single_by_rays = shot(view, SINGLE)?;
    view.show(&lit.hair, data, field)?;
    let frame = shot(view, ALL)?;
    let single = shot(view, SINGLE)?;
    let head = shot(view, NONE)?;
    // Where no shader has the exact integrals, the method's own stand for them and the cause is nothing.
    let [exact_by_transport, single_exact] = match exact_single {
        Some([by_transport, by_rays]) => [by_transport, by_rays],
        None => [&single, &single_by_rays],
    };
    let by_integral = moved(&frame, exact_by_transport, &single);
    let by_both = moved(&by_rays, single_exact, &single_by_rays);

    // Coverage comes from the traced picture that the result is not judged by: noise that both share would be
    // taken for agreement.
    let covered = |frame: &Picture, by: &Picture| with_coverage(frame, &head, by);
    let error = |a: &Picture, b: &Picture| anyhow::Ok(compare(a, b)?.error());
    let swapped = |name, exact: &Picture| {
        anyhow::Ok(Cause {
            name,
            alone: error(&moved(truth, &frame, exact), &noiseless(truth))?,
            remaining: Some(error(exact, truth)?),
        })
    };
    let [light_fit, coverage, transmittance, integral, multiple] = CAUSES;
    Ok(Causes {
        method: method.clone(),
        whole: error(&frame, truth)?,
        parts: vec![
            Cause {
                name: light_fit,
                alone: error(fitted, truth)?,
                remaining: Some(error(&frame, fitted)?),
            },
            swapped(coverage, &covered(&frame, fitted))?,
            swapped(transmittance, &by_rays)?,
            swapped(integral, &by_integral)?,
            Cause {
                name: multiple,
                alone: error(&covered(&by_both, truth), fitted)?,
                remaining: None,
            },
        ],
        single: error(&single, fitted_single)?,
        single_exact: error(&covered(single_exact, truth), fitted_single)?,
    })
}

fn noiseless(picture: &Picture) -> Picture {
    Picture { variance: None, ..picture.clone() }
}

/// `whole` + `a` − `b`: with a part of it exchanged, or as far from it as they are from each other.
fn moved(whole: &Picture, a: &Picture, b: &Picture) -> Picture {
    let rgb = whole.rgb.iter().zip(&a.rgb).zip(&b.rgb);
    Picture {
        rgb: rgb.map(|((w, a), b)| [0, 1, 2].map(|c| w[c] + a[c] - b[c])).collect(),
        ..noiseless(whole)
    }
}

/// The frame with the truth's coverage by hair and by the head, each part's colour as it is; `head` is the head's
/// part alone.
fn with_coverage(frame: &Picture, head: &Picture, truth: &Picture) -> Picture {
    let plane = |plane: &Option<Vec<f32>>, i: usize| plane.as_ref().map_or(0.0, |plane| plane[i]);
    let part = |picture: &Picture, i: usize| {
        let hair = plane(&picture.hair, i);
        [hair, (plane(&picture.alpha, i) - hair).max(0.0)]
    };
    let rgb = (0..frame.rgb.len()).map(|i| {
        let (has, wanted) = (part(frame, i), part(truth, i));
        let scale = [0, 1].map(|k| if has[k] > 0.0 { wanted[k] / has[k] } else { 0.0 });
        let (all, skin) = (frame.rgb[i], head.rgb[i]);
        [0, 1, 2].map(|c| scale[0] * (all[c] - skin[c]) + scale[1] * skin[c])
    });
    Picture { rgb: rgb.collect(), ..noiseless(frame) }
}
