//! The panel's parts, top to bottom.

use super::state::{Notice, PanelAction, PanelState};
use crate::config::PresetName;
use crate::input::Layer;
use crate::surgery::WallMode;
use egui::{CollapsingHeader, Color32, ComboBox, RichText, ScrollArea, Slider, Ui};

type Actions = Vec<PanelAction>;

const LAYERS: [(Layer, &str, &str); 8] = [
    (Layer::Particles, "Particles", "Particles and the springs between them"),
    (Layer::Wireframe, "Wireframe", "Edges of the surface"),
    (Layer::Sections, "Sections", "Clusters of faces that an edit may skip"),
    (Layer::Boxes, "Boxes", "The boxes of the last tear"),
    (Layer::Influences, "Influences", "Which particles move which vertices"),
    (Layer::Strips, "Strips", "What blades swept, at rest: nothing pulls across"),
    (Layer::Edges, "Edges", "Rims of wounds and cuts"),
    (Layer::Errors, "Errors", "Distance of the GPU's positions from the f64 reference; reads back, so it is slow"),
];

/// Keys and mouse, as the help shows them.
pub const HELP: [(&str, &str); 24] = [
    ("Left drag on the tissue", "tear"),
    ("... and the wheel", "depth of the blade"),
    ("... with Shift and the wheel, or Q / E", "lean of the blade"),
    ("Shift + left drag", "draw a line, cut through it"),
    ("Ctrl + left drag", "grab"),
    ("Space (hold)", "squeeze what is under the cursor"),
    ("Right drag, or left drag beside", "orbit"),
    ("Middle drag, Shift + right drag", "pan"),
    ("Wheel, two fingers, + and -", "zoom to the cursor"),
    ("Alt + left drag, arrow keys", "orbit without a right button"),
    ("Alt + Shift + left drag", "pan without a middle button"),
    ("[ and ]", "depth of the blade"),
    ("Ctrl+Z, Ctrl+Y", "undo, redo"),
    ("R", "reset"),
    ("A", "next animation, after the last the rest pose"),
    ("P, N", "pause, single step"),
    ("F", "frame the model"),
    ("Ctrl+O", "open a model (or drop a file)"),
    ("F3", "counters and times over the picture"),
    ("F12, F10", "screenshot, record"),
    ("F11", "full screen"),
    ("Tab", "show or hide the panel"),
    ("F1 or H", "this help"),
    ("Esc", "drop what is in hand; Ctrl+Q quits"),
];

/// Everything, in a column that scrolls.
pub fn all(ui: &mut Ui, state: &mut PanelState, actions: &mut Actions) {
    ui.add_space(6.0);
    ui.horizontal(|ui| {
        ui.heading(RichText::new("Incise").strong());
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if !state.in_room && ui.button("Help").on_hover_text("Mouse and keys (F1)").clicked() {
                state.help = !state.help;
            }
            let hint = "Write the settings to config.toml (Ctrl+S); its comments stay";
            if ui.button("Save settings").on_hover_text(hint).clicked() {
                actions.push(PanelAction::SaveConfig);
            }
        });
    });
    ui.separator();
    // from below, so that what is told has its place and its height in the frame in which it comes
    ui.with_layout(egui::Layout::bottom_up(egui::Align::Min), |ui| {
        if state.in_room {
            told_below(ui, state);
        }
        ui.with_layout(egui::Layout::top_down(egui::Align::Min), |ui| column(ui, state, actions));
    });
}

fn column(ui: &mut Ui, state: &mut PanelState, actions: &mut Actions) {
    ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
        section(ui, "Model", true, |ui| model(ui, state, actions));
        section(ui, "Edits", true, |ui| edits(ui, state, actions));
        if state.in_room {
            section(ui, "Hands", true, |ui| hands(ui, state, actions));
        }
        section(ui, "Blade", true, |ui| blade(ui, state, actions));
        section(ui, "Material", true, |ui| material(ui, state, actions));
        section(ui, "Animation", true, |ui| animation(ui, state, actions));
        section(ui, "Particles", false, |ui| particles(ui, state, actions));
        section(ui, "Inspection", false, |ui| layers(ui, state, actions));
        section(ui, "Timing", false, |ui| timing(ui, state, actions));
        ui.add_space(8.0);
    });
}

fn section(ui: &mut Ui, title: &str, open: bool, add: impl FnOnce(&mut Ui)) {
    CollapsingHeader::new(RichText::new(title).strong()).id_salt(title).default_open(open).show(ui, |ui| {
        ui.spacing_mut().slider_width = 120.0;
        add(ui);
    });
}

fn model(ui: &mut Ui, state: &mut PanelState, actions: &mut Actions) {
    ui.add(egui::Label::new(RichText::new(state.model_name()).strong()).truncate()).on_hover_text(&state.model);
    let [vertices, faces, particles, pieces] = state.counts;
    let pieces = if pieces == 1 { "1 piece".to_string() } else { format!("{pieces} pieces") };
    ui.small(format!("{faces} faces, {vertices} vertices"));
    ui.small(format!("{particles} particles, {pieces}, diagonal {}", length(state.diagonal)));
    ui.horizontal_wrapped(|ui| {
        for name in state.bundled.clone() {
            let shown = state.model == name;
            if ui.selectable_label(shown, name).on_hover_text("Bundled model").clicked() {
                actions.push(PanelAction::Open(name.to_string()));
            }
        }
    });
    if !state.in_room {
        path(ui, state, actions);
    }
    ui.horizontal(|ui| {
        if !state.in_room && ui.button("Browse...").on_hover_text("Choose a file (Ctrl+O)").clicked() {
            actions.push(PanelAction::OpenDialog);
        }
        if ui.button("Export").on_hover_text("Write the model as it is to export.glb, pieces as nodes of their own").clicked() {
            actions.push(PanelAction::Export);
        }
    });
    if let Some(progress) = &state.loading {
        ui.add(egui::ProgressBar::new(progress.part).desired_height(8.0));
        ui.small(&progress.text);
    }
}

/// A model by its file's name.
fn path(ui: &mut Ui, state: &mut PanelState, actions: &mut Actions) {
    ui.horizontal(|ui| {
        let field = egui::TextEdit::singleline(&mut state.path).hint_text("path, or drop a file").desired_width(150.0);
        let field = ui.add(field).on_hover_text(".glb, .gltf, .obj or .stl");
        let enter = field.lost_focus() && ui.input(|i| i.key_pressed(egui::Key::Enter));
        let open = ui.button("Open").on_hover_text("Open the file of this name").clicked();
        if (enter || open) && !state.path.trim().is_empty() {
            actions.push(PanelAction::Open(state.path.trim().to_string()));
        }
    });
}

fn edits(ui: &mut Ui, state: &mut PanelState, actions: &mut Actions) {
    ui.horizontal(|ui| {
        let mut button = |on: bool, text: &str, hint: &str, action: PanelAction| {
            if ui.add_enabled(on, egui::Button::new(text)).on_hover_text(hint).clicked() {
                actions.push(action);
            }
        };
        button(state.undo_depth > 0, "Undo", "Take the last edit back (Ctrl+Z)", PanelAction::Undo);
        button(state.redo_depth > 0, "Redo", "Do it again (Ctrl+Y)", PanelAction::Redo);
        button(state.undo_depth > 0, "Reset", "The model as it was loaded (R)", PanelAction::Reset);
        let (frame, hint) =
            if state.in_room { ("To me", "Bring the model within reach") } else { ("Frame", "Show the whole model (F)") };
        button(true, frame, hint, PanelAction::Frame);
    });
    ui.horizontal(|ui| {
        if ui.button("Screenshot").on_hover_text("Write a picture of the window (F12)").clicked() {
            actions.push(PanelAction::Screenshot);
        }
        let mut recording = state.recording;
        if !state.in_room && ui.checkbox(&mut recording, "Record").on_hover_text("Write a picture of every frame (F10)").changed()
        {
            actions.push(PanelAction::Record(recording));
        }
    });
    if !state.last_edit.is_empty() {
        ui.small(&state.last_edit);
    }
}

fn hands(ui: &mut Ui, state: &mut PanelState, actions: &mut Actions) {
    ui.horizontal(|ui| {
        if ui.button("Swap").on_hover_text("Exchange the tools of the two hands").clicked() {
            actions.push(PanelAction::SwapHands);
        }
        let mut plane_tool = state.plane_tool;
        let hint = "The scalpel cuts along the plane that it shows, on letting go; else it tears";
        if ui.toggle_value(&mut plane_tool, "Plane").on_hover_text(hint).changed() {
            actions.push(PanelAction::PlaneTool(plane_tool));
        }
        let mut calibrating = state.calibrating;
        let hint = "Find the tip: rest it on a firm point, hold the trigger, turn the hand every way, let go";
        if ui.toggle_value(&mut calibrating, "Calibrate tip").on_hover_text(hint).changed() {
            actions.push(PanelAction::Calibrate(calibrating));
        }
    });
    if state.calibrating {
        ui.small("Rest the tip on a firm point, hold the trigger, turn the hand every way, let go.");
    }
    let [x, y, z] = state.config.vr.tip_offset.map(|m| 1e3 * m);
    ui.small(format!("tip at {x:.0}, {y:.0}, {z:.0} mm from the grip"));
    let vr = &mut state.config.vr;
    distance(ui, &mut vr.reach, 0.0, 0.1, "reach", "How much deeper the scalpel goes with the trigger fully pulled");
    ui.add(slider(&mut vr.haptics, 0.0..=1.0).text("vibration")).on_hover_text("Strength of what the hands feel");
    let mut degrees = vr.snap_turn.to_degrees();
    let turn = slider(&mut degrees, 0.0..=90.0).suffix(" deg").fixed_decimals(0).text("turn");
    if ui.add(turn).on_hover_text("One push of the stick").changed() {
        vr.snap_turn = degrees.to_radians();
    }
}

/// What a pointer's blade and grab need, and hands have by themselves.
fn pointer(ui: &mut Ui, state: &mut PanelState) {
    let [low, high] = state.depth_range;
    distance(ui, &mut state.depth, low, high, "depth", "How far the tip goes under the surface; the wheel while tearing");
    let mut degrees = state.tilt.to_degrees();
    let lean = slider(&mut degrees, -68.0..=68.0).suffix(" deg").fixed_decimals(0).text("lean");
    if ui.add(lean).on_hover_text("Lean of the blade to the right; Shift and the wheel while tearing").changed() {
        state.tilt = degrees.to_radians();
    }
    let diagonal = state.diagonal;
    distance(ui, &mut state.grab_radius, 0.01 * diagonal, 0.4 * diagonal, "grab", "Radius of a grab (Ctrl and drag)");
}

fn blade(ui: &mut Ui, state: &mut PanelState, actions: &mut Actions) {
    if !state.in_room {
        pointer(ui, state);
    }
    let diagonal = state.diagonal;
    let mut width = state.config.tear.width * diagonal;
    let hint = "Width of the slit that is taken out; 0 is a slit that takes nothing out";
    let mut changed = distance(ui, &mut width, 0.0, 0.1 * diagonal, "width", hint);
    if changed {
        state.config.tear.width = width / diagonal;
    }
    ui.horizontal(|ui| {
        ui.label("wall");
        for (wall, name) in [(WallMode::Open, "open"), (WallMode::Closed, "closed")] {
            let hint = "Open: the surface is clipped. Closed: walls and a floor line the slit";
            changed |= ui.selectable_value(&mut state.config.tear.wall, wall, name).on_hover_text(hint).changed();
        }
    });
    if state.config.tear.wall == WallMode::Closed && state.config.tear.width == 0.0 {
        ui.colored_label(WARNING, "A slit of width 0 has no walls.");
    }
    let mut gap = state.config.tear.gap * diagonal;
    if distance(ui, &mut gap, 0.0, 0.1 * diagonal, "opening", "How far the lips of a wound are drawn apart") {
        state.config.tear.gap = gap / diagonal;
        changed = true;
    }
    let time = slider(&mut state.config.tear.opening_time, 0.0..=3.0).suffix(" s").text("opens in");
    changed |= ui.add(time).on_hover_text("Seconds until a wound stands open").changed();
    if changed {
        actions.push(PanelAction::SettingsChanged);
    }
}

fn material(ui: &mut Ui, state: &mut PanelState, actions: &mut Actions) {
    ui.horizontal(|ui| {
        for (preset, name, hint) in [
            (PresetName::Soft, "soft", "Follows the hand far and comes back slowly"),
            (PresetName::Firm, "firm", "Gives little and settles at once"),
            (PresetName::Sponge, "sponge", "Gives locally and creeps back"),
        ] {
            let now = state.config.dynamics.preset == preset;
            if ui.selectable_label(now, name).on_hover_text(hint).clicked() && !now {
                state.config.dynamics.preset = preset;
                actions.push(PanelAction::Material(preset));
            }
        }
    });
    let dynamics = &mut state.config.dynamics;
    let values = match dynamics.preset {
        PresetName::Soft => &mut dynamics.soft,
        PresetName::Firm => &mut dynamics.firm,
        PresetName::Sponge => &mut dynamics.sponge,
    };
    let mut changed = false;
    let mut add = |slider: Slider<'_>, hint: &str| changed |= ui.add(slider).on_hover_text(hint).changed();
    add(
        slider(&mut values.frequency, 0.2..=20.0).logarithmic(true).suffix(" Hz").text("frequency"),
        "Of a lone particle on its anchor",
    );
    add(slider(&mut values.damping, 0.0..=3.0).text("damping"), "Ratio: 0 rings for ever, 1 is critical");
    add(
        slider(&mut values.coupling, 0.0..=8.0).text("coupling"),
        "Stiffness of a spring to a neighbour, in anchor stiffnesses: how far a push spreads",
    );
    let hint = "Particles turn with their neighbourhood: large bends keep their shape";
    changed |= ui.checkbox(&mut values.rotations, "rotations").on_hover_text(hint).changed();
    if changed {
        actions.push(PanelAction::SettingsChanged);
    }
}

fn animation(ui: &mut Ui, state: &mut PanelState, actions: &mut Actions) {
    let name = |i: Option<usize>| i.and_then(|i| state.animations.get(i)).map_or("rest pose", |a| a.0.as_str()).to_string();
    ComboBox::from_id_salt("animation").selected_text(name(state.animation)).show_ui(ui, |ui| {
        for choice in std::iter::once(None).chain((0..state.animations.len()).map(Some)) {
            let text = match choice.and_then(|i| state.animations.get(i)) {
                Some((name, duration)) => format!("{name} ({duration:.2} s)"),
                None => "rest pose".to_string(),
            };
            if ui.selectable_label(state.animation == choice, text).clicked() {
                actions.push(PanelAction::Animate(choice));
            }
        }
    });
    let speed = slider(&mut state.speed, 0.0..=4.0).suffix(" x").text("speed");
    if ui.add(speed).on_hover_text("Speed of the animation; 1 is the model's own").changed() {
        actions.push(PanelAction::Speed(state.speed));
    }
    ui.horizontal(|ui| {
        let mut paused = state.paused;
        if ui.checkbox(&mut paused, "Pause").on_hover_text("Stop the clock (P)").changed() {
            actions.push(PanelAction::Pause(paused));
        }
        if ui.add_enabled(state.paused, egui::Button::new("Step")).on_hover_text("One step of 1/90 s (N)").clicked() {
            actions.push(PanelAction::Step);
        }
    });
}

fn particles(ui: &mut Ui, state: &mut PanelState, actions: &mut Actions) {
    let diagonal = state.diagonal;
    let mut spacing = state.spacing.unwrap_or(state.spacing_used);
    let hint = "Least distance of particles; they are sampled anew when the slider is let go";
    if distance(ui, &mut spacing, 0.01 * diagonal, 0.3 * diagonal, "spacing", hint) {
        state.spacing = Some(spacing);
        state.stale = true;
    }
    let settings = &mut state.config.particles;
    let radius = slider(&mut settings.radius, 1.05..=4.0).suffix(" spacings").text("radius").max_decimals(2);
    let hint = "Reach of a particle's influence; 1.5 spacings or more is smooth";
    state.stale |= ui.add(radius).on_hover_text(hint).changed();
    let springs = slider(&mut settings.neighbours, 0.0..=6.0).suffix(" spacings").text("springs").max_decimals(2);
    let hint = "Particles nearer than this are joined by a spring";
    state.stale |= ui.add(springs).on_hover_text(hint).changed();
    if !state.stale {
        return;
    }
    if state.undo_depth > 0 {
        let hint = "Sample the particles with these values on the model as it was loaded";
        if ui.button("Regenerate, without the edits").on_hover_text(hint).clicked() {
            state.stale = false;
            actions.push(PanelAction::Regenerate);
        }
    } else if !ui.input(|i| i.pointer.any_down()) && !ui.ctx().text_edit_focused() {
        state.stale = false;
        actions.push(PanelAction::Regenerate);
    }
}

fn layers(ui: &mut Ui, state: &mut PanelState, actions: &mut Actions) {
    for (layer, name, hint) in LAYERS {
        let mut on = state.layers.contains(&layer);
        if ui.checkbox(&mut on, name).on_hover_text(hint).changed() {
            actions.push(PanelAction::Show(layer, on));
        }
    }
}

fn timing(ui: &mut Ui, state: &mut PanelState, actions: &mut Actions) {
    plot(ui, state);
    egui::Grid::new("stages").num_columns(2).spacing([16.0, 2.0]).show(ui, |ui| {
        for &(name, ms) in state.stages.rows() {
            ui.small(name);
            ui.small(format!("{ms:.3} ms"));
            ui.end_row();
        }
        for &(name, ms) in state.gpu_stages.rows() {
            ui.small(format!("{name}, GPU"));
            ui.small(format!("{ms:.3} ms"));
            ui.end_row();
        }
        for &(name, count) in state.counters.iter().filter(|_| state.in_room && state.counters_shown) {
            ui.small(name);
            ui.small(count.to_string());
            ui.end_row();
        }
    });
    if !state.table.is_empty() {
        ui.separator();
        ui.small("Last tear, a segment");
        egui::Grid::new("table").num_columns(3).spacing([12.0, 2.0]).striped(true).show(ui, |ui| {
            for heading in ["", "median", "most"] {
                ui.small(heading);
            }
            ui.end_row();
            for row in &state.table {
                ui.small(row.name);
                ui.small(format!("{:.3} ms", row.median_ms));
                ui.small(format!("{:.3} ms", row.most_ms));
                ui.end_row();
            }
        });
    }
    let hint = "Counters, stages on the CPU and passes on the GPU, over the picture (F3)";
    let words = if state.in_room { "Counters" } else { "Counters over the picture" };
    ui.checkbox(&mut state.counters_shown, words).on_hover_text(hint);
    let mut vsync = state.vsync;
    if !state.in_room && ui.checkbox(&mut vsync, "Wait for the display").on_hover_text("Vertical synchronisation").changed() {
        actions.push(PanelAction::Vsync(vsync));
    }
    ui.small(&state.adapter);
}

/// What the last frame cost, in the upper right corner.
fn counters(ui: &mut Ui, free: egui::Rect, state: &PanelState) {
    let area = egui::Area::new(egui::Id::unique("counters")).order(egui::Order::Middle).interactable(false).constrain_to(free);
    area.pivot(egui::Align2::RIGHT_TOP).fixed_pos(free.right_top() + egui::vec2(-12.0, 12.0)).show(ui.ctx(), |ui| {
        ui.set_clip_rect(free); // a small window has no room for all
        egui::Frame::new().fill(Color32::from_black_alpha(170)).corner_radius(4.0).inner_margin(8.0).show(ui, |ui| {
            egui::Grid::new("counters").num_columns(2).spacing([16.0, 1.0]).show(ui, |ui| {
                let mut row = |name: &str, value: String| {
                    ui.small(name);
                    ui.label(RichText::new(value).small().monospace());
                    ui.end_row();
                };
                row("frame, CPU", format!("{:.3} ms", state.stages.total()));
                state.stages.rows().iter().for_each(|&(name, ms)| row(name, format!("{ms:.3} ms")));
                state.gpu_stages.rows().iter().for_each(|&(name, ms)| row(&format!("{name}, GPU"), format!("{ms:.3} ms")));
                state.counters.iter().for_each(|&(name, count)| row(name, count.to_string()));
            });
        });
    });
}

/// Milliseconds of the last frames as bars; the line is 1/90 s.
fn plot(ui: &mut Ui, state: &PanelState) {
    let (area, response) = ui.allocate_exact_size(egui::vec2(ui.available_width(), 56.0), egui::Sense::hover());
    let paint = ui.painter_at(area);
    paint.rect_filled(area, 3.0, Color32::from_gray(20));
    let budget = 1000.0 / 90.0;
    let most = state.frame_ms.iter().copied().fold(1.5 * budget, f32::max);
    let height = |ms: f32| area.bottom() - area.height() * ms / most;
    let step = area.width() / state.frame_ms.len().max(60) as f32;
    for (i, &ms) in state.frame_ms.iter().enumerate() {
        let left = area.left() + i as f32 * step;
        let bar = egui::Rect::from_min_max(egui::pos2(left, height(ms)), egui::pos2(left + (step - 1.0).max(1.0), area.bottom()));
        paint.rect_filled(bar, 0.0, if ms > budget { WARNING } else { Color32::from_rgb(90, 170, 130) });
    }
    paint.hline(area.x_range(), height(budget), egui::Stroke::new(1.0, Color32::from_gray(120)));
    response.on_hover_text("Milliseconds of the last frames; the line is 1/90 s");
}

const WARNING: Color32 = Color32::from_rgb(225, 150, 70);
/// The words of an error.
pub const TROUBLE: Color32 = Color32::from_rgb(240, 130, 110);

/// A slider that leaves a value alone until it is moved: others round and clamp what they only show.
fn slider<'a>(value: &'a mut f64, range: std::ops::RangeInclusive<f64>) -> Slider<'a> {
    Slider::new(value, range).clamping(egui::SliderClamping::Edits)
}

/// A slider over metres, in the unit that suits the larger end. Returns whether the value was changed.
fn distance(ui: &mut Ui, metres: &mut f64, low: f64, high: f64, text: &str, hint: &str) -> bool {
    let (unit, per_metre) = unit_of(high);
    let mut value = *metres * per_metre;
    let slider = slider(&mut value, low * per_metre..=high * per_metre).suffix(unit).text(text).max_decimals(2).smart_aim(false);
    let changed = ui.add(slider).on_hover_text(hint).changed();
    if changed {
        *metres = value / per_metre;
    }
    changed
}

/// The unit that lengths up to `metres` are told in, and how many there are to a metre.
fn unit_of(metres: f64) -> (&'static str, f64) {
    if metres < 1e-4 {
        (" \u{b5}m", 1e6)
    } else if metres < 1.0 {
        (" mm", 1e3)
    } else {
        (" m", 1.0)
    }
}

fn length(metres: f64) -> String {
    let (unit, per_metre) = unit_of(metres);
    let decimals = if per_metre > 1.0 { 1 } else { 2 };
    format!("{:.*}{unit}", decimals, metres * per_metre)
}

/// What there is to be told, with a button that takes it away. Returns whether that was pressed.
fn notice(ui: &mut Ui, told: &Notice) -> bool {
    told_text(ui, told);
    ui.button("OK").clicked()
}

fn told_text(ui: &mut Ui, told: &Notice) {
    let colour = if told.error { TROUBLE } else { ui.visuals().text_color() };
    ui.colored_label(colour, &told.text);
}

/// What there is to be told, in a row of its own at the lower edge: nothing moves under a hand that is about to press, and nothing is
/// covered. What it takes is taken from the column that scrolls. `ui` goes upwards: egui's own panel at a lower edge stands where its
/// size of the frame before puts it, and in its first frame that is a guess.
fn told_below(ui: &mut Ui, state: &mut PanelState) {
    let Some(told) = &state.notice else { return };
    let pressed = ui.button("OK").clicked();
    told_text(ui, told);
    ui.separator();
    if pressed {
        state.notice = None;
    }
}

/// Notices and help over a window's picture.
pub fn overlays(ui: &mut Ui, free: egui::Rect, state: &mut PanelState) {
    if let Some(told) = &state.notice {
        let title = if told.error { "That did not work" } else { "Done" };
        let pressed = egui::Window::new(title)
            .id(egui::Id::unique("notice"))
            .collapsible(false)
            .resizable(false)
            .fixed_pos(free.left_top() + egui::vec2(16.0, 16.0))
            .show(ui.ctx(), |ui| {
                ui.set_width(420f32.min((free.width() - 64.0).max(120.0)));
                notice(ui, told)
            })
            .and_then(|window| window.inner);
        if pressed == Some(true) {
            state.notice = None;
        }
    }
    if let Some(file) = &state.hovered {
        let text = format!("Let go to open {file}");
        let paint = ui.ctx().layer_painter(egui::LayerId::new(egui::Order::Foreground, egui::Id::unique("hovered")));
        paint.rect_filled(free, 0.0, Color32::from_black_alpha(150));
        paint.text(free.center(), egui::Align2::CENTER_CENTER, text, egui::FontId::proportional(20.0), Color32::WHITE);
    }
    if state.counters_shown {
        counters(ui, free, state);
    }
    if state.help {
        let mut open = true;
        let height = (free.height() - 70.0).max(80.0);
        egui::Window::new("Mouse and keys")
            .open(&mut open)
            .collapsible(false)
            .resizable(false)
            .pivot(egui::Align2::CENTER_CENTER)
            .fixed_pos(free.center())
            .show(ui.ctx(), |ui| {
                ScrollArea::vertical().max_height(height).min_scrolled_height(height).show(ui, |ui| {
                    egui::Grid::new("help").num_columns(2).spacing([20.0, 3.0]).striped(true).show(ui, |ui| {
                        for (keys, what) in HELP {
                            ui.label(RichText::new(keys).strong());
                            ui.label(what);
                            ui.end_row();
                        }
                    });
                });
            });
        state.help &= open;
    }
}

#[cfg(test)]
mod tests {
    use super::length;

    #[test]
    fn lengths_are_told_in_the_unit_that_suits_them() {
        let told = [174.6, 1.0, 0.24, 2e-4, 3e-5].map(length);
        assert_eq!(told, ["174.60 m", "1.00 m", "240.0 mm", "0.2 mm", "30.0 \u{b5}m"]);
    }
}
