//! Reads arrays of 32-bit floats from a Python pickle of nested dictionaries, without running anything in it.
//!
//! A pickle is a program that names functions to call. This interpreter supports the few instructions needed for numpy arrays in dictionaries,
//! and three names, none of which it calls; it rejects everything else. Array data is borrowed from the file, and lengths are checked
//! against the file's size.

use std::collections::BTreeMap;

/// Maximum number of instructions; the known files have fewer than a thousand.
const LONGEST: usize = 4096;
/// Maximum length of an array's path, in bytes; the known files have at most 30. Without it, a key that is used at every depth would make
/// paths that are longer than the file by a factor of [`LONGEST`].
const LONGEST_NAME: usize = 1024;

// Opcodes of Python's `pickle` module, by its names.
const PROTO: u8 = 0x80;
const STOP: u8 = b'.';
const MARK: u8 = b'(';
const NONE: u8 = b'N';
const NEWTRUE: u8 = 0x88;
const NEWFALSE: u8 = 0x89;
const BININT: u8 = b'J';
const BININT1: u8 = b'K';
const BININT2: u8 = b'M';
const BINUNICODE: u8 = b'X';
const SHORT_BINBYTES: u8 = b'C';
const BINBYTES: u8 = b'B';
const GLOBAL: u8 = b'c';
const EMPTY_DICT: u8 = b'}';
const TUPLE: u8 = b't';
const TUPLE1: u8 = 0x85;
const TUPLE3: u8 = 0x87;
const REDUCE: u8 = b'R';
const BUILD: u8 = b'b';
const SETITEM: u8 = b's';
const SETITEMS: u8 = b'u';
const BINPUT: u8 = b'q';
const LONG_BINPUT: u8 = b'r';
const BINGET: u8 = b'h';
const LONG_BINGET: u8 = b'j';

/// An array in the file: little-endian 32-bit floats, the last axis fastest.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Array<'a> {
    pub(super) shape: Vec<usize>,
    /// Four bytes per value.
    pub(super) bytes: &'a [u8],
}

/// Arrays by their path in the nested dictionaries, such as `VGG16_0/Conv_0/kernel`.
pub(super) type Arrays<'a> = BTreeMap<String, Array<'a>>;

/// The arrays of a pickle, or an error if it has anything else.
pub(super) fn read(bytes: &[u8]) -> Result<Arrays<'_>, String> {
    let mut machine = Machine { rest: bytes, stack: Vec::new(), memo: BTreeMap::new() };
    for _ in 0..LONGEST {
        if let Some(found) = machine.step()? {
            let Value::Dictionary(found) = found else { return Err("it is no dictionary".into()) };
            return Ok(found);
        }
    }
    Err(format!("it has more than {LONGEST} instructions"))
}

#[derive(Debug, Clone)]
enum Value<'a> {
    Mark,
    None,
    Bool(bool),
    Int(i64),
    Text(&'a str),
    Bytes(&'a [u8]),
    Name(Name),
    Tuple(Vec<Value<'a>>),
    /// Little-endian 32-bit floats.
    Type,
    /// An array whose data has not been read yet.
    Empty,
    Array(Array<'a>),
    /// A dictionary; nested dictionaries are flattened.
    Dictionary(Arrays<'a>),
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Name {
    Reconstruct,
    Array,
    Type,
}

struct Machine<'a> {
    rest: &'a [u8],
    stack: Vec<Value<'a>>,
    memo: BTreeMap<u32, Value<'a>>,
}

impl<'a> Machine<'a> {
    /// Executes one instruction; the last one returns the result.
    fn step(&mut self) -> Result<Option<Value<'a>>, String> {
        let code = self.take(1)?[0];
        let value = match code {
            PROTO => match self.take(1)?[0] {
                2 | 3 => return Ok(None),
                other => return Err(format!("protocol {other} is none of 2 and 3")),
            },
            STOP => return self.pop().map(Some),
            MARK => Value::Mark,
            NONE => Value::None,
            NEWTRUE => Value::Bool(true),
            NEWFALSE => Value::Bool(false),
            BININT1 => Value::Int(self.take(1)?[0].into()),
            BININT2 => Value::Int(self.number::<2>()?),
            BININT => Value::Int(i64::from(self.number::<4>()? as u32 as i32)),
            BINUNICODE => {
                let length = self.number::<4>()?;
                Value::Text(std::str::from_utf8(self.take(length)?).map_err(|_| "a text is not UTF-8")?)
            }
            SHORT_BINBYTES => {
                let length = self.take(1)?[0];
                Value::Bytes(self.take(length)?)
            }
            BINBYTES => {
                let length = self.number::<4>()?;
                Value::Bytes(self.take(length)?)
            }
            GLOBAL => Value::Name(self.name()?),
            EMPTY_DICT => Value::Dictionary(Arrays::new()),
            TUPLE => Value::Tuple(self.pop_mark()?),
            TUPLE1..=TUPLE3 => {
                let count = usize::from(code - TUPLE1 + 1);
                let first = self.stack.len().checked_sub(count).ok_or("the stack is too short")?;
                Value::Tuple(self.stack.split_off(first))
            }
            REDUCE => self.call()?,
            BUILD => self.build()?,
            SETITEM => {
                let (value, key) = (self.pop()?, self.pop()?);
                return self.insert(vec![key, value]).map(|()| None);
            }
            SETITEMS => {
                let items = self.pop_mark()?;
                return self.insert(items).map(|()| None);
            }
            BINPUT | LONG_BINPUT => {
                let key = if code == BINPUT { self.take(1)?[0].into() } else { self.number::<4>()? as u32 };
                // Only plain values are memoised: a shared dictionary or array would have two owners.
                if let Some(plain @ (Value::Text(_) | Value::Bytes(_) | Value::Name(_) | Value::Type)) =
                    self.stack.last()
                {
                    self.memo.insert(key, plain.clone());
                }
                return Ok(None);
            }
            BINGET | LONG_BINGET => {
                let key = if code == BINGET { self.take(1)?[0].into() } else { self.number::<4>()? as u32 };
                self.memo.get(&key).cloned().ok_or("it refers to something that is not kept")?
            }
            other => return Err(format!("the instruction {other:#04x} is not allowed")),
        };
        self.stack.push(value);
        Ok(None)
    }

    fn take(&mut self, count: impl TryInto<usize>) -> Result<&'a [u8], String> {
        let count = count.try_into().map_err(|_| "a length is negative")?;
        let (taken, rest) = self.rest.split_at_checked(count).ok_or("it ends too early")?;
        self.rest = rest;
        Ok(taken)
    }

    /// `N` little-endian bytes, unsigned.
    fn number<const N: usize>(&mut self) -> Result<i64, String> {
        Ok(self.take(N)?.iter().rev().fold(0, |number, byte| number << 8 | i64::from(*byte)))
    }

    fn pop(&mut self) -> Result<Value<'a>, String> {
        self.stack.pop().ok_or_else(|| "the stack is empty".into())
    }

    /// Pops everything above the last mark, and the mark.
    fn pop_mark(&mut self) -> Result<Vec<Value<'a>>, String> {
        let mark = self.stack.iter().rposition(|value| matches!(value, Value::Mark)).ok_or("a mark is missing")?;
        let above = self.stack.split_off(mark + 1);
        self.stack.pop();
        Ok(above)
    }

    fn name(&mut self) -> Result<Name, String> {
        let line = |machine: &mut Self| {
            let end = machine.rest.iter().take(64).position(|b| *b == b'\n').ok_or("a name has no end")?;
            let line = machine.take(end)?;
            machine.take(1).map(|_| line)
        };
        let (module, name) = (line(self)?, line(self)?);
        match (module, name) {
            (b"numpy.core.multiarray" | b"numpy._core.multiarray", b"_reconstruct") => Ok(Name::Reconstruct),
            (b"numpy", b"ndarray") => Ok(Name::Array),
            (b"numpy", b"dtype") => Ok(Name::Type),
            _ => {
                let [module, name] = [module, name].map(String::from_utf8_lossy);
                Err(format!("the name {module}.{name} is not allowed"))
            }
        }
    }

    /// `_reconstruct(ndarray, (0,), b"b")` and `dtype("f4", False, True)`.
    fn call(&mut self) -> Result<Value<'a>, String> {
        let (arguments, function) = (self.pop()?, self.pop()?);
        let (Value::Name(function), Value::Tuple(arguments)) = (function, arguments) else {
            return Err("it calls what is no function".into());
        };
        match (function, arguments.as_slice()) {
            (Name::Reconstruct, [Value::Name(Name::Array), Value::Tuple(shape), Value::Bytes(b"b")])
                if matches!(shape.as_slice(), [Value::Int(0)]) =>
            {
                Ok(Value::Empty)
            }
            (Name::Type, [Value::Text("f4"), Value::Bool(false), Value::Bool(true)]) => Ok(Value::Type),
            _ => Err("a function has arguments that are not allowed; only arrays of 32-bit floats are".into()),
        }
    }

    /// Sets an array's data, or a type's byte order.
    fn build(&mut self) -> Result<Value<'a>, String> {
        let (state, object) = (self.pop()?, self.pop()?);
        let Value::Tuple(state) = state else { return Err("a state is no tuple".into()) };
        match (object, state.as_slice()) {
            (Value::Type, [Value::Int(3), Value::Text("<"), Value::None, Value::None, Value::None, ..]) => {
                Ok(Value::Type)
            }
            (
                Value::Empty,
                [Value::Int(1), Value::Tuple(shape), Value::Type, Value::Bool(false), Value::Bytes(bytes)],
            ) => {
                let side = |value: &Value<'_>| match value {
                    Value::Int(side) => usize::try_from(*side).ok(),
                    _ => None,
                };
                let shape: Option<Vec<usize>> = shape.iter().map(side).collect();
                let shape = shape.ok_or("the shape of an array is no tuple of numbers")?;
                let size = shape.iter().try_fold(4usize, |size, side| size.checked_mul(*side));
                if size != Some(bytes.len()) {
                    return Err(format!("an array of {shape:?} has {} bytes", bytes.len()));
                }
                Ok(Value::Array(Array { shape, bytes }))
            }
            _ => Err("a state is not one of an array of little-endian 32-bit floats".into()),
        }
    }

    /// Inserts alternating keys and values into the dictionary on top of the stack.
    fn insert(&mut self, items: Vec<Value<'a>>) -> Result<(), String> {
        let Some(Value::Dictionary(dictionary)) = self.stack.last_mut() else {
            return Err("it fills what is no dictionary".into());
        };
        let mut items = items.into_iter();
        while let Some(key) = items.next() {
            let Value::Text(key) = key else { return Err("a key is no text".into()) };
            let is_too_long = |name: &str| key.len() + 1 + name.len() > LONGEST_NAME;
            match items.next() {
                Some(Value::Array(_)) if is_too_long("") => return Err("a name is too long".into()),
                Some(Value::Dictionary(inner)) if inner.keys().any(|name| is_too_long(name)) => {
                    return Err("a name is too long".into());
                }
                Some(Value::Array(array)) => _ = dictionary.insert(key.to_owned(), array),
                Some(Value::Dictionary(inner)) => {
                    dictionary.extend(inner.into_iter().map(|(name, array)| (format!("{key}/{name}"), array)));
                }
                _ => return Err(format!("{key} is neither an array nor a dictionary")),
            }
        }
        Ok(())
    }
}

/// `{"a": {"b": array([[1, 2]], dtype="<f4")}}` as numpy 1 and Python's protocol 3 write it: the seed of the tests and of the fuzz
/// target.
pub(crate) fn sample() -> Vec<u8> {
    let mut bytes = b"\x80\x03}q\x00X\x01\x00\x00\x00aq\x01}q\x02X\x01\x00\x00\x00bq\x03".to_vec();
    bytes.extend(
        b"cnumpy.core.multiarray\n_reconstruct\nq\x04cnumpy\nndarray\nq\x05K\x00\x85q\x06C\x01bq\x07\x87q\x08R",
    );
    bytes.extend(b"q\x09(K\x01K\x01K\x02\x86q\x0acnumpy\ndtype\nq\x0bX\x02\x00\x00\x00f4q\x0c\x89\x88\x87q\x0dRq\x0e");
    bytes
        .extend(b"(K\x03X\x01\x00\x00\x00<q\x0fNNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tq\x10b\x89B\x08\x00\x00\x00");
    bytes.extend([1.0f32, 2.0].iter().flat_map(|v| v.to_le_bytes()));
    bytes.extend(b"q\x11tq\x12bss.");
    bytes
}

/// Checks that each array of an accepted file has as many bytes as its shape needs. Returns the number of arrays; `None` for a refused
/// file.
pub(crate) fn check(bytes: &[u8]) -> Option<usize> {
    let arrays = read(bytes).ok()?;
    for (name, array) in &arrays {
        assert_eq!(Some(array.bytes.len()), array.shape.iter().try_fold(4usize, |size, side| size.checked_mul(*side)));
        assert!(name.len() <= LONGEST_NAME);
    }
    Some(arrays.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nested_arrays_are_found_by_their_path() {
        let bytes = sample();
        let arrays = read(&bytes).unwrap();
        let numbers: Vec<u8> = [1.0f32, 2.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        let expected = Array { shape: vec![1, 2], bytes: &numbers };
        assert_eq!(arrays, Arrays::from([("a/b".to_owned(), expected)]));
    }

    #[test]
    fn another_name_is_refused_by_that_name() {
        let error = read(b"\x80\x03cos\nsystem\nX\x02\x00\x00\x00ls\x85R.").unwrap_err();
        assert!(error.contains("os.system is not allowed"), "{error}");
    }

    #[test]
    fn damage_of_any_byte_is_no_panic_and_no_other_shape() {
        let whole = sample();
        for length in 0..whole.len() {
            read(&whole[..length]).unwrap_err();
        }
        for at in 0..whole.len() {
            for flip in [1, 0x20, 0x80, 0xff] {
                let mut bytes = whole.clone();
                bytes[at] ^= flip;
                if let Ok(arrays) = read(&bytes) {
                    assert!(arrays.values().all(|a| a.bytes.len() == 4 * a.shape.iter().product::<usize>()));
                }
            }
        }
    }

    #[test]
    fn a_key_that_is_used_at_every_depth_makes_no_endless_name() {
        // Protocol, 200 dictionaries each below a memoised key of 60 bytes, the sample's dictionary, and what sets each in its outer one.
        let nested = |depth: usize| {
            let mut bytes = b"\x80\x03X\x3c\x00\x00\x00".to_vec();
            bytes.extend([b'k'; 60]);
            bytes.extend(b"q\xf0");
            (0..depth).for_each(|_| bytes.extend(b"}h\xf0"));
            let whole = sample();
            bytes.extend(&whole[2..whole.len() - 1]);
            (0..depth).for_each(|_| bytes.push(b's'));
            bytes.push(b'.');
            bytes
        };
        assert_eq!(read(&nested(3)).unwrap().keys().next().unwrap().len(), 3 * 61 + 3);
        assert!(read(&nested(200)).unwrap_err().contains("too long"));
    }

    #[test]
    fn endless_nesting_ends() {
        let mut bytes = b"\x80\x03N".to_vec();
        bytes.resize(1 << 20, 0x85);
        assert!(read(&bytes).unwrap_err().contains("4096"));
    }
}
