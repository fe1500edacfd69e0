//! Writes ZIP archives, also ones that no honest program would write.

#[derive(Clone)]
pub(crate) struct ZipEntry {
    pub(crate) name: Vec<u8>,
    pub(crate) data: Vec<u8>,
    pub(crate) method: u16,
    pub(crate) flags: u16,
    /// Sizes in 64-bit extra fields.
    pub(crate) wide: bool,
    /// Size in the central directory, where it is to be another than the data's.
    pub(crate) claimed: Option<u64>,
    /// Start of the local header in the central directory, where it is to be another than the true one.
    pub(crate) offset: Option<u64>,
    /// Name in the local header, where it is to be another.
    pub(crate) local_name: Option<Vec<u8>>,
}

impl ZipEntry {
    pub(crate) fn new(name: &str, data: &[u8]) -> Self {
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

#[derive(Clone, Default)]
pub(crate) struct Zip {
    pub(crate) entries: Vec<ZipEntry>,
    /// 64-bit end records.
    pub(crate) wide: bool,
    pub(crate) comment: Vec<u8>,
    /// Entry count in the end record, where it is to be another.
    pub(crate) count: Option<u64>,
}

pub(crate) fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _| if crc & 1 == 0 { crc >> 1 } else { (crc >> 1) ^ 0xEDB8_8320 };
    !bytes.iter().fold(u32::MAX, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), step))
}

const ELSEWHERE: u32 = u32::MAX;

impl Zip {
    pub(crate) fn of<'a>(files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> Self {
        Self { entries: files.into_iter().map(|(name, data)| ZipEntry::new(name, data)).collect(), ..Self::default() }
    }

    pub(crate) fn encode(&self) -> Vec<u8> {
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
            central.extend((if entry.wide { ELSEWHERE } else { offset as u32 }).to_le_bytes());
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
        let short = |n: u64| if self.wide { ELSEWHERE } else { n as u32 };
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

/// What local header and central directory have in common.
fn header(out: &mut Vec<u8>, entry: &ZipEntry, size: u64, name: usize, extra: u16) {
    out.extend(45_u16.to_le_bytes());
    out.extend(entry.flags.to_le_bytes());
    out.extend(entry.method.to_le_bytes());
    out.extend([0; 4]);
    out.extend(crc32(&entry.data).to_le_bytes());
    let short = if entry.wide { ELSEWHERE } else { size as u32 };
    out.extend(short.to_le_bytes());
    out.extend(short.to_le_bytes());
    out.extend((name as u16).to_le_bytes());
    out.extend(extra.to_le_bytes());
}

fn extra(out: &mut Vec<u8>, numbers: &[u64]) {
    out.extend(1_u16.to_le_bytes());
    out.extend((numbers.len() as u16 * 8).to_le_bytes());
    numbers.iter().for_each(|n| out.extend(n.to_le_bytes()));
}
