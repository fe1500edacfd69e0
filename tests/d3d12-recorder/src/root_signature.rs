//! Serialized root signatures of versions 1.0 and 1.1.

/// Kind of a descriptor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DescriptorKind {
    /// Shader resource view.
    Srv,
    /// Unordered access view.
    Uav,
    /// Constant buffer view.
    Cbv,
    /// Sampler.
    Sampler,
    /// Render target or depth stencil view.
    Target,
}

/// Consecutive descriptors of a table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Range {
    /// Their kind.
    pub kind: DescriptorKind,
    /// Their number; `None` without a limit.
    pub count: Option<u32>,
    /// The first one's place in the table.
    pub offset: u32,
}

/// A root parameter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Parameter {
    /// A descriptor table.
    Table(Vec<Range>),
    /// This number of 32-bit constants.
    Constants(u32),
    /// A root descriptor.
    Descriptor(DescriptorKind),
}

/// A root signature.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RootSignature {
    /// Its parameters.
    pub parameters: Vec<Parameter>,
}

/// Reads 32-bit words at byte offsets.
struct Words<'a>(&'a [u8]);

impl Words<'_> {
    fn at(&self, offset: usize) -> Option<u32> {
        let bytes = self.0.get(offset..offset.checked_add(4)?)?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?))
    }
}

/// `D3D12_DESCRIPTOR_RANGE_OFFSET_APPEND`, and the number of descriptors of a range without a limit.
const APPEND: u32 = u32::MAX;

impl RootSignature {
    /// Reads the part `RTS0` of a container.
    pub fn parse(container: &[u8]) -> Option<Self> {
        let words = Words(container);
        if container.get(..4)? != b"DXBC" {
            return None;
        }
        let starts = (0..words.at(28)? as usize).map_while(|i| words.at(32 + 4 * i).map(|start| start as usize));
        let start = starts.into_iter().find(|&start| container.get(start..start + 4) == Some(b"RTS0"))?;
        let part = Words(container.get(start + 8..start + 8 + words.at(start + 4)? as usize)?);
        let is_1_1 = match part.at(0)? {
            1 => false,
            2 => true,
            _ => return None,
        };
        let (count, first) = (part.at(4)? as usize, part.at(8)? as usize);
        let parameters = (0..count).map(|i| parameter(&part, first + 12 * i, is_1_1)).collect::<Option<_>>()?;
        Some(Self { parameters })
    }
}

fn parameter(part: &Words<'_>, at: usize, is_1_1: bool) -> Option<Parameter> {
    let content = part.at(at + 8)? as usize;
    Some(match part.at(at)? {
        0 => {
            let (count, first) = (part.at(content)? as usize, part.at(content + 4)? as usize);
            let size = if is_1_1 { 24 } else { 20 };
            let mut next = Some(0);
            let range = |i: usize| {
                let at = first + size * i;
                let number = part.at(at + 4)?;
                let offset = match part.at(at + size - 4)? {
                    APPEND => next?,
                    offset => offset,
                };
                let count = (number != APPEND).then_some(number);
                next = count.and_then(|count| offset.checked_add(count));
                Some(Range { kind: kind_of_range(part.at(at)?)?, count, offset })
            };
            Parameter::Table((0..count).map(range).collect::<Option<_>>()?)
        }
        1 => Parameter::Constants(part.at(content + 8)?),
        2 => Parameter::Descriptor(DescriptorKind::Cbv),
        3 => Parameter::Descriptor(DescriptorKind::Srv),
        4 => Parameter::Descriptor(DescriptorKind::Uav),
        _ => return None,
    })
}

fn kind_of_range(kind: u32) -> Option<DescriptorKind> {
    Some(match kind {
        0 => DescriptorKind::Srv,
        1 => DescriptorKind::Uav,
        2 => DescriptorKind::Cbv,
        3 => DescriptorKind::Sampler,
        _ => return None,
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A container with one part.
    fn container(part: &[u32]) -> Vec<u8> {
        let mut bytes = b"DXBC".to_vec();
        bytes.extend([0; 16]);
        let size = 4 * part.len() as u32;
        for word in [1, 36 + 8 + size, 1, 36] {
            bytes.extend(u32::to_le_bytes(word));
        }
        bytes.extend(b"RTS0");
        bytes.extend(size.to_le_bytes());
        bytes.extend(part.iter().flat_map(|word| word.to_le_bytes()));
        bytes
    }

    #[test]
    fn both_versions_are_read() {
        // Header, three parameters, then their contents: 6 constants, a table of 2 inputs and an output, a root descriptor.
        let version_1_0 = [
            1, 3, 24, 0, 0, 0, //
            1, 0, 60, 0, 0, 72, 4, 0, 120, //
            0, 0, 6, //
            2, 80, //
            0, 2, 0, 0, APPEND, 1, 1, 0, 0, APPEND, //
            0, 0,
        ];
        let table = |offset| {
            Parameter::Table(vec![
                Range { kind: DescriptorKind::Srv, count: Some(2), offset: 0 },
                Range { kind: DescriptorKind::Uav, count: Some(1), offset },
            ])
        };
        let expected = [Parameter::Constants(6), table(2), Parameter::Descriptor(DescriptorKind::Uav)];
        assert_eq!(RootSignature::parse(&container(&version_1_0)).unwrap().parameters, expected);

        let version_1_1 = [
            2, 1, 24, 0, 0, 0, //
            0, 0, 36, //
            2, 44, //
            0, 2, 0, 0, 1, APPEND, 1, 1, 0, 0, 1, 5,
        ];
        assert_eq!(RootSignature::parse(&container(&version_1_1)).unwrap().parameters, [table(5)]);
    }

    #[test]
    fn bytes_that_are_cut_off_are_refused() {
        let whole = container(&[1, 1, 24, 0, 0, 0, 1, 0, 36, 0, 0, 6]);
        assert!(RootSignature::parse(&whole).is_some());
        for length in 0..whole.len() {
            assert_eq!(RootSignature::parse(&whole[..length]), None, "{length}");
        }
    }
}
