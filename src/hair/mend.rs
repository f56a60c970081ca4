//! Mending: after it every strand has two points or more, every step of a strand a direction, and every
//! value is finite and in range. What was done is counted, never silent.

use super::{Hair, length, median};
use glam::Vec3;

/// Coordinates from here on count as infinite: their squared distances overflow f32.
const COORDINATE_LIMIT: f32 = 1e18;

/// A step shorter than this share of its strand counts as a repeated point, since rounding decides its
/// direction. Relative to the strand, so that units do not matter; below the 1/65,535 of the longest strand
/// that `.hair` can hold with equal steps.
const SHORTEST_STEP: f64 = 1e-6;

/// Share of a strand's length, below which its two longest steps go to a stray point and back.
const STRAY_REST: f64 = 1e-3;

/// Colours up to 1 that are a little brighter than they should be end here.
const BRIGHTEST: f32 = 4.0;

/// What `mend` did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mended {
    /// Strands altered and kept.
    pub mended: usize,
    /// Strands removed.
    pub dropped: usize,
    /// One line for each kind of damage, with its count.
    pub notes: Vec<String>,
}

/// Removes points that are NaN, infinite or repeated, then strands of fewer than two points. Thickness that
/// is NaN, infinite or negative takes the value of the point before it in the strand (the first sound one,
/// at the root; that of the strand before, where a strand has none); so do colours and transparencies that
/// are NaN or infinite, and those out of range are clamped to 0…1; colours that run from 0 to 255 are divided by that
/// first. A thickness of 0 is left: tips end so.
/// An array without one sound value is removed.
pub fn mend(hair: &mut Hair) -> Mended {
    let strands = hair.strand_count();
    let mut altered = vec![false; strands];
    let mut notes = Vec::new();
    let mut note = |count: usize, what: &str| {
        if count > 0 {
            notes.push(format!("{count} {what}"));
        }
    };

    let mut thickness = hair.thickness.take();
    let bad =
        fill(hair, &mut thickness, &mut altered, |t| (t.is_finite() && t >= 0.0).then_some(t));
    note(
        bad,
        match &thickness {
            Some(_) => "thicknesses NaN, infinite or negative: neighbour's taken",
            None => {
                "thicknesses, which are all, NaN, infinite or negative: strands taper to 0.3 of their width at the tip"
            }
        },
    );
    let mut color = hair.color.take();
    if let Some(colors) = color.as_mut().filter(|colors| are_bytes(colors)) {
        colors.iter_mut().flatten().for_each(|c| *c /= 255.0);
        note(colors.len(), "colours from 0 to 255: taken as such");
    }
    let bad = fill(hair, &mut color, &mut altered, |c| {
        let sound = c.iter().all(|x| x.is_finite());
        sound.then_some(c.map(|x| x.clamp(0.0, 1.0)))
    });
    note(bad, "colours NaN, infinite or outside 0…1: neighbour's taken, or clamped");
    let mut transparency = hair.transparency.take();
    let bad =
        fill(hair, &mut transparency, &mut altered, |t| t.is_finite().then_some(t.clamp(0.0, 1.0)));
    note(bad, "transparencies NaN, infinite or outside 0…1: neighbour's taken, or clamped");

    let mut keep = vec![false; hair.points.len()];
    let mut offsets = vec![0];
    let mut kept = 0;
    let [mut unusable, mut repeated, mut dropped] = [0; 3];
    for (strand, altered) in hair.strands().zip(&mut altered) {
        let usable: Vec<usize> = strand.clone().filter(|&i| is_usable(hair.points[i])).collect();
        let points: Vec<Vec3> = usable.iter().map(|&i| hair.points[i]).collect();
        let shortest = SHORTEST_STEP * usual_length(&points);
        let mut last: Option<Vec3> = None;
        let before = kept;
        for (&i, &point) in usable.iter().zip(&points) {
            if last.is_none_or(|last| length(&[last, point]) > shortest) {
                last = Some(point);
                keep[i] = true;
                kept += 1;
            }
        }
        let left = (kept - before) as usize;
        unusable += strand.len() - usable.len();
        repeated += usable.len() - left;
        if left < 2 {
            keep[strand].fill(false);
            kept = before;
            dropped += 1;
            *altered = false;
        } else {
            offsets.push(kept);
            *altered |= left < strand.len();
        }
    }
    note(unusable, "points NaN, infinite or beyond 1e18: removed");
    note(repeated, "points repeated: merged");
    note(dropped, "strands of fewer than two points: dropped");

    if unusable + repeated + dropped > 0 {
        hair.offsets = offsets;
        retain(&mut hair.points, &keep);
        thickness.iter_mut().for_each(|values| retain(values, &keep));
        color.iter_mut().for_each(|values| retain(values, &keep));
        transparency.iter_mut().for_each(|values| retain(values, &keep));
    }
    hair.thickness = thickness;
    hair.color = color;
    hair.transparency = transparency;
    Mended { mended: altered.iter().filter(|&&a| a).count(), dropped, notes }
}

/// Length of a polyline but for two steps that are nearly all of it: those to a stray point and back.
fn usual_length(points: &[Vec3]) -> f64 {
    let mut steps: Vec<f64> = points.windows(2).map(length).collect();
    steps.sort_unstable_by(f64::total_cmp);
    let whole = steps.iter().sum::<f64>();
    let rest = steps.iter().rev().skip(2).sum::<f64>();
    if 0.0 < rest && rest < STRAY_REST * whole { rest } else { whole }
}

/// Whether colours run from 0 to 255: none is beyond, and most are too bright for colours up to 1, or all are whole.
fn are_bytes(colors: &[[f32; 3]]) -> bool {
    let finite = || colors.iter().flatten().copied().filter(|c| c.is_finite());
    let most = finite().fold(0.0, f32::max);
    let brightest = colors.iter().map(|c| c.iter().copied().fold(0.0, f32::max));
    finite().all(|c| (0.0..=255.0).contains(&c))
        && most > 1.0
        && (median(brightest) > BRIGHTEST || finite().all(|c| c.fract() == 0.0))
}

fn is_usable(point: Vec3) -> bool {
    // False for NaN too.
    point.abs().max_element() < COORDINATE_LIMIT && !point.is_nan()
}

/// Replaces each value by what `mended` makes of it, and where that is none by its neighbour's. Returns how
/// many values changed and marks their strands; takes the array away where no value is sound.
fn fill<T: Copy + PartialEq>(
    hair: &Hair,
    array: &mut Option<Vec<T>>,
    altered: &mut [bool],
    mended: impl Fn(T) -> Option<T>,
) -> usize {
    let Some(values) = array else { return 0 };
    let first_sound = |values: &[T]| values.iter().find_map(|&v| mended(v));
    let Some(mut near) = first_sound(values) else {
        return array.take().map_or(0, |values| values.len());
    };
    let mut changed = 0;
    for (strand, altered) in hair.strands().zip(altered) {
        near = first_sound(&values[strand.clone()]).unwrap_or(near);
        for value in &mut values[strand] {
            near = mended(*value).unwrap_or(near);
            if *value != near {
                *value = near;
                *altered = true;
                changed += 1;
            }
        }
    }
    changed
}

fn retain<T>(values: &mut Vec<T>, keep: &[bool]) {
    let mut keep = keep.iter();
    values.retain(|_| keep.next().is_some_and(|&k| k));
}
