//! Writer of protobuf's wire format.

use super::messages::ModelProto;
use super::wire::{Field, Fields, Value};
use super::{CheckResult, Fault};

impl Field<'_> {
    /// Appends the field to `message`, unchanged.
    pub(super) fn write(&self, message: &mut Vec<u8>) {
        match self.value {
            Value::Varint(value) => write_int(message, self.number, value),
            Value::Bytes(bytes) => write_bytes(message, self.number, bytes),
            Value::Fixed32(bytes) => {
                write_varint(message, u64::from(self.number) << 3 | 5);
                message.extend_from_slice(&bytes);
            }
        }
    }
}

/// An empty message with room for `bytes` bytes.
pub(super) fn reserved(bytes: usize) -> CheckResult<Vec<u8>> {
    let mut message = Vec::new();
    message.try_reserve_exact(bytes).map_err(Fault::no_memory)?;
    Ok(message)
}

/// The model with another graph, which `rewrite` makes of the bytes of its own. Memory of `bytes` bytes is reserved for the result, and can fail.
pub(super) fn with_graph(
    onnx: &[u8],
    bytes: usize,
    rewrite: impl Fn(&[u8]) -> CheckResult<Vec<u8>>,
) -> CheckResult<Vec<u8>> {
    let mut written = reserved(bytes)?;
    let mut fields = Fields::new("the model", onnx);
    while let Some(field) = fields.next()? {
        match field.number {
            ModelProto::GRAPH => write_bytes(&mut written, ModelProto::GRAPH, &rewrite(field.bytes()?)?),
            _ => field.write(&mut written),
        }
    }
    Ok(written)
}

/// Appends a field that is an integer.
pub(super) fn write_int(message: &mut Vec<u8>, number: u32, value: u64) {
    write_varint(message, u64::from(number) << 3);
    write_varint(message, value);
}

/// Appends a field that is bytes, a text or a message.
pub(super) fn write_bytes(message: &mut Vec<u8>, number: u32, bytes: &[u8]) {
    write_varint(message, u64::from(number) << 3 | 2);
    write_varint(message, bytes.len() as u64);
    message.extend_from_slice(bytes);
}

fn write_varint(message: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        message.push(value as u8 | 0x80);
        value >>= 7;
    }
    message.push(value as u8);
}

#[cfg(test)]
mod tests {
    use super::super::wire::Fields;

    #[test]
    fn fields_are_written_as_they_were_read() {
        let minus_one = [&[0x08_u8][..], &[0xFF; 9], &[0x01]].concat();
        let message =
            [&minus_one[..], b"\x92\x01\x02hi", &[0x15, 0, 0, 0x80, 0x3F], &[0x98, 0x02, 0x80, 0x01]].concat();
        let (mut fields, mut written) = (Fields::new("a test", &message), Vec::new());
        while let Some(field) = fields.next().unwrap() {
            field.write(&mut written);
        }
        assert_eq!(written, message);
    }
}
