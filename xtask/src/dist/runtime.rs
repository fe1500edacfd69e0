//! Components that compilers add to a library or program besides crates: Rust's standard library, and the linked parts of the C library and
//! the unwinder. They are read from its symbols, so that none goes unnamed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use object::read::elf::ElfFile64;
use object::read::pe::PeFile64;
use object::{Object, ObjectSymbol, SymbolKind};
use provision::{Console, tools};

use super::Platform;
use super::dependencies::{Kind, Part};
use crate::shell::output;
use crate::workspace::Workspace;

/// Rust's own list of its standard library's components, with all notices, beside the page of parts.
pub(super) const RUST_NOTICES: &str = "THIRD-PARTY-RUST.html";

/// The same file, as bytes.
pub(super) fn rust_notices(workspace: &Workspace) -> Result<Vec<u8>, String> {
    let sysroot = output(Command::new("rustc").args(["--print", "sysroot"]).current_dir(&workspace.root))?;
    let page = Path::new(sysroot.trim()).join("share/doc/rust/COPYRIGHT-library.html");
    fs::read(&page).map_err(|e| format!("{}: {e}. Take Rust by rustup, which brings that page along", page.display()))
}

/// The runtime parts of a library or program, from the symbols in `debug`: its debug file, or the file before it was stripped.
pub(super) fn parts(workspace: &Workspace, platform: Platform, debug: &[u8]) -> Result<Vec<Part>, String> {
    let mut parts = vec![standard_library(workspace)?];
    match platform {
        Platform::Linux => {
            let sources = tools::zig_sources(&Console::new()).map_err(|e| e.to_string())?;
            parts.extend(parts_from_zig(&c_sources(debug)?, &sources)?);
        }
        Platform::Windows => parts.extend(parts_from_mingw(debug)?),
    }
    Ok(parts)
}

fn part(name: &str, version: &str, licence: &str, repository: &str, texts: BTreeMap<String, String>) -> Part {
    Part {
        kind: Kind::Runtime,
        name: name.to_owned(),
        version: version.to_owned(),
        licence: licence.to_owned(),
        description: None,
        repository: Some(repository.to_owned()),
        sha256: None,
        uses: Vec::new(),
        texts,
    }
}

fn standard_library(workspace: &Workspace) -> Result<Part, String> {
    let version_line = output(Command::new("rustc").arg("--version").current_dir(&workspace.root))?;
    let version =
        version_line.split_whitespace().nth(1).ok_or_else(|| format!("rustc's version is {version_line:?}"))?;
    Ok(part("rust-std", version, "MIT OR Apache-2.0", "https://github.com/rust-lang/rust", BTreeMap::new()))
}

/// Sources that zig compiles while it links, and their licence.
struct Origin {
    name: &'static str,
    licence: &'static str,
    repository: &'static str,
    /// Folder of the sources.
    folder: &'static str,
    /// The only files of that folder under this licence; without it all that no origin before it has.
    files: Option<&'static [&'static str]>,
    /// The licence file; without one, every source states its licence in its first comment.
    licence_file: Option<&'static str>,
    /// Text that the licence must contain, to recognise it.
    marker: &'static str,
}

const ORIGINS: [Origin; 3] = [
    Origin {
        name: "llvm-libunwind",
        licence: "Apache-2.0 WITH LLVM-exception",
        repository: "https://github.com/llvm/llvm-project",
        folder: "libunwind/src",
        files: None,
        licence_file: Some("libunwind/LICENSE.TXT"),
        marker: "LLVM Exceptions to the Apache 2.0 License",
    },
    // A constant, the only start file without the exception below. Every program that glibc starts contains it; libraries do not.
    Origin {
        name: "glibc-start",
        licence: "LGPL-2.1-or-later",
        repository: "https://sourceware.org/glibc/",
        folder: "libc/glibc/csu",
        files: Some(&["init.c"]),
        licence_file: None,
        marker: "GNU Lesser General Public\nLicense as published by the Free Software Foundation; either\nversion 2.1 of the License, or (at your option) any later version.",
    },
    Origin {
        name: "glibc-nonshared",
        licence: "LGPL-2.1-or-later WITH GCC-exception-2.0-note",
        repository: "https://sourceware.org/glibc/",
        folder: "libc/glibc",
        files: None,
        licence_file: None,
        marker: "permission to link the compiled version of this file with other\nprograms, and to distribute those programs without any restriction",
    },
];

/// The parts that the C `sources` in a library come from. A source of unknown origin is an error.
fn parts_from_zig(sources: &BTreeSet<String>, zig: &Path) -> Result<Vec<Part>, String> {
    let mut parts = Vec::new();
    let mut known = BTreeSet::new();
    for origin in &ORIGINS {
        let mut files = Vec::new();
        let is_wanted = |name: &&String| origin.files.is_none_or(|files| files.contains(&name.as_str()));
        let wanted = sources.difference(&known).filter(is_wanted).cloned().collect();
        find(&zig.join(origin.folder), &wanted, &mut files)?;
        if files.is_empty() {
            continue;
        }
        known.extend(files.iter().filter_map(|file| Some(file.file_name()?.to_string_lossy().into_owned())));
        let read = |path: &Path| fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()));
        let texts: BTreeMap<String, String> = match origin.licence_file {
            Some(terms) => [(terms.to_owned(), read(&zig.join(terms))?)].into(),
            None => files
                .iter()
                .map(|file| Ok((file.display().to_string(), head(&read(file)?))))
                .collect::<Result<_, String>>()?,
        };
        if let Some((file, _)) = texts.iter().find(|(_, text)| !text.contains(origin.marker)) {
            return Err(format!("{file} is in the library under other terms than {}", origin.licence));
        }
        parts.push(part(origin.name, &format!("zig-{}", tools::ZIG), origin.licence, origin.repository, texts));
    }
    let unknown: Vec<_> = sources.difference(&known).map(String::as_str).collect();
    if unknown.is_empty() {
        Ok(parts)
    } else {
        Err(format!("the library has in it, and no page names: {}", unknown.join(", ")))
    }
}

/// Adds files below `folder` whose name is in `names`.
fn find(folder: &Path, names: &BTreeSet<String>, found: &mut Vec<PathBuf>) -> Result<(), String> {
    let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
    let entries = fs::read_dir(folder).map_err(failed)?.collect::<Result<Vec<_>, _>>().map_err(failed)?;
    let mut paths: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            find(&path, names, found)?;
        } else if path.file_name().is_some_and(|name| names.contains(&*name.to_string_lossy())) {
            found.push(path);
        }
    }
    Ok(())
}

/// The comment at the start of a C source, without its comment marks.
fn head(source: &str) -> String {
    let comment =
        source.trim_start().strip_prefix("/*").and_then(|rest| rest.split_once("*/")).map_or("", |(text, _)| text);
    comment.lines().map(str::trim).collect::<Vec<_>>().join("\n").trim().to_owned()
}

/// Names of the C, C++ and assembly sources that a Linux library was compiled from; Rust's have no such extension.
fn c_sources(debug: &[u8]) -> Result<BTreeSet<String>, String> {
    let file =
        ElfFile64::<object::Endianness>::parse(debug).map_err(|e| format!("the built library is no ELF file: {e}"))?;
    let names = file.symbols().filter(|symbol| symbol.kind() == SymbolKind::File);
    let names: BTreeSet<String> = names.filter_map(|symbol| symbol.name().ok().map(str::to_owned)).collect();
    if names.is_empty() {
        return Err("the built library does not say what it was compiled from: its symbol table is missing".to_owned());
    }
    let is_c = |name: &String| {
        let ending = Path::new(name).extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        ["c", "cc", "cpp", "cxx", "s", "S", "zig"].contains(&ending)
    };
    Ok(names.into_iter().filter(is_c).collect())
}

/// Path of MinGW-w64's notices on Debian.
pub(crate) const MINGW_NOTICES: &str = "/usr/share/doc/mingw-w64-common/copyright";

/// MinGW-w64's start files and helpers, and GCC's unwinder. Their symbols must be there: MinGW's linker takes no other runtime.
fn parts_from_mingw(debug: &[u8]) -> Result<Vec<Part>, String> {
    let file = PeFile64::parse(debug).map_err(|e| format!("the built library is no DLL: {e}"))?;
    let names: BTreeSet<&str> = file.symbols().filter_map(|symbol| symbol.name().ok()).collect();
    for wanted in ["_pei386_runtime_relocator", "_Unwind_RaiseException"] {
        if !names.contains(wanted) {
            return Err(format!("the built DLL has no {wanted}: what is linked into it is not what is named"));
        }
    }
    let compiler = || Command::new("x86_64-w64-mingw32-gcc");
    let macros = output(compiler().args(["-E", "-dM", "-include", "_mingw.h", "-x", "c", "/dev/null"]))?;
    let value = |name: &str| {
        let line = macros.lines().find_map(|line| line.strip_prefix("#define ")?.strip_prefix(name)?.strip_prefix(' '));
        line.map(str::to_owned).ok_or_else(|| format!("MinGW-w64 says no {name}"))
    };
    let version = format!("{}.{}", value("__MINGW64_VERSION_MAJOR")?, value("__MINGW64_VERSION_MINOR")?);
    let gcc = output(compiler().arg("-dumpfullversion"))?;
    let notices = fs::read_to_string(MINGW_NOTICES).map_err(|e| {
        format!("{MINGW_NOTICES}: {e}. The archive must have MinGW-w64's notices: apt install mingw-w64-common")
    })?;
    Ok(vec![
        part("mingw-w64", &version, "ZPL-2.1", "https://www.mingw-w64.org", [("copyright".to_owned(), notices)].into()),
        part("libgcc", gcc.trim(), "GPL-3.0-or-later WITH GCC-exception-3.1", "https://gcc.gnu.org", BTreeMap::new()),
    ])
}

#[cfg(test)]
mod tests {
    use object::elf::{SHN_ABS, SHT_STRTAB, SHT_SYMTAB, STT_FILE, STT_FUNC, SymbolType};

    use super::*;

    /// A folder with a small copy of zig's sources, as far as these tests need them.
    fn zig(name: &str, glibc: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("cairn-runtime-{name}-{}", std::process::id()));
        for (file, text) in [
            ("libunwind/src/libunwind.cpp", "// code"),
            ("libunwind/LICENSE.TXT", "---- LLVM Exceptions to the Apache 2.0 License ----\n"),
            ("libc/glibc/io/stat64-2.32.c", glibc),
            ("libc/glibc/csu/init.c", START),
        ] {
            let path = folder.join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        folder
    }

    fn named(names: &[&str]) -> BTreeSet<String> {
        names.iter().map(|name| (*name).to_owned()).collect()
    }

    const EXCEPTION: &str = "/* Copyright of someone.\n   The owner gives unlimited\n   permission to link the compiled version of this file with other\n   \
                             programs, and to distribute those programs without any restriction\n   coming from it.  */\n#include <a.h>\n/* b */\n";

    #[test]
    fn linked_parts_are_named_with_their_licences_and_unknown_ones_are_refused() {
        let folder = zig("named", EXCEPTION);
        let both = parts_from_zig(&named(&["libunwind.cpp", "stat64-2.32.c"]), &folder).unwrap();
        let named_parts: Vec<_> = both.iter().map(|part| (part.name.as_str(), part.licence.as_str())).collect();
        assert_eq!(
            named_parts,
            [
                ("llvm-libunwind", "Apache-2.0 WITH LLVM-exception"),
                ("glibc-nonshared", "LGPL-2.1-or-later WITH GCC-exception-2.0-note")
            ]
        );
        let text = both[1].texts.values().next().unwrap();
        assert!(text.starts_with("Copyright of someone.\nThe owner") && text.ends_with("coming from it."), "{text}");
        assert!(parts_from_zig(&named(&[]), &folder).unwrap().is_empty());
        let unknown = parts_from_zig(&named(&["libunwind.cpp", "inflate.c"]), &folder).unwrap_err();
        assert!(unknown.contains("inflate.c") && !unknown.contains("libunwind.cpp"), "{unknown}");
        fs::remove_dir_all(folder).unwrap();
    }

    const START: &str = "/* Special startup support.\n   The GNU C Library is free software; you can redistribute it under the terms of the GNU Lesser General Public\n   \
                         License as published by the Free Software Foundation; either\n   version 2.1 of the License, or (at your option) any later \
                         version.  */\nconst int a = 1;\n";

    #[test]
    fn the_start_file_of_programs_is_named_apart() {
        let folder = zig("start", EXCEPTION);
        let parts = parts_from_zig(&named(&["init.c", "stat64-2.32.c"]), &folder).unwrap();
        let found: Vec<_> = parts.iter().map(|part| (part.name.as_str(), part.licence.as_str())).collect();
        assert_eq!(found[0], ("glibc-start", "LGPL-2.1-or-later"));
        assert_eq!(found[1].0, "glibc-nonshared");
        assert!(found.len() == 2 && parts[0].texts.values().all(|text| text.contains("Lesser General Public")));
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_glibc_file_without_the_linking_exception_is_refused() {
        let folder = zig("refused", "/* Copyright of someone. All of the LGPL holds. */");
        let refused = parts_from_zig(&named(&["stat64-2.32.c"]), &folder).unwrap_err();
        assert!(refused.contains("stat64-2.32.c") && refused.contains("other terms"), "{refused}");
        fs::remove_dir_all(folder).unwrap();
    }

    /// A 64-bit ELF file with a symbol table alone: names and types of local symbols. Layouts: the System V ABI's chapters 4 and 5.
    fn elf(symbols: &[(&str, SymbolType)]) -> Vec<u8> {
        const HEADER: usize = 64;
        let (mut table, mut names) = (vec![0; 24], vec![0]);
        for (name, kind) in symbols {
            table.extend((names.len() as u32).to_le_bytes());
            table.extend([kind.0, 0]);
            table.extend(SHN_ABS.0.to_le_bytes());
            table.extend([0; 16]);
            names.extend(name.bytes().chain([0]));
        }
        names.resize(names.len().next_multiple_of(8), 0);
        let sections = [
            (0, 0, 0, 0, 0),
            // Its names are in section 2.
            (SHT_SYMTAB.0, HEADER, table.len(), 2, 24),
            (SHT_STRTAB.0, HEADER + table.len(), names.len(), 0, 0),
        ];
        let mut file = b"\x7fELF\x02\x01\x01".to_vec();
        file.resize(16, 0);
        // A shared library for x86-64, of version 1, without an entry point and program headers.
        file.extend([3_u16, 62, 1, 0].iter().flat_map(|v| v.to_le_bytes()));
        file.extend([0, 0, (HEADER + table.len() + names.len()) as u64].iter().flat_map(|v: &u64| v.to_le_bytes()));
        file.extend([0, 0, 64, 0, 0, 64, sections.len() as u16, 2].iter().flat_map(|v: &u16| v.to_le_bytes()));
        file.extend(table.into_iter().chain(names));
        for (kind, offset, size, link, entry) in sections {
            file.extend([0, kind].iter().flat_map(|v: &u32| v.to_le_bytes()));
            file.extend([0, 0, offset as u64, size as u64].iter().flat_map(|v: &u64| v.to_le_bytes()));
            file.extend([link, 0].iter().flat_map(|v: &u32| v.to_le_bytes()));
            file.extend([1, entry].iter().flat_map(|v: &u64| v.to_le_bytes()));
        }
        file
    }

    #[test]
    fn c_sources_are_read_from_the_symbol_table() {
        let files = [("a.c", STT_FILE), ("b.rs", STT_FILE), ("b.1f-cgu.0", STT_FILE), ("start.S", STT_FILE)];
        let file = elf(&[&files[..], &[("function.c", STT_FUNC)]].concat());
        assert_eq!(c_sources(&file), Ok(named(&["a.c", "start.S"])));
        assert!(c_sources(&elf(&[("a.c", STT_FUNC)])).unwrap_err().contains("symbol table is missing"));
        assert!(c_sources(b"not a library").is_err());
    }
}
