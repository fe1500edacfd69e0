//! The ledger of the sealed set: one line for each time that it was opened.
//!
//! Lines are only ever appended. Each ends with a checksum of itself, so a later change of a line shows.

use std::fmt::Write as _;
use std::fs::{self, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::process::Command;

use cairn::{Error, ErrorKind, Result};
use jiff::Timestamp;

use super::rows;
use super::store::{digest, digest_of_sources};
use super::table::Table;
use media::describe_io;

/// The repository's ledger, from its root.
pub(super) const LEDGER: &str = "docs/sealed-ledger.csv";
/// The ledger of a set of one's own, beside its file.
pub(super) const OWN_LEDGER: &str = "sealed-ledger.csv";
/// Names of the columns.
const HEADER: &str = "date,commit,work tree,version,generator,rows,lpips,left out,results,checksum";
const COLUMNS: usize = 10;
/// Commit and state of the work tree of a copy without git.
const NO_GIT: &str = "no-git";
/// Sources of the generator and of `picture_flow`, from the repository's root.
pub(super) const GENERATOR: [&str; 2] = ["src/framegen", "src/guidance"];

/// The state of the sources that a measurement was made with.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Sources {
    /// Commit as a full hash, or [`NO_GIT`].
    pub(super) commit: String,
    /// `clean`, `changed`, or [`NO_GIT`]. The ledger itself is not looked at.
    pub(super) work_tree: String,
    /// First 24 hexadecimal digits of the SHA-256 of the generator's sources.
    pub(super) generator: String,
}

impl Sources {
    /// Those of the repository in `root`.
    ///
    /// # Errors
    /// `Io` when the generator's sources cannot be read.
    pub(super) fn of(root: &Path) -> Result<Self> {
        let generator = digest_of_sources(&GENERATOR.map(|folder| root.join(folder)), &[])?;
        let git = |arguments: &[&str]| {
            let output = Command::new("git").arg("-C").arg(root).args(arguments).output().ok()?;
            output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
        };
        let but_ledger = format!(":(exclude){LEDGER}");
        let commit = git(&["rev-parse", "HEAD"]);
        let changes = git(&["status", "--porcelain", "--untracked-files=no", "--", ".", &but_ledger]);
        let (commit, work_tree) = match (commit, changes) {
            (Some(commit), Some(changes)) => {
                (commit, if changes.is_empty() { "clean".into() } else { "changed".into() })
            }
            _ => (NO_GIT.into(), NO_GIT.into()),
        };
        Ok(Self { commit, work_tree, generator })
    }

    /// A warning if nobody can find out later which sources these are.
    pub(super) fn warning(&self) -> Option<&'static str> {
        match self.work_tree.as_str() {
            NO_GIT => Some("this copy has no git history: the ledger's line names no commit"),
            "changed" => Some("the work tree differs from its commit: the ledger's line says \"changed\""),
            _ => None,
        }
    }
}

/// One opening of the sealed set.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Entry {
    /// Time to the second, in UTC.
    pub(super) date: Timestamp,
    pub(super) sources: Sources,
    /// Version of the program.
    pub(super) version: String,
    pub(super) rows: Vec<String>,
    /// Network of LPIPS, or `none`.
    pub(super) lpips: String,
    /// Names of rows and clips that were not available.
    pub(super) left_out: Vec<String>,
    pub(super) results: Vec<ClipResult>,
}

/// Scores of all rows on one clip at twice the anchors' rate.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ClipResult {
    pub(super) clip: String,
    /// Row, and its PSNR, SSIM and LPIPS as they are written; `-` for no LPIPS.
    pub(super) scores: Vec<(String, [String; 3])>,
}

/// Results of every clip of a table.
pub(super) fn results(table: &Table) -> Vec<ClipResult> {
    let score = |clip: &str, row: rows::Kind| {
        let score = table.clip(2, clip, row)?.score;
        let lpips = score.lpips.map_or_else(|| "-".to_owned(), |value| format!("{value:.4}"));
        Some((row.name().to_owned(), [format!("{:.2}", score.psnr), format!("{:.4}", score.ssim), lpips]))
    };
    let clips = table.groups(2).into_iter().flat_map(|group| table.clips(2, &group));
    let result = |clip: String| {
        let scores = table.rows(2).into_iter().filter_map(|row| score(&clip, row)).collect();
        ClipResult { clip, scores }
    };
    clips.map(result).collect()
}

impl Entry {
    /// The line without its end.
    fn line(&self) -> String {
        let mut results = Vec::new();
        for ClipResult { clip, scores } in &self.results {
            let mut text = clip.clone();
            for (row, measures) in scores {
                _ = write!(text, " {row} {}", measures.join("/"));
            }
            results.push(text);
        }
        let left_out = if self.left_out.is_empty() { "-".into() } else { self.left_out.join(" ") };
        let Sources { commit, work_tree, generator } = &self.sources;
        let body = [
            &self.date.to_string(),
            commit,
            work_tree,
            &self.version,
            generator,
            &self.rows.join(" "),
            &self.lpips,
            &left_out,
            &results.join("; "),
        ]
        .map(|column| column.replace([',', '\n'], " "))
        .join(",");
        format!("{body},{}", checksum(&body))
    }

    /// Reads a line.
    fn parse(line: &str) -> std::result::Result<Self, String> {
        let columns: Vec<&str> = line.split(',').collect();
        if columns.len() != COLUMNS {
            return Err(format!("it has {} columns of {COLUMNS}", columns.len()));
        }
        let (body, sum) = line.rsplit_once(',').unwrap_or_default();
        if sum != checksum(body) {
            return Err(format!("its checksum is {}, not {sum}: it was changed", checksum(body)));
        }
        let words = |text: &str| text.split(' ').filter(|word| *word != "-").map(str::to_owned).collect::<Vec<_>>();
        let result = |text: &str| {
            let mut words = text.split(' ');
            let clip = words.next().filter(|clip| !clip.is_empty()).ok_or("a result names no clip")?.to_owned();
            let mut scores = Vec::new();
            while let Some(row) = words.next() {
                let measures: Vec<String> = words.next().unwrap_or_default().split('/').map(str::to_owned).collect();
                let measures: [String; 3] =
                    measures.try_into().map_err(|_| format!("{clip}: {row} has not three measures"))?;
                if measures.iter().any(|m| m != "-" && m.parse::<f64>().is_err()) {
                    return Err(format!("{clip}: {row} has a measure that is no number"));
                }
                scores.push((row.to_owned(), measures));
            }
            if scores.is_empty() { Err(format!("{clip} has no scores")) } else { Ok(ClipResult { clip, scores }) }
        };
        let [commit, work_tree, version, generator] = [1, 2, 3, 4].map(|i| columns[i].to_owned());
        Ok(Self {
            date: columns[0].parse().map_err(|e| format!("{:?} is no time: {e}", columns[0]))?,
            sources: Sources { commit, work_tree, generator },
            version,
            rows: words(columns[5]),
            lpips: columns[6].to_owned(),
            left_out: words(columns[7]),
            results: columns[8].split("; ").map(result).collect::<std::result::Result<_, String>>()?,
        })
    }
}

fn checksum(body: &str) -> String {
    digest([body.as_bytes()])[..12].to_owned()
}

/// The present time to the second.
pub(super) fn now() -> Timestamp {
    Timestamp::from_second(Timestamp::now().as_second()).unwrap_or_default()
}

/// The ledger in a file.
#[derive(Debug)]
pub(super) struct Ledger {
    path: PathBuf,
}

impl Ledger {
    pub(super) fn new(path: PathBuf) -> Self {
        Self { path }
    }

    /// All entries in order of time.
    ///
    /// # Errors
    /// `Io`; `InvalidState` for a line that was changed or that is earlier than the one before it.
    pub(super) fn read(&self) -> Result<Vec<Entry>> {
        let text = match fs::read_to_string(&self.path) {
            Ok(text) => text,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(e) => return Err(describe_io("cannot be read", &self.path, &e)),
        };
        parse(&text).map_err(|cause| {
            Error::new(ErrorKind::InvalidState, cause)
                .field(self.path.display().to_string())
                .remedy("Restore the ledger from the history of the repository")
        })
    }

    /// Appends an entry, and the header to a new file. What the file holds already is checked and stays as it is. Returns the number of entries.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub(super) fn append(&self, entry: &Entry) -> Result<usize> {
        let before = self.read()?;
        if let Some(last) = before.last().filter(|last| last.date > entry.date) {
            let cause = format!("its last line is of {}, later than now, {}", last.date, entry.date);
            return Err(Error::new(ErrorKind::InvalidState, cause)
                .field(self.path.display().to_string())
                .remedy("Set this machine's clock"));
        }
        let fail = |e: &io::Error| describe_io("cannot be written", &self.path, e);
        let mut file = OpenOptions::new().create(true).append(true).open(&self.path).map_err(|e| fail(&e))?;
        let is_new = file.metadata().map_err(|e| fail(&e))?.len() == 0;
        let header = if is_new { format!("{HEADER}\n") } else { String::new() };
        file.write_all(format!("{header}{}\n", entry.line()).as_bytes()).map_err(|e| fail(&e))?;
        Ok(before.len() + 1)
    }
}

fn parse(text: &str) -> std::result::Result<Vec<Entry>, String> {
    if !text.is_empty() && !text.ends_with('\n') {
        return Err("its last line has no end".into());
    }
    let mut lines = text.lines();
    match lines.next() {
        None | Some(HEADER) => {}
        Some(other) => return Err(format!("its first line is {other:?}, not the names of the columns")),
    }
    let mut entries: Vec<Entry> = Vec::new();
    for (number, line) in lines.enumerate() {
        let number = number + 2;
        let entry = Entry::parse(line).map_err(|cause| format!("line {number}: {cause}"))?;
        if entries.last().is_some_and(|last| last.date > entry.date) {
            return Err(format!("line {number} is earlier than the line before it"));
        }
        entries.push(entry);
    }
    Ok(entries)
}

#[cfg(test)]
mod tests {
    use super::super::table::tests::record;
    use super::*;

    fn entry(second: i64) -> Entry {
        let table = Table::new(&[
            record("snow-901", rows::Kind::Blend, 30.0, Some(0.1)),
            record("snow-901", rows::Kind::Flow, 33.125, None),
            record("city", rows::Kind::Blend, 20.5, Some(0.25)),
        ]);
        Entry {
            date: Timestamp::from_second(second).unwrap(),
            sources: Sources { commit: "c0ffee".into(), work_tree: "clean".into(), generator: "abc".into() },
            version: "0.1.0".into(),
            rows: vec!["blend".into(), "cairn-flow".into()],
            lpips: "alex".into(),
            left_out: Vec::new(),
            results: results(&table),
        }
    }

    #[test]
    fn a_line_is_read_as_it_was_written_and_a_change_of_it_shows() {
        let entry = entry(1_790_000_000);
        let line = entry.line();
        assert_eq!(Entry::parse(&line).unwrap(), entry);
        assert!(
            line.contains(
                "snow-901 blend 30.00/0.3000/0.1000 cairn-flow 33.12/0.3312/-; city blend 20.50/0.2050/0.2500"
            ),
            "{line}"
        );
        let better = line.replace("33.12", "39.12");
        assert!(Entry::parse(&better).unwrap_err().contains("changed"), "{better}");
        assert!(Entry::parse("a,b").unwrap_err().contains("columns"));
        let with_sum = |body: String| format!("{body},{}", checksum(&body));
        let body = line.rsplit_once(',').unwrap().0;
        for (from, to, why) in [
            ("30.00/0.3000/0.1000", "30.00/0.3000", "three measures"),
            ("30.00", "x", "no number"),
            ("; city blend 20.50/0.2050/0.2500", "; city", "no scores"),
            ("2026-", "26-", "no time"),
        ] {
            let error = Entry::parse(&with_sum(body.replacen(from, to, 1))).unwrap_err();
            assert!(error.contains(why), "{error}");
        }
    }

    #[test]
    fn a_run_appends_and_changes_nothing_that_is_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(OWN_LEDGER);
        let ledger = Ledger::new(path.clone());
        assert!(ledger.read().unwrap().is_empty());
        assert_eq!(ledger.append(&entry(1_790_000_000)).unwrap(), 1);
        let first = fs::read_to_string(&path).unwrap();
        assert_eq!(ledger.append(&entry(1_790_000_060)).unwrap(), 2);
        let both = fs::read_to_string(&path).unwrap();
        assert!(both.starts_with(&first) && both.len() > first.len() && both.lines().count() == 3);
        assert_eq!(ledger.read().unwrap(), [entry(1_790_000_000), entry(1_790_000_060)]);
        // A clock that runs behind, a line that was changed, and one that was moved.
        assert!(ledger.append(&entry(1_780_000_000)).unwrap_err().to_string().contains("later than now"));
        let lines: Vec<&str> = both.lines().collect();
        for broken in [
            both.replacen("30.00/", "31.00/", 1),
            [lines[0], lines[2], lines[1], ""].join("\n"),
            both.trim_end().to_owned(),
            lines[1..].join("\n") + "\n",
        ] {
            fs::write(&path, &broken).unwrap();
            assert_eq!(ledger.append(&entry(1_790_000_120)).unwrap_err().kind(), ErrorKind::InvalidState, "{broken}");
            assert_eq!(fs::read_to_string(&path).unwrap(), broken);
        }
    }

    #[test]
    fn the_repositorys_ledger_is_whole() {
        let path = provision::repository().join(LEDGER);
        assert!(path.is_file(), "{} is missing", path.display());
        for entry in Ledger::new(path).read().unwrap() {
            assert!(!entry.results.is_empty() && !entry.rows.is_empty() && !entry.sources.commit.is_empty());
        }
    }

    /// A copy of the repository with one source file of the generator, which is returned as well.
    fn copy_with_a_source() -> (tempfile::TempDir, PathBuf) {
        let copy = tempfile::tempdir().unwrap();
        for folder in GENERATOR {
            fs::create_dir_all(copy.path().join(folder)).unwrap();
        }
        let source = copy.path().join(GENERATOR[0]).join("warp.rs");
        fs::write(&source, "fn warp() {}\n").unwrap();
        (copy, source)
    }

    #[test]
    fn sources_without_git_are_recorded_as_such() {
        let (copy, source) = copy_with_a_source();
        let bare = Sources::of(copy.path()).unwrap();
        assert_eq!((bare.commit.as_str(), bare.work_tree.as_str()), (NO_GIT, NO_GIT));
        assert!(bare.warning().is_some_and(|text| text.contains("no git history")));
        fs::write(&source, "fn warp() { }\n").unwrap();
        assert_ne!(Sources::of(copy.path()).unwrap().generator, bare.generator);
    }

    // The lab's Windows has no git.
    #[cfg(unix)]
    #[test]
    fn commit_and_work_tree_are_recorded_and_the_digest_follows_the_generator() {
        let (copy, source) = copy_with_a_source();
        let git = |arguments: &[&str]| {
            let mut command = std::process::Command::new("git");
            command.args(["-c", "user.name=a", "-c", "user.email=a@b"]).args(arguments).current_dir(copy.path());
            assert!(command.output().unwrap().status.success(), "{arguments:?}");
        };
        git(&["init", "--quiet"]);
        git(&["add", "."]);
        git(&["commit", "--quiet", "--message", "first"]);
        let clean = Sources::of(copy.path()).unwrap();
        assert!(clean.commit.len() == 40 && clean.work_tree == "clean" && clean.warning().is_none());
        fs::write(&source, "fn warp() { }\n").unwrap();
        let changed = Sources::of(copy.path()).unwrap();
        assert_eq!((changed.work_tree.as_str(), &changed.commit), ("changed", &clean.commit));
        assert_ne!(changed.generator, clean.generator);
        assert!(changed.warning().is_some());
    }
}
