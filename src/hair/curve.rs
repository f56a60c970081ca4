//! Strands as smooth curves: between two points a cubic Hermite curve whose tangents the neighbouring
//! segments share. The rasteriser and the path tracer both draw it as straight pieces.

use glam::{DVec3, Vec3};

use super::Hair;

/// A straight piece may leave its curve by this many pixels.
const TOLERANCE_PX: f64 = 0.15;
const MAX_PIECES: u32 = 8;
/// Segments that the choice of pieces looks at.
const BENDS: usize = 4096;

/// Turn from strand to strand of the ellipse's axis: the golden angle.
const TWIST: f32 = 2.399_963;

/// The fibre's frame at every point.
#[derive(Clone)]
pub struct Frames {
    /// Unit tangents, root to tip.
    pub tangents: Vec<Vec3>,
    /// Unit axis of the cross section from which azimuths count (η* = η₁* of Xu 2011, Eq 24), across the
    /// tangent. Each strand's stands at an angle of its own and turns no more than the strand does.
    pub axes: Vec<Vec3>,
}

impl Frames {
    pub fn new(hair: &Hair) -> Frames {
        let mut frames = Frames {
            tangents: Vec::with_capacity(hair.points.len()),
            axes: Vec::with_capacity(hair.points.len()),
        };
        for range in hair.strands() {
            let strand = &hair.points[range.clone()];
            let mut axis = Vec3::ZERO;
            for i in 0..strand.len() {
                let u = tangent(strand, i);
                let (x, y) = normals(u);
                axis = match i {
                    0 => {
                        let (sin, cos) = (TWIST * range.start as f32).sin_cos();
                        x * cos + y * sin
                    }
                    _ => axis.reject_from_normalized(u).normalize_or(x),
                };
                frames.tangents.push(u);
                frames.axes.push(axis);
            }
        }
        frames
    }
}

/// The unit tangent at a point of a strand.
pub(super) fn tangent(strand: &[Vec3], i: usize) -> Vec3 {
    let (a, b) = (i.saturating_sub(1), (i + 1).min(strand.len() - 1));
    (strand[b] - strand[a]).normalize_or(Vec3::Y)
}

/// Two unit vectors at right angles to unit `u` and to each other (Duff et al. 2017); shaders/shade.wgsl has
/// the first.
pub fn normals(u: Vec3) -> (Vec3, Vec3) {
    let s = if u.z >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (s + u.z);
    let x = Vec3::new(1.0 + s * u.x * u.x * a, s * u.x * u.y * a, -s * u.x);
    (x, u.cross(x))
}

/// Straight pieces a segment needs, so that 95 % of them stay within tolerance of their curve: a chord of c
/// pixels that turns by δ leaves its curve by cδ/8, and by 1/n² of that in n pieces. At most 8. Seen from `eye`
/// (world), where a unit length at unit distance spans `pixels`.
pub fn pieces(hair: &Hair, tangents: &[Vec3], eye: DVec3, pixels: f64) -> u32 {
    let stride = (hair.points.len() / BENDS).max(1);
    let mut off: Vec<f64> = hair
        .strands()
        .flat_map(|range| range.skip(1))
        .filter(|i| i % stride == 0)
        .map(|i| {
            let (a, b) = (hair.points[i - 1].as_dvec3(), hair.points[i].as_dvec3());
            let turn = f64::from(tangents[i - 1].angle_between(tangents[i]));
            a.distance(b) / a.distance(eye).max(1e-6) * pixels * turn / 8.0
        })
        .collect();
    off.sort_by(f64::total_cmp);
    let worst = off.get(off.len() * 95 / 100).copied().unwrap_or(0.0);
    ((worst / TOLERANCE_PX).sqrt().ceil() as u32).clamp(1, MAX_PIECES)
}
