//! The panel as a board in the room: opened in front of the user, pointed at with the aim ray, pressed with the trigger. It has a
//! swapchain of its own that the compositor shows as a quad, so an open board costs one small picture and a closed one nothing.

use super::error::VrError;
use super::input::Hand;
use super::space::Pose;
use super::swapchain::Images;
use crate::gpu::Context;
use crate::gpu::ui::{UiCost, UiFrame, UiPass};
use crate::panel::{Panel, PanelAction, PanelState};
use glam::{DQuat, DVec3};
use openxr as xr;

/// The board's size in the room, metres.
const SIZE: (f64, f64) = (0.36, 0.60);
/// The board's points.
pub const POINTS: [f32; 2] = [360.0, 600.0];
/// Pixels a point.
pub const SHARPNESS: f32 = 2.0;
/// From the head to where it opens: forwards, to the left, down. Metres.
const PLACE: DVec3 = DVec3::new(-0.4, -0.15, -0.58);
/// A trigger presses above this.
const PRESSED: f64 = 0.5;

/// Where a ray meets the board.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pointed {
    hand: usize,
    at: [f32; 2],
    pressed: bool,
}

/// What the panel is told of a ray.
#[derive(Clone, Copy, Debug, Default)]
struct Pointer {
    pointed: Option<Pointed>,
    /// The panel was told that something is pressed.
    down: bool,
    /// Nobody knows what the hands did meanwhile.
    away: bool,
}

impl Pointer {
    /// Where the panel is to see its pointer, and whether that goes down or up. A trigger that was pulled elsewhere is no press; one that
    /// leaves the board lets go there.
    fn tell(&mut self, now: Option<Pointed>) -> (Option<[f32; 2]>, Option<bool>) {
        let now = now.filter(|_| !std::mem::take(&mut self.away));
        let was = std::mem::replace(&mut self.pointed, now);
        let pressed = now.is_some_and(|p| p.pressed);
        if self.down && !pressed {
            self.down = false;
            return (now.map(|p| p.at), Some(false));
        }
        let presses = pressed && !self.down && was.is_some_and(|w| !w.pressed);
        self.down |= presses;
        (now.map(|p| p.at), presses.then_some(true))
    }

    /// The hands are somebody else's for a while.
    fn look_away(&mut self) {
        (self.pointed, self.away) = (None, true);
    }
}

/// The board, open or not.
pub struct Board {
    panel: Panel,
    /// What the panel shows.
    pub state: PanelState,
    place: Option<Pose>,
    pointer: Pointer,
    /// The session's: see [`Board::prepare`].
    picture: Option<(Images, UiPass)>,
    drawn: bool,
}

impl Board {
    /// A closed board.
    pub fn new(state: PanelState) -> Self {
        Self { panel: Panel::new(), state, place: None, pointer: Pointer::default(), picture: None, drawn: false }
    }

    /// Opens it before the user, or closes it.
    pub fn toggle(&mut self, head: &Pose) {
        self.drawn = false;
        self.pointer.look_away();
        self.place = match self.place {
            Some(_) => None,
            None => Some(placed(head)),
        };
    }

    /// The hands are the runtime's menu's: what they pressed here they have let go.
    pub fn look_away(&mut self) {
        self.pointer.look_away();
    }

    /// True while it is open.
    pub fn is_open(&self) -> bool {
        self.place.is_some()
    }

    /// Makes what it is drawn with, at the start of a session: opening it later compiles nothing.
    pub fn prepare(&mut self, session: &xr::Session<xr::Vulkan>, context: &Context) -> Result<(), VrError> {
        if self.picture.is_none() {
            let size = POINTS.map(|p| (p * SHARPNESS) as u32);
            let images = Images::new(session, context, (size[0], size[1]), 1)?;
            let mut ui = UiPass::new(context, images.format());
            self.rehearse(context, &mut ui, images.format(), images.size());
            self.picture = Some((images, ui));
        }
        Ok(())
    }

    /// Draws the panel once where nobody sees it: its glyphs are made and uploaded, its buffers grown.
    fn rehearse(&mut self, context: &Context, ui: &mut UiPass, format: wgpu::TextureFormat, size: (u32, u32)) {
        let unseen = context.device().create_texture(&wgpu::TextureDescriptor {
            label: Some("rehearsal"),
            size: wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        let view = unseen.create_view(&wgpu::TextureViewDescriptor::default());
        let frame = self.panel.run_pointer((POINTS, SHARPNESS), None, None, &mut self.state);
        let drawn = UiFrame { jobs: frame.jobs, textures: frame.textures, pixels_per_point: SHARPNESS };
        let mut encoder = context.device().create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("rehearsal") });
        let buffers = ui.encode(context, &mut encoder, &view, size, drawn, true);
        context.queue().submit(buffers.into_iter().chain([encoder.finish()]));
        ui.take_cost();
    }

    /// What its pictures have cost since this was last asked, but for the rehearsal at a session's start.
    pub fn take_cost(&mut self) -> UiCost {
        self.picture.as_mut().map(|(_, ui)| ui.take_cost()).unwrap_or_default()
    }

    /// Forgets what belongs to a session that is over.
    pub fn end_session(&mut self) {
        self.picture = None;
        self.drawn = false;
        // The glyphs that were uploaded are gone, too, and a new panel uploads its own.
        self.panel = Panel::new();
    }

    /// Which hands point at it.
    pub fn pointed_at(&self, hands: &[Hand; 2]) -> [bool; 2] {
        let Some(place) = self.place else { return [false; 2] };
        [0, 1].map(|hand| hands[hand].aim.is_some_and(|aim| meet(&place, &aim).is_some()))
    }

    /// One frame of the open board: hands point and press, the picture is drawn. Returns what the user wants; nothing happens, and
    /// nothing is paid for, while it is closed.
    pub fn frame(
        &mut self,
        hands: &[Hand; 2],
        session: &xr::Session<xr::Vulkan>,
        context: &Context,
    ) -> Result<Vec<PanelAction>, VrError> {
        let Some(place) = self.place else { return Ok(Vec::new()) };
        let (at, press) = self.pointer.tell(pointed(&place, hands, self.pointer.pointed.map(|p| p.hand)));
        let frame = self.panel.run_pointer((POINTS, SHARPNESS), at, press, &mut self.state);
        self.prepare(session, context)?;
        let Some((images, ui)) = &mut self.picture else { return Ok(frame.actions) };
        let index = images.acquire()?;
        let view = images.texture(index).create_view(&wgpu::TextureViewDescriptor::default());
        let mut encoder = context.device().create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("board") });
        let drawn = UiFrame { jobs: frame.jobs, textures: frame.textures, pixels_per_point: SHARPNESS };
        let buffers = ui.encode(context, &mut encoder, &view, images.size(), drawn, true);
        context.queue().submit(buffers.into_iter().chain([encoder.finish()]));
        images.release()?;
        self.drawn = true;
        Ok(frame.actions)
    }

    /// What the compositor is to show: the picture and the quad it stands on.
    pub fn shown(&self) -> Option<(&Images, Pose, (f64, f64))> {
        let place = self.place.filter(|_| self.drawn)?;
        self.picture.as_ref().map(|(images, _)| (images, place, SIZE))
    }

    /// The ray of the hand that points, from the hand to the board, in the room.
    pub fn ray(&self, hands: &[Hand; 2]) -> Option<[DVec3; 2]> {
        let (place, pointed) = self.place.zip(self.pointer.pointed)?;
        let aim = hands[pointed.hand].aim?;
        Some([aim.position, point_of(&place, pointed.at)])
    }
}

/// Where a point of the board, in points from its upper left, is in the room.
pub fn point_of(place: &Pose, at: [f32; 2]) -> DVec3 {
    let x = (f64::from(at[0] / POINTS[0]) - 0.5) * SIZE.0;
    let y = (0.5 - f64::from(at[1] / POINTS[1])) * SIZE.1;
    place.at(DVec3::new(x, y, 0.0))
}

/// Where the board opens: before a head, turned to it, upright.
pub fn placed(head: &Pose) -> Pose {
    let upright = DQuat::from_rotation_y(head.yaw());
    let position = head.position + upright * PLACE;
    let to_head = head.position - position;
    Pose { position, rotation: DQuat::from_rotation_y(to_head.x.atan2(to_head.z)) }
}

/// The point of the board, in points from its upper left, that a ray from before it meets.
fn meet(place: &Pose, aim: &Pose) -> Option<[f32; 2]> {
    let back = place.rotation.inverse();
    let (from, along) = (back * (aim.position - place.position), back * aim.forward());
    if from.z <= 0.0 || along.z >= -1e-6 {
        return None;
    }
    let hit = from - along * (from.z / along.z);
    let (u, v) = (hit.x / SIZE.0 + 0.5, 0.5 - hit.y / SIZE.1);
    let inside = (0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&v);
    inside.then_some([u as f32 * POINTS[0], v as f32 * POINTS[1]])
}

/// The hand that points: the one that did before, as long as it does, else the right one, else the left.
fn pointed(place: &Pose, hands: &[Hand; 2], before: Option<usize>) -> Option<Pointed> {
    let one = |hand: usize| {
        let at = meet(place, hands[hand].aim.as_ref()?)?;
        Some(Pointed { hand, at, pressed: hands[hand].tear > PRESSED })
    };
    before.and_then(one).or_else(|| one(1)).or_else(|| one(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: Pose = Pose { position: DVec3::new(0.0, 1.6, 0.0), rotation: DQuat::IDENTITY };

    fn aiming_at(point: DVec3) -> Hand {
        let from = DVec3::new(0.1, 1.2, -0.1);
        let rotation = DQuat::from_rotation_arc(DVec3::NEG_Z, (point - from).normalize());
        Hand { aim: Some(Pose { position: from, rotation }), ..Hand::default() }
    }

    #[test]
    fn a_ray_finds_the_point_it_is_aimed_at_and_misses_beside_the_board() {
        let place = placed(&HEAD);
        for (x, y) in [(0.0, 0.0), (0.17, 0.29), (-0.17, -0.29)] {
            let aim = aiming_at(place.at(DVec3::new(x, y, 0.0))).aim.expect("given");
            let at = meet(&place, &aim).expect("a hit");
            let wanted = [(x / SIZE.0 + 0.5) as f32 * POINTS[0], (0.5 - y / SIZE.1) as f32 * POINTS[1]];
            assert!((at[0] - wanted[0]).abs() < 0.01 && (at[1] - wanted[1]).abs() < 0.01, "{at:?} {wanted:?}");
        }
        let beside = aiming_at(place.at(DVec3::new(0.3, 0.0, 0.0))).aim.expect("given");
        assert_eq!(meet(&place, &beside), None);
        let away = Pose { rotation: DQuat::from_rotation_y(3.0), ..HEAD };
        assert_eq!(meet(&place, &away), None, "a hand that points away");
    }

    #[test]
    fn it_faces_the_user_whichever_way_they_look() {
        for yaw in [0.0, 1.0, -2.5] {
            let head = Pose { rotation: DQuat::from_rotation_y(yaw), ..HEAD };
            let place = placed(&head);
            let front = place.rotation * DVec3::Z;
            let to_head = (head.position - place.position) * DVec3::new(1.0, 0.0, 1.0);
            assert!(front.dot(to_head.normalize()) > 0.999);
            assert!((place.position - head.position).dot(head.forward()) > 0.5);
        }
    }

    #[test]
    fn the_hand_that_points_keeps_pointing() {
        let place = placed(&HEAD);
        let both = [aiming_at(place.position), aiming_at(place.position)];
        assert_eq!(pointed(&place, &both, None).map(|p| p.hand), Some(1));
        assert_eq!(pointed(&place, &both, Some(0)).map(|p| p.hand), Some(0));
        assert_eq!(pointed(&place, &[Hand::default(); 2], Some(0)), None);
    }

    #[test]
    fn what_is_pressed_is_let_go_wherever_the_ray_goes() {
        let at = [100.0, 50.0];
        let ray = |pressed: bool| Some(Pointed { hand: 1, at, pressed });
        let tell = |pointer: &mut Pointer, rays: &[Option<Pointed>]| rays.iter().map(|&r| pointer.tell(r)).collect::<Vec<_>>();
        let mut pointer = Pointer::default();
        let told = tell(&mut pointer, &[ray(false), ray(true), ray(true), ray(false)]);
        assert_eq!(told, [(Some(at), None), (Some(at), Some(true)), (Some(at), None), (Some(at), Some(false))]);
        let told = tell(&mut pointer, &[ray(true), None, None, ray(false)]);
        assert_eq!(told, [(Some(at), Some(true)), (None, Some(false)), (None, None), (Some(at), None)], "beside the board");
        // a trigger pulled elsewhere presses nothing, and its end lets nothing go
        let told = tell(&mut pointer, &[None, ray(true), ray(true), ray(false), ray(true)]);
        assert_eq!(told.iter().map(|t| t.1).collect::<Vec<_>>(), [None, None, None, None, Some(true)]);
        // the runtime's menu comes in between, and the trigger that has pressed there is still held
        pointer.look_away();
        let told = tell(&mut pointer, &[ray(true), ray(true), ray(false)]);
        assert_eq!(told, [(None, Some(false)), (Some(at), None), (Some(at), None)]);
    }

    #[test]
    fn what_is_let_go_beside_the_board_presses_no_button_and_no_slider_sticks() {
        let mut panel = Panel::new();
        let mut state = PanelState { in_room: true, undo_depth: 1, ..PanelState::default() };
        let mut run = |at: Option<[f32; 2]>, press: Option<bool>| {
            let mut frame = panel.run_pointer((POINTS, SHARPNESS), at, press, &mut state);
            frame.textures.clear();
            (frame.actions.len(), panel.context().dragged_id().is_some())
        };
        let (mut pressed, mut held) = (0, 0);
        for y in (4..600).step_by(8) {
            let at = Some([60.0, y as f32]);
            run(at, None);
            held += usize::from(run(at, Some(true)).1);
            pressed += run(None, Some(false)).0;
            assert!(!run(at, None).1, "nothing follows a ray whose trigger is let go, {y}");
        }
        assert_eq!(pressed, 0, "no button was pressed");
        assert!(held > 5, "buttons and sliders were taken hold of: {held}");
    }

    #[test]
    fn a_closed_board_takes_no_ray() {
        let mut board = Board::new(PanelState::default());
        let hands = [aiming_at(placed(&HEAD).position); 2];
        assert_eq!(board.pointed_at(&hands), [false; 2]);
        board.toggle(&HEAD);
        assert!(board.is_open() && board.pointed_at(&hands) == [true; 2] && board.shown().is_none());
        board.toggle(&HEAD);
        assert!(!board.is_open() && board.pointed_at(&hands) == [false; 2]);
    }
}
