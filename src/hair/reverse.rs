//! Strands that a file has from tip to root.
//!
//! Told by which ends lie on a head: on the one that is there, else on what may be one, which strands leave outward or down.

use super::{Hair, OnHead, length};
use glam::{DMat4, DVec3, DVec4, Vec3};

/// Share of the ends that lie on the head, at least and at most: roots, and ends that are none.
const ON_HEAD: f64 = 0.7;
const OFF_HEAD: f64 = 0.3;
/// Roots lie on a sphere but for so much of its radius (the median of all), and strands leave it outward, from so many of
/// them at least; of tips, from so many at most. Eight grooms have 0.03 to 0.08 and a share of 0.56 to 0.94, their tips 0.04 to
/// 0.22 and 0.13 to 0.79.
const ROUND: f64 = 0.15;
const OUTWARD: f64 = 0.7;
const INWARD: f64 = 0.5;
/// The sphere of roots is smaller, or fits them better than tips, of which this much is seen: where strands hang straight
/// down from a cap both ends are alike.
const SMALLER: f64 = 0.95;
const BETTER: f64 = 0.75;
const SEEN: f64 = 0.02;
/// And where strands rise, by this share of their length, the sphere of roots is as round as that, and smaller than that of
/// tips, as their spread is, but not by more than this: hair put up in a bun rises, to a much smaller one.
const RISING: f32 = 0.2;
const ROUNDER: f64 = 0.06;
const SMALLEST: f64 = 0.55;
/// Of fewer strands nothing is told.
const FEWEST: usize = 32;
/// Ends that are looked at, at most.
const ENDS: usize = 4096;

/// Turns every strand around, with all that its points have.
pub fn reverse(hair: &mut Hair) {
    let strands: Vec<_> = hair.strands().collect();
    for strand in strands {
        hair.points[strand.clone()].reverse();
        hair.thickness.iter_mut().for_each(|t| t[strand.clone()].reverse());
        hair.color.iter_mut().for_each(|c| c[strand.clone()].reverse());
        hair.transparency.iter_mut().for_each(|t| t[strand.clone()].reverse());
    }
}

/// Whether strands are stored from tip to root, where that is beyond doubt. `on_head` tells the share of points that lie
/// on the head, if there is one.
pub fn is_reversed(hair: &Hair, on_head: Option<OnHead>) -> bool {
    if hair.strand_count() < FEWEST {
        return false;
    }
    let strands: Vec<&[Vec3]> =
        hair.polylines().zip(hair.strays()).filter(|(_, stray)| !stray).map(|(s, _)| s).collect();
    let strands = || strands.iter().step_by(strands.len().div_ceil(ENDS).max(1));
    let ends = |last: bool| -> (Vec<Vec3>, Vec<Vec3>) {
        let end = |points: &&[Vec3]| {
            let at = |i: usize| if last { points[points.len() - 1 - i] } else { points[i] };
            (at(0), at(1) - at(0))
        };
        strands().map(end).unzip()
    };
    let (first, last) = (ends(false), ends(true));
    if let Some(on_head) = on_head {
        let (firsts, lasts) = (on_head(&first.0), on_head(&last.0));
        if firsts >= ON_HEAD || lasts >= ON_HEAD {
            return firsts <= OFF_HEAD;
        }
    }
    let (first, last) = (Ends::of(&first.0, &first.1), Ends::of(&last.0, &last.1));
    let rise = super::median(
        strands().map(|points| (points[points.len() - 1] - points[0]).y / length(points) as f32),
    );
    let smaller = |last: f64, first: f64| (SMALLEST..SMALLER).contains(&(last / first));
    let leave_it = last.off < ROUND
        && last.outward >= OUTWARD
        && first.outward <= INWARD
        && (last.radius < SMALLER * first.radius
            || first.off > SEEN && last.off < BETTER * first.off);
    let compact = last.off < ROUNDER
        && rise > RISING
        && smaller(last.radius, first.radius)
        && smaller(last.spread, first.spread);
    leave_it || compact
}

/// How ends of strands lie on the sphere that fits them best.
struct Ends {
    /// Median distance from it over its radius.
    off: f64,
    /// Share of strands that leave it outward.
    outward: f64,
    radius: f64,
    /// Median distance from their middle.
    spread: f64,
}

impl Ends {
    fn of(ends: &[Vec3], ways: &[Vec3]) -> Ends {
        let (middle, spread) = super::median_distance(ends.iter().copied());
        let places: Vec<DVec3> = ends
            .iter()
            .map(|&p| (p - middle).as_dvec3() / f64::from(spread.max(f32::MIN_POSITIVE)))
            .collect();
        let mut kept: Vec<DVec3> = places.clone();
        let mut fit = (DVec3::ZERO, 1.0);
        for _ in 0..3 {
            fit = sphere(&kept);
            let mut off: Vec<f64> = places.iter().map(|&p| distance(p, fit)).collect();
            let half = off.len() / 2;
            let median = *off.select_nth_unstable_by(half, f64::total_cmp).1;
            kept = places.iter().copied().filter(|&p| distance(p, fit) <= 3.0 * median).collect();
        }
        let (center, radius) = fit;
        let off = super::median(places.iter().map(|&p| (distance(p, fit) / radius) as f32));
        let outward =
            places.iter().zip(ways).filter(|(p, way)| (**p - center).dot(way.as_dvec3()) > 0.0);
        Ends {
            off: off.into(),
            outward: outward.count() as f64 / places.len() as f64,
            radius: radius * f64::from(spread),
            spread: spread.into(),
        }
    }
}

fn distance(p: DVec3, (center, radius): (DVec3, f64)) -> f64 {
    (p.distance(center) - radius).abs()
}

/// Centre and radius by linear least squares of |p|² = 2 c·p + (r² − |c|²).
fn sphere(places: &[DVec3]) -> (DVec3, f64) {
    let (mut matrix, mut sum) = (DMat4::ZERO, DVec4::ZERO);
    for &p in places {
        let row = (2.0 * p).extend(1.0);
        matrix += DMat4::from_cols(row * row.x, row * row.y, row * row.z, row * row.w);
        sum += p.length_squared() * row;
    }
    let solved = matrix.inverse() * sum;
    let center = solved.truncate();
    let radius = (solved.w + center.length_squared()).max(0.0).sqrt();
    match center.is_finite() && radius > 0.0 {
        true => (center, radius),
        false => (DVec3::ZERO, 1.0),
    }
}
