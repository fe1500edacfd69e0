//! The recorder of Direct3D 12 calls on real calls: correct frames of the library break no rule, and mutants of its calls do. Runs where the
//! recorder is this program's `d3d12.dll`: `cargo xtask test recorder`, in the lab.
#![cfg(windows)]

use test_support::d3d12::recorder::{Finding, findings_of, report_live};

mod counts;
mod faults;
mod frames;
mod mutants;
mod placed;
mod present;
use mutants::Mutant;

/// Identifiers of Microsoft's debug layer, without their common start.
const LAYER: &str = "D3D12_MESSAGE_ID_";

/// The rules that frames break with a mutant of the library's calls, or without one.
fn broken(mutant: Option<Mutant>) -> Vec<Finding> {
    findings_of(|| {
        let ran = frames::run(mutant);
        assert!(ran.is_ok() || mutant.is_some(), "correct frames: {ran:?}");
        report_live();
    })
}

/// Frames with a mutant must break each of these rules.
fn must_break(mutant: Mutant, ids: &[&str]) {
    let found = broken(Some(mutant));
    for id in ids {
        let is_found = found.iter().any(|finding| finding.id == *id || finding.id.strip_prefix(LAYER) == Some(id));
        assert!(is_found, "{mutant:?} breaks {id}, and the recorder finds {found:#?}");
    }
}

#[test]
fn correct_frames_break_no_rule_and_leave_no_object() {
    assert_eq!(broken(None), []);
}

/// A test for each mutant, by the rules that it breaks.
macro_rules! mutants {
    ($($name:ident: $mutant:ident breaks $($id:ident)+;)*) => {$(
        #[test]
        fn $name() {
            must_break(Mutant::$mutant, &[$(stringify!($id)),+]);
        }
    )*};
}

mutants! {
    uav_barriers_are_dropped: UavBarrierDropped breaks RECORDER_UAV_WITHOUT_BARRIER;
    uav_barriers_name_another_resource: UavBarrierOfAnother breaks RECORDER_UAV_WITHOUT_BARRIER;
    transitions_are_dropped: TransitionDropped breaks INVALID_SUBRESOURCE_STATE;
    transitions_are_recorded_twice: TransitionTwice breaks RESOURCE_BARRIER_BEFORE_AFTER_MISMATCH;
    transitions_start_at_another_state: WrongStateBefore breaks RESOURCE_BARRIER_BEFORE_AFTER_MISMATCH;
    transitions_end_at_another_state: WrongStateAfter breaks INVALID_SUBRESOURCE_STATE;
    transitions_change_nothing: SameStates breaks RESOURCE_BARRIER_MATCHING_STATES;
    a_state_writes_and_reads: CombinedStates breaks RESOURCE_BARRIER_INVALID_COMBINATION;
    a_state_needs_a_flag_that_the_resource_has_not: StateWithoutFlag breaks RESOURCE_BARRIER_MISSING_BIND_FLAGS;
    a_state_is_of_another_type_of_list: StateOfAnotherList breaks RESOURCE_BARRIER_INVALID_COMMAND_LIST_TYPE;
    a_transition_names_no_subresource: NoSuchSubresource breaks RESOURCE_BARRIER_INVALID_SUBRESOURCE;
    a_split_barrier_does_not_end: SplitNotEnded breaks RESOURCE_BARRIER_UNMATCHED_BEGIN;
    a_split_barrier_does_not_begin: SplitNotBegun breaks RESOURCE_BARRIER_UNMATCHED_END;
    the_pipeline_is_not_set: PipelineNotSet breaks COMMAND_LIST_PIPELINE_STATE_NOT_SET;
    the_root_signature_is_not_set: RootSignatureNotSet breaks COMMAND_LIST_DISPATCH_ROOT_SIGNATURE_NOT_SET;
    the_table_is_not_set: TableNotSet breaks COMMAND_LIST_DESCRIPTOR_TABLE_NOT_SET;
    the_constants_are_not_set: ConstantsNotSet breaks GPU_BASED_VALIDATION_ROOT_ARGUMENT_UNINITIALIZED;
    the_descriptor_heap_is_not_set: HeapNotSet breaks SET_DESCRIPTOR_TABLE_INVALID;
    descriptors_are_not_written: DescriptorNotWritten breaks GPU_BASED_VALIDATION_DESCRIPTOR_UNINITIALIZED;
    outputs_are_described_as_inputs: DescriptorOfAnotherKind breaks GPU_BASED_VALIDATION_DESCRIPTOR_TYPE_MISMATCH;
    a_descriptor_in_flight_is_overwritten: DescriptorOverwritten breaks RECORDER_DESCRIPTOR_WRITTEN_WHILE_IN_USE;
    views_end_behind_their_buffers: ViewOutOfBounds breaks CREATESHADERRESOURCEVIEW_INVALIDDIMENSIONS;
    a_queue_does_not_wait: WaitDropped breaks RECORDER_QUEUES_NOT_ORDERED;
    a_queue_waits_for_an_earlier_value: WaitForEarlierValue breaks RECORDER_QUEUES_NOT_ORDERED;
    a_list_is_executed_twice: ExecutedTwice breaks COMMAND_LIST_SYNC;
    a_list_is_not_closed: NotClosed breaks EXECUTECOMMANDLISTS_OPENCOMMANDLIST;
    memory_is_mapped_behind_its_end: MappedBehindEnd breaks MAP_INVALIDRANGE;
    fences_are_not_waited_for: FenceNotWaited breaks
        COMMAND_ALLOCATOR_SYNC OBJECT_DELETED_WHILE_STILL_IN_USE;
    a_reference_is_not_released: ReleaseDropped breaks LIVE_RESOURCE;
}
