//! The machine's description in the report.

use super::Settings;
use crate::report::{Adapter, Machine};

/// The machine with its adapters. Makes a device on each.
pub fn describe(settings: &Settings) -> Machine {
    let adapters = adapters();
    let first =
        adapters.iter().position(|adapter| !adapter.software).or(if adapters.is_empty() { None } else { Some(0) });
    // An adapter that is not there is not judged.
    let judged = settings.adapter.map_or(first, |index| (index < adapters.len()).then_some(index));
    let emulated = judged.is_some_and(|index| adapters[index].software) || is_wine();
    Machine { adapters, judged, emulated, ..without_adapters() }
}

/// Whether Wine runs the program.
#[cfg(windows)]
fn is_wine() -> bool {
    cairn::gpu::System::current().wine.is_some()
}

/// Not on other systems.
#[cfg(not(windows))]
fn is_wine() -> bool {
    false
}

/// The machine as the system describes it.
pub fn without_adapters() -> Machine {
    let mut machine = Machine {
        system: system(),
        processor: "unknown".to_owned(),
        threads: std::thread::available_parallelism().map_or(0, usize::from),
        ..Machine::default()
    };
    if let Ok(mut found) = sysinfo::System::new() {
        found.refresh_cpu_list(sysinfo::CpuRefreshKind::nothing());
        found.refresh_memory_specifics(sysinfo::MemoryRefreshKind::nothing().with_ram());
        if let Some(brand) = found.cpus().first().map(|cpu| cpu.brand().trim()).filter(|brand| !brand.is_empty()) {
            machine.processor = brand.to_owned();
        }
        machine.memory = found.total_memory();
    }
    machine
}

/// The adapters with Direct3D 12.
#[cfg(windows)]
pub fn adapters() -> Vec<Adapter> {
    let all = cairn::gpu::adapters().unwrap_or_default().into_iter();
    // Wine gives adapters that it does not know the name of another.
    let by = if is_wine() { " (by Wine, which may invent the name)" } else { "" };
    all.map(|adapter| {
        let gpu = cairn::gpu::Gpu::on_adapter(Some(adapter.luid)).ok();
        Adapter {
            name: format!("{}{by}", adapter.description),
            ids: [adapter.vendor, adapter.device],
            memory: adapter.memory,
            driver: adapter.driver,
            software: adapter.software,
            feature_level: gpu.as_ref().and_then(super::there::feature_level),
            shader_model: gpu.as_ref().and_then(super::there::shader_model),
        }
    })
    .collect()
}

/// None on other systems.
#[cfg(not(windows))]
pub fn adapters() -> Vec<Adapter> {
    Vec::new()
}

/// The operating system, such as `Windows 10.0.22631`.
#[cfg(windows)]
fn system() -> String {
    let cairn::gpu::System { build, wine } = cairn::gpu::System::current();
    let build = build.map(|[major, minor, build]| format!(" {major}.{minor}.{build}")).unwrap_or_default();
    let wine = wine.map(|version| format!(", by Wine {version}")).unwrap_or_default();
    format!("Windows{build}{wine}")
}

/// The operating system, such as `linux, 6.1.0`.
#[cfg(not(windows))]
fn system() -> String {
    let kernel = std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    format!("{}, {}", std::env::consts::OS, kernel.trim())
}
