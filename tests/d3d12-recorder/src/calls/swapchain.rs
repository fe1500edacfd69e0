//! DXGI's swap chains: which queue each presents on, its buffers, and their state when it presents them.

use std::collections::BTreeSet;
use std::ffi::c_void;
use std::sync::OnceLock;

use windows::Win32::Graphics::Direct3D12::ID3D12Resource;
use windows::Win32::Graphics::Dxgi::*;
use windows::core::{HRESULT, IUnknown_Vtbl, Interface};

use super::hooks::{self, HookGuard, caller};
use super::{Calls, is_reporting, report};
use crate::timeline::Id;

/// A live swap chain.
pub(super) struct SwapChain {
    queue: Id,
    /// Addresses of the buffers that the program has asked for. Their reference counts may be 0 while the swap chain keeps them.
    buffers: BTreeSet<usize>,
}

/// Puts the hooks into the tables of factories, once.
///
/// # Safety
/// Null, or a live adapter.
pub(super) unsafe fn record_factories(adapter: *mut c_void) {
    static DONE: OnceLock<()> = OnceLock::new();
    DONE.get_or_init(|| {
        let _guard = HookGuard::enter();
        // SAFETY: the caller's promise; nothing is released.
        let adapter = unsafe { windows::core::IUnknown::from_raw_borrowed(&adapter) };
        let adapter = adapter.and_then(|adapter| adapter.cast::<IDXGIAdapter>().ok());
        // SAFETY: a live adapter.
        let of_adapter = adapter.and_then(|adapter| unsafe { adapter.GetParent::<IDXGIFactory>() }.ok());
        // SAFETY: no arguments.
        let Some(factory) = of_adapter.or_else(|| unsafe { CreateDXGIFactory1::<IDXGIFactory>() }.ok()) else { return };
        // SAFETY: the tables of live objects, which are those of all factories.
        unsafe {
            factories::install(Interface::vtable(&factory));
            if let Ok(second) = factory.cast::<IDXGIFactory2>() {
                newer_factories::install(Interface::vtable(&second));
            }
        }
    });
}

impl Calls {
    /// Whether a swap chain has a buffer at an address.
    pub(super) fn is_buffer(&self, object: usize) -> bool {
        self.chains.values().any(|chain| chain.buffers.contains(&object))
    }

    /// A new swap chain on a queue; on Direct3D 11 it is on a device, and not recorded.
    ///
    /// # Safety
    /// A live swap chain.
    unsafe fn add_chain(&mut self, chain: *mut c_void, queue: *mut c_void) {
        let Some(queue) = self.id(queue) else { return };
        self.chains.insert(chain as usize, SwapChain { queue, buffers: BTreeSet::new() });
        // SAFETY: the caller's promise; the tables are those of all swap chains on Direct3D 12.
        unsafe {
            let borrowed = IDXGISwapChain::from_raw_borrowed(&chain).expect("a swap chain");
            chains::install(Interface::vtable(borrowed));
            if let Ok(newer) = borrowed.cast::<IDXGISwapChain1>() {
                newer_chains::install(Interface::vtable(&newer));
            }
            if let Ok(newest) = borrowed.cast::<IDXGISwapChain3>() {
                newest_chains::install(Interface::vtable(&newest));
            }
            release::install(chain);
        }
    }

    /// A swap chain's buffer.
    fn add_buffer(&mut self, chain: *mut c_void, buffer: *mut c_void) -> Option<Id> {
        self.chains.get_mut(&(chain as usize))?.buffers.insert(buffer as usize);
        self.resource(buffer)
    }

    /// The buffers of a swap chain end: other objects may get their addresses.
    fn end_buffers(&mut self, chain: *mut c_void) {
        let chain = self.chains.get_mut(&(chain as usize));
        for buffer in chain.map(|chain| std::mem::take(&mut chain.buffers)).unwrap_or_default() {
            self.ids.remove(&buffer);
        }
    }
}

/// A swap chain presents its current buffer.
///
/// # Safety
/// A live swap chain, in a hook of it.
unsafe fn present(caller: usize, chain: *mut c_void, flags: DXGI_PRESENT) {
    if flags.contains(DXGI_PRESENT_TEST) {
        return;
    }
    // SAFETY: the caller's promise; nothing is released. These calls come from inside of a hook, so that they are not recorded.
    let buffer = unsafe {
        let borrowed = IDXGISwapChain::from_raw_borrowed(&chain).expect("a swap chain");
        let Ok(newest) = borrowed.cast::<IDXGISwapChain3>() else { return };
        let Ok(buffer) = borrowed.GetBuffer::<ID3D12Resource>(newest.GetCurrentBackBufferIndex()) else { return };
        buffer
    };
    report(caller, |calls| {
        if let Some(id) = calls.add_buffer(chain, buffer.as_raw())
            && let Some(queue) = calls.chains.get(&(chain as usize)).map(|chain| chain.queue)
        {
            calls.recorder.present(queue, id);
        }
    });
}

/// Reports a new swap chain.
///
/// # Safety
/// The result and the variable of a call that made it.
unsafe fn made(result: HRESULT, chain: *mut *mut c_void, queue: *mut c_void) {
    if result.is_ok() && !chain.is_null() {
        // SAFETY: the caller's promise.
        report(caller(), |calls| unsafe { calls.add_chain(*chain, queue) });
    }
}

mod factories {
    use super::*;

    hooks::hooks! { IDXGIFactory_Vtbl;
        fn CreateSwapChain[original](
            this, queue: *mut c_void, desc: *const DXGI_SWAP_CHAIN_DESC, chain: *mut *mut c_void,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result = original(this, queue, desc, chain);
                made(result, chain, queue);
                result
            }
        }
    }
}

mod newer_factories {
    use windows::Win32::Foundation::HWND;

    use super::*;

    hooks::hooks! { IDXGIFactory2_Vtbl;
        fn CreateSwapChainForHwnd[original](
            this, queue: *mut c_void, window: HWND, desc: *const DXGI_SWAP_CHAIN_DESC1,
            full_screen: *const DXGI_SWAP_CHAIN_FULLSCREEN_DESC, output: *mut c_void, chain: *mut *mut c_void,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result = original(this, queue, window, desc, full_screen, output, chain);
                made(result, chain, queue);
                result
            }
        }
        fn CreateSwapChainForCoreWindow[original](
            this, queue: *mut c_void, window: *mut c_void, desc: *const DXGI_SWAP_CHAIN_DESC1, output: *mut c_void,
            chain: *mut *mut c_void,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result = original(this, queue, window, desc, output, chain);
                made(result, chain, queue);
                result
            }
        }
        fn CreateSwapChainForComposition[original](
            this, queue: *mut c_void, desc: *const DXGI_SWAP_CHAIN_DESC1, output: *mut c_void, chain: *mut *mut c_void,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result = original(this, queue, desc, output, chain);
                made(result, chain, queue);
                result
            }
        }
    }
}

mod chains {
    use windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT;
    use windows::core::GUID;

    use super::*;

    hooks::hooks! { IDXGISwapChain_Vtbl;
        fn Present[original](this, interval: u32, flags: DXGI_PRESENT) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                present(caller(), this, flags);
                original(this, interval, flags)
            }
        }
        fn GetBuffer[original](this, number: u32, id: *const GUID, buffer: *mut *mut c_void) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                let result = original(this, number, id, buffer);
                if result.is_ok() && !buffer.is_null() {
                    report(caller(), |calls| _ = calls.add_buffer(this, *buffer));
                }
                result
            }
        }
        fn ResizeBuffers[original](this, count: u32, width: u32, height: u32, format: DXGI_FORMAT, flags: u32) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            let result = unsafe { original(this, count, width, height, format, flags) };
            if result.is_ok() {
                report(caller(), |calls| calls.end_buffers(this));
            }
            result
        }
    }
}

mod newer_chains {
    use super::*;

    hooks::hooks! { IDXGISwapChain1_Vtbl;
        fn Present1[original](
            this, interval: u32, flags: DXGI_PRESENT, parameters: *const DXGI_PRESENT_PARAMETERS,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            unsafe {
                present(caller(), this, flags);
                original(this, interval, flags, parameters)
            }
        }
    }
}

mod newest_chains {
    use windows::Win32::Graphics::Dxgi::Common::DXGI_FORMAT;

    use super::*;

    hooks::hooks! { IDXGISwapChain3_Vtbl;
        fn ResizeBuffers1[original](
            this, count: u32, width: u32, height: u32, format: DXGI_FORMAT, flags: u32, nodes: *const u32,
            queues: *const *mut c_void,
        ) -> HRESULT {
            // SAFETY: the caller's own arguments, passed on.
            let result = unsafe { original(this, count, width, height, format, flags, nodes, queues) };
            if result.is_ok() {
                report(caller(), |calls| calls.end_buffers(this));
            }
            result
        }
    }
}

/// The last release of a swap chain.
mod release {
    use super::*;

    static ORIGINAL: OnceLock<unsafe extern "system" fn(*mut c_void) -> u32> = OnceLock::new();

    unsafe extern "system" fn hook(this: *mut c_void) -> u32 {
        let original = ORIGINAL.get().expect("the original function");
        // SAFETY: the caller's own argument, passed on.
        let count = unsafe { original(this) };
        if count == 0 && !is_reporting() {
            report(caller(), |calls| {
                calls.end_buffers(this);
                calls.chains.remove(&(this as usize));
            });
        }
        count
    }

    /// Puts the hook into the table of a live swap chain, once.
    ///
    /// # Safety
    /// The swap chain is live.
    pub(super) unsafe fn install(chain: *mut c_void) {
        // SAFETY: an object starts with the address of its table, and that with the functions of `IUnknown`.
        unsafe { hooks::replace(&raw const (**chain.cast::<*const IUnknown_Vtbl>()).Release, &ORIGINAL, hook) };
    }
}
