//! Opening an adapter, and what happens when a device fails.
#![cfg(feature = "gpu")]

use incise::gpu::context::{open_device, required_limits};
use incise::gpu::{AdapterChoice, AdapterKind, Context, ContextOptions, GpuError};

#[test]
fn the_best_adapter_is_found_and_named() -> Result<(), GpuError> {
    let context = Context::headless(ContextOptions::default())?;
    assert!(!context.adapter_name().is_empty() && [1, 4].contains(&context.samples()));
    assert!(context.device().limits().max_storage_buffers_per_shader_stage >= 8);
    context.wait()
}

#[test]
fn choices_are_kept() {
    for (adapter, software) in [(AdapterChoice::Software, true), (AdapterChoice::Hardware, false)] {
        match Context::headless(ContextOptions { adapter, ..Default::default() }) {
            Ok(context) => assert_eq!(context.adapter_kind() == AdapterKind::Software, software),
            Err(error) => assert!(error.to_string().contains("mesa-vulkan-drivers"), "{error}"),
        }
    }
}

#[test]
fn parts_made_elsewhere_serve_as_well() -> Result<(), GpuError> {
    let made = Context::headless(ContextOptions::default())?;
    let (device, queue) = open_device(made.adapter())?;
    let context = Context::from_parts(made.instance().clone(), made.adapter().clone(), device, queue);
    assert_eq!(context.adapter_name(), made.adapter_name());
    context.wait()
}

#[test]
fn a_refused_call_is_an_error_and_no_panic() -> Result<(), GpuError> {
    let context = Context::headless(ContextOptions::default())?;
    assert!(context.check().is_ok());
    let size = context.device().limits().max_buffer_size.saturating_add(4);
    let usage = wgpu::BufferUsages::STORAGE;
    let _refused =
        context.device().create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    assert!(matches!(context.check(), Err(GpuError::Lost(_))));
    assert!(matches!(context.wait(), Err(GpuError::Lost(_))));
    assert!(required_limits().max_buffer_size < size);
    Ok(())
}

#[test]
fn a_device_that_is_gone_is_an_error_and_can_be_opened_again() -> Result<(), GpuError> {
    let context = Context::headless(ContextOptions::default())?;
    context.device().destroy();
    assert!(matches!(context.wait(), Err(GpuError::Lost(_))));
    let again = context.reopen()?;
    assert_eq!((again.adapter_name(), again.samples()), (context.adapter_name(), context.samples()));
    again.wait()
}

#[test]
fn optional_features_can_be_left_out() -> Result<(), GpuError> {
    let plain = Context::headless(ContextOptions { plain: true, ..Default::default() })?;
    assert!(plain.device().features().is_empty() && !plain.draws_views_at_once(2, 1));
    assert!(plain.device().limits().max_storage_buffers_per_shader_stage == 4 && !plain.deforms());
    let again = plain.reopen()?;
    assert!(again.device().features().is_empty() && !again.deforms());
    assert!(Context::headless(ContextOptions::default())?.deforms());
    let mut renderer = incise::gpu::Renderer::new(std::sync::Arc::new(plain));
    assert!(!renderer.set_timing(true) && renderer.gpu_times().is_none());
    Ok(())
}
