//! Builtin grooms and head: what a user relies on whatever the style.

use glam::Vec3;
use hairlight::hair::Hair;
use hairlight::hair::groom::{GroomOptions, STYLES, grow};
use hairlight::head::builtin::{HEAD_BOUNDS, builtin_head, head_distance, scalp_depth};
use std::collections::HashMap;

fn strands(hair: &Hair) -> impl Iterator<Item = &[Vec3]> {
    hair.offsets.windows(2).map(|o| &hair.points[o[0] as usize..o[1] as usize])
}

fn options(strands: usize) -> GroomOptions {
    GroomOptions { strands, ..Default::default() }
}

fn length(strand: &[Vec3]) -> f32 {
    strand.windows(2).map(|p| p[0].distance(p[1])).sum()
}

/// Mean turn in radians per metre.
fn curvature(hair: &Hair) -> f32 {
    let turns = strands(hair).flat_map(|s| s.windows(3));
    let turn: f32 = turns.map(|p| (p[1] - p[0]).angle_between(p[2] - p[1])).sum();
    turn / strands(hair).map(length).sum::<f32>()
}

/// Share of points deeper than 1 mm in the head.
fn share_inside(points: &[Vec3]) -> f32 {
    points.iter().filter(|&&p| head_distance(p) < -1e-3).count() as f32 / points.len() as f32
}

/// Share of points before the eyes: within 45 mm of the middle, eye height, in front of the face.
fn share_before_eyes(points: &[Vec3]) -> f32 {
    let before = |p: &&Vec3| p.x.abs() < 0.045 && p.y.abs() < 0.012 && p.z > 0.06;
    points.iter().filter(before).count() as f32 / points.len() as f32
}

/// Largest distance from a spot of the inner scalp to the nearest root.
fn widest_bald_spot(roots: &[Vec3], skin: &[Vec3]) -> f32 {
    let inner = skin.iter().filter(|&&p| scalp_depth(p) > 0.012);
    let nearest = inner
        .map(|p| roots.iter().map(|r| r.distance_squared(*p)).fold(f32::INFINITY, f32::min).sqrt());
    nearest.fold(0.0, f32::max)
}

#[test]
fn every_style_is_sound() {
    let head = builtin_head();
    for style in STYLES {
        let hair = grow(style, &options(3_000)).unwrap();
        assert_eq!(hair.offsets.len(), 3_001, "{style}");
        assert_eq!((hair.offsets[0], hair.offsets[3_000]), (0, hair.points.len() as u32));
        assert!(hair.points.iter().all(|p| p.is_finite()), "{style}: not finite");
        for strand in strands(&hair) {
            assert!((12..=40).contains(&strand.len()), "{style}: {} points", strand.len());
            assert!(strand.windows(2).all(|p| p[0].distance(p[1]) > 5e-6), "{style}: repeated");
            assert!(head_distance(strand[0]).abs() < 1e-3, "{style}: root off the skin");
        }
        let inside = share_inside(&hair.points);
        assert!(inside < 0.02, "{style}: {inside} of the points inside the head");
        let eyes = share_before_eyes(&hair.points);
        assert!(eyes < 0.001, "{style}: {eyes} of the points before the eyes");

        let roots: Vec<Vec3> = strands(&hair).map(|s| s[0]).collect();
        // 3,000 roots over 0.07 m² lie about 5 mm apart; at most 6.5 mm from any spot when measured.
        let bald = widest_bald_spot(&roots, &head.positions);
        assert!(bald < 0.009, "{style}: a bald spot of {bald} m");

        // The checks can fail: hair pushed into the head, over the face, and thinned at the crown.
        let pushed: Vec<Vec3> = hair.points.iter().map(|p| *p * Vec3::new(0.8, 1.0, 0.8)).collect();
        assert!(share_inside(&pushed) > 0.02, "{style}");
        let turned: Vec<Vec3> = hair.points.iter().map(|p| Vec3::new(p.x, p.y, -p.z)).collect();
        assert!(share_before_eyes(&turned) > 0.001, "{style}");
        let thinned: Vec<Vec3> = roots.into_iter().filter(|r| r.y < 0.105).collect();
        assert!(widest_bald_spot(&thinned, &head.positions) > 0.009, "{style}");
    }
}

#[test]
fn the_seed_decides_and_threads_do_not() {
    for style in STYLES {
        let groom = |seed| grow(style, &GroomOptions { seed, ..options(1_000) }).unwrap();
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(groom(7), alone.install(|| groom(7)), "{style}");
        let (a, b) = (groom(7), groom(8));
        let same = a.points.iter().zip(&b.points).filter(|(p, q)| p == q).count();
        assert_eq!(same, 0, "{style}: points shared between seeds");
    }
}

#[test]
fn counts_are_exact_at_the_bounds_and_errors_beyond() {
    for count in [1_000, 200_000] {
        assert_eq!(grow("bob", &options(count)).unwrap().offsets.len(), count + 1);
    }
    let wrong = [
        (options(999), "strands"),
        (options(200_001), "strands"),
        (GroomOptions { length: 0.1, ..options(1_000) }, "length"),
        (GroomOptions { curl: f32::NAN, ..options(1_000) }, "curl"),
        (GroomOptions { clump: Some(1.5), ..options(1_000) }, "clump"),
        (GroomOptions { flyaway: Some(-0.1), ..options(1_000) }, "flyaway"),
    ];
    for (options, name) in wrong {
        let line = grow("straight", &options).unwrap_err().to_string();
        assert!(line.contains(name) && !line.contains('\n'), "{line}");
    }
    let line = grow("mullet", &options(1_000)).unwrap_err().to_string();
    assert!(STYLES.iter().all(|s| line.contains(s)) && !line.contains('\n'), "{line}");
}

#[test]
fn options_do_what_they_say() {
    for (style, shortest, longest) in [
        ("straight", 0.10, 0.60),
        ("wavy", 0.08, 0.60),
        ("curly", 0.05, 0.60),
        ("bob", 0.01, 0.45),
        ("ponytail", 0.15, 0.65),
    ] {
        let groom = |o: GroomOptions| grow(style, &o).unwrap();
        let base = groom(options(1_000));
        let mean = |h: &Hair| strands(h).map(length).sum::<f32>() / 1_000.0;
        let (low, high) = strands(&base)
            .map(length)
            .fold((f32::INFINITY, 0.0_f32), |(l, h), x| (l.min(x), h.max(x)));
        assert!(low > shortest && high < longest, "{style}: lengths {low} to {high}");

        let straightened = groom(GroomOptions { curl: 0.0, ..options(1_000) });
        assert!(curvature(&straightened) < 0.97 * curvature(&base), "{style}: curl");
        // The shortest hair still has at least two points a strand, apart.
        for (factor, less) in [(0.2, true), (2.0, false)] {
            let hair = groom(GroomOptions { length: factor, ..options(1_000) });
            assert_eq!(mean(&hair) < mean(&base), less, "{style}: length {factor}");
            assert!(hair.points.iter().all(|p| p.is_finite()), "{style}: length {factor}");
            assert!(share_inside(&hair.points) < 0.02, "{style}: length {factor}");
        }
        for changed in [
            GroomOptions { clump: Some(1.0), ..options(1_000) },
            GroomOptions { flyaway: Some(1.0), ..options(1_000) },
        ] {
            assert_ne!(groom(changed), base, "{style}");
        }
    }
}

#[test]
fn the_head_is_a_closed_smooth_surface_of_human_size() {
    let head = builtin_head();
    assert!((10_000..40_000).contains(&head.triangles.len()), "{}", head.triangles.len());
    let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
    let mut volume = 0.0;
    let mut against = 0;
    for t in &head.triangles {
        let [a, b, c] = t.map(|i| head.positions[i as usize]);
        volume += a.dot(b.cross(c)) / 6.0;
        let face = (b - a).cross(c - a);
        against += usize::from(face.dot(head.normals[t[0] as usize]) < 0.0);
        for k in 0..3 {
            *edges.entry((t[k], t[(k + 1) % 3])).or_default() += 1;
        }
    }
    // Every directed edge is met by its reverse as often: no holes, one orientation.
    let open = edges.iter().filter(|&(&(a, b), n)| edges.get(&(b, a)) != Some(n)).count();
    assert_eq!(open, 0, "open edges");
    // A head and bust: 4 to 5 litres and a good deal of shoulder; positive where faces point
    // outward.
    assert!((0.006..0.03).contains(&volume), "volume {volume} m³");
    let share = against as f32 / head.triangles.len() as f32;
    assert!(share < 0.005, "{share} of the triangles face against their normal");
    assert!(head.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
    let off = head.positions.iter().map(|&p| head_distance(p).abs()).fold(0.0, f32::max);
    assert!(off < 5e-4, "a vertex {off} m off the surface");
    for p in &head.positions {
        assert!(p.cmpge(HEAD_BOUNDS[0]).all() && p.cmple(HEAD_BOUNDS[1]).all());
    }
    // Chin to crown about 0.23 m, about 0.155 m wide above the ears.
    let crown = head.positions.iter().map(|p| p.y).fold(f32::MIN, f32::max);
    assert!((0.110..0.122).contains(&crown), "crown at {crown}");
    let wide = head.positions.iter().filter(|p| p.y > 0.03).map(|p| p.x).fold(0.0, f32::max);
    assert!((0.073..0.082).contains(&wide), "half width {wide}");
}
