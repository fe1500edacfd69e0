//! Reader of protobuf's wire format, zero-copy, for untrusted input.
//!
//! Only what ONNX needs: varints, 32-bit numbers and length-delimited bytes. Groups, 64-bit numbers and ambiguous encodings are
//! refused. Nothing here recurses or allocates for a length that a file claims.
//! Encoding: <https://protobuf.dev/programming-guides/encoding/>.

use super::{CheckResult, Fault};

/// One field's value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Value<'a> {
    Varint(u64),
    Bytes(&'a [u8]),
    Fixed32([u8; 4]),
}

/// The fields of one message, in file order.
pub(super) struct Fields<'a> {
    rest: &'a [u8],
    /// Name of the message, for error texts.
    message: &'static str,
}

impl<'a> Fields<'a> {
    pub(super) fn new(message: &'static str, bytes: &'a [u8]) -> Self {
        Self { rest: bytes, message }
    }

    /// The next field's number and value, `None` at the end.
    pub(super) fn next(&mut self) -> CheckResult<Option<Field<'a>>> {
        if self.rest.is_empty() {
            return Ok(None);
        }
        let message = self.message;
        let tag = self.varint()?;
        let number = u32::try_from(tag >> 3).ok().filter(|n| (1..1 << 29).contains(n));
        let number = number.ok_or_else(|| Fault::new(format!("{message} has a field number out of range")))?;
        let value = match tag & 7 {
            0 => Value::Varint(self.varint()?),
            2 => {
                let length = self.varint()?;
                Value::Bytes(self.take(length)?)
            }
            5 => {
                let bytes = self.take(4)?;
                Value::Fixed32([bytes[0], bytes[1], bytes[2], bytes[3]])
            }
            wire => {
                return Err(Fault::new(format!(
                    "{message} has field {number} of the wire type {wire}, which ONNX has not"
                )));
            }
        };
        Ok(Some(Field { message, number, value }))
    }

    fn take(&mut self, length: u64) -> CheckResult<&'a [u8]> {
        let split = usize::try_from(length).ok().and_then(|n| self.rest.split_at_checked(n));
        let (bytes, rest) =
            split.ok_or_else(|| Fault::new(format!("{} ends inside a field of {length} bytes", self.message)))?;
        self.rest = rest;
        Ok(bytes)
    }

    fn varint(&mut self) -> CheckResult<u64> {
        let mut value = 0_u64;
        for shift in (0..64).step_by(7) {
            let byte = self.take(1)?[0];
            let part = u64::from(byte & 0x7F);
            if shift == 63 && part > 1 {
                break;
            }
            value |= part << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(Fault::new(format!("{} has a number of more than 64 bits", self.message)))
    }
}

/// One field of a message.
#[derive(Debug, Clone, Copy)]
pub(super) struct Field<'a> {
    message: &'static str,
    pub(super) number: u32,
    pub(super) value: Value<'a>,
}

impl<'a> Field<'a> {
    /// An integer; negative ones have all 64 bits.
    pub(super) fn int(&self) -> CheckResult<i64> {
        match self.value {
            Value::Varint(value) => Ok(value.cast_signed()),
            _ => Err(self.mistyped("an integer")),
        }
    }

    pub(super) fn float(&self) -> CheckResult<f32> {
        match self.value {
            Value::Fixed32(bytes) => Ok(f32::from_le_bytes(bytes)),
            _ => Err(self.mistyped("a float")),
        }
    }

    pub(super) fn bytes(&self) -> CheckResult<&'a [u8]> {
        match self.value {
            Value::Bytes(bytes) => Ok(bytes),
            _ => Err(self.mistyped("bytes")),
        }
    }

    /// UTF-8 of at most `most` bytes.
    pub(super) fn text(&self, most: usize) -> CheckResult<&'a str> {
        let bytes = self.bytes()?;
        if bytes.len() > most {
            return Err(self.fault(format!("has {} bytes, at most {most} are allowed", bytes.len())));
        }
        std::str::from_utf8(bytes).map_err(|_| self.fault("is no UTF-8"))
    }

    /// Appends one integer, or all integers of a packed field, to a list of at most `most` entries.
    pub(super) fn ints(&self, list: &mut Vec<i64>, most: usize) -> CheckResult<()> {
        match self.value {
            Value::Varint(value) => list.push(value.cast_signed()),
            Value::Bytes(bytes) => {
                let mut packed = Fields::new(self.message, bytes);
                while !packed.rest.is_empty() {
                    list.push(packed.varint()?.cast_signed());
                    if list.len() > most {
                        break;
                    }
                }
            }
            Value::Fixed32(_) => return Err(self.mistyped("integers")),
        }
        if list.len() > most { Err(self.fault(format!("has more than {most} numbers"))) } else { Ok(()) }
    }

    /// A sub-message.
    pub(super) fn message(&self, message: &'static str) -> CheckResult<Fields<'a>> {
        Ok(Fields::new(message, self.bytes()?))
    }

    /// Stores `value` in an empty slot, and refuses a repeated field: protobuf lets a later field replace or merge with an earlier one,
    /// and readers may differ on which.
    pub(super) fn once<T>(&self, slot: &mut Option<T>, value: T) -> CheckResult<()> {
        match slot.replace(value) {
            None => Ok(()),
            Some(_) => Err(self.fault("is given twice")),
        }
    }

    /// Error for a field that no bundle needs.
    pub(super) fn refuse<T>(&self, meaning: &str) -> CheckResult<T> {
        Err(self.fault(format!("({meaning}) is not allowed")))
    }

    pub(super) fn fault(&self, cause: impl std::fmt::Display) -> Fault {
        Fault::new(format!("field {} of {} {cause}", self.number, self.message))
    }

    fn mistyped(&self, wanted: &str) -> Fault {
        self.fault(format!("is not {wanted}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first(bytes: &[u8]) -> CheckResult<Option<Field<'_>>> {
        Fields::new("a test", bytes).next()
    }

    #[test]
    fn numbers_and_bytes_are_read() {
        let field = first(&[0x08, 0x96, 0x01]).unwrap().unwrap();
        assert_eq!((field.number, field.int().unwrap()), (1, 150));
        let minus_one = [&[0x08_u8][..], &[0xFF; 9], &[0x01]].concat();
        assert_eq!(first(&minus_one).unwrap().unwrap().int().unwrap(), -1);
        assert_eq!(first(b"\x12\x02hi").unwrap().unwrap().text(2).unwrap(), "hi");
        assert_eq!(first(&[0x15, 0, 0, 0x80, 0x3F]).unwrap().unwrap().float().unwrap(), 1.0);
        assert!(first(&[]).unwrap().is_none());
    }

    #[test]
    fn hostile_bytes_are_refused() {
        let over = [&[0x08_u8][..], &[0xFF; 9], &[0x02]].concat();
        let endless = [&[0x08_u8][..], &[0x80; 40]].concat();
        let huge_length = [&[0x12_u8][..], &[0xFF; 9], &[0x01]].concat();
        let cases: [&[u8]; 9] = [
            &over,
            &endless,
            &huge_length,
            &[0x08],
            &[0x12, 5, 1],
            &[0x15, 0, 0],
            &[0x09, 0, 0, 0, 0, 0, 0, 0, 0],
            &[0x0B, 0x0C],
            &[0x00, 0x00],
        ];
        for bytes in cases {
            assert!(first(bytes).is_err(), "{bytes:?}");
        }
    }

    #[test]
    fn wrong_types_repeats_and_long_lists_are_refused() {
        let int = first(&[0x08, 1]).unwrap().unwrap();
        assert!(int.float().is_err() && int.bytes().is_err() && int.text(9).is_err());
        let mut slot = None;
        int.once(&mut slot, 1).unwrap();
        assert!(int.once(&mut slot, 2).is_err());
        let packed = first(&[0x0A, 3, 1, 2, 3]).unwrap().unwrap();
        assert!(packed.int().is_err() && packed.text(2).is_err());
        let mut list = Vec::new();
        packed.ints(&mut list, 3).unwrap();
        assert_eq!(list, [1, 2, 3]);
        assert!(packed.ints(&mut list, 5).is_err());
    }
}
