//! How wide a fibre is, where the user does not say.
//!
//! Files give widths in units and with meanings of their own (or leave their tool's default), so the
//! diameter is fitted to the groom: real hairs of 80 µm on a real scalp, thicker where a file has fewer
//! strands than a scalp has hairs, so that as much of the scalp and the light is covered. A file's thickness
//! array serves as a profile along the strands.

use super::{Hair, length, median, median_distance, quantile};

/// Hairs on a human scalp.
const REAL_STRANDS: f64 = 100_000.0;
/// Diameter of a human hair in metres.
const REAL_DIAMETER: f64 = 80e-6;
/// Bounds of diameter over the real one: fine hair is 40 µm; beyond 6 (0.48 mm) fibres look like wire.
const DIAMETER_RATIO: [f64; 2] = [0.5, 6.0];

/// Median distance of the roots from their middle in metres: √3/2 of the radius for an evenly covered
/// hemisphere, here of 0.097 m. Six grooms made in metres have 0.080 to 0.087.
const ROOT_DISTANCE: f64 = 0.084;
/// The longest hair to expect, in metres: bounds the metre where the roots lie close together.
const LONGEST: f64 = 1.0;

/// Share of the strand's length, at its tip, over which it tapers where no thickness array says so.
const TAPER_LENGTH: f64 = 0.2;
/// What the taper leaves at the tip.
const TAPER_TIP: f64 = 0.3;
/// Below this no profile falls: a ribbon of no width has no normal and no cover.
const NARROWEST: f32 = 0.05;

/// A fibre diameter and where it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Diameter {
    /// In the hair's unit.
    pub diameter: f32,
    /// One line for a report.
    pub reason: String,
}

/// The length of a metre in the hair's unit, judged by how far the roots spread over the scalp, or by the
/// median strand's length where that makes the metre longer (a wisp, a single strand). Insensitive to
/// strays. 0 for no hair.
pub fn metre(hair: &Hair) -> f32 {
    let roots = hair.polylines().filter_map(|points| points.first());
    let (_, root_distance) = median_distance(roots.copied());
    let strand_length = median(hair.polylines().map(|points| length(points) as f32));
    (root_distance / ROOT_DISTANCE as f32).max(strand_length / LONGEST as f32)
}

/// The diameter to draw and shade fibres with: 80 µm · (100,000 / strands), which keeps the projected area
/// of a full scalp, within 0.5 to 6 times 80 µm, in the hair's unit by `metre`.
pub fn fibre_diameter(hair: &Hair) -> Diameter {
    let strands = hair.strand_count().max(1);
    let metre = metre(hair);
    let [thinnest, thickest] = DIAMETER_RATIO;
    let ratio = (REAL_STRANDS / strands as f64).clamp(thinnest, thickest);
    let diameter = (REAL_DIAMETER * ratio * f64::from(metre)) as f32;
    let reason = format!(
        "{ratio:.2} × 80 µm, for {strands} strands instead of a scalp's 100000, at {metre:.4} units a metre"
    );
    Diameter { diameter, reason }
}

/// Width at each point as a share (0.05…1) of the fibre diameter: the thickness array over the 95th
/// percentile of its strands' maxima; without one (or one of zeros) 1, falling linearly to 0.3 over the last
/// 20 % of the strand's length.
pub fn width_profile(hair: &Hair) -> Vec<f32> {
    if let Some(thickness) = &hair.thickness {
        let maxima =
            hair.strands().map(|range| thickness[range].iter().copied().fold(0.0, f32::max));
        let full = quantile(maxima, 0.95);
        if full > 0.0 {
            return thickness.iter().map(|t| (t / full).clamp(NARROWEST, 1.0)).collect();
        }
    }
    let mut profile = Vec::with_capacity(hair.points.len());
    for points in hair.polylines() {
        let whole = length(points);
        let mut left = whole;
        for (i, point) in points.iter().enumerate() {
            if i > 0 {
                left -= length(&[points[i - 1], *point]);
            }
            let from_tip = (left / (TAPER_LENGTH * whole)).clamp(0.0, 1.0);
            profile.push((TAPER_TIP + (1.0 - TAPER_TIP) * from_tip) as f32);
        }
    }
    profile
}
