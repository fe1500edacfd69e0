//! States on each published page the commit and the generator that made it.
//!
//! A commit may be rewritten by a merge, so the page also has a digest of the generator's sources: a test compares it with the sources of
//! today. A page whose generator has changed since is made again, or says so.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use cairn::Result;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::files::{docs, write_all};
use media::describe_io;

/// Folders and files of the generator's sources: frame generation on the processor, its shaders, and optical flow.
const SOURCES: [&str; 4] =
    ["src/framegen", "src/gpu/shaders", "src/guidance/picture_flow.rs", "src/guidance/picture_flow"];

/// A page that a command writes: its path in the docs, and the command.
struct Page {
    path: &'static str,
    command: &'static str,
}

/// All of them.
const PAGES: [Page; 8] = [
    Page { path: "quality.md", command: "study quality --speed --publish" },
    Page { path: "quality-sealed.md", command: "study quality --sealed --rows all --publish" },
    Page { path: "generator-rules.md", command: "study ablate --publish" },
    Page { path: "motion.md", command: "study motion --publish" },
    Page { path: "cadence.md", command: "study cadence --publish" },
    Page { path: "world.md", command: "study world-quality --publish" },
    Page { path: "report/report.md", command: "study compare --publish docs/report" },
    Page { path: "sweeps/paper.md", command: "study sweep tools/study/sweeps/paper.toml --publish docs/sweeps" },
];

/// Start of the line that a page has.
const START: &str = "*Made at commit ";
/// Start of the digest within that line.
const DIGEST: &str = "generator sources `";
/// Commit and digest of rollouts whose manifests name none.
const UNKNOWN: &str = "unknown";
/// Part of the line once the generator has changed.
const OLDER: &str = " The generator's sources have changed since.";

/// The sources that made a rollout or a page.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Source {
    /// The commit and its date as Markdown, such as `` `178771f` of 2026-11-23 ``; `unknown` without Git.
    pub commit: String,
    /// The first 16 hexadecimal digits of the SHA-256 of the generator's sources.
    pub generator: String,
}

impl Source {
    /// The sources of this program's repository, as they are when it is first called; `None` where the repository is not.
    pub(crate) fn of_this_program() -> Option<Self> {
        static SOURCE: OnceLock<Option<Source>> = OnceLock::new();
        let read = || {
            let root = provision::repository();
            Some(Self { commit: commit(root), generator: digest(root).ok()? })
        };
        SOURCE.get_or_init(read).clone()
    }
}

/// `page`, with this program's commit and generator stated below its title.
pub(crate) fn stamped(page: &str) -> String {
    stamped_with(page, [&Source::of_this_program()])
}

/// `page`, with the commits and generators of what it shows stated below its title. A part whose manifest has no sources is unknown.
pub(crate) fn stamped_with<'a>(page: &str, sources: impl IntoIterator<Item = &'a Option<Source>>) -> String {
    let unknown = || Source { commit: UNKNOWN.into(), generator: UNKNOWN.into() };
    let sources: BTreeSet<Source> = sources.into_iter().map(|source| source.clone().unwrap_or_else(unknown)).collect();
    let parts: Vec<String> =
        sources.iter().map(|Source { commit, generator }| format!("{commit}; {DIGEST}{generator}`")).collect();
    with_line(page, &format!("{START}{}.*", parts.join("; and at commit ")))
}

/// Inserts `line` as a paragraph below the title.
fn with_line(page: &str, line: &str) -> String {
    match page.split_once('\n') {
        Some((title, rest)) if title.starts_with("# ") => format!("{title}\n\n{line}\n{rest}"),
        _ => format!("{line}\n\n{page}"),
    }
}

/// The commit and its date, such as `` `178771f` of 2026-11-23 ``; says so if files differ from it.
fn commit(root: &Path) -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").arg("-C").arg(root).args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let Some(commit) = git(&["show", "-s", "--format=`%h` of %cs"]) else { return UNKNOWN.to_owned() };
    let code = ["status", "--porcelain", "--", "src", "samples", "tools"];
    match git(&code) {
        Some(changes) if changes.is_empty() => commit,
        _ => format!("{commit}, with changes that are in no commit"),
    }
}

/// Digest of the generator's sources below `root`, without tests, empty lines and lines that are comments: the first 16 hexadecimal digits
/// of a SHA-256.
fn digest(root: &Path) -> Result<String> {
    let mut files = Vec::new();
    for name in SOURCES {
        let path = root.join(name);
        gather(&path, &mut files).map_err(|e| describe_io("cannot be read", &path, &e))?;
    }
    files.sort();
    let mut hash = Sha256::new();
    for path in files {
        let text = fs::read_to_string(&path).map_err(|e| describe_io("cannot be read", &path, &e))?;
        hash.update(code(&text));
    }
    Ok(hash.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect())
}

/// The lines of a source file that are code.
fn code(text: &str) -> String {
    let is_code = |line: &&str| !line.is_empty() && !line.starts_with("//");
    text.lines().map(str::trim).filter(is_code).flat_map(|line| [line, "\n"]).collect()
}

/// Adds the Rust and HLSL files at or below `path`, except tests.
fn gather(path: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    let is_test = path.file_stem().is_some_and(|name| name == "tests" || name == "golden");
    if path.is_dir() {
        if !is_test {
            for entry in fs::read_dir(path)? {
                gather(&entry?.path(), files)?;
            }
        }
    } else if !is_test && path.extension().is_some_and(|kind| ["rs", "hlsl", "hlsli"].iter().any(|name| kind == *name))
    {
        files.push(path.to_owned());
    }
    Ok(())
}

/// What a page says about its generator, against the generator of today.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// It has no line, or one that cannot be read.
    Silent,
    /// It was made by today's generator.
    Current,
    /// It was made by an older one and says so.
    SaysOlder,
    /// It was made by an older one and does not say so, or says so although it was not.
    Wrong,
}

fn state(page: &str, today: &str) -> State {
    let Some(line) = page.lines().find(|line| line.starts_with(START)) else { return State::Silent };
    let digests: Vec<&str> =
        line.split(DIGEST).skip(1).map(|rest| rest.split('`').next().unwrap_or_default()).collect();
    if digests.is_empty() || digests.contains(&UNKNOWN) {
        return State::Silent;
    }
    match (digests.iter().all(|digest| *digest == today), line.contains(OLDER)) {
        (true, false) => State::Current,
        (false, true) => State::SaysOlder,
        _ => State::Wrong,
    }
}

/// `page`, whose line says whether the generator has changed since; the same if it has no line.
fn marked(page: &str, today: &str) -> String {
    if state(page, today) != State::Wrong {
        return page.to_owned();
    }
    let mark = |line: &str| match line.strip_prefix(START) {
        None => line.to_owned(),
        Some(_) if line.contains(OLDER) => line.replace(OLDER, ""),
        Some(_) => format!("{}{OLDER}*", line.trim_end_matches('*')),
    };
    page.lines().map(|line| mark(line) + "\n").collect()
}

/// A published page in [`pages`].
#[derive(Debug)]
pub(crate) struct PageState {
    /// Path within the docs, what it says, and the command that makes it again.
    pub(crate) line: String,
    /// Whether it says something wrong about its generator, or nothing.
    pub(crate) is_wrong: bool,
}

/// The published pages. With `mark`, pages of an older generator are changed to say so first.
///
/// # Errors
/// `Io`.
pub(crate) fn pages(mark: bool) -> Result<Vec<PageState>> {
    let today = digest(provision::repository())?;
    let page = |page: &Page| {
        let path = docs().join(page.path);
        let mut text = fs::read_to_string(&path).map_err(|e| describe_io("cannot be read", &path, &e))?;
        if mark {
            let marked = marked(&text, &today);
            if marked != text {
                write_all(vec![(path, marked.clone().into_bytes())])?;
                text = marked;
            }
        }
        let again = format!("make it anew with `cargo run --release -p study -- {}`", &page.command["study ".len()..]);
        let (is_wrong, says) = match state(&text, &today) {
            State::Current => (false, "made by today's generator".to_owned()),
            State::SaysOlder => (false, format!("made by an older generator, and says so; {again}")),
            State::Silent => (true, format!("does not say which generator made it; {again}")),
            State::Wrong => (
                true,
                format!(
                    "was made by another generator than it says; {again}, or let it say so with `study pages --mark`"
                ),
            ),
        };
        Ok(PageState { line: format!("{}: {says}", page.path), is_wrong })
    };
    PAGES.iter().map(page).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_published_page_says_which_generator_made_it() {
        let wrong: Vec<String> = pages(false).unwrap().into_iter().filter(|p| p.is_wrong).map(|p| p.line).collect();
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    }

    #[test]
    fn a_page_is_current_until_the_generator_changes_and_then_says_so() {
        let page = with_line("# Title\n\nText.\n", &format!("{START}`178771f` of 2026-11-23; {DIGEST}0011`.*"));
        assert_eq!(page, "# Title\n\n*Made at commit `178771f` of 2026-11-23; generator sources `0011`.*\n\nText.\n");
        assert_eq!((state(&page, "0011"), state(&page, "0012")), (State::Current, State::Wrong));
        assert_eq!(marked(&page, "0011"), page);
        let older = marked(&page, "0012");
        assert!(older.contains("`0011`. The generator's sources have changed since.*\n\nText."), "{older}");
        // A generator that is changed back makes the page current again.
        assert_eq!((state(&older, "0012"), state(&older, "0011")), (State::SaysOlder, State::Wrong));
        assert_eq!(marked(&older, "0011"), page);
        assert_eq!(state("# Title\n\nText.\n", "0011"), State::Silent);
    }

    #[test]
    fn a_page_of_kept_rollouts_names_all_their_sources() {
        let [older, newer] = [("`178771f` of 2026-11-23", "0011"), ("`65cf61b` of 2026-11-24", "0012")]
            .map(|(commit, generator)| Some(Source { commit: commit.into(), generator: generator.into() }));
        let page = |sources: &[&Option<Source>]| stamped_with("# Title\n\nText.\n", sources.iter().copied());
        let both = page(&[&newer, &older, &newer]);
        assert_eq!(
            both,
            "# Title\n\n*Made at commit `178771f` of 2026-11-23; generator sources `0011`; and at commit `65cf61b` of 2026-11-24; \
             generator sources `0012`.*\n\nText.\n"
        );
        assert_eq!((state(&both, "0012"), state(&marked(&both, "0012"), "0012")), (State::Wrong, State::SaysOlder));
        assert_eq!(state(&page(&[&newer, &newer]), "0012"), State::Current);
        assert_eq!(state(&page(&[&newer, &None]), "0012"), State::Silent);
    }

    #[test]
    fn the_digest_follows_code_and_not_comments_or_tests() {
        let folder = tempfile::tempdir().unwrap();
        let write = |source: usize, name: &str, text: &str| {
            let path = folder.path().join(SOURCES[source]).join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        let code = [(0, "mod.rs"), (1, "a.hlsl"), (3, "a.rs")];
        code.iter().for_each(|(source, name)| write(*source, name, "code\n"));
        fs::write(folder.path().join(SOURCES[2]), "code\n").unwrap();
        let first = digest(folder.path()).unwrap();
        write(0, "mod.rs", "// A comment.\n\n  code\n");
        write(0, "tests.rs", "a test\n");
        write(0, &["tests", "a.rs"].join("/"), "a test\n");
        write(1, "compiled/a.dxbc", "bytes\n");
        assert_eq!(digest(folder.path()).unwrap(), first);
        for (source, name) in code {
            write(source, name, "other code\n");
            assert_ne!(digest(folder.path()).unwrap(), first, "{name}");
            write(source, name, "code\n");
        }
        fs::write(folder.path().join(SOURCES[2]), "other code\n").unwrap();
        assert_ne!(digest(folder.path()).unwrap(), first);
    }
}
