//! The query calls, answered as AMD's libraries do.

use std::ffi::{c_char, c_void};

use crate::config::{SWAPCHAIN_EFFECT, Sdk};
use crate::field_access::{get, links, put};
use crate::generation::CreationParams;
use crate::library::{ContextKind, EFFECT, Library, id, is_device};
use crate::upscale::{self, UpscalerState};
use crate::{ERROR, NO_PROVIDER, OK, PARAMETER, UNKNOWN_STRUCT};

impl Library {
    pub(crate) unsafe fn query(&mut self, context: *mut *mut c_void, head: *mut u8) -> u32 {
        // SAFETY: the caller's chain.
        let chain = match unsafe { links(head) } {
            Ok(chain) if !chain.is_empty() => chain,
            Ok(_) => return self.report_violation("query", "a pointer is null", PARAMETER),
            Err(why) => return self.report_violation("query", why, PARAMETER),
        };
        if let Some(code) = self.refusal("query", &chain) {
            return code;
        }
        // SAFETY: the caller's memory.
        let known = (!context.is_null()).then(|| unsafe { *context } as usize);
        if self.config.is_loader {
            let effect = match known {
                Some(known) => self.owners.get(&known).copied(),
                // SAFETY: the id of the creation struct is at 16.
                None if chain[0].0 == id::GET_VERSIONS => Some(unsafe { get::<u64>(head, 16) } & EFFECT),
                None => Some(chain[0].0 & EFFECT),
            };
            let effect_library = effect.and_then(|effect| self.effect_library(effect));
            // SAFETY: forwarded unchanged.
            let code =
                effect_library.map_or(NO_PROVIDER, |effect_library| unsafe { effect_library.query(context, head) });
            return self.log_call("query", &chain, code);
        }
        let code = match (chain[0].0, known) {
            // SAFETY: a struct of the type that its id says.
            (id::GET_VERSIONS, None) => unsafe { self.versions(head) },
            (id::PROVIDER_VERSION, Some(known)) if self.config.sdk > Sdk::V110 => match self.contexts.get(&known) {
                Some((id, name)) => {
                    // SAFETY: the id is at 16, the name at 24, and both may be written.
                    unsafe {
                        put(head, 16, *id);
                        put(head, 24, name.as_ptr());
                    }
                    OK
                }
                None => self.report_violation("query", "there is no such context", PARAMETER),
            },
            (id::MEMORY | id::UPSCALE_MEMORY, Some(known)) if self.config.sdk >= Sdk::V114 => {
                let bytes = match (chain[0].0, self.effect_contexts.get(&known).map(|effect| &effect.kind)) {
                    (id::MEMORY, Some(ContextKind::Generator(frames))) => frames.memory(),
                    (id::UPSCALE_MEMORY, Some(ContextKind::Upscaler(of))) => UpscalerState::memory(of.render, of.shown),
                    _ => return UNKNOWN_STRUCT,
                };
                // SAFETY: a struct of the type that its id says.
                unsafe { self.memory(head, 16, bytes) }
            }
            (id::UPSCALE_MEMORY_V2, None) if self.config.sdk >= Sdk::V20 => {
                // SAFETY: fields of the struct.
                let (device, sides) =
                    unsafe { (get::<*mut c_void>(head, 16), [24, 28, 32, 36].map(|at| get::<u32>(head, at))) };
                // SAFETY: the caller's device.
                if !unsafe { is_device(device) } || sides.contains(&0) {
                    return self.report_violation("query", &format!("memory of {sides:?}"), PARAMETER);
                }
                let [a, b, c, d] = sides;
                // SAFETY: a struct of the type that its id says.
                unsafe { self.memory(head, 48, UpscalerState::memory([a, b], [c, d])) }
            }
            (id::RENDER_SIZE, _) => {
                // SAFETY: fields of the struct.
                let (shown, mode) = unsafe { ([16, 20].map(|at| get::<u32>(head, at)), get::<u32>(head, 24)) };
                // SAFETY: the struct has two pointers for the answers there.
                let pointers = unsafe { [32, 40].map(|at| get::<*mut u8>(head, at)) };
                let Some(size) = upscale::render_size(shown, mode) else {
                    return self.report_violation("query", &format!("quality mode {mode}"), PARAMETER);
                };
                // SAFETY: the caller's memory for the answers.
                unsafe { self.answer(&pointers, &size) }
            }
            (id::JITTER_PHASES, _) => {
                // SAFETY: fields of the struct.
                let [render, shown] = unsafe { [16, 20].map(|at| get::<u32>(head, at)) };
                let count = (8.0 * (shown as f32 / render as f32).powi(2)) as i32;
                // SAFETY: the struct has a pointer for the answer there.
                unsafe { self.answer(&[get::<*mut u8>(head, 24)], &[count]) }
            }
            (id::JITTER, _) => {
                // SAFETY: fields of the struct.
                let (index, count) = unsafe { (get::<i32>(head, 16), get::<i32>(head, 20)) };
                let Some(jitter) = upscale::jitter(index, count) else {
                    return self.report_violation("query", &format!("jitter {index} of {count}"), PARAMETER);
                };
                // SAFETY: the struct has two pointers for the answers there.
                unsafe { self.answer(&[24, 32].map(|at| get::<*mut u8>(head, at)), &jitter) }
            }
            (id::RESOURCES, Some(_)) if self.config.sdk >= Sdk::V20 => {
                // AMD's FSR 3 says nothing: all bits of both.
                let [required, optional] =
                    self.config.required_inputs.map_or([u64::MAX; 2], |kinds| [kinds, 63 & !kinds]);
                // SAFETY: the answers are fields of the struct.
                unsafe {
                    put(head, 16, required);
                    put(head, 24, optional);
                }
                OK
            }
            (id::SWAPCHAIN_MEMORY, Some(known)) if self.config.sdk >= Sdk::V114 => {
                let Some(presenting) = self.swapchains.get(&known) else { return UNKNOWN_STRUCT };
                let ([width, height], _) = presenting.swapchain.shown();
                // SAFETY: a struct of the type that its id says.
                unsafe { self.memory(head, 16, 16 * u64::from(width) * u64::from(height)) }
            }
            (id::SWAPCHAIN_MEMORY_V2, None) if self.config.sdk >= Sdk::V20 => {
                // SAFETY: fields of the struct.
                let (device, words) = unsafe {
                    (get::<*mut c_void>(head, 16), [24, 28, 32, 36, 40, 44, 48, 52].map(|at| get::<u32>(head, at)))
                };
                let [width, height, format, buffers, of_width, of_height, of_format, flags] = words;
                let interface = of_format != 0;
                // SAFETY: the caller's device.
                let is_right = unsafe { is_device(device) }
                    && ![width, height, format].contains(&0)
                    && (1..=self.config.sdk.most_buffers()).contains(&buffers)
                    && (of_width != 0, of_height != 0) == (interface, interface)
                    && flags < 4;
                if !is_right {
                    return self.report_violation("query", &format!("memory of a swap chain of {words:?}"), PARAMETER);
                }
                let pictures = u64::from(buffers + 1 + u32::from(interface && flags & 2 != 0));
                // SAFETY: a struct of the type that its id says.
                unsafe { self.memory(head, 56, 4 * pictures * u64::from(width) * u64::from(height)) }
            }
            (id::MEMORY_V2, None) if self.config.sdk >= Sdk::V20 => {
                // SAFETY: fields of the struct.
                let (device, sides) =
                    unsafe { (get::<*mut c_void>(head, 16), [24, 28, 32, 36].map(|at| get::<u32>(head, at))) };
                // SAFETY: as above.
                let (flags, formats) = unsafe { (get::<u32>(head, 44), [48, 52].map(|at| get::<u32>(head, at))) };
                // SAFETY: the caller's device.
                if !unsafe { is_device(device) } || sides.contains(&0) || flags != 8 || formats[0] == 0 {
                    return self.report_violation(
                        "query",
                        &format!("memory of {sides:?}, {flags}, {formats:?}"),
                        PARAMETER,
                    );
                }
                let made = CreationParams {
                    flags: 0,
                    render: [sides[0], sides[1]],
                    shown: [sides[2], sides[3]],
                    format: formats[0],
                    hudless: formats[1],
                };
                // SAFETY: a struct of the type that its id says.
                unsafe { self.memory(head, 56, made.memory()) }
            }
            (query, known) => self.unknown_query(query, known),
        };
        self.log_call("query", &chain, code)
    }

    /// The code for a query that the release does not know, as AMD's published providers return it.
    fn unknown_query(&self, query: u64, context: Option<usize>) -> u32 {
        let effect = match context {
            Some(known) if self.swapchains.contains_key(&known) => SWAPCHAIN_EFFECT,
            Some(known) => match self.effect_contexts.get(&known).map(|effect| &effect.kind) {
                Some(ContextKind::Generator(_)) => id::GENERATION & EFFECT,
                _ => id::UPSCALE & EFFECT,
            },
            None => query & EFFECT,
        };
        match (effect, self.config.sdk) {
            (SWAPCHAIN_EFFECT, Sdk::V110 | Sdk::V114) => PARAMETER,
            (0x2_0000, Sdk::V110) => ERROR,
            (0x2_0000, Sdk::V114) if context.is_none() => PARAMETER,
            _ => UNKNOWN_STRUCT,
        }
    }

    /// Writes answers through the struct's pointers.
    unsafe fn answer<T: Copy>(&self, pointers: &[*mut u8], values: &[T]) -> u32 {
        if pointers.iter().any(|pointer| pointer.is_null()) {
            return self.report_violation("query", "there is no room for the answer", PARAMETER);
        }
        for (pointer, value) in pointers.iter().zip(values) {
            // SAFETY: the caller's memory.
            unsafe { put(*pointer, 0, *value) };
        }
        OK
    }

    /// Writes the memory usage through the struct's pointer.
    unsafe fn memory(&self, head: *const u8, at: usize, bytes: u64) -> u32 {
        // SAFETY: the struct has a pointer for the answer there.
        let pointer = unsafe { get::<*mut u8>(head, at) };
        if pointer.is_null() {
            return self.report_violation("query", "there is no room for the answer", PARAMETER);
        }
        // SAFETY: the caller's memory for two numbers.
        unsafe {
            put(pointer, 0, bytes);
            put(pointer, 8, bytes / 2);
        }
        OK
    }

    unsafe fn versions(&mut self, head: *mut u8) -> u32 {
        // SAFETY: fields of the struct.
        let (create, device, count) =
            unsafe { (get::<u64>(head, 16), get::<*mut c_void>(head, 24), get::<*mut u64>(head, 32)) };
        // SAFETY: as above.
        let (ids, names) = unsafe { (get::<*mut u64>(head, 40), get::<*mut *const c_char>(head, 48)) };
        if ![id::GENERATION, id::UPSCALE, 0x3_0001, 0x3_0005, 0x3_0006].contains(&create) {
            return self.report_violation("query", &format!("{create:x} makes no context"), PARAMETER);
        }
        // SAFETY: the caller's device.
        if !unsafe { is_device(device) } {
            return self.report_violation("query", "the device is none", PARAMETER);
        }
        if count.is_null() || ids.is_null() || names.is_null() {
            return self.report_violation("query", "there is no room for the answer", PARAMETER);
        }
        // SAFETY: the caller's memory.
        let room = usize::try_from(unsafe { *count }).unwrap_or(0);
        if room == 0 {
            // AMD's libraries return 0 here in any case.
            return self.report_violation("query", "the number alone is asked for, which no release tells", OK);
        }
        let fits = self.config.has(create & EFFECT);
        let offers = self.config.offered(create).iter().filter(|_| fits).take(room);
        let mut written = 0;
        for (id, name) in offers {
            // SAFETY: the lists have this capacity.
            unsafe {
                *ids.add(written) = *id;
                *names.add(written) = name.as_ptr();
            }
            self.offered.push(*id);
            written += 1;
        }
        // SAFETY: the caller's memory.
        unsafe { *count = written as u64 };
        OK
    }
}
