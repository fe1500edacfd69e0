//! States on each published page the commit, the generator and the world that made it.
//!
//! A commit may be rewritten by a merge, so the page also has a digest of the generator's sources, and that of the bundle if a world made its
//! pictures: a test compares them with the sources and the embedded world of today. A page of another generator or world is made again, or
//! says so.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use cairn::Result;
use cairn::bundle::{Bundle, OpenOptions};
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
const PAGES: [Page; 9] = [
    Page { path: "quality.md", command: "study quality --speed --publish" },
    Page { path: "quality-sealed.md", command: "study quality --sealed --rows all --publish" },
    Page { path: "generator-rules.md", command: "study ablate --publish" },
    Page { path: "motion.md", command: "study motion --publish" },
    Page { path: "cadence.md", command: "study cadence --publish" },
    Page { path: "world.md", command: "study world-quality --publish" },
    Page { path: "weights.md", command: "study weights --publish" },
    Page { path: "report/report.md", command: "study compare --publish docs/report" },
    Page { path: "sweeps/paper.md", command: "study sweep tools/study/sweeps/paper.toml --publish docs/sweeps" },
];

/// Start of the line that a page has.
const START: &str = "*Made at commit ";
/// Starts of the digests within that line. Pages without a world have none of it, nor have those from before it was stated.
const DIGEST: &str = "generator sources `";
const WORLD: &str = "world `";
/// Number of hexadecimal digits that a page shows of a digest.
const DIGITS: usize = 16;
/// Commit and digest of rollouts whose manifests name none.
const UNKNOWN: &str = "unknown";
/// Parts of the line once the generator, or the embedded world, is another.
const OLDER: &str = " The generator's sources have changed since.";
const OTHER_WORLD: &str = " The world inside the library is another one now.";

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

/// `page`, with this program's commit and generator stated below its title, and the digest of the bundle whose pictures it shows.
pub(crate) fn stamped(page: &str, world: Option<&str>) -> String {
    stamped_with(page, [(&Source::of_this_program(), world)])
}

/// Adds a line below the title of `page`: commits, generators and worlds of its parts. A part without sources in its manifest is unknown.
pub(crate) fn stamped_with<'a>(
    page: &str,
    sources: impl IntoIterator<Item = (&'a Option<Source>, Option<&'a str>)>,
) -> String {
    let unknown = || Source { commit: UNKNOWN.into(), generator: UNKNOWN.into() };
    let sources: BTreeSet<(Source, Option<&str>)> =
        sources.into_iter().map(|(source, world)| (source.clone().unwrap_or_else(unknown), world)).collect();
    let part = |(Source { commit, generator }, world): &(Source, Option<&str>)| {
        let world = world.map_or_else(String::new, |digest| format!("; {WORLD}{}`", abbreviated(digest)));
        format!("{commit}; {DIGEST}{generator}`{world}")
    };
    let parts: Vec<String> = sources.iter().map(part).collect();
    with_line(page, &format!("{START}{}.*", parts.join("; and at commit ")))
}

/// The first digits of a digest, as pages print it.
fn abbreviated(digest: &str) -> &str {
    digest.get(..DIGITS).unwrap_or(digest)
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

/// Digest of the generator's sources below `root`, without tests, empty lines and lines that are comments: the first [`DIGITS`] of a SHA-256.
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
    Ok(hash.finalize().iter().take(DIGITS / 2).map(|byte| format!("{byte:02x}")).collect())
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

/// The digests of today's generator and of the embedded world.
#[derive(Debug, Clone, Copy)]
struct Today<'a> {
    generator: &'a str,
    world: &'a str,
}

/// What a page says about its generator and its world, against those of today.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// It has no line, or one that cannot be read.
    Silent,
    /// It was made by today's generator and world.
    Current,
    /// It was made by others and says so.
    SaysOlder,
    /// It was made by others and does not say so, or says so although it was not.
    Wrong,
}

/// The digests in a page's line that follow `start`.
fn digests<'a>(line: &'a str, start: &'static str) -> impl Iterator<Item = &'a str> {
    line.split(start).skip(1).map(|rest| rest.split('`').next().unwrap_or_default())
}

/// The end that a page's line should have: whether its generator and its world are still those of today.
fn changes(line: &str, today: Today<'_>) -> String {
    let is_older = digests(line, DIGEST).any(|digest| digest != today.generator);
    let is_other = digests(line, WORLD).any(|digest| digest != abbreviated(today.world));
    [(is_older, OLDER), (is_other, OTHER_WORLD)].iter().filter(|(is, _)| *is).map(|(_, words)| *words).collect()
}

/// A page's line, and what it says of changes since then.
fn split_changes(line: &str) -> (String, String) {
    let said: String = [OLDER, OTHER_WORLD].into_iter().filter(|words| line.contains(words)).collect();
    (line.replace(OLDER, "").replace(OTHER_WORLD, ""), said)
}

fn state(page: &str, today: Today<'_>) -> State {
    let Some(line) = page.lines().find(|line| line.starts_with(START)) else { return State::Silent };
    let mut generators = digests(line, DIGEST).peekable();
    if generators.peek().is_none() || generators.any(|digest| digest == UNKNOWN) {
        return State::Silent;
    }
    let (wanted, (_, said)) = (changes(line, today), split_changes(line));
    match (wanted == said, said.is_empty()) {
        (true, true) => State::Current,
        (true, false) => State::SaysOlder,
        (false, _) => State::Wrong,
    }
}

/// `page`, whose line says whether the generator and the world have changed since; the same if it has no line.
fn marked(page: &str, today: Today<'_>) -> String {
    if state(page, today) != State::Wrong {
        return page.to_owned();
    }
    let mark = |line: &str| {
        if !line.starts_with(START) {
            return line.to_owned();
        }
        let (plain, _) = split_changes(line);
        format!("{}{}*", plain.trim_end_matches('*'), changes(line, today))
    };
    page.lines().map(|line| mark(line) + "\n").collect()
}

/// A published page in [`pages`].
#[derive(Debug)]
pub(crate) struct PageState {
    /// Path within the docs, what it says, and the command that makes it again.
    pub(crate) line: String,
    /// Whether it says something wrong about its generator or its world, or nothing.
    pub(crate) is_wrong: bool,
}

/// The published pages. With `mark`, pages of an older generator or another world are changed to say so first.
///
/// # Errors
/// `Io`.
pub(crate) fn pages(mark: bool) -> Result<Vec<PageState>> {
    let (generator, bundle) = (digest(provision::repository())?, Bundle::embedded(&OpenOptions::default())?);
    let today = Today { generator: &generator, world: bundle.digest() };
    let page = |page: &Page| {
        let path = docs().join(page.path);
        let mut text = fs::read_to_string(&path).map_err(|e| describe_io("cannot be read", &path, &e))?;
        if mark {
            let marked = marked(&text, today);
            if marked != text {
                write_all(vec![(path, marked.clone().into_bytes())])?;
                text = marked;
            }
        }
        let again = format!("make it anew with `cargo run --release -p study -- {}`", &page.command["study ".len()..]);
        let (is_wrong, says) = match state(&text, today) {
            State::Current => (false, "made by today's generator and world".to_owned()),
            State::SaysOlder => (false, format!("made by an older generator or another world, and says so; {again}")),
            State::Silent => (true, format!("does not say which generator made it; {again}")),
            State::Wrong => (
                true,
                format!(
                    "was made by another generator or world than it says; {again}, or let it say so with `study pages --mark`"
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

    const TODAY: Today<'_> = Today { generator: "0011", world: "0123456789abcdef0123" };
    const TOMORROW: Today<'_> = Today { generator: "0012", ..TODAY };

    #[test]
    fn a_page_is_current_until_the_generator_changes_and_then_says_so() {
        let page = with_line("# Title\n\nText.\n", &format!("{START}`178771f` of 2026-11-23; {DIGEST}0011`.*"));
        assert_eq!(page, "# Title\n\n*Made at commit `178771f` of 2026-11-23; generator sources `0011`.*\n\nText.\n");
        assert_eq!((state(&page, TODAY), state(&page, TOMORROW)), (State::Current, State::Wrong));
        assert_eq!(marked(&page, TODAY), page);
        let older = marked(&page, TOMORROW);
        assert!(older.contains("`0011`. The generator's sources have changed since.*\n\nText."), "{older}");
        // A generator that is changed back makes the page current again.
        assert_eq!((state(&older, TOMORROW), state(&older, TODAY)), (State::SaysOlder, State::Wrong));
        assert_eq!(marked(&older, TODAY), page);
        assert_eq!(state("# Title\n\nText.\n", TODAY), State::Silent);
    }

    #[test]
    fn a_page_of_a_world_names_the_bundle_and_says_so_once_another_is_embedded() {
        let source = Some(Source { commit: "`178771f` of 2026-11-23".into(), generator: "0011".into() });
        let page = stamped_with("# Title\n\nText.\n", [(&source, Some(TODAY.world))]);
        let line = "*Made at commit `178771f` of 2026-11-23; generator sources `0011`; world `0123456789abcdef`.*";
        assert_eq!(page, format!("# Title\n\n{line}\n\nText.\n"));
        let other = Today { world: "fedcba9876543210", ..TODAY };
        assert_eq!((state(&page, TODAY), state(&page, other)), (State::Current, State::Wrong));
        let of_other = marked(&page, other);
        assert!(of_other.contains("abcdef`. The world inside the library is another one now.*\n"), "{of_other}");
        assert_eq!((state(&of_other, other), state(&of_other, TODAY)), (State::SaysOlder, State::Wrong));
        assert_eq!(marked(&of_other, TODAY), page);
        // Both have changed; then one of them is as it was.
        let both = Today { generator: "0012", ..other };
        assert_eq!(state(&of_other, both), State::Wrong);
        let of_both = marked(&of_other, both);
        assert!(of_both.contains("`. The generator's sources have changed since. The world inside"), "{of_both}");
        assert_eq!((state(&of_both, both), marked(&of_both, other)), (State::SaysOlder, of_other));
        // Rollouts of two worlds are two parts.
        let parts = [(&source, Some(TODAY.world)), (&source, Some(other.world)), (&source, Some(TODAY.world))];
        let two = stamped_with("# Title\n", parts);
        assert_eq!((two.matches(WORLD).count(), two.matches(DIGEST).count()), (2, 2), "{two}");
    }

    #[test]
    fn a_page_of_kept_rollouts_names_all_their_sources() {
        let [older, newer] = [("`178771f` of 2026-11-23", "0011"), ("`65cf61b` of 2026-11-24", "0012")]
            .map(|(commit, generator)| Some(Source { commit: commit.into(), generator: generator.into() }));
        let page = |sources: &[&Option<Source>]| stamped_with("# Title\n\nText.\n", sources.iter().map(|s| (*s, None)));
        let both = page(&[&newer, &older, &newer]);
        assert_eq!(
            both,
            "# Title\n\n*Made at commit `178771f` of 2026-11-23; generator sources `0011`; and at commit `65cf61b` of 2026-11-24; \
             generator sources `0012`.*\n\nText.\n"
        );
        let today = TOMORROW;
        assert_eq!((state(&both, today), state(&marked(&both, today), today)), (State::Wrong, State::SaysOlder));
        assert_eq!(state(&page(&[&newer, &newer]), today), State::Current);
        assert_eq!(state(&page(&[&newer, &None]), today), State::Silent);
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
