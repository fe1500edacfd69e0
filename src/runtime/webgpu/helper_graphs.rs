//! Graphs that move and check values on the adapter, and the adapter's run of the self-test.
//!
//! All values are words: 32-bit integers, because sums and copies of floats may change the bits of numbers that are not finite.

use std::sync::Arc;

use ort::AsPointer;
use ort::session::Session;
use ort::sys::ONNXTensorElementDataType as Element;

use super::adapter_errors::call_provider;
use super::buffer::{DeviceBuffer, WORD};
use super::plugin::{LOCK, Plugin, refuse_other_providers};
use super::value::{Value, check};
use crate::Result;
use crate::bundle::{DataType, ModelWriter, Precision};
use crate::runtime::aligned_buffer::AlignedBuffer;
use crate::runtime::execution_context::Region;
use crate::runtime::failure::make;
use crate::runtime::self_test;

/// One buffer's part of a move: rows of `row` words from one buffer to another.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct MoveShape {
    /// Words of a row.
    pub(super) row: usize,
    /// Rows of the buffer that is read, and of the one that is written.
    pub(super) from_rows: usize,
    pub(super) to_rows: usize,
    /// Rows that are moved.
    pub(super) rows: usize,
}

/// One part of a graph of moves.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Move {
    pub(super) shape: MoveShape,
    /// The lists of row numbers, among those of the graph: which rows are read, and where they are written. Parts share lists.
    pub(super) lists: [usize; 2],
}

/// The rows of a move: which are read, and where they are written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct MovedRows {
    pub(super) from: Vec<i64>,
    pub(super) to: Vec<i64>,
}

/// The shape and the rows of a copy between buffers of `from` and `to` bytes; `None` if a region does not begin or end with a word.
pub(super) fn rows_of(regions: &[Region], from: usize, to: usize) -> Option<(MoveShape, MovedRows)> {
    let numbers = regions.iter().flat_map(|r| [r.from, r.to, r.len]).chain([from, to]);
    let unit = numbers.fold(0, gcd);
    if unit == 0 || !unit.is_multiple_of(WORD) {
        return None;
    }
    let row = |at: usize| (at / unit) as i64;
    let list = |start: fn(&Region) -> usize| {
        regions.iter().flat_map(|r| (0..r.len / unit).map(move |i| row(start(r)) + i as i64)).collect::<Vec<_>>()
    };
    let rows = MovedRows { from: list(|r| r.from), to: list(|r| r.to) };
    let shape = MoveShape { row: unit / WORD, from_rows: from / unit, to_rows: to / unit, rows: rows.from.len() };
    Some((shape, rows))
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// A model that makes the given moves with lists of `lists` row numbers. Inputs are, for each move `i`, `to.i` and `from.i`, and for each list `k`
/// `read.k` or `written.k` or both: the same numbers, as a list or as a column. Output `moved.i` must have the memory of `to.i`, whose other rows then stay as they are.
pub(super) fn moves(moves: &[Move], lists: &[usize]) -> Vec<u8> {
    let mut model = ModelWriter::default();
    for ListInput { name, list, is_column } in list_inputs(moves) {
        model.input(&name, DataType::I64, &[lists[list], 1][..1 + usize::from(is_column)]);
    }
    for (i, Move { shape, lists }) in moves.iter().enumerate() {
        let [to, from, taken, moved] = names(i);
        let (source, target) = (list_name(lists[0], false), list_name(lists[1], true));
        model.input(&to, DataType::I32, &[shape.to_rows, shape.row]);
        model.input(&from, DataType::I32, &[shape.from_rows, shape.row]);
        model.node("Gather", &[&from, &source], &[&taken], &[("axis", 0)]);
        model.node("ScatterND", &[&to, &target, &taken], &[&moved], &[]);
        model.output(&moved, DataType::I32, &[shape.to_rows, shape.row]);
    }
    model.finish()
}

/// Names of the values of move `i`: what is written, what is read, the rows between, and the result.
pub(super) fn names(i: usize) -> [String; 4] {
    ["to", "from", "taken", "moved"].map(|what| format!("{what}.{i}"))
}

/// An input that is a list of row numbers.
pub(super) struct ListInput {
    pub(super) name: String,
    /// The list's number.
    pub(super) list: usize,
    /// Whether it has two dimensions, as rows that are written have.
    pub(super) is_column: bool,
}

/// The lists that a graph of moves has as inputs. One that is both read and written is two inputs, since no provider reshapes it on the adapter.
pub(super) fn list_inputs(moves: &[Move]) -> Vec<ListInput> {
    let mut used: Vec<_> = moves.iter().flat_map(|part| [(part.lists[0], false), (part.lists[1], true)]).collect();
    used.sort_unstable();
    used.dedup();
    used.into_iter().map(|(list, is_column)| ListInput { name: list_name(list, is_column), list, is_column }).collect()
}

fn list_name(list: usize, is_column: bool) -> String {
    format!("{}.{list}", if is_column { "written" } else { "read" })
}

/// A finite check: for each group of buffers, given by their words, the largest of the numbers that [`is_finite`] judges. Input `x.i` is a
/// buffer; the output `largest` has a number for each group.
pub(super) fn largest(groups: &[Vec<usize>], precision: Precision) -> Vec<u8> {
    let mut model = ModelWriter::default();
    model.constant("zero", &[1], &[0]);
    model.constant("least", &[1], &[i32::MIN]);
    // Removes the sign bit: of a float, or of the first and of the second half float of a word.
    let factors: &[i32] = match precision {
        Precision::F32 => &[2],
        Precision::F16 => &[2, 1 << 17],
    };
    for (f, factor) in factors.iter().enumerate() {
        model.constant(&format!("factor.{f}"), &[1], &[*factor]);
    }
    let mut results = Vec::new();
    let mut i = 0;
    for (g, group) in groups.iter().enumerate() {
        let mut parts = Vec::new();
        for words in group {
            let x = format!("x.{i}");
            model.input(&x, DataType::I32, &[*words]);
            for f in 0..factors.len() {
                let [shifted, is_high, high, part] =
                    ["shifted", "is_high", "high", "part"].map(|what| format!("{what}.{i}.{f}"));
                model.node("Mul", &[&x, &format!("factor.{f}")], &[&shifted], &[]);
                model.node("Less", &[&shifted, "zero"], &[&is_high], &[]);
                model.node("Where", &[&is_high, &shifted, "least"], &[&high], &[]);
                model.node("ReduceMax", &[&high], &[&part], &[("keepdims", 1)]);
                parts.push(part);
            }
            i += 1;
        }
        let (all, result) = (format!("all.{g}"), format!("group.{g}"));
        let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
        model.node("Concat", &parts, &[&all], &[("axis", 0)]);
        model.node("ReduceMax", &[&all], &[&result], &[("keepdims", 1)]);
        results.push(result);
    }
    let results: Vec<&str> = results.iter().map(String::as_str).collect();
    model.node("Concat", &results, &["largest"], &[("axis", 0)]);
    model.output("largest", DataType::I32, &[groups.len()]);
    model.finish()
}

/// Whether a group is finite whose largest number is `largest`.
///
/// A number is not finite if all bits of its exponent are set. Without the sign bit, such a word is the largest of all: from -2^24 on as a signed
/// integer for a float, whose exponent has eight bits, and from -2^27 on for a half float.
pub(super) fn is_finite(largest: i32, precision: Precision) -> bool {
    match precision {
        Precision::F32 => largest < -(1 << 24),
        Precision::F16 => largest < -(1 << 27),
    }
}

/// Whether the adapter gives the expected output of the self-test, whose `model` has numbers of `precision`.
pub(super) fn passes_self_test(plugin: &Arc<Plugin>, model: &[u8], precision: Precision) -> Result<bool> {
    let [given, expected] = self_test::input_and_output(precision);
    let element = match precision {
        Precision::F32 => Element::ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT,
        Precision::F16 => Element::ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT16,
    };
    let session = SessionUnderLock::new(plugin, model, "self-test")?;
    let mut memory = AlignedBuffer::zeroed(given.len())?;
    memory.bytes_mut().copy_from_slice(&given);
    let [x, y] = [DeviceBuffer::with_contents(plugin, &memory)?, DeviceBuffer::with_contents(plugin, &memory)?];
    let shape = [self_test::LENGTH];
    let binding =
        Binding::new(session.get(), &[(c"x", x.value(&shape, element)?)], &[(c"y", y.value(&shape, element)?)])?;
    binding.run(session.get())?;
    let mut result = vec![0; expected.len()];
    y.read(&mut result)?;
    Ok(result == expected)
}

/// A session of a helper graph, with every node on the adapter. It is made and dropped under the provider's lock.
pub(super) struct SessionUnderLock(Option<Session>);

impl SessionUnderLock {
    pub(super) fn new(plugin: &Plugin, model: &[u8], what: &str) -> Result<Self> {
        let mut builder = make("prepare a session", || plugin.session(false))?;
        let session = call_provider(|| {
            let session = make(&format!("load the {what}"), || builder.commit_from_memory(model))?;
            refuse_other_providers(&session, what, plugin.describe())?;
            Ok(session)
        })?;
        Ok(Self(Some(session)))
    }

    pub(super) fn get(&self) -> &Session {
        self.0.as_ref().expect("taken only when it is dropped")
    }
}

impl Drop for SessionUnderLock {
    fn drop(&mut self) {
        let _held = LOCK.lock();
        self.0.take();
    }
}

/// A session's inputs and outputs, bound to memory that its maker keeps alive.
pub(super) struct Binding(ort::session::IoBinding);

impl Binding {
    pub(super) fn new<N: AsRef<std::ffi::CStr>>(
        session: &Session,
        inputs: &[(N, Value)],
        outputs: &[(N, Value)],
    ) -> Result<Self> {
        let mut binding = make("bind a tensor", || session.create_binding())?;
        let api = ort::api();
        for (bind, values) in [(api.BindInput, inputs), (api.BindOutput, outputs)] {
            for (name, value) in values {
                // SAFETY: live name and value; the binding keeps its own reference to the value.
                check("bind a tensor", unsafe { bind(binding.ptr_mut(), name.as_ref().as_ptr(), value.ptr()) })?;
            }
        }
        Ok(Self(binding))
    }

    /// Runs the session, whose binding this is, and returns when its commands are on the adapter's queue.
    pub(super) fn run(&self, session: &Session) -> Result<()> {
        let run = ort::api().RunWithBinding;
        // SAFETY: a live session with its own binding, under the lock of all runs.
        call_provider(|| check("run a graph", unsafe { run(session.ptr().cast_mut(), std::ptr::null(), self.0.ptr()) }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_become_rows_of_the_largest_common_unit() {
        let regions = [Region { to: 96, from: 0, len: 32 }, Region { to: 224, from: 32, len: 32 }];
        let (shape, rows) = rows_of(&regions, 64, 256).unwrap();
        assert_eq!(shape, MoveShape { row: 8, from_rows: 2, to_rows: 8, rows: 2 });
        assert_eq!(rows, MovedRows { from: vec![0, 1], to: vec![3, 7] });
        // Half a word cannot be moved.
        assert_eq!(rows_of(&[Region { to: 2, from: 0, len: 2 }], 8, 8), None);
    }

    /// What the graph computes for one word.
    fn largest_of(word: i32, factors: &[i32]) -> i32 {
        let high = |factor: &i32| Some(word.wrapping_mul(*factor)).filter(|word| *word < 0).unwrap_or(i32::MIN);
        factors.iter().map(high).max().unwrap()
    }

    #[test]
    fn infinities_and_no_numbers_are_found_in_every_bit_pattern_of_a_half() {
        for bits in 0..=u16::MAX {
            let finite = half::f16::from_bits(bits).is_finite();
            for word in [u32::from(bits), u32::from(bits) << 16, u32::from(bits) << 16 | 0x7BFF] {
                let found = is_finite(largest_of(word.cast_signed(), &[2, 1 << 17]), Precision::F16);
                assert_eq!(found, finite, "{word:#x}");
            }
        }
        for value in
            [0.0, -0.0, f32::MAX, f32::MIN, f32::MIN_POSITIVE, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, -f32::NAN]
        {
            let found = is_finite(largest_of(value.to_bits().cast_signed(), &[2]), Precision::F32);
            assert_eq!(found, value.is_finite(), "{value}");
        }
    }
}
