//! A session keeps what an edit leaves as it was: its pictures are those of a session that begins with the edit.

use std::path::Path;
use std::sync::{Arc, Mutex};

use hairlight::gpu::shaders::Shaders;
use hairlight::head::Head;
use hairlight::live::{Picture, Said, ScenePart, Session, Wish};
use hairlight::paint::{Channel, Fibres, Paint};
use hairlight::scene::{Lens, Orbit, Scattering, Scene, View, parse_assignment};
use hairlight::stage::Geometry;
use tempfile::tempdir;

use crate::editor::small;

/// The last picture of a wish.
fn see(session: &mut Session, wish: &Wish) -> Picture {
    let last = Mutex::new(None);
    let say = |said: Said| {
        if let Said::Picture(picture) = said {
            *last.lock().unwrap() = Some(picture);
        }
    };
    assert!(session.see(wish, &|| true, &say).unwrap());
    last.into_inner().unwrap().expect("a picture")
}

/// Bytes that differ, and by how much at most.
fn apart(a: &Picture, b: &Picture) -> (usize, u8) {
    assert_eq!(a.size, b.size);
    let differ = a.rgba.iter().zip(&b.rgba).map(|(a, b)| a.abs_diff(*b)).filter(|&by| by > 0);
    differ.fold((0, 0), |(count, most), by| (count + 1, most.max(by)))
}

/// An edit, by name.
type Edit<'a> = (&'a str, &'a dyn Fn(&mut Wish));

#[test]
fn an_edited_scene_is_seen_as_if_it_had_always_been_so() {
    let wish = Wish::new(small(), [96, 96]);
    let points = Geometry::load(&wish.scene).unwrap().groom().points.len();
    let edits: [Edit; 9] = [
        ("another camera", &|wish| {
            let orbit = Orbit { azimuth_deg: 80.0, ..Orbit::default() };
            wish.scene.camera.view = View::Orbit(orbit);
        }),
        ("roughness", &|wish| wish.scene.fibre.beta_r_deg = 12.0),
        ("paint", &|wish| {
            let mut paint = Paint::bare(points);
            let layer = paint.layer_mut(Channel::Absorption);
            (0..points / 2).for_each(|point| layer.set(point, [0.1; 3], 1.0));
            wish.paint = Some(Arc::new(paint));
        }),
        ("more paint", &|wish| {
            let paint = Arc::make_mut(wish.paint.as_mut().unwrap());
            let layer = paint.layer_mut(Channel::Absorption);
            (points / 4..points / 3).for_each(|point| layer.set(point, [1.5; 3], 0.7));
        }),
        ("turned light", &|wish| wish.scene.environment.rotation_deg = 70.0),
        ("samples", &|wish| wish.scene.render.samples = Some(8)),
        ("light turned back", &|wish| wish.scene.environment.rotation_deg = 0.0),
        ("the head's colour", &|wish| wish.scene.head.color = [0.1, 0.4, 0.8]),
        ("the head's place", &|wish| wish.scene.head.offset = Some([0.0, -0.02, 0.0])),
    ];
    let mut session = Session::default();
    let mut now = wish;
    let mut before = see(&mut session, &now);
    // What passes took is what the frame took, where the device tells times.
    let stages = &before.figures.as_ref().unwrap().stages;
    let frame_ms = stages.iter().find(|(name, _)| *name == "the frame").unwrap().1;
    let passes = &before.frame.passes;
    if let (Some(gather_ms), Some(shade_ms)) = (passes.get("gather"), passes.get("shade")) {
        let both = gather_ms + shade_ms;
        assert!(both > 0.05 * frame_ms && both < frame_ms, "{both} of {frame_ms}");
    }
    session.idle(&now, &|| true, &|_| {});
    for (name, edit) in edits {
        let mut next = now.clone();
        edit(&mut next);
        let picture = see(&mut session, &next);
        let anew = see(&mut Session::default(), &next);
        assert_eq!(apart(&picture, &anew), (0, 0), "{name}: bytes that differ, and the most");
        // The control: the edit is seen.
        assert!(apart(&picture, &before).0 > 0, "{name}");
        (now, before) = (next, picture);
        session.idle(&now, &|| true, &|_| {});
    }
    // At rest light was brought to all points: another camera waits for none.
    let mut turned = now.clone();
    turned.scene.camera.view =
        View::Orbit(Orbit { azimuth_deg: 200.0, elevation_deg: -20.0, ..Orbit::default() });
    let light = |picture: &Picture| picture.figures.as_ref().unwrap().brought;
    assert_eq!(light(&see(&mut session, &turned)), 0);
    // The control: without rest it does.
    let mut session = Session::default();
    see(&mut session, &now);
    assert!(light(&see(&mut session, &turned)) > 0);
}

/// A driver that draws nothing must not pass for a view without hair.
#[test]
fn hair_before_the_camera_that_is_not_drawn_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let built_in = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    for entry in std::fs::read_dir(built_in).unwrap().map(Result::unwrap) {
        if entry.path().is_file() {
            std::fs::copy(entry.path(), folder.path().join(entry.file_name())).unwrap();
        }
    }
    let raster = folder.path().join("raster.wgsl");
    let text = std::fs::read_to_string(&raster).unwrap();
    let blind = text.replace("return encode_seen(HAIR,", "discard; return encode_seen(HAIR,");
    assert_ne!(text, blind);
    std::fs::write(&raster, blind).unwrap();
    let mut wish = Wish::new(small(), [96, 96]);
    see(&mut Session::default(), &wish);
    wish.shaders = Some(Arc::new(Shaders::read(folder.path()).unwrap()));
    let seen = Session::default().see(&wish, &|| true, &|_| {});
    let error = seen.unwrap_err().to_string();
    assert!(error.contains("draws none of them"), "{error}");
    // What is not before the camera is no error.
    let stage = Geometry::load(&wish.scene).unwrap();
    let beyond = stage.center.as_dvec3() + 20.0 * f64::from(stage.radius) * glam::DVec3::Z;
    wish.scene.camera.view = View::Position(beyond.to_array());
    wish.scene.camera.target = Some((2.0 * beyond).to_array());
    let notes = Mutex::new(Vec::new());
    let say = |said: Said| {
        if let Said::Note(note) = said {
            notes.lock().unwrap().push(note);
        }
    };
    Session::default().see(&wish, &|| true, &say).unwrap();
    let notes = notes.into_inner().unwrap();
    assert!(notes.iter().any(|note| note.contains("no hair is in the frame")), "{notes:?}");
}

/// What the check of a view without hair rests on.
#[test]
fn strands_are_expected_where_the_camera_sees_them() {
    let scene = small();
    let stage = Geometry::load(&scene).unwrap();
    let lens = stage.camera(&scene).unwrap().lens(stage.center, [96, 96]);
    let expected = stage.expected_samples(&lens, 4);
    assert!(expected > 1000.0, "{expected}");
    assert!((stage.expected_samples(&lens, 8) / expected - 2.0).abs() < 1e-9);
    let away = Lens { forward: -lens.forward, ..lens };
    assert_eq!(stage.expected_samples(&away, 4), 0.0);
    // All strands of a head that stands between them and the camera.
    let mut walled = stage.clone();
    let [right, up] = [lens.right, lens.up].map(|v| v.as_vec3() * lens.distance as f32);
    let middle = stage.center + (0.5 * lens.eye).as_vec3();
    let corner = |x: f32, y: f32| middle + x * right + y * up;
    walled.head = Some(Head {
        positions: vec![corner(-1.0, -1.0), corner(3.0, -1.0), corner(-1.0, 3.0)],
        normals: vec![glam::Vec3::Z; 3],
        triangles: vec![[0, 1, 2]],
    });
    assert_eq!(walled.expected_samples(&lens, 4), 0.0);
}

#[test]
fn repainted_fibres_are_those_of_the_new_paint() {
    let spec = small().fibre;
    let points = 5000;
    let mut before = Paint::bare(points);
    let layer = before.layer_mut(Channel::Absorption);
    (0..points).step_by(3).for_each(|point| layer.set(point, [0.3, 0.6, 0.9], 0.5));
    let mut after = before.clone();
    after.layer_mut(Channel::Absorption).set(1234, [2.0, 0.1, 0.4], 1.0);
    let known = Fibres::new(&spec, Some(&before));
    let apart = |a: &Fibres, b: &Fibres| {
        assert_eq!(a.points().len(), b.points().len());
        a.points().iter().zip(b.points()).filter(|(a, b)| a != b).count()
    };
    assert_eq!(apart(&known, &known.repainted(&before, &after)), 1);
    let fresh = Fibres::new(&spec, Some(&after));
    assert_eq!(apart(&fresh, &known.repainted(&before, &after)), 0);
    // A channel that was not there, and one that is there no more.
    let mut more = after.clone();
    more.layer_mut(Channel::Roughness).set(77, [20.0, 0.0, 0.0], 1.0);
    let fresh = Fibres::new(&spec, Some(&more));
    assert_eq!(apart(&fresh, &known.repainted(&before, &more)), 0);
    assert_eq!(apart(&known, &fresh.repainted(&more, &before)), 0);
    // All of it undone, the hair is even again.
    assert!(!fresh.repainted(&more, &Paint::bare(points)).painted());
}

/// The first picture of pale hair has the light that strands send each other.
#[test]
fn the_first_preview_is_as_bright_as_the_finished_picture() {
    let mut scene = small();
    let white = hairlight::scene::PRESETS.iter().find(|preset| preset.name == "white").unwrap();
    scene.fibre.set_preset(white);
    // Over the hair, mean luminance of linear radiance.
    let brightness = |picture: &Picture| {
        let frame = &picture.frame;
        let [mut sum, mut covered] = [0.0; 2];
        for (pixel, hair) in frame.pixels.iter().zip(&frame.hair_coverage) {
            sum += hair * hairlight::image::luminance([pixel[0], pixel[1], pixel[2]]);
            covered += hair;
        }
        f64::from(sum / covered)
    };
    let pictures = |scene: &Scene| {
        let said = Mutex::new(Vec::new());
        let say = |what: Said| {
            if let Said::Picture(picture) = what {
                said.lock().unwrap().push(brightness(&picture));
            }
        };
        let wish = Wish::new(scene.clone(), [96, 96]);
        assert!(Session::default().see(&wish, &|| true, &say).unwrap());
        said.into_inner().unwrap()
    };
    let shown = pictures(&scene);
    let (first, last) = (shown[0], *shown.last().unwrap());
    println!("first {first:.3}, finished {last:.3}");
    assert!(shown.len() > 1 && (first / last - 1.0).abs() < 0.1, "{shown:?}");
    // The control: single scattering, which a first picture without that light would be.
    scene.render.scattering = Scattering::Single;
    let single = *pictures(&scene).last().unwrap();
    println!("single scattering {single:.3}");
    assert!(single < 0.7 * last, "{single} of {last}");
}

/// What cannot be loaded is said to be, by its part, and what there was can be seen.
#[test]
fn a_refusal_names_the_part_and_what_can_be_used() {
    let folder = tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    for (name, bytes) in [
        ("bad.hair", &b"HAIR but not really"[..]),
        ("bad.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
        ("bad.exr", b"no map"),
        ("bad.paint", b"no paint"),
    ] {
        std::fs::write(path(name), bytes).unwrap();
    }
    let good = small();
    let mut session = Session::default();
    see(&mut session, &Wish::new(good.clone(), [64, 64]));
    let set = |to: String| {
        let mut scene = good.clone();
        scene.apply(vec![parse_assignment(&to).unwrap()]).unwrap();
        scene
    };
    for (part, to) in [
        (ScenePart::Hair, format!("hair.source={}", path("bad.hair"))),
        (ScenePart::Head, format!("head.source={}", path("bad.obj"))),
        (ScenePart::Map, format!("environment.source={}", path("bad.exr"))),
        (ScenePart::Paint, format!("hair.paint={}", path("bad.paint"))),
        (ScenePart::Adapter, "render.adapter=no such adapter".to_owned()),
        (ScenePart::Camera, "camera.position=0,0,0".to_owned()),
    ] {
        let mut scene = set(to);
        if part == ScenePart::Camera {
            scene.camera.target = Some([0.0; 3]);
        }
        let wish = Wish::new(scene, [64, 64]);
        let error = session.see(&wish, &|| true, &|_| {}).unwrap_err();
        let Said::Refused(refusal) = session.refusal(&wish.scene, &error) else {
            panic!("{part:?}: no part is refused: {error:#}");
        };
        println!("{part:?}: {}", refusal.line);
        assert_eq!(refusal.part, part);
        assert!(!refusal.line.contains('\n'));
        let mut mended = wish.scene.clone();
        part.copy(&refusal.instead, &mut mended);
        assert!(mended == good, "{part:?}: the last good one");
        let picture = see(&mut session, &Wish::new(mended, [64, 64]));
        assert!(picture.finished, "{part:?}: and it is seen");
    }
    // Files that are gone are not asked for again, whatever device they are shown on.
    crate::frames::write_tuft(folder.path());
    let tuft = set(format!("hair.source={}", path("strands.hair")));
    let before = see(&mut session, &Wish::new(tuft.clone(), [64, 64]));
    std::fs::remove_file(path("strands.hair")).unwrap();
    let mut other = tuft.clone();
    other.render.adapter = "auto".to_owned();
    assert!(see(&mut session, &Wish::new(other, [64, 64])).rgba.len() == before.rgba.len());
    // The control: a session that never saw them is refused, and takes the default in their place.
    let mut fresh = Session::default();
    let error = fresh.see(&Wish::new(tuft.clone(), [64, 64]), &|| true, &|_| {}).unwrap_err();
    let Said::Refused(refusal) = fresh.refusal(&tuft, &error) else { panic!("{error:#}") };
    assert_eq!((refusal.part, &*refusal.instead.hair.source), (ScenePart::Hair, "builtin:bob"));
}
