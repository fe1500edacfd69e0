//! The process of a test program.

/// Resident memory of this process, in bytes.
pub fn resident_memory() -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").expect("the process's status");
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("its resident size");
    line.trim().trim_end_matches("kB").trim().parse::<u64>().expect("a number") * 1024
}
