//! Smooth surfaces of few triangles: normals between corners, where rays leave from, folds, and light between vertices.

use glam::{DVec3, Vec3};
use hairlight::gpu::frame::{Background, Parts, Renderer};
use hairlight::gpu::method::MethodData;
use hairlight::hair::Hair;
use hairlight::head::{FineHead, Head, HeadRays, SurfacePlace};
use hairlight::light::HairMedium;
use hairlight::reference::tracer::skin::Skin;
use hairlight::reference::tracer::strands::StrandRay;
use hairlight::scattering::model::Model;
use hairlight::scene::{FibreSpec, Lens};
use hairlight::srbf::{SrbfLight, split_wide};
use hairlight::stage::Geometry;

use crate::wgsl::cpu;

/// A ball of few triangles.
fn ball() -> Head {
    const ROWS: u32 = 6;
    const COLUMNS: u32 = 10;
    let mut positions = vec![Vec3::Y, Vec3::NEG_Y];
    for row in 1..ROWS {
        let (sin, cos) = (std::f32::consts::PI * row as f32 / ROWS as f32).sin_cos();
        for column in 0..COLUMNS {
            let (s, c) = (std::f32::consts::TAU * column as f32 / COLUMNS as f32).sin_cos();
            positions.push(Vec3::new(sin * c, cos, sin * s));
        }
    }
    let at = |row: u32, column: u32| 2 + (row - 1) * COLUMNS + column % COLUMNS;
    let mut triangles = Vec::new();
    for column in 0..COLUMNS {
        triangles.push([0, at(1, column + 1), at(1, column)]);
        triangles.push([1, at(ROWS - 1, column), at(ROWS - 1, column + 1)]);
        for row in 1..ROWS - 1 {
            let [a, b] = [row, row + 1].map(|row| at(row, column));
            let [c, d] = [row, row + 1].map(|row| at(row, column + 1));
            triangles.extend([[a, c, b], [c, d, b]]);
        }
    }
    Head { normals: positions.clone(), positions, triangles }
}

/// Weights of three corners, all over a triangle.
fn weights() -> impl Iterator<Item = [f32; 3]> {
    let steps = 8;
    (0..steps).flat_map(move |i| {
        (0..steps - i).map(move |j| {
            let [v, w] = [i, j].map(|k| (k as f32 + 0.3) / steps as f32);
            [1.0 - v - w, v, w]
        })
    })
}

#[test]
fn the_tracers_normals_are_those_of_the_smooth_surface() {
    // However small the triangles are.
    for scale in [1e-3, 1.0, 1e3] {
        let unit = ball();
        let head = Head { positions: unit.positions.iter().map(|&p| scale * p).collect(), ..unit };
        let skin = Skin::new(&head, Vec3::ONE, Vec3::ZERO);
        let (mut off, mut flat) = (0.0f64, 0.0f64);
        for corners in &head.triangles {
            for weights in weights() {
                let place = SurfacePlace::on(*corners, weights);
                let (at, normal) = (place.of(&head.positions), place.of(&head.normals).normalize());
                let ray = StrandRay::free(3.0 * at, -at.normalize());
                let (id, t) = skin.closest(&ray.ray).unwrap();
                let found = skin.skin_point(id, t, &ray.ray).normal;
                off = off.max(found.distance(normal.as_dvec3()));
                // The control: that of a corner.
                flat = flat.max(head.normals[corners[0] as usize].as_dvec3().distance(found));
            }
        }
        println!("size {scale}: {off:.1e} off, a corner's {flat:.2}");
        assert!(off < 1e-3 && flat > 0.3, "{scale}: {off} {flat}");
    }
}

#[test]
fn a_ball_of_few_triangles_does_not_shade_what_faces_the_light() {
    let head = ball();
    let rays = HeadRays::new(&head, Vec3::ZERO);
    let omega = Vec3::new(0.3, 0.2, 0.9).normalize();
    // The share of what faces the light by its smooth normal that is in the shade.
    let shaded = |lifted: bool| {
        let (mut dark, mut all) = (0, 0);
        for corners in &head.triangles {
            for weights in weights() {
                let place = SurfacePlace::on(*corners, weights);
                let normal = place.of(&head.normals).normalize();
                if normal.dot(omega) < 0.05 {
                    continue;
                }
                let at = match lifted {
                    true => place.lifted(&head, 1.0),
                    false => place.of(&head.positions),
                };
                all += 1;
                let ray = StrandRay::free(at + 1e-5 * normal, omega);
                dark += usize::from(rays.occluded(&ray.ray));
            }
        }
        dark as f64 / all as f64
    };
    println!("in the shade: lifted {:.3}, on the triangles {:.3}", shaded(true), shaded(false));
    assert!(shaded(true) < 0.005 && shaded(false) > 0.05);
    // What is lifted stays within the ball, and corners stay where they are.
    for corners in &head.triangles {
        for weights in weights() {
            let place = SurfacePlace::on(*corners, weights);
            let (flat, lifted) = (place.of(&head.positions), place.lifted(&head, 1.0));
            assert!(lifted.length() > flat.length() && lifted.length() < 1.06, "{lifted}");
            assert!(place.lifted(&head, -1.0).distance(flat) < 1e-6, "hollow from inside");
        }
        let corner = SurfacePlace::vertex(corners[0]);
        assert_eq!(corner.lifted(&head, 1.0), head.positions[corners[0] as usize]);
    }
}

#[test]
fn corners_of_a_fold_have_the_normals_of_their_triangles() {
    // A sheet folded back onto itself: its smooth normals lie in it.
    let mut folded = Head {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(0.5, 0.05, 1.0), Vec3::new(0.5, -0.05, 1.0)],
        normals: vec![Vec3::NEG_Z, Vec3::NEG_Z, Vec3::Y, Vec3::NEG_Y],
        triangles: vec![[0, 2, 1], [0, 1, 3]],
    };
    let turned = |head: &Head| {
        let of = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| head.positions[i as usize]);
            let facet = (b - a).cross(c - a).normalize();
            t.map(|i| head.normals[i as usize].dot(facet))
        };
        head.triangles.iter().flat_map(of).filter(|&cosine| cosine < 0.25).count()
    };
    let (before, places) = (turned(&folded), folded.positions.clone());
    folded.split_folds();
    assert_eq!((before, turned(&folded)), (4, 0));
    assert_eq!(folded.positions[..4], places[..]);
    // A ball has none.
    let mut round = ball();
    round.split_folds();
    assert_eq!(round, ball());
}

/// The shadow of a strand on a floor whose vertices lie farther apart than pixels: with what is seen said, dark within two
/// pixels, on the device as on the CPU.
#[test]
fn shadows_on_the_head_are_as_crisp_as_pixels() {
    let mut hair = Hair { offsets: vec![0, 17], ..Hair::default() };
    hair.points.extend((0..=16).map(|k| Vec3::new(0.0, 0.5, k as f32 / 8.0 - 1.0)));
    hair.thickness = Some(vec![1.0; 17]);
    let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
    let floor = Head {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        normals: vec![Vec3::Y; 4],
        triangles: vec![[0, 2, 1], [0, 3, 2]],
    };
    let stage = Geometry::new(hair, Some(floor), 0.3);
    // From aside, so that the shadow lies beside the strand.
    let direction = DVec3::new(0.8, 1.0, 0.0).normalize();
    let sun = SrbfLight { direction, lambda: 0.005, rgb: [1e4; 3] };
    let lights = [vec![sun], split_wide(&[])].concat();
    let medium = HairMedium::new(&stage, true);
    let lens = Lens {
        eye: DVec3::new(0.0, 6.0, 0.0),
        forward: DVec3::NEG_Y,
        right: 0.2 * DVec3::X,
        up: 0.2 * DVec3::NEG_Z,
        distance: 6.0,
        size: [256, 256],
    };
    let method = MethodData::fast(&FibreSpec::default().resolve(), Model::Marschner, 2);
    let row = |detail: bool, device: bool| -> Vec<f32> {
        let mut renderer = Renderer::new(cpu(), &method, &stage).unwrap();
        renderer.trace_on_device = device;
        let (points, head) = renderer.visible(&[lens], 4, 4).unwrap();
        let lit = medium.bring(&stage, lights.clone(), &points, &|_| true).unwrap();
        let (at, seen) = ((&stage, &medium), (&points[..], Some(&head).filter(|_| detail)));
        lit.show_at(at, &mut renderer, &method, None, seen, 1.0, &|_| true).unwrap();
        let parts = Parts { single: true, global: true, local: true };
        let frame = renderer.render(&lens, 4, Background::Transparent, parts).unwrap();
        (0..256).map(|x| frame.pixels[128 * 256 + x][0]).collect()
    };
    let [fine, device, coarse] =
        [(true, false), (true, true), (false, false)].map(|(detail, on)| row(detail, on));
    // Left of the strand its shadow: pixels neither dark nor bright there.
    let between = |row: &[f32]| {
        let lit = row[200];
        row[32..110].iter().filter(|&&v| v > 0.1 * lit && v < 0.9 * lit).count()
    };
    let dark = |row: &[f32]| row[32..110].iter().filter(|&&v| v < 0.1 * row[200]).count();
    println!(
        "pixels between: {} of {} dark; by vertices {}",
        between(&fine),
        dark(&fine),
        between(&coarse)
    );
    assert!(dark(&fine) > 10 && between(&fine) <= 4, "{fine:?}");
    assert!(between(&coarse) > between(&fine) + 2, "the control: {:?}", &coarse[32..110]);
    let off: f32 = fine.iter().zip(&device).map(|(a, b)| (a - b).abs()).sum();
    assert!(off < 1e-2 * fine.iter().sum::<f32>(), "device {off}");
}

#[test]
fn a_lattice_holds_each_point_once_where_the_shader_looks_for_it() {
    let head = ball();
    let fine = FineHead::new(&head, 0.4);
    let all: Vec<(u32, u64, bool)> =
        (0..fine.head.triangles.len() as u32).map(|t| (t, 1 << (t % 3), true)).collect();
    for across in [2, 4, 8] {
        let detail = hairlight::head::Detail::new(&fine, across, &all);
        let places: Vec<Vec3> =
            detail.points.iter().map(|p| detail.place(&fine, p).of(&head.positions)).collect();
        // Euler: as many points as the closed surface's finer triangles have vertices.
        assert_eq!(places.len(), 2 + fine.head.triangles.len() * (across * across) as usize / 2);
        for (triangle, &[a, b, c]) in fine.head.triangles.iter().enumerate() {
            let corners = [a, b, c].map(|i| fine.head.positions[i as usize]);
            let first = detail.words[triangle] as usize;
            for j in 0..=across {
                for i in 0..=across - j {
                    // `cell_of` of shaders/resolve.wgsl.
                    let place = (j * (across + 1) - j * j.saturating_sub(1) / 2 + i) as usize;
                    let [v, w] = [i, j].map(|k| k as f32 / across as f32);
                    let wanted = (1.0 - v - w) * corners[0] + v * corners[1] + w * corners[2];
                    let found = places[detail.words[first + place] as usize];
                    assert!(found.distance(wanted) < 1e-5, "{triangle} {i} {j}");
                }
            }
        }
        // Points on an edge are looked for by the lights of both its triangles.
        let several = detail.points.iter().filter(|point| point.lights.count_ones() > 1).count();
        assert!(several > 0 && several < places.len());
    }
}
