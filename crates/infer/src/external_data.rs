//! Finds tensors whose data lie outside the model file.
//!
//! The check reads the fields of the protobuf message, with the field numbers of `onnx.proto`. The runtime rejects many
//! models with outside data, but not all. For example, it accepts a hard link to the data. This check rejects all such
//! models.

use crate::error::Refusal;

/// Largest depth of nested protobuf messages that is accepted.
const MAX_DEPTH: u32 = 32;

/// The kinds of protobuf messages that can contain tensors, directly or in nested messages.
#[derive(Clone, Copy)]
enum Message {
    Model,
    Graph,
    Function,
    Node,
    Attribute,
    SparseTensor,
    Tensor,
}

impl Message {
    /// Returns the kind of message in a field, or `None` if the field cannot contain a tensor.
    fn child(self, field: u64) -> Option<Self> {
        match (self, field) {
            (Self::Model, 7) => Some(Self::Graph),
            (Self::Model, 25) => Some(Self::Function),
            (Self::Graph, 1) | (Self::Function, 7) => Some(Self::Node),
            (Self::Graph, 5) | (Self::Attribute, 5 | 10) | (Self::SparseTensor, 1 | 2) => Some(Self::Tensor),
            (Self::Graph, 15) | (Self::Attribute, 22 | 23) => Some(Self::SparseTensor),
            (Self::Node, 5) | (Self::Function, 11) => Some(Self::Attribute),
            (Self::Attribute, 6 | 11) => Some(Self::Graph),
            _ => None,
        }
    }
}

/// One field of a message: its number and its value.
enum Field<'a> {
    Number(u64, u64),
    Bytes(u64, &'a [u8]),
}

struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, count: u64) -> Result<&'a [u8], Refusal> {
        let count = usize::try_from(count).ok().filter(|&n| n <= self.0.len());
        let (head, rest) = self.0.split_at(count.ok_or(Refusal::NotOnnx("it is cut short"))?);
        self.0 = rest;
        Ok(head)
    }

    fn varint(&mut self) -> Result<u64, Refusal> {
        let mut value = 0_u64;
        for shift in (0..64).step_by(7) {
            let byte = self.take(1)?.first().copied().unwrap_or_default();
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(Refusal::NotOnnx("a number has no end"))
    }

    fn next(&mut self) -> Result<Option<Field<'a>>, Refusal> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let key = self.varint()?;
        let field = key >> 3;
        Ok(Some(match key & 7 {
            0 => Field::Number(field, self.varint()?),
            1 => Field::Bytes(field, self.take(8)?),
            2 => {
                let count = self.varint()?;
                Field::Bytes(field, self.take(count)?)
            }
            5 => Field::Bytes(field, self.take(4)?),
            _ => return Err(Refusal::NotOnnx("unknown kind of field")),
        }))
    }
}

/// Returns an error if a tensor lies outside the file, or if the bytes are not a protobuf message.
pub(crate) fn refuse_external_data(model: &[u8]) -> Result<(), Refusal> {
    walk(Message::Model, model, 0)
}

fn walk(kind: Message, bytes: &[u8], depth: u32) -> Result<(), Refusal> {
    if depth > MAX_DEPTH {
        return Err(Refusal::NotOnnx("nested too deeply"));
    }
    let mut reader = Reader(bytes);
    let mut name = String::new();
    let mut external = false;
    while let Some(field) = reader.next()? {
        match (kind, field) {
            (Message::Tensor, Field::Bytes(8, text)) => name = String::from_utf8_lossy(text).into_owned(),
            (Message::Tensor, Field::Bytes(13, _)) => external = true,
            (Message::Tensor, Field::Number(14, location)) => external |= location != 0,
            (Message::Tensor, _) | (_, Field::Number(..)) => {}
            (_, Field::Bytes(field, inner)) => {
                if let Some(child) = kind.child(field) {
                    walk(child, inner, depth + 1)?;
                }
            }
        }
    }
    if external { Err(Refusal::ExternalData(name)) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(field: u8, inner: &[u8]) -> Vec<u8> {
        let mut bytes = vec![field << 3 | 2, u8::try_from(inner.len()).unwrap()];
        bytes.extend_from_slice(inner);
        bytes
    }

    #[test]
    fn external_tensors_are_found_wherever_they_are() {
        let tensor = [message(8, b"weights"), vec![14 << 3, 1]].concat();
        let as_initializer = message(7, &message(5, &tensor));
        let in_a_node = message(7, &message(1, &message(5, &message(5, &tensor))));
        let in_a_branch = message(7, &message(1, &message(5, &message(6, &message(5, &tensor)))));
        for model in [as_initializer, in_a_node, in_a_branch] {
            assert!(
                matches!(refuse_external_data(&model), Err(Refusal::ExternalData(name)) if name == "weights")
            );
        }
        let by_location_alone = message(7, &message(5, &message(13, b"x")));
        assert!(matches!(refuse_external_data(&by_location_alone), Err(Refusal::ExternalData(_))));
        assert!(refuse_external_data(&message(7, &message(5, &message(8, b"weights")))).is_ok());
    }

    #[test]
    fn broken_bytes_end_in_an_error() {
        assert!(refuse_external_data(&[0x3a, 0xff]).is_err());
        assert!(refuse_external_data(&[0xff; 20]).is_err());
        let mut nested = Vec::new();
        for _ in 0..20 {
            nested = message(1, &message(5, &message(6, &nested)));
            nested.truncate(100);
        }
        let _ = refuse_external_data(&message(7, &nested));
    }
}
