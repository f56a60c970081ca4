//! Controls of the editor for those who do not see them or have no pointer: names, and what Tab reaches.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Mutex;

use eframe::egui::accessibility::is_input;
use eframe::egui::accesskit::{Action, NodeId, Role};
use eframe::egui::{self, Event, Key, Modifiers, Pos2, Rect, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use hairlight::editor::{Document, Editor, PRESET_SIDE, preset_scene};
use hairlight::live::{Said, Session, Wish};
use hairlight::scene::{FIELDS, PRESETS, Pigment, parse_assignment};

use crate::editor::{Window, editor, key, look, opened, seen, small, window_of};
use crate::editor_files::until;

const SIZE: [f32; 2] = [1280.0, 2200.0];

struct Control {
    id: NodeId,
    role: Role,
    name: String,
    /// Left panel, middle, right panel, or the bar above.
    place: usize,
    /// Whether it can have the focus, and Tab should bring it there.
    focusable: bool,
}

fn controls<State>(window: &Harness<'_, State>) -> Vec<Control> {
    let nodes = window.root().children_recursive();
    let shown = nodes.filter(|node| node.accesskit_node().has_bounds());
    let controls = shown.filter_map(|node| {
        let own = node.accesskit_node();
        let [x, y] = node.rect().center().into();
        is_input(own.role()).then(|| Control {
            id: own.locate().0,
            role: own.role(),
            name: own.label().unwrap_or_default(),
            place: match x {
                _ if y < 24.0 => 3,
                _ => usize::from(x > 250.0) + usize::from(x > SIZE[0] - 340.0),
            },
            focusable: own.data().supports_action(Action::Focus) && !own.is_disabled(),
        })
    });
    controls.collect()
}

/// Controls without a name, and those of one kind, but for some, that stand in one place under one name.
fn badly_named<State>(window: &Harness<'_, State>, but: &BTreeSet<NodeId>) -> Vec<String> {
    let mut faults = window.unnamed_widgets();
    let mut all = BTreeMap::new();
    let counted = controls(window).into_iter().filter(|control| !but.contains(&control.id));
    for Control { role, name, place, .. } in counted {
        *all.entry((place, format!("{role:?} {name}"))).or_insert(0) += 1;
    }
    let several = all.into_iter().filter(|(_, count)| *count > 1);
    faults.extend(several.map(|((_, what), n)| format!("{n} × {what}")));
    faults
}

/// Controls, but for those of `but`, that do not get the focus while Tab goes round.
fn unreached<State>(window: &mut Harness<'_, State>, but: &BTreeSet<NodeId>) -> Vec<String> {
    let mut all = controls(window);
    all.retain(|control| !but.contains(&control.id));
    let mut reached = BTreeSet::new();
    for _ in 0..all.len() + but.len() + 5 {
        window.key_press(Key::Tab);
        window.step();
        reached.extend(window.ctx.memory(|m| m.focused()).map(|id| id.accesskit_id()));
        let left = |c: &Control| c.focusable && !reached.contains(&c.id);
        if !all.iter().any(left) {
            break;
        }
    }
    let enabled = |c: &&Control| !matches!(c.role, Role::Slider | Role::SpinButton) || c.focusable;
    let missed = all.iter().filter(enabled).filter(|c| c.focusable && !reached.contains(&c.id));
    missed.map(|control| format!("{:?} {}", control.role, control.name)).collect()
}

fn click(window: &mut Window, label: &str) {
    window.get_by_label(label).click();
    window.run_steps(3);
}

/// What is wrong with the controls as they are now; `but` are those that a dialog keeps from the focus.
fn check(window: &mut Window, state: &str, but: &BTreeSet<NodeId>) -> Vec<String> {
    let scene = editor(window).document.scene.clone();
    let mut faults = badly_named(window, but);
    faults.extend(unreached(window, but).iter().map(|control| format!("not reached: {control}")));
    let now = &editor(window).document.scene;
    let other = FIELDS.iter().filter(|field| field.get(now) != field.get(&scene));
    faults.extend(other.map(|field| format!("{} changed by passing", field.key)));
    println!("{state}: {} controls {faults:?}", controls(window).len().saturating_sub(but.len()));
    window.ctx.memory_mut(|m| m.stop_text_input());
    window.run_steps(2);
    faults.into_iter().map(|fault| format!("{state}: {fault}")).collect()
}

#[test]
fn every_control_has_a_name_and_is_reached_by_tab() {
    let mut scene = small();
    // More digits than are shown.
    (scene.fibre.beta_r_deg, scene.environment.rotation_deg) = (9.123_456_789, 1.234_567_89);
    let mut window = window_of(Document::new(scene, None), SIZE);
    let none = BTreeSet::new();
    let mut faults = Vec::new();
    for header in ["Camera", "Hair and head", "Rendering"] {
        click(&mut window, header);
    }
    for way in ["absorption", "color", "melanin"] {
        click(&mut window, way);
        seen(&mut window);
        faults.extend(check(&mut window, &format!("view, colour by {way}"), &none));
    }
    key(&mut window, Modifiers::NONE, Key::R);
    // What it says stands above its buttons.
    let judged = |window: &Window| editor(window).truth().is_some_and(|t| t.judged.is_some());
    until(&mut window, "a truth", judged);
    window.run_steps(3);
    faults.extend(check(&mut window, "truth", &none));
    key(&mut window, Modifiers::NONE, Key::R);
    click(&mut window, "Browse maps…");
    faults.extend(check(&mut window, "maps", &none));
    key(&mut window, Modifiers::NONE, Key::Escape);
    window.event(Event::Text("?".to_owned()));
    window.run_steps(3);
    faults.extend(check(&mut window, "shortcuts", &none));
    key(&mut window, Modifiers::NONE, Key::Escape);

    key(&mut window, Modifiers::NONE, Key::B);
    for way in ["absorption", "color", "melanin"] {
        let left = |node: &egui_kittest::Node| node.rect().center().x < 250.0;
        let ways: Vec<_> = window.get_all_by_label(way).filter(left).collect();
        assert_eq!(ways.len(), 1, "{way}");
        ways[0].click();
        window.run_steps(3);
        look(&mut window, &format!("controls-{way}.png"));
        faults.extend(check(&mut window, &format!("paint, colour by {way}"), &none));
    }
    window.get_by_role_and_label(Role::RadioButton, "eccentricity").click();
    window.run_steps(3);
    faults.extend(check(&mut window, "paint, eccentricity", &none));

    // Menus and lists go away with the focus: their names are looked at.
    for (role, menu) in [
        (Role::Button, "File"),
        (Role::Button, "Edit"),
        (Role::ComboBox, "Falloff"),
        (Role::ComboBox, "Reach"),
        (Role::ComboBox, "map"),
        (Role::ComboBox, "hair"),
        (Role::ComboBox, "fibre model"),
    ] {
        let before: BTreeSet<NodeId> = controls(&window).iter().map(|c| c.id).collect();
        window.get_by_role_and_label(role, menu).click();
        window.run_steps(3);
        assert!(controls(&window).len() > before.len(), "{menu} opens");
        let listed = badly_named(&window, &before);
        faults.extend(listed.into_iter().map(|fault| format!("{menu}: {fault}")));
        key(&mut window, Modifiers::NONE, Key::Escape);
        window.run_steps(3);
        assert_eq!(controls(&window).len(), before.len(), "{menu} closes by Escape");
    }

    // The menu, beside the tool of that name.
    window.get_all_by_label("View").next().unwrap().click();
    window.run_steps(3);
    window.get_by_label("As the desktop");
    faults.extend(badly_named(&window, &none));
    key(&mut window, Modifiers::NONE, Key::Escape);
    window.run_steps(2);

    // What asks, alone has the focus.
    let behind: BTreeSet<NodeId> = controls(&window).iter().map(|c| c.id).collect();
    click(&mut window, "File");
    click(&mut window, "Save picture…");
    faults.extend(check(&mut window, "save picture", &behind));
    key(&mut window, Modifiers::NONE, Key::Escape);
    window.run_steps(2);
    click(&mut window, "File");
    click(&mut window, "New");
    window.get_by_label("Throw away");
    faults.extend(check(&mut window, "leaving", &behind));
    assert!(faults.is_empty(), "{faults:#?}");
}

/// The control of the checks: they find what has no name, what shares one, and what Tab passes by.
#[test]
fn a_control_without_name_or_focus_is_found() {
    let (mut x, mut text) = (1.0, String::new());
    let mut window = Harness::builder().with_accessibility_check(false).build_ui(move |ui| {
        ui.add_space(40.0);
        let _ = ui.button("Twice");
        let _ = ui.button("Twice");
        ui.text_edit_singleline(&mut text);
        ui.add(egui::DragValue::new(&mut x)).accessible_name("Named");
        // It says that it can have the focus, and is out of Tab's way.
        let (_, response) = ui.allocate_exact_size(egui::Vec2::splat(20.0), egui::Sense::hover());
        response.widget_info(|| egui::WidgetInfo::labeled(Role::Button, true, "Passed by"));
        ui.ctx().accesskit_node_builder(response.id, |node| node.add_action(Action::Focus));
    });
    window.run_steps(2);
    let faults = badly_named(&window, &BTreeSet::new());
    assert_eq!(faults.len(), 2, "{faults:#?}");
    assert!(faults[0].contains("TextInput") && faults[1].contains("2 × Button Twice"));
    assert_eq!(unreached(&mut window, &BTreeSet::new()), ["Button Passed by"]);
}

/// The brush's colour by melanin or absorption is what the scene's would be, and comes back as it was stated.
#[test]
fn the_brush_has_a_scenes_ways_to_state_its_colour() {
    let mut window = window_of(Document::new(small(), None), [1280.0, 900.0]);
    key(&mut window, Modifiers::NONE, Key::B);
    window.run_steps(2);
    let left = |window: &mut Window, label: &str, role: Role| {
        let all = window.get_all_by_role_and_label(role, label);
        let one: Vec<_> = all.filter(|node| node.rect().center().x < 250.0).collect();
        assert_eq!(one.len(), 1, "{label}");
        one[0].click();
        window.run_steps(3);
    };
    let type_number = |window: &mut Window, label: &str, number: &str| {
        left(window, label, Role::SpinButton);
        key(window, Modifiers::COMMAND, Key::A);
        window.event(Event::Text(number.to_owned()));
        window.step();
        key(window, Modifiers::NONE, Key::Enter);
        window.run_steps(2);
    };
    let value = |window: &Window| editor(window).brush.value;
    let near = |a: [f32; 3], sigma_a: [f64; 3]| {
        a.iter()
            .zip(sigma_a)
            .all(|(a, s)| (f64::from(*a) - s.sqrt()).abs() < 1e-3 * s.sqrt().max(0.1))
    };
    let before = value(&window);
    left(&mut window, "melanin", Role::Button);
    type_number(&mut window, "eumelanin", "0.3");
    type_number(&mut window, "pheomelanin", "1.2");
    let red = Pigment::Melanin { eumelanin: 0.3, pheomelanin: 1.2 }.sigma_a();
    assert!(near(value(&window), red) && value(&window) != before, "{:?}", value(&window));
    // Picked up, it is stated as melanin still.
    let editor_ = window.state_mut().as_mut().unwrap();
    let blond = Pigment::Melanin { eumelanin: 0.25, pheomelanin: 0.1 }.sigma_a();
    editor_.brush.value = blond.map(|s| half::f16::from_f64(s.sqrt()).to_f32());
    window.run_steps(2);
    let spin = window.get_all_by_role_and_label(Role::SpinButton, "eumelanin");
    let stated: Vec<f64> = spin
        .filter(|node| node.rect().center().x < 250.0)
        .filter_map(|node| node.accesskit_node().numeric_value())
        .collect();
    assert!((stated[0] - 0.25).abs() < 0.01, "{stated:?}");
    // The control: dye, which no melanin is, is stated as absorption.
    window.state_mut().as_mut().unwrap().brush.value = [1.2, 0.1, 0.1];
    window.run_steps(2);
    type_number(&mut window, "absorption, green", "4");
    assert!(near(value(&window), [1.44, 4.0, 0.01]), "{:?}", value(&window));
    left(&mut window, "red", Role::Button);
    let mut fibre = hairlight::scene::FibreSpec::default();
    let red = hairlight::scene::PRESETS.iter().find(|preset| preset.name == "red").unwrap();
    fibre.set_preset(red);
    assert!(near(value(&window), fibre.pigment.sigma_a()));
    look(&mut window, "brush-color.png");
}

/// Types into the number named `label`, and enters it.
fn type_number(window: &mut Window, label: &str, text: &str) {
    type_into(window, Role::SpinButton, label, text);
}

/// Types into the field of a kind named `label`, and enters it.
fn type_into(window: &mut Window, role: Role, label: &str, text: &str) {
    window.get_by_role_and_label(role, label).click();
    window.run_steps(3);
    key(window, Modifiers::COMMAND, Key::A);
    window.event(Event::Text(text.to_owned()));
    window.run_steps(2);
    key(window, Modifiers::NONE, Key::Enter);
    window.run_steps(3);
}

/// A decimal comma is read, and what is no number leaves the number as it was, and says so.
#[test]
fn numbers_are_read_or_refused_aloud() {
    let mut window = window_of(Document::new(small(), None), [1280.0, 2200.0]);
    let eta = |window: &Window| editor(window).document.scene.fibre.eta;
    let before = eta(&window);
    for text in ["nan", "NaN", "inf", "-inf", "infinity", "1e999", "1.5.1", "1,5,1", "brown"] {
        type_number(&mut window, "index of refraction", text);
        assert_eq!(eta(&window), before, "`{text}`");
        let said = editor(&window).message().unwrap_or_default().to_owned();
        let expected = format!("index of refraction: `{text}` is no number");
        assert_eq!(said, expected, "`{text}`");
    }
    for (text, value) in [("1,7", 1.7), ("1.6", 1.6), (" 1.4 ", 1.4), ("1", 1.0)] {
        type_number(&mut window, "index of refraction", text);
        assert_eq!(eta(&window), value, "`{text}`");
    }
    // The other kinds of numbers.
    click(&mut window, "Camera");
    click(&mut window, "Rendering");
    type_number(&mut window, "size, width", "nan");
    assert_eq!(editor(&window).document.scene.output.size, [96, 96]);
    assert_eq!(editor(&window).message(), Some("size, width: `nan` is no number"));
    key(&mut window, Modifiers::NONE, Key::B);
    window.run_steps(2);
    let radius = |window: &Window| editor(window).brush.radius;
    for (text, value) in [("inf", 0.06), ("12,5", 0.125), ("20 %", 0.2), ("nan", 0.2)] {
        type_number(&mut window, "Radius", text);
        assert!((radius(&window) - value).abs() < 1e-6, "`{text}`: {}", radius(&window));
    }
    // While it is typed it is red, and an escape leaves no word of it.
    window.get_by_role_and_label(Role::SpinButton, "index of refraction").click();
    window.run_steps(3);
    key(&mut window, Modifiers::COMMAND, Key::A);
    window.event(Event::Text("nan".to_owned()));
    window.run_steps(2);
    look(&mut window, "no-number.png");
    key(&mut window, Modifiers::NONE, Key::Escape);
    window.run_steps(3);
    assert_eq!(editor(&window).message(), Some("Radius: `nan` is no number"));
}

/// A text field says why it does not take what was typed.
#[test]
fn text_that_is_no_value_is_refused_aloud() {
    let mut scene = small();
    scene.apply(vec![parse_assignment("render.quality=40%").unwrap()]).unwrap();
    let mut window = window_of(Document::new(scene.clone(), None), [1280.0, 2200.0]);
    click(&mut window, "Rendering");
    let type_text = |window: &mut Window, label: &str, text: &str| {
        type_into(window, Role::TextInput, label, text);
    };
    for text in ["nan%", "inf ms", "good"] {
        type_text(&mut window, "quality", text);
        assert!(editor(&window).document.scene == scene, "{text}");
        let said = editor(&window).message().unwrap_or_default().to_owned();
        assert!(said.contains("render.quality") && said.contains(text), "{text}: {said}");
    }
    type_text(&mut window, "quality", "50%");
    let quality = editor(&window).document.scene.render.quality;
    assert_eq!(quality, Some(hairlight::scene::Target::Error(0.5)), "the control");
}

/// Under a dialog keys are the dialog's alone.
#[test]
fn keys_do_not_act_under_a_dialog() {
    let mut window = window_of(Document::new(small(), None), [900.0, 700.0]);
    click(&mut window, "blond");
    seen(&mut window);
    let scene = editor(&window).document.scene.clone();
    let painting = |window: &Window| window.query_by_label("What to paint").is_some();
    let truth = |window: &Window| window.query_by_label("Divider").is_some();
    let press_all = |window: &mut Window| {
        for pressed in [Key::B, Key::R, Key::T, Key::F, Key::X, Key::CloseBracket] {
            key(window, Modifiers::NONE, pressed);
        }
        key(window, Modifiers::COMMAND, Key::Z);
        window.event(Event::Text("?".to_owned()));
        window.run_steps(3);
    };
    let brush = editor(&window).brush.clone();
    click(&mut window, "File");
    click(&mut window, "New");
    window.get_by_label("Throw away");
    press_all(&mut window);
    assert!(editor(&window).document.scene == scene, "nothing is undone, and nothing turns");
    assert!(!painting(&window) && !truth(&window) && editor(&window).brush == brush);
    assert!(window.query_by_label("Quit").is_none() && window.query_by_label("Wheel").is_none());
    key(&mut window, Modifiers::COMMAND, Key::O);
    window.run_steps(3);
    assert!(window.query_by_label("Path").is_none(), "no dialog over a dialog");
    key(&mut window, Modifiers::NONE, Key::Escape);
    window.run_steps(3);
    assert!(window.query_by_label("Throw away").is_none(), "Escape is the dialog's");
    // One with a text field that is not typed into.
    key(&mut window, Modifiers::COMMAND, Key::O);
    window.run_steps(3);
    window.ctx.memory_mut(|m| m.stop_text_input());
    window.run_steps(2);
    press_all(&mut window);
    assert!(editor(&window).document.scene == scene && !painting(&window) && !truth(&window));
    key(&mut window, Modifiers::NONE, Key::Escape);
    window.run_steps(3);
    // The control: without a dialog they do.
    key(&mut window, Modifiers::NONE, Key::B);
    key(&mut window, Modifiers::COMMAND, Key::Z);
    window.run_steps(3);
    assert!(painting(&window) && editor(&window).document.scene.fibre.preset != "blond");
}

/// A screen of 1280 × 800 at 2.5 pixels a point: panels scroll, dialogs fit, and the picture has room.
#[test]
fn a_large_interface_leaves_room_for_the_picture() {
    let size = [512.0, 320.0];
    let mut window = window_of(Document::new(small(), None), size);
    let room = window.get_by_label("Picture").rect();
    println!("the picture: {room:?}");
    assert!(room.width() >= 0.3 * size[0] && room.height() >= 0.7 * size[1], "{room:?}");
    look(&mut window, "large.png");
    // What is far below and to the right in the panels is reached by scrolling.
    let far = |window: &Window, label: &str| window.get_by_label(label).rect();
    let scroll = |window: &mut Window, at: Pos2, by: Vec2| {
        window.hover_at(at);
        window.step();
        for _ in 0..40 {
            window.event(Event::MouseWheel {
                unit: egui::MouseWheelUnit::Point,
                delta: by,
                modifiers: Modifiers::NONE,
                phase: egui::TouchPhase::Move,
                source: egui::MouseWheelSource::Wheel,
            });
            window.run_steps(2);
        }
        window.run_steps(10);
    };
    let screen = Rect::from_min_size(Pos2::ZERO, size.into());
    let panel = Pos2::new(size[0] - 60.0, 160.0);
    assert!(!screen.contains_rect(far(&window, "Rendering")), "it is far below");
    scroll(&mut window, panel, Vec2::new(0.0, -200.0));
    let header = far(&window, "Rendering");
    assert!(screen.intersects(header), "{header:?}");
    look(&mut window, "large-scrolled.png");
    window.event(Event::Text("?".to_owned()));
    window.run_steps(4);
    look(&mut window, "large-shortcuts.png");
    key(&mut window, Modifiers::NONE, Key::Escape);
    for entry in ["Open…", "Save picture…"] {
        click(&mut window, "File");
        click(&mut window, entry);
        look(&mut window, &format!("large-{}.png", entry.split(' ').next().unwrap()));
        for label in ["Path", "Browse…", "Cancel"] {
            let rect = window.get_by_label(label).rect();
            assert!(screen.contains_rect(rect), "{entry} {label}: {rect:?}");
        }
        key(&mut window, Modifiers::NONE, Key::Escape);
        window.run_steps(3);
    }
}

/// The pictures of presets are there from the first frame on, and show what the renderer makes of them.
/// `HAIRLIGHT_BLESS=1 cargo test --release presets_have_pictures` renders them anew.
#[test]
fn presets_have_pictures_at_once() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/presets.png");
    let side = PRESET_SIDE;
    let mut strip = image::RgbImage::new(side * PRESETS.len() as u32, side);
    let mut session = Session::default();
    for (k, preset) in (0..).zip(PRESETS) {
        let last = Mutex::new(None);
        let say = |said| {
            if let Said::Picture(picture) = said {
                *last.lock().unwrap() = Some(picture);
            }
        };
        let mut scene = preset_scene(preset);
        scene.render.adapter = "cpu".to_owned();
        session.see(&Wish::new(scene, [side; 2]), &|| true, &say).unwrap();
        let picture = last.into_inner().unwrap().expect("a picture");
        for (i, rgba) in (0..).zip(picture.rgba.chunks_exact(4)) {
            let rgb = image::Rgb([rgba[0], rgba[1], rgba[2]]);
            strip.put_pixel(k * side + i % side, i / side, rgb);
        }
    }
    if std::env::var_os("HAIRLIGHT_BLESS").is_some_and(|v| v == "1") {
        strip.save(&path).unwrap();
        return;
    }
    let shipped = image::open(&path).unwrap().into_rgb8();
    assert_eq!(shipped.dimensions(), strip.dimensions());
    let off = |a: &[u8], b: &[u8]| {
        let sum: u64 = a.iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        sum as f64 / a.len() as f64
    };
    let apart = off(shipped.as_raw(), strip.as_raw());
    println!("off by {apart:.3} of 255 in the mean");
    assert!(apart < 1.0, "bless them anew: {apart}");
    // The control: presets one place on.
    let (_, rest) = strip.as_raw().split_at(3 * side as usize);
    assert!(off(shipped.as_raw(), rest) > 10.0);

    let document = Document::new(small(), None);
    let mut window = opened([1280.0, 800.0], move |ctx| Editor::new(document.clone(), ctx));
    window.run_steps(2);
    let shown = window.render().unwrap();
    for (k, preset) in (0..).zip(PRESETS) {
        let rect = window.get_by_role_and_label(Role::Button, preset.name).rect();
        let middle = rect.min + Vec2::splat(0.5 * rect.width());
        let around = |x: i32, y: i32| {
            let pixel = shown.get_pixel((middle.x as i32 + x) as u32, (middle.y as i32 + y) as u32);
            [pixel[0], pixel[1], pixel[2]].map(f64::from)
        };
        let places = (-12..12).flat_map(|y| (-12..12).map(move |x| (x, y)));
        let mean = places.fold([0.0; 3], |sum, (x, y)| {
            let pixel = around(x, y);
            [0, 1, 2].map(|c| sum[c] + pixel[c] / 576.0)
        });
        let inner = image::imageops::crop_imm(&shipped, k * side + 20, 20, side - 40, side - 40);
        let inner = inner.to_image();
        let of_strip = [0, 1, 2].map(|c| {
            inner.pixels().map(|p| f64::from(p[c])).sum::<f64>() / inner.pixels().len() as f64
        });
        println!("{}: {mean:.0?}, in the strip {of_strip:.0?}", preset.name);
        assert!((0..3).all(|c| (mean[c] - of_strip[c]).abs() < 25.0), "{}", preset.name);
    }
}
