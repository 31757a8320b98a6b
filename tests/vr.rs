//! The real program on a real OpenXR runtime: Monado without a headset, its controllers led over a socket. `scripts/test-vr`
//! sets the runtime up and runs these; elsewhere they are ignored.

#![cfg(feature = "vr")]

#[path = "vr/bare_hand.rs"]
mod bare_hand;
#[path = "vr/buttons.rs"]
mod buttons;
#[path = "vr/driver.rs"]
mod driver;
#[path = "vr/failures.rs"]
mod failures;
#[path = "vr/focus.rs"]
mod focus;
#[path = "vr/multiview.rs"]
mod multiview;
#[path = "vr/panel.rs"]
mod panel;
#[path = "vr/remote.rs"]
mod remote;
#[path = "vr/service.rs"]
mod service;
#[path = "vr/steady.rs"]
mod steady;
#[path = "vr/surgery.rs"]
mod surgery;
#[path = "vr/validation.rs"]
mod validation;
