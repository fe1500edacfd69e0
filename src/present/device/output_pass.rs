//! Output pass: scales finished frames to the target's size and converts them to its colours and format.

use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;

use super::super::area::Area;
use super::super::upscale::{Filter, Table};
use super::inputs::in_common_state;
use super::resource_cache::ResourceCache;
use crate::gpu::compute::picture_formats::{PictureFormat, pitch};
use crate::gpu::compute::{CommandRecorder, Kernel, Output, ResourceWithState, Shape, View, WordRange};
use crate::gpu::{Gpu, Heap, MappedBuffer, buffer, writable_texture};
use crate::pixel_format::SCRGB_NITS;
use crate::{Colours, Error, ErrorKind, Result};

/// Descriptors per frame: for the vertical and the horizontal pass.
pub(super) const DESCRIPTORS: u32 = 6;
/// Side of a thread group, in threads.
const GROUP: u32 = 8;
/// Bytes per pixel of the buffer between the two passes.
const BETWEEN_PIXEL: u64 = 8;
/// Largest buffer that shaders can address, in bytes.
const MAX_BUFFER: u64 = 4 << 27;

/// Separable resampling of a picture in two shaders: first along columns to the target's rows, then along rows, with conversion to the target's
/// colours and format. The result is copied, so the target need not allow unordered access.
pub(super) struct OutputPass {
    gpu: Gpu,
    /// First pass: resamples columns to the target's rows.
    rows: Kernel,
    /// Second pass: resamples rows, and converts.
    columns: Kernel,
    /// The generator's output: of the anchors' size, RGBA8.
    picture: ID3D12Resource,
    /// Size of the picture.
    from: (u32, u32),
    resources: Option<Resources>,
}

/// Resources for one size of frames.
struct Resources {
    /// Size of the frames.
    size: (u32, u32),
    /// Area of the picture in the frame.
    area: Area,
    /// Filter weights for rows and, from byte `at_columns` on, for columns.
    tables: ID3D12Resource,
    /// Bytes of `tables`.
    bytes: usize,
    /// Filter weights per position: of rows and of columns.
    taps: [u32; 2],
    at_columns: u32,
    /// Result of the first pass.
    between: ID3D12Resource,
    /// Result of the second pass: the frame, in rows as for a copy.
    finished: ID3D12Resource,
    /// Format and colours of the finished frame.
    last: Option<(PictureFormat, Colours)>,
}

impl OutputPass {
    /// For pictures of the size `from`.
    ///
    /// # Errors
    /// `OutOfMemory`, `DeviceRemoved`, or `Device` when the driver refuses a shader.
    pub(super) fn new(gpu: &Gpu, from: (u32, u32)) -> Result<Self> {
        let rows = Shape { constants: 6, inputs: 2, outputs: 1 };
        let columns = Shape { constants: 14, inputs: 2, outputs: 1 };
        Ok(Self {
            gpu: gpu.clone(),
            rows: Kernel::new(gpu, include_bytes!("../../gpu/shaders/compiled/scale_rows.dxbc"), rows)?,
            columns: Kernel::new(gpu, include_bytes!("../../gpu/shaders/compiled/scale_columns.dxbc"), columns)?,
            picture: writable_texture(gpu, from, DXGI_FORMAT_R8G8B8A8_UNORM, D3D12_RESOURCE_STATE_COMMON)?,
            from,
            resources: None,
        })
    }

    /// Prepares for frames of `size`, with the picture's aspect ratio kept if `letterbox` is set; records into a list of `cache`. Resources of
    /// earlier frames live until those have run.
    ///
    /// # Errors
    /// `Unsupported` for more pixels than fit into the buffers of Direct3D; `OutOfMemory`, `DeviceRemoved`.
    pub(super) fn fit(&mut self, cache: &mut ResourceCache, size: (u32, u32), letterbox: bool) -> Result<()> {
        let area = Area::of(self.from, size, letterbox);
        if !self.resources.as_ref().is_some_and(|resources| resources.size == size && resources.area == area) {
            // Freed first: there may not be enough memory for both.
            self.resources = None;
            self.resources = Some(Resources::new(&self.gpu, cache, self.from, size, area)?);
        }
        Ok(())
    }

    /// Whether frames have another size than pictures.
    pub(super) fn resizes(&self) -> bool {
        self.resources.as_ref().is_some_and(|resources| resources.area.size != self.from)
    }

    /// The texture that the generator writes.
    pub(super) fn picture(&self) -> ResourceWithState<'_> {
        in_common_state(&self.picture)
    }

    /// Records the scaling of the picture and the copy into `target`, which has the size of the last [`fit`](Self::fit).
    ///
    /// # Errors
    /// As for any frame. Nothing more is recorded then.
    pub(super) fn record(
        &mut self,
        frame: &mut CommandRecorder<'_>,
        format: PictureFormat,
        colours: Colours,
        target: Output<'_>,
    ) -> Result<()> {
        let Self { resources: Some(resources), rows, columns, picture, from, .. } = self else {
            return Err(not_ready());
        };
        resources.last = None;
        let (size, area) = (resources.size, resources.area);
        let between = view(&resources.between, u64::from(from.0) * u64::from(area.size.1) * BETWEEN_PIXEL);
        let tables = view(&resources.tables, resources.bytes as u64);
        let pitch = pitch(size.0, format.bytes);
        let finished = view(&resources.finished, u64::from(pitch) * u64::from(size.1));
        let groups = |(width, height): (u32, u32)| [width.div_ceil(GROUP), height.div_ceil(GROUP), 1];
        let constants = [from.0, from.1, area.size.0, area.size.1, 0, resources.taps[0]];
        let source = View::Texture(in_common_state(picture), DXGI_FORMAT_R8G8B8A8_UNORM);
        frame.run(rows, &constants, &[source, tables], &[between], groups((from.0, area.size.1)))?;
        let (kind, white) = match colours {
            Colours::Srgb => (0, 1.0),
            Colours::Linear => (1, 1.0),
            Colours::ScRgb { white_nits } => (1, (f64::from(white_nits) / SCRGB_NITS) as f32),
            Colours::Hdr10 { white_nits } => (2, white_nits),
        };
        let constants = [
            from.0,
            area.size.1,
            area.size.0,
            area.size.1,
            resources.at_columns,
            resources.taps[1],
            size.0,
            size.1,
            area.at.0,
            area.at.1,
            pitch,
            format.written,
            kind,
            white.to_bits(),
        ];
        frame.run(columns, &constants, &[between, tables], &[finished], groups(size))?;
        resources.last = Some((format, colours));
        resources.copy(frame, target)
    }

    /// Records another copy of the last finished frame into `target`; `false` if it has another format or colours.
    ///
    /// # Errors
    /// As for [`record`](Self::record).
    pub(super) fn again(
        &self,
        frame: &mut CommandRecorder<'_>,
        format: PictureFormat,
        colours: Colours,
        target: Output<'_>,
    ) -> Result<bool> {
        match &self.resources {
            Some(resources) if resources.last == Some((format, colours)) => {
                resources.copy(frame, target).map(|()| true)
            }
            _ => Ok(false),
        }
    }
}

impl Resources {
    fn new(gpu: &Gpu, cache: &mut ResourceCache, from: (u32, u32), size: (u32, u32), area: Area) -> Result<Self> {
        let between = u64::from(from.0) * u64::from(area.size.1) * BETWEEN_PIXEL;
        // Half floats are the widest format.
        let finished = u64::from(pitch(size.0, 8)) * u64::from(size.1);
        if between.max(finished) > MAX_BUFFER {
            let cause = format!("frames of {} x {} pixels of anchors of {} x {}", size.0, size.1, from.0, from.1);
            return Err(Error::new(ErrorKind::Unsupported, cause).field("size"));
        }
        let rows = Table::new(from.1, area.size.1, Filter::Lanczos3)?;
        let columns = Table::new(from.0, area.size.0, Filter::Lanczos3)?;
        let bytes_of = |table: &Table, positions: u32| 4 * (table.width + 1) * positions as usize;
        let at_columns = bytes_of(&rows, area.size.1);
        let bytes = at_columns + bytes_of(&columns, area.size.0);
        let mut written = MappedBuffer::new(gpu, Heap::Upload, bytes)?;
        let mut at = 0;
        for (table, positions) in [(&rows, area.size.1), (&columns, area.size.0)] {
            for i in 0..positions as usize {
                let (first, weights) = table.taps(i);
                written.write(at, &(first as u32).to_le_bytes());
                written.write(at + 4, bytemuck::must_cast_slice(weights));
                at += 4 * (weights.len() + 1);
            }
        }
        let make = |bytes: u64| buffer(gpu, Heap::Device, bytes as usize);
        let tables = make(bytes as u64)?;
        // In a list of our own: an engine's list may never run.
        let mut frame = cache.begin()?;
        frame.begin_event(c"Cairn: weights for another size");
        let from_processor =
            ResourceWithState { resource: written.resource(), state: D3D12_RESOURCE_STATE_GENERIC_READ };
        frame.copy_bytes(&from_processor, bytes as u64, &in_common_state(&tables), 0)?;
        frame.end_event();
        frame.submit(gpu.frames())?;
        Ok(Self {
            size,
            area,
            tables,
            bytes,
            taps: [rows.width as u32, columns.width as u32],
            at_columns: at_columns as u32,
            between: make(between)?,
            finished: make(finished)?,
            last: None,
        })
    }

    /// Copies the finished frame over the whole target.
    fn copy(&self, frame: &mut CommandRecorder<'_>, target: Output<'_>) -> Result<()> {
        let (format, _) = self.last.ok_or_else(not_ready)?;
        target.copy(frame, &in_common_state(&self.finished), format.rows([self.size.0, self.size.1]))
    }
}

fn view(resource: &ID3D12Resource, bytes: u64) -> View<'_> {
    View::Buffer(in_common_state(resource), WordRange { first: 0, count: (bytes / 4) as u32 })
}

/// Cannot happen: `fit` was called for the size before.
fn not_ready() -> Error {
    Error::new(ErrorKind::InvalidState, "there is nothing to bring a frame into a target with")
}
