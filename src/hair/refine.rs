//! Points between those of a groom, so that light which changes along a strand has places enough to be kept at.

use glam::Vec3;

use super::Hair;
use super::curve::tangent;

/// A segment is divided into so many at most.
const MOST_PIECES: f32 = 8.0;

/// A groom, and where the points of its refined hair lie on it.
#[derive(Clone, Debug)]
pub struct Refined {
    pub groom: Hair,
    /// Of each point of the refined hair: the groom's point at or before it, and the share of the way to the next.
    pub places: Vec<(u32, f32)>,
}

/// Divides segments so that points are about `spacing` apart, on the cubic curve that segments are drawn as; farther apart
/// where there would be more than `most` points. None where the groom's own points are near enough.
pub fn refine(groom: &Hair, spacing: f32, most: usize) -> Option<(Hair, Refined)> {
    let mut spacing = spacing;
    let mut places = places(groom, spacing);
    while places.len() > most && places.len() > groom.points.len() {
        spacing *= 1.25;
        places = self::places(groom, spacing);
    }
    if places.len() == groom.points.len() {
        return None;
    }
    let mut hair = Hair { offsets: vec![0], ..Hair::default() };
    hair.points.reserve(places.len());
    let mut next = 0;
    for strand in groom.strands() {
        let own = &groom.points[strand.clone()];
        while next < places.len() && (places[next].0 as usize) < strand.end {
            let (first, s) = places[next];
            let i = first as usize - strand.start;
            hair.points.push(if s == 0.0 { own[i] } else { on_curve(own, i, s) });
            next += 1;
        }
        hair.offsets.push(next as u32);
    }
    hair.thickness = groom.thickness.as_deref().map(|all| between(all, &places, lerp));
    hair.transparency = groom.transparency.as_deref().map(|all| between(all, &places, lerp));
    hair.color = groom
        .color
        .as_deref()
        .map(|all| between(all, &places, |a, b, s| std::array::from_fn(|k| lerp(a[k], b[k], s))));
    Some((hair, Refined { groom: groom.clone(), places }))
}

/// Of each point of the refined hair.
fn places(groom: &Hair, spacing: f32) -> Vec<(u32, f32)> {
    let mut places = Vec::with_capacity(2 * groom.points.len());
    for strand in groom.strands() {
        for i in strand.clone() {
            places.push((i as u32, 0.0));
            if i + 1 < strand.end {
                let pieces = groom.points[i].distance(groom.points[i + 1]) / spacing;
                let pieces = pieces.round().clamp(1.0, MOST_PIECES) as u32;
                places.extend((1..pieces).map(|k| (i as u32, k as f32 / pieces as f32)));
            }
        }
    }
    places
}

/// The cubic Hermite curve from point `i` of a strand to the next (shaders/raster.wgsl).
fn on_curve(strand: &[Vec3], i: usize, s: f32) -> Vec3 {
    let (a, b) = (strand[i], strand[i + 1]);
    let chord = a.distance(b);
    let (u, v) = (chord * tangent(strand, i), chord * tangent(strand, i + 1));
    let r = 1.0 - s;
    r * r * (1.0 + 2.0 * s) * a + s * r * r * u + s * s * (3.0 - 2.0 * s) * b - s * s * r * v
}

/// Values of the groom's points at `places`.
fn between<T: Copy>(all: &[T], places: &[(u32, f32)], mix: impl Fn(T, T, f32) -> T) -> Vec<T> {
    let at = |&(first, s): &(u32, f32)| match s {
        0.0 => all[first as usize],
        s => mix(all[first as usize], all[first as usize + 1], s),
    };
    places.iter().map(at).collect()
}

fn lerp(a: f32, b: f32, s: f32) -> f32 {
    a + s * (b - a)
}
