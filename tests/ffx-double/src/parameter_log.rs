//! Logs the parameters that a host passes in addition to textures: a line in `parameters.txt` for each struct of a successful call,
//! including parameters that do not change the double's pictures.

use crate::field_access::get;

/// Type of a field.
#[derive(Clone, Copy)]
enum FieldType {
    /// A byte.
    Byte,
    Word,
    Float,
    /// An array of floats.
    Floats(usize),
    /// An array of words.
    Words(usize),
    /// A pointer to AMD's pacing struct.
    Pacing,
}

use FieldType::{Byte, Float, Floats, Pacing, Word, Words};

/// Fields of a struct: name, offset and type.
type Fields = &'static [(&'static str, usize, FieldType)];

/// The fields that both prepare structs share.
const PREPARE: Fields = &[
    ("render_size", 40, Words(2)),
    ("jitter", 48, Floats(2)),
    ("scale", 56, Floats(2)),
    ("time", 64, Float),
    ("near", 72, Float),
    ("far", 76, Float),
    ("fov", 80, Float),
    ("metres", 84, Float),
];

/// The fields of each struct, by its id.
const STRUCTS: [(u64, &[Fields]); 11] = [
    (0x2_0001, &[&[("flags", 16, Word), ("shown", 20, Words(2)), ("render", 28, Words(2)), ("format", 36, Word)]]),
    (0x2_0009, &[&[("hudless", 16, Word)]]),
    (0x2_0002, &[&[("async", 57, Byte), ("rect", 120, Words(4))]]),
    (0x2_0004, &[PREPARE]),
    (
        0x2_000a,
        &[&[("position", 16, Floats(3)), ("up", 28, Floats(3)), ("right", 40, Floats(3)), ("forward", 52, Floats(3))]],
    ),
    (
        0x2_000c,
        &[
            PREPARE,
            &[
                ("position", 184, Floats(3)),
                ("up", 196, Floats(3)),
                ("right", 208, Floats(3)),
                ("forward", 220, Floats(3)),
            ],
        ],
    ),
    (0x2_0003, &[&[("transfer", 272, Word), ("luminance", 276, Floats(2)), ("rect", 284, Words(4))]]),
    (0x1_0000, &[&[("flags", 16, Word), ("render", 20, Words(2)), ("shown", 28, Words(2))]]),
    (
        0x1_0001,
        &[&[
            ("jitter", 360, Floats(2)),
            ("scale", 368, Floats(2)),
            ("render_size", 376, Words(2)),
            ("upscale_size", 384, Words(2)),
            ("sharpen", 392, Byte),
            ("sharpness", 396, Float),
            ("time", 400, Float),
            ("exposure", 404, Float),
            ("near", 412, Float),
            ("far", 416, Float),
            ("fov", 420, Float),
            ("metres", 424, Float),
            ("flags", 428, Word),
        ]],
    ),
    (0x3_0002, &[&[("flags", 64, Word)]]),
    (0x3_0008, &[&[("key", 16, Word), ("pacing", 32, Pacing)]]),
];

/// The log line of a struct: its id, and each field as `NAME=VALUE`. None for a struct that is not logged.
///
/// # Safety
/// A struct of that id.
pub(crate) unsafe fn line(id: u64, at: *const u8) -> Option<String> {
    let (_, fields) = STRUCTS.iter().find(|(known, _)| *known == id)?;
    let mut line = format!("{id:x}");
    for (name, offset, kind) in fields.iter().copied().flatten() {
        // SAFETY: a field of the struct, by its published layout.
        let value = unsafe { value(at, *offset, *kind) };
        line.push_str(&format!(" {name}={value}"));
    }
    Some(line)
}

/// # Safety
/// The struct has a field of this type at that offset.
unsafe fn value(at: *const u8, offset: usize, kind: FieldType) -> String {
    // SAFETY: the caller's promise, here and below.
    let floats = |count: usize| (0..count).map(|index| unsafe { get::<f32>(at, offset + 4 * index) }.to_string());
    // SAFETY: as above.
    let words = |count: usize| (0..count).map(|index| unsafe { get::<u32>(at, offset + 4 * index) }.to_string());
    match kind {
        // SAFETY: as above.
        Byte => unsafe { get::<u8>(at, offset) }.to_string(),
        Word => words(1).collect(),
        Float => floats(1).collect(),
        Floats(count) => floats(count).collect::<Vec<_>>().join(","),
        Words(count) => words(count).collect::<Vec<_>>().join(","),
        Pacing => {
            // SAFETY: as above; null, or a pacing struct with these fields.
            unsafe {
                let tuning = get::<*const u8>(at, offset);
                if tuning.is_null() {
                    return "none".to_owned();
                }
                let (margin, factor, time) = (get::<f32>(tuning, 0), get::<f32>(tuning, 4), get::<u32>(tuning, 12));
                let (spins, waits) = (get::<u8>(tuning, 8), get::<u8>(tuning, 16));
                format!("{margin},{factor},{spins},{time},{waits}")
            }
        }
    }
}
