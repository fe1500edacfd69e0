//! Vulkan's validation layer below Direct3D 12 in the lab: tests of the library run over it, and each message that calls without the library do
//! not cause is a failure. Mutants of the library's calls must cause such messages.

mod known;
pub(super) mod messages;

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use provision::Console;

use super::amd::Amd;
use super::tally::{Skip, Tally};
use super::{Context, windows_build};
use crate::shell::{CommandOutput, Log};
use known::{KnownMessages, LIST};
use messages::{Message, separate};

/// Frames of the library, mutants of its calls, and calls without it.
const OWN_PROGRAM: &str = "d3d12_validation";
/// Its test that mutants alter.
const MUTATED: &str = "frames_in_flight_read_what_earlier_dispatches_write";

/// The variable that names a mutant for [`OWN_PROGRAM`].
const MUTANT: &str = "CAIRN_VALIDATION_MUTANT";

/// Mutants of the library's calls, and the rule that the layer must report for each.
const MUTANTS: [(&str, &str); 5] = [
    ("uav-barrier-dropped", "SYNC-HAZARD-READ-AFTER-WRITE"),
    ("wrong-state", "VUID-VkImageMemoryBarrier-oldLayout-01197"),
    ("read-while-written", "VUID-VkImageMemoryBarrier-oldLayout-01197"),
    ("descriptor-overwritten", "VUID-vkQueueSubmit-pCommandBuffers-00070"),
    ("view-out-of-bounds", "VUID-VkBufferViewCreateInfo-offset-00931"),
];

/// A mutant that the layer cannot see: it instruments no access to texel buffers, which vkd3d makes of Direct3D's raw buffers.
const UNSEEN: &str = "access-out-of-bounds";

/// Programs of every run. Their tests load no world.
const SHORT: [&str; 5] = ["d3d12", "d3d12_flow", "d3d12_generator", "d3d12_presenter", "d3d12_shaders"];

/// More programs.
const LONG: [&str; 4] = ["d3d12_drawer", "d3d12_libraries", "d3d12_prepare", "host"];
/// Their tests that are left out: those with a world, which [`Heaps::Copied`] excludes, and those of Unity's test double, which make wrong calls.
const LEFT_OUT: [&str; 3] = ["frames_of_a_rollout_equal_the_processors", "late::", "strictness::"];
/// Programs whose tests load worlds.
const WORLDS: [&str; 6] =
    ["d3d12_drawer", "d3d12_interface", "d3d12_lifecycle", "d3d12_memory", "d3d12_residency", "directml"];

/// How vkd3d represents descriptor heaps.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Heaps {
    /// A Vulkan descriptor set per dispatch, with copies of its descriptors. Only in these does the layer check accesses of shaders. DirectML
    /// crashes with them.
    Copied,
    /// One Vulkan descriptor set per heap, as without the layer. The layer's instrumentation of shaders is invalid with them, and is off.
    Whole,
}

impl Heaps {
    /// Content of `vk_layer_settings.txt`.
    fn settings(self) -> String {
        // Without a limit, since a known message could use it up for an unknown one of the same rule.
        let common = [
            ("message_format_json", "true"),
            ("report_flags", "error,warn"),
            ("enable_message_limit", "false"),
            ("validate_sync", "true"),
            ("syncval_shader_accesses_heuristic", "true"),
        ];
        let instrumented: &[_] = match self {
            Self::Copied => &[("gpuav_enable", "true"), ("gpuav_validate_ray_query", "false")],
            Self::Whole => &[],
        };
        let line = |(name, value): &(&str, &str)| format!("khronos_validation.{name} = {value}\n");
        common.iter().chain(instrumented).map(line).collect()
    }
}

/// The short form: calls without the library, mutants, and some programs.
pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let Some(validation) = Validation::new(context)? else { return Ok(skipped()) };
    let mut tally = Tally::default();
    let own = validation.run(&[OWN_PROGRAM], Heaps::Copied, &[], None, log)?;
    let not_shown = validation.known.not_shown(&own.messages);
    tally.test((!not_shown.is_empty()).then(|| {
        format!("the layer is not active, or these entries of {LIST} are no longer needed: {}", not_shown.join("; "))
    }));
    tally.add(validation.judge(own));
    for (mutant, id) in MUTANTS {
        let found = validation.mutant(mutant, log)?;
        let is_seen = found.iter().any(|line| line.contains(id));
        tally.test((!is_seen).then(|| format!("mutant {mutant}: the layer reports no {id}, but {found:?}")));
    }
    let found = validation.mutant(UNSEEN, log)?;
    tally.test((!found.is_empty()).then(|| format!("the layer sees mutant {UNSEEN} by now: demand it: {found:?}")));
    tally.add(validation.judge(validation.run(&SHORT, Heaps::Copied, &[], None, log)?));
    Ok(tally)
}

/// The programs that the short form leaves out.
pub(super) fn run_all(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let Some(validation) = Validation::new(context)? else { return Ok(skipped()) };
    let skip: Vec<_> = LEFT_OUT.into_iter().flat_map(|test| ["--skip", test]).collect();
    let mut tally = validation.judge(validation.run(&LONG, Heaps::Copied, &skip, None, log)?);
    tally.add(validation.judge(validation.run(&WORLDS, Heaps::Whole, &[], None, log)?));
    Ok(tally)
}

fn skipped() -> Tally {
    let name = "Direct3D 12 over Vulkan's validation layer".to_owned();
    let reason = match provision::lab::possible() {
        Err(why) => format!("needs lab: {why}"),
        Ok(()) => "needs lab".to_owned(),
    };
    Tally { skips: vec![Skip { name, reason }], ..Tally::default() }
}

/// The layer, and the messages that are not the library's.
struct Validation<'a> {
    context: &'a Context<'a>,
    layer: PathBuf,
    known: KnownMessages,
}

/// Tests that ran over the layer.
struct Ran {
    tally: Tally,
    messages: Vec<Message>,
}

impl<'a> Validation<'a> {
    /// `None` if this machine cannot have the lab.
    fn new(context: &'a Context<'a>) -> Result<Option<Self>, String> {
        if provision::lab::possible().is_err() {
            return Ok(None);
        }
        let known = KnownMessages::parse(&context.workspace.read(LIST)?)?;
        let console = Console::new();
        let lab = provision::lab::lab(&console).map_err(|e| e.to_string())?;
        let layer = lab.validation_layer(&console).map_err(|e| e.to_string())?;
        Ok(Some(Self { context, layer, known }))
    }

    /// Runs test programs, or some of their tests as `chosen` says, one test at a time.
    fn run(
        &self,
        programs: &[&str],
        heaps: Heaps,
        chosen: &[&str],
        mutant: Option<&str>,
        log: &mut Log,
    ) -> Result<Ran, String> {
        let mut command = self.context.windows_tests(programs.iter().copied(), log)?;
        command.args(["--", "--test-threads=1"]).args(chosen);
        self.context.provide_windows_worlds(&mut command)?;
        Amd::None.provide(&mut command);
        self.provide(&mut command, heaps)?;
        match mutant {
            Some(mutant) => command.env(MUTANT, mutant),
            None => command.env_remove(MUTANT),
        };
        let CommandOutput { success, output } = log.run(&mut command)?;
        let (output, messages) = separate(&output)?;
        Ok(Ran { tally: windows_build::judge(&CommandOutput { success, output }, &[]), messages })
    }

    /// Makes programs of a command load the layer.
    fn provide(&self, command: &mut Command, heaps: Heaps) -> Result<(), String> {
        let folder = self.context.workspace.target.join("xtask").join(format!("validation-{heaps:?}"));
        let file = folder.join("vk_layer_settings.txt");
        fs::create_dir_all(&folder)
            .and_then(|()| fs::write(&file, heaps.settings()))
            .map_err(|e| format!("{}: {e}", file.display()))?;
        command.env("VK_ADD_LAYER_PATH", &self.layer).env("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation");
        command.env("VK_LAYER_SETTINGS_PATH", file);
        match heaps {
            Heaps::Copied => windows_build::copy_descriptors(command),
            Heaps::Whole => _ = command.env("VKD3D_CONFIG", ""),
        }
        Ok(())
    }

    /// The counts, with a failure for each kind of unknown message of each test.
    fn judge(&self, ran: Ran) -> Tally {
        let Ran { mut tally, messages } = ran;
        tally.failures.extend(self.known.unknown(&messages).into_iter().map(|line| {
            format!(
                "{line}. Mend the call; if calls without the library cause it as well, add them to \
                 tests/{OWN_PROGRAM}/system_calls.rs and the message to {LIST}"
            )
        }));
        tally
    }

    /// The unknown messages of a mutant.
    fn mutant(&self, mutant: &str, log: &mut Log) -> Result<Vec<String>, String> {
        let ran = self.run(&[OWN_PROGRAM], Heaps::Copied, &["--exact", MUTATED], Some(mutant), log)?;
        match ran.tally.passed + ran.tally.failures.len() {
            0 => Err(format!("mutant {mutant}: {MUTATED} did not run")),
            _ => Ok(self.known.unknown(&ran.messages)),
        }
    }
}
