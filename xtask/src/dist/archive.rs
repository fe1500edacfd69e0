//! Packs trees as ZIP and as compressed tar, with one fixed time, no owner and sorted entries: the same files give the same bytes.

use std::io::{Cursor, Write};
use std::process::Command;

use flate2::{Compression, GzBuilder};
use jiff::Timestamp;
use jiff::tz::TimeZone;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use super::tree::Tree;
use crate::shell::output;
use crate::workspace::Workspace;

/// The environment variable for the build time <https://reproducible-builds.org/specs/source-date-epoch/>.
pub(super) const EPOCH: &str = "SOURCE_DATE_EPOCH";

/// The time of every entry in an archive, in whole seconds: from the variable, else the time of the repository's last commit.
pub(super) fn build_time(workspace: &Workspace) -> Result<Timestamp, String> {
    let text = match std::env::var(EPOCH) {
        Ok(text) => text,
        Err(_) => output(Command::new("git").args(["log", "-1", "--format=%ct"]).current_dir(&workspace.root))?,
    };
    let seconds = text.trim().parse().ok();
    let build_time = seconds.and_then(|seconds| Timestamp::from_second(seconds).ok());
    build_time.ok_or_else(|| format!("{EPOCH} is {text:?}, and not a number of seconds since 1970"))
}

/// Permissions of an entry: everyone may read it, and execute it if it is a program; the owner may write.
fn mode(tree: &Tree, path: &str) -> u32 {
    if tree.is_program(path) { 0o755 } else { 0o644 }
}

/// A ZIP file.
pub(super) fn zip(tree: &Tree, build_time: Timestamp) -> Result<Vec<u8>, String> {
    let failed = |e: zip::result::ZipError| format!("{}: {e}", tree.name());
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .last_modified_time(zip_time(build_time));
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    for (path, bytes) in tree.files() {
        let mode = mode(tree, &path);
        writer.start_file(path, options.unix_permissions(mode)).map_err(failed)?;
        writer.write_all(bytes).map_err(|e| format!("{}: {e}", tree.name()))?;
    }
    Ok(writer.finish().map_err(failed)?.into_inner())
}

/// The time in ZIP's format, which begins in 1980; earlier times become the earliest that it has.
fn zip_time(build_time: Timestamp) -> DateTime {
    let at = build_time.to_zoned(TimeZone::UTC);
    let parts = [at.month(), at.day(), at.hour(), at.minute(), at.second()].map(|part| u8::try_from(part).unwrap_or(0));
    let [month, day, hour, minute, second] = parts;
    let year = u16::try_from(at.year()).unwrap_or(0);
    DateTime::from_date_and_time(year, month, day, hour, minute, second).unwrap_or_default()
}

/// A tar file, compressed by gzip.
pub(super) fn tar_gz(tree: &Tree, build_time: Timestamp) -> Result<Vec<u8>, String> {
    let failed = |e: std::io::Error| format!("{}: {e}", tree.name());
    // The gzip header has no name and no time.
    let writer = GzBuilder::new().mtime(0).write(Vec::new(), Compression::best());
    let mut builder = tar::Builder::new(writer);
    for (path, bytes) in tree.files() {
        let mut header = tar::Header::new_gnu();
        header.set_size(bytes.len() as u64);
        header.set_mode(mode(tree, &path));
        header.set_mtime(u64::try_from(build_time.as_second()).unwrap_or(0));
        header.set_uid(0);
        header.set_gid(0);
        builder.append_data(&mut header, path, bytes).map_err(failed)?;
    }
    builder.into_inner().and_then(flate2::write::GzEncoder::finish).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn build_time(text: &str) -> Timestamp {
        text.parse().unwrap()
    }

    #[test]
    fn zip_has_times_from_1980_on() {
        let time = zip_time(build_time("2000-02-29T13:14:16Z"));
        assert_eq!((time.year(), time.month(), time.day()), (2000, 2, 29));
        assert_eq!((time.hour(), time.minute(), time.second()), (13, 14, 16));
        assert_eq!(zip_time(build_time("1970-01-01T00:00:00Z")), DateTime::default());
    }

    #[test]
    fn the_same_files_make_the_same_bytes() {
        let mut trees = [Tree::new("a-1".to_owned()), Tree::new("a-1".to_owned())];
        for (path, text) in [("b", "two"), ("a", "one")] {
            trees[0].add(path, text).unwrap();
        }
        for (path, text) in [("a", "one"), ("b", "two")] {
            trees[1].add(path, text).unwrap();
        }
        let [zips, tars] = [zip, tar_gz]
            .map(|pack| trees.each_ref().map(|tree| pack(tree, build_time("2000-02-29T00:00:00Z")).unwrap()));
        assert_eq!(zips[0], zips[1]);
        assert_eq!(tars[0], tars[1]);
        assert_ne!(
            zips[0],
            zip(&trees[0], build_time("2000-02-29T00:00:02Z")).unwrap(),
            "the time of the files is in it"
        );
        assert!(zips[0].starts_with(b"PK") && tars[0].starts_with(&[0x1f, 0x8b]));
    }

    #[test]
    fn programs_and_nothing_else_may_be_executed() {
        let mut tree = Tree::new("a-1".to_owned());
        tree.add("a", "text").unwrap();
        tree.add_program("bin/b", "code").unwrap();
        let packed = tar_gz(&tree, Timestamp::UNIX_EPOCH).unwrap();
        let mut archive = tar::Archive::new(flate2::read::GzDecoder::new(packed.as_slice()));
        let modes = archive.entries().unwrap().map(|entry| entry.unwrap().header().mode().unwrap());
        assert_eq!(modes.collect::<Vec<_>>(), [0o644, 0o755]);
        let packed = zip(&tree, Timestamp::UNIX_EPOCH).unwrap();
        let mut archive = zip::ZipArchive::new(Cursor::new(packed)).unwrap();
        let modes = ["a-1/a", "a-1/bin/b"].map(|name| archive.by_name(name).unwrap().unix_mode().unwrap() & 0o777);
        assert_eq!(modes, [0o644, 0o755]);
    }
}
