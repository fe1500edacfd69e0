//! Records the double's shaders into the caller's list. Like AMD's libraries, it leaves its own descriptor heap, root signature and
//! pipeline set.

use std::ffi::c_void;
use std::mem::ManuallyDrop;
use std::time::{Duration, Instant};

use windows::Win32::Graphics::Direct3D::ID3DBlob;
use windows::Win32::Graphics::Direct3D12::*;
use windows::Win32::Graphics::Dxgi::Common::*;
use windows::core::{Interface, Result};

/// Number of frames in flight that AMD's libraries support.
const SLOTS: u64 = 4;

/// How long a context waits at its end for frames that it recorded: much longer than a frame takes on a processor.
const LATE: Duration = Duration::from_millis(500);

/// Number of inputs of the shader; it has one output.
pub(crate) const INPUTS: usize = 7;
const DESCRIPTORS: u32 = INPUTS as u32 + 1;

/// Number of root constants; the last two are the flags and the number of repetitions.
pub(crate) const CONSTANTS: usize = 19;

/// The shader's flags.
pub(crate) const RESET: u32 = 1;
pub(crate) const HUDLESS: u32 = 2;
pub(crate) const DISTORTED: u32 = 4;
pub(crate) const INVERTED: u32 = 8;
/// Errors: a copy of the frame, black, wrong sign of motion, wrong sign of vertical motion, reversed depth order, jitter of the
/// wrong sign.
pub(crate) const THROUGH: u32 = 16;
pub(crate) const BLACK: u32 = 32;
pub(crate) const WRONG_SIGN: u32 = 64;
pub(crate) const UPSIDE_DOWN: u32 = 128;
pub(crate) const FARTHEST: u32 = 256;
pub(crate) const WRONG_JITTER: u32 = 512;

pub(crate) const READ: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_NON_PIXEL_SHADER_RESOURCE;
const WRITTEN: D3D12_RESOURCE_STATES = D3D12_RESOURCE_STATE_UNORDERED_ACCESS;

/// ffx-api's resource states with their Direct3D 12 values.
const STATES: [(u32, i32); 12] = [
    (1, 0),
    (2, 0x8),
    (4, 0x40),
    (8, 0x80),
    (12, 0xc0),
    (16, 0x800),
    (20, 0xac3),
    (32, 0x400),
    (64, 0x200),
    (128, 0),
    (256, 0x4),
    (512, 0x10),
];

/// A texture argument: the caller's resource and its state, as ffx-api's numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TextureArg {
    pub(crate) pointer: *mut c_void,
    pub(crate) state: u32,
}

/// The textures of a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pictures {
    /// Inputs in the order of the shader's registers; the previous picture goes into the third. A missing input is replaced by
    /// another texture, which the shader does not read.
    pub(crate) inputs: [TextureArg; INPUTS],
    /// Index of motion among the inputs; the shader gets its size.
    pub(crate) motion: usize,
    pub(crate) output: TextureArg,
    /// Index of the input to keep as the next frame's previous picture; None to keep the output.
    pub(crate) kept: Option<usize>,
}

/// Index of the previous picture among the inputs.
pub(crate) const PREVIOUS: usize = 2;

/// The device objects of a context.
pub(crate) struct ShaderWork {
    device: ID3D12Device,
    root: ID3D12RootSignature,
    pipeline: ID3D12PipelineState,
    heap: ID3D12DescriptorHeap,
    /// The previous picture, in the state for shader reads.
    before: Option<ID3D12Resource>,
    /// Frame numbers, one for each slot: the CPU writes `recorded_numbers` when it records a frame, and the device copies the number to
    /// `completed_numbers` when the frame has run.
    recorded_numbers: ID3D12Resource,
    completed_numbers: ID3D12Resource,
    recorded: u64,
}

// SAFETY: objects of Direct3D 12 are free-threaded.
unsafe impl Send for ShaderWork {}

impl ShaderWork {
    /// Creates the objects for a shader.
    pub(crate) fn new(device: &ID3D12Device, code: &[u8]) -> Result<Self> {
        let root = root_signature(device)?;
        let wanted = D3D12_COMPUTE_PIPELINE_STATE_DESC {
            pRootSignature: borrowed(&root),
            CS: D3D12_SHADER_BYTECODE { pShaderBytecode: code.as_ptr().cast(), BytecodeLength: code.len() },
            ..Default::default()
        };
        // SAFETY: a live device; the description and the code live during the call.
        let pipeline = unsafe { device.CreateComputePipelineState(&wanted) }?;
        let wanted = D3D12_DESCRIPTOR_HEAP_DESC {
            Type: D3D12_DESCRIPTOR_HEAP_TYPE_CBV_SRV_UAV,
            NumDescriptors: DESCRIPTORS * SLOTS as u32,
            Flags: D3D12_DESCRIPTOR_HEAP_FLAG_SHADER_VISIBLE,
            NodeMask: 0,
        };
        // SAFETY: as above.
        let heap = unsafe { device.CreateDescriptorHeap(&wanted) }?;
        let buffer = |heap, state| {
            let wanted = D3D12_RESOURCE_DESC {
                Dimension: D3D12_RESOURCE_DIMENSION_BUFFER,
                Width: SLOTS * 8,
                Height: 1,
                DepthOrArraySize: 1,
                MipLevels: 1,
                SampleDesc: DXGI_SAMPLE_DESC { Count: 1, Quality: 0 },
                Layout: D3D12_TEXTURE_LAYOUT_ROW_MAJOR,
                ..Default::default()
            };
            committed(device, heap, &wanted, state)
        };
        let recorded_numbers = buffer(D3D12_HEAP_TYPE_UPLOAD, D3D12_RESOURCE_STATE_GENERIC_READ)?;
        let completed_numbers = buffer(D3D12_HEAP_TYPE_READBACK, D3D12_RESOURCE_STATE_COPY_DEST)?;
        let made = Self {
            device: device.clone(),
            root,
            pipeline,
            heap,
            before: None,
            recorded_numbers,
            completed_numbers,
            recorded: 0,
        };
        made.with_mapping(&made.completed_numbers, |numbers| numbers.fill(0))?;
        Ok(made)
    }

    /// Number of recorded frames that have not run and still may: none once the device is removed.
    pub(crate) fn in_flight(&self) -> u64 {
        // Tests let one call fail.
        let completed = self.completed().or_else(|_| self.completed()).unwrap_or(self.recorded);
        // Asked last, since the mapping fails too if the device is removed meanwhile.
        // SAFETY: a live device.
        let is_removed = unsafe { self.device.GetDeviceRemovedReason() }.is_err();
        // A frame whose recording failed may run nevertheless, and is completed without being counted.
        if is_removed { 0 } else { self.recorded.saturating_sub(completed) }
    }

    /// Number of frames that complete within [`LATE`]: the device was still running them. The host never submits the others, whose list it
    /// may reset because of an error that this library does not learn of.
    pub(crate) fn completed_late(&self) -> u64 {
        let before = self.in_flight();
        let start = Instant::now();
        let mut left = before;
        while left > 0 && start.elapsed() < LATE {
            std::thread::sleep(Duration::from_millis(1));
            left = left.min(self.in_flight());
        }
        before - left
    }

    /// Number of the last frame that has run.
    fn completed(&self) -> Result<u64> {
        let mut completed = 0;
        self.with_mapping(&self.completed_numbers, |numbers| completed = numbers.iter().copied().max().unwrap_or(0))?;
        Ok(completed)
    }

    /// Records a frame. Every texture returns to its stated state. Writes the size of motion into `constants`.
    ///
    /// # Safety
    /// List and textures were checked, and live until the list has run.
    pub(crate) unsafe fn record(
        &mut self,
        list: *mut c_void,
        pictures: &Pictures,
        mut constants: [u32; CONSTANTS],
    ) -> Result<()> {
        let object = |arg: &TextureArg| {
            // SAFETY: checked to be a resource; the caller keeps its reference.
            unsafe { ID3D12Resource::from_raw_borrowed(&arg.pointer) }.cloned()
        };
        // SAFETY: checked to be a list.
        let list = unsafe { ID3D12GraphicsCommandList::from_raw_borrowed(&list) }.cloned();
        let motion = object(&pictures.inputs[pictures.motion]);
        let kept = pictures.kept.map_or(pictures.output, |kept| pictures.inputs[kept]);
        let (Some(list), Some(motion), Some(output), Some(source)) =
            (list, motion, object(&pictures.output), object(&kept))
        else {
            return Ok(());
        };
        // SAFETY: live resources.
        let (of_motion, of_frame) = unsafe { (motion.GetDesc(), output.GetDesc()) };
        (constants[4], constants[5]) = (of_motion.Width as u32, of_motion.Height);
        let before = self.previous_texture(&source)?;
        let mut inputs = pictures.inputs.map(|arg| object(&arg));
        inputs[PREVIOUS] = Some(before.clone());
        let slot = (self.recorded % SLOTS) as u32;
        let table = self.describe(slot, &inputs, Some(&output));
        let mut all = vec![(pictures.output, WRITTEN)];
        for (index, arg) in pictures.inputs.iter().enumerate() {
            if index != PREVIOUS && all.iter().all(|(known, _)| known.pointer != arg.pointer) {
                all.push((*arg, READ));
            }
        }
        let barriers = |back: bool| -> Vec<D3D12_RESOURCE_BARRIER> {
            let change = |(arg, then): &(TextureArg, D3D12_RESOURCE_STATES)| {
                let (resource, now) = (object(arg)?, state(arg.state));
                (now != *then).then(|| match back {
                    false => transition(&resource, now, *then),
                    true => transition(&resource, *then, now),
                })
            };
            all.iter().filter_map(change).collect()
        };
        let kept_in = if pictures.kept.is_some() { READ } else { WRITTEN };
        let recorded = self.recorded + 1;
        self.with_mapping(&self.recorded_numbers, |numbers| numbers[slot as usize] = recorded)?;
        self.recorded = recorded;
        let groups = |side: u32| side.div_ceil(8);
        // SAFETY: an open list; its objects live until it has run, by the caller's promise and as the context does.
        unsafe {
            record_barriers(&list, &barriers(false));
            list.SetDescriptorHeaps(&[Some(self.heap.clone())]);
            list.SetComputeRootSignature(&self.root);
            list.SetPipelineState(&self.pipeline);
            list.SetComputeRoot32BitConstants(0, CONSTANTS as u32, constants.as_ptr().cast(), 0);
            list.SetComputeRootDescriptorTable(1, table);
            list.Dispatch(groups(of_frame.Width as u32), groups(of_frame.Height), 1);
            let copying = [
                transition(&source, kept_in, D3D12_RESOURCE_STATE_COPY_SOURCE),
                transition(&before, READ, D3D12_RESOURCE_STATE_COPY_DEST),
            ];
            list.ResourceBarrier(&copying);
            list.CopyResource(&before, &source);
            let copied = [
                transition(&source, D3D12_RESOURCE_STATE_COPY_SOURCE, kept_in),
                transition(&before, D3D12_RESOURCE_STATE_COPY_DEST, READ),
            ];
            list.ResourceBarrier(&copied);
            record_barriers(&list, &barriers(true));
            list.CopyBufferRegion(
                &self.completed_numbers,
                u64::from(slot) * 8,
                &self.recorded_numbers,
                u64::from(slot) * 8,
                8,
            );
        }
        Ok(())
    }

    /// A texture for the previous picture, of the source's size and format.
    fn previous_texture(&mut self, source: &ID3D12Resource) -> Result<ID3D12Resource> {
        // SAFETY: live resources.
        let (wanted, had) = unsafe { (source.GetDesc(), self.before.as_ref().map(|before| before.GetDesc())) };
        let fits = |had: &D3D12_RESOURCE_DESC| {
            (had.Width, had.Height, had.Format) == (wanted.Width, wanted.Height, wanted.Format)
        };
        if let (Some(before), true) = (&self.before, had.as_ref().is_some_and(fits)) {
            return Ok(before.clone());
        }
        let wanted = D3D12_RESOURCE_DESC { Flags: D3D12_RESOURCE_FLAG_NONE, Alignment: 0, ..wanted };
        let made = committed(&self.device, D3D12_HEAP_TYPE_DEFAULT, &wanted, READ)?;
        self.before = Some(made.clone());
        Ok(made)
    }

    /// Writes the descriptors of a frame.
    fn describe(
        &self,
        slot: u32,
        inputs: &[Option<ID3D12Resource>; INPUTS],
        output: Option<&ID3D12Resource>,
    ) -> D3D12_GPU_DESCRIPTOR_HANDLE {
        // SAFETY: a live device and heap; descriptors inside it.
        unsafe {
            let step = self.device.GetDescriptorHandleIncrementSize(D3D12_DESCRIPTOR_HEAP_TYPE_CBV_SRV_UAV);
            let first = slot * DESCRIPTORS * step;
            let start = self.heap.GetCPUDescriptorHandleForHeapStart().ptr + first as usize;
            let at = |index: usize| D3D12_CPU_DESCRIPTOR_HANDLE { ptr: start + index * step as usize };
            for (index, input) in inputs.iter().enumerate() {
                self.device.CreateShaderResourceView(input.as_ref(), None, at(index));
            }
            self.device.CreateUnorderedAccessView(output, None, None, at(inputs.len()));
            D3D12_GPU_DESCRIPTOR_HANDLE { ptr: self.heap.GetGPUDescriptorHandleForHeapStart().ptr + u64::from(first) }
        }
    }

    /// Maps a buffer of frame numbers.
    fn with_mapping(&self, buffer: &ID3D12Resource, act: impl FnOnce(&mut [u64])) -> Result<()> {
        let mut pointer = std::ptr::null_mut();
        // SAFETY: a buffer that the CPU can map.
        unsafe { buffer.Map(0, None, Some(&mut pointer)) }?;
        // SAFETY: mapped above, with a number for each slot; CPU and device never write the same number at a time.
        act(unsafe { std::slice::from_raw_parts_mut(pointer.cast(), SLOTS as usize) });
        // SAFETY: mapped above.
        unsafe { buffer.Unmap(0, None) };
        Ok(())
    }

    /// Removes the device, as the system does when commands hang, by submitting a list that is not closed.
    pub(crate) fn remove_device(&self) -> Result<()> {
        let kind = D3D12_COMMAND_LIST_TYPE_DIRECT;
        let wanted = D3D12_COMMAND_QUEUE_DESC { Type: kind, ..Default::default() };
        // SAFETY: a live device, and its objects, which live during the calls.
        unsafe {
            let queue: ID3D12CommandQueue = self.device.CreateCommandQueue(&wanted)?;
            let allocator: ID3D12CommandAllocator = self.device.CreateCommandAllocator(kind)?;
            let list: ID3D12GraphicsCommandList = self.device.CreateCommandList(0, kind, &allocator, None)?;
            queue.ExecuteCommandLists(&[Some(list.cast()?)]);
        }
        Ok(())
    }
}

pub(crate) fn state(arg: u32) -> D3D12_RESOURCE_STATES {
    D3D12_RESOURCE_STATES(STATES.iter().find(|(known, _)| *known == arg).map_or(0, |(_, state)| *state))
}

/// # Safety
/// An open list, and live resources in the states before.
pub(crate) unsafe fn record_barriers(list: &ID3D12GraphicsCommandList, barriers: &[D3D12_RESOURCE_BARRIER]) {
    if !barriers.is_empty() {
        // SAFETY: the caller's promise.
        unsafe { list.ResourceBarrier(barriers) };
    }
}

fn root_signature(device: &ID3D12Device) -> Result<ID3D12RootSignature> {
    let range = |kind, count| D3D12_DESCRIPTOR_RANGE {
        RangeType: kind,
        NumDescriptors: count,
        OffsetInDescriptorsFromTableStart: D3D12_DESCRIPTOR_RANGE_OFFSET_APPEND,
        ..Default::default()
    };
    let ranges = [range(D3D12_DESCRIPTOR_RANGE_TYPE_SRV, INPUTS as u32), range(D3D12_DESCRIPTOR_RANGE_TYPE_UAV, 1)];
    let constants = D3D12_ROOT_CONSTANTS { Num32BitValues: CONSTANTS as u32, ..Default::default() };
    let table = D3D12_ROOT_DESCRIPTOR_TABLE { NumDescriptorRanges: 2, pDescriptorRanges: ranges.as_ptr() };
    let parameters = [
        D3D12_ROOT_PARAMETER {
            ParameterType: D3D12_ROOT_PARAMETER_TYPE_32BIT_CONSTANTS,
            Anonymous: D3D12_ROOT_PARAMETER_0 { Constants: constants },
            ShaderVisibility: D3D12_SHADER_VISIBILITY_ALL,
        },
        D3D12_ROOT_PARAMETER {
            ParameterType: D3D12_ROOT_PARAMETER_TYPE_DESCRIPTOR_TABLE,
            Anonymous: D3D12_ROOT_PARAMETER_0 { DescriptorTable: table },
            ShaderVisibility: D3D12_SHADER_VISIBILITY_ALL,
        },
    ];
    let wanted = D3D12_ROOT_SIGNATURE_DESC { NumParameters: 2, pParameters: parameters.as_ptr(), ..Default::default() };
    let mut blob: Option<ID3DBlob> = None;
    // SAFETY: the description and the memory it points to live during the call.
    unsafe { D3D12SerializeRootSignature(&wanted, D3D_ROOT_SIGNATURE_VERSION_1, &mut blob, None) }?;
    let blob = blob.ok_or_else(windows::core::Error::empty)?;
    // SAFETY: a live blob and a live device.
    unsafe {
        let bytes = std::slice::from_raw_parts(blob.GetBufferPointer().cast::<u8>(), blob.GetBufferSize());
        device.CreateRootSignature(0, bytes)
    }
}

pub(crate) fn committed(
    device: &ID3D12Device,
    heap: D3D12_HEAP_TYPE,
    wanted: &D3D12_RESOURCE_DESC,
    state: D3D12_RESOURCE_STATES,
) -> Result<ID3D12Resource> {
    let heap = D3D12_HEAP_PROPERTIES { Type: heap, ..Default::default() };
    let mut made: Option<ID3D12Resource> = None;
    // SAFETY: descriptions and memory for the result live during the call.
    unsafe { device.CreateCommittedResource(&heap, D3D12_HEAP_FLAG_NONE, wanted, state, None, &mut made) }?;
    made.ok_or_else(windows::core::Error::empty)
}

/// An object as a field of a description: without a reference of its own.
fn borrowed<T: Interface>(object: &T) -> ManuallyDrop<Option<T>> {
    // SAFETY: the same pointer; `ManuallyDrop` releases no reference.
    unsafe { std::mem::transmute_copy(object) }
}

pub(crate) fn transition(
    resource: &ID3D12Resource,
    before: D3D12_RESOURCE_STATES,
    after: D3D12_RESOURCE_STATES,
) -> D3D12_RESOURCE_BARRIER {
    let transition = D3D12_RESOURCE_TRANSITION_BARRIER {
        pResource: borrowed(resource),
        Subresource: D3D12_RESOURCE_BARRIER_ALL_SUBRESOURCES,
        StateBefore: before,
        StateAfter: after,
    };
    D3D12_RESOURCE_BARRIER {
        Type: D3D12_RESOURCE_BARRIER_TYPE_TRANSITION,
        Anonymous: D3D12_RESOURCE_BARRIER_0 { Transition: ManuallyDrop::new(transition) },
        ..Default::default()
    }
}
