//! The configure calls of a swap chain.

use crate::config::Sdk;
use crate::field_access::get;
use crate::generation;
use crate::library::id;
use crate::swapchain::{self, SwapchainContext};

/// Checks a configure call of a swap chain, and applies it.
///
/// # Safety
/// A chain of structs whose types match their ids.
pub(crate) unsafe fn configure(
    presenting: &SwapchainContext,
    chain: &[(u64, *const u8)],
    sdk: Sdk,
) -> Result<(), String> {
    let (first, head) = chain[0];
    if chain.len() > 1 {
        return Err("the struct is not alone".to_owned());
    }
    if first == id::INTERFACE {
        // SAFETY: fields of the struct, here and below.
        let (interface, flags) = unsafe { (swapchain::interface(head), get::<u32>(head, 64)) };
        let mut fault = None;
        if interface.is_some() {
            let (size, _) = presenting.swapchain.shown();
            // SAFETY: the struct has a resource there.
            unsafe { generation::check_resource(head, 16, size, None, false, &mut |why| fault = Some(why)) };
        }
        if flags > 3 || (interface.is_none() && flags != 0) {
            fault = Some(format!("flags {flags}"));
        }
        return fault.map_or_else(
            || {
                presenting.swapchain.set_interface(interface);
                Ok(())
            },
            |why| Err(format!("interface: {why}")),
        );
    }
    // SAFETY: as above.
    let (key, tuning) = unsafe { (get::<u64>(head, 16), get::<*const u8>(head, 32)) };
    if key != 2 || tuning.is_null() || sdk == Sdk::V110 {
        return Err(format!("key {key} is not known, or has no value"));
    }
    // SAFETY: a pointer to a pacing struct.
    let (margin, factor, spins, waits) =
        unsafe { (get::<f32>(tuning, 0), get::<f32>(tuning, 4), get::<u8>(tuning, 8), get::<u8>(tuning, 16)) };
    let is_right = margin.is_finite() && margin >= 0.0 && (0.0..=1.0).contains(&factor) && spins < 2 && waits < 2;
    if is_right { Ok(()) } else { Err(format!("pacing {margin}, {factor}, {spins}, {waits}")) }
}
