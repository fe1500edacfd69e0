//! The library's state and its five functions: they return what AMD's libraries return, and check every call.

use std::collections::HashMap;
use std::ffi::{CString, c_void};
use std::io::Write;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use windows::Win32::Graphics::Direct3D12::ID3D12Device;
use windows::core::{IUnknown, Interface};

use crate::config::{Config, Sdk};
use crate::effect_library::EffectLibrary;
use crate::field_access::{get, links};
use crate::generation::{CONFIGURE, CreationParams, GeneratorState, PICTURE, PREPARE, PREPARE_V2, Request};
use crate::parameter_log;
use crate::prepared_inputs::PreparedInputs;
use crate::shader_work::{CONSTANTS, RESET, ShaderWork};
use crate::swapchain::{self, SwapchainContext};
use crate::swapchain_config;
use crate::upscale::{MASK, UPSCALE, UpscalerState};
use crate::{NO_PROVIDER, OK, PARAMETER, RUNTIME, THREW, UNKNOWN_STRUCT};

/// Struct ids, with the effect in the upper bits.
pub(crate) mod id {
    pub(crate) const GLOBAL_DEBUG_1: u64 = 1;
    pub(crate) const BACKEND: u64 = 2;
    pub(crate) const GET_VERSIONS: u64 = 4;
    pub(crate) const OVERRIDE: u64 = 5;
    pub(crate) const PROVIDER_VERSION: u64 = 6;
    pub(crate) const GLOBAL_DEBUG: u64 = 7;
    pub(crate) const UPSCALE: u64 = 0x1_0000;
    pub(crate) const RENDER_SIZE: u64 = 0x1_0003;
    pub(crate) const JITTER_PHASES: u64 = 0x1_0004;
    pub(crate) const JITTER: u64 = 0x1_0005;
    pub(crate) const UPSCALE_MEMORY: u64 = 0x1_0008;
    pub(crate) const UPSCALE_MEMORY_V2: u64 = 0x1_0009;
    pub(crate) const RESOURCES: u64 = 0x1_000a;
    pub(crate) const UPSCALE_VERSION: u64 = 0x1_000b;
    pub(crate) const GENERATION: u64 = 0x2_0001;
    pub(crate) const MEMORY: u64 = 0x2_0007;
    pub(crate) const HUDLESS: u64 = 0x2_0009;
    pub(crate) const MEMORY_V2: u64 = 0x2_000b;
    pub(crate) const GENERATION_VERSION: u64 = 0x2_000e;
    pub(crate) const SWAPCHAINS: [u64; 3] = [0x3_0001, 0x3_0005, 0x3_0006];
    pub(crate) const INTERFACE: u64 = 0x3_0002;
    pub(crate) const WAIT: u64 = 0x3_0007;
    pub(crate) const SWAPCHAIN_KEY: u64 = 0x3_0008;
    pub(crate) const SWAPCHAIN_MEMORY: u64 = 0x3_0009;
    pub(crate) const SWAPCHAIN_MEMORY_V2: u64 = 0x3_000a;
    pub(crate) const SWAPCHAIN_VERSION: u64 = 0x3_000b;
}

pub(crate) const EFFECT: u64 = 0x00ff_0000;

/// The message callback: the kind, and text in UTF-16.
type Message = unsafe extern "C" fn(u32, *const u16);

/// The double's state between calls.
#[derive(Default)]
pub(crate) struct Library {
    pub(crate) config: Config,
    /// Live contexts by address, with the provider of each.
    pub(crate) contexts: HashMap<usize, (u64, CString)>,
    /// The creation chain of each context, which must live as long: the address of each link and its header.
    chains: HashMap<usize, Vec<(usize, [u64; 2])>>,
    /// The generators and upscalers among the contexts.
    pub(crate) effect_contexts: HashMap<usize, EffectContext>,
    /// The swap chains among the contexts.
    pub(crate) swapchains: HashMap<usize, SwapchainContext>,
    /// Number of pictures requested.
    pictures: u64,
    /// Provider ids returned by queries.
    pub(crate) offered: Vec<u64>,
    message: Option<Message>,
    /// For a loader: the libraries of the effects, by effect id.
    effect_libraries: HashMap<u64, EffectLibrary>,
    /// For a loader: the effect of each context.
    pub(crate) owners: HashMap<usize, u64>,
}

/// A generator's or upscaler's context.
pub(crate) struct EffectContext {
    pub(crate) kind: ContextKind,
    device: ID3D12Device,
    /// Created at the first picture: drivers take long to compile shaders.
    work: Option<ShaderWork>,
    /// The same for reactive masks.
    mask: Option<ShaderWork>,
    /// A generator's motion and depth.
    inputs: PreparedInputs,
}

/// The kind of a context, with its state.
pub(crate) enum ContextKind {
    Generator(GeneratorState),
    Upscaler(UpscalerState),
}

static LIBRARY: OnceLock<Result<Mutex<Library>, String>> = OnceLock::new();

impl Library {
    /// Handles a call of one of the five functions, unless it fails on purpose. It throws with the library unlocked.
    pub(crate) fn called(call: &'static str, act: impl FnOnce(&mut Self) -> u32) -> u32 {
        let code = match crate::faults::injected(call) {
            Some(code) => Self::handle(call, |library| library.log_call(call, &[], code)),
            None => Self::handle(call, act),
        };
        if code == THREW {
            crate::faults::throw();
        }
        code
    }

    /// Handles one call. ffx-api forbids concurrent calls of one context and has no lock; here they take turns and are checked.
    pub(crate) fn handle(call: &'static str, act: impl FnOnce(&mut Self) -> u32) -> u32 {
        let library =
            LIBRARY.get_or_init(|| Config::own().map(|config| Mutex::new(Self { config, ..Self::default() })));
        let Ok(library) = library else {
            eprintln!("ffx-double: {library:?}", library = library.as_ref().err());
            return PARAMETER;
        };
        let mut library: MutexGuard<'_, Self> = library.lock().unwrap_or_else(PoisonError::into_inner);
        let answer = library.config.fixed_answers.iter().find(|(of, ..)| of == call).cloned();
        if let Some((_, code, text)) = answer {
            library.log_call(call, &[], code);
            library.say(&text);
            return code;
        }
        act(&mut library)
    }

    /// The code for a call that the configuration rejects, if it does.
    pub(crate) fn refusal(&self, call: &str, chain: &[(u64, *const u8)]) -> Option<u32> {
        if !self.config.may_reject {
            return None;
        }
        let text = std::fs::read_to_string(self.config.folder.join("refuses.txt")).ok()?;
        let mut words = text.trim().splitn(3, ' ');
        let id = u64::from_str_radix(words.next()?, 16).ok()?;
        let code = words.next()?.parse().ok()?;
        if chain.first().is_none_or(|(first, _)| *first != id) {
            return None;
        }
        self.say(words.next().unwrap_or_default());
        Some(self.log_call(call, chain, code))
    }

    /// Sends a message to the callback.
    fn say(&self, text: &str) {
        let units: Vec<u16> = text.encode_utf16().chain([0]).collect();
        if let Some(message) = self.message {
            // SAFETY: ends with a zero; the function is the host's.
            unsafe { message(0, units.as_ptr()) };
        }
    }

    fn append(&self, file: &str, line: &str) {
        let open = std::fs::OpenOptions::new().create(true).append(true).open(self.config.folder.join(file));
        let written = open.and_then(|mut file| writeln!(file, "{line}"));
        if let Err(e) = written {
            eprintln!("ffx-double: {file}: {e}: {line}");
        }
    }

    /// Logs a call.
    pub(crate) fn log_call(&self, call: &str, links: &[(u64, *const u8)], code: u32) -> u32 {
        if self.config.quiet {
            return code;
        }
        let ids: Vec<_> = links.iter().map(|(id, _)| format!("{id:x}")).collect();
        self.append("calls.txt", &format!("{call} {} {code}", ids.join(",")));
        if code == OK && !self.config.is_loader {
            for (id, at) in links {
                // SAFETY: a link of the current call, of the type that its id says.
                if let Some(line) = unsafe { parameter_log::line(*id, *at) } {
                    self.append("parameters.txt", &line);
                }
            }
        }
        code
    }

    /// Logs a rule violation; returns the code.
    pub(crate) fn report_violation(&self, call: &str, why: &str, code: u32) -> u32 {
        self.append("judgement.txt", &format!("{call}: {why}"));
        code
    }

    /// The provider that a context gets, which the struct `create` makes.
    fn provider(&self, create: u64, wanted: Option<u64>) -> Option<(u64, CString)> {
        let offered = self.config.offered(create);
        let offered = match wanted {
            None => offered.first(),
            Some(id) => offered.iter().find(|(known, _)| *known == id),
        };
        offered.map(|offered| self.config.substitute.as_ref().unwrap_or(offered).clone())
    }

    pub(crate) unsafe fn create(&mut self, context: *mut *mut c_void, head: *mut u8, callbacks: *const c_void) -> u32 {
        // SAFETY: the caller's chain.
        let chain = match unsafe { links(head) } {
            Ok(chain) if !chain.is_empty() && !context.is_null() => chain,
            Ok(_) => return self.report_violation("create", "a pointer is null", PARAMETER),
            Err(why) => return self.report_violation("create", why, PARAMETER),
        };
        if let Some(code) = self.refusal("create", &chain) {
            return code;
        }
        let first = chain[0].0;
        if self.config.is_loader {
            let Some(effect_library) = self.effect_library(first & EFFECT) else {
                return self.log_call("create", &chain, NO_PROVIDER);
            };
            // SAFETY: forwarded unchanged.
            let code = unsafe { effect_library.create(context, head, callbacks) };
            if code == OK {
                // SAFETY: written by the call.
                self.owners.insert(unsafe { *context } as usize, first & EFFECT);
            }
            return self.log_call("create", &chain, code);
        }
        if !callbacks.is_null() {
            self.report_violation("create", "memory is to come from the host, which this one never asks for", OK);
        }
        // SAFETY: the chain's links, of the types that their ids say.
        let code = unsafe { self.check_create(context, &chain) };
        if code == OK {
            // SAFETY: the caller's links; a header is two numbers long.
            let links = chain.iter().map(|(_, at)| (*at as usize, [0, 8].map(|of| unsafe { get::<u64>(*at, of) })));
            // SAFETY: written by the call.
            self.chains.insert(unsafe { *context } as usize, links.collect());
        }
        self.log_call("create", &chain, code)
    }

    /// Whether a context's creation chain is still unchanged in memory. Freed memory may hold anything.
    fn has_chain(&self, context: usize) -> bool {
        self.chains.get(&context).is_none_or(|links| {
            // SAFETY: a chain must live as long as its context; a host that breaks this is detected here, by the comparison or by a
            // crash.
            let stays =
                |(at, head): &(usize, [u64; 2])| [0, 8].map(|of| unsafe { get::<u64>(*at as *const u8, of) }) == *head;
            links.iter().all(stays)
        })
    }

    unsafe fn check_create(&mut self, pointer: *mut *mut c_void, chain: &[(u64, *const u8)]) -> u32 {
        let find = |wanted: u64| chain.iter().find(|(id, _)| *id == wanted).map(|(_, at)| *at);
        let (first, head) = chain[0];
        if !self.config.has(first & EFFECT) {
            return NO_PROVIDER;
        }
        let version = match first {
            id::GENERATION => id::GENERATION_VERSION,
            id::UPSCALE => id::UPSCALE_VERSION,
            _ if id::SWAPCHAINS.contains(&first) => id::SWAPCHAIN_VERSION,
            _ => return UNKNOWN_STRUCT,
        };
        for (link, _) in &chain[1..] {
            if ![id::BACKEND, id::OVERRIDE, id::HUDLESS, version].contains(link) {
                self.report_violation("create", &format!("{link:x} does not belong into this chain"), OK);
            }
        }
        match (find(version), self.config.sdk) {
            (None, Sdk::V21) => {
                return self.report_violation(
                    "create",
                    "the release that the host was written for is missing",
                    PARAMETER,
                );
            }
            (Some(_), sdk) if sdk < Sdk::V21 => {
                self.report_violation(
                    "create",
                    "a release before 2.1 is told for which release the host was written",
                    OK,
                );
            }
            (Some(at), _) => {
                // SAFETY: the version struct has its number at 16.
                let version = unsafe { get::<u32>(at, 16) };
                let own = self.config.providers.iter().map(|(id, _)| *id as u32 & 0x7fff_ffff).max().unwrap_or(0);
                if version >> 22 == 0 || version > own.max(0x0100_0000) {
                    self.report_violation(
                        "create",
                        &format!("{version:#x} is no release that this library could know"),
                        OK,
                    );
                }
            }
            (None, _) => {}
        }
        let Some(backend) = find(id::BACKEND) else {
            return self.report_violation("create", "there is no device", PARAMETER);
        };
        // SAFETY: the device is at 16.
        if !unsafe { is_device(get(backend, 16)) } {
            return self.report_violation("create", "the device is none", PARAMETER);
        }
        // SAFETY: the id is at 16.
        let wanted = find(id::OVERRIDE).map(|at| unsafe { get::<u64>(at, 16) });
        if let Some(wanted) = wanted
            && !self.offered.contains(&wanted)
        {
            return self.report_violation("create", &format!("{wanted:x} was never offered"), NO_PROVIDER);
        }
        if id::SWAPCHAINS.contains(&first) {
            let Some(provider) = self.provider(first, wanted) else { return NO_PROVIDER };
            let mut faults = Vec::new();
            // SAFETY: a struct of the type that its id says.
            let made =
                unsafe { swapchain::make(first, head, self.config.sdk, self.config.folder.clone(), &mut faults) };
            let code = if made.is_some() { OK } else { RUNTIME };
            for why in faults {
                self.report_violation("create", &why, code);
            }
            if let Some((presenting, _)) = made {
                let context = Box::into_raw(Box::new(0_u64)).cast::<c_void>();
                self.swapchains.insert(context as usize, presenting);
                self.contexts.insert(context as usize, provider);
                // SAFETY: the caller's memory.
                unsafe { *pointer = context };
            }
            return code;
        }
        // Two sizes, at 20 and 28 of both structs.
        // SAFETY: as above.
        let sides = unsafe { [20, 24, 28, 32].map(|at| get::<u32>(head, at)) };
        if sides.iter().any(|side| !(1..=16384).contains(side)) {
            return self.report_violation("create", &format!("sizes {sides:?}"), PARAMETER);
        }
        // AMD's optical flow keeps copies of the displayed picture down to 1/64 of its size. A texture without a pixel ends the
        // process: in the lab in a shader that writes it, and by an exception of AMD's where Direct3D does not create it.
        if first == id::GENERATION && sides[..2].iter().any(|side| side >> 6 == 0) {
            let code = self.report_violation("create", &format!("sides {:?} end the process", &sides[..2]), RUNTIME);
            return if self.config.returns_on_crash { code } else { std::process::abort() };
        }
        // Colour formats: three or four channels, no integers.
        // SAFETY: the format is at 36 of a frame generator's struct, and at 16 of the HUD-less struct.
        let format = (first == id::GENERATION).then(|| unsafe { get::<u32>(head, 36) });
        // SAFETY: as above.
        let hudless = find(id::HUDLESS).map(|at| unsafe { get::<u32>(at, 16) });
        for format in format.into_iter().chain(hudless) {
            if ![1, 3, 4, 5, 9, 10, 11, 12, 13, 14, 15, 16, 17, 29, 30, 32].contains(&format) {
                return self.report_violation("create", &format!("format {format} is none of pictures"), 3);
            }
        }
        let Some(provider) = self.provider(first, wanted) else { return NO_PROVIDER };
        let made = Box::into_raw(Box::new(0_u64)).cast::<c_void>();
        {
            // SAFETY: checked to be a device; the caller keeps its reference.
            let device = unsafe { get::<*mut c_void>(backend, 16) };
            // SAFETY: as above.
            let device = unsafe { IUnknown::from_raw_borrowed(&device) }.map(|object| object.cast::<ID3D12Device>());
            let Some(Ok(device)) = device else {
                return self.report_violation("create", "the device is none", PARAMETER);
            };
            // SAFETY: the flags are at 16.
            let flags = unsafe { get::<u32>(head, 16) };
            let (one, other) = ([sides[0], sides[1]], [sides[2], sides[3]]);
            let kind = match format {
                Some(format) => {
                    // SDK 1.1.0 does not know the HUD-less struct.
                    let hudless = hudless.filter(|_| self.config.sdk > Sdk::V110).unwrap_or(format);
                    let made_for = CreationParams { flags, shown: one, render: other, format, hudless };
                    ContextKind::Generator(GeneratorState::new(made_for))
                }
                None => ContextKind::Upscaler(UpscalerState {
                    flags,
                    render: one,
                    shown: other,
                    follows: false,
                    jitter: [0.0; 2],
                }),
            };
            let inputs = PreparedInputs::default();
            self.effect_contexts.insert(made as usize, EffectContext { kind, device, work: None, mask: None, inputs });
        }
        self.contexts.insert(made as usize, provider);
        // SAFETY: the caller's memory.
        unsafe { *pointer = made };
        OK
    }

    pub(crate) unsafe fn destroy(&mut self, context: *mut *mut c_void, callbacks: *const c_void) -> u32 {
        if context.is_null() {
            return self.report_violation("destroy", "a pointer is null", PARAMETER);
        }
        // SAFETY: the caller's memory.
        let known = unsafe { *context } as usize;
        if let Some(effect) = self.owners.remove(&known) {
            let Some(effect_library) = self.effect_library(effect) else { return NO_PROVIDER };
            // SAFETY: forwarded unchanged.
            let code = unsafe { effect_library.destroy(context, callbacks) };
            return self.log_call("destroy", &[], code);
        }
        if !self.has_chain(known) {
            self.report_violation("destroy", "the chain that the context was made with is gone", OK);
        }
        self.chains.remove(&known);
        if let Some(EffectContext { kind: ContextKind::Generator(generator), .. }) = self.effect_contexts.get(&known)
            && let Some(why) = generator.presented_by().and_then(|swapchain| swapchain.remove_generator(known))
        {
            self.report_violation("destroy", &why, OK);
        }
        if let Some(presenting) = self.swapchains.remove(&known) {
            for why in presenting.end() {
                self.report_violation("destroy", &why, OK);
            }
        }
        if let Some(EffectContext { work: Some(work), .. }) = self.effect_contexts.remove(&known) {
            let late = work.completed_late();
            if late > 0 {
                self.report_violation("destroy", &format!("{late} frames are under way"), OK);
            }
        }
        if self.contexts.remove(&known).is_none() {
            return self.report_violation("destroy", "there is no such context", PARAMETER);
        }
        // SAFETY: allocated by `create`, and removed from the maps above.
        drop(unsafe { Box::from_raw(known as *mut u64) });
        self.log_call("destroy", &[], OK)
    }

    /// Of a loader: destroys all live contexts; returns their number. Generators go first, as they would while their swap chain lives.
    ///
    /// # Safety
    /// Nobody uses them any more.
    pub(crate) unsafe fn destroy_all(&mut self) -> u64 {
        let mut owners: Vec<_> = self.owners.drain().collect();
        owners.sort_by_key(|(_, effect)| *effect);
        for (context, effect) in &owners {
            let mut context = *context as *mut c_void;
            if let Some(effect_library) = self.effect_library(*effect) {
                // SAFETY: the caller's promise.
                unsafe { effect_library.destroy(&mut context, std::ptr::null()) };
            }
        }
        owners.len() as u64
    }

    pub(crate) unsafe fn configure(&mut self, context: *mut *mut c_void, head: *const u8) -> u32 {
        // SAFETY: the caller's chain.
        let chain = match unsafe { links(head) } {
            Ok(chain) if !chain.is_empty() => chain,
            Ok(_) => return self.report_violation("configure", "a pointer is null", PARAMETER),
            Err(why) => return self.report_violation("configure", why, PARAMETER),
        };
        if let Some(code) = self.refusal("configure", &chain) {
            return code;
        }
        // SAFETY: the caller's memory.
        let known = (!context.is_null()).then(|| unsafe { *context } as usize);
        if let Some(effect) = known.and_then(|known| self.owners.get(&known).copied()) {
            let Some(effect_library) = self.effect_library(effect) else { return NO_PROVIDER };
            // SAFETY: forwarded unchanged.
            let code = unsafe { effect_library.configure(context, head) };
            return self.log_call("configure", &chain, code);
        }
        if known.is_some_and(|known| !self.contexts.contains_key(&known)) {
            return self.report_violation("configure", "there is no such context", PARAMETER);
        }
        let code = match chain[0].0 {
            // Without a context, only releases from 2.1 on accept a callback.
            id::GLOBAL_DEBUG_1 if known.is_none() => PARAMETER,
            id::GLOBAL_DEBUG_1 => {
                // SAFETY: the function is at 16, null or of this type.
                self.message = unsafe { get(head, 16) };
                OK
            }
            id::GLOBAL_DEBUG if self.config.sdk >= Sdk::V21 => {
                // SAFETY: the effect is at 16.
                let effect = unsafe { get::<u64>(head, 16) };
                if !self.config.has(effect) {
                    self.report_violation("configure", &format!("{effect:x} is no effect of this library"), OK);
                }
                // SAFETY: the function is at 24.
                self.message = unsafe { get(head, 24) };
                OK
            }
            // SAFETY: the chain's links, of the types that their ids say.
            CONFIGURE => known.map_or(PARAMETER, |known| unsafe { self.frame("configure", known, &chain) }),
            id::INTERFACE | id::SWAPCHAIN_KEY => match known.and_then(|known| self.swapchains.get(&known)) {
                // SAFETY: as above.
                Some(presenting) => match unsafe { swapchain_config::configure(presenting, &chain, self.config.sdk) } {
                    Ok(()) => OK,
                    Err(why) => self.report_violation("configure", &why, PARAMETER),
                },
                None => PARAMETER,
            },
            _ => UNKNOWN_STRUCT,
        };
        self.log_call("configure", &chain, code)
    }

    /// Handles one call of a frame.
    unsafe fn frame(&mut self, call: &str, context: usize, chain: &[(u64, *const u8)]) -> u32 {
        if !self.has_chain(context) {
            return self.report_violation(call, "the chain that the context was made with is gone", PARAMETER);
        }
        let Some(mut effect) = self.effect_contexts.remove(&context) else { return UNKNOWN_STRUCT };
        // SAFETY: as the caller promises.
        let code = unsafe { self.frame_of(call, context, &mut effect, chain) };
        self.effect_contexts.insert(context, effect);
        code
    }

    unsafe fn frame_of(
        &mut self,
        call: &str,
        context: usize,
        effect: &mut EffectContext,
        chain: &[(u64, *const u8)],
    ) -> u32 {
        let mut faults = Vec::new();
        let mut fault = |why| faults.push(why);
        // SAFETY: as the caller promises.
        let request = unsafe {
            match (&mut effect.kind, chain) {
                (ContextKind::Generator(generator), _) if chain[0].0 != UPSCALE => {
                    generator.check(self.config.sdk, context, chain, &mut fault)
                }
                (ContextKind::Upscaler(upscaler), [(UPSCALE, head)]) => {
                    upscaler.check(*head, &mut fault).map(Request::Picture)
                }
                (ContextKind::Upscaler(upscaler), [(MASK, head)]) => {
                    upscaler.check_mask(*head, &mut fault).map(Request::Picture)
                }
                _ => return UNKNOWN_STRUCT,
            }
        };
        let in_flight = effect.work.as_ref().map_or(0, ShaderWork::in_flight);
        if [PICTURE, UPSCALE].contains(&chain[0].0) && in_flight >= 4 {
            faults.push(format!("{in_flight} frames are under way"));
        }
        for why in &faults {
            self.report_violation(call, why, PARAMETER);
        }
        if !faults.is_empty() {
            return PARAMETER;
        }
        let mut request = match (request, &mut effect.kind) {
            (None, _) => return OK,
            (Some(Request::Picture(request)), _) => request,
            (Some(Request::Prepare(request)), ContextKind::Generator(generator)) => {
                // SAFETY: list and resources were checked.
                let recorded = unsafe { effect.inputs.record(&effect.device, &request) };
                return recorded.map_or(RUNTIME, |inputs| {
                    generator.set_prepared_inputs(inputs);
                    OK
                });
            }
            (Some(Request::Prepare(_)), ContextKind::Upscaler(_)) => return UNKNOWN_STRUCT,
        };
        if self.config.fails_from.is_some_and(|first| self.pictures + 1 >= first) {
            return RUNTIME;
        }
        let code = match &mut effect.kind {
            ContextKind::Generator(_) => {
                let runs = self.contexts.get(&context).map(|(_, name)| name);
                if self.config.wrong_provider.is_none() || self.config.wrong_provider.as_ref() == runs {
                    request.constants[CONSTANTS - 2] |= self.config.wrong_picture_flags;
                }
                let number = self.pictures + 1;
                if self.config.cut_at.is_some_and(|cut| (cut..cut + 4).contains(&number)) {
                    request.constants[CONSTANTS - 2] |= RESET;
                }
                request.constants[CONSTANTS - 1] = self.config.extra_repetitions;
                &include_bytes!("compiled/interpolate.dxbc")[..]
            }
            ContextKind::Upscaler(_) if chain[0].0 == MASK => include_bytes!("compiled/reactive.dxbc"),
            ContextKind::Upscaler(upscaler) => {
                upscaler.follows = true;
                include_bytes!("compiled/upscale.dxbc")
            }
        };
        let work = if chain[0].0 == MASK { &mut effect.mask } else { &mut effect.work };
        if work.is_none() {
            *work = ShaderWork::new(&effect.device, code).ok();
        }
        let Some(work) = work else { return RUNTIME };
        // SAFETY: list and resources were checked.
        let recorded = unsafe { work.record(request.list, &request.pictures, request.constants) };
        self.pictures += 1;
        let removed = if self.config.device_removed_at == Some(self.pictures) { work.remove_device() } else { Ok(()) };
        if recorded.and(removed).is_err() { RUNTIME } else { OK }
    }

    pub(crate) unsafe fn dispatch(&mut self, context: *mut *mut c_void, head: *const u8) -> u32 {
        // SAFETY: the caller's chain.
        let chain = match unsafe { links(head) } {
            Ok(chain) if !chain.is_empty() && !context.is_null() => chain,
            Ok(_) => return self.report_violation("dispatch", "a pointer is null", PARAMETER),
            Err(why) => return self.report_violation("dispatch", why, PARAMETER),
        };
        if let Some(code) = self.refusal("dispatch", &chain) {
            return code;
        }
        // SAFETY: the caller's memory.
        let known = unsafe { *context } as usize;
        if let Some(effect) = self.owners.get(&known).copied() {
            let Some(effect_library) = self.effect_library(effect) else { return NO_PROVIDER };
            // SAFETY: forwarded unchanged.
            let code = unsafe { effect_library.dispatch(context, head) };
            return self.log_call("dispatch", &chain, code);
        }
        if !self.contexts.contains_key(&known) {
            return self.report_violation("dispatch", "there is no such context", PARAMETER);
        }
        let code = match chain[0].0 {
            // AMD's 2.0 returns this for an unknown struct.
            PREPARE_V2 if self.config.sdk < Sdk::V21 => PARAMETER,
            // SAFETY: the chain's links, of the types that their ids say.
            PREPARE | PREPARE_V2 | PICTURE | UPSCALE | MASK => unsafe { self.frame("dispatch", known, &chain) },
            id::WAIT => match self.swapchains.get(&known) {
                Some(presenting) => {
                    presenting.swapchain.wait();
                    OK
                }
                None => UNKNOWN_STRUCT,
            },
            _ => UNKNOWN_STRUCT,
        };
        self.log_call("dispatch", &chain, code)
    }

    /// The library of an effect, loaded at the first call.
    pub(crate) fn effect_library(&mut self, effect: u64) -> Option<EffectLibrary> {
        if let Some(effect_library) = self.effect_libraries.get(&effect) {
            return Some(*effect_library);
        }
        let effect_library = EffectLibrary::load(effect)?;
        self.effect_libraries.insert(effect, effect_library);
        Some(effect_library)
    }
}

/// Whether an object is a device of Direct3D 12.
///
/// # Safety
/// Null, or an object of COM.
pub(crate) unsafe fn is_device(object: *mut c_void) -> bool {
    // SAFETY: the caller's promise; the reference stays the caller's.
    unsafe { IUnknown::from_raw_borrowed(&object) }.is_some_and(|object| object.cast::<ID3D12Device>().is_ok())
}
