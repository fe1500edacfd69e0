//! A host that presents a swap chain's buffers: in the state for that, and in others.

use cairn::gpu::windows::Win32::Graphics::Direct3D12::*;
use cairn::gpu::windows::Win32::Graphics::Dxgi::*;
use test_support::d3d12::engine::Engine;
use test_support::d3d12::recorder::findings_of;
use test_support::d3d12::textures::{Recording, wait};
use test_support::ffx::window::{PRESENT, Window, of_engine};

const TARGET: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_RENDER_TARGET;

/// Clears and presents each buffer; the state that it is presented in.
fn broken(presented_in: D3D12_RESOURCE_STATES) -> Vec<String> {
    let engine = Engine::create();
    let window = Window::open();
    let findings = findings_of(|| {
        let chain = of_engine(&engine, &window);
        let desc = D3D12_DESCRIPTOR_HEAP_DESC {
            Type: D3D12_DESCRIPTOR_HEAP_TYPE_RTV,
            NumDescriptors: 1,
            ..Default::default()
        };
        // SAFETY: a description that lives during the call.
        let views: ID3D12DescriptorHeap = unsafe { engine.device.CreateDescriptorHeap(&desc) }.expect("a heap");
        let mut states = [PRESENT; 3];
        // Each buffer twice, so that its state is followed from one present to the next.
        for _ in 0..6 {
            // SAFETY: a live swap chain.
            let number = unsafe { chain.GetCurrentBackBufferIndex() };
            // SAFETY: a live swap chain with this buffer.
            let buffer: ID3D12Resource = unsafe { chain.GetBuffer(number) }.expect("a buffer");
            // SAFETY: a live buffer, and a descriptor of a live heap.
            let view = unsafe {
                let view = views.GetCPUDescriptorHandleForHeapStart();
                engine.device.CreateRenderTargetView(&buffer, None, view);
                view
            };
            let recording = Recording::on(&engine.device, &engine.direct);
            recording.barrier(&buffer, states[number as usize], TARGET);
            // SAFETY: an open list, and a view of a live buffer.
            unsafe { recording.list().ClearRenderTargetView(view, &[0.5; 4], None) };
            recording.barrier(&buffer, TARGET, presented_in);
            states[number as usize] = presented_in;
            recording.submit(&engine.direct);
            // The buffer's last reference goes before it is presented, as in many engines.
            drop(buffer);
            // SAFETY: a live swap chain.
            unsafe { chain.Present(0, DXGI_PRESENT(0)) }.ok().expect("a present");
            wait(&engine.device, &engine.direct);
        }
    });
    findings.into_iter().map(|finding| format!("{}: {}", finding.id, finding.text)).collect()
}

#[test]
fn buffers_are_presented_in_the_state_for_that() {
    assert_eq!(broken(PRESENT), [""; 0]);
}

#[test]
fn buffers_that_are_presented_as_render_targets_are_found() {
    let found = broken(TARGET);
    assert_eq!(found.len(), 6, "{found:#?}");
    let is_right = |text: &String| {
        text.starts_with("D3D12_MESSAGE_ID_INVALID_SUBRESOURCE_STATE") && text.ends_with("presented in RENDER_TARGET")
    };
    assert!(found.iter().all(is_right), "{found:#?}");
}
