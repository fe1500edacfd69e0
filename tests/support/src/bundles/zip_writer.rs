//! Writes ZIP archives, including invalid ones.

/// A file of an archive.
#[derive(Clone)]
pub struct ZipEntry {
    /// Name in the central directory.
    pub name: Vec<u8>,
    /// Contents, as they are stored.
    pub data: Vec<u8>,
    /// Compression method; 0 for stored.
    pub method: u16,
    /// General purpose flags.
    pub flags: u16,
    /// Whether sizes are written in 64-bit extra fields.
    pub wide: bool,
    /// Size to write instead of the size of `data`.
    pub claimed: Option<u64>,
    /// Offset of the local header to write instead of the true one.
    pub offset: Option<u64>,
    /// Name to write in the local header instead of `name`.
    pub local_name: Option<Vec<u8>>,
}

impl ZipEntry {
    /// A stored file.
    pub fn new(name: &str, data: &[u8]) -> Self {
        Self {
            name: name.into(),
            data: data.to_vec(),
            method: 0,
            flags: 0,
            wide: false,
            claimed: None,
            offset: None,
            local_name: None,
        }
    }
}

/// An archive.
#[derive(Clone, Default)]
pub struct Zip {
    /// Its files, in order.
    pub entries: Vec<ZipEntry>,
    /// Whether there are 64-bit end records.
    pub wide: bool,
    /// The archive's comment.
    pub comment: Vec<u8>,
    /// Number of files to write in the end record instead of the true one.
    pub count: Option<u64>,
}

/// The CRC-32 checksum of ZIP.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _| if crc & 1 == 0 { crc >> 1 } else { (crc >> 1) ^ 0xEDB8_8320 };
    !bytes.iter().fold(u32::MAX, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), step))
}

/// In a 32-bit field: the value is in a 64-bit one.
const IN_64_BITS: u32 = u32::MAX;

impl Zip {
    /// An archive of stored files.
    pub fn of<'a>(files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> Self {
        Self { entries: files.into_iter().map(|(name, data)| ZipEntry::new(name, data)).collect(), ..Self::default() }
    }

    /// The archive's bytes.
    pub fn encode(&self) -> Vec<u8> {
        let mut out = Vec::new();
        let mut central = Vec::new();
        for entry in &self.entries {
            let offset = entry.offset.unwrap_or(out.len() as u64);
            let name = entry.local_name.as_ref().unwrap_or(&entry.name);
            let size = entry.claimed.unwrap_or(entry.data.len() as u64);
            out.extend(0x0403_4B50_u32.to_le_bytes());
            header(&mut out, entry, size, name.len(), if entry.wide { 20 } else { 0 });
            out.extend(name);
            if entry.wide {
                extra(&mut out, &[size, size]);
            }
            out.extend(&entry.data);

            central.extend(0x0201_4B50_u32.to_le_bytes());
            central.extend(45_u16.to_le_bytes());
            header(&mut central, entry, size, entry.name.len(), if entry.wide { 28 } else { 0 });
            central.extend([0; 10]);
            central.extend((if entry.wide { IN_64_BITS } else { offset as u32 }).to_le_bytes());
            central.extend(&entry.name);
            if entry.wide {
                extra(&mut central, &[size, size, offset]);
            }
        }
        let start = out.len() as u64;
        let (count, length) = (self.count.unwrap_or(self.entries.len() as u64), central.len() as u64);
        out.extend(central);
        if self.wide {
            let record = out.len() as u64;
            out.extend(0x0606_4B50_u32.to_le_bytes());
            out.extend(44_u64.to_le_bytes());
            out.extend([45, 0, 45, 0]);
            out.extend([0; 8]);
            [count, count, length, start].iter().for_each(|n| out.extend(n.to_le_bytes()));
            out.extend(0x0706_4B50_u32.to_le_bytes());
            out.extend([0; 4]);
            out.extend(record.to_le_bytes());
            out.extend(1_u32.to_le_bytes());
        }
        let short = |n: u64| if self.wide { IN_64_BITS } else { n as u32 };
        out.extend(0x0605_4B50_u32.to_le_bytes());
        out.extend([0; 4]);
        out.extend((short(count) as u16).to_le_bytes());
        out.extend((short(count) as u16).to_le_bytes());
        out.extend(short(length).to_le_bytes());
        out.extend(short(start).to_le_bytes());
        out.extend((self.comment.len() as u16).to_le_bytes());
        out.extend(&self.comment);
        out
    }
}

/// Writes the fields that local header and central directory share.
fn header(out: &mut Vec<u8>, entry: &ZipEntry, size: u64, name: usize, extra: u16) {
    out.extend(45_u16.to_le_bytes());
    out.extend(entry.flags.to_le_bytes());
    out.extend(entry.method.to_le_bytes());
    out.extend([0; 4]);
    out.extend(crc32(&entry.data).to_le_bytes());
    let short = if entry.wide { IN_64_BITS } else { size as u32 };
    out.extend(short.to_le_bytes());
    out.extend(short.to_le_bytes());
    out.extend((name as u16).to_le_bytes());
    out.extend(extra.to_le_bytes());
}

/// Writes a 64-bit extra field.
fn extra(out: &mut Vec<u8>, numbers: &[u64]) {
    out.extend(1_u16.to_le_bytes());
    out.extend((numbers.len() as u16 * 8).to_le_bytes());
    numbers.iter().for_each(|n| out.extend(n.to_le_bytes()));
}
