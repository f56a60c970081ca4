//! The brush: from a place on the screen to paint on strand points.

use glam::Vec3;
use half::f16;
use rayon::prelude::*;

use super::history::Texels;
use crate::paint::{Channel, Layer, Paint};
use crate::scene::Lens;
use crate::stage::Geometry;

/// What a dab does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Puts the value there at the brush's strength.
    Set,
    /// Brings what is there nearer to the value, dab by dab.
    Blend,
    /// Brings what is there nearer to its mean under the brush.
    Smooth,
    /// Uncovers the scene's own.
    Erase,
}

impl Mode {
    pub const ALL: [Self; 4] = [Self::Set, Self::Blend, Self::Smooth, Self::Erase];

    pub fn word(self) -> &'static str {
        ["Set", "Blend", "Smooth", "Erase"][self as usize]
    }
}

/// How the brush fades towards its rim.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Falloff {
    Smooth,
    Linear,
    Hard,
}

impl Falloff {
    pub const ALL: [Self; 3] = [Self::Smooth, Self::Linear, Self::Hard];

    pub fn word(self) -> &'static str {
        ["Smooth", "Linear", "Hard"][self as usize]
    }

    /// 1 in the middle (0), 0 at the rim (1).
    fn at(self, distance: f32) -> f32 {
        let left = (1.0 - distance).clamp(0.0, 1.0);
        match self {
            Self::Smooth => left * left * (3.0 - 2.0 * left),
            Self::Linear => left,
            Self::Hard => f32::from(left > 0.0),
        }
    }
}

/// Which points under the brush are painted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// Those at the front of what is there.
    Front,
    /// All of them.
    Through,
    /// Those of every strand that is at the front under the brush, root to tip.
    Strands,
}

impl Reach {
    pub const ALL: [Self; 3] = [Self::Front, Self::Through, Self::Strands];

    pub fn word(self) -> &'static str {
        ["Visible front", "Through", "Whole strands"][self as usize]
    }
}

/// How paint is put on.
#[derive(Clone, Debug, PartialEq)]
pub struct Brush {
    pub channel: Channel,
    /// In the channel's own numbers: √σ_a, degrees, ….
    pub value: [f32; 3],
    /// Of the picture's height.
    pub radius: f32,
    /// 0 to 1.
    pub strength: f32,
    /// From dab to dab, in radii.
    pub spacing: f32,
    pub falloff: Falloff,
    pub mode: Mode,
    pub reach: Reach,
    /// Weight at the root and at the tip of a strand, 0 to 1.
    pub gradient: [f32; 2],
    /// The same on the other side of x = the hair's middle.
    pub mirror: bool,
}

impl Default for Brush {
    fn default() -> Self {
        Self {
            channel: Channel::Absorption,
            value: [0.2, 0.9, 1.2],
            radius: 0.06,
            strength: 1.0,
            spacing: 0.25,
            falloff: Falloff::Smooth,
            mode: Mode::Set,
            reach: Reach::Front,
            gradient: [1.0; 2],
            mirror: false,
        }
    }
}

impl Brush {
    /// The absorption that its value is the root of, per radius, linear RGB: of a brush for absorption.
    pub fn sigma_a(&self) -> [f64; 3] {
        self.value.map(|root| f64::from(root).powi(2))
    }
}

/// Where strand points are in a picture: x and y in its heights from its upper left corner, y down; points behind the
/// camera are nowhere.
pub struct Places {
    at: Vec<[f32; 2]>,
    mirrored: Vec<[f32; 2]>,
    lens: Lens,
    /// Whether the point lies at the front of what is there, hair or head.
    front: Vec<bool>,
}

const NOWHERE: [f32; 3] = [f32::INFINITY; 3];
/// Cells along a picture's height in which the nearest of hair and head is looked for.
const FRONT_CELLS: f32 = 96.0;
/// How far behind the nearest a point still is at the front, in radii of the hair.
const FRONT_DEPTH: f32 = 0.06;

impl Places {
    /// Of a picture through `lens`.
    pub fn new(stage: &Geometry, lens: &Lens) -> Self {
        let (width, height) = (lens.right.length() / lens.up.length(), 1.0);
        // x, y and depth.
        let place = |p: Vec3| {
            let to = p.as_dvec3() - lens.eye;
            let depth = to.dot(lens.forward);
            if depth <= 1e-9 {
                return NOWHERE;
            }
            let x = to.dot(lens.right) / (lens.right.length_squared() * depth);
            let y = to.dot(lens.up) / (lens.up.length_squared() * depth);
            [0.5 * (1.0 + x) * width, 0.5 * (1.0 - y) * height, depth].map(|v| v as f32)
        };
        let points = &stage.groom().points;
        let seen_at = |sign: Vec3| -> Vec<[f32; 3]> {
            points.par_iter().map(|&p| place(sign * (p - stage.center))).collect()
        };
        let (at, mirrored) = (seen_at(Vec3::ONE), seen_at(Vec3::new(-1.0, 1.0, 1.0)));
        let cell = (height as f32 / FRONT_CELLS).max(1e-3);
        let columns = (width as f32 / cell).ceil() as usize + 1;
        let rows = FRONT_CELLS as usize + 1;
        let cell_of = |[x, y, _]: [f32; 3]| {
            let inside = x >= 0.0 && y >= 0.0 && x <= width as f32 && y <= height as f32;
            inside.then(|| ((y / cell) as usize).min(rows - 1) * columns + (x / cell) as usize)
        };
        let mut nearest = vec![f32::INFINITY; columns * rows];
        let head = stage.head.iter().flat_map(|head| &head.positions);
        let of_head = head.map(|&p| place(p - stage.center));
        for p in at.iter().copied().chain(of_head) {
            if let Some(i) = cell_of(p) {
                nearest[i] = nearest[i].min(p[2]);
            }
        }
        let behind = FRONT_DEPTH * stage.radius;
        let front = at.iter().map(|&p| {
            cell_of(p).is_some_and(|i| {
                // Of the cells beside it too: hair has gaps.
                let (x, y) = (i % columns, i / columns);
                let beside = (y.saturating_sub(1)..=(y + 1).min(rows - 1)).flat_map(|y| {
                    (x.saturating_sub(1)..=(x + 1).min(columns - 1)).map(move |x| y * columns + x)
                });
                let near = |i: &usize| nearest[*i] < p[2] - behind;
                // A front that most cells around have hides what is behind it.
                p[2] <= nearest[i] + behind && beside.filter(near).count() < 6
            })
        });
        let front = front.collect();
        let flat = |places: Vec<[f32; 3]>| places.into_iter().map(|[x, y, _]| [x, y]).collect();
        Self { front, at: flat(at), mirrored: flat(mirrored), lens: *lens }
    }

    /// Whether they are those of a picture through `lens`, whatever its size.
    pub fn are_through(&self, lens: &Lens) -> bool {
        Lens { size: self.lens.size, ..*lens } == self.lens
    }
}

/// What is painted on, as the pointer meets it.
pub struct Canvas<'a> {
    pub places: &'a Places,
    pub stage: &'a Geometry,
    /// What the scene itself has of the brush's channel.
    pub bare: [f32; 3],
}

/// A stroke under way: what its points were like before it.
pub struct Stroke {
    brush: Brush,
    /// By point; NaN weight where it was not touched.
    before: Vec<[f16; 4]>,
    /// The greatest share of the brush that each point has had, so that dabs of one stroke do not add up.
    most: Vec<f32>,
    last: Option<[f32; 2]>,
}

impl Stroke {
    pub fn new(brush: &Brush, points: usize) -> Self {
        Self {
            brush: brush.clone(),
            before: vec![[f16::NAN; 4]; points],
            most: vec![0.0; points],
            last: None,
        }
    }

    /// Goes on to a place (see [`Places`]), with `pressure` 0 to 1; whether anything was painted.
    pub fn to(
        &mut self,
        place: [f32; 2],
        pressure: f32,
        canvas: &Canvas,
        paint: &mut Paint,
    ) -> bool {
        let step = (self.brush.spacing * self.brush.radius).max(1e-3);
        let from = self.last.unwrap_or(place);
        let way = [place[0] - from[0], place[1] - from[1]];
        let length = way[0].hypot(way[1]);
        if self.last.is_some() && length < step {
            return false;
        }
        let dabs = (length / step).floor().max(1.0) as usize;
        let mut painted = false;
        for dab in 1..=dabs {
            let f = dab as f32 / dabs as f32;
            painted |=
                self.dab([from[0] + f * way[0], from[1] + f * way[1]], pressure, canvas, paint);
        }
        self.last = Some(place);
        painted
    }

    fn dab(&mut self, at: [f32; 2], pressure: f32, canvas: &Canvas, paint: &mut Paint) -> bool {
        let &Canvas { places, stage, bare } = canvas;
        let brush = &self.brush;
        let radius = brush.radius;
        let share = |p: &[f32; 2]| {
            let distance = (p[0] - at[0]).hypot(p[1] - at[1]) / radius;
            if distance < 1.0 { brush.falloff.at(distance) } else { 0.0 }
        };
        let of = |i: usize| {
            let own = share(&places.at[i]);
            if brush.mirror { own.max(share(&places.mirrored[i])) } else { own }
        };
        let shown = |i: usize| brush.reach == Reach::Through || places.front[i] || brush.mirror;
        let mut touched: Vec<(usize, f32)> = (0..places.at.len())
            .into_par_iter()
            .filter_map(|i| Some((i, of(i))).filter(|&(i, share)| share > 0.0 && shown(i)))
            .collect();
        if brush.reach == Reach::Strands {
            touched = whole_strands(stage, &touched);
        }
        let even = brush.gradient == [1.0; 2];
        if !even {
            along_strands(stage, &mut touched, brush.gradient);
        }
        touched.retain(|&(_, share)| share > 0.0);
        if touched.is_empty() {
            return false;
        }
        let layer = paint.layer_mut(brush.channel);
        let mean = {
            let sum = touched.iter().fold([0.0f32; 4], |sum, &(i, share)| {
                let v = layer.over(i, bare);
                [0, 1, 2, 3].map(|k| sum[k] + share * if k < 3 { v[k] } else { 1.0 })
            });
            [0, 1, 2].map(|k| sum[k] / sum[3].max(f32::MIN_POSITIVE))
        };
        for (i, share) in touched {
            let amount = share * brush.strength * pressure;
            if self.before[i][3].is_nan() {
                self.before[i] = layer.texel(i);
            }
            let before = self.before[i].map(f16::to_f32);
            let (value, weight) = layer.at(i);
            match brush.mode {
                Mode::Set | Mode::Erase => {
                    self.most[i] = self.most[i].max(amount);
                    let most = self.most[i];
                    let (value, weight) = ([before[0], before[1], before[2]], before[3]);
                    if brush.mode == Mode::Erase {
                        layer.set(i, value, weight * (1.0 - most));
                    } else {
                        let (value, weight) = over(value, weight, brush.value, most);
                        layer.set(i, value, weight);
                    }
                }
                Mode::Blend => {
                    let (value, weight) = over(value, weight, brush.value, 0.3 * amount);
                    layer.set(i, value, weight);
                }
                Mode::Smooth => {
                    let (value, weight) = over(value, weight, mean, 0.5 * amount);
                    layer.set(i, value, weight);
                }
            }
        }
        true
    }

    /// What it did, as a step of the history; None where it did nothing.
    pub fn step(self, paint: &Paint) -> Option<super::history::Step> {
        let Brush { channel, mode, .. } = self.brush;
        let layer = paint.layer(channel)?;
        let touched = self.before.iter().enumerate().filter(|(_, texel)| !texel[3].is_nan());
        let before: Texels = touched.map(|(i, texel)| (i as u32, *texel)).collect();
        let after = before.iter().map(|&(i, _)| (i, layer.texel(i as usize))).collect();
        let label = format!("{} {}", mode.word().to_lowercase(), channel.name());
        (!before.is_empty()).then_some(super::history::Step::Stroke {
            label,
            channel,
            before,
            after,
        })
    }
}

/// `amount` of `value` over what is there.
fn over(there: [f32; 3], weight: f32, value: [f32; 3], amount: f32) -> ([f32; 3], f32) {
    let total = weight + amount * (1.0 - weight);
    if total <= 0.0 {
        return (there, 0.0);
    }
    // What is covered of the old shows through by its own weight.
    let old = weight * (1.0 - amount) / total;
    ([0, 1, 2].map(|k| old * there[k] + (1.0 - old) * value[k]), total)
}

/// Every point of the strands that are touched, with the greatest share of any.
fn whole_strands(stage: &Geometry, touched: &[(usize, f32)]) -> Vec<(usize, f32)> {
    let offsets = &stage.groom().offsets;
    let mut all: Vec<(usize, f32)> = Vec::new();
    let mut k = 0;
    while k < touched.len() {
        let strand = offsets.partition_point(|&first| first as usize <= touched[k].0) - 1;
        let range = offsets[strand] as usize..offsets[strand + 1] as usize;
        let mut most = 0.0f32;
        while k < touched.len() && range.contains(&touched[k].0) {
            most = most.max(touched[k].1);
            k += 1;
        }
        all.extend(range.map(|i| (i, most)));
    }
    all
}

/// Multiplies each share by what a gradient from root to tip has there.
fn along_strands(stage: &Geometry, touched: &mut [(usize, f32)], [root, tip]: [f32; 2]) {
    let offsets = &stage.groom().offsets;
    for (i, share) in touched {
        let strand = offsets.partition_point(|&first| first as usize <= *i) - 1;
        let (first, end) = (offsets[strand] as usize, offsets[strand + 1] as usize);
        let t = (*i - first) as f32 / (end - first).saturating_sub(1).max(1) as f32;
        *share *= root + t * (tip - root);
    }
}

/// The value that shows at the point nearest to a place, within a radius (see [`Places`]).
pub fn pick(
    place: [f32; 2],
    radius: f32,
    places: &Places,
    layer: Option<&Layer>,
    bare: [f32; 3],
) -> Option<[f32; 3]> {
    let away = |i: &usize| {
        let p = places.at[*i];
        (p[0] - place[0]).hypot(p[1] - place[1])
    };
    let front = (0..places.at.len()).filter(|&i| places.front[i]);
    let nearest = front.min_by(|a, b| away(a).total_cmp(&away(b))).filter(|i| away(i) <= radius)?;
    Some(layer.map_or(bare, |layer| layer.over(nearest, bare)))
}
