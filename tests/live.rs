//! A session keeps what an edit leaves as it was: its pictures are those of a session that begins with the edit.

use std::sync::{Arc, Mutex};

use hairlight::live::{Picture, Said, Session, Wish};
use hairlight::paint::{Channel, Fibres, Paint};
use hairlight::scene::{Orbit, View};
use hairlight::stage::Geometry;

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

/// An edit, by name.
type Edit<'a> = (&'a str, &'a dyn Fn(&mut Wish));

#[test]
fn an_edited_scene_is_seen_as_if_it_had_always_been_so() {
    let wish = Wish::new(small(), [96, 96]);
    let points = Geometry::load(&wish.scene).unwrap().hair.points.len();
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
    if let Some(shade_ms) = before.frame.passes.get("shade") {
        assert!(*shade_ms > 0.05 * frame_ms && *shade_ms < frame_ms, "{shade_ms} of {frame_ms}");
    }
    session.foresee(&now, &|| true);
    for (name, edit) in edits {
        let mut next = now.clone();
        edit(&mut next);
        let picture = see(&mut session, &next);
        let anew = see(&mut Session::default(), &next);
        assert_eq!(picture.rgba, anew.rgba, "{name}");
        // The control: the edit is seen.
        assert_ne!(picture.rgba, before.rgba, "{name}");
        (now, before) = (next, picture);
        session.foresee(&now, &|| true);
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
