//! Incise tears and cuts soft, rigged, animated models in real time.
//!
//! The modules, top to bottom; arrows point down only (`tests/architecture.rs` checks it):
//!
//! | module | what it holds |
//! |---|---|
//! | [`cli`] | one file a sub-command |
//! | [`app`] | owns the scene and the tools; one frame reads as a stage list |
//! | [`host`] | headless, desktop and VR: each owns its loop |
//! | [`panel`] | the control panel: a function of plain state, drawn by a host |
//! | [`gpu`] | reads a scene, deforms and draws it, never changes it |
//! | [`input`] | plain input frames, tools, scripts |
//! | [`scene`] | tissues by id, edits, severed pieces, history |
//! | [`tissue`] | mesh, rig, particles and dynamics: one soft body |
//! | [`formats`] | glTF, OBJ, STL, procedural models |
//! | [`physics`] | the linear particle network and its exact propagation |
//! | [`particles`] | Poisson-disk sampling, the particle map, strips, the update after a wound |
//! | [`surgery`] | blade paths, boxes, the tear, the plane cut |
//! | [`rig`] | skeleton, animation, vertex rows, skinning |
//! | [`geometry`] | indices, tracked arrays, the triangle mesh, exact predicates |
//! | [`diagnostics`] | counters and timings; anyone may use it |

pub mod app;
pub mod cli;
pub mod config;
pub mod diagnostics;
pub mod formats;
pub mod geometry;
#[cfg(feature = "gpu")]
pub mod gpu;
#[cfg(feature = "gpu")]
pub mod host;
pub mod input;
#[cfg(any(feature = "desktop", feature = "vr"))]
pub mod panel;
pub mod particles;
pub mod physics;
pub mod rig;
pub mod scene;
pub mod surgery;
pub mod tissue;

/// The examples of the README, as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
