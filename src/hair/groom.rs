//! Builtin grooms: strands grown on the builtin head, in metres.
//!
//! The usual way of a grooming tool. Some hundred guides are grown by integrating a direction that
//! starts along the comb and turns to gravity, held off the skin, the shoulders and the face. Each
//! strand blends the three nearest guides that are combed alike, is drawn towards the centres of
//! its lock and of its wisp (two levels of clumping, stronger towards the tip), waved with a phase
//! shared by the lock, and strays a little; a few strands are flyaways. Hair rides higher over the
//! skin the farther it has travelled over it, so that strands from the parting lie on those from
//! the sides.
//!
//! Every random number is a hash of (seed, purpose, index), so a groom depends on its options
//! alone, not on threads. Roots follow the R2 low-discrepancy sequence (Roberts 2018), jittered,
//! thinned to the scalp.

use super::Hair;
use crate::head::builtin::{HEAD_BOUNDS, head_distance, scalp_depth};
use anyhow::{Result, bail};
use glam::{Vec3, vec3};
use rayon::prelude::*;
use std::f32::consts::TAU;
use std::ops::RangeInclusive;
use std::sync::OnceLock;

/// Names of the builtin grooms.
pub const STYLES: [&str; 5] = ["straight", "wavy", "curly", "bob", "ponytail"];

const STRANDS: RangeInclusive<usize> = 1_000..=200_000;

/// What can be changed about a builtin groom.
#[derive(Clone, Debug, PartialEq)]
pub struct GroomOptions {
    /// Number of strands, 1,000 to 200,000; 20,000 unless said.
    pub strands: usize,
    /// Grooms of different seeds differ in every strand.
    pub seed: u64,
    /// Multiplier of the style's own length, 0.2 to 2.
    pub length: f32,
    /// Multiplier of the style's own wave or curl, 0 to 2.
    pub curl: f32,
    /// How closely strands gather into locks at the tip, 0 to 1; the style's own unless said.
    pub clump: Option<f32>,
    /// Share of strands that stray, 0 to 1; the style's own unless said.
    pub flyaway: Option<f32>,
}

impl Default for GroomOptions {
    fn default() -> Self {
        Self { strands: 20_000, seed: 1, length: 1.0, curl: 1.0, clump: None, flyaway: None }
    }
}

/// Grows a builtin groom on the builtin head (metres, y up, face along +z).
///
/// Errors: a style that is not one of [`STYLES`]; an option out of range.
pub fn grow(style: &str, options: &GroomOptions) -> Result<Hair> {
    let Some(style) = Style::named(style) else {
        bail!("no builtin groom '{style}': choose one of {}", STYLES.join(", "));
    };
    check("strands", options.strands as f64, *STRANDS.start() as f64..=*STRANDS.end() as f64)?;
    check("length", options.length.into(), 0.2..=2.0)?;
    check("curl", options.curl.into(), 0.0..=2.0)?;
    let clump = options.clump.unwrap_or(style.clump);
    check("clump", clump.into(), 0.0..=1.0)?;
    let flyaway = options.flyaway.unwrap_or(style.flyaway);
    check("flyaway", flyaway.into(), 0.0..=1.0)?;

    let groom = Groom::new(style, options, clump, flyaway);
    let roots = scatter_roots(options.strands, options.seed, ROOTS);
    let n = groom.guides.style.points;
    let mut points = vec![Vec3::ZERO; options.strands * n];
    points
        .par_chunks_mut(n)
        .zip(&roots)
        .enumerate()
        .for_each(|(i, (strand, &root))| groom.strand(i, root, strand));
    let offsets = (0..=options.strands).map(|s| (s * n) as u32).collect();
    Ok(Hair { points, offsets, ..Hair::default() })
}

fn check(name: &str, value: f64, range: RangeInclusive<f64>) -> Result<()> {
    if !range.contains(&value) {
        bail!("groom {name} is {value}: it must lie in {} to {}", range.start(), range.end());
    }
    Ok(())
}

/// What sets one style apart. Lengths in metres.
#[derive(Clone, Copy)]
struct Style {
    /// Points of a strand.
    points: usize,
    /// Length of a strand before variation.
    length: f32,
    /// Strands may be shorter by up to this share.
    length_variation: f32,
    fall: Fall,
    /// x of the parting.
    part_x: f32,
    /// How far hair at the front is combed back; negative: forward, framing the face.
    sweep_back: f32,
    /// How far the root stands up from the skin: 0 lies in it, 1 is normal to it.
    lift: f32,
    /// Height over the skin that a strand reaches as it travels over the head.
    volume: f32,
    /// How slowly a strand turns: the arc length over which it takes its new direction.
    stiffness: f32,
    /// Radius of the wave or curl at the tip, and its length along the strand.
    wave_radius: f32,
    wave_pitch: f32,
    /// 0: a helix; 1: a wave in the plane of the surface.
    wave_flatness: f32,
    /// Turns by which strands of one wisp, and wisps of one lock, differ in phase.
    wave_jitter: f32,
    wave_spread: f32,
    /// Number of wisps: the fewer, the thicker each. It does not depend on the number of strands.
    wisps: usize,
    /// How far a common strand lies and wanders from its wisp's centre.
    noise: f32,
    /// How far wisps join their lock, 0 to 1, against strands their wisp.
    gather: f32,
    clump: f32,
    flyaway: f32,
}

/// Where hair goes once it leaves the comb.
#[derive(Clone, Copy, PartialEq)]
enum Fall {
    /// Down, under gravity.
    Free,
    /// Down to a cut at this height, tips turned in, with a fringe over the forehead.
    Cut { height: f32 },
    /// Along the scalp to a tie, then down as a tail.
    Tied,
}

impl Style {
    fn named(name: &str) -> Option<Self> {
        let straight = Self {
            points: 32,
            length: 0.45,
            length_variation: 0.16,
            fall: Fall::Free,
            part_x: 0.0,
            sweep_back: 0.4,
            lift: 0.30,
            volume: 0.012,
            stiffness: 0.022,
            wave_radius: 0.0025,
            wave_pitch: 0.16,
            wave_flatness: 0.6,
            wave_jitter: 0.12,
            wave_spread: 0.3,
            gather: 0.55,
            wisps: 2_200,
            noise: 0.0022,
            clump: 0.55,
            flyaway: 0.03,
        };
        Some(match name {
            "straight" => straight,
            "wavy" => Self {
                points: 36,
                length: 0.35,
                length_variation: 0.2,
                part_x: 0.022,
                lift: 0.42,
                volume: 0.018,
                wave_radius: 0.0115,
                wave_pitch: 0.088,
                wave_flatness: 0.5,
                wave_jitter: 0.025,
                wave_spread: 0.10,
                gather: 0.4,
                wisps: 1_100,
                noise: 0.0016,
                clump: 0.72,
                flyaway: 0.035,
                ..straight
            },
            "curly" => Self {
                points: 40,
                length: 0.215,
                length_variation: 0.3,
                part_x: 0.012,
                sweep_back: -0.45,
                lift: 0.62,
                volume: 0.030,
                stiffness: 0.030,
                wave_radius: 0.0070,
                wave_pitch: 0.030,
                wave_flatness: 0.0,
                wave_jitter: 0.02,
                wave_spread: 1.0,
                gather: 0.08,
                wisps: 420,
                noise: 0.0014,
                clump: 0.88,
                flyaway: 0.04,
                ..straight
            },
            "bob" => Self {
                points: 26,
                length: 0.36,
                length_variation: 0.03,
                fall: Fall::Cut { height: -0.105 },
                sweep_back: -1.15,
                lift: 0.34,
                volume: 0.014,
                wave_radius: 0.0015,
                clump: 0.38,
                flyaway: 0.02,
                ..straight
            },
            "ponytail" => Self {
                points: 36,
                length: 0.36,
                length_variation: 0.3,
                fall: Fall::Tied,
                lift: 0.08,
                volume: 0.005,
                wave_radius: 0.006,
                wave_pitch: 0.22,
                wave_flatness: 0.3,
                wave_jitter: 0.1,
                clump: 0.5,
                flyaway: 0.03,
                ..straight
            },
            _ => return None,
        })
    }
}

/// Where a cut style's length is counted from.
const HAIRLINE_HEIGHT: f32 = 0.075;
/// Middle of the ponytail's tie, and the radius of the bundle in it.
const TIE: Vec3 = vec3(0.0, 0.062, -0.124);
const TIE_RADIUS: f32 = 0.013;
/// Share of a tied strand's points that lie before the tie.
const TIE_AT: f32 = 0.36;
/// Least height of hair over skin, away from the root.
const GAP: f32 = 0.0022;
const GUIDES: usize = 700;
const LOCKS: usize = 260;

// Purposes of random numbers, so that streams do not meet.
const ROOTS: u64 = 1;
const GUIDE: u64 = 2;
const LOCK: u64 = 3;
const WISP: u64 = 4;
const STRAND: u64 = 5;

struct Guide {
    root: Vec3,
    comb: Vec3,
    points: Vec<Vec3>,
}

/// The centre of a lock or wisp: a strand without wave, and what its members share.
struct Clump {
    root: Vec3,
    comb: Vec3,
    points: Vec<Vec3>,
    /// Phase of the wave in turns, and factors of its pitch and radius.
    phase: f32,
    pitch: f32,
    radius: f32,
    /// 1 or −1: which way its helix winds; as one where phases agree.
    hand: f32,
    /// The lock that a wisp belongs to; its own index for a lock.
    lock: usize,
}

struct Guides {
    style: Style,
    guides: Vec<Guide>,
    grid: RootGrid,
}

struct Groom {
    guides: Guides,
    seed: u64,
    curl: f32,
    clump: f32,
    flyaway: f32,
    locks: Vec<Clump>,
    wisps: Vec<Clump>,
    wisp_grid: RootGrid,
}

impl Guides {
    fn grow(style: Style, seed: u64) -> Self {
        let grown = scatter_roots(GUIDES, seed, GUIDE).into_par_iter().enumerate();
        let guides: Vec<Guide> = grown
            .map(|(i, root)| grow_guide(&style, root, &mut Rng::new(seed, GUIDE, i)))
            .collect();
        let grid = RootGrid::new(guides.iter().map(|g| g.root));
        Self { style, guides, grid }
    }

    /// Clump centres; each its own lock, until wisps are given theirs.
    fn clumps(&self, count: usize, seed: u64, purpose: u64) -> Vec<Clump> {
        let grown =
            scatter_roots(count, seed, purpose).into_par_iter().enumerate().map(|(i, root)| {
                let mut rng = Rng::new(seed, purpose, i);
                let mut points = vec![Vec3::ZERO; self.style.points];
                let comb = comb(&self.style, root);
                self.blend(root, comb, 1.0, &mut points);
                // Neighbouring locks wave alike, or waves blur into fuzz.
                let drift =
                    0.5 * (root.x * 31.0).sin() + 0.5 * (root.z * 27.0 + root.y * 19.0).sin();
                Clump {
                    root,
                    comb,
                    points,
                    phase: drift * 0.6 + self.style.wave_spread * rng.unit(),
                    pitch: 1.0 + 0.16 * rng.signed(),
                    radius: 1.0 + 0.3 * rng.signed(),
                    hand: (rng.unit() - 0.5 * self.style.wave_spread).signum(),
                    lock: i,
                }
            });
        grown.collect()
    }

    /// Blends the three nearest guides that are combed alike, each moved to start at `root`, up to
    /// the share `extent` of their length.
    fn blend(&self, root: Vec3, comb: Vec3, extent: f32, out: &mut [Vec3]) {
        let nearest = nearest_alike(&self.grid, root, comb, |i| self.guides[i].comb);
        let weights = nearest.map(|(_, d2)| 1.0 / (d2 + 4e-6));
        let total: f32 = weights.iter().sum();
        let last = (out.len() - 1) as f32;
        let tied = self.style.fall == Fall::Tied;
        for (k, p) in out.iter_mut().enumerate() {
            let at = extent_at(k as f32 / last, extent, tied) * last;
            // The offset of the root fades along a tied strand, or the tie would be as wide as the
            // scalp.
            let keep = if tied { (1.0 - k as f32 / (TIE_AT * last)).max(0.0) } else { 1.0 };
            *p = root * keep;
            for ((guide, _), w) in nearest.iter().zip(weights) {
                let guide = &self.guides[*guide];
                *p += (sample(&guide.points, at) - guide.root * keep) * (w / total);
            }
        }
    }
}

impl Groom {
    fn new(mut style: Style, options: &GroomOptions, clump: f32, flyaway: f32) -> Self {
        style.length *= options.length;
        if let Fall::Cut { height } = &mut style.fall {
            *height = HAIRLINE_HEIGHT + (*height - HAIRLINE_HEIGHT) * options.length;
        }
        let seed = options.seed;
        let guides = Guides::grow(style, seed);
        let locks = guides.clumps(LOCKS, seed, LOCK);
        let lock_grid = RootGrid::new(locks.iter().map(|c| c.root));
        let mut wisps = guides.clumps(style.wisps, seed, WISP);
        for wisp in &mut wisps {
            let [(lock, _), ..] =
                nearest_alike(&lock_grid, wisp.root, wisp.comb, |i| locks[i].comb);
            let owner = &locks[lock];
            wisp.lock = lock;
            wisp.phase = owner.phase + style.wave_spread * (wisp.phase - 0.5);
            wisp.hand = owner.hand;
            wisp.pitch = owner.pitch * (1.0 + 0.25 * (wisp.pitch - 1.0));
        }
        let wisp_grid = RootGrid::new(wisps.iter().map(|c| c.root));
        let curl = options.curl;
        Self { guides, seed, curl, clump, flyaway, locks, wisps, wisp_grid }
    }

    fn strand(&self, index: usize, root: Vec3, out: &mut [Vec3]) {
        let style = &self.guides.style;
        let mut rng = Rng::new(self.seed, STRAND, index);
        let comb = comb(style, root);
        let extent = 1.0 - style.length_variation * rng.unit() * rng.unit();
        let stray = rng.unit() < self.flyaway;
        let extent = if stray { extent * (0.55 + 0.4 * rng.unit()) } else { extent };
        self.guides.blend(root, comb, extent, out);

        let [(wisp, _), ..] = nearest_alike(&self.wisp_grid, root, comb, |i| self.wisps[i].comb);
        let wisp = &self.wisps[wisp];
        let lock = &self.locks[wisp.lock];
        let clump = if stray { 0.3 * self.clump } else { self.clump };
        let last = (out.len() - 1) as f32;
        let tied = style.fall == Fall::Tied;
        // A member keeps its own place in the wisp, or the wisp would become a line.
        let place = rng.about_zero() * style.noise;
        let wisp_place = (wisp.root - lock.root) * 0.25;
        for (k, p) in out.iter_mut().enumerate().skip(1) {
            let t = k as f32 / last;
            let at = extent_at(t, extent, tied) * last;
            let pull =
                if tied { smoothstep((t - TIE_AT) / (1.0 - TIE_AT)) } else { smoothstep(t / 0.85) };
            let to_wisp = sample(&wisp.points, at) + place - *p;
            let to_lock = sample(&lock.points, at) + wisp_place + place - *p;
            *p += (to_wisp * 0.8).lerp(to_lock * 0.9, style.gather * pull) * (clump * pull);
        }

        // Wave about the strand, in a frame of the outward direction: it needs no transport along
        // the strand, and neighbours agree on it.
        let waved_share = if tied { 1.0 - TIE_AT } else { 1.0 };
        let step = style.length * extent / (last * waved_share);
        let pitch = style.wave_pitch * wisp.pitch * (1.0 + 0.03 * rng.signed());
        let phase = wisp.phase + style.wave_jitter * rng.signed();
        let radius = style.wave_radius * self.curl * lock.radius * (1.0 + 0.15 * rng.signed());
        let noise = Noise::new(&mut rng);
        let noise_size = if stray { 0.008 } else { style.noise };
        let lift = if stray { 0.022 * rng.unit() } else { 0.0 };
        let mut previous = root;
        for (k, p) in out.iter_mut().enumerate().skip(1) {
            let t = k as f32 / last;
            let base = *p;
            let along = (base - previous).normalize_or(Vec3::NEG_Y);
            previous = base;
            let outward = outward(base);
            let side = along.cross(outward).normalize_or(Vec3::X);
            let up = side.cross(along);
            let grown = if tied { smoothstep((t - TIE_AT) / 0.4) } else { smoothstep(t / 0.35) };
            let (s, c) = (TAU * (phase + k as f32 * step / pitch)).sin_cos();
            let wave =
                (side * c + up * (s * wisp.hand * (1.0 - style.wave_flatness))) * (radius * grown);
            let loose = if tied { 0.25 + 0.75 * grown } else { t.sqrt() };
            let wander = noise.at(t) * (noise_size * loose);
            *p = base + wave + wander + up * (lift * t * loose);
        }

        let fringe = is_fringe(style, root);
        for (k, p) in out.iter_mut().enumerate().skip(1) {
            let gap = GAP * (k as f32 / 3.0).min(1.0);
            *p = keep_out(*p, gap, !fringe);
        }
        separate(out, root);
    }
}

/// Position in a guide, as a share of its length, of the share `t` of a strand that is `extent` as
/// long. A tied strand must reach the tie at the same share whatever its length.
fn extent_at(t: f32, extent: f32, tied: bool) -> f32 {
    if tied && t > TIE_AT {
        TIE_AT + (t - TIE_AT) * extent
    } else if tied {
        t
    } else {
        t * extent
    }
}

/// Moves apart consecutive points that coincide, which collision can bring about.
fn separate(strand: &mut [Vec3], root: Vec3) {
    for k in 1..strand.len() {
        if strand[k].distance_squared(strand[k - 1]) < 1e-10 {
            strand[k] = strand[k - 1] + outward(root) * 1e-4;
        }
    }
}

/// Grows one guide of exactly `style.points` points.
fn grow_guide(style: &Style, root: Vec3, rng: &mut Rng) -> Guide {
    let comb = comb(style, root);
    let mut points = match style.fall {
        Fall::Tied => grow_tied(style, root, rng),
        _ => grow_falling(style, root, comb, rng),
    };
    resample(&mut points, style.points, (style.fall == Fall::Tied).then_some(TIE_AT));
    Guide { root, comb, points }
}

fn grow_falling(style: &Style, root: Vec3, comb: Vec3, rng: &mut Rng) -> Vec<Vec3> {
    const STEP: f32 = 0.006;
    let fringe = is_fringe(style, root);
    let normal = skin().normal(root);
    // A fringe lies closer than the rest.
    let close = if fringe { 0.45 } else { 1.0 };
    let lift = close * style.lift * (1.0 + 0.25 * rng.signed());
    let volume = close * style.volume * (1.0 + 0.25 * rng.signed());
    // Hair of the nape has less far to fall to the common edge.
    let shorter = 0.3 * smoothstep((0.02 - root.y) / 0.1);
    let length = style.length * (1.0 - shorter + 0.06 * rng.signed());
    let ragged = 0.0035 * rng.signed();
    let cut = |p: Vec3| match style.fall {
        // The fringe ends at the brow, and frames the face beside the eyes.
        Fall::Cut { .. } if fringe => {
            0.027 - 0.055 * smoothstep((p.x.abs() - 0.046) / 0.03) + ragged
        }
        Fall::Cut { height } => height + ragged,
        _ => f32::NEG_INFINITY,
    };
    let turn = 1.0 - (-STEP / style.stiffness).exp();
    let mut direction = (comb * (1.0 - lift) + normal * lift).normalize_or(normal);
    let mut points = vec![root];
    let (mut p, mut travelled, mut over_skin) = (root, 0.0, 0.0);
    while points.len() < 3 || (travelled < length && p.y > cut(p)) {
        let (near, gradient) = skin().query(p);
        let normal = gradient.normalize_or(Vec3::Y);
        // Over the head hair follows the comb, tangentially; below it, gravity.
        let top =
            if fringe { smoothstep((p.y - 0.055) / 0.05) } else { smoothstep((p.y - 0.01) / 0.07) };
        let on_top = top * (1.0 - smoothstep((near - 0.6 * volume - 0.006) / 0.03));
        let sweep = if fringe { comb } else { (comb + outward(p) * 0.25).normalize_or(comb) };
        let tangent = (sweep - normal * sweep.dot(normal)).normalize_or(sweep);
        let mut target = tangent * on_top + Vec3::NEG_Y * (1.05 - on_top);
        let inward = -vec3(p.x, 0.0, p.z + 0.03).normalize_or_zero();
        match style.fall {
            // Tips turn in towards the neck.
            Fall::Cut { height } if !fringe => {
                target += inward * (0.95 * smoothstep((height + 0.085 - p.y) / 0.08))
            }
            // Hair parts over the shoulder, to the chest or to the back, rather than lie on it.
            Fall::Free if p.y < -0.10 && near < 0.06 => {
                let forward = if root.z > -0.005 { 1.0 } else { -1.0 };
                target += vec3(-0.1 * p.x.signum(), 0.0, forward)
                    * (1.2 * smoothstep((0.06 - near) / 0.06));
            }
            _ => target += inward * (0.12 * smoothstep(-p.y / 0.05)),
        }
        direction =
            direction.lerp(target.normalize_or(Vec3::NEG_Y), turn).normalize_or(Vec3::NEG_Y);
        p += direction * STEP;
        travelled += STEP;
        if near < 0.03 {
            over_skin += STEP;
        }
        let gap = GAP + volume * smoothstep(over_skin / 0.09);
        let held = keep_out(p, gap.min(0.2 * travelled + 1e-4), !fringe);
        let push = held - p;
        if push.length_squared() > 1e-12 {
            let out = push.normalize();
            direction = (direction - out * direction.dot(out).min(0.0)).normalize_or(direction);
        }
        p = held;
        points.push(p);
    }
    points
}

fn grow_tied(style: &Style, root: Vec3, rng: &mut Rng) -> Vec<Vec3> {
    const STEP: f32 = 0.004;
    let gap = GAP + style.volume * 0.5 * (1.0 + rng.signed());
    let mut points = vec![root];
    let mut p = root;
    let mut arrival = Vec3::ZERO;
    // The way to the tie is at most half round the head.
    for _ in 0..100 {
        let to_tie = TIE - p;
        arrival = to_tie;
        if to_tie.length() < TIE_RADIUS + STEP {
            break;
        }
        let normal = skin().normal(p);
        let near = to_tie.length() < 0.035;
        let along = if near { to_tie } else { to_tie - normal * to_tie.dot(normal) };
        p += along.normalize_or(to_tie.normalize()) * STEP;
        p = keep_out(p, gap.min(0.15 * p.distance(root) + 1e-4), true);
        points.push(p);
    }
    // Hair from the hairline wraps the outside of the bundle, hair from near the tie its inside.
    let around = (-arrival).normalize_or(Vec3::Y);
    let travelled = points.len() as f32 * STEP;
    let share = (travelled / 0.17).clamp(0.05, 1.0).sqrt();
    let angle = around.x.atan2(around.y);
    let length = style.length * (1.0 + 0.12 * rng.signed());
    let wobble = rng.about_zero() * 0.25;
    let mut center = TIE + vec3(0.0, 0.004, -0.012);
    let mut direction = vec3(0.0, 0.38, -0.92).normalize();
    let mut travelled = 0.0;
    let up = Vec3::Y;
    while travelled < length {
        let t = travelled / length;
        let side = Vec3::X;
        let over = side.cross(direction).normalize_or(up);
        // Narrow at the tie, full at a third, gathered at the tip.
        let spread =
            TIE_RADIUS * (0.85 + 2.1 * smoothstep(t / 0.35) - 1.7 * smoothstep((t - 0.4) / 0.6));
        let (s, c) = (angle + 0.5 * t).sin_cos();
        let place = (side * (s + wobble.x) + over * (c + wobble.y)) * (spread * share);
        points.push(keep_out(center + place, GAP, true));
        direction = (direction + Vec3::NEG_Y * (STEP / 0.030)).normalize_or(Vec3::NEG_Y);
        center = keep_out(center + direction * STEP, 0.030 * smoothstep(t * 4.0) + 0.004, true);
        travelled += STEP;
    }
    points
}

/// The direction in which hair at `root` is combed, tangential to the skin, unit length: away from
/// the parting, or to the tie.
fn comb(style: &Style, root: Vec3) -> Vec3 {
    let normal = skin().normal(root);
    let away = if style.fall == Fall::Tied {
        TIE - root
    } else if is_fringe(style, root) {
        vec3(root.x, 0.0, root.z + 0.04)
    } else {
        // Aside from the parting, and back where the parting ends at the crown.
        let from_part = root.x - style.part_x;
        let behind_crown = 1.0 - smoothstep((root.z + 0.075) / 0.055);
        let front = 0.2 + style.sweep_back * smoothstep((root.z + 0.04) / 0.10);
        let back = front + 2.2 * behind_crown;
        vec3(from_part / (from_part.abs() + 0.002 + 0.05 * behind_crown), 0.0, -back)
    };
    (away - normal * away.dot(normal)).normalize_or(Vec3::NEG_Z)
}

/// Whether a root belongs to the fringe of a cut style.
fn is_fringe(style: &Style, root: Vec3) -> bool {
    matches!(style.fall, Fall::Cut { .. }) && root.z - 0.6 * root.x.abs() > 0.002 && root.y > 0.04
}

/// Horizontally away from the head's axis, below its middle; away from its middle, above. Unit
/// length.
fn outward(p: Vec3) -> Vec3 {
    (p - vec3(0.0, p.y.min(0.03), -0.02)).normalize_or(Vec3::NEG_Z)
}

/// `p` moved to at least `gap` off the skin and, where `face` is set, out of the room before the
/// face.
fn keep_out(mut p: Vec3, gap: f32, face: bool) -> Vec3 {
    if face {
        // An ellipsoid over brow, eyes, nose and mouth; hair leaves it sideways and back, never
        // forward.
        let q = (p - vec3(0.0, -0.035, 0.085)) / vec3(0.060, 0.105, 0.075);
        let inside = 1.0 - q.length();
        if inside > 0.0 {
            let side = vec3(p.x, 0.0, -0.010).normalize_or(Vec3::X);
            p += side * (inside * 0.060);
        }
    }
    for _ in 0..2 {
        let (distance, gradient) = skin().query(p);
        if distance >= gap {
            break;
        }
        p += gradient.normalize_or(Vec3::Y) * (gap - distance);
    }
    p
}

/// `count` roots over the scalp, in the order of a low-discrepancy sequence: any prefix covers the
/// scalp.
fn scatter_roots(count: usize, seed: u64, purpose: u64) -> Vec<Vec3> {
    const BLOCK: usize = 1 << 14;
    let mut roots = Vec::with_capacity(count + BLOCK);
    let mut start = 0;
    while roots.len() < count {
        let block =
            (start..start + BLOCK).into_par_iter().filter_map(|i| root_candidate(i, seed, purpose));
        roots.extend(block.collect::<Vec<_>>());
        start += BLOCK;
    }
    roots.truncate(count);
    roots
}

/// The `i`th point of the sequence on the skull, where it falls on the scalp.
fn root_candidate(i: usize, seed: u64, purpose: u64) -> Option<Vec3> {
    // R2: powers of the reciprocal plastic number; in f64, as f32 runs out of bits at 10⁵ points.
    const R2: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    let mut rng = Rng::new(seed, purpose << 8, i);
    let mut shift = Rng::new(seed, purpose << 16, 0);
    let lattice = R2.map(|a| (f64::from(shift.unit()) + a * i as f64).fract() as f32);
    let jitter = 0.3 / (1.0 + i as f32).sqrt();
    let u = lattice[0] + jitter * rng.signed();
    let v = (lattice[1] + jitter * rng.signed()).clamp(0.0, 1.0);
    // Equal areas of a sphere about the skull's middle, of which the scalp takes y from −0.9 up.
    let y = 1.0 - 1.9 * v;
    let (s, c) = (TAU * u).sin_cos();
    let ring = (1.0 - y * y).max(0.0).sqrt();
    let direction = vec3(s * ring, y, c * ring);
    let center = vec3(0.0, 0.015, -0.018);
    let mut distance = 0.09;
    let mut normal = direction;
    for _ in 0..5 {
        let (outside, gradient) = skin().query(center + direction * distance);
        normal = gradient.normalize_or(direction);
        distance -= outside / direction.dot(gradient).max(0.4);
    }
    let root = center + direction * distance;
    // Area of skin for a solid angle, against its largest value: even density over an uneven skull.
    let facing = direction.dot(normal).max(0.2);
    let area = distance * distance / facing / 0.0165;
    // The hairline thins out over a centimetre.
    let density = smoothstep((scalp_depth(root) + 0.003 * rng.signed()) / 0.010);
    (rng.unit() < area * density).then_some(root)
}

/// Resamples a polyline to `count` points of equal arc length; with `tie`, the share of points up
/// to its knee (the point nearest the tie) is fixed as well.
fn resample(points: &mut Vec<Vec3>, count: usize, tie: Option<f32>) {
    let mut arc = vec![0.0];
    for pair in points.windows(2) {
        arc.push(arc[arc.len() - 1] + pair[0].distance(pair[1]));
    }
    let total = arc[arc.len() - 1].max(1e-6);
    let knee = tie.map(|share| {
        let nearest = (0..points.len()).min_by(|&a, &b| {
            points[a].distance_squared(TIE).total_cmp(&points[b].distance_squared(TIE))
        });
        (share, arc[nearest.unwrap_or(0)] / total)
    });
    let resampled = (0..count).map(|k| {
        let t = k as f32 / (count - 1) as f32;
        let at = total
            * match knee {
                Some((share, knee)) if t < share => knee * t / share,
                Some((share, knee)) => knee + (1.0 - knee) * (t - share) / (1.0 - share),
                None => t,
            };
        let after = arc.partition_point(|&s| s < at).clamp(1, arc.len() - 1);
        let span = (arc[after] - arc[after - 1]).max(1e-9);
        points[after - 1].lerp(points[after], ((at - arc[after - 1]) / span).clamp(0.0, 1.0))
    });
    *points = resampled.collect();
}

/// The polyline at a fractional index, clamped to its ends.
fn sample(points: &[Vec3], at: f32) -> Vec3 {
    let i = (at as usize).min(points.len() - 2);
    points[i].lerp(points[i + 1], at - i as f32)
}

fn smoothstep(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The head's distance on a grid, for the millions of queries that a groom makes.
struct Skin {
    size: [usize; 3],
    distance: Vec<f32>,
}

/// Spacing of the grid: trilinear distances are then good to 0.2 mm, except in the folds of face
/// and ear.
const SKIN_CELL: f32 = 0.005;

fn skin() -> &'static Skin {
    static SKIN: OnceLock<Skin> = OnceLock::new();
    SKIN.get_or_init(|| {
        let extent = (HEAD_BOUNDS[1] - HEAD_BOUNDS[0]) / SKIN_CELL;
        let size = extent.to_array().map(|e| e.ceil() as usize + 1);
        let at = |i: usize| {
            vec3(
                (i % size[0]) as f32,
                (i / size[0] % size[1]) as f32,
                (i / (size[0] * size[1])) as f32,
            )
        };
        let distance = (0..size[0] * size[1] * size[2])
            .into_par_iter()
            .map(|i| head_distance(HEAD_BOUNDS[0] + at(i) * SKIN_CELL))
            .collect();
        Skin { size, distance }
    })
}

impl Skin {
    /// Distance at `p`, and its gradient. Outside the grid, that of the nearest point of it plus
    /// the way there.
    fn query(&self, p: Vec3) -> (f32, Vec3) {
        let q = (p - HEAD_BOUNDS[0]) / SKIN_CELL;
        let last = Vec3::from_array(self.size.map(|n| (n - 1) as f32)) - 1e-3;
        let inside = q.clamp(Vec3::ZERO, last);
        let cell = inside.as_uvec3();
        let f = inside - cell.as_vec3();
        let [nx, ny, _] = self.size;
        let base = (cell.z as usize * ny + cell.y as usize) * nx + cell.x as usize;
        let d = |x: usize, y: usize, z: usize| self.distance[base + (z * ny + y) * nx + x];
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let along_x = |y, z| mix(d(0, y, z), d(1, y, z), f.x);
        let (x00, x10, x01, x11) = (along_x(0, 0), along_x(1, 0), along_x(0, 1), along_x(1, 1));
        let (y0, y1) = (mix(x00, x10, f.y), mix(x01, x11, f.y));
        let slope_x = |y, z| d(1, y, z) - d(0, y, z);
        let gradient = vec3(
            mix(
                mix(slope_x(0, 0), slope_x(1, 0), f.y),
                mix(slope_x(0, 1), slope_x(1, 1), f.y),
                f.z,
            ),
            mix(x10 - x00, x11 - x01, f.z),
            y1 - y0,
        );
        let beyond = (q - inside) * SKIN_CELL;
        (mix(y0, y1, f.z) + beyond.length(), gradient / SKIN_CELL + beyond.normalize_or_zero())
    }

    fn normal(&self, p: Vec3) -> Vec3 {
        self.query(p).1.normalize_or(Vec3::Y)
    }
}

/// Roots in cubes of a grid, for nearest neighbours.
struct RootGrid {
    roots: Vec<Vec3>,
    /// Roots of cube `c` are `sorted[starts[c]..starts[c + 1]]`.
    starts: Vec<usize>,
    sorted: Vec<u32>,
}

impl RootGrid {
    const CELL: f32 = 0.014;
    const SIZE: [i32; 3] = [14, 18, 18];
    const LOW: Vec3 = vec3(-0.098, -0.115, -0.126);

    fn new(roots: impl Iterator<Item = Vec3>) -> Self {
        let roots: Vec<Vec3> = roots.collect();
        let cubes = (Self::SIZE[0] * Self::SIZE[1] * Self::SIZE[2]) as usize;
        let cube: Vec<usize> = roots.iter().map(|&p| Self::index(Self::cube(p))).collect();
        let mut sorted: Vec<u32> = (0..roots.len() as u32).collect();
        sorted.sort_by_key(|&i| cube[i as usize]);
        let starts =
            (0..=cubes).map(|c| sorted.partition_point(|&i| cube[i as usize] < c)).collect();
        Self { roots, starts, sorted }
    }

    fn cube(p: Vec3) -> [i32; 3] {
        let q = ((p - Self::LOW) / Self::CELL).to_array();
        std::array::from_fn(|k| (q[k] as i32).clamp(0, Self::SIZE[k] - 1))
    }

    fn index(c: [i32; 3]) -> usize {
        ((c[2] * Self::SIZE[1] + c[1]) * Self::SIZE[0] + c[0]) as usize
    }

    /// Calls `visit` with the indices of all roots within `reach` cubes of `p`'s.
    fn visit_near(&self, p: Vec3, reach: i32, mut visit: impl FnMut(usize)) {
        let c = Self::cube(p);
        let range = |k: usize| (c[k] - reach).max(0)..=(c[k] + reach).min(Self::SIZE[k] - 1);
        for z in range(2) {
            for y in range(1) {
                let first = Self::index([*range(0).start(), y, z]);
                let last = Self::index([*range(0).end(), y, z]);
                for &i in &self.sorted[self.starts[first]..self.starts[last + 1]] {
                    visit(i as usize);
                }
            }
        }
    }
}

/// The three nearest roots, with squared distances lengthened where the comb differs, so that
/// strands from either side of a parting never mix. With fewer than three roots the last is
/// repeated.
fn nearest_alike(
    grid: &RootGrid,
    root: Vec3,
    comb: Vec3,
    comb_of: impl Fn(usize) -> Vec3,
) -> [(usize, f32); 3] {
    let mut best = [(usize::MAX, f32::INFINITY); 3];
    for reach in [1, 2, 4, 18] {
        best = [(usize::MAX, f32::INFINITY); 3];
        grid.visit_near(root, reach, |i| {
            let unlike = 1.0 - comb_of(i).dot(comb);
            let d2 = grid.roots[i].distance_squared(root) + 1.5e-3 * unlike;
            if d2 < best[2].1 {
                best[2] = (i, d2);
                best.sort_by(|a, b| a.1.total_cmp(&b.1));
            }
        });
        // Complete when nothing beyond the visited cubes can be nearer.
        if best[2].1.sqrt() <= reach as f32 * RootGrid::CELL {
            break;
        }
    }
    best
}

/// Smooth noise along a strand: two sines a coordinate.
struct Noise {
    phases: [Vec3; 2],
}

impl Noise {
    fn new(rng: &mut Rng) -> Self {
        Self { phases: std::array::from_fn(|_| vec3(rng.unit(), rng.unit(), rng.unit())) }
    }

    /// Of order 1; `t` is the share of the strand's length.
    fn at(&self, t: f32) -> Vec3 {
        let octave = |k: usize, turns: f32| ((self.phases[k] + turns * t) * TAU).map(f32::sin);
        octave(0, 0.7) * 0.7 + octave(1, 1.9) * 0.3
    }
}

/// SplitMix64 (Steele et al. 2014) started at a hash of seed, purpose and index.
struct Rng(u64);

impl Rng {
    fn new(seed: u64, purpose: u64, index: usize) -> Self {
        let mut rng = Self(seed ^ purpose.wrapping_mul(0xd6e8_feb8_6659_fd93));
        let key = rng.next();
        Self(key ^ (index as u64).wrapping_mul(0xa076_1d64_78bd_642f))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In [0, 1).
    fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 24) as f32
    }

    /// In [−1, 1).
    fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }

    /// Each coordinate in [−1, 1), denser towards 0.
    fn about_zero(&mut self) -> Vec3 {
        let mut axis = || 0.5 * (self.signed() + self.signed());
        vec3(axis(), axis(), axis())
    }
}
