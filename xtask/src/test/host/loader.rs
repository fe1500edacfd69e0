//! `include/cairn_ld.h`: every compiler accepts it, a complete library loads by it, and an incomplete one is refused with a message.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::{HostSetup, check_compiles};
use crate::abi::{declarations, header, loader};
use crate::shell::Log;
use crate::test::tally::Tally;
use crate::test::{Context, abi};

const PROGRAM: &str = "tests/host/loader.c";
const STAND_IN: &str = "tests/host/stand_in.c";

pub(super) fn run(context: &Context<'_>, log: &mut Log, setup: &HostSetup, tally: &mut Tally) -> Result<(), String> {
    let workspace = context.workspace;
    let declared = declarations::read(&workspace.read(header::HEADER)?)?;
    let committed = workspace.read(loader::LOADER)?;
    let differs = loader::with_lists(&committed, &declared)? != committed;
    tally.check(differs.then(|| format!("{} lists other functions; cargo xtask fix --abi writes it", loader::LOADER)));
    let source = workspace.root.join(PROGRAM);
    for compiler in abi::available_compilers(tally) {
        check_compiles(log, &compiler, &setup.include, &source, tally)?;
    }

    let program = setup.work.join("loader");
    let mut compile = setup.compile();
    compile.arg(&source).arg("-o").arg(&program);
    // Part of the C library since glibc 2.34.
    compile.args(if cfg!(target_os = "linux") { &["-ldl"][..] } else { &[] });
    if !log.run(&mut compile)?.success {
        tally.failures.push(format!("{PROGRAM} does not compile"));
        return Ok(());
    }
    let world = context.bundle("tiny")?;
    for case in cases(context, log, setup)? {
        let mut command = Command::new(&program);
        command.arg(&case.library).arg(&world).current_dir(&setup.work);
        context.provide_worlds(&mut command)?;
        let ended = log.run(&mut command)?;
        let first = ended.output.lines().next().unwrap_or_default();
        let (code, message) = first.split_once(' ').unwrap_or((first, ""));
        let lacks = case.message_parts.iter().find(|part| !message.contains(**part));
        let fine = ended.success && code == case.result && lacks.is_none() && (code != "0" || message.is_empty());
        tally.test(
            (!fine).then(|| format!("{}: {first:?}, not {} with {:?}", case.name, case.result, case.message_parts)),
        );
    }
    Ok(())
}

/// A library to load, and the expected result.
struct Case {
    name: &'static str,
    library: PathBuf,
    /// The printed result: the value of `CAIRN_OK`, `CAIRN_ERROR_IO` and so on.
    result: &'static str,
    /// Parts of the expected message.
    message_parts: &'static [&'static str],
}

fn cases(context: &Context<'_>, log: &mut Log, setup: &HostSetup) -> Result<Vec<Case>, String> {
    let text = setup.work.join("text.so");
    std::fs::write(&text, "no library").map_err(|e| format!("{}: {e}", text.display()))?;
    // A library in the current folder, named without a folder.
    let bare = format!("{}here{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    std::fs::copy(&setup.library, setup.work.join(&bare)).map_err(|e| format!("{bare}: {e}"))?;
    let mut make = |name: &str, defines: &[&str]| stand_in(context, log, setup, name, defines);
    let this = "-DSTAND_IN_ABI=CAIRN_ABI_VERSION";
    Ok(vec![
        Case { name: "the whole library", library: setup.library.clone(), result: "0", message_parts: &[] },
        Case { name: "a bare name", library: bare.into(), result: "0", message_parts: &[] },
        Case { name: "no path", library: PathBuf::new(), result: "-1", message_parts: &["path: ", "Give a cairn_ld"] },
        Case {
            name: "no file",
            library: setup.work.join("nowhere.so"),
            result: "-7",
            message_parts: &["nowhere.so: ", "cannot be loaded", "Put "],
        },
        Case { name: "no library", library: text, result: "-7", message_parts: &["text.so: ", "cannot be loaded"] },
        Case {
            name: "another library",
            library: make("other", &[])?,
            result: "-5",
            message_parts: &["no Cairn library", "cairn_abi_version"],
        },
        Case {
            name: "another binary interface",
            library: make("interface", &["-DSTAND_IN_ABI=CAIRN_ABI_VERSION+1", "-DSTAND_IN_VERSION=CAIRN_VERSION"])?,
            result: "-5",
            message_parts: &["cairn_abi_version is ", "compiled for"],
        },
        Case {
            name: "an older version",
            library: make("older", &[this, "-DSTAND_IN_VERSION=CAIRN_VERSION-1"])?,
            result: "-5",
            message_parts: &["cairn_version is ", "not older"],
        },
        Case {
            name: "an incomplete library",
            library: make("incomplete", &[this, "-DSTAND_IN_VERSION=CAIRN_VERSION"])?,
            result: "-5",
            message_parts: &["has no cairn_result_name"],
        },
        Case {
            name: "no version",
            library: make("unversioned", &[this])?,
            result: "-5",
            message_parts: &["has no cairn_version"],
        },
    ])
}

/// A small library with some of Cairn's functions.
fn stand_in(
    context: &Context<'_>,
    log: &mut Log,
    setup: &HostSetup,
    name: &str,
    defines: &[&str],
) -> Result<PathBuf, String> {
    let library = setup.work.join(format!("{name}{}", std::env::consts::DLL_SUFFIX));
    let mut command = setup.compile();
    command.args(["-shared", "-fPIC", "-include", "cairn.h"]).args(defines);
    command.arg(context.workspace.root.join(Path::new(STAND_IN))).arg("-o").arg(&library);
    if log.run(&mut command)?.success { Ok(library) } else { Err(format!("{STAND_IN} does not compile as {name}")) }
}
