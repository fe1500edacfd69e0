//! The calls themselves: answers as AMD's libraries do, and checks every call.

use std::collections::HashMap;
use std::ffi::{CString, c_void};
use std::io::Write;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use windows::Win32::Graphics::Direct3D12::ID3D12Device;
use windows::Win32::System::LibraryLoader::{GetProcAddress, LoadLibraryA};
use windows::core::{IUnknown, Interface, PCSTR, s};

use crate::frames::{CONFIGURE, Frames, Made, PICTURE, PREPARE, PREPARE_V2};
use crate::memory::{get, links};
use crate::role::{Role, Sdk};
use crate::settings;
use crate::swapchain::{self, Presenting};
use crate::told;
use crate::upscale::{Larger, MASK, UPSCALE};
use crate::work::{CONSTANTS, RESET, Work};
use crate::{NO_PROVIDER, OK, PARAMETER, RUNTIME, UNKNOWN_STRUCT};

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
pub(crate) struct Judge {
    pub(crate) role: Role,
    /// Live contexts by address, with the provider of each.
    pub(crate) contexts: HashMap<usize, (u64, CString)>,
    /// The creation chain of each context, which must live as long: the address of each link and its header.
    chains: HashMap<usize, Vec<(usize, [u64; 2])>>,
    /// The generators and upscalers among the contexts.
    pub(crate) frames: HashMap<usize, Worker>,
    /// The swap chains among the contexts.
    pub(crate) swapchains: HashMap<usize, Presenting>,
    /// Number of pictures requested.
    pictures: u64,
    /// Provider ids returned by queries.
    pub(crate) offered: Vec<u64>,
    message: Option<Message>,
    /// For a loader: the libraries of the effects.
    behind: HashMap<u64, Behind>,
    /// For a loader: the effect of each context.
    pub(crate) owners: HashMap<usize, u64>,
}

/// A generator's or upscaler's context.
pub(crate) struct Worker {
    pub(crate) does: Does,
    device: ID3D12Device,
    /// Created at the first picture: drivers take long to compile shaders.
    work: Option<Work>,
    /// The same for reactive masks.
    mask: Option<Work>,
}

/// The kind of a context, with its state.
pub(crate) enum Does {
    Generates(Frames),
    Enlarges(Larger),
}

/// An exported function of unknown type.
type Found = unsafe extern "system" fn() -> isize;
type Create = unsafe extern "C" fn(*mut *mut c_void, *mut u8, *const c_void) -> u32;
type Destroy = unsafe extern "C" fn(*mut *mut c_void, *const c_void) -> u32;
type Query = unsafe extern "C" fn(*mut *mut c_void, *mut u8) -> u32;
/// `ffxConfigure` and `ffxDispatch`.
type Send = unsafe extern "C" fn(*mut *mut c_void, *const u8) -> u32;

/// The functions of a library that a loader forwards to.
#[derive(Clone, Copy)]
pub(crate) struct Behind {
    create: Create,
    destroy: Destroy,
    configure: Send,
    pub(crate) query: Query,
    dispatch: Send,
}

static JUDGE: OnceLock<Result<Mutex<Judge>, String>> = OnceLock::new();

impl Judge {
    /// Handles one call. ffx-api forbids concurrent calls of one context and has no lock; here they take turns and are checked.
    pub(crate) fn hears(call: &'static str, act: impl FnOnce(&mut Self) -> u32) -> u32 {
        let judge = JUDGE.get_or_init(|| Role::own().map(|role| Mutex::new(Self { role, ..Self::default() })));
        let Ok(judge) = judge else {
            eprintln!("ffx-double: {judge:?}", judge = judge.as_ref().err());
            return PARAMETER;
        };
        let mut judge: MutexGuard<'_, Self> = judge.lock().unwrap_or_else(PoisonError::into_inner);
        let told = judge.role.answers.iter().find(|(of, ..)| of == call).cloned();
        if let Some((_, code, text)) = told {
            judge.note(call, &[], code);
            judge.say(&text);
            return code;
        }
        act(&mut judge)
    }

    /// The code for a call that the configuration rejects, if it does.
    pub(crate) fn refusal(&self, call: &str, chain: &[(u64, *const u8)]) -> Option<u32> {
        if !self.role.is_refusing {
            return None;
        }
        let text = std::fs::read_to_string(self.role.folder.join("refuses.txt")).ok()?;
        let mut words = text.trim().splitn(3, ' ');
        let id = u64::from_str_radix(words.next()?, 16).ok()?;
        let code = words.next()?.parse().ok()?;
        if chain.first().is_none_or(|(first, _)| *first != id) {
            return None;
        }
        self.say(words.next().unwrap_or_default());
        Some(self.note(call, chain, code))
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
        let open = std::fs::OpenOptions::new().create(true).append(true).open(self.role.folder.join(file));
        let written = open.and_then(|mut file| writeln!(file, "{line}"));
        if let Err(e) = written {
            eprintln!("ffx-double: {file}: {e}: {line}");
        }
    }

    /// Logs a call.
    pub(crate) fn note(&self, call: &str, links: &[(u64, *const u8)], code: u32) -> u32 {
        if self.role.quiet {
            return code;
        }
        let ids: Vec<_> = links.iter().map(|(id, _)| format!("{id:x}")).collect();
        self.append("calls.txt", &format!("{call} {} {code}", ids.join(",")));
        if code == OK && !self.role.is_loader {
            for (id, at) in links {
                // SAFETY: a link of the current call, of the type that its id says.
                if let Some(line) = unsafe { told::line(*id, *at) } {
                    self.append("told.txt", &line);
                }
            }
        }
        code
    }

    /// Logs a rule violation; returns the code.
    pub(crate) fn fault(&self, call: &str, why: &str, code: u32) -> u32 {
        self.append("judgement.txt", &format!("{call}: {why}"));
        code
    }

    /// The provider that a context gets.
    fn provider(&self, wanted: Option<u64>) -> Option<(u64, CString)> {
        let offered = match wanted {
            None => self.role.offers.first(),
            Some(id) => self.role.offers.iter().find(|(known, _)| *known == id),
        };
        offered.map(|offered| self.role.runs.as_ref().unwrap_or(offered).clone())
    }

    pub(crate) unsafe fn create(&mut self, context: *mut *mut c_void, head: *mut u8, callbacks: *const c_void) -> u32 {
        // SAFETY: the caller's chain.
        let chain = match unsafe { links(head) } {
            Ok(chain) if !chain.is_empty() && !context.is_null() => chain,
            Ok(_) => return self.fault("create", "a pointer is null", PARAMETER),
            Err(why) => return self.fault("create", why, PARAMETER),
        };
        if let Some(code) = self.refusal("create", &chain) {
            return code;
        }
        let first = chain[0].0;
        if self.role.is_loader {
            let Some(behind) = self.behind(first & EFFECT) else { return self.note("create", &chain, NO_PROVIDER) };
            // SAFETY: forwarded unchanged.
            let code = unsafe { (behind.create)(context, head, callbacks) };
            if code == OK {
                // SAFETY: written by the call.
                self.owners.insert(unsafe { *context } as usize, first & EFFECT);
            }
            return self.note("create", &chain, code);
        }
        if !callbacks.is_null() {
            self.fault("create", "memory is to come from the host, which this one never asks for", OK);
        }
        // SAFETY: the chain's links, of the types that their ids say.
        let code = unsafe { self.judge_create(context, &chain) };
        if code == OK {
            // SAFETY: the caller's links; a header is two numbers long.
            let links = chain.iter().map(|(_, at)| (*at as usize, [0, 8].map(|of| unsafe { get::<u64>(*at, of) })));
            // SAFETY: written by the call.
            self.chains.insert(unsafe { *context } as usize, links.collect());
        }
        self.note("create", &chain, code)
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

    unsafe fn judge_create(&mut self, place: *mut *mut c_void, chain: &[(u64, *const u8)]) -> u32 {
        let find = |wanted: u64| chain.iter().find(|(id, _)| *id == wanted).map(|(_, at)| *at);
        let (first, head) = chain[0];
        if !self.role.has(first & EFFECT) {
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
                self.fault("create", &format!("{link:x} does not belong into this chain"), OK);
            }
        }
        match (find(version), self.role.sdk) {
            (None, Sdk::V21) => {
                return self.fault("create", "the release that the host was written for is missing", PARAMETER);
            }
            (Some(_), sdk) if sdk < Sdk::V21 => {
                self.fault("create", "a release before 2.1 is told for which release the host was written", OK);
            }
            (Some(at), _) => {
                // SAFETY: the version struct has its number at 16.
                let told = unsafe { get::<u32>(at, 16) };
                let own = self.role.offers.iter().map(|(id, _)| *id as u32 & 0x7fff_ffff).max().unwrap_or(0);
                if told >> 22 == 0 || told > own.max(0x0100_0000) {
                    self.fault("create", &format!("{told:#x} is no release that this library could know"), OK);
                }
            }
            (None, _) => {}
        }
        let Some(backend) = find(id::BACKEND) else { return self.fault("create", "there is no device", PARAMETER) };
        // SAFETY: the device is at 16.
        if !unsafe { is_device(get(backend, 16)) } {
            return self.fault("create", "the device is none", PARAMETER);
        }
        // SAFETY: the id is at 16.
        let wanted = find(id::OVERRIDE).map(|at| unsafe { get::<u64>(at, 16) });
        if let Some(wanted) = wanted
            && !self.offered.contains(&wanted)
        {
            return self.fault("create", &format!("{wanted:x} was never offered"), NO_PROVIDER);
        }
        if id::SWAPCHAINS.contains(&first) {
            let Some(provider) = self.provider(wanted) else { return NO_PROVIDER };
            let mut faults = Vec::new();
            // SAFETY: a struct of the type that its id says.
            let made = unsafe { swapchain::make(first, head, self.role.folder.clone(), &mut faults) };
            let code = if made.is_some() { OK } else { RUNTIME };
            for why in faults {
                self.fault("create", &why, code);
            }
            if let Some((presenting, _)) = made {
                let context = Box::into_raw(Box::new(0_u64)).cast::<c_void>();
                self.swapchains.insert(context as usize, presenting);
                self.contexts.insert(context as usize, provider);
                // SAFETY: the caller's memory.
                unsafe { *place = context };
            }
            return code;
        }
        // Two sizes, at 20 and 28 of both structs.
        // SAFETY: as above.
        let sides = unsafe { [20, 24, 28, 32].map(|at| get::<u32>(head, at)) };
        if sides.iter().any(|side| !(1..=16384).contains(side)) {
            return self.fault("create", &format!("sizes {sides:?}"), PARAMETER);
        }
        // AMD's optical flow keeps copies of the displayed picture down to 1/64 of its size. A texture without a pixel ends the
        // process: in the lab in a shader that writes it, and by an exception of AMD's where Direct3D does not create it.
        if first == id::GENERATION && sides[..2].iter().any(|side| side >> 6 == 0) {
            let code = self.fault("create", &format!("sides {:?} end the process", &sides[..2]), RUNTIME);
            return if self.role.survives { code } else { std::process::abort() };
        }
        // Colour formats: three or four channels, no integers.
        // SAFETY: the format is at 36 of a frame generator's struct, and at 16 of the HUD-less struct.
        let format = (first == id::GENERATION).then(|| unsafe { get::<u32>(head, 36) });
        // SAFETY: as above.
        let hudless = find(id::HUDLESS).map(|at| unsafe { get::<u32>(at, 16) });
        for format in format.into_iter().chain(hudless) {
            if ![1, 3, 4, 5, 9, 10, 11, 12, 13, 14, 15, 16, 17, 29, 30, 32].contains(&format) {
                return self.fault("create", &format!("format {format} is none of pictures"), 3);
            }
        }
        let Some(provider) = self.provider(wanted) else { return NO_PROVIDER };
        let made = Box::into_raw(Box::new(0_u64)).cast::<c_void>();
        {
            // SAFETY: checked to be a device; the caller keeps its reference.
            let device = unsafe { get::<*mut c_void>(backend, 16) };
            // SAFETY: as above.
            let device = unsafe { IUnknown::from_raw_borrowed(&device) }.map(|object| object.cast::<ID3D12Device>());
            let Some(Ok(device)) = device else { return self.fault("create", "the device is none", PARAMETER) };
            // SAFETY: the flags are at 16.
            let flags = unsafe { get::<u32>(head, 16) };
            let (one, other) = ([sides[0], sides[1]], [sides[2], sides[3]]);
            let does = match format {
                Some(format) => {
                    let made_for =
                        Made { flags, shown: one, render: other, format, hudless: hudless.unwrap_or(format) };
                    Does::Generates(Frames::new(made_for))
                }
                None => Does::Enlarges(Larger { flags, render: one, shown: other, follows: false, jitter: [0.0; 2] }),
            };
            self.frames.insert(made as usize, Worker { does, device, work: None, mask: None });
        }
        self.contexts.insert(made as usize, provider);
        // SAFETY: the caller's memory.
        unsafe { *place = made };
        OK
    }

    pub(crate) unsafe fn destroy(&mut self, context: *mut *mut c_void, callbacks: *const c_void) -> u32 {
        if context.is_null() {
            return self.fault("destroy", "a pointer is null", PARAMETER);
        }
        // SAFETY: the caller's memory.
        let known = unsafe { *context } as usize;
        if let Some(effect) = self.owners.remove(&known) {
            let Some(behind) = self.behind(effect) else { return NO_PROVIDER };
            // SAFETY: forwarded unchanged.
            let code = unsafe { (behind.destroy)(context, callbacks) };
            return self.note("destroy", &[], code);
        }
        if !self.has_chain(known) {
            self.fault("destroy", "the chain that the context was made with is gone", OK);
        }
        self.chains.remove(&known);
        if let Some(Worker { does: Does::Generates(frames), .. }) = self.frames.get(&known)
            && let Some(why) = frames.presented_by().and_then(|stage| stage.let_go(known))
        {
            self.fault("destroy", &why, OK);
        }
        if let Some(presenting) = self.swapchains.remove(&known) {
            for why in presenting.end() {
                self.fault("destroy", &why, OK);
            }
        }
        if let Some(Worker { work: Some(work), .. }) = self.frames.remove(&known)
            && work.under_way() > 0
        {
            self.fault("destroy", &format!("{} frames are under way", work.under_way()), OK);
            // The device may still use it, so it is leaked.
            std::mem::forget(work);
        }
        if self.contexts.remove(&known).is_none() {
            return self.fault("destroy", "there is no such context", PARAMETER);
        }
        // SAFETY: allocated by `create`, and removed from the maps above.
        drop(unsafe { Box::from_raw(known as *mut u64) });
        self.note("destroy", &[], OK)
    }

    pub(crate) unsafe fn configure(&mut self, context: *mut *mut c_void, head: *const u8) -> u32 {
        // SAFETY: the caller's chain.
        let chain = match unsafe { links(head) } {
            Ok(chain) if !chain.is_empty() => chain,
            Ok(_) => return self.fault("configure", "a pointer is null", PARAMETER),
            Err(why) => return self.fault("configure", why, PARAMETER),
        };
        if let Some(code) = self.refusal("configure", &chain) {
            return code;
        }
        // SAFETY: the caller's memory.
        let known = (!context.is_null()).then(|| unsafe { *context } as usize);
        if let Some(effect) = known.and_then(|known| self.owners.get(&known).copied()) {
            let Some(behind) = self.behind(effect) else { return NO_PROVIDER };
            // SAFETY: forwarded unchanged.
            let code = unsafe { (behind.configure)(context, head) };
            return self.note("configure", &chain, code);
        }
        if known.is_some_and(|known| !self.contexts.contains_key(&known)) {
            return self.fault("configure", "there is no such context", PARAMETER);
        }
        let code = match chain[0].0 {
            // Without a context, only releases from 2.1 on accept a callback.
            id::GLOBAL_DEBUG_1 if known.is_none() => PARAMETER,
            id::GLOBAL_DEBUG_1 => {
                // SAFETY: the function is at 16, null or of this type.
                self.message = unsafe { get(head, 16) };
                OK
            }
            id::GLOBAL_DEBUG if self.role.sdk >= Sdk::V21 => {
                // SAFETY: the effect is at 16.
                let effect = unsafe { get::<u64>(head, 16) };
                if !self.role.has(effect) {
                    self.fault("configure", &format!("{effect:x} is no effect of this library"), OK);
                }
                // SAFETY: the function is at 24.
                self.message = unsafe { get(head, 24) };
                OK
            }
            // SAFETY: the chain's links, of the types that their ids say.
            CONFIGURE => known.map_or(PARAMETER, |known| unsafe { self.frame("configure", known, &chain) }),
            id::INTERFACE | id::SWAPCHAIN_KEY => match known.and_then(|known| self.swapchains.get(&known)) {
                // SAFETY: as above.
                Some(presenting) => match unsafe { settings::configure(presenting, &chain, self.role.sdk) } {
                    Ok(()) => OK,
                    Err(why) => self.fault("configure", &why, PARAMETER),
                },
                None => PARAMETER,
            },
            _ => UNKNOWN_STRUCT,
        };
        self.note("configure", &chain, code)
    }

    /// Handles one call of a frame.
    unsafe fn frame(&mut self, call: &str, context: usize, chain: &[(u64, *const u8)]) -> u32 {
        if !self.has_chain(context) {
            return self.fault(call, "the chain that the context was made with is gone", PARAMETER);
        }
        let Some(mut worker) = self.frames.remove(&context) else { return UNKNOWN_STRUCT };
        // SAFETY: as the caller promises.
        let code = unsafe { self.frame_of(call, context, &mut worker, chain) };
        self.frames.insert(context, worker);
        code
    }

    unsafe fn frame_of(&mut self, call: &str, context: usize, worker: &mut Worker, chain: &[(u64, *const u8)]) -> u32 {
        let mut faults = Vec::new();
        let mut fault = |why| faults.push(why);
        // SAFETY: as the caller promises.
        let asked = unsafe {
            match (&mut worker.does, chain) {
                (Does::Generates(frames), _) if chain[0].0 != UPSCALE => {
                    frames.judge(self.role.sdk, context, chain, &mut fault)
                }
                (Does::Enlarges(larger), [(UPSCALE, head)]) => larger.judge(*head, &mut fault),
                (Does::Enlarges(larger), [(MASK, head)]) => larger.judge_mask(*head, &mut fault),
                _ => return UNKNOWN_STRUCT,
            }
        };
        let under_way = worker.work.as_ref().map_or(0, Work::under_way);
        if [PICTURE, UPSCALE].contains(&chain[0].0) && under_way >= 4 {
            faults.push(format!("{under_way} frames are under way"));
        }
        for why in &faults {
            self.fault(call, why, PARAMETER);
        }
        if !faults.is_empty() {
            return PARAMETER;
        }
        let Some(mut asked) = asked else { return OK };
        if self.role.breaks.is_some_and(|first| self.pictures + 1 >= first) {
            return RUNTIME;
        }
        let code = match &mut worker.does {
            Does::Generates(_) => {
                let runs = self.contexts.get(&context).map(|(_, name)| name);
                if self.role.only.is_none() || self.role.only.as_ref() == runs {
                    asked.constants[CONSTANTS - 2] |= self.role.plays;
                }
                let number = self.pictures + 1;
                if self.role.cuts.is_some_and(|cut| (cut..cut + 4).contains(&number)) {
                    asked.constants[CONSTANTS - 2] |= RESET;
                }
                asked.constants[CONSTANTS - 1] = self.role.slow;
                &include_bytes!("interpolate.dxbc")[..]
            }
            Does::Enlarges(_) if chain[0].0 == MASK => include_bytes!("reactive.dxbc"),
            Does::Enlarges(larger) => {
                larger.follows = true;
                include_bytes!("upscale.dxbc")
            }
        };
        let work = if chain[0].0 == MASK { &mut worker.mask } else { &mut worker.work };
        if work.is_none() {
            *work = Work::new(&worker.device, code).ok();
        }
        let Some(work) = work else { return RUNTIME };
        // SAFETY: list and resources were checked.
        let recorded = unsafe { work.record(asked.list, &asked.pictures, asked.constants) };
        self.pictures += 1;
        let removed = if self.role.removes == Some(self.pictures) { work.remove_device() } else { Ok(()) };
        if recorded.and(removed).is_err() { RUNTIME } else { OK }
    }

    pub(crate) unsafe fn dispatch(&mut self, context: *mut *mut c_void, head: *const u8) -> u32 {
        // SAFETY: the caller's chain.
        let chain = match unsafe { links(head) } {
            Ok(chain) if !chain.is_empty() && !context.is_null() => chain,
            Ok(_) => return self.fault("dispatch", "a pointer is null", PARAMETER),
            Err(why) => return self.fault("dispatch", why, PARAMETER),
        };
        if let Some(code) = self.refusal("dispatch", &chain) {
            return code;
        }
        // SAFETY: the caller's memory.
        let known = unsafe { *context } as usize;
        if let Some(effect) = self.owners.get(&known).copied() {
            let Some(behind) = self.behind(effect) else { return NO_PROVIDER };
            // SAFETY: forwarded unchanged.
            let code = unsafe { (behind.dispatch)(context, head) };
            return self.note("dispatch", &chain, code);
        }
        if !self.contexts.contains_key(&known) {
            return self.fault("dispatch", "there is no such context", PARAMETER);
        }
        let code = match chain[0].0 {
            // AMD's 2.0 returns this for an unknown struct.
            PREPARE_V2 if self.role.sdk < Sdk::V21 => PARAMETER,
            // SAFETY: the chain's links, of the types that their ids say.
            PREPARE | PREPARE_V2 | PICTURE | UPSCALE | MASK => unsafe { self.frame("dispatch", known, &chain) },
            id::WAIT => match self.swapchains.get(&known) {
                Some(presenting) => {
                    presenting.stage.wait();
                    OK
                }
                None => UNKNOWN_STRUCT,
            },
            _ => UNKNOWN_STRUCT,
        };
        self.note("dispatch", &chain, code)
    }

    /// The library of an effect, loaded by its bare name, as AMD's loader does.
    pub(crate) fn behind(&mut self, effect: u64) -> Option<Behind> {
        if let Some(behind) = self.behind.get(&effect) {
            return Some(*behind);
        }
        let name = match effect {
            0x1_0000 => s!("amd_fidelityfx_upscaler_dx12.dll"),
            _ => s!("amd_fidelityfx_framegeneration_dx12.dll"),
        };
        // SAFETY: a static name; a copy of this library, or one that a test put there.
        let module = unsafe { LoadLibraryA(name) }.ok()?;
        let find = |name: PCSTR| {
            // SAFETY: a loaded module and a static name.
            unsafe { GetProcAddress(module, name) }
        };
        // SAFETY: ffx-api's functions by their names.
        let behind = unsafe {
            Behind {
                create: std::mem::transmute::<Found, Create>(find(s!("ffxCreateContext"))?),
                destroy: std::mem::transmute::<Found, Destroy>(find(s!("ffxDestroyContext"))?),
                configure: std::mem::transmute::<Found, Send>(find(s!("ffxConfigure"))?),
                query: std::mem::transmute::<Found, Query>(find(s!("ffxQuery"))?),
                dispatch: std::mem::transmute::<Found, Send>(find(s!("ffxDispatch"))?),
            }
        };
        self.behind.insert(effect, behind);
        Some(behind)
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
