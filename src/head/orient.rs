//! Which way a mesh faces: outward, whatever its file says.
//!
//! Triangles that share an edge are made to face alike, and each surface that they make is turned so that the volume it
//! bounds is positive.

use super::obj::{area_normal, weld_key};
use glam::{DVec3, Vec3};
use std::collections::HashMap;

/// Of a surface with a hole, ∫ r·n over ∫ |r|, r from its middle, from where on it tells outside from inside: 1 of a
/// sphere, 0.5 of half of one, 0 of a plane.
const HOLLOW: f64 = 0.1;
/// A surface with a hole has a say of its own if it has this share of the area: the inside of a mouth has not.
const LARGE: f64 = 0.1;

/// What is known of a surface.
#[derive(Clone, Default)]
struct Patch {
    area: f64,
    middle: DVec3,
    /// ∫ r·n and ∫ |r| from the middle, as its first triangle faces.
    outward: f64,
    reach: f64,
    open: bool,
    /// The area of triangles that face as the first.
    alike: f64,
}

/// Turns triangles, and normals of vertices that have one (others are zero), outward. How many of both were turned.
pub fn face_outward(
    positions: &[Vec3],
    triangles: &mut [[u32; 3]],
    normals: &mut [Vec3],
) -> (usize, usize) {
    let (of, against, open) = patches(positions, triangles);
    let corners = |t: &[u32; 3]| t.map(|v| positions[v as usize].as_dvec3());
    // Middle and area-weighted normal, in turn with the patch's first.
    let facet = |i: usize| {
        let [a, b, c] = corners(&triangles[i]);
        let normal = area_normal([a, b, c]);
        ((a + b + c) / 3.0, if against[i] { -normal } else { normal })
    };
    let mut all = vec![Patch::default(); open.len()];
    for (i, &patch) in of.iter().enumerate() {
        let (place, normal) = facet(i);
        let (patch, area) = (&mut all[patch], normal.length());
        patch.area += area;
        patch.middle += area * place;
        patch.alike += if against[i] { 0.0 } else { area };
    }
    for (patch, open) in all.iter_mut().zip(open) {
        patch.middle /= patch.area;
        patch.open = open;
    }
    for (i, &patch) in of.iter().enumerate() {
        let (place, normal) = facet(i);
        let patch = &mut all[patch];
        let r = place - patch.middle;
        patch.outward += r.dot(normal);
        patch.reach += r.length() * normal.length();
    }

    // Of those that tell, the area that faces inward in the file.
    let area: f64 = all.iter().map(|patch| patch.area).sum();
    let own = |patch: &Patch| {
        let share = patch.outward / patch.reach.max(f64::MIN_POSITIVE);
        let tells = !patch.open || (share.abs() > HOLLOW && patch.area > LARGE * area);
        (tells && share != 0.0).then_some(share < 0.0)
    };
    let balance: f64 = all
        .iter()
        .filter_map(|patch| Some((patch, own(patch)?)))
        .map(|(patch, first)| {
            let inward = if first { patch.alike } else { patch.area - patch.alike };
            2.0 * inward - patch.area
        })
        .sum();
    let turn_first: Vec<bool> = all
        .iter()
        .map(|patch| {
            // Else it follows the rest, from what most of it says.
            let most_against = 2.0 * patch.alike < patch.area;
            own(patch).unwrap_or(most_against ^ (balance > 0.0))
        })
        .collect();
    let mut turned = 0;
    for (i, triangle) in triangles.iter_mut().enumerate() {
        if against[i] ^ turn_first[of[i]] {
            triangle.swap(1, 2);
            turned += 1;
        }
    }

    // Normals of the file may say otherwise than its triangles: a mirrored export turns these alone.
    let mut agree = vec![0.0; all.len()];
    let mut patch_of = vec![usize::MAX; positions.len()];
    for (triangle, &patch) in triangles.iter().zip(&of) {
        let normal = area_normal(corners(triangle));
        for &v in triangle {
            patch_of[v as usize] = patch;
            agree[patch] += normal.dot(normals[v as usize].as_dvec3());
        }
    }
    let mut turned_normals = 0;
    for (normal, patch) in normals.iter_mut().zip(patch_of) {
        if agree.get(patch).is_some_and(|&agree| agree < 0.0) && *normal != Vec3::ZERO {
            *normal = -*normal;
            turned_normals += 1;
        }
    }
    (turned, turned_normals)
}

/// Triangles that hang together by edges of two: the patch of each, whether it faces against its patch's first, and of
/// each patch whether it has a border.
fn patches(positions: &[Vec3], triangles: &[[u32; 3]]) -> (Vec<usize>, Vec<bool>, Vec<bool>) {
    let mut places = HashMap::new();
    let place: Vec<u32> = positions
        .iter()
        .map(|&p| {
            let next = places.len() as u32;
            *places.entry(weld_key(p)).or_insert(next)
        })
        .collect();
    // Both ends, triangle, and whether it passes from the lower to the higher.
    let mut edges: Vec<([u32; 2], usize, bool)> = Vec::with_capacity(3 * triangles.len());
    for (i, triangle) in triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|v| place[v as usize]);
        let ends = [[a, b], [b, c], [c, a]];
        edges.extend(ends.map(|[a, b]| ([a.min(b), a.max(b)], i, a < b)));
    }
    edges.sort_unstable();
    let mut neighbours: Vec<Vec<(usize, bool)>> = vec![Vec::new(); triangles.len()];
    for shared in edges.chunk_by(|a, b| a.0 == b.0) {
        if let [(_, i, up), (_, j, also_up)] = *shared {
            neighbours[i].push((j, up == also_up));
            neighbours[j].push((i, up == also_up));
        }
    }
    let mut of = vec![usize::MAX; triangles.len()];
    let mut against = vec![false; triangles.len()];
    let mut open = Vec::new();
    for first in 0..triangles.len() {
        if of[first] != usize::MAX {
            continue;
        }
        of[first] = open.len();
        open.push(false);
        let mut waiting = vec![first];
        while let Some(i) = waiting.pop() {
            open[of[first]] |= neighbours[i].len() < 3;
            for &(j, opposed) in &neighbours[i] {
                if of[j] == usize::MAX {
                    (of[j], against[j]) = (of[first], against[i] ^ opposed);
                    waiting.push(j);
                }
            }
        }
    }
    // One-sided surfaces stay as they are.
    let mut twisted = vec![false; open.len()];
    for (i, around) in neighbours.iter().enumerate() {
        twisted[of[i]] |= around.iter().any(|&(j, opposed)| against[j] != against[i] ^ opposed);
    }
    against.iter_mut().zip(&of).for_each(|(against, &patch)| *against &= !twisted[patch]);
    (of, against, open)
}
