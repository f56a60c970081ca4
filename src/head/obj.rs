//! Heads from Wavefront OBJ files.
//!
//! Of a file only `v`, `vn` and `f` matter here; all objects, groups and materials become one mesh.
//! Normals that the file lacks are the sums of the face normals around a position, weighted by area and
//! welded by position, so that a texture seam makes no crease.

use super::{Head, Up, builtin::builtin_head, check_scale};
use anyhow::{Context, Result, anyhow, ensure};
use glam::{DVec3, Vec3};
use std::collections::HashMap;

/// Twice a triangle's area over its longest edge squared, below which rounding of f32 coordinates decides
/// where the triangle faces.
const FLATTEST_TRIANGLE: f64 = 1e-7;

/// A head in the world's frame, and what was done to it on the way.
#[derive(Clone, Debug, Default)]
pub struct LoadedHead {
    pub head: Head,
    /// Triangles left out: a corner is NaN or infinite, or they have no area.
    pub dropped_triangles: usize,
    /// Vertices whose normal was computed from the triangles around them.
    pub computed_normals: usize,
}

/// Loads `source`, an OBJ file's path or `builtin`, turned by `up` and then multiplied by `scale` (1e-9 to
/// 1e9). The builtin head is y up whatever `up` says.
///
/// Fails, in one line, where the file cannot be read, is no OBJ, or holds no triangle with an area.
pub fn load(source: &str, up: Up, scale: f32) -> Result<LoadedHead> {
    check_scale(scale)?;
    if source == "builtin" {
        let mut head = builtin_head();
        head.positions.iter_mut().for_each(|p| *p *= scale);
        return Ok(LoadedHead { head, ..Default::default() });
    }
    let bytes = std::fs::read(source).with_context(|| format!("{source}: cannot be read"))?;
    parse(&bytes, up, scale).with_context(|| source.to_owned())
}

fn parse(bytes: &[u8], up: Up, scale: f32) -> Result<LoadedHead> {
    // Names in other encodings than UTF-8 must not matter, nor what tobj would take for faces ('l') or open
    // as another file ('mtllib').
    let text = String::from_utf8_lossy(bytes);
    let geometry: Vec<&str> = text
        .lines()
        .filter(|line| matches!(line.split_whitespace().next(), Some("v" | "vn" | "f")))
        .collect();
    let options = tobj::LoadOptions {
        single_index: true,
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
    };
    let (models, _) = tobj::load_obj_buf(&mut geometry.join("\n").as_bytes(), &options, |_| {
        Ok(Default::default())
    })
    .map_err(|e| anyhow!("not a sound OBJ file ({e}): export it again as OBJ"))?;
    let mesh = match models.into_iter().next() {
        Some(model) => model.mesh,
        None => tobj::Mesh::default(),
    };

    let vectors = |flat: &[f32]| -> Vec<Vec3> {
        flat.chunks_exact(3).map(|v| up.to_world(Vec3::from_slice(v))).collect()
    };
    let positions: Vec<Vec3> = vectors(&mesh.positions).iter().map(|&p| p * scale).collect();
    // Fewer normals than vertices: some faces name none, and which ones tobj no longer tells.
    let given_normals = match vectors(&mesh.normals) {
        normals if normals.len() == positions.len() => normals,
        _ => vec![Vec3::ZERO; positions.len()],
    };

    let corners = |t: &[u32]| [0, 1, 2].map(|i| positions[t[i] as usize].as_dvec3());
    let triangles: Vec<[u32; 3]> = mesh
        .indices
        .chunks_exact(3)
        .filter(|t| has_area(corners(t)))
        .map(|t| [t[0], t[1], t[2]])
        .collect();
    ensure!(
        !triangles.is_empty(),
        "holds no triangle with an area: give a mesh of faces, or head 'none'"
    );

    // Only vertices that a triangle uses stay.
    let mut head = Head::default();
    let mut new_index = vec![u32::MAX; positions.len()];
    let mut normal_sums: HashMap<[u32; 3], DVec3> = HashMap::new();
    for triangle in &triangles {
        let area_normal = area_normal(corners(triangle));
        for &old in triangle {
            let old = old as usize;
            *normal_sums.entry(weld_key(positions[old])).or_default() += area_normal;
            if new_index[old] == u32::MAX {
                new_index[old] = head.positions.len() as u32;
                head.positions.push(positions[old]);
                head.normals.push(given_normals[old]);
            }
        }
        head.triangles.push(triangle.map(|v| new_index[v as usize]));
    }

    let mut computed_normals = 0;
    for (normal, &position) in head.normals.iter_mut().zip(&head.positions) {
        *normal = normal.try_normalize().unwrap_or_else(|| {
            computed_normals += 1;
            // Faces back to back cancel; any unit vector serves there.
            let sum = normal_sums[&weld_key(position)];
            sum.try_normalize().unwrap_or(DVec3::Y).as_vec3()
        });
    }
    Ok(LoadedHead {
        dropped_triangles: mesh.indices.len() / 3 - head.triangles.len(),
        computed_normals,
        head,
    })
}

/// Normal of a triangle times twice its area. In f64: the products of a head of 1e-6 units would be lost.
fn area_normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

fn has_area([a, b, c]: [DVec3; 3]) -> bool {
    let longest =
        (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    // False for NaN and for infinite corners, whose ratio is NaN.
    area_normal([a, b, c]).length() / longest > FLATTEST_TRIANGLE
}

/// Equal for equal positions (−0 counts as 0).
fn weld_key(p: Vec3) -> [u32; 3] {
    (p + Vec3::ZERO).to_array().map(f32::to_bits)
}
