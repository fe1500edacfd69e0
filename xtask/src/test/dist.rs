//! Archives: packing twice gives the same bytes, they contain what their pages list, hosts are built and run from them alone, and their
//! `cairn-check` judges this machine.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use provision::{Console, tools};

use super::Context;
use super::archive;
use super::archive_check;
use super::host;
use super::lab;
use super::tally::{Skip, Tally};
use crate::book;
use crate::dist::{self, PackedFile, Parts, Platform, Source};
use crate::shell::{Log, output};
use crate::workspace;

/// The platforms that archives are made for.
const BOTH: [Platform; 2] = [Platform::Windows, Platform::Linux];

/// Archives are unpacked below this folder: its name has a space and a letter that is not Latin.
const UNPACKED: &str = "a folder Ж";

/// A minimal host: checks that the linked library has the header's version.
const HOST: &str = "#include \"cairn.h\"\n\nint main(void)\n{\n    return cairn_version() == CAIRN_VERSION && \
                    cairn_abi_version() == CAIRN_ABI_VERSION ? 0 : 3;\n}\n";

/// The same as a program without a C library.
const BARE_HOST: &str =
    "#include \"cairn.h\"\n\nint start(void)\n{\n    return cairn_version() == CAIRN_VERSION ? 0 : 3;\n}\n";

/// A CMake project that finds the archive.
const CMAKE_PROJECT: &str = "cmake_minimum_required(VERSION 3.16)\nproject(game LANGUAGES C)\nfind_package(Cairn 0.1 REQUIRED)\n\
                       add_executable(game game.c)\ntarget_link_libraries(game PRIVATE Cairn::Cairn)\n\
                       if(WIN32)\n    add_custom_command(TARGET game POST_BUILD COMMAND ${CMAKE_COMMAND} -E copy_if_different\n        \
                       $<TARGET_FILE:Cairn::Cairn> ${Cairn_RUNTIME_FILES} $<TARGET_FILE_DIR:game>)\nendif()\n";

pub(super) fn run(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    let skip = |name: &str, reason: &str| Skip { name: name.to_owned(), reason: reason.to_owned() };
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        tally.skips.push(skip("archives", "needs linux: they are made on Linux on x86-64"));
        return Ok(tally);
    }
    let (Some(cmake), Some(cc)) = (tools::cmake(&Console::new()), tools::on_path("cc")) else {
        tally.skips.push(skip("archives", "needs cmake and cc: apt install cmake gcc"));
        return Ok(tally);
    };
    if let Some(skip) = lab::skip_without_mingw("archives")? {
        tally.skips.push(skip);
        return Ok(tally);
    }
    context.build_programs(log)?;
    context.build_for_windows(log)?;
    let work = fresh(context, "dist")?;
    let made = [work.join("first"), work.join("second")]
        .map(|folder| dist::make(context.workspace, &BOTH, Parts::Archives, Source::Tests, &folder));
    let [first, second] = made;
    let first = first?;
    for (one, other) in first.iter().zip(second?) {
        let differs = one.sha256 != other.sha256;
        tally.check(differs.then(|| format!("{} is another file the second time", one.path.display())));
    }
    let sums = log.run(Command::new("sha256sum").args(["--check", "SHA256SUMS"]).current_dir(work.join("first")))?;
    tally.check((!sums.success).then(|| "SHA256SUMS are not the archives'".to_owned()));
    let [windows, slim, linux] = first.as_slice() else {
        return Err(format!("{} archives were made, not three", first.len()));
    };
    let unpacked = work.join(UNPACKED);
    let unpack = |log: &mut Log, made: &PackedFile| unpack(log, &cmake, made, &unpacked);
    let (windows, slim, linux) = (unpack(log, windows)?, unpack(log, slim)?, unpack(log, linux)?);
    for root in [&windows, &slim] {
        tally.check(unity(root)?);
        tally.check(without_terms(root)?);
        tally.check(directml_without_terms(root)?);
    }
    for root in [&windows, &slim, &linux] {
        tally.check(missing_files(root)?);
        tally.check(forbidden_files(root)?);
        tally.check(missing_chapters(context, root)?);
        tally.check(dead_links(root)?);
    }
    for (root, linked) in [(&windows, ["mingw-w64", "libgcc"]), (&linux, ["llvm-libunwind", "glibc-nonshared"])] {
        tally.check(unlisted_parts(root, LIBRARY_LISTS, &["rust-std", linked[0], linked[1]])?);
        tally.check(unlisted_parts(root, CHECK_LISTS, &["rust-std", linked[0], "clap", "image"])?);
    }
    tally.check(unlisted_parts(&linux, CHECK_LISTS, &["glibc-start"])?);
    for file in ["lib/libcairn.so", "debug/libcairn.so.debug", "bin/cairn-check"] {
        tally.check(build_specific_text(&linux.join(file))?);
    }
    for library in [linux.join("lib/libcairn.so"), context.workspace.target.join("debug/libcairn.so")] {
        let bytes = fs::read(&library).map_err(|e| format!("{}: {e}", library.display()))?;
        let name = dist::soname(&bytes)?;
        let wrong = name.as_deref() != Some("libcairn.so");
        tally.check(wrong.then(|| format!("{} is named {name:?} for programs", library.display())));
    }
    let unity = "unity/com.cairn.unity/Plugins/x86_64/cairn_unity.dll";
    for file in ["bin/cairn.dll", "debug/cairn.dll.debug", "bin/cairn-check.exe", unity] {
        tally.check(build_specific_text(&windows.join(file))?);
    }
    tally.check((!windows.join("runtime/DirectML.dll").is_file()).then(|| "the runtimes are missing".to_owned()));
    tally.check(slim.join("runtime").exists().then(|| "the slim archive has runtimes".to_owned()));

    let builds = HostBuilds { context, work: &work, cmake: &cmake };
    builds.on_linux(log, &linux, &cc, &mut tally)?;
    archive_check::on_linux(context, log, &linux, &work, &mut tally)?;
    match lab::skip_unless_possible("hosts and cairn-check from the Windows archive")? {
        Some(skip) => tally.skips.push(skip),
        None => {
            builds.on_windows(log, &windows, &mut tally)?;
            archive_check::on_windows(context, log, [&windows, &slim], &work, &mut tally)?;
        }
    }
    Ok(tally)
}

/// Compares the release archives of this repository and of a clone of it, each compiled at its own path and with tools in its own cache.
pub(super) fn run_release(context: &Context<'_>, log: &mut Log) -> Result<Tally, String> {
    let mut tally = Tally::default();
    let work = fresh(context, "dist-release")?;
    let other = work.join("clone");
    let cloned =
        log.run(Command::new("git").args(["clone", "--quiet"]).arg(&context.workspace.root).arg(&other))?.success;
    if !cloned {
        return Err("the clone cannot be cloned".to_owned());
    }
    let here = dist::make(context.workspace, &BOTH, Parts::All, Source::Release, &work.join("here"))?;
    let mut command = Command::new(tools::cargo());
    command.args(["xtask", "dist", "--out"]).arg(work.join("there")).current_dir(&other);
    command.env("CARGO_TARGET_DIR", work.join("target")).env("CAIRN_CACHE_DIR", other_cache(&work)?);
    if !log.run(&mut command)?.success {
        return Err("the other clone makes no archives".to_owned());
    }
    for made in &here {
        let name = made.path.file_name().unwrap_or_default();
        let read = |path: &Path| fs::read(path).map_err(|e| format!("{}: {e}", path.display()));
        let differs = read(&made.path)? != read(&work.join("there").join(name))?;
        tally.check(differs.then(|| format!("{} is another file from another place", name.display())));
    }
    let wheels: Vec<&PackedFile> =
        here.iter().filter(|made| made.path.extension().is_some_and(|e| e == "whl")).collect();
    super::wheels::check(context, log, &work, &wheels, &mut tally)?;
    fs::remove_dir_all(&work).map_err(|e| format!("{}: {e}", work.display()))?;
    Ok(tally)
}

/// A second cache, as another user has one: its zig has compiled nothing yet, everything else is linked from this cache.
fn other_cache(work: &Path) -> Result<PathBuf, String> {
    let folder = work.join("another user");
    let own = folder.join("cairn");
    fs::create_dir_all(&own).map_err(|e| format!("{}: {e}", own.display()))?;
    let cache = provision::cache_dir().map_err(|e| e.to_string())?;
    let zig = tools::zigbuild(&Console::new()).map_err(|e| e.to_string())?;
    for entry in fs::read_dir(&cache).map_err(|e| format!("{}: {e}", cache.display()))? {
        let from = entry.map_err(|e| format!("{}: {e}", cache.display()))?.path();
        let into = own.join(from.file_name().unwrap_or_default());
        let [program, how] = if from == zig.folder() { ["cp", "-a"] } else { ["ln", "-s"] };
        output(Command::new(program).arg(how).arg(&from).arg(&into))?;
    }
    let objects = zig.objects();
    let relative = objects.strip_prefix(&cache).map_err(|e| format!("{}: {e}", objects.display()))?;
    workspace::remove(&own.join(relative))?;
    Ok(folder)
}

/// An empty folder for output.
pub(super) fn fresh(context: &Context<'_>, name: &str) -> Result<PathBuf, String> {
    let work = context.workspace.target.join("xtask").join("test").join(name);
    workspace::make_empty(&work)?;
    Ok(work)
}

/// Unpacks an archive with CMake, not with our own code; returns its top folder.
fn unpack(log: &mut Log, cmake: &Path, made: &PackedFile, into: &Path) -> Result<PathBuf, String> {
    fs::create_dir_all(into).map_err(|e| format!("{}: {e}", into.display()))?;
    let unpacked = log.run(Command::new(cmake).args(["-E", "tar", "xf"]).arg(&made.path).current_dir(into))?.success;
    let name = made.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let folder = into.join(name.trim_end_matches(".zip").trim_end_matches(".tar.gz"));
    if unpacked && folder.is_dir() {
        Ok(folder)
    } else {
        Err(format!("{name} does not unpack into a folder of its name"))
    }
}

/// Files that the first column of the page's table lists and the archive lacks. A slim archive has the full archive's page.
fn missing_files(root: &Path) -> Result<Option<String>, String> {
    let page = root.join("README.md");
    let text = fs::read_to_string(&page).map_err(|e| format!("{}: {e}", page.display()))?;
    let slim = root.to_string_lossy().ends_with("-slim");
    let named: Vec<&str> = text
        .lines()
        .filter_map(|line| line.strip_prefix("| `")?.split(" | ").next())
        .flat_map(|column| column.split('`').step_by(2))
        .filter(|name| !(slim && *name == "runtime/"))
        .collect();
    if named.len() < 8 {
        return Err(format!("{} has no table of files", page.display()));
    }
    let missing: Vec<_> = named.into_iter().filter(|name| !root.join(name).exists()).collect();
    Ok((!missing.is_empty()).then(|| format!("{} names {}", page.display(), missing.join(", "))))
}

/// Chapters of the book that an archive lacks.
fn missing_chapters(context: &Context<'_>, root: &Path) -> Result<Option<String>, String> {
    let chapters = book::chapters(&context.workspace.read(book::SUMMARY)?)?;
    let wanted = chapters.iter().filter(|chapter| chapter.starts_with("docs/"));
    // A whole run of the comparison is as large as the library, and the lab is for Cairn's developers.
    let missing: Vec<_> = wanted
        .filter(|chapter| !["docs/lab.md", "docs/report/report.md", "docs/sweeps/paper.md"].contains(&chapter.as_str()))
        .filter(|chapter| !root.join(chapter).is_file())
        .map(String::as_str)
        .collect();
    Ok((!missing.is_empty()).then(|| format!("{} has no {}", root.display(), missing.join(", "))))
}

/// Links in an archive's pages to files that it lacks.
fn dead_links(root: &Path) -> Result<Option<String>, String> {
    let mut dead = Vec::new();
    let mut alive = 0;
    for page in files(root)?.into_iter().filter(|path| path.extension().is_some_and(|ending| ending == "md")) {
        let text = fs::read_to_string(&page).map_err(|e| format!("{}: {e}", page.display()))?;
        for target in book::links(&text) {
            match page.with_file_name(target).exists() {
                true => alive += 1,
                false => dead.push(format!("{}: {target}", page.strip_prefix(root).unwrap_or(&page).display())),
            }
        }
    }
    if alive < 40 {
        return Ok(Some(format!("the pages of {} have {alive} links among each other", root.display())));
    }
    Ok((!dead.is_empty()).then(|| format!("links in {} lead to nothing: {}", root.display(), dead.join(", "))))
}

/// Names of the page of licences and of the bill of materials: of the library, and of `cairn-check`.
const LIBRARY_LISTS: [&str; 2] = ["THIRD-PARTY.md", "cairn.cdx.json"];
const CHECK_LISTS: [&str; 2] = ["THIRD-PARTY-CHECK.md", "cairn-check.cdx.json"];

/// Parts of the library or of `cairn-check` that the page of licences or the bill of materials does not name.
fn unlisted_parts(root: &Path, lists: [&str; 2], parts: &[&str]) -> Result<Option<String>, String> {
    let read = |name: &str| fs::read_to_string(root.join(name)).map_err(|e| format!("{name}: {e}"));
    let (page, bill) = (read(lists[0])?, read(lists[1])?);
    let in_bill = |part: &str| ["generic", "cargo"].iter().any(|kind| bill.contains(&format!("\"pkg:{kind}/{part}@")));
    let is_named = |part: &&&str| page.contains(&format!("\n| {part} ")) && in_bill(part);
    let missing: Vec<_> = parts.iter().filter(|part| !is_named(part)).copied().collect();
    if !read("THIRD-PARTY-RUST.html")?.contains("Copyright notices for The Rust Standard Library") {
        return Ok(Some("the archive has no notices of Rust's standard library".to_owned()));
    }
    Ok((!missing.is_empty()).then(|| format!("{} and {} do not name {}", lists[0], lists[1], missing.join(", "))))
}

/// The first string in a library or its debug information that would differ in another build: the path of this machine's cache, rustc's
/// temporary folders, and LLVM's numbers.
fn build_specific_text(debug: &Path) -> Result<Option<String>, String> {
    let cache = provision::cache_dir().map_err(|e| e.to_string())?;
    let bytes = fs::read(debug).map_err(|e| format!("{}: {e}", debug.display()))?;
    let numbered = || bytes.windows(7).position(|part| part.starts_with(b".llvm.") && part[6].is_ascii_digit());
    let found = [cache.as_os_str().as_encoded_bytes(), b"site-packages/ziglang", b"_deps_rustc"]
        .into_iter()
        .find_map(|text| bytes.windows(text.len()).position(|part| part == text))
        .or_else(numbered);
    Ok(found.map(|at| {
        let end = bytes[at..].iter().position(|&byte| byte == 0).map_or(bytes.len(), |length| at + length);
        format!("{} names {}", debug.display(), String::from_utf8_lossy(&bytes[at..end]))
    }))
}

/// Every file below a folder.
fn files(root: &Path) -> Result<Vec<PathBuf>, String> {
    let mut folders = vec![root.to_owned()];
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).map_err(|e| format!("{}: {e}", folder.display()))? {
            let path = entry.map_err(|e| format!("{}: {e}", folder.display()))?.path();
            if path.is_dir() { folders.push(path) } else { found.push(path) }
        }
    }
    Ok(found)
}

/// Files that must not be in an archive: AMD's, and our tests.
fn forbidden_files(root: &Path) -> Result<Option<String>, String> {
    let is_foreign =
        |part: &str| part.starts_with("amd_") || part.starts_with("ffx") || part == "tests" || part == "target";
    let mut found = Vec::new();
    for file in files(root)? {
        let inside = file.strip_prefix(root).unwrap_or(&file).to_string_lossy().to_lowercase();
        if inside.split('/').any(is_foreign) {
            found.push(inside);
        }
    }
    Ok((!found.is_empty()).then(|| format!("archives must not have {}", found.join(", "))))
}

/// The first error in the package for Unity: its plugin must export Unity's entry points and the whole library, and every file that Unity
/// reads must have a `.meta` file.
fn unity(root: &Path) -> Result<Option<String>, String> {
    let package = root.join("unity/com.cairn.unity");
    let plugin = package.join("Plugins/x86_64/cairn_unity.dll");
    let bytes = fs::read(&plugin).map_err(|e| format!("{}: {e}", plugin.display()))?;
    let exported = dist::exports(bytes.as_slice())?;
    let wanted =
        ["UnityPluginLoad", "UnityPluginUnload", "cairn_unity_state", "cairn_world_load", "cairn_presenter_create"];
    let mut missing: Vec<String> =
        wanted.iter().filter(|name| !exported.iter().any(|one| one == *name)).map(|name| (*name).to_owned()).collect();
    let files =
        ["package.json", "Runtime/Plugin.cs", "Runtime/Binding/Native.cs", "Runtime/Binding/Cairn.asmdef", "Plugins"];
    for file in files {
        let described = package.join(file).exists() && package.join(format!("{file}.meta")).is_file();
        missing.extend((!described).then(|| format!("{file} and its description")));
    }
    for file in ["Samples~/Walk/Place.bytes", "Documentation~/index.md"] {
        missing.extend((!package.join(file).is_file()).then(|| file.to_owned()));
    }
    Ok((!missing.is_empty()).then(|| format!("{} has not {}", package.display(), missing.join(", "))))
}

/// The library's licence files that a plugin's own folder lacks. A studio copies only that folder out of the archive.
fn without_terms(root: &Path) -> Result<Option<String>, String> {
    let mut missing = Vec::new();
    for name in dist::TERMS {
        let terms = fs::read(root.join(name)).map_err(|e| format!("{name}: {e}"))?;
        let copies = ["unity/com.cairn.unity", "unreal/Cairn"].map(|plugin| root.join(plugin).join(name));
        missing.extend(copies.into_iter().filter(|copy| fs::read(copy).ok().as_ref() != Some(&terms)));
    }
    Ok((!missing.is_empty()).then(|| format!("not the archive's own: {missing:?}")))
}

/// Copies of `DirectML.dll` that have another version than the page of its terms, or are without that page. ONNX Runtime's licence is beside them.
fn directml_without_terms(root: &Path) -> Result<Option<String>, String> {
    let mut wrong = Vec::new();
    let copies = files(root)?.into_iter().filter(|file| file.ends_with("DirectML.dll"));
    let version: Vec<u8> =
        format!("{}+", provision::DIRECTML_VERSION).encode_utf16().flat_map(u16::to_le_bytes).collect();
    let licence = format!("nuget.org/packages/Microsoft.AI.DirectML/{}/License", provision::DIRECTML_VERSION);
    for copy in copies {
        let bytes = fs::read(&copy).map_err(|e| format!("{}: {e}", copy.display()))?;
        let page = fs::read_to_string(copy.with_file_name(dist::DIRECTML_TERMS)).unwrap_or_default();
        let is_that_version = bytes.windows(version.len()).any(|part| part == version);
        if !is_that_version || !page.contains(&licence) {
            wrong.push(copy);
        }
    }
    Ok((!wrong.is_empty()).then(|| format!("not with the terms of their version: {wrong:?}")))
}

/// Folders and tools for building hosts.
struct HostBuilds<'a> {
    context: &'a Context<'a>,
    work: &'a Path,
    cmake: &'a Path,
}

impl HostBuilds<'_> {
    fn write(&self, folder: &str, name: &str, text: &str) -> Result<PathBuf, String> {
        let path = self.work.join(folder).join(name);
        fs::create_dir_all(self.work.join(folder)).map_err(|e| format!("{}: {e}", path.display()))?;
        fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok(path)
    }

    /// With CMake, the sample as its page says and a project that finds the package; with pkg-config, one file.
    fn on_linux(&self, log: &mut Log, root: &Path, cc: &Path, tally: &mut Tally) -> Result<(), String> {
        let build = self.work.join("host-c");
        let source = root.join("samples").join("host-c");
        let mut configure = Command::new(self.cmake);
        configure.arg("-S").arg(source).arg("-B").arg(&build).arg("-DCMAKE_C_FLAGS=-Werror");
        let built =
            log.run(&mut configure)?.success && log.run(Command::new(self.cmake).arg("--build").arg(&build))?.success;
        tally.test((!built).then(|| "host-c does not build from the archive".to_owned()));
        if built {
            let mut command = Command::new(build.join("host-c"));
            self.context.provide_worlds(command.current_dir(self.work))?;
            let (script, seed) = (root.join("samples/scripts/walk.txt"), root.join("samples/worlds/place.ppm"));
            command.arg("--script").arg(script).arg("--seed-picture").arg(seed);
            let ended = log.run(command.args(["--seconds", "0.2", "--out", "walk.y4m"]))?;
            let video = fs::read(self.work.join("walk.y4m")).unwrap_or_default();
            let wrong = !ended.success || !video.starts_with(b"YUV4MPEG2 W320 H180 ");
            tally.test(
                wrong.then(|| "host-c of the archive writes no video of the world inside the library".to_owned()),
            );
        }

        // CMake's own message would name a variable of the sample's file, not what to do.
        let nothing = self.work.join("nothing");
        fs::create_dir_all(&nothing).map_err(|e| format!("{}: {e}", nothing.display()))?;
        let mut configure = Command::new(self.cmake);
        configure.arg("-S").arg(root.join("samples/host-c")).arg("-B").arg(self.work.join("host-c-of-nothing"));
        let refused = log.run(configure.arg(format!("-DCAIRN_ROOT={}", nothing.display())))?;
        // It wraps its lines.
        let message = refused.output.split_whitespace().collect::<Vec<_>>().join(" ");
        let helps = !refused.success && message.contains("Set CAIRN_ROOT");
        tally.test((!helps).then(|| "host-c without Cairn does not say what to do".to_owned()));

        self.write("found", "game.c", HOST)?;
        let list = self.write("found", "CMakeLists.txt", CMAKE_PROJECT)?;
        let build = self.work.join("found-build");
        let mut configure = Command::new(self.cmake);
        configure.arg("-S").arg(list.with_file_name("")).arg("-B").arg(&build);
        configure.arg(format!("-DCMAKE_PREFIX_PATH={}", root.display()));
        let right = log.run(&mut configure)?.success
            && log.run(Command::new(self.cmake).arg("--build").arg(&build))?.success
            && log.run(&mut Command::new(build.join("game")))?.success;
        tally.test((!right).then(|| "a project that finds the package by CMake has no library".to_owned()));
        let mut later = Command::new(self.cmake);
        let wanted = self.write("later", "CMakeLists.txt", &CMAKE_PROJECT.replace("Cairn 0.1", "Cairn 0.2"))?;
        later.arg("-S").arg(wanted.with_file_name("")).arg("-B").arg(self.work.join("later-build"));
        let refused = log.run(later.arg(format!("-DCMAKE_PREFIX_PATH={}", root.display())))?;
        let named = refused.output.contains("CairnConfig.cmake, version: 0.1");
        tally.test((refused.success || !named).then(|| "a later version is found where this one is".to_owned()));

        self.with_library_beside(log, root, cc, tally)?;

        if tools::on_path("pkg-config").is_none() {
            let reason = "needs pkg-config: apt install pkg-config";
            tally.skips.push(Skip { name: "the archive by pkg-config".into(), reason: reason.into() });
            return Ok(());
        }
        let program = self.work.join("by-pkg-config");
        // `pkg-config` quotes its output for a shell, including the space in the folder's name.
        let script =
            r#"flags=$(pkg-config --cflags --libs cairn) && eval "\"\$1\" -std=c11 \"\$2\" $flags -o \"\$3\"""#;
        let mut command = Command::new("sh");
        command.args(["-c", script, "sh"]).arg(cc).arg(self.work.join("found").join("game.c")).arg(&program);
        command.env("PKG_CONFIG_PATH", root.join("lib").join("pkgconfig"));
        let right = log.run(&mut command)?.success && log.run(&mut Command::new(&program))?.success;
        tally.test((!right).then(|| "pkg-config does not lead to the library".to_owned()));
        Ok(())
    }

    /// As `docs/troubleshooting.md` says: a program with the library beside it starts with `$ORIGIN` as its run path, and not without. It is linked
    /// with the library's path, which a library without a `DT_SONAME` would make the program depend on.
    fn with_library_beside(&self, log: &mut Log, root: &Path, cc: &Path, tally: &mut Tally) -> Result<(), String> {
        let folder = self.work.join("beside");
        let source = self.write("beside", "game.c", HOST)?;
        let library = folder.join("libcairn.so");
        fs::copy(root.join("lib/libcairn.so"), &library).map_err(|e| format!("{}: {e}", library.display()))?;
        let moved = folder.join("elsewhere");
        fs::create_dir_all(&moved).map_err(|e| format!("{}: {e}", moved.display()))?;
        for (name, flags, starts) in [("game", &["-Wl,-rpath,$ORIGIN"][..], true), ("game-without", &[], false)] {
            let mut command = Command::new(cc);
            command.arg("-std=c11").arg("-I").arg(root.join("include")).arg(&source).arg(&library);
            let linked = log.run(command.args(flags).arg("-o").arg(folder.join(name)))?.success;
            // Both move to a folder in which the program was not linked.
            for file in [name, "libcairn.so"] {
                fs::copy(folder.join(file), moved.join(file)).map_err(|e| format!("{file}: {e}"))?;
            }
            let started = log.run(Command::new(moved.join(name)).env_remove("LD_LIBRARY_PATH"))?.success;
            let wrong = !linked || started != starts;
            tally.test(wrong.then(|| format!("{name} with libcairn.so beside it: linked {linked}, started {started}")));
        }
        Ok(())
    }

    /// The sample as its page says, run with nothing but the archive's files; hosts of other kinds; a project that finds the package; and a
    /// program that LLVM links as MSVC does.
    fn on_windows(&self, log: &mut Log, root: &Path, tally: &mut Tally) -> Result<(), String> {
        let source = root.join("samples").join("host-d3d12");
        let program = host::windows_sample(log, self.cmake, &source, &self.work.join("host-d3d12"), &[])?;
        archive::run(self.context, log, root, &program, self.work, tally)?;

        let list = self.work.join("found");
        let build = self.work.join("found-windows");
        let compiler = tools::mingw_compiler(false, &Console::new()).map_err(|e| e.to_string())?;
        let mut configure = Command::new(self.cmake);
        configure.arg("-S").arg(&list).arg("-B").arg(&build).arg("-DCMAKE_SYSTEM_NAME=Windows");
        configure.arg(format!("-DCMAKE_C_COMPILER={}", compiler.program.display()));
        // CMake looks for packages for another system in that system's folders only.
        configure.arg(format!("-DCairn_DIR={}", root.join("lib/cmake/Cairn").display()));
        let right = log.run(&mut configure)?.success
            && log.run(Command::new(self.cmake).arg("--build").arg(&build))?.success
            && build.join("DirectML.dll").is_file()
            && log.run(&mut in_lab(&build.join("game.exe"))?)?.success;
        tally.test((!right).then(|| "a Windows project that finds the package by CMake has no library".to_owned()));
        self.by_import_library(log, root, tally)
    }

    /// `cairn.lib`, with LLVM's compiler and linker in MSVC mode.
    fn by_import_library(&self, log: &mut Log, root: &Path, tally: &mut Tally) -> Result<(), String> {
        const NAME: &str = "cairn.lib with a linker in MSVC's manner";
        let (Some(clang), Some(lld)) = (tools::clang("clang", &Console::new()), rust_lld()?) else {
            tally.skips.push(Skip { name: NAME.into(), reason: "needs clang: apt install clang".into() });
            return Ok(());
        };
        let source = self.write("bare", "bare.c", BARE_HOST)?;
        let folder = source.with_file_name("");
        let mut compile = Command::new(clang);
        compile.args([
            "--target=x86_64-pc-windows-msvc",
            "-std=c11",
            "-ffreestanding",
            "-c",
            "bare.c",
            "-o",
            "bare.obj",
        ]);
        compile.arg("-I").arg(root.join("include")).current_dir(&folder);
        let mut link = Command::new(lld);
        link.args([
            "-flavor",
            "link",
            "/nologo",
            "/nodefaultlib",
            "/entry:start",
            "/subsystem:console",
            "/out:bare.exe",
        ]);
        link.arg("bare.obj").arg(root.join("lib").join("cairn.lib")).current_dir(&folder);
        let linked = log.run(&mut compile)?.success && log.run(&mut link)?.success;
        tally.test((!linked).then(|| format!("{NAME}: it does not link")));
        if linked {
            let dll = folder.join("cairn.dll");
            fs::copy(root.join("bin").join("cairn.dll"), &dll).map_err(|e| format!("{}: {e}", dll.display()))?;
            let ended = log.run(&mut in_lab(&folder.join("bare.exe"))?)?;
            tally.test((!ended.success).then(|| format!("{NAME}: the program does not find the library")));
        }
        Ok(())
    }
}

/// Runs a Windows program in the lab.
fn in_lab(program: &Path) -> Result<Command, String> {
    let mut command = lab::lab_run()?;
    command.arg(program);
    Ok(command)
}

/// The linker that rustc ships.
fn rust_lld() -> Result<Option<PathBuf>, String> {
    let sysroot = output(Command::new("rustc").args(["--print", "sysroot"]))?;
    let host = format!("lib/rustlib/{}-unknown-linux-gnu/bin/rust-lld", std::env::consts::ARCH);
    let program = Path::new(sysroot.trim()).join(host);
    Ok(program.is_file().then_some(program))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directml_without_the_terms_of_its_version_is_found() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("runtime");
        fs::create_dir(&folder).unwrap();
        let library = |version: &str| {
            let text: Vec<u8> =
                format!("ProductVersion {version}+2").encode_utf16().flat_map(u16::to_le_bytes).collect();
            fs::write(folder.join("DirectML.dll"), text).unwrap();
        };
        assert_eq!(directml_without_terms(root.path()), Ok(None));
        library(provision::DIRECTML_VERSION);
        assert!(directml_without_terms(root.path()).unwrap().is_some());
        let licence =
            format!("https://www.nuget.org/packages/Microsoft.AI.DirectML/{}/License", provision::DIRECTML_VERSION);
        fs::write(folder.join(dist::DIRECTML_TERMS), licence).unwrap();
        assert_eq!(directml_without_terms(root.path()), Ok(None));
        library("1.15.2");
        assert!(directml_without_terms(root.path()).unwrap().is_some());
    }
}
