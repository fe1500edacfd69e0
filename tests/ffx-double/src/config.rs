//! Configuration of a copy of the double, read from the text file beside it.

use std::ffi::CString;
use std::path::{Path, PathBuf};

use windows::Win32::Foundation::HMODULE;
use windows::Win32::System::LibraryLoader::{
    GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS, GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT, GetModuleFileNameW,
    GetModuleHandleExW,
};
use windows::core::PCWSTR;

use crate::library::EFFECT;
use crate::shader_work;

/// The effect of swap chains, in the ids of structs.
pub(crate) const SWAPCHAIN_EFFECT: u64 = 0x3_0000;

/// The configuration: one setting per line, such as `sdk 2.1` or `offers 0xf600000001000001 4.0.1`.
#[derive(Debug, Clone, Default)]
pub(crate) struct Config {
    /// `sdk 1.1.0`, `1.1.4`, `2.0` or `2.1`: the SDK release; default 1.1.4.
    pub(crate) sdk: Sdk,
    /// `loader`: forwards every call to the library of its effect, which it loads by name, as AMD's loader does.
    pub(crate) is_loader: bool,
    /// `effect NUMBER`: the effect it implements; default 0x20000. May be repeated.
    pub(crate) effects: Vec<u64>,
    /// `offers ID NAME`: an available provider; the first is the default.
    pub(crate) providers: Vec<(u64, CString)>,
    /// The provider of swap chains, if it is another than those: that of SDK 1.1.0 is named 1.0.
    swapchain_provider: Option<(u64, CString)>,
    /// `runs ID NAME`: the provider that contexts get instead, as drivers do.
    pub(crate) substitute: Option<(u64, CString)>,
    /// `answers CALL CODE TEXT`: that call returns the code, and the text goes to the message callback.
    pub(crate) fixed_answers: Vec<(String, u32, String)>,
    /// `refusing`: fails calls whose first struct has the id in `refuses.txt`, which has a line `ID CODE TEXT` and may change.
    pub(crate) may_reject: bool,
    /// `plays FLAG`: makes its pictures wrong: `through` (a copy of the input), `black`, `backwards` (wrong sign of motion),
    /// `upside-down` (wrong sign of vertical motion), `farthest` (reversed depth order) or `jitter` (jitter of the wrong sign).
    pub(crate) wrong_picture_flags: u32,
    /// `only NAME`: only the provider of that name makes wrong pictures.
    pub(crate) wrong_provider: Option<CString>,
    /// `slow COUNT`: how many more times its shader repeats its work.
    pub(crate) extra_repetitions: u32,
    /// `survives`: calls that crash AMD's libraries return an error; otherwise they end the process.
    pub(crate) returns_on_crash: bool,
    /// `quiet`: logs rule violations only, and no calls.
    pub(crate) quiet: bool,
    /// `removes COUNT`: removes the device at that picture.
    pub(crate) device_removed_at: Option<u64>,
    /// `cuts COUNT`: the picture at which it detects a cut. That picture and the next three are copies of the input, as AMD's are while
    /// one of the last four frames was a cut.
    pub(crate) cut_at: Option<u64>,
    /// `breaks COUNT`: generation fails from that picture on.
    pub(crate) fails_from: Option<u64>,
    /// `requires KINDS`: the required inputs of an upscaler, as a sum of flags; else it answers with every bit, as AMD's FSR 3 does.
    pub(crate) required_inputs: Option<u64>,
    /// The folder of the copy.
    pub(crate) folder: PathBuf,
}

/// Releases in their order.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Sdk {
    /// 1.1.0.
    V110,
    /// 1.1.4.
    #[default]
    V114,
    /// 2.0.
    V20,
    /// 2.1 and later.
    V21,
}

impl Sdk {
    /// The number of buffers for which AMD's swap chain has room.
    pub(crate) fn most_buffers(self) -> u32 {
        if self < Self::V20 { 6 } else { 16 }
    }
}

impl Config {
    /// Reads the text file beside this library.
    pub(crate) fn own() -> Result<Self, String> {
        let file = own_file()?;
        let folder = file.parent().unwrap_or(Path::new("")).to_owned();
        let mut text = file.into_os_string();
        text.push(".txt");
        let text = std::fs::read_to_string(&text).map_err(|e| format!("{}: {e}", text.display()))?;
        Self::parse(&text).map(|config| Self { folder, ..config })
    }

    fn parse(text: &str) -> Result<Self, String> {
        let mut config = Self::default();
        for line in text.lines().map(str::trim).filter(|line| !line.is_empty()) {
            let mut words = line.splitn(4, ' ');
            let mut word = || words.next().ok_or_else(|| format!("\"{line}\" ends too soon"));
            match word()? {
                "sdk" => {
                    config.sdk = match word()? {
                        "1.1.0" => {
                            config.swapchain_provider = Some((0xf65c_dd12_0100_0000, name("1.0")?));
                            Sdk::V110
                        }
                        "1.1.4" => Sdk::V114,
                        "2.0" => Sdk::V20,
                        "2.1" => Sdk::V21,
                        other => return Err(format!("{other} is no release that is played")),
                    }
                }
                "quiet" => config.quiet = true,
                "survives" => config.returns_on_crash = true,
                "loader" => config.is_loader = true,
                "refusing" => config.may_reject = true,
                "cuts" => config.cut_at = Some(word()?.parse().map_err(|e| format!("{e}"))?),
                "effect" => config.effects.push(number(word()?)?),
                "offers" => config.providers.push((number(word()?)?, name(word()?)?)),
                "plays" => {
                    config.wrong_picture_flags |= match word()? {
                        "through" => shader_work::THROUGH,
                        "black" => shader_work::BLACK,
                        "backwards" => shader_work::WRONG_SIGN,
                        "upside-down" => shader_work::UPSIDE_DOWN,
                        "farthest" => shader_work::FARTHEST,
                        "jitter" => shader_work::WRONG_JITTER,
                        other => return Err(format!("{other} is nothing that is played")),
                    }
                }
                "only" => config.wrong_provider = Some(name(word()?)?),
                "slow" => config.extra_repetitions = word()?.parse().map_err(|e| format!("{e}"))?,
                "removes" => config.device_removed_at = Some(word()?.parse().map_err(|e| format!("{e}"))?),
                "requires" => config.required_inputs = Some(number(word()?)?),
                "breaks" => config.fails_from = Some(word()?.parse().map_err(|e| format!("{e}"))?),
                "runs" => config.substitute = Some((number(word()?)?, name(word()?)?)),
                "answers" => {
                    config.fixed_answers.push((
                        word()?.to_owned(),
                        word()?.parse().map_err(|e| format!("{e}"))?,
                        word()?.to_owned(),
                    ));
                }
                other => return Err(format!("{other} is no word of a role")),
            }
        }
        if config.effects.is_empty() {
            config.effects.push(0x2_0000);
        }
        Ok(config)
    }
}

impl Config {
    /// The available providers of the contexts that the struct `create` makes.
    pub(crate) fn offered(&self, create: u64) -> &[(u64, CString)] {
        match &self.swapchain_provider {
            Some(provider) if create & EFFECT == SWAPCHAIN_EFFECT => std::slice::from_ref(provider),
            _ => &self.providers,
        }
    }

    /// Whether it implements an effect; swap chains belong to frame generation.
    pub(crate) fn has(&self, effect: u64) -> bool {
        self.effects.contains(&if effect == SWAPCHAIN_EFFECT { 0x2_0000 } else { effect })
    }
}

fn number(text: &str) -> Result<u64, String> {
    u64::from_str_radix(text.trim_start_matches("0x"), 16).map_err(|e| format!("{text}: {e}"))
}

fn name(text: &str) -> Result<CString, String> {
    CString::new(text).map_err(|e| e.to_string())
}

/// The path of this library's file.
fn own_file() -> Result<PathBuf, String> {
    let here = own_file as fn() -> Result<PathBuf, String> as *const u16;
    let flags = GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT;
    let mut module = HMODULE::default();
    // SAFETY: an address in this module, and memory for the handle.
    unsafe { GetModuleHandleExW(flags, PCWSTR(here), &mut module) }.map_err(|e| e.to_string())?;
    let mut name = vec![0; 1 << 15];
    // SAFETY: a loaded module, and the slice's memory.
    let length = unsafe { GetModuleFileNameW(Some(module), &mut name) } as usize;
    Ok(String::from_utf16_lossy(&name[..length]).into())
}
