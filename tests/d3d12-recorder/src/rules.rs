//! The rules, each with an identifier: that of the message of Microsoft's debug layer, where it has one.

/// Declares [`Rule`] with identifiers, and the numbers of those that are in `D3D12_MESSAGE_ID` of `d3d12sdklayers.h`.
macro_rules! rules {
    (
        layer { $($(#[doc = $text:literal])+ $name:ident = $id:ident, $number:literal;)+ }
        own { $($(#[doc = $own_text:literal])+ $own:ident = $own_id:literal;)+ }
    ) => {
        /// A rule of Direct3D 12.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum Rule {
            $($(#[doc = $text])+ $name,)+
            $($(#[doc = $own_text])+ $own,)+
        }

        impl Rule {
            /// All rules.
            pub const ALL: &[Self] = &[$(Self::$name,)+ $(Self::$own,)+];

            /// Name of the debug layer's message, or `RECORDER_…` where it has none.
            pub fn id(self) -> &'static str {
                match self {
                    $(Self::$name => stringify!($id),)+
                    $(Self::$own => $own_id,)+
                }
            }

            /// Number of the debug layer's message.
            pub fn number(self) -> Option<u32> {
                match self {
                    $(Self::$name => Some($number),)+
                    $(Self::$own => None,)+
                }
            }
        }

        #[cfg(all(test, windows))]
        mod tests {
            use super::Rule;

            #[test]
            fn numbers_are_those_of_the_header() {
                $(assert_eq!(
                    Rule::$name.number(),
                    u32::try_from(windows::Win32::Graphics::Direct3D12::$id.0).ok(),
                    "{}",
                    stringify!($id)
                );)+
            }
        }
    };
}

rules! {
    layer {
        /// A barrier's state before is not the state of the resource.
        BarrierBeforeMismatch = D3D12_MESSAGE_ID_RESOURCE_BARRIER_BEFORE_AFTER_MISMATCH, 527;
        /// A barrier has the same state before and after.
        BarrierMatchingStates = D3D12_MESSAGE_ID_RESOURCE_BARRIER_MATCHING_STATES, 525;
        /// A state combines a write with another state.
        BarrierInvalidCombination = D3D12_MESSAGE_ID_RESOURCE_BARRIER_INVALID_COMBINATION, 526;
        /// A resource was created without the flag that the state needs.
        BarrierMissingFlag = D3D12_MESSAGE_ID_RESOURCE_BARRIER_MISSING_BIND_FLAGS, 523;
        /// Resources in upload and readback heaps stay in their state.
        BarrierInvalidHeap = D3D12_MESSAGE_ID_RESOURCE_BARRIER_INVALID_HEAP, 741;
        /// A list of this type has no such state.
        BarrierInvalidListType = D3D12_MESSAGE_ID_RESOURCE_BARRIER_INVALID_COMMAND_LIST_TYPE, 537;
        /// The resource has no such subresource.
        BarrierInvalidSubresource = D3D12_MESSAGE_ID_RESOURCE_BARRIER_INVALID_SUBRESOURCE, 521;
        /// A split barrier ends that did not begin.
        BarrierUnmatchedEnd = D3D12_MESSAGE_ID_RESOURCE_BARRIER_UNMATCHED_END, 534;
        /// A split barrier begins twice, or the resource is used before its end.
        BarrierUnmatchedBegin = D3D12_MESSAGE_ID_RESOURCE_BARRIER_UNMATCHED_BEGIN, 535;
        /// An enhanced barrier of a subresource that another kind of barrier, or its creation, put into a state other than COMMON.
        BarrierInteropState = D3D12_MESSAGE_ID_BARRIER_INTEROP_INVALID_STATE, 1351;
        /// A transition barrier of a subresource that enhanced barriers left in another layout than COMMON, or with unfinished writes.
        BarrierInteropLayout = D3D12_MESSAGE_ID_BARRIER_INTEROP_INVALID_LAYOUT, 1350;
        /// An enhanced barrier's layout before is not the layout of the subresource.
        BarrierLayoutMismatch = D3D12_MESSAGE_ID_INCOMPATIBLE_BARRIER_LAYOUT, 1334;
        /// An enhanced barrier's accesses before are not those since the last barrier.
        BarrierAccessMismatch = D3D12_MESSAGE_ID_INCOMPATIBLE_BARRIER_ACCESS, 1332;
        /// Scope, access and layout on one side of an enhanced barrier do not go together.
        BarrierIncompatibleValues = D3D12_MESSAGE_ID_INCOMPATIBLE_BARRIER_VALUES, 1331;
        /// A texture barrier of a buffer, or a buffer barrier of a texture.
        BarrierType = D3D12_MESSAGE_ID_INCOMPATIBLE_BARRIER_TYPE, 1335;
        /// A texture barrier names subresources that its texture has not.
        BarrierSubresources = D3D12_MESSAGE_ID_TEXTURE_BARRIER_SUBRESOURCES_OUT_OF_BOUNDS, 1355;
        /// A buffer barrier is not of the whole buffer.
        BarrierBufferRange = D3D12_MESSAGE_ID_BUFFER_BARRIER_SUBREGION_OUT_OF_BOUNDS, 1340;
        /// A command uses a texture whose layout does not allow that.
        LayoutIncompatible = D3D12_MESSAGE_ID_GPU_BASED_VALIDATION_INCOMPATIBLE_TEXTURE_LAYOUT, 1358;
        /// A command uses a subresource that is not in the state for it.
        InvalidState = D3D12_MESSAGE_ID_INVALID_SUBRESOURCE_STATE, 538;
        /// An allocator is reset while one of its lists is recorded.
        AllocatorRecording = D3D12_MESSAGE_ID_COMMAND_ALLOCATOR_CANNOT_RESET, 543;
        /// Two lists are recorded with one allocator at a time.
        AllocatorContention = D3D12_MESSAGE_ID_COMMAND_ALLOCATOR_CONTENTION, 540;
        /// A list is executed whose allocator was reset after the list was closed.
        AllocatorReset = D3D12_MESSAGE_ID_COMMAND_ALLOCATOR_RESET, 541;
        /// An allocator is reset while its commands may still run.
        AllocatorInUse = D3D12_MESSAGE_ID_COMMAND_ALLOCATOR_SYNC, 552;
        /// A list has another type than its allocator.
        AllocatorType = D3D12_MESSAGE_ID_WRONG_COMMAND_ALLOCATOR_TYPE, 549;
        /// A command is recorded into a closed list, or a closed list is closed.
        ListClosed = D3D12_MESSAGE_ID_COMMAND_LIST_CLOSED, 547;
        /// An open list is reset.
        ListOpen = D3D12_MESSAGE_ID_COMMAND_LIST_OPEN, 544;
        /// A list is executed again while it may still run.
        ListInUse = D3D12_MESSAGE_ID_COMMAND_LIST_SYNC, 553;
        /// An open list is executed.
        ExecuteOpenList = D3D12_MESSAGE_ID_EXECUTECOMMANDLISTS_OPENCOMMANDLIST, 837;
        /// A list is executed on a queue of another type.
        ExecuteListType = D3D12_MESSAGE_ID_EXECUTECOMMANDLISTS_COMMANDLISTMISMATCH, 836;
        /// An object is released that queued commands use, or used by commands after its release.
        DeletedInUse = D3D12_MESSAGE_ID_OBJECT_DELETED_WHILE_STILL_IN_USE, 921;
        /// An object is evicted that queued commands use.
        EvictedInUse = D3D12_MESSAGE_ID_OBJECT_EVICTED_WHILE_STILL_IN_USE, 960;
        /// Commands use an evicted object.
        NotResident = D3D12_MESSAGE_ID_INVALID_USE_OF_NON_RESIDENT_RESOURCE, 608;
        /// A dispatch without a root signature.
        RootSignatureNotSet = D3D12_MESSAGE_ID_COMMAND_LIST_DISPATCH_ROOT_SIGNATURE_NOT_SET, 952;
        /// A dispatch with another root signature than its pipeline's.
        RootSignatureMismatch = D3D12_MESSAGE_ID_COMMAND_LIST_DISPATCH_ROOT_SIGNATURE_MISMATCH, 953;
        /// A dispatch without a pipeline.
        PipelineNotSet = D3D12_MESSAGE_ID_COMMAND_LIST_PIPELINE_STATE_NOT_SET, 1045;
        /// A dispatch without one of its descriptor tables.
        TableNotSet = D3D12_MESSAGE_ID_COMMAND_LIST_DESCRIPTOR_TABLE_NOT_SET, 991;
        /// A dispatch without one of its root constant buffer views.
        RootCbvNotSet = D3D12_MESSAGE_ID_COMMAND_LIST_ROOT_CONSTANT_BUFFER_VIEW_NOT_SET, 992;
        /// A dispatch without one of its root shader resource views.
        RootSrvNotSet = D3D12_MESSAGE_ID_COMMAND_LIST_ROOT_SHADER_RESOURCE_VIEW_NOT_SET, 993;
        /// A dispatch without one of its root unordered access views.
        RootUavNotSet = D3D12_MESSAGE_ID_COMMAND_LIST_ROOT_UNORDERED_ACCESS_VIEW_NOT_SET, 994;
        /// A dispatch without all of its root constants.
        RootConstantsNotSet = D3D12_MESSAGE_ID_GPU_BASED_VALIDATION_ROOT_ARGUMENT_UNINITIALIZED, 935;
        /// A descriptor heap is set that shaders cannot see, or two of one type.
        SetHeapInvalid = D3D12_MESSAGE_ID_SET_DESCRIPTOR_HEAP_INVALID, 554;
        /// A table is set that is not in the set heap, or where the root signature has none.
        SetTableInvalid = D3D12_MESSAGE_ID_SET_DESCRIPTOR_TABLE_INVALID, 708;
        /// Constants are set where the root signature has none, or more than it has.
        SetConstantInvalid = D3D12_MESSAGE_ID_SET_ROOT_CONSTANT_INVALID, 709;
        /// A root constant buffer view is set where the root signature has none, or at no buffer.
        SetRootCbvInvalid = D3D12_MESSAGE_ID_SET_ROOT_CONSTANT_BUFFER_VIEW_INVALID, 710;
        /// A root shader resource view is set where the root signature has none, or at no buffer.
        SetRootSrvInvalid = D3D12_MESSAGE_ID_SET_ROOT_SHADER_RESOURCE_VIEW_INVALID, 711;
        /// A root unordered access view is set where the root signature has none, or at no buffer.
        SetRootUavInvalid = D3D12_MESSAGE_ID_SET_ROOT_UNORDERED_ACCESS_VIEW_INVALID, 712;
        /// A table reaches over the end of its heap.
        TableOutOfBounds = D3D12_MESSAGE_ID_GPU_BASED_VALIDATION_DESCRIPTOR_HEAP_INDEX_OUT_OF_BOUNDS, 936;
        /// A table has a descriptor that was never written.
        DescriptorUninitialized = D3D12_MESSAGE_ID_GPU_BASED_VALIDATION_DESCRIPTOR_UNINITIALIZED, 938;
        /// A table has a descriptor of another kind than its range.
        DescriptorTypeMismatch = D3D12_MESSAGE_ID_GPU_BASED_VALIDATION_DESCRIPTOR_TYPE_MISMATCH, 939;
        /// A view is written outside of every heap.
        DescriptorHandleInvalid = D3D12_MESSAGE_ID_INVALID_DESCRIPTOR_HANDLE, 646;
        /// A shader resource view has bytes or subresources that its resource has not.
        SrvOutOfBounds = D3D12_MESSAGE_ID_CREATESHADERRESOURCEVIEW_INVALIDDIMENSIONS, 31;
        /// An unordered access view has bytes or subresources that its resource has not.
        UavOutOfBounds = D3D12_MESSAGE_ID_CREATEUNORDEREDACCESSVIEW_INVALIDDIMENSIONS, 345;
        /// A constant buffer view ends behind its buffer.
        CbvOutOfBounds = D3D12_MESSAGE_ID_CREATE_CONSTANT_BUFFER_VIEW_INVALID_DESC, 650;
        /// A copy reads behind the end of its source.
        CopySourceOutOfBounds = D3D12_MESSAGE_ID_COPYBUFFERREGION_SRCRANGEOUTOFBOUNDS, 844;
        /// A copy writes behind the end of its destination.
        CopyDestinationOutOfBounds = D3D12_MESSAGE_ID_COPYBUFFERREGION_DSTRANGEOUTOFBOUNDS, 841;
        /// `DiscardResource` names subresources that its resource has not.
        DiscardOutOfBounds = D3D12_MESSAGE_ID_DISCARD_INVALID_SUBRESOURCE_RANGE, 995;
        /// A resource is mapped whose heap the processor cannot access.
        MapInvalidHeap = D3D12_MESSAGE_ID_MAP_INVALIDHEAP, 822;
        /// A subresource is mapped that does not exist.
        MapInvalidSubresource = D3D12_MESSAGE_ID_MAP_INVALIDSUBRESOURCE, 826;
        /// The range to read ends before its start or behind the resource.
        MapInvalidRange = D3D12_MESSAGE_ID_MAP_INVALIDRANGE, 828;
        /// The written range ends before its start or behind the resource.
        UnmapInvalidRange = D3D12_MESSAGE_ID_UNMAP_INVALIDRANGE, 829;
        /// A resource is unmapped that is not mapped.
        UnmapNotMapped = D3D12_MESSAGE_ID_RESOURCE_UNMAP_NOTMAPPED, 310;
        /// A device is alive at the end.
        LiveDevice = D3D12_MESSAGE_ID_LIVE_DEVICE, 274;
        /// A queue is alive at the end.
        LiveQueue = D3D12_MESSAGE_ID_LIVE_COMMANDQUEUE, 570;
        /// An allocator is alive at the end.
        LiveAllocator = D3D12_MESSAGE_ID_LIVE_COMMANDALLOCATOR, 571;
        /// A pipeline is alive at the end.
        LivePipeline = D3D12_MESSAGE_ID_LIVE_PIPELINESTATE, 572;
        /// A list is alive at the end.
        LiveList = D3D12_MESSAGE_ID_LIVE_COMMANDLIST12, 573;
        /// A resource is alive at the end.
        LiveResource = D3D12_MESSAGE_ID_LIVE_RESOURCE, 575;
        /// A descriptor heap is alive at the end.
        LiveDescriptorHeap = D3D12_MESSAGE_ID_LIVE_DESCRIPTORHEAP, 576;
        /// A root signature is alive at the end.
        LiveRootSignature = D3D12_MESSAGE_ID_LIVE_ROOTSIGNATURE, 577;
        /// A heap is alive at the end.
        LiveHeap = D3D12_MESSAGE_ID_LIVE_HEAP, 579;
        /// A fence is alive at the end.
        LiveFence = D3D12_MESSAGE_ID_LIVE_MONITOREDFENCE, 580;
        /// A query heap is alive at the end.
        LiveQueryHeap = D3D12_MESSAGE_ID_LIVE_QUERYHEAP, 581;
    }
    own {
        /// Two commands access memory through unordered access views, or one clears it, without a barrier between them.
        UavWithoutBarrier = "RECORDER_UAV_WITHOUT_BARRIER";
        /// Two queues access memory, one of them writes, and no fence orders them.
        QueuesNotOrdered = "RECORDER_QUEUES_NOT_ORDERED";
        /// A descriptor is written that queued commands use.
        DescriptorInUse = "RECORDER_DESCRIPTOR_WRITTEN_WHILE_IN_USE";
        /// Memory is mapped for reading while queued commands write it.
        MapInUse = "RECORDER_MAPPED_WHILE_WRITTEN";
        /// A submission uses memory of a heap through two resources without an aliasing barrier between them.
        AliasingBarrierMissing = "RECORDER_ALIASING_BARRIER_MISSING";
        /// The first use of a placed or reserved render target or depth buffer, or the first after another resource used its memory, is no
        /// clear, discard or copy of whole subresources.
        PlacedNotInitialized = "RECORDER_PLACED_RESOURCE_NOT_INITIALIZED";
        /// A command accesses a resource in a way that the last enhanced barrier does not allow, or after a write of another kind.
        AccessWithoutBarrier = "RECORDER_ACCESS_WITHOUT_BARRIER";
        /// Lists of this type have no such layout, access or scope.
        EnhancedBarrierListType = "RECORDER_ENHANCED_BARRIER_NOT_IN_LIST_TYPE";
        /// A command is recorded into a list of a type that has no such command.
        CommandListType = "RECORDER_COMMAND_NOT_IN_LIST_TYPE";
    }
}

/// A rule that a call broke.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// The rule.
    pub rule: Rule,
    /// Interface and method of the call, such as `ID3D12GraphicsCommandList::Dispatch`.
    pub function: &'static str,
    /// The objects and values.
    pub text: String,
    /// Code address that made the call, or recorded the command; 0 if it is not known.
    pub caller: usize,
}

impl Finding {
    /// The finding as JSON, in the form of the messages of Vulkan's validation layer.
    pub fn to_json(&self) -> String {
        let quoted = |text: &str| serde_json::Value::from(text).to_string();
        format!(
            "{{\n\t\"Severity\" : \"Error\",\n\t\"VUID\" : {},\n\t\"Function\" : {},\n\t\"MainMessage\" : {}\n}}\n",
            quoted(self.rule.id()),
            quoted(self.function),
            quoted(&self.text)
        )
    }
}
