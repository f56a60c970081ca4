//! Controls of the editor for those who do not see them or have no pointer: names, and what Tab reaches.

use std::collections::{BTreeMap, BTreeSet};

use eframe::egui::accessibility::is_input;
use eframe::egui::accesskit::{Action, NodeId, Role};
use eframe::egui::{self, Event, Key, Modifiers};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use hairlight::editor::Document;
use hairlight::scene::{FIELDS, Pigment};

use crate::editor::{Window, editor, key, look, seen, small, window_of};
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
