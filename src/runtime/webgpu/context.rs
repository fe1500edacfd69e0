//! The memory and the work of one rollout on the adapter.

use std::ffi::CString;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ort::AsPointer;
use ort::memory::MemoryInfo;
use ort::sys::ONNXTensorElementDataType as Element;

use super::buffer::{DeviceBuffer, WORD};
use super::helper_graphs::{self, Binding, ListInput, Move, SessionUnderLock};
use super::pictures::PictureReader;
use super::plugin::Plugin;
use super::value::Value;
use crate::allocate;
use crate::bundle::Precision;
use crate::locks::Mutex;
use crate::runtime::aligned_buffer::AlignedBuffer;
use crate::runtime::execution_context::{
    Backup, BindingId, BufferId, Bytes, ContextLimits, DecodedPicture, ExecutionContext, FiniteCheckId, MAX_GROUPS,
    RecordedCopiesId, RecordedCopy, Region,
};
use crate::runtime::finite::all_finite;
use crate::runtime::graph::{ElementType, Graph};
use crate::{Picture, Result};

/// Buffers, bound graphs, and the graphs that move and check values.
pub(super) struct WebGpuContext {
    // Bindings hold addresses of buffers: they are dropped first.
    bindings: Vec<(Binding, Arc<Graph>)>,
    moves: Vec<Mover>,
    finite_checks: Vec<FiniteCheck>,
    pictures: Option<PictureReader>,
    buffers: Vec<Buffer>,
    recorded: Vec<Vec<RecordedCopy>>,
    plugin: Arc<Plugin>,
    limits: ContextLimits,
    bytes: Bytes,
    read: AtomicU64,
    /// The buffer that was read last, whole: values are often read in pieces, and the provider copies whole buffers only. `None` once work
    /// was submitted after it.
    last_read: Mutex<Option<(BufferId, Vec<u8>)>>,
    /// Contents of buffers on the adapter that could not be written yet. They are written before anything else uses a buffer.
    unwritten: Mutex<Contents>,
}

/// A buffer of the host's size in bytes.
struct Buffer {
    bytes: usize,
    storage: Storage,
}

/// Where a buffer's contents are. A buffer moves to the adapter when a graph first needs it there: contents that are only copied elsewhere stay
/// on the host.
enum Storage {
    Host(AlignedBuffer),
    Adapter(DeviceBuffer),
}

/// A graph that moves rows between buffers.
struct Mover {
    /// What is written, what is read, and how.
    parts: Vec<(BufferId, BufferId, Move)>,
    binding: Binding,
    session: SessionUnderLock,
    /// The lists of row numbers on the adapter, and what they hold.
    lists: Vec<(DeviceBuffer, Vec<i64>)>,
}

/// A recorded finite check.
struct FiniteCheck {
    groups: Vec<Vec<BufferId>>,
    precision: Precision,
    /// Made at the first check for which all buffers are on the adapter; `None` before.
    graph: Option<FiniteGraph>,
}

struct FiniteGraph {
    binding: Binding,
    session: SessionUnderLock,
    /// The graph's result, a number for each group.
    largest: Box<[i32]>,
}

/// Contents of buffers.
type Contents = Vec<(BufferId, Storage)>;

impl WebGpuContext {
    pub(super) fn new(plugin: &Arc<Plugin>, limits: ContextLimits) -> Self {
        Self {
            bindings: Vec::new(),
            moves: Vec::new(),
            finite_checks: Vec::new(),
            pictures: None,
            buffers: Vec::new(),
            recorded: Vec::new(),
            plugin: plugin.clone(),
            limits,
            bytes: Bytes::default(),
            read: AtomicU64::new(0),
            last_read: Mutex::new(None),
            unwritten: Mutex::new(Vec::new()),
        }
    }

    /// Retries the writes that failed.
    fn flush_unwritten(&self) -> Result<()> {
        let mut unwritten = self.unwritten.lock();
        while let Some((id, copy)) = unwritten.last() {
            match copy {
                Storage::Adapter(copy) => self.on_adapter(*id).copy_from(copy)?,
                // The buffer was moved to the adapter after the copy was made.
                Storage::Host(copy) => self.on_adapter(*id).write(copy.bytes())?,
            }
            unwritten.pop();
        }
        Ok(())
    }

    /// Moves a buffer to the adapter, if it is not there.
    fn move_to_adapter(&mut self, id: BufferId) -> Result<()> {
        let buffer = &mut self.buffers[id.0];
        if let Storage::Host(contents) = &buffer.storage {
            buffer.storage = Storage::Adapter(DeviceBuffer::with_contents(&self.plugin, contents)?);
        }
        Ok(())
    }

    /// A buffer that is on the adapter.
    fn on_adapter(&self, id: BufferId) -> &DeviceBuffer {
        match &self.buffers[id.0].storage {
            Storage::Adapter(buffer) => buffer,
            Storage::Host(_) => unreachable!("the buffer was moved before"),
        }
    }

    /// Writes a whole buffer.
    fn write_whole(&mut self, to: BufferId, bytes: &[u8]) -> Result<()> {
        self.flush_unwritten()?;
        let buffer = &mut self.buffers[to.0];
        assert_eq!(bytes.len(), buffer.bytes, "a whole buffer");
        match &mut buffer.storage {
            Storage::Host(contents) => {
                contents.bytes_mut()[..bytes.len()].copy_from_slice(bytes);
                Ok(())
            }
            Storage::Adapter(buffer) => buffer.write(bytes),
        }
    }

    /// Reads a whole buffer.
    fn read_whole(&self, from: BufferId) -> Result<Vec<u8>> {
        self.flush_unwritten()?;
        let buffer = &self.buffers[from.0];
        let mut bytes = allocate::zeroed(buffer.bytes)?;
        match &buffer.storage {
            Storage::Host(contents) => bytes.copy_from_slice(&contents.bytes()[..buffer.bytes]),
            Storage::Adapter(buffer) => buffer.read(&mut bytes)?,
        }
        Ok(bytes)
    }

    /// Calls `with` with a range of a buffer's contents.
    fn with_contents(&self, from: BufferId, at: usize, len: usize, with: impl FnOnce(&[u8])) -> Result<()> {
        let mut last = self.last_read.lock();
        if last.as_ref().is_none_or(|(id, _)| *id != from) {
            *last = Some((from, self.read_whole(from)?));
        }
        with(&last.as_ref().expect("set above").1[at..at + len]);
        Ok(())
    }

    /// Notes that contents will change.
    fn changes(&mut self) {
        *self.last_read.get_mut() = None;
    }

    /// Makes copies that are independent of each other, all or none: in one graph if possible, else through the host's memory. These cannot fail
    /// once the graph has run: where the adapter cannot be written to, they are completed later.
    fn make_copies(&mut self, copies: &[(BufferId, BufferId, Vec<Region>)]) -> Result<()> {
        self.changes();
        self.flush_unwritten()?;
        let (mut parts, mut lists) = (Vec::new(), Vec::<Vec<i64>>::new());
        let mut through_host = Contents::new();
        for (to, from, regions) in copies {
            let on_host = |id: &BufferId| matches!(self.buffers[id.0].storage, Storage::Host(_));
            let rows = helper_graphs::rows_of(regions, self.buffers[from.0].bytes, self.buffers[to.0].bytes);
            match rows.filter(|_| !on_host(from) && !on_host(to)) {
                Some((shape, rows)) => {
                    let lists = [rows.from, rows.to].map(|rows| match lists.iter().position(|list| *list == rows) {
                        Some(known) => known,
                        None => {
                            lists.push(rows);
                            lists.len() - 1
                        }
                    });
                    parts.push((*to, *from, Move { shape, lists }));
                }
                None => through_host.push((*to, Storage::Host(self.contents_after(*to, *from, regions)?))),
            }
        }
        self.run_mover(parts, lists)?;
        self.set_contents(through_host);
        self.bytes.copied += copies.iter().flat_map(|(.., regions)| regions).map(|r| r.len as u64).sum::<u64>();
        Ok(())
    }

    /// Makes copies in a graph, with these lists of rows.
    fn run_mover(&mut self, parts: Vec<(BufferId, BufferId, Move)>, lists: Vec<Vec<i64>>) -> Result<()> {
        if parts.is_empty() {
            return Ok(());
        }
        let mover = match self.moves.iter().position(|mover| mover.parts == parts) {
            Some(known) => known,
            None => {
                let mover = self.new_mover(parts, &lists)?;
                self.moves.push(mover);
                self.moves.len() - 1
            }
        };
        let mover = &mut self.moves[mover];
        for ((memory, held), wanted) in mover.lists.iter_mut().zip(lists) {
            if *held != wanted {
                memory.write(bytemuck::cast_slice(&wanted))?;
                *held = wanted;
            }
        }
        mover.binding.run(mover.session.get())
    }

    /// What a buffer holds after a copy.
    fn contents_after(&self, to: BufferId, from: BufferId, regions: &[Region]) -> Result<AlignedBuffer> {
        let (source, bytes) = (self.read_whole(from)?, self.buffers[to.0].bytes);
        let mut contents = AlignedBuffer::zeroed(bytes)?;
        let is_whole = |r: &Region| r.to == 0 && r.len == bytes;
        if !regions.iter().any(is_whole) {
            contents.bytes_mut()[..bytes].copy_from_slice(&self.read_whole(to)?);
        }
        for r in regions {
            contents.bytes_mut()[r.to..r.to + r.len].copy_from_slice(&source[r.from..r.from + r.len]);
        }
        Ok(contents)
    }

    fn new_mover(&self, parts: Vec<(BufferId, BufferId, Move)>, lists: &[Vec<i64>]) -> Result<Mover> {
        let moves: Vec<_> = parts.iter().map(|(.., part)| part.clone()).collect();
        let sizes: Vec<_> = lists.iter().map(Vec::len).collect();
        let model = helper_graphs::moves(&moves, &sizes);
        let session = SessionUnderLock::new(&self.plugin, &model, "graph of copies")?;
        let lists = lists.iter().map(|rows| self.new_list(rows)).collect::<Result<Vec<_>>>()?;
        let (words, integers) =
            (Element::ONNX_TENSOR_ELEMENT_DATA_TYPE_INT32, Element::ONNX_TENSOR_ELEMENT_DATA_TYPE_INT64);
        let text = |name: String| CString::new(name).expect("no NUL");
        let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
        for ListInput { name, list, is_column } in helper_graphs::list_inputs(&moves) {
            let (memory, rows) = &lists[list];
            let shape = &[rows.len(), 1][..1 + usize::from(is_column)];
            inputs.push((text(name), memory.value(shape, integers)?));
        }
        for (i, (to, from, Move { shape, .. })) in parts.iter().enumerate() {
            let [to_name, from_name, _, moved] = helper_graphs::names(i).map(text);
            let [to, from] = [to, from].map(|id| self.on_adapter(*id));
            inputs.push((to_name, to.value(&[shape.to_rows, shape.row], words)?));
            inputs.push((from_name, from.value(&[shape.from_rows, shape.row], words)?));
            // In place: the provider then writes the moved rows only.
            outputs.push((moved, to.value(&[shape.to_rows, shape.row], words)?));
        }
        let binding = Binding::new(session.get(), &inputs, &outputs)?;
        Ok(Mover { parts, binding, session, lists })
    }

    /// A list of row numbers on the adapter.
    fn new_list(&self, rows: &[i64]) -> Result<(DeviceBuffer, Vec<i64>)> {
        let bytes: &[u8] = bytemuck::cast_slice(rows);
        let mut memory = AlignedBuffer::zeroed(bytes.len())?;
        memory.bytes_mut().copy_from_slice(bytes);
        Ok((DeviceBuffer::with_contents(&self.plugin, &memory)?, rows.to_vec()))
    }

    fn new_finite_graph(&self, groups: &[Vec<BufferId>], precision: Precision) -> Result<FiniteGraph> {
        let words = |id: &BufferId| DeviceBuffer::words(self.buffers[id.0].bytes);
        let sizes: Vec<Vec<usize>> = groups.iter().map(|group| group.iter().map(words).collect()).collect();
        let model = helper_graphs::largest(&sizes, precision);
        let session = SessionUnderLock::new(&self.plugin, &model, "graph that checks values")?;
        let mut largest = vec![0_i32; groups.len()].into_boxed_slice();
        let element = Element::ONNX_TENSOR_ELEMENT_DATA_TYPE_INT32;
        let input = |(i, id): (usize, &BufferId)| {
            let name = CString::new(format!("x.{i}")).expect("no NUL");
            Ok((name, self.on_adapter(*id).value(&[words(id)], element)?))
        };
        let inputs = groups.iter().flatten().enumerate().map(input).collect::<Result<Vec<_>>>()?;
        let (host, bytes) = (MemoryInfo::default(), size_of_val(&*largest));
        // SAFETY: the numbers are in a box of their own, which lives as long as the binding.
        let output = unsafe { Value::new(host.ptr(), largest.as_mut_ptr().cast(), bytes, &[groups.len()], element) }?;
        let binding = Binding::new(session.get(), &inputs, &[(c"largest".to_owned(), output)])?;
        Ok(FiniteGraph { binding, session, largest })
    }
}

impl ExecutionContext for WebGpuContext {
    fn buffer(&mut self, bytes: usize) -> Result<BufferId> {
        let contents = AlignedBuffer::zeroed(DeviceBuffer::words(bytes) * WORD)?;
        self.buffers.push(Buffer { bytes, storage: Storage::Host(contents) });
        Ok(BufferId(self.buffers.len() - 1))
    }

    fn size(&self, of: BufferId) -> usize {
        self.buffers[of.0].bytes
    }

    fn bind(&mut self, graph: &Arc<Graph>, tensors: &[BufferId]) -> Result<BindingId> {
        assert_eq!(tensors.len(), graph.tensors().len(), "one buffer for each input and output");
        let mut values = Vec::new();
        for (i, ((name, spec), buffer)) in graph.tensors().iter().zip(tensors).enumerate() {
            assert_eq!(self.size(*buffer), spec.bytes(), "{}: the buffer fits the tensor", spec.name);
            let is_input = i < graph.input_count();
            assert!(is_input || tensors.iter().filter(|b| *b == buffer).count() == 1, "{}: written alone", spec.name);
            self.move_to_adapter(*buffer)?;
            let element = match spec.element {
                ElementType::F32 => Element::ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT,
                ElementType::F16 => Element::ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT16,
                ElementType::U8 => Element::ONNX_TENSOR_ELEMENT_DATA_TYPE_UINT8,
            };
            values.push((name, self.on_adapter(*buffer).value(&spec.shape, element)?));
        }
        let (inputs, outputs) = values.split_at(graph.input_count());
        let binding = Binding::new(graph.session(), inputs, outputs)?;
        self.bindings.push((binding, graph.clone()));
        Ok(BindingId(self.bindings.len() - 1))
    }

    fn upload(&mut self, to: BufferId, at: usize, bytes: &[u8]) -> Result<()> {
        self.changes();
        if bytes.len() == self.size(to) {
            self.write_whole(to, bytes)?;
        } else if let Storage::Host(contents) = &mut self.buffers[to.0].storage {
            contents.bytes_mut()[at..at + bytes.len()].copy_from_slice(bytes);
        } else {
            let mut contents = self.read_whole(to)?;
            contents[at..at + bytes.len()].copy_from_slice(bytes);
            self.write_whole(to, &contents)?;
        }
        self.bytes.uploaded += bytes.len() as u64;
        Ok(())
    }

    fn replace(&mut self, contents: &[(BufferId, &[u8])]) -> Result<()> {
        let ids: Vec<_> = contents.iter().map(|(id, _)| *id).collect();
        self.all_or_nothing(&ids, |context| {
            contents.iter().try_for_each(|(to, bytes)| {
                context.write_whole(*to, bytes)?;
                context.bytes.uploaded += bytes.len() as u64;
                Ok(())
            })
        })
    }

    fn clear(&mut self, buffers: &[BufferId]) -> Result<()> {
        self.all_or_nothing(buffers, |context| {
            buffers.iter().try_for_each(|id| context.write_whole(*id, &allocate::zeroed(context.size(*id))?))
        })
    }

    fn copy(&mut self, to: BufferId, from: BufferId, regions: &[Region]) -> Result<()> {
        self.make_copies(&[(to, from, regions.to_vec())])
    }

    fn record_copies(&mut self, copies: Vec<RecordedCopy>) -> Result<RecordedCopiesId> {
        self.recorded.push(copies);
        Ok(RecordedCopiesId(self.recorded.len() - 1))
    }

    fn run_copies(&mut self, copies: &[RecordedCopiesId]) -> Result<()> {
        let all = copies.iter().flat_map(|id| &self.recorded[id.0]);
        let all: Vec<_> = all.map(|copy| (copy.to, copy.from, copy.regions.clone())).collect();
        self.make_copies(&all)
    }

    fn back_up(&mut self, of: &[BufferId]) -> Result<Backup> {
        self.copies_of(of).map(Backup::new)
    }

    fn restore_backup(&mut self, backup: Backup) -> Result<()> {
        self.set_contents(*backup.into_contents::<Contents>());
        Ok(())
    }

    fn run(&mut self, binding: BindingId) -> Result<()> {
        self.limits.check_stop()?;
        self.changes();
        self.flush_unwritten()?;
        let (binding, graph) = &self.bindings[binding.0];
        binding.run(graph.session())
    }

    fn read(&self, from: BufferId, at: usize, into: &mut [u8]) -> Result<()> {
        self.with_contents(from, at, into.len(), |bytes| into.copy_from_slice(bytes))?;
        self.read.fetch_add(into.len() as u64, Ordering::Relaxed);
        Ok(())
    }

    fn prepare_read_picture(&mut self, from: &DecodedPicture<'_>) -> Result<()> {
        let Storage::Adapter(planes) = &self.buffers[from.planes.0].storage else { return Ok(()) };
        if self.pictures.as_ref().is_none_or(|pictures| !pictures.fits(from)) {
            self.pictures = Some(PictureReader::new(&self.plugin, from)?);
        }
        self.pictures.as_mut().expect("made above").bind(from.planes, planes).map(drop)
    }

    fn read_picture(&mut self, from: &DecodedPicture<'_>, into: &mut Picture) -> Result<bool> {
        self.flush_unwritten()?;
        self.prepare_read_picture(from)?;
        let Storage::Adapter(planes) = &self.buffers[from.planes.0].storage else { return Ok(false) };
        let pictures = self.pictures.as_mut().expect("prepared above");
        let pixels = into.rgba_mut();
        pictures.read(from, planes, pixels)?;
        self.read.fetch_add(pixels.len() as u64, Ordering::Relaxed);
        Ok(true)
    }

    fn add_finite_check(&mut self, groups: &[&[BufferId]], precision: Precision) -> Result<FiniteCheckId> {
        assert!(groups.len() <= MAX_GROUPS, "groups that can be told apart");
        let groups = groups.iter().map(|group| group.to_vec()).collect();
        self.finite_checks.push(FiniteCheck { groups, precision, graph: None });
        Ok(FiniteCheckId(self.finite_checks.len() - 1))
    }

    fn find_not_finite(&mut self, check: FiniteCheckId) -> Result<Option<usize>> {
        self.flush_unwritten()?;
        let FiniteCheck { groups, precision, graph } = &self.finite_checks[check.0];
        let precision = *precision;
        let on_host = |id: &BufferId| matches!(self.buffers[id.0].storage, Storage::Host(_));
        if groups.iter().flatten().any(on_host) {
            let mut contents = |id: &BufferId| Ok(all_finite(&self.read_whole(*id)?, precision));
            for (i, group) in groups.iter().enumerate() {
                if !group.iter().map(&mut contents).collect::<Result<Vec<_>>>()?.into_iter().all(|finite| finite) {
                    return Ok(Some(i));
                }
            }
            return Ok(None);
        }
        if graph.is_none() {
            let made = self.new_finite_graph(groups, precision)?;
            self.finite_checks[check.0].graph = Some(made);
        }
        let graph = self.finite_checks[check.0].graph.as_ref().expect("made above");
        graph.binding.run(graph.session.get())?;
        Ok(graph.largest.iter().position(|largest| !helper_graphs::is_finite(*largest, precision)))
    }

    fn bytes(&self) -> Bytes {
        Bytes { read: self.read.load(Ordering::Relaxed), ..self.bytes }
    }
}

impl WebGpuContext {
    /// Makes a change to buffers; if it fails, they keep their contents.
    fn all_or_nothing(&mut self, of: &[BufferId], change: impl FnOnce(&mut Self) -> Result<()>) -> Result<()> {
        let before = self.copies_of(of)?;
        self.changes();
        change(self).inspect_err(|_| self.set_contents(before))
    }

    fn copies_of(&self, of: &[BufferId]) -> Result<Contents> {
        self.flush_unwritten()?;
        let copy = |id: &BufferId| {
            let storage = match &self.buffers[id.0].storage {
                Storage::Adapter(buffer) => Storage::Adapter(buffer.duplicate()?),
                Storage::Host(contents) => {
                    let mut copy = AlignedBuffer::zeroed(contents.len())?;
                    copy.bytes_mut().copy_from_slice(contents.bytes());
                    Storage::Host(copy)
                }
            };
            Ok((*id, storage))
        };
        of.iter().map(copy).collect()
    }

    /// Gives buffers these contents, on the adapter as soon as it can be done.
    fn set_contents(&mut self, copies: Contents) {
        self.changes();
        let unwritten = self.unwritten.get_mut();
        for (id, copy) in copies {
            // Of two contents of a buffer, the later ones count.
            unwritten.retain(|(other, _)| *other != id);
            match (&mut self.buffers[id.0].storage, copy) {
                (Storage::Host(contents), Storage::Host(copy)) => {
                    contents.bytes_mut()[..copy.len()].copy_from_slice(copy.bytes());
                }
                (Storage::Adapter(_), copy) => unwritten.push((id, copy)),
                (Storage::Host(_), Storage::Adapter(_)) => unreachable!("buffers stay on the adapter"),
            }
        }
        if let Err(error) = self.flush_unwritten() {
            log::warn!("buffers are written later: {error}");
        }
    }
}
