//! A folder of pictures in natural order: `2.png` before `10.png`.

use std::fs::{self, File};
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};

use cairn::{Error, ErrorKind, Picture, Result};

use super::source::{Input, Source};
use crate::manifest::read_bounded;
use crate::picture;
use media::describe_io;

/// Maximum file size of a picture, in bytes.
const MAX_BYTES: u64 = 512 << 20;
/// Number of files named in the note on files that are no pictures.
const NAMED: usize = 3;

struct Pictures {
    /// Unread pictures in reverse order: the next one is last.
    waiting: Vec<PathBuf>,
}

impl Source for Pictures {
    fn read(&mut self, out: &mut Picture) -> Result<bool> {
        let Some(path) = self.waiting.pop() else { return Ok(false) };
        let picture =
            picture::decode(&read_bounded(&path, MAX_BYTES)?).map_err(|e| e.field(path.display().to_string()))?;
        if picture.size() != out.size() {
            // The file has changed since the folder was opened.
            let cause = format!("it is {picture:?} now, those before it are {out:?}");
            return Err(Error::new(ErrorKind::InvalidArgument, cause).field(path.display().to_string()));
        }
        *out = picture;
        Ok(true)
    }
}

/// Checks every picture of `folder`: each can be read, and all have the same size.
pub(super) fn open(folder: &Path) -> Result<Input> {
    let failed = |e: io::Error| describe_io("cannot be read", folder, &e);
    let (mut pictures, mut others) = (Vec::new(), Vec::new());
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let list = if is_picture(&path) { &mut pictures } else { &mut others };
        list.push(path);
    }
    pictures.sort_by(|a, b| by_number(a, b));
    others.sort();
    if pictures.len() < 2 {
        let cause = match pictures.len() {
            0 => "the folder holds no picture",
            _ => "the folder holds one picture, and nothing lies between",
        };
        return Err(Error::new(ErrorKind::InvalidArgument, cause)
            .field(folder.display().to_string())
            .remedy("Name a folder with two or more PNG or JPEG files, numbered in the order of time"));
    }
    let size = one_size(&pictures)?;
    let mut notes = Vec::new();
    if !others.is_empty() {
        let names = others.iter().take(NAMED).map(|path| name(path)).collect::<Vec<_>>().join(", ");
        let more = if others.len() > NAMED { ", ..." } else { "" };
        notes.push(format!("{} beside the pictures left aside: {names}{more}", others.len()));
    }
    let expected = Some(pictures.len() as u64);
    pictures.reverse();
    let source = Box::new(Pictures { waiting: pictures });
    Ok(Input { size, rate: None, pixel_aspect: (1, 1), expected, notes, source, stopper: None })
}

fn is_picture(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    ["png", "jpg", "jpeg"].iter().any(|known| extension == *known) && !path.is_dir()
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Compares numbers within names by value; names with equal values (`1` and `01`) byte by byte.
fn by_number(a: &Path, b: &Path) -> std::cmp::Ordering {
    natord::compare(&name(a), &name(b)).then_with(|| a.cmp(b))
}

/// The common size.
fn one_size(pictures: &[PathBuf]) -> Result<(u32, u32)> {
    let mut first: Option<(&Path, (u32, u32))> = None;
    for path in pictures {
        let field = || path.display().to_string();
        let file = File::open(path).map_err(|e| describe_io("cannot be read", path, &e))?;
        let size = picture::size(BufReader::new(file)).map_err(|e| e.field(field()))?;
        match first {
            None => first = Some((path, size)),
            Some((other, (width, height))) if size != (width, height) => {
                let cause =
                    format!("it has {} x {} pixels, {} has {width} x {height}", size.0, size.1, other.display());
                return Err(Error::new(ErrorKind::InvalidArgument, cause)
                    .field(field())
                    .remedy("Put pictures of one size into the folder"));
            }
            Some(_) => {}
        }
    }
    first.map(|(_, size)| size).ok_or_else(|| Error::new(ErrorKind::InvalidArgument, "there is no picture"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_ordered_as_people_count() {
        let mut names = ["10.png", "frame2.png", "2.png", "frame10.png", "1.png", "01.png", "a.png"].map(PathBuf::from);
        names.sort_by(|a, b| by_number(a, b));
        let names: Vec<String> = names.iter().map(|path| name(path)).collect();
        assert_eq!(names, ["01.png", "1.png", "2.png", "10.png", "a.png", "frame2.png", "frame10.png"]);
    }
}
