//! The panel's place in a window: what turns the window's events into the panel's.

use super::screen::Screen;
use crate::panel::Panel;
use egui_winit::egui::ViewportId;
use std::time::Duration;
use winit::raw_window_handle::HasDisplayHandle;
use winit::window::Window;

/// A fresh panel, and what makes its events. `repaint` is called, on any thread, when it wants to be drawn after some time.
pub fn panel_on(
    window: &Window,
    screen: &Screen,
    display: &dyn HasDisplayHandle,
    repaint: impl Fn(Duration) + Send + Sync + 'static,
) -> (Panel, egui_winit::State) {
    let panel = Panel::new();
    panel.context().set_request_repaint_callback(move |info| repaint(info.delay));
    let scale = Some(window.scale_factor() as f32);
    let side = Some(screen.longest_side() as usize);
    let state = egui_winit::State::new(panel.context().clone(), ViewportId::ROOT, display, scale, window.theme(), side);
    (panel, state)
}
