//! Heads from Wavefront OBJ files.
//!
//! Of a file only `v`, `vn` and `f` matter here; all objects, groups and materials become one mesh.
//! Normals that the file lacks are the sums of the face normals around a position, weighted by area and
//! welded by position, so that a texture seam makes no crease.

use super::{Head, builtin::builtin_head, orient::face_outward};
use crate::file_kind::{FileKind, Role, lossy_text};
use anyhow::{Context, Result, anyhow, bail, ensure};
use glam::{DVec3, Vec3};
use std::collections::HashMap;
use std::fmt::Write as _;

/// Twice a triangle's area over its longest edge squared, below which rounding of f32 coordinates decides
/// where the triangle faces.
const FLATTEST_TRIANGLE: f64 = 1e-7;
/// A vertex that lies so many times as far from the middle as the median vertex is no part of a head, nor of a whole
/// body with a finely meshed face.
const STRAY_REACH: f32 = 300.0;

/// A head in the frame of its file, and what was done to it on the way.
#[derive(Clone, Debug, Default)]
pub struct LoadedHead {
    pub head: Head,
    /// Triangles left out: a corner is NaN, infinite or far from all others, or they have no area.
    pub dropped_triangles: usize,
    /// Triangles and normals of the file that faced inward, and were turned.
    pub turned_triangles: usize,
    pub turned_normals: usize,
    /// Vertices whose normal was computed from the triangles around them.
    pub computed_normals: usize,
}

impl LoadedHead {
    /// What was mended, a line each.
    pub fn notes(&self) -> Vec<String> {
        let counts = [
            (
                self.dropped_triangles,
                "triangles left out: a corner is NaN, infinite or far from all others, or they have no area",
            ),
            (self.turned_triangles, "triangles faced inward: turned outward"),
            (self.turned_normals, "normals pointed inward: turned outward"),
        ];
        let told = counts.iter().filter(|(count, _)| *count > 0);
        told.map(|(count, what)| format!("head: {count} {what}")).collect()
    }
}

/// Loads `source`, an OBJ file's path or `builtin`.
///
/// Fails, in one line, where the file cannot be read, is no OBJ, or holds no triangle with an area.
pub fn load(source: &str) -> Result<LoadedHead> {
    if source == "builtin" {
        return Ok(LoadedHead { head: builtin_head(), ..Default::default() });
    }
    let bytes = std::fs::read(source).with_context(|| format!("{source}: cannot be read"))?;
    parse(&bytes).with_context(|| source.to_owned())
}

fn parse(bytes: &[u8]) -> Result<LoadedHead> {
    match FileKind::of(bytes) {
        FileKind::Obj | FileKind::Text => {}
        other => bail!(other.refusal(Role::Head)),
    }
    let options = tobj::LoadOptions {
        single_index: true,
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
    };
    // Names in other encodings than UTF-8 must not matter.
    let geometry = geometry(&lossy_text(bytes));
    let (models, _) =
        tobj::load_obj_buf(&mut geometry.as_bytes(), &options, |_| Ok(Default::default()))
            .map_err(|e| anyhow!("not a sound OBJ file ({e}): export it again as OBJ"))?;
    let mesh = match models.into_iter().next() {
        Some(model) => model.mesh,
        None => tobj::Mesh::default(),
    };

    let vectors =
        |flat: &[f32]| -> Vec<Vec3> { flat.chunks_exact(3).map(Vec3::from_slice).collect() };
    let positions = vectors(&mesh.positions);
    // Fewer normals than vertices: some faces name none, and which ones tobj no longer tells.
    let mut given_normals = match vectors(&mesh.normals) {
        normals if normals.len() == positions.len() => normals,
        _ => vec![Vec3::ZERO; positions.len()],
    };

    let corners = |t: &[u32]| [0, 1, 2].map(|i| positions[t[i] as usize].as_dvec3());
    let stray = stray_vertices(&positions, &mesh.indices);
    let mut triangles: Vec<[u32; 3]> = mesh
        .indices
        .chunks_exact(3)
        .filter(|t| !t.iter().any(|&v| stray[v as usize]) && has_area(corners(t)))
        .map(|t| [t[0], t[1], t[2]])
        .collect();
    ensure!(
        !triangles.is_empty(),
        "holds no triangle with an area: give a mesh of faces, or head 'none'"
    );
    let (turned_triangles, turned_normals) =
        face_outward(&positions, &mut triangles, &mut given_normals);

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
        turned_triangles,
        turned_normals,
        computed_normals,
        head,
    })
}

/// The lines of an OBJ that matter, as tobj reads them: `v`, `vn` and `f`. Lines end at LF, CR or both, and go on after
/// a backslash; what follows a `#` is gone.
fn geometry(text: &str) -> String {
    let mut geometry = String::with_capacity(text.len());
    let mut textures = 0i64;
    let mut begun = String::new();
    // Between CR and LF there is an empty line, which ends no statement that goes on.
    for line in text.replace("\r\n", "\n").split(['\n', '\r']) {
        let whole = line.split_whitespace().take_while(|word| !word.starts_with('#'));
        let words = whole.fold(std::mem::take(&mut begun), |line, word| line + " " + word);
        let keyword = words.split_whitespace().next().unwrap_or_default();
        if !matches!(keyword, "v" | "vt" | "vn" | "f") {
            continue;
        }
        if let Some(goes_on) = words.strip_suffix('\\') {
            begun = goes_on.to_owned();
            continue;
        }
        let words = words.split_whitespace().skip(1);
        match keyword {
            "vt" => {
                textures += 1;
                continue;
            }
            "f" => {
                geometry.push('f');
                words.for_each(|corner| add_corner(&mut geometry, corner, textures));
            }
            _ => {
                geometry.push_str(keyword);
                // What follows a place is a weight or a colour.
                for word in words.take(3) {
                    geometry.push(' ');
                    geometry.push_str(if is_nan(word) { "nan" } else { word });
                }
            }
        }
        geometry.push('\n');
    }
    geometry
}

/// Adds a corner of a face. Texture coordinates are left out of the geometry, so none is counted back from its end.
fn add_corner(geometry: &mut String, corner: &str, textures: i64) {
    let mut parts = corner.splitn(3, '/');
    let (place, texture) = (parts.next().unwrap_or_default(), parts.next());
    let _ = write!(geometry, " {place}");
    let Some(texture) = texture else { return };
    match texture.parse::<i64>() {
        Ok(back) if back < 0 => {
            let _ = write!(geometry, "/{}", textures.saturating_add(back).saturating_add(1));
        }
        _ => {
            let _ = write!(geometry, "/{texture}");
        }
    }
    if let Some(normal) = parts.next() {
        let _ = write!(geometry, "/{normal}");
    }
}

/// Whether a number is NaN or infinite as C libraries write them: `-nan(ind)`, `1.#QNAN`, `-1.#IND00`.
fn is_nan(word: &str) -> bool {
    let word = word.trim_start_matches(['+', '-']).to_ascii_lowercase();
    word.starts_with("nan") || word.starts_with("1.#")
}

/// Of each vertex, whether it lies far from all others that a triangle uses.
fn stray_vertices(positions: &[Vec3], indices: &[u32]) -> Vec<bool> {
    let used = indices.iter().map(|&i| positions[i as usize]).filter(|p| p.is_finite());
    let (middle, distance) = crate::hair::median_distance(used);
    // Half of a head is not in one place, but a plate of two triangles may be.
    let reach = STRAY_REACH * distance;
    positions.iter().map(|p| distance > 0.0 && p.distance(middle) > reach).collect()
}

/// Normal of a triangle times twice its area. In f64: the products of a head of 1e-6 units would be lost.
pub(super) fn area_normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

fn has_area([a, b, c]: [DVec3; 3]) -> bool {
    let longest =
        (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    // False for NaN and for infinite corners, whose ratio is NaN.
    area_normal([a, b, c]).length() / longest > FLATTEST_TRIANGLE
}

/// Equal for equal positions (−0 counts as 0).
pub(super) fn weld_key(p: Vec3) -> [u32; 3] {
    (p + Vec3::ZERO).to_array().map(f32::to_bits)
}
