//! Points between those of a groom, and what is painted there.

use glam::Vec3;
use hairlight::hair::{Hair, refine};
use hairlight::paint::{Channel, Paint};
use hairlight::scene::Scene;
use hairlight::stage::Geometry;

const MANY: usize = 1 << 20;

/// A quarter of a circle in five points, a straight strand of two, and one of a lone point.
fn groom() -> Hair {
    let arc = (0..5).map(|i| {
        let angle = std::f32::consts::FRAC_PI_8 * i as f32;
        Vec3::new(angle.cos(), angle.sin(), 0.0)
    });
    let others = [Vec3::ZERO, Vec3::new(0.0, 0.0, 0.3), Vec3::ONE];
    let points: Vec<Vec3> = arc.chain(others).collect();
    let thickness = Some((0..points.len()).map(|i| i as f32).collect());
    let color = Some(points.iter().map(|p| p.to_array()).collect());
    Hair { points, offsets: vec![0, 5, 7, 8], thickness, color, transparency: None }
}

#[test]
fn refined_strands_lie_on_their_curve() {
    let groom = groom();
    let (hair, refined) = refine(&groom, 0.1, MANY).unwrap();
    assert_eq!(refined.places.len(), hair.points.len());
    assert_eq!(hair.offsets, [0, 17, 21, 22]);
    let mut kept = 0;
    for (i, &(first, s)) in refined.places.iter().enumerate() {
        let first = first as usize;
        assert!((0.0..1.0).contains(&s));
        if s == 0.0 {
            assert_eq!(hair.points[i], groom.points[first]);
            kept += 1;
        }
        let of = |values: &Option<Vec<f32>>, i: usize| values.as_ref().unwrap()[i];
        let expected = of(&groom.thickness, first) + s;
        assert!((of(&hair.thickness, i) - expected).abs() < 1e-5, "{i}");
    }
    assert_eq!(kept, groom.points.len());
    let off = |p: &Vec3| (p.length() - 1.0).abs();
    let most = hair.points[..17].iter().map(off).fold(0.0, f32::max);
    let chords = groom.points[..5].windows(2).map(|ends| off(&(0.5 * (ends[0] + ends[1]))));
    let most_of_chords = chords.fold(0.0, f32::max);
    println!("off a circle by {most:.5}; chords by {most_of_chords:.5}");
    // At a strand's end the tangent is that of the chord.
    assert!(most < 0.6 * most_of_chords, "{most} {most_of_chords}");
    // Strands whose points are near enough stay as they are, and so do those that would be too many.
    assert!(refine(&groom, 0.5, MANY).is_none());
    assert!(refine(&groom, 0.1, groom.points.len()).is_none());
    let (some, _) = refine(&groom, 0.1, 15).unwrap();
    assert!(some.points.len() <= 15 && some.points.len() > groom.points.len());
}

#[test]
fn paint_of_a_groom_is_found_between_its_points() {
    let mut scene = Scene::default();
    scene.hair.strands = 1000;
    let bare = Geometry::load(&scene).unwrap();
    let refined = bare.refined.clone().expect("the bob's points are far apart");
    let groom = bare.groom();
    assert_eq!(groom.points.len(), 1000 * 26);
    assert!(bare.hair.points.len() > groom.points.len());
    let mut paint = Paint::bare(groom.points.len());
    for point in (0..groom.points.len()).step_by(2) {
        paint.layer_mut(Channel::Absorption).set(point, [0.5, 1.0, 2.0], 1.0);
        paint.layer_mut(Channel::Thickness).set(point, [3.0, 0.0, 0.0], 1.0);
    }
    let stage = Geometry::load_under(Some(&paint), &scene).unwrap();
    let fibres = stage.fibres_under(Some(&paint), &scene).unwrap();
    assert_eq!(fibres.points().len(), stage.hair.points.len());
    let own = fibres.base().sigma_a.map(f64::sqrt);
    for (i, &(first, s)) in refined.places.iter().enumerate() {
        // Every other point is painted, so that the weight falls or rises from one to the next.
        let weight = if first % 2 == 0 { 1.0 - s } else { s };
        let found = fibres.points()[i].to_f32();
        let expected = own[2] as f32 + weight * (2.0 - own[2] as f32);
        assert!((found[2] - expected).abs() < 4e-3, "{i}: {} {expected}", found[2]);
        let thicker = stage.diameters[i] / bare.diameters[i];
        assert!((thicker - (1.0 + 2.0 * weight)).abs() < 4e-3, "{i}: {thicker}");
    }
    // The control: paint of other hair is refused.
    assert!(bare.fibres_under(Some(&Paint::bare(7)), &scene).is_err());
}
