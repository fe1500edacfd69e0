//! Archives: a reader of the ZIP files that `docs/bundle.md` section 1 allows, and of no others.
//!
//! Format: PKWARE's APPNOTE 6.3.10. Entries are stored, never compressed, so nothing can grow while it is read. Everything that two
//! readers could interpret differently is refused: comments, several disks, entries with equal names or shared bytes, local headers
//! that differ from the central directory, data descriptors.

use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;

use super::{MANIFEST_NAME, damaged, invalid, names};
use crate::{Error, Result};

const END: u32 = 0x0605_4B50;
const END64: u32 = 0x0606_4B50;
const LOCATOR64: u32 = 0x0706_4B50;
const CENTRAL: u32 = 0x0201_4B50;
const LOCAL: u32 = 0x0403_4B50;
const END_LEN: u64 = 22;
const END64_LEN: u64 = 56;
const LOCATOR64_LEN: u64 = 20;
const CENTRAL_LEN: usize = 46;
const LOCAL_LEN: u64 = 30;
/// Placeholder in a 32-bit field whose value is in a ZIP64 record.
const ZIP64_MARKER_32: u64 = u32::MAX as u64;
const ZIP64_MARKER_16: u64 = u16::MAX as u64;
/// The flag that a name is UTF-8, which says nothing about ASCII names. No other flag is allowed.
const UTF8_FLAG: u16 = 1 << 11;
const MAX_ENTRIES: u64 = 8192;
const MAX_CENTRAL: u64 = 8 << 20;

/// Position and size of a stored file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) data: Range<u64>,
    /// CRC-32 of the data, as the central directory says.
    pub(super) crc: u32,
}

impl Entry {
    pub(super) fn size(&self) -> u64 {
        self.data.end - self.data.start
    }

    /// Byte range of the data in an archive in memory.
    pub(super) fn range(&self) -> Option<Range<usize>> {
        Some(usize::try_from(self.data.start).ok()?..usize::try_from(self.data.end).ok()?)
    }
}

fn bad(cause: impl Into<String>) -> Error {
    invalid(
        "archive",
        cause,
        "Write the archive again with stored (uncompressed) entries, as docs/bundle.md section 1 says",
    )
}

/// Reads consecutive little-endian fields of a record.
struct Record<'a>(&'a [u8]);

impl<'a> Record<'a> {
    fn bytes(&mut self, n: usize) -> Result<&'a [u8]> {
        let (bytes, rest) = self.0.split_at_checked(n).ok_or_else(|| bad("a record of the archive is cut short"))?;
        self.0 = rest;
        Ok(bytes)
    }

    fn number(&mut self, bytes: usize) -> Result<u64> {
        Ok(self.bytes(bytes)?.iter().rev().fold(0, |value, &b| value << 8 | u64::from(b)))
    }

    fn u16(&mut self) -> Result<u16> {
        Ok(self.number(2)? as u16)
    }

    fn u32(&mut self) -> Result<u32> {
        Ok(self.number(4)? as u32)
    }

    fn expect(&mut self, signature: u32, what: &str) -> Result<()> {
        if self.u32()? == signature { Ok(()) } else { Err(bad(format!("there is no {what} where one must be"))) }
    }
}

fn read_at(file: &mut (impl Read + Seek), at: u64, len: u64) -> Result<Vec<u8>> {
    let short = || bad("the archive is cut short, or a position in it is wrong");
    file.seek(SeekFrom::Start(at)).map_err(|_| short())?;
    let mut bytes = Vec::new();
    // `len` is the size of a record, a name, or a directory already checked against `MAX_CENTRAL`.
    let got = file.take(len).read_to_end(&mut bytes).map_err(|_| short())?;
    if got as u64 == len { Ok(bytes) } else { Err(short()) }
}

/// Position of the central directory, and its number of entries.
struct Central {
    entries: u64,
    range: Range<u64>,
}

/// All files of the archive `file` of `len` bytes that have a name a bundle may use.
///
/// # Errors
/// `InvalidBundle` for anything but a plain archive of stored entries.
pub(super) fn directory(file: &mut (impl Read + Seek), len: u64) -> Result<BTreeMap<String, Entry>> {
    let central = central(file, len)?;
    let bytes = read_at(file, central.range.start, central.range.end - central.range.start)?;
    let mut record = Record(&bytes);
    let mut entries = BTreeMap::new();
    let mut extents = Vec::new();
    for _ in 0..central.entries {
        let header = Header::read(&mut record)?;
        let data = header.data(file)?;
        extents.push(header.offset..data.end);
        // Entries with names that no bundle may list are never read; only the archive rules apply to them.
        let name = String::from_utf8_lossy(header.name).into_owned();
        if entries.insert(name.clone(), Entry { data, crc: header.crc }).is_some() {
            return Err(bad(format!("the entry `{}` is there twice", name.escape_debug())));
        }
    }
    if !record.0.is_empty() {
        return Err(bad("the central directory has more bytes than entries"));
    }
    extents.sort_by_key(|extent| extent.start);
    let overlaps = extents.windows(2).any(|pair| pair[0].end > pair[1].start);
    if overlaps || extents.last().is_some_and(|last| last.end > central.range.start) {
        return Err(bad("entries overlap one another or the central directory"));
    }
    entries.retain(|name, _| names::violation(name).is_none());
    Ok(entries)
}

fn central(file: &mut (impl Read + Seek), len: u64) -> Result<Central> {
    let end_at = len.checked_sub(END_LEN).ok_or_else(|| bad("the file is too short for an archive"))?;
    let end = read_at(file, end_at, END_LEN)?;
    let mut end = Record(&end);
    end.expect(END, "end record (the archive may have a comment or be cut short)")?;
    let (disk, first_disk, here, entries) = (end.u16()?, end.u16()?, end.number(2)?, end.number(2)?);
    let (size, offset, comment) = (end.number(4)?, end.number(4)?, end.u16()?);
    if (disk, first_disk, comment) != (0, 0, 0) || here != entries {
        return Err(bad("the archive has a comment or several disks"));
    }
    let (entries, size, offset, after) =
        if entries == ZIP64_MARKER_16 || size == ZIP64_MARKER_32 || offset == ZIP64_MARKER_32 {
            central64(file, end_at)?
        } else {
            (entries, size, offset, end_at)
        };
    let range = offset..offset.checked_add(size).unwrap_or(0);
    if range.end != after || entries > MAX_ENTRIES || size > MAX_CENTRAL {
        return Err(bad(format!(
            "the central directory of {entries} entries, {size} bytes at {offset} is misplaced or too large"
        )));
    }
    Ok(Central { entries, range })
}

/// The central directory as the ZIP64 records describe it: entries, size, offset, and the position of the records.
fn central64(file: &mut (impl Read + Seek), end_at: u64) -> Result<(u64, u64, u64, u64)> {
    let missing = || bad("the archive's 64-bit records are missing");
    let at = end_at.checked_sub(LOCATOR64_LEN).ok_or_else(missing)?;
    let locator = read_at(file, at, LOCATOR64_LEN)?;
    let mut locator = Record(&locator);
    locator.expect(LOCATOR64, "64-bit locator")?;
    let (disk, record_at, disks) = (locator.u32()?, locator.number(8)?, locator.u32()?);
    if disk != 0 || disks != 1 || record_at.checked_add(END64_LEN) != Some(at) {
        return Err(bad("the archive's 64-bit locator is wrong"));
    }
    let record = read_at(file, record_at, END64_LEN)?;
    let mut record = Record(&record);
    record.expect(END64, "64-bit end record")?;
    let (rest, _versions, disk, first_disk) = (record.number(8)?, record.u32()?, record.u32()?, record.u32()?);
    let (here, entries, size, offset) = (record.number(8)?, record.number(8)?, record.number(8)?, record.number(8)?);
    if (rest, disk, first_disk) != (END64_LEN - 12, 0, 0) || here != entries {
        return Err(bad("the archive's 64-bit end record is wrong"));
    }
    Ok((entries, size, offset, record_at))
}

/// One entry of the central directory.
struct Header<'a> {
    name: &'a [u8],
    flags: u16,
    crc: u32,
    size: u64,
    offset: u64,
}

impl<'a> Header<'a> {
    fn read(record: &mut Record<'a>) -> Result<Self> {
        let mut fixed = Record(record.bytes(CENTRAL_LEN)?);
        fixed.expect(CENTRAL, "entry of the central directory")?;
        let (_versions, flags, method, _time) = (fixed.u32()?, fixed.u16()?, fixed.u16()?, fixed.u32()?);
        let (crc, packed, size) = (fixed.u32()?, fixed.number(4)?, fixed.number(4)?);
        let (name_len, extra_len, comment_len) = (fixed.u16()?, fixed.u16()?, fixed.u16()?);
        let (disk, _inner, _outer, offset) = (fixed.u16()?, fixed.u16()?, fixed.u32()?, fixed.number(4)?);
        let name = record.bytes(name_len.into())?;
        let extra = record.bytes(extra_len.into())?;
        record.bytes(comment_len.into())?;

        let shown = String::from_utf8_lossy(name);
        let fault = |cause: &str| bad(format!("the entry `{}` {cause}", shown.escape_debug()));
        if flags & 1 != 0 {
            return Err(fault("is encrypted"));
        }
        if method != 0 {
            return Err(fault("is compressed"));
        }
        if flags & !UTF8_FLAG != 0 || disk != 0 {
            return Err(fault("has a data descriptor, another unusual flag, or lies on another disk"));
        }
        let mut wide = Record(extra64(extra)?.unwrap_or_default());
        let mut widened = |short: u64| if short == ZIP64_MARKER_32 { wide.number(8) } else { Ok(short) };
        let (size, packed, offset) = (widened(size)?, widened(packed)?, widened(offset)?);
        if packed != size {
            return Err(fault("has two sizes"));
        }
        Ok(Self { name, flags, crc, size, offset })
    }

    /// Byte range of the data; also checks the local header.
    fn data(&self, file: &mut (impl Read + Seek)) -> Result<Range<u64>> {
        let shown = String::from_utf8_lossy(self.name);
        let fault =
            || bad(format!("the local header of `{}` is not what the central directory says", shown.escape_debug()));
        let names_at = self.offset.checked_add(LOCAL_LEN).ok_or_else(fault)?;
        let fixed = read_at(file, self.offset, LOCAL_LEN)?;
        let mut fixed = Record(&fixed);
        fixed.expect(LOCAL, "local header")?;
        let (_version, flags, method, _time) = (fixed.u16()?, fixed.u16()?, fixed.u16()?, fixed.u32()?);
        let (crc, packed, size) = (fixed.u32()?, fixed.number(4)?, fixed.number(4)?);
        let (name_len, extra_len) = (fixed.u16()?, fixed.u16()?);
        let rest = read_at(file, names_at, u64::from(name_len) + u64::from(extra_len))?;
        let (name, extra) = rest.split_at_checked(name_len.into()).ok_or_else(fault)?;
        let mut wide = Record(extra64(extra)?.unwrap_or_default());
        let mut widened = |short: u64| if short == ZIP64_MARKER_32 { wide.number(8) } else { Ok(short) };
        let sizes = (widened(size)?, widened(packed)?);
        if (name, flags, method, crc, sizes) != (self.name, self.flags, 0, self.crc, (self.size, self.size)) {
            return Err(fault());
        }
        let start = names_at.checked_add(rest.len() as u64).ok_or_else(fault)?;
        Ok(start..start.checked_add(self.size).ok_or_else(fault)?)
    }
}

/// The content of the ZIP64 field among extra fields.
fn extra64(extra: &[u8]) -> Result<Option<&[u8]>> {
    let mut record = Record(extra);
    let mut found = None;
    // Some writers pad the extra fields with fewer bytes than a field's own header has.
    while record.0.len() >= 4 {
        let (id, len) = (record.u16()?, record.u16()?);
        let content = record.bytes(len.into())?;
        if id == 1 && found.replace(content).is_some() {
            return Err(bad("an entry has two 64-bit fields"));
        }
    }
    Ok(found)
}

/// Compares the manifest's bytes with its CRC-32, because no checksum in the manifest can protect the manifest itself.
pub(super) fn check_manifest(bytes: &[u8], entry: &Entry) -> Result<()> {
    let crc = !bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| if crc & 1 == 0 { crc >> 1 } else { crc >> 1 ^ 0xEDB8_8320 })
    });
    if crc == entry.crc { Ok(()) } else { Err(damaged(MANIFEST_NAME, "the CRC-32 is not the one in the archive")) }
}
