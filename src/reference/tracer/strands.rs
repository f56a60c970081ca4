//! Rays against strands: round, tapered pieces of the curves that the rasteriser draws, under a BVH.
//!
//! Each segment is the cubic Hermite curve of `hair::Frames` (shaders/raster.wgsl, hair_vertex) in straight
//! pieces. A ray meets a piece where it passes the axis within the radius there; at inner joints the axis ends
//! in a sphere, so that pieces leave no gap, and at root and tip it is cut flat, so that a strand covers just
//! what a camera-facing ribbon does. A fibre has front faces alone: a ray that starts within one leaves it.

use glam::{DMat3, DVec3, Mat4, Vec3, Vec3A, Vec4};
use obvhs::{aabb::Aabb, ray::Ray};

use super::wide::{ITEMS, WideBvh};
use crate::hair::{Frames, Hair};

/// A ray that starts on a fibre misses its own strand over a path of so many radii: within the fibre, light
/// is the scattering function's part.
pub const CLEAR_RADII: f32 = 4.0;

/// No strand of its own.
pub const NO_STRAND: u32 = u32::MAX;

/// A ray from a place on a strand or, with [`Self::free`], from anywhere else.
#[derive(Clone, Copy, Debug)]
pub struct StrandRay {
    pub ray: Ray,
    own: u32,
    /// The path over which `own` is missed.
    clear: f32,
}

impl StrandRay {
    /// `direction` is a unit vector.
    pub fn free(origin: Vec3, direction: Vec3) -> StrandRay {
        let ray = Ray::new_inf(origin.into(), direction.into());
        StrandRay { ray, own: NO_STRAND, clear: 0.0 }
    }

    /// From a fibre of strand `own`, about `axis_point` along unit `u`, on the side that unit `omega` leaves by.
    pub fn leaving(axis_point: DVec3, radius: f64, u: DVec3, own: u32, omega: DVec3) -> StrandRay {
        let across = omega.reject_from_normalized(u).normalize_or_zero();
        let origin = (axis_point + radius * across).as_vec3a();
        let ray = Ray::new_inf(origin, omega.as_vec3a());
        StrandRay { ray, own, clear: CLEAR_RADII * radius as f32 }
    }

    /// From a place on the surface of strand `own`, no farther than `most`; the strand is missed over a path of
    /// [`CLEAR_RADII`].
    pub fn along(origin: Vec3, radius: f32, own: u32, omega: Vec3, most: f32) -> StrandRay {
        let ray = Ray::new(origin.into(), omega.into(), 0.0, most);
        StrandRay { ray, own, clear: CLEAR_RADII * radius }
    }

    /// The same ray beyond the fibre that it met at `at`.
    pub fn past(&self, at: &FibrePoint) -> StrandRay {
        let (o, d) = (self.ray.origin, self.ray.direction);
        let origin = o + (at.axis_point.as_vec3a() - o).dot(d) * d;
        let clear = CLEAR_RADII * at.radius as f32;
        StrandRay { ray: Ray::new_inf(origin, d), own: at.strand, clear }
    }
}

/// A straight piece.
#[derive(Clone, Copy)]
struct Piece {
    /// Start of the axis, radius there.
    start: Vec4,
    /// From start to end: axis, radius.
    edge: Vec4,
}

/// The pieces of a leaf: x, y, z and radius of their starts and edges, and of a place without a piece nothing.
#[derive(Clone, Copy)]
#[repr(align(128))]
struct Pack {
    start: [Vec4; 4],
    edge: [Vec4; 4],
}

impl Pack {
    fn new(pieces: [Option<&Piece>; ITEMS]) -> Pack {
        let columns = |part: fn(&Piece) -> Vec4| {
            let rows = pieces.map(|piece| piece.map_or(Vec4::ZERO, part));
            let turned = Mat4::from_cols(rows[0], rows[1], rows[2], rows[3]).transpose();
            [turned.x_axis, turned.y_axis, turned.z_axis, turned.w_axis]
        };
        Pack { start: columns(|piece| piece.start), edge: columns(|piece| piece.edge) }
    }

    fn piece(&self, lane: usize) -> Piece {
        let at = |columns: &[Vec4; 4]| Vec4::from(columns.map(|column| column[lane]));
        Piece { start: at(&self.start), edge: at(&self.edge) }
    }
}

/// Where a piece belongs.
#[derive(Clone, Copy, Default)]
struct Place {
    strand: u32,
    /// First point of the segment.
    point: u32,
    part: u16,
    /// Cut flat at start and end.
    flat: [bool; 2],
}

/// The pieces of strands relative to a centre, ready to be hit by rays.
pub struct StrandBvh {
    bvh: WideBvh,
    /// Leaf by leaf.
    packs: Vec<Pack>,
    places: Vec<[Place; ITEMS]>,
}

/// The same with the curves that the pieces are of.
pub struct Strands<'a> {
    hair: &'a Hair,
    frames: &'a Frames,
    /// Pieces a segment.
    parts: u32,
    bvh: StrandBvh,
}

/// Which piece a ray met.
#[derive(Clone, Copy, Debug)]
pub struct PieceId {
    leaf: u32,
    lane: u32,
}

/// Where a ray met a strand.
#[derive(Clone, Copy, Debug)]
pub struct FibrePoint {
    pub strand: u32,
    /// The strand point before it, and the part of the way to the next.
    pub point: u32,
    pub along: f32,
    /// On the axis, relative to the centre.
    pub axis_point: DVec3,
    pub radius: f64,
    /// Columns: the smooth curve's tangent u, root to tip; the axis from which azimuths count; their cross
    /// product.
    pub frame: DMat3,
    /// h = sin(φ_o − φ_n), the signed offset of the ray across the fibre in radii, in [−1, 1].
    pub h: f64,
}

impl FibrePoint {
    /// The ray that leaves the fibre along unit `omega` (world), from the side it leaves on.
    pub fn leave(&self, omega: DVec3) -> StrandRay {
        StrandRay::leaving(self.axis_point, self.radius, self.frame.x_axis, self.strand, omega)
    }
}

impl StrandBvh {
    /// See [`Strands::new`].
    pub fn new(
        hair: &Hair,
        diameters: &[f32],
        frames: &Frames,
        parts: u32,
        center: Vec3,
    ) -> StrandBvh {
        let parts = parts.max(1);
        let mut pieces = Vec::new();
        let mut places = Vec::new();
        for (strand, range) in hair.strands().enumerate() {
            let first = pieces.len();
            for point in range.start..range.end.saturating_sub(1).max(range.start) {
                let (a, b) = (hair.points[point] - center, hair.points[point + 1] - center);
                let chord = a.distance(b);
                let curve = |part: u32| {
                    let s = part as f32 / parts as f32;
                    let tangents = [frames.tangents[point], frames.tangents[point + 1]];
                    let radius = 0.5 * (diameters[point] * (1.0 - s) + diameters[point + 1] * s);
                    hermite([a, b], tangents.map(|t| chord * t), s).0.extend(radius)
                };
                for part in 0..parts {
                    let start = curve(part);
                    let edge = curve(part + 1) - start;
                    if edge.truncate() != Vec3::ZERO {
                        pieces.push(Piece { start, edge });
                        places.push(Place {
                            strand: strand as u32,
                            point: point as u32,
                            part: part as u16,
                            flat: [false; 2],
                        });
                    }
                }
            }
            if let [root, ..] = &mut places[first..] {
                root.flat[0] = true;
            }
            if let [.., tip] = &mut places[first..] {
                tip.flat[1] = true;
            }
        }
        let boxes: Vec<Aabb> = pieces.iter().map(bounds).collect();
        let bvh = WideBvh::new(&boxes);
        let packs = bvh.leaves.iter().map(|items| Pack::new(items.map(|i| pieces.get(i as usize))));
        let place = |i: u32| places.get(i as usize).copied().unwrap_or_default();
        let places = bvh.leaves.iter().map(|items| items.map(place)).collect();
        StrandBvh { packs: packs.collect(), places, bvh }
    }

    /// Corners of the box around all strands.
    pub fn bounds(&self) -> (Vec3A, Vec3A) {
        (self.bvh.bounds.min, self.bvh.bounds.max)
    }

    /// The nearest piece before `ray.tmax`, and the path to it.
    pub fn closest(&self, ray: &StrandRay) -> Option<(PieceId, f32)> {
        let mut nearest = None;
        self.bvh.traverse(&ray.ray, |leaf, bound| {
            self.nearest_in(leaf, ray, bound).map_or(bound, |(lane, t)| {
                nearest = Some((PieceId { leaf: leaf as u32, lane }, t));
                t
            })
        });
        nearest
    }

    /// First point of the segment that a piece is of.
    pub fn segment(&self, id: PieceId) -> u32 {
        self.places[id.leaf as usize][id.lane as usize].point
    }

    /// Whether anything lies before `ray.tmax`.
    pub fn occluded(&self, ray: &StrandRay) -> bool {
        let mut met = false;
        self.bvh.traverse(&ray.ray, |leaf, bound| {
            met = met || self.nearest_in(leaf, ray, bound).is_some();
            if met { f32::NEG_INFINITY } else { bound }
        });
        met
    }

    /// Pieces that the ray enters before `ray.tmax` or, with `leaves`, that it leaves; of two that meet one.
    pub fn count(&self, ray: &StrandRay, leaves: bool) -> u32 {
        let mut count = 0;
        self.bvh.traverse(&ray.ray, |leaf, bound| {
            for lane in 0..ITEMS {
                count += u32::from(self.meets_in(leaf, lane, ray, leaves));
            }
            bound
        });
        count
    }

    /// Whether the ray meets this piece, but for the joint at its end.
    fn meets_in(&self, leaf: usize, lane: usize, from: &StrandRay, leaves: bool) -> bool {
        let (piece, place) = (self.packs[leaf].piece(lane), self.places[leaf][lane]);
        let (o, d) = (Vec3::from(from.ray.origin), Vec3::from(from.ray.direction));
        let (offset, edge) = (piece.start.truncate() - o, piece.edge.truncate());
        let (along, edge_along) = (offset.dot(d), edge.dot(d));
        let (aside, slant) = (offset - along * d, edge - edge_along * d);
        let slant2 = slant.length_squared().max(f32::MIN_POSITIVE);
        let unbound = -aside.dot(slant) / slant2;
        let s = unbound.clamp(0.0, 1.0);
        let radius = piece.start.w + s * piece.edge.w;
        let inside2 = radius * radius - (aside + s * slant).length_squared();
        if inside2 <= 0.0 || s < unbound || s > unbound && place.flat[0] {
            return false;
        }
        let inside = inside2.sqrt();
        let slanted = inside * (1.0 + edge_along * edge_along / slant2).sqrt();
        let deep = if s == unbound { slanted.min(inside + edge_along.abs()) } else { inside };
        let t = along + s * edge_along + if leaves { deep } else { -deep };
        let own = t.abs() < from.clear && place.strand == from.own;
        t > 0.0 && t < from.ray.tmax && !own
    }

    /// Of the pieces of a leaf the one that the ray enters first, and where, if that is before `bound`.
    #[inline(always)]
    fn nearest_in(&self, leaf: usize, from: &StrandRay, bound: f32) -> Option<(u32, f32)> {
        let Pack { start: [ax, ay, az, radius], edge: [ex, ey, ez, taper] } = self.packs[leaf];
        let (o, d) = (from.ray.origin, from.ray.direction);
        let (ax, ay, az) = (ax - o.x, ay - o.y, az - o.z);
        let along = ax * d.x + ay * d.y + az * d.z;
        let edge_along = ex * d.x + ey * d.y + ez * d.z;
        // Across the ray, the ray is a point and the axis a shorter edge.
        let (ax, ay, az) = (ax - along * d.x, ay - along * d.y, az - along * d.z);
        let (ex, ey, ez) = (ex - edge_along * d.x, ey - edge_along * d.y, ez - edge_along * d.z);
        let edge2 = ex * ex + ey * ey + ez * ez;
        let unbound = -(ax * ex + ay * ey + az * ez) / edge2.max(Vec4::splat(f32::MIN_POSITIVE));
        let s = unbound.max(Vec4::ZERO).min(Vec4::ONE);
        let (x, y, z) = (ax + s * ex, ay + s * ey, az + s * ez);
        let radius = radius + s * taper;
        let inside2 = radius * radius - (x * x + y * y + z * z);
        let mut met = inside2.cmpgt(Vec4::ZERO).bitmask();
        let mut nearest = None;
        let mut bound = bound;
        while met != 0 {
            let lane = met.trailing_zeros() as usize & 3;
            met &= met - 1;
            let place = &self.places[leaf][lane];
            let (inside, along_axis) = (inside2[lane].sqrt(), edge_along[lane]);
            let mut deep = inside;
            if s[lane] == unbound[lane] {
                // Along the cylinder, but within the piece however small the angle between ray and axis.
                let slant = (1.0 + along_axis * along_axis / edge2[lane]).sqrt();
                deep = (inside * slant).min(inside + along_axis.abs());
            } else if place.flat[usize::from(s[lane] > 0.5)] {
                continue;
            }
            let t = along[lane] + s[lane] * along_axis - deep;
            let own = t < from.clear && place.strand == from.own;
            if t > 0.0 && t < bound && !own {
                bound = t;
                nearest = Some((lane as u32, t));
            }
        }
        nearest
    }
}

impl<'a> Strands<'a> {
    /// The strands of `hair` with a diameter at each point, every segment in `parts` ≥ 1 straight pieces;
    /// `center` becomes the origin.
    pub fn new(
        hair: &'a Hair,
        diameters: &[f32],
        frames: &'a Frames,
        parts: u32,
        center: Vec3,
    ) -> Strands<'a> {
        let bvh = StrandBvh::new(hair, diameters, frames, parts, center);
        Strands { hair, frames, parts: parts.max(1), bvh }
    }

    /// See [`StrandBvh::bounds`].
    pub fn bounds(&self) -> (Vec3A, Vec3A) {
        self.bvh.bounds()
    }

    /// See [`StrandBvh::closest`].
    pub fn closest(&self, ray: &StrandRay) -> Option<PieceId> {
        self.bvh.closest(ray).map(|(id, _)| id)
    }

    /// See [`StrandBvh::occluded`].
    pub fn occluded(&self, ray: &StrandRay) -> bool {
        self.bvh.occluded(ray)
    }

    /// The fibre where `ray` meets a piece.
    pub fn fibre_point(&self, id: PieceId, ray: &StrandRay) -> FibrePoint {
        let (leaf, lane) = (id.leaf as usize, id.lane as usize);
        let (piece, place) = (self.bvh.packs[leaf].piece(lane), self.bvh.places[leaf][lane]);
        let origin = DVec3::from(Vec3::from(ray.ray.origin));
        let d = DVec3::from(Vec3::from(ray.ray.direction)).normalize();
        let start = piece.start.truncate().as_dvec3();
        let edge = piece.edge.truncate().as_dvec3();
        let (to, across) = (start - origin, edge.reject_from_normalized(d));
        let s = (-to.dot(across) / across.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let axis_point = start + s * edge;
        let radius = f64::from(piece.start.w) + s * f64::from(piece.edge.w);

        let along = (f64::from(place.part) + s) / f64::from(self.parts);
        let (i, j) = (place.point as usize, place.point as usize + 1);
        let (points, frames) = (&self.hair.points, self.frames);
        let chord = points[i].distance(points[j]);
        let tangents = [chord * frames.tangents[i], chord * frames.tangents[j]];
        let (_, slope) = hermite([points[i], points[j]], tangents, along as f32);
        let u = slope.as_dvec3().try_normalize().unwrap_or(edge.normalize());
        let axis = frames.axes[i].lerp(frames.axes[j], along as f32).as_dvec3();
        let y = axis
            .reject_from_normalized(u)
            .try_normalize()
            .unwrap_or_else(|| u.any_orthonormal_vector());
        let side = u.cross(d).normalize_or_zero();
        let h = ((origin - axis_point).dot(side) / radius).clamp(-1.0, 1.0);
        FibrePoint {
            strand: place.strand,
            point: place.point,
            along: along as f32,
            axis_point,
            radius,
            frame: DMat3::from_cols(u, y, u.cross(y)),
            h,
        }
    }
}

fn bounds(piece: &Piece) -> Aabb {
    let a = Vec3A::from_vec4(piece.start);
    let b = a + Vec3A::from_vec4(piece.edge);
    let (ra, rb) = (piece.start.w, piece.start.w + piece.edge.w);
    Aabb { min: (a - ra).min(b - rb), max: (a + ra).max(b + rb) }
}

/// Place and slope at s of the cubic Hermite curve through two points with these tangents.
fn hermite([a, b]: [Vec3; 2], [ta, tb]: [Vec3; 2], s: f32) -> (Vec3, Vec3) {
    let r = 1.0 - s;
    // From b − a, so that the slope keeps its digits far from the origin.
    let place = a + s * s * (3.0 - 2.0 * s) * (b - a) + s * r * (r * ta - s * tb);
    let slope = 6.0 * s * r * (b - a) + r * (1.0 - 3.0 * s) * ta + s * (3.0 * s - 2.0) * tb;
    (place, slope)
}
