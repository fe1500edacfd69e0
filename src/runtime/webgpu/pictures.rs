//! Converts decoded pictures on the adapter, so that only 8-bit pixels of the picture's size come to the host.

use std::sync::Arc;

use ort::sys::ONNXTensorElementDataType as Element;

use super::buffer::{DeviceBuffer, WORD};
use super::helper_graphs::{Binding, SessionUnderLock};
use super::plugin::Plugin;
use crate::Result;
use crate::bundle::{DataType, ModelWriter, Precision};
use crate::runtime::aligned_buffer::AlignedBuffer;
use crate::runtime::execution_context::{BufferId, DecodedPicture, Tap};

/// A graph that resamples one picture of a decoder's output.
pub(super) struct PictureReader {
    // Bindings hold addresses of the buffers: they are dropped first.
    /// One for each buffer of planes.
    bindings: Vec<(BufferId, Binding)>,
    session: SessionUnderLock,
    /// The number of the picture.
    index: DeviceBuffer,
    /// The pixels.
    pixels: DeviceBuffer,
    conversion: Conversion,
}

/// Which pictures a graph converts, and how.
#[derive(Debug, Clone, PartialEq)]
struct Conversion {
    pictures: usize,
    size: [usize; 2],
    precision: Precision,
    rows: Vec<Tap>,
    columns: Vec<Tap>,
}

impl Conversion {
    fn of(picture: &DecodedPicture<'_>) -> Self {
        let (rows, columns) = (picture.rows.to_vec(), picture.columns.to_vec());
        Self { pictures: picture.pictures, size: picture.size, precision: picture.precision, rows, columns }
    }

    fn fits(&self, picture: &DecodedPicture<'_>) -> bool {
        (self.pictures, self.size, self.precision) == (picture.pictures, picture.size, picture.precision)
            && self.rows == picture.rows
            && self.columns == picture.columns
    }
}

impl PictureReader {
    pub(super) fn new(plugin: &Arc<Plugin>, picture: &DecodedPicture<'_>) -> Result<Self> {
        let conversion = Conversion::of(picture);
        let session = SessionUnderLock::new(plugin, &model(&conversion), "graph that resizes pictures")?;
        let [index, pixels] = [size_of::<i64>(), conversion.rows.len() * conversion.columns.len() * WORD]
            .map(|bytes| DeviceBuffer::with_contents(plugin, &AlignedBuffer::zeroed(bytes)?));
        Ok(Self { bindings: Vec::new(), session, index: index?, pixels: pixels?, conversion })
    }

    /// Whether the graph resamples pictures like this one.
    pub(super) fn fits(&self, picture: &DecodedPicture<'_>) -> bool {
        self.conversion.fits(picture)
    }

    /// Resamples a picture of `planes`, which is the buffer that it names, and waits for the pixels.
    pub(super) fn read(
        &mut self,
        picture: &DecodedPicture<'_>,
        planes: &DeviceBuffer,
        pixels: &mut [u8],
    ) -> Result<()> {
        let at = self.bind(picture.planes, planes)?;
        self.index.write(&(picture.index as i64).to_le_bytes())?;
        self.bindings[at].1.run(self.session.get())?;
        self.pixels.read(pixels)
    }

    /// Index of the binding of `planes`, the buffer `id`, which is made if there is none.
    pub(super) fn bind(&mut self, id: BufferId, planes: &DeviceBuffer) -> Result<usize> {
        if let Some(known) = self.bindings.iter().position(|(of, _)| *of == id) {
            return Ok(known);
        }
        self.bindings.push((id, self.binding(planes)?));
        Ok(self.bindings.len() - 1)
    }

    fn binding(&self, planes: &DeviceBuffer) -> Result<Binding> {
        let Conversion { pictures, size: [height, width], precision, rows, columns } = &self.conversion;
        let element = match precision {
            Precision::F32 => Element::ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT,
            Precision::F16 => Element::ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT16,
        };
        let planes = planes.value(&[*pictures, 3, *height, *width], element)?;
        let index = self.index.value(&[1], Element::ONNX_TENSOR_ELEMENT_DATA_TYPE_INT64)?;
        let pixels =
            self.pixels.value(&[1, rows.len(), columns.len()], Element::ONNX_TENSOR_ELEMENT_DATA_TYPE_INT32)?;
        Binding::new(self.session.get(), &[(c"planes", planes), (c"index", index)], &[(c"pixels", pixels)])
    }
}

/// A model of the operations of [`Bilinear::to_picture`](crate::world::Bilinear::to_picture), in their order. Input `planes` is
/// `[pictures, 3, height, width]`, input `index` the number of the picture; output `pixels`, `[1, rows, columns]`, has red in the lowest
/// byte of each number and 255 in the highest.
fn model(Conversion { pictures, size: [height, width], precision, rows, columns }: &Conversion) -> Vec<u8> {
    let mut model = ModelWriter::default();
    let element = DataType::from(*precision);
    model.input("planes", element, &[*pictures, 3, *height, *width]);
    model.input("index", DataType::I64, &[1]);
    model.node("Gather", &["planes", "index"], &["chosen"], &[("axis", 0)]);
    let float = match precision {
        Precision::F32 => "chosen",
        Precision::F16 => {
            model.node("Cast", &["chosen"], &["float"], &[("to", DataType::F32 as i64)]);
            "float"
        }
    };
    model.constant("0", &[], &[0.0_f32]);
    model.constant("1", &[], &[1.0_f32]);
    model.node("Clip", &[float, "0", "1"], &["clamped"], &[]);
    interpolate(&mut model, "clamped", "x", 3, columns);
    interpolate(&mut model, "x", "y", 2, rows);
    model.constant("255", &[1], &[255.0_f32]);
    model.constant("half", &[1], &[0.5_f32]);
    model.node("Mul", &["y", "255"], &["scaled"], &[]);
    model.node("Add", &["scaled", "half"], &["raised"], &[]);
    model.node("Floor", &["raised"], &["whole"], &[]);
    model.node("Cast", &["whole"], &["bytes"], &[("to", DataType::I32 as i64)]);
    model.constant("places", &[3, 1, 1], &[1, 1 << 8, 1 << 16]);
    model.constant("channels", &[1], &[1_i64]);
    model.constant("opaque", &[1], &[0xFF_i32 << 24]);
    model.node("Mul", &["bytes", "places"], &["placed"], &[]);
    model.node("ReduceSum", &["placed", "channels"], &["colour"], &[("keepdims", 0)]);
    model.node("Add", &["colour", "opaque"], &["pixels"], &[]);
    model.output("pixels", DataType::I32, &[1, rows.len(), columns.len()]);
    model.finish()
}

/// Interpolates linearly between rows or columns of `from`, which is `[1, 3, height, width]`.
fn interpolate(model: &mut ModelWriter, from: &str, to: &str, axis: i64, taps: &[Tap]) {
    let name = |what: &str| format!("{what}.{to}");
    let [low, high, t, first, second, difference, share] =
        ["low", "high", "t", "first", "second", "difference", "share"].map(name);
    let numbers = |of: fn(&Tap) -> usize| taps.iter().map(|tap| of(tap) as i64).collect::<Vec<_>>();
    model.constant(&low, &[taps.len()], &numbers(|tap| tap.low));
    model.constant(&high, &[taps.len()], &numbers(|tap| tap.high));
    let fractions: Vec<_> = taps.iter().map(|tap| tap.t).collect();
    let shape = if axis == 3 { &[taps.len()][..] } else { &[taps.len(), 1] };
    model.constant(&t, shape, &fractions);
    model.node("Gather", &[from, &low], &[&first], &[("axis", axis)]);
    model.node("Gather", &[from, &high], &[&second], &[("axis", axis)]);
    model.node("Sub", &[&second, &first], &[&difference], &[]);
    model.node("Mul", &[&difference, &t], &[&share], &[]);
    model.node("Add", &[&first, &share], &[to], &[]);
}
