//! System, processor and memory.

use cairn::Result;
use sysinfo::{CpuRefreshKind, MemoryRefreshKind};

use crate::outcome::{Better, Outcome};
use crate::settings::Settings;

/// Least memory for the embedded world on the processor beside a game, in bytes.
const MEMORY: u64 = 4 << 30;

pub(super) fn run(_: &Settings) -> Result<Outcome> {
    let mut cores = 0;
    let (mut processor, mut memory, mut available) = (None, 0, 0);
    if let Ok(mut system) = sysinfo::System::new() {
        system.refresh_cpu_list(CpuRefreshKind::nothing());
        system.refresh_memory_specifics(MemoryRefreshKind::nothing().with_ram());
        cores = system.cpus().len();
        processor = system.cpus().first().map(|cpu| cpu.brand().trim().to_owned());
        (memory, available) = (system.total_memory(), system.available_memory());
    }
    let processor = processor.filter(|name| !name.is_empty()).unwrap_or_else(|| "a processor without a name".into());
    let os = os();
    let found = format!("{os} on {processor}, {cores} threads, {:.1} GiB", gibibytes(memory));
    let outcome = match memory {
        0 => Outcome::cannot_tell(format!("{found}: the system does not report its memory"), "Update the system"),
        1..MEMORY => Outcome::fail(
            format!("{found}: that is less than {:.0} GiB", gibibytes(MEMORY)),
            "Use a machine with more memory",
        ),
        _ => Outcome::pass(found),
    };
    Ok(outcome
        .fact("system", os)
        .fact("architecture", std::env::consts::ARCH)
        .fact("processor", processor)
        .fact("threads", cores.to_string())
        .fact("optimised build", if cfg!(debug_assertions) { "no" } else { "yes" })
        .figure("memory", gibibytes(memory), "GiB", Better::Neither)
        .figure("available memory", gibibytes(available), "GiB", Better::Neither))
}

fn gibibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 30)
}

/// Name and version, e.g. `Windows 10.0.22631`.
#[cfg(windows)]
fn os() -> String {
    let cairn::gpu::System { build, wine } = cairn::gpu::System::current();
    let build = build.map(|[major, minor, build]| format!(" {major}.{minor}.{build}")).unwrap_or_default();
    let wine = wine.map(|version| format!(", played by Wine {version}")).unwrap_or_default();
    format!("Windows{build}{wine}")
}

/// Name and version, e.g. `Debian GNU/Linux 12`.
#[cfg(not(windows))]
fn os() -> String {
    sysinfo::System::long_os_version().unwrap_or_else(|_| std::env::consts::OS.to_owned())
}
