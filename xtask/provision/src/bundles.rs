//! Worlds for the tests and the demo, made by this repository's bundle builder: of random weights, or of the embedded world's in fewer bits.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest, Sha256};

use crate::python::{python_env, python_path, text};
use crate::{Error, Progress, Result, cache, process, repository};

/// The worlds that tests use: four of random weights, one for the demo, `tiny` with a float32 residual stream in f16, and the embedded world in 8
/// and in 4 bits.
pub const BUNDLES: [&str; 8] =
    ["tiny", "window", "stream", "joined", "demo", "tiny-residual", "miniature-8bit", "miniature-4bit"];

/// The embedded world with quantised weights: names, and what the weights are. Of the last, so many matrices stay in 16 bits that a pass's error is
/// below 1 %.
pub const QUANTISED: [(&str, &str); 4] = [
    ("miniature-8bit", "8 bits"),
    ("miniature-8bit-activations", "8 bits, activations too"),
    ("miniature-4bit", "4 bits"),
    ("miniature-4bit-mixed", "4 bits, two thirds in 16"),
];

/// The matrices of `miniature-4bit-mixed` that stay in 16 bits.
const MIXED: &str = "blocks.0,blocks.5,blocks.6,blocks.7,blocks.1.attn,blocks.2.attn,blocks.3.attn,blocks.4.attn";

/// The world inside the library.
const EMBEDDED: &str = "samples/worlds/miniature.cairn";

/// The directory of the world `name`, one of [`BUNDLES`] or [`QUANTISED`]; built on first use.
///
/// A built world is kept as long as the builder's sources and the embedded world stay the same, to the byte.
///
/// # Errors
/// An unknown name, no Python environment, or a builder that fails.
pub fn bundle(name: &str, progress: &dyn Progress) -> Result<PathBuf> {
    let wanted = format!("the test world \"{name}\"");
    let Some((source, options)) = recipe(name) else {
        let remedy = format!("Ask for one of {}", names().collect::<Vec<_>>().join(", "));
        return Err(Error::new(wanted, "there is no such world", remedy));
    };
    let key = key()?;
    let folder = cache::cache_dir()?.join("bundles").join(&key).join(name);
    let complete = folder.join("cairn-world.json");
    if complete.is_file() {
        return Ok(folder);
    }

    let item = format!("bundle-{key}-{name}");
    let held = cache::lock(&item, progress)?;
    if complete.is_file() {
        return Ok(folder);
    }
    let interpreter = python_env(progress)?;
    progress.start(&format!("building {wanted}"));
    let scratch = cache::scratch(&item, &held)?;
    let unfinished = scratch.join(name);
    let mut command = Command::new(interpreter);
    command.args(["-m", "cairn.build"]);
    match source {
        Source::Random(preset) => command.args(["random", "--preset", preset]),
        Source::Embedded => command.arg("quantise").arg(repository().join(EMBEDDED)),
    };
    command.args(options);
    command.args(["--out", text(&unfinished)?]).env("PYTHONPATH", python_path()).env("PYTHONDONTWRITEBYTECODE", "1");
    let outcome = process::run(&mut command, |line| progress.detail(line)).map_err(|e| Error::io(&scratch, &e))?;
    if !outcome.status.success() {
        let cause = format!("the bundle builder failed:\n{}\n", outcome.tail(6));
        return Err(Error::new(wanted, cause, "Mend what it names above and run the command again"));
    }
    if !unfinished.join("cairn-world.json").is_file() {
        return Err(Error::new(
            wanted,
            "the bundle builder left no cairn-world.json",
            "Run it by hand with PYTHONPATH=bindings/python to see what it does",
        ));
    }
    cache::publish(&unfinished, &folder)?;
    cache::remove(&scratch)?;
    progress.done(&format!("world \"{name}\": {}", folder.display()));
    Ok(folder)
}

/// The names of all worlds, once each.
fn names() -> impl Iterator<Item = &'static str> {
    let others = QUANTISED.into_iter().map(|(name, _)| name).filter(|name| !BUNDLES.contains(name));
    BUNDLES.into_iter().chain(others)
}

/// Source of a world's weights.
enum Source {
    /// Random weights and the shapes of a preset.
    Random(&'static str),
    /// The embedded world.
    Embedded,
}

/// Source and builder options of the world `name`; `None` if there is no such world.
fn recipe(name: &str) -> Option<(Source, &'static [&'static str])> {
    Some(match name {
        "tiny" => (Source::Random("tiny"), &[]),
        "window" => (Source::Random("window"), &[]),
        "stream" => (Source::Random("stream"), &[]),
        "joined" => (Source::Random("joined"), &[]),
        "demo" => (Source::Random("demo"), &[]),
        "tiny-residual" => (Source::Random("tiny"), &["--residual", "float32"]),
        "miniature-8bit" => (Source::Embedded, &["--weights", "8"]),
        "miniature-8bit-activations" => (Source::Embedded, &["--weights", "8", "--activations", "8"]),
        "miniature-4bit" => (Source::Embedded, &["--weights", "4"]),
        "miniature-4bit-mixed" => (Source::Embedded, &["--weights", "4", "--keep-16", MIXED]),
        _ => return None,
    })
}

/// Builds every world of [`BUNDLES`] and returns the directory that has one folder per world.
///
/// # Errors
/// As [`bundle`].
pub fn test_bundles(progress: &dyn Progress) -> Result<PathBuf> {
    for name in BUNDLES {
        bundle(name, progress)?;
    }
    Ok(cache::cache_dir()?.join("bundles").join(key()?))
}

/// Cache key of all worlds: of the builder, its options, and the embedded world.
fn key() -> Result<String> {
    // The archive begins with the manifest, which has the checksums of all other files.
    const BEGINNING: u64 = 16 << 10;
    let world = repository().join(EMBEDDED);
    let mut beginning = Vec::new();
    fs::File::open(&world)
        .and_then(|file| file.take(BEGINNING).read_to_end(&mut beginning))
        .map_err(|e| Error::io(&world, &e))?;
    let mut hash = Sha256::new();
    hash.update(builder_key(&python_path())?);
    for name in names() {
        let options = recipe(name).map_or(&[][..], |(_, options)| options);
        hash.update(format!("{name} {}\n", options.join(" ")));
    }
    hash.update(beginning);
    Ok(cache::hex(&hash.finalize())[..16].to_owned())
}

/// Cache key of the builder: a hash over the paths and bytes of all its files.
fn builder_key(package: &Path) -> Result<String> {
    let mut files = Vec::new();
    let sources = package.join("cairn").join("build");
    collect_files(&sources, &mut files).map_err(|e| {
        let remedy = "Run from a complete clone: the builder's sources are bindings/python/cairn/build";
        Error::new("the bundle builder", format!("{}: {e}", sources.display()), remedy)
    })?;
    files.sort();
    let mut hash = Sha256::new();
    for file in files {
        let bytes = fs::read(&file).map_err(|e| Error::io(&file, &e))?;
        let name = file.strip_prefix(package).unwrap_or(&file).to_string_lossy().replace('\\', "/");
        hash.update(format!("{name}\n{}\n", bytes.len()));
        hash.update(bytes);
    }
    Ok(cache::hex(&hash.finalize())[..16].to_owned())
}

fn collect_files(folder: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            if path.file_name().is_some_and(|name| name != "__pycache__") {
                collect_files(&path, files)?;
            }
        } else if path.extension().is_none_or(|suffix| suffix != "pyc") {
            files.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Silent;

    #[test]
    fn an_unknown_world_is_refused_with_the_names_of_the_known_ones() {
        let refused = bundle("huge", &Silent).unwrap_err().to_string();
        assert!(
            refused.contains("huge")
                && refused
                    .contains("tiny, window, stream, joined, demo, tiny-residual, miniature-8bit, miniature-4bit"),
            "{refused}"
        );
    }

    #[test]
    fn every_named_world_has_a_command() {
        for name in names() {
            assert!(recipe(name).is_some(), "{name}");
        }
    }

    #[test]
    fn the_key_follows_names_and_bytes_but_not_byte_code() {
        let folder = std::env::temp_dir().join(format!("cairn-provision-key-{}", std::process::id()));
        fs::create_dir_all(folder.join("cairn/build/__pycache__")).unwrap();
        fs::write(folder.join("cairn/build/a.py"), "x = 1").unwrap();
        let first = builder_key(&folder).unwrap();
        fs::write(folder.join("cairn/build/__pycache__/a.pyc"), "code").unwrap();
        assert_eq!(builder_key(&folder).unwrap(), first);
        fs::write(folder.join("cairn/build/a.py"), "x = 2").unwrap();
        let changed = builder_key(&folder).unwrap();
        fs::rename(folder.join("cairn/build/a.py"), folder.join("cairn/build/b.py")).unwrap();
        let renamed = builder_key(&folder).unwrap();
        fs::remove_dir_all(&folder).unwrap();
        assert!(first != changed && changed != renamed);
    }
}
