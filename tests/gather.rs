//! Light that paths gather, against path tracing of as many scattering events.

use glam::{DVec2, DVec3, Vec3};
use hairlight::field::{Judged, correction};
use hairlight::gpu::frame::{Background, Parts, Renderer};
use hairlight::gpu::method::MethodData;
use hairlight::gpu::sky_map::{SIDE, direction_at, place_of, sky_texels};
use hairlight::light::{HairMedium, Lights};
use hairlight::measure::compare::compare;
use hairlight::measure::read::Picture;
use hairlight::paint::Fibres;
use hairlight::reference::Models;
use hairlight::reference::tracer::film::Film;
use hairlight::reference::tracer::light::Light;
use hairlight::reference::tracer::skin::Skin;
use hairlight::reference::tracer::strands::Strands;
use hairlight::reference::tracer::{Sampling, TraceScene, trace};
use hairlight::scene::{PRESETS, Scene};
use hairlight::srbf::{ORDINATES, SrbfLight, lattice, sky_of, split_wide};
use hairlight::stage::Geometry;

use crate::wgsl::cpu;

const ALL: Parts = Parts { single: true, global: true, local: true };
/// Times as many rays and paths as at 64 samples.
const RAYS: f64 = 6.0;
const SAMPLES: u32 = 64;

/// A low sun and a sky.
fn lights() -> Vec<SrbfLight> {
    vec![
        SrbfLight {
            direction: DVec3::new(0.8, 0.4, 0.3).normalize(),
            lambda: 0.08,
            rgb: [60.0, 50.0, 40.0],
        },
        SrbfLight { direction: DVec3::Y, lambda: 0.9, rgb: [0.3, 0.4, 0.6] },
        SrbfLight {
            direction: DVec3::new(-0.5, -0.2, 0.8).normalize(),
            lambda: 0.5,
            rgb: [0.4, 0.3, 0.2],
        },
    ]
}

struct View {
    scene: Scene,
    stage: Geometry,
    trace_on_device: bool,
}

impl View {
    fn new(preset: &str, head: bool) -> View {
        let mut scene = Scene::default();
        scene.hair.strands = 4000;
        scene.output.size = [96, 72];
        if !head {
            scene.head.source = "none".to_owned();
        }
        scene.fibre.set_preset(PRESETS.iter().find(|p| p.name == preset).unwrap());
        let stage = Geometry::load(&scene).unwrap();
        View { scene, stage, trace_on_device: false }
    }

    /// A frame; without a field paths meet two strands after the one that is seen.
    fn frame(&self, parts: Parts, with_field: bool) -> Picture {
        self.frame_of_field(parts, with_field.then_some(1.0))
    }

    /// The same, of a field that is this much too bright.
    fn frame_of_field(&self, parts: Parts, too_bright: Option<f32>) -> Picture {
        let with_field = too_bright.is_some();
        let View { scene, stage, .. } = self;
        let lens = stage.camera(scene).unwrap().lens(stage.center, scene.output.size);
        let fibres = Fibres::new(&scene.fibre, None);
        let method = MethodData::new(scene.fibre.model, fibres, &scene.render).unwrap();
        let mut renderer = Renderer::new(cpu(), &method, stage).unwrap();
        renderer.trace_on_device = self.trace_on_device;
        let (points, head) = renderer.visible(&[lens], stage.pieces(&lens), SAMPLES).unwrap();
        let medium = HairMedium::new(stage, with_field);
        let lights =
            Lights { lamps: Vec::new(), distant: split_wide(&lights()), sky: sky_of(&lights()) };
        let lit = medium.bring(stage, lights, &points, &|_| true).unwrap();
        let mut field = lit.field(stage, &medium, &method, &|_| true).unwrap();
        if let Some((field, factor)) = field.as_mut().zip(too_bright) {
            field.radiance.iter_mut().for_each(|cell| cell.0 *= factor);
        }
        let (seen, at) = ((&points[..], Some(&head)), (stage, &medium));
        lit.show_at(at, &mut renderer, &method, field.as_ref(), seen, RAYS, &|_| true).unwrap();
        let frame = renderer.render(&lens, SAMPLES, Background::Transparent, parts).unwrap();
        Picture::of_frame(&frame)
    }

    fn truth(&self, max_depth: u32, samples: u32) -> Picture {
        let View { scene, stage, .. } = self;
        let Geometry { hair, diameters, frames, head, head_albedo, center, .. } = stage;
        let lens = stage.camera(scene).unwrap().lens(*center, scene.output.size);
        let light = Light::lobes(&lights()).unwrap();
        let strands = Strands::new(hair, diameters, frames, stage.pieces(&lens), *center);
        let skin = head.as_ref().map(|head| Skin::new(head, *head_albedo, *center));
        let model = hairlight::reference::model_of(&scene.fibre);
        let traced = TraceScene {
            strands: &strands,
            skin: skin.as_ref(),
            light: &light,
            models: &Models::even(&*model),
            lens,
            sampling: Sampling::Both,
            max_depth,
            seed: 0,
        };
        let mut film = Film::new(lens.size);
        trace(&traced, &mut film, samples, &|_| true).unwrap();
        Picture::of_film(&film, "the truth")
    }
}

/// Mean of green over the hair of `a` over that of `b`.
fn ratio(a: &Picture, b: &Picture) -> f64 {
    let sum = |picture: &Picture| -> f64 {
        let hair = b.hair.as_ref().expect("hair");
        picture.rgb.iter().zip(hair).map(|(rgb, &hair)| f64::from(rgb[1] * hair)).sum()
    };
    sum(a) / sum(b)
}

/// Looked up as shaders/gather.wgsl does.
#[test]
fn the_map_of_the_sky_has_its_radiance_and_the_nearest_ordinate() {
    let (sky, ordinates) = (sky_of(&lights()), split_wide(&lights()));
    let ordinates = &ordinates[ordinates.len() - ORDINATES..];
    let texels = sky_texels(&sky, ordinates);
    let at = |x: usize, y: usize| texels[y * SIDE + x];
    let (mut mean, mut worst, mut other, mut control) = (Vec3::ZERO, 0.0f32, 0, 0.0f32);
    let sphere = lattice(2000);
    for &direction in &sphere {
        let place = place_of(direction);
        assert!(direction_at(place).distance(direction) < 1e-12, "{direction}");
        let place = place * SIDE as f64;
        let near = (place - 0.5).clamp(DVec2::ZERO, DVec2::splat(SIDE as f64 - 1.0));
        let first = near.min(DVec2::splat(SIDE as f64 - 2.0)).floor();
        let f = (near - first).as_vec2();
        let [x, y] = first.to_array().map(|n| n as usize);
        let found =
            at(x, y).lerp(at(x + 1, y), f.x).lerp(at(x, y + 1).lerp(at(x + 1, y + 1), f.x), f.y);
        let exact = |direction: DVec3| -> Vec3 {
            let of = |light: &SrbfLight| {
                let apart = (direction - light.direction).length() / light.lambda;
                DVec3::from(light.rgb) * (-apart * apart).exp()
            };
            sky.iter().map(of).sum::<DVec3>().as_vec3()
        };
        mean += exact(direction) / sphere.len() as f32;
        let error = |truth: Vec3| (found.truncate() - truth).abs().max_element();
        worst = worst.max(error(exact(direction)));
        control = control.max(error(exact(-direction)));
        let nearest = |a: &&SrbfLight, b: &&SrbfLight| {
            a.direction.dot(direction).total_cmp(&b.direction.dot(direction))
        };
        let nearest = ordinates.iter().max_by(nearest).expect("ordinates").direction;
        let [x, y] = place.min(DVec2::splat(SIDE as f64 - 1.0)).to_array().map(|n| n as usize);
        other += usize::from(ordinates[at(x, y).w as usize].direction != nearest);
    }
    println!(
        "radiance within {worst:.1e}; {other} of {} next to the nearest ordinate",
        sphere.len()
    );
    assert!(worst < 5e-3 && control > 0.5, "{worst} {control}");
    assert!(other < sphere.len() / 20, "{other}");
}

#[test]
fn paths_bring_what_three_events_scatter() {
    for preset in ["blond", "white"] {
        let view = View::new(preset, false);
        let frame = view.frame(ALL, false);
        let [two, three, four] = [2, 3, 4].map(|depth| view.truth(depth, 128));
        let (error, mean) = (compare(&frame, &three).unwrap().error(), ratio(&frame, &three));
        let others = [ratio(&frame, &two), ratio(&frame, &four)];
        println!(
            "{preset}: {:.1} % off, mean {mean:.3}; of 2 and 4 events {others:.3?}",
            100.0 * error
        );
        assert!(error < 0.1 && (mean - 1.0).abs() < 0.03, "{preset}: {error} {mean}");
        // The control: one event less or more is told apart.
        assert!(others[0] > 1.04 && others[1] < 0.97, "{others:?}");
    }
}

#[test]
fn whole_paths_correct_the_field() {
    let view = View::new("white", false);
    let [frame, wrong] = [1.0, 2.0].map(|factor| view.frame_of_field(ALL, Some(factor)));
    let bare = view.frame(ALL, false);
    let truth = view.truth(u32::MAX, 128);
    let error = compare(&frame, &truth).unwrap().error();
    let [mean, cancelled, control] =
        [(&frame, &truth), (&wrong, &frame), (&bare, &frame)].map(|(a, b)| ratio(a, b));
    println!(
        "{:.1} % off, mean {mean:.3}; with a field twice as bright {cancelled:.3}, without one {control:.3}",
        100.0 * error
    );
    assert!(error < 0.1 && (mean - 1.0).abs() < 0.03, "{error} {mean}");
    assert!((cancelled - 1.0).abs() < 0.01, "{cancelled}");
    // The control: that light is a good part of a frame.
    assert!(control < 0.9, "{control}");
}

#[test]
fn a_correction_says_what_was_found_over_what_was_foretold() {
    let dims = [16, 12, 8];
    let place = |i: usize| {
        let at = |a: f64| (i as f64 * a).fract() as f32;
        Vec3::new(at(0.819_172) * 16.0, at(0.671_044) * 12.0, at(0.549_700) * 8.0)
    };
    let factor = |cell: Vec3| if cell.x < 8.0 { 0.5 } else { 2.0 };
    let judged = |i: usize| {
        let (cell, foretold) = (place(i), Vec3::new(1.0, 2.0, 3.0));
        Judged { cell, foretold, found: factor(cell) * foretold }
    };
    let all: Vec<Judged> = (0..20_000).map(judged).collect();
    let (coarse, texels) = correction(dims, &all);
    assert_eq!(coarse, [4, 3, 2]);
    for (i, texel) in texels.iter().enumerate() {
        let [r, g, b, _] = texel.map(|bits| half::f16::from_bits(bits).to_f32());
        assert!((r - g).abs() < 1e-2 && (r - b).abs() < 1e-2, "{r} {g} {b}");
        // Cells at the step have some of both.
        match i % 4 {
            0 => assert!((r - 0.5).abs() < 0.1, "{r}"),
            3 => assert!((r - 2.0).abs() < 0.1, "{r}"),
            _ => assert!((0.5..2.0).contains(&r), "{r}"),
        }
    }
    // Where nothing is known nothing changes; a cell without paths has what the others have.
    let (_, none) = correction(dims, &[]);
    assert!(none.iter().all(|texel| texel[0] == half::f16::ONE.to_bits()));
    let low: Vec<Judged> = all.iter().copied().filter(|one| one.cell.z < 2.0).collect();
    let (_, texels) = correction([16, 12, 16], &low);
    let far = half::f16::from_bits(texels[texels.len() - 1][0]).to_f32();
    assert!((far - 1.25).abs() < 0.05, "{far}");
}

#[test]
fn what_the_device_casts_is_what_its_twin_casts() {
    let view = View::new("blond", true);
    let twin = view.frame(ALL, true);
    let device = View { trace_on_device: true, ..view };
    let error = compare(&device.frame(ALL, true), &twin).unwrap().error();
    let single = Parts { single: true, global: false, local: false };
    let control = compare(&device.frame(single, true), &twin).unwrap().error();
    println!(
        "device against twin {:.2} %; one event alone {:.0} %",
        100.0 * error,
        100.0 * control
    );
    assert!(error < 0.01 && control > 0.1, "{error} {control}");
}

#[test]
fn the_head_has_light_from_hair_and_head() {
    let mut view = View::new("white", true);
    view.scene.output.size = [120, 90];
    let skin = |picture: &Picture, i: usize| {
        let plane = |plane: &Option<Vec<f32>>| plane.as_ref().map_or(0.0, |plane| plane[i]);
        plane(&picture.hair) == 0.0 && plane(&picture.alpha) > 0.99
    };
    let truth = view.truth(u32::MAX, 128);
    let direct = view.truth(1, 64);
    let frame = view.frame(ALL, true);
    let sum = |picture: &Picture| -> Vec3 {
        let seen = (0..picture.rgb.len()).filter(|&i| skin(&truth, i) && skin(&frame, i));
        seen.map(|i| Vec3::from(picture.rgb[i])).sum()
    };
    let (frame, truth, direct) = (sum(&frame), sum(&truth), sum(&direct));
    println!("head: frame over truth {:.3}, of direct light {:.3}", frame / truth, direct / truth);
    assert!((frame / truth - 1.0).abs().max_element() < 0.03, "{}", frame / truth);
    assert!((direct / truth).max_element() < 0.93, "{}", direct / truth);
}
