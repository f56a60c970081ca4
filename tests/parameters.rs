//! What the editor shows of a fibre's parameters: plotted lobes, help in pictures, presets' pictures.

use std::time::{Duration, Instant};

use eframe::egui::{self, Pos2, Rect, Vec2};
use egui_kittest::kittest::{NodeT, Queryable};
use hairlight::editor::Document;
use hairlight::editor::lobes::{Lobes, Subject};
use hairlight::scene::{Bcsdf, FibreSpec, Method, PRESETS, Pigment, RenderSpec};

use super::editor::{Window, editor, look, small, window};

fn subject(model: Bcsdf, method: Method, theta_i_deg: f64) -> Subject {
    let pigment = Pigment::Absorption([0.1, 0.3, 0.7]);
    let fibre = FibreSpec { model, pigment, ..FibreSpec::default() };
    let render = RenderSpec { method, ..RenderSpec::default() };
    Subject { fibre, render, theta_i: theta_i_deg.to_radians() }
}

fn greatest(apart: [Option<f64>; 4]) -> f64 {
    apart.into_iter().flatten().fold(0.0, f64::max)
}

#[test]
fn plotted_lobes_of_fast_are_the_exact_ones() {
    for model in [Bcsdf::Marschner, Bcsdf::Deon] {
        for theta_i_deg in [-60.0, 0.0, 30.0] {
            let of = subject(model, Method::Fast, theta_i_deg);
            let begun = Instant::now();
            let exact = Lobes::exact(&of);
            let exact_ms = 1e3 * begun.elapsed().as_secs_f64();
            let shaded = Lobes::shaded(&of).unwrap();
            let shaded_ms = 1e3 * begun.elapsed().as_secs_f64() - exact_ms;
            let begun = Instant::now();
            Lobes::shaded(&of).unwrap();
            let again_ms = 1e3 * begun.elapsed().as_secs_f64();
            let apart = shaded.apart(&exact);
            println!(
                "{model:?} at {theta_i_deg}°: {apart:.4?}; exact {exact_ms:.1} ms, \
                 shaded {shaded_ms:.1} ms, again {again_ms:.1} ms"
            );
            assert!(apart[..3].iter().all(Option::is_some), "{apart:?}");
            // Of longer paths the table is further off.
            let bounds = apart.into_iter().zip([0.02, 0.02, 0.02, 0.06]);
            assert!(bounds.flat_map(|(off, most)| Some(off? < most)).all(|good| good));
            // The controls: another roughness along, another width of the glint across.
            let mut other = of.clone();
            other.fibre.beta_r_deg *= 1.2;
            other.fibre.w_c *= 1.5;
            let far = shaded.apart(&Lobes::exact(&other));
            assert!(far.iter().flatten().all(|off| *off > 0.05), "{far:?}");
        }
    }
    // An eccentric fibre of Marschner's, and the method that is further off.
    let mut eccentric = subject(Bcsdf::Marschner, Method::Fast, 20.0);
    eccentric.fibre.eccentricity = 0.85;
    let [fast, xu] = [Method::Fast, Method::Xu].map(|method| {
        eccentric.render.method = method;
        greatest(Lobes::shaded(&eccentric).unwrap().apart(&Lobes::exact(&eccentric)))
    });
    println!("eccentric: fast {fast:.4}, xu {xu:.4}");
    assert!(fast < 0.03 && xu > 0.05);
    // What is path traced only has no shading, and says so.
    let chiang = subject(Bcsdf::Chiang, Method::Fast, 0.0);
    let refused = Lobes::shaded(&chiang).err().unwrap().to_string();
    assert!(refused.contains("chiang is path traced only"), "{refused}");
    assert!(Lobes::exact(&chiang).most()[0] > 0.0);
}

/// Along the strand and over all azimuths no more goes out than came in, and all of it from a clear fibre.
#[test]
fn plotted_lobes_hold_the_light() {
    let mut of = subject(Bcsdf::Deon, Method::Fast, 0.0);
    for (sigma_a, least, most) in [(0.0, 0.98, 1.02), (1.0, 0.1, 0.5)] {
        of.fibre.pigment = Pigment::Absorption([sigma_a; 3]);
        // Reciprocal without tilt and with one roughness: the integral over θ_o is that over θ_i.
        (of.fibre.alpha_r_deg, of.fibre.beta_tt_deg, of.fibre.beta_trt_deg) =
            (0.0, Some(7.0), Some(7.0));
        of.fibre.beta_r_deg = 7.0;
        for lobes in [Lobes::exact(&of), Lobes::shaded(&of).unwrap()] {
            let out: f64 = lobes
                .along
                .windows(2)
                .map(|w| {
                    let value = |k: usize| w[k].1.iter().sum::<f64>() * w[k].0.cos();
                    0.5 * (w[1].0 - w[0].0) * (value(0) + value(1))
                })
                .sum();
            println!("σ_a {sigma_a}: {out:.4}");
            assert!((least..most).contains(&out), "{out}");
        }
    }
}

/// Steps until `done` says so.
fn until(window: &mut Window, mut done: impl FnMut(&mut Window) -> bool) -> Duration {
    let begun = Instant::now();
    while !done(window) {
        assert!(begun.elapsed() < Duration::from_secs(120), "it never came");
        std::thread::sleep(Duration::from_millis(2));
        window.step();
    }
    begun.elapsed()
}

fn plotted(window: &Window) -> Option<String> {
    let plot = window.query_by_label_contains("Lobes, off the exact ones by")?;
    plot.accesskit_node().label()
}

#[test]
fn the_plot_follows_an_edit_and_never_shows_what_was() {
    let mut window = window(Document::new(small(), None));
    until(&mut window, |window| plotted(window).is_some());
    let before = plotted(&window).unwrap();
    window.state_mut().as_mut().unwrap().document.scene.fibre.w_c = 0.3;
    window.step();
    assert_eq!(plotted(&window), None, "what was is not what is");
    let took = until(&mut window, |window| plotted(window).is_some());
    let after = plotted(&window).unwrap();
    println!("{before}\n{after}\nafter {took:.0?}");
    assert!(after != before && after.contains("TRT"));
    let scene = &editor(&window).document.scene;
    let of = Subject { fibre: scene.fibre.clone(), render: scene.render.clone(), theta_i: 0.0 };
    let [r, ..] = Lobes::shaded(&of).unwrap().apart(&Lobes::exact(&of));
    let r = format!("R {:.2} %", 100.0 * r.unwrap());
    assert!(after.contains(&r), "{r}");
}

#[test]
fn help_shows_what_a_parameter_does() {
    let mut window = window(Document::new(small(), None));
    window.set_size(Vec2::new(1100.0, 1100.0));
    window.run_steps(3);
    for (label, words, said) in [
        ("width R", ["0.05°", "now", "45°"], "What goes along the strand"),
        ("shift TT", ["-20°", "now", "20°"], "What goes along the strand"),
        ("intensity R", ["0", "now", "4"], "heights are square roots"),
        ("colour TRT", ["0,0,0", "now", "1,1,1"], "own colour is multiplied by"),
        ("index of refraction", ["1", "now", "3"], "Lobes round the strand"),
        ("eccentricity", ["0.5", "now", "2"], "Lobes round the strand"),
        ("eumelanin", ["half", "now", "twice"], "Colour of the hair as a whole"),
        ("diameter", ["half", "now", "twice"], "Width of the strands"),
    ] {
        let at = window.get_by_role_and_label(egui::Role::Label, label).rect().center();
        window.hover_at(Pos2::ZERO);
        window.run_steps(2);
        window.hover_at(at);
        // Curves come from a thread.
        let took = until(&mut window, |window| window.query_by_label_contains(said).is_some());
        println!("{label}: {took:.0?}");
        words.iter().for_each(|word| _ = window.get_by_label(word));
        look(&mut window, &format!("help_{}.png", label.replace(' ', "_")));
    }
    // The control: a field without a picture.
    window.hover_at(Pos2::ZERO);
    window.run_steps(2);
    let at = window.get_by_role_and_label(egui::Role::Label, "fibre model").rect().center();
    window.hover_at(at);
    until(&mut window, |window| window.query_by_label_contains("fibre.model:").is_some());
    assert!(window.query_by_label("now").is_none());
}

/// Least, mean and greatest sRGB of what is drawn within a rectangle.
fn drawn(picture: &image::RgbaImage, rect: Rect) -> [[f64; 3]; 3] {
    let mut of = [[255.0, 255.0, 255.0], [0.0; 3], [0.0; 3]];
    let (columns, rows) =
        (rect.left() as u32..rect.right() as u32, rect.top() as u32..rect.bottom() as u32);
    let count = f64::from(columns.len() as u32 * rows.len() as u32);
    for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
        let pixel = picture.get_pixel(x, y).0.map(f64::from);
        let [least, mean, most] = &mut of;
        *least = [0, 1, 2].map(|c| f64::min(least[c], pixel[c]));
        *mean = [0, 1, 2].map(|c| mean[c] + pixel[c] / count);
        *most = [0, 1, 2].map(|c| f64::max(most[c], pixel[c]));
    }
    of
}

#[test]
fn presets_are_shown_as_what_they_look_like() {
    let mut window = window(Document::new(small(), None));
    let square = |window: &Window, name: &str| {
        let rect = window.get_by_label(name).rect();
        Rect::from_min_size(rect.min, Vec2::splat(rect.width())).shrink(4.0)
    };
    let begun = Instant::now();
    let last = PRESETS[PRESETS.len() - 1].name;
    until(&mut window, |window| {
        std::thread::sleep(Duration::from_millis(300));
        // Where there is no picture yet it is all of one colour.
        let [least, _, most] = drawn(&window.render().unwrap(), square(window, last));
        most[0] - least[0] > 12.0
    });
    println!("all pictures after {:.2?}", begun.elapsed());
    let picture = window.render().unwrap();
    let of = |name: &str| drawn(&picture, square(&window, name))[1];
    let bright = |name: &str| of(name).iter().sum::<f64>();
    PRESETS.iter().for_each(|preset| println!("{}: {:.0?}", preset.name, of(preset.name)));
    assert!(bright("white") > bright("blond") && bright("blond") > bright("brown"));
    assert!(bright("brown") > bright("black"));
    let [r, _, b] = of("red");
    assert!(r > b + 5.0);
    // They are buttons by their names.
    window.get_by_label("blond").click();
    window.run_steps(3);
    assert_eq!(editor(&window).document.scene.fibre.preset, "blond");
    window.set_size(Vec2::new(1100.0, 900.0));
    for (theme, name) in [(egui::Theme::Light, "light"), (egui::Theme::Dark, "dark")] {
        window.ctx.set_theme(theme);
        window.run_steps(3);
        until(&mut window, |window| plotted(window).is_some());
        look(&mut window, &format!("parameters_{name}.png"));
    }
}
