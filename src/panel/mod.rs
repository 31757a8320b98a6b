//! The control panel: what it shows is [`PanelState`], what the user wants is a list of [`PanelAction`]s. It knows no window and
//! no headset: a host feeds it events and draws its triangles.

mod sections;
mod state;

pub use state::{Notice, PanelAction, PanelState, Progress, TimingRow, short_name};

use std::time::Duration;

/// The panel's width, points.
pub const WIDTH: f32 = 300.0;

/// The panel and what it remembers between frames (scroll positions, the font's texture).
#[derive(Default)]
pub struct Panel {
    context: egui::Context,
}

/// One frame of the panel.
pub struct PanelFrame {
    /// Triangles.
    pub jobs: Vec<egui::ClippedPrimitive>,
    /// Textures that they need.
    pub textures: egui::TexturesDelta,
    /// Pixels a point.
    pub pixels_per_point: f32,
    /// What the user wants.
    pub actions: Vec<PanelAction>,
    /// What is left of the window beside the panel, points: left, top, right, bottom.
    pub canvas: [f32; 4],
    /// When the panel wants to be drawn again; zero is at once.
    pub repaint_after: Duration,
    /// Cursor shape, clipboard, and the like.
    pub platform: egui::PlatformOutput,
}

impl Panel {
    /// A panel in the dark style.
    pub fn new() -> Self {
        let panel = Self::default();
        panel.context.set_theme(egui::Theme::Dark);
        panel.context.options_mut(|o| o.zoom_with_keyboard = false);
        panel.context.all_styles_mut(|style| {
            style.text_styles.insert(egui::TextStyle::Small, egui::FontId::proportional(11.0));
            style.visuals.widgets.noninteractive.fg_stroke.color = egui::Color32::from_gray(190);
            style.visuals.selection.bg_fill = egui::Color32::from_rgb(13, 104, 102);
            style.visuals.slider_trailing_fill = true;
            // a cursor that blinks is a window that never rests
            style.visuals.text_cursor.blink = false;
        });
        panel
    }

    /// What egui keeps; hosts hand it to those who make its events.
    pub fn context(&self) -> &egui::Context {
        &self.context
    }

    /// True if text is being typed, so that keys mean letters.
    pub fn is_typing(&self) -> bool {
        self.context.text_edit_focused()
    }

    /// True if something of the panel lies at a point (in points) that `canvas` of the last frame would call free.
    pub fn covers(&self, x: f32, y: f32) -> bool {
        self.context.layer_id_at(egui::pos2(x, y)).is_some_and(|layer| layer.order != egui::Order::Background)
    }

    /// Runs one frame on a window: the panel on the left, the rest free, notices and help over it.
    pub fn run(&mut self, input: egui::RawInput, state: &mut PanelState) -> PanelFrame {
        self.run_with(input, |ui, actions| {
            if state.open {
                egui::Panel::left("panel").exact_size(WIDTH).show(ui, |ui| sections::all(ui, state, actions));
            }
            let free = ui.available_rect_before_wrap();
            sections::overlays(ui, free, state);
            free
        })
    }

    /// Runs one frame on a surface that the panel fills, as on a board in the world: there is nothing beside it that could be laid over,
    /// and nothing is laid over it.
    pub fn run_filling(&mut self, input: egui::RawInput, state: &mut PanelState) -> PanelFrame {
        self.run_with(input, |ui, actions| {
            egui::CentralPanel::default().show(ui, |ui| sections::all(ui, state, actions));
            egui::Rect::NOTHING
        })
    }

    /// [`Panel::run_filling`] for a pointer that is known as a place and a press alone, as a ray from a hand is. `size` in
    /// points, of `sharpness` pixels each; `at` the pointer now, in points. What is let go nowhere presses nothing, and what was dragged stays
    /// where it was.
    pub fn run_pointer(
        &mut self,
        (size, sharpness): ([f32; 2], f32),
        at: Option<[f32; 2]>,
        press: Option<bool>,
        state: &mut PanelState,
    ) -> PanelFrame {
        let mut input = egui::RawInput {
            screen_rect: Some(egui::Rect::from_min_size(egui::Pos2::ZERO, size.into())),
            focused: true,
            ..Default::default()
        };
        input.viewports.entry(input.viewport_id).or_default().native_pixels_per_point = Some(sharpness);
        match at {
            Some(at) => {
                input.events.push(egui::Event::PointerMoved(at.into()));
                input.events.extend(press.map(|pressed| egui::Event::PointerButton {
                    pos: at.into(),
                    button: egui::PointerButton::Primary,
                    pressed,
                    modifiers: egui::Modifiers::default(),
                }));
            }
            None => {
                if press == Some(false) {
                    self.context.stop_dragging();
                    self.context.input_mut(|i| i.pointer = Default::default());
                }
                input.events.push(egui::Event::PointerGone);
            }
        }
        self.run_filling(input, state)
    }

    fn run_with(
        &mut self,
        input: egui::RawInput,
        mut draw: impl FnMut(&mut egui::Ui, &mut Vec<PanelAction>) -> egui::Rect,
    ) -> PanelFrame {
        let mut actions = Vec::new();
        let mut canvas = egui::Rect::NOTHING;
        let output = self.context.run_ui(input, |ui| canvas = draw(ui, &mut actions));
        let repaint_after = output.viewport_output.get(&egui::ViewportId::ROOT).map_or(Duration::MAX, |v| v.repaint_delay);
        PanelFrame {
            jobs: self.context.tessellate(output.shapes, output.pixels_per_point),
            textures: output.textures_delta,
            pixels_per_point: output.pixels_per_point,
            actions,
            canvas: [canvas.left(), canvas.top(), canvas.right(), canvas.bottom()],
            repaint_after,
            platform: output.platform_output,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Presses and lets go at a place; returns what that asked for.
    fn click(panel: &mut Panel, state: &mut PanelState, at: [f32; 2]) -> Vec<PanelAction> {
        let size = ([WIDTH, 2400.0], 1.0);
        let mut actions = Vec::new();
        // sections that an earlier click has closed are open again
        panel.context.memory_mut(|memory| memory.data.clear());
        for (at, press) in [(Some(at), None), (Some(at), Some(true)), (Some(at), Some(false)), (None, None)] {
            let mut frame = panel.run_pointer(size, at, press, state);
            actions.extend(frame.actions);
            frame.textures.clear();
        }
        actions
    }

    #[test]
    fn every_button_that_is_pressed_says_something_and_a_rest_says_nothing() {
        let mut panel = Panel::new();
        let mut state = PanelState { undo_depth: 1, redo_depth: 1, ..PanelState::default() };
        let mut said = Vec::new();
        for y in (8..2400).step_by(9) {
            for x in [30.0, 90.0, 150.0, 210.0, 270.0] {
                said.extend(click(&mut panel, &mut state, [x, y as f32]));
                // what the clicks have changed in the state is not what this test is about
                state = PanelState { undo_depth: 1, redo_depth: 1, ..PanelState::default() };
            }
        }
        for wanted in [PanelAction::Undo, PanelAction::Redo, PanelAction::Reset, PanelAction::OpenDialog, PanelAction::Screenshot]
        {
            assert!(said.contains(&wanted), "{wanted:?} cannot be reached: {said:?}");
        }
        assert!(click(&mut panel, &mut state, [1.0, 2399.0]).is_empty(), "beside everything");
    }

    #[test]
    fn what_a_board_tells_and_counts_covers_no_control() {
        let plain = || PanelState { in_room: true, undo_depth: 1, ..PanelState::default() };
        let told = || {
            let text = "cannot write config.toml: it may not be written; start Incise where you may write".to_string();
            PanelState { notice: Some(Notice { text, error: true }), counters_shown: true, ..plain() }
        };
        let mut panel = Panel::new();
        let (mut reached, mut taken_away) = (Vec::new(), 0);
        for y in (8..2400).step_by(9) {
            for x in [30.0, 90.0, 150.0, 210.0, 270.0] {
                let (at, mut state) = ([x, y as f32], told());
                let said = click(&mut panel, &mut plain(), at);
                assert_eq!(click(&mut panel, &mut state, at), said, "at {at:?}");
                taken_away += usize::from(state.notice.is_none());
                reached.extend(said);
            }
        }
        assert!(reached.contains(&PanelAction::SaveConfig) && reached.contains(&PanelAction::Undo), "{reached:?}");
        assert!(taken_away > 0, "OK takes it away");
    }

    /// From where to where, downwards, the words of an error are drawn, points.
    fn told_between(frame: &PanelFrame) -> (f32, f32) {
        let meshes = frame.jobs.iter().filter_map(|job| match &job.primitive {
            egui::epaint::Primitive::Mesh(mesh) => Some(mesh),
            egui::epaint::Primitive::Callback(_) => None,
        });
        let trouble = meshes.flat_map(|m| &m.vertices).filter(|v| v.color == sections::TROUBLE).map(|v| v.pos.y);
        trouble.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)))
    }

    #[test]
    fn what_a_board_tells_stands_where_it_stays_from_its_first_frame_on() {
        for words in [4, 20, 60] {
            let notice = Notice { text: "cannot write here; ".repeat(words), error: true };
            let mut state = PanelState { in_room: true, ..PanelState::default() };
            let mut panel = Panel::new();
            let mut told = Vec::new();
            for frame in 0..5 {
                if frame == 2 {
                    state.notice = Some(notice.clone());
                }
                let mut frame = panel.run_pointer(([360.0, 600.0], 2.0), None, None, &mut state);
                frame.textures.clear();
                told.push(told_between(&frame));
            }
            assert!(told[1].0 > told[1].1, "nothing to be told: {told:?}");
            let (top, bottom) = told[2];
            assert_eq!(told[2..], [told[2]; 3], "it moves");
            assert!(top > 100.0 && bottom > top && bottom < 600.0 - 20.0, "an OK fits below {top}..{bottom}");
        }
    }

    #[test]
    fn a_board_s_glyphs_are_as_sharp_as_its_pixels() {
        for sharpness in [1.0, 2.0] {
            let mut frame = Panel::new().run_pointer(([WIDTH, 800.0], sharpness), None, None, &mut PanelState::default());
            assert_eq!(frame.pixels_per_point, sharpness);
            frame.textures.clear();
            let right = frame.jobs.iter().map(|job| job.clip_rect.right()).fold(0.0, f32::max);
            assert!(right <= WIDTH + 1.0, "points are points at any sharpness: {right}");
        }
    }

    #[test]
    fn counters_stand_over_the_picture_and_cost_nothing_when_off() {
        let mut panel = Panel::new();
        let mut state = PanelState::default();
        let mut stages = crate::diagnostics::Stages::default();
        stages.add("draw", 1.5);
        state.note_frame(stages, [("dispatches", 2); 8]);
        let size = [WIDTH + 600.0, 800.0];
        let mut triangles = |state: &mut PanelState| {
            let mut count = 0;
            for _ in 0..3 {
                let screen_rect = Some(egui::Rect::from_min_size(egui::Pos2::ZERO, size.into()));
                let mut frame = panel.run(egui::RawInput { screen_rect, ..Default::default() }, state);
                frame.textures.clear();
                count = frame.jobs.iter().filter(|job| job.clip_rect.right() > WIDTH + 1.0).map(triangles_of).sum();
                assert!(frame.actions.is_empty() && (!state.counters_shown || frame.canvas[0] >= WIDTH - 10.0));
            }
            count
        };
        let off = triangles(&mut state);
        state.counters_shown = true;
        let on = triangles(&mut state);
        state.counters_shown = false;
        assert!(on > off + 100, "{on} triangles beside {off}");
        assert_eq!(triangles(&mut state), off);
    }

    fn triangles_of(job: &egui::ClippedPrimitive) -> usize {
        match &job.primitive {
            egui::epaint::Primitive::Mesh(mesh) => mesh.indices.len() / 3,
            egui::epaint::Primitive::Callback(_) => 0,
        }
    }

    #[test]
    fn a_panel_that_is_only_looked_at_changes_no_setting() {
        let mut panel = Panel::new();
        let mut state = PanelState { diagonal: 0.164_234_567, tilt: 0.123_456_7, speed: 7.0, ..PanelState::default() };
        // between the slider's steps, and outside its range
        (state.config.tear.gap, state.config.tear.width) = (0.030_000_01, 0.7);
        (state.config.particles.radius, state.config.particles.neighbours) = (1.777_777_7, 50.0);
        state.config.dynamics.soft.frequency = 99.123_456;
        (state.config.vr.snap_turn, state.config.vr.haptics, state.config.vr.reach) = (0.5, 0.612_345_6, 0.030_000_01);
        let before = state.clone();
        for look in 0..6 {
            state.in_room = look > 2;
            panel.context.memory_mut(|memory| memory.data.clear());
            let mut frame = panel.run_pointer(([WIDTH, 2400.0], 1.0), None, None, &mut state);
            assert!(frame.actions.is_empty(), "{:?}", frame.actions);
            frame.textures.clear();
        }
        assert_eq!(state.config, before.config);
        assert_eq!((state.tilt, state.depth, state.speed), (before.tilt, before.depth, before.speed));
    }

    #[test]
    fn a_resting_panel_asks_for_no_frame() {
        let mut panel = Panel::new();
        let mut state = PanelState::default();
        let mut after = Duration::ZERO;
        for _ in 0..10 {
            let screen_rect = Some(egui::Rect::from_min_size(egui::Pos2::ZERO, [WIDTH, 800.0].into()));
            let mut frame = panel.run_filling(egui::RawInput { screen_rect, ..Default::default() }, &mut state);
            after = frame.repaint_after;
            assert!(frame.actions.is_empty());
            frame.textures.clear();
        }
        assert!(after > Duration::from_secs(3600), "{after:?}");
    }
}
