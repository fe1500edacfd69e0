//! The operators of the graphs that DirectML compiles, from hooks in the tables that its objects share.

use std::collections::HashMap;
use std::ffi::{CStr, c_void};
use std::sync::{LazyLock, Mutex, MutexGuard, OnceLock};

use cairn::gpu::Gpu;
use cairn::gpu::windows::Win32::AI::MachineLearning::DirectML::*;
use cairn::gpu::windows::core::{GUID, HRESULT, Interface};
use test_support::d3d12::directml;
use test_support::d3d12::function_tables::replace_function;

/// An operator of a compiled graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Operator {
    /// The name that ONNX Runtime gives it: that of the ONNX value that it computes, with a suffix.
    pub(crate) name: String,
    pub(crate) kind: DML_OPERATOR_TYPE,
}

impl Operator {
    /// Name of its type, without the prefix `DML_OPERATOR_`.
    pub(crate) fn kind_name(&self) -> String {
        kind_name(self.kind).map_or_else(|| format!("type {}", self.kind.0), str::to_owned)
    }
}

/// Names of the types that the embedded world's graphs have.
fn kind_name(kind: DML_OPERATOR_TYPE) -> Option<&'static str> {
    Some(match kind {
        DML_OPERATOR_ELEMENT_WISE_IDENTITY => "ELEMENT_WISE_IDENTITY",
        DML_OPERATOR_ELEMENT_WISE_ADD => "ELEMENT_WISE_ADD",
        DML_OPERATOR_ELEMENT_WISE_ADD1 => "ELEMENT_WISE_ADD1",
        DML_OPERATOR_ELEMENT_WISE_COS => "ELEMENT_WISE_COS",
        DML_OPERATOR_ELEMENT_WISE_DIVIDE => "ELEMENT_WISE_DIVIDE",
        DML_OPERATOR_ELEMENT_WISE_MULTIPLY => "ELEMENT_WISE_MULTIPLY",
        DML_OPERATOR_ELEMENT_WISE_SIN => "ELEMENT_WISE_SIN",
        DML_OPERATOR_ELEMENT_WISE_SQRT => "ELEMENT_WISE_SQRT",
        DML_OPERATOR_ELEMENT_WISE_SUBTRACT => "ELEMENT_WISE_SUBTRACT",
        DML_OPERATOR_ACTIVATION_RELU => "ACTIVATION_RELU",
        DML_OPERATOR_ACTIVATION_SIGMOID => "ACTIVATION_SIGMOID",
        DML_OPERATOR_ACTIVATION_SOFTMAX => "ACTIVATION_SOFTMAX",
        DML_OPERATOR_ACTIVATION_TANH => "ACTIVATION_TANH",
        DML_OPERATOR_CONVOLUTION => "CONVOLUTION",
        DML_OPERATOR_DEPTH_TO_SPACE1 => "DEPTH_TO_SPACE1",
        DML_OPERATOR_FILL_VALUE_SEQUENCE => "FILL_VALUE_SEQUENCE",
        DML_OPERATOR_GATHER => "GATHER",
        DML_OPERATOR_GEMM => "GEMM",
        DML_OPERATOR_REDUCE => "REDUCE",
        DML_OPERATOR_CAST => "CAST",
        DML_OPERATOR_SPLIT => "SPLIT",
        DML_OPERATOR_JOIN => "JOIN",
        DML_OPERATOR_SLICE1 => "SLICE1",
        // Types newer than the bindings, numbered as in DirectML.h.
        DML_OPERATOR_TYPE(153) => "ELEMENT_WISE_CLIP1",
        DML_OPERATOR_TYPE(158) => "ACTIVATION_SOFTMAX1",
        DML_OPERATOR_TYPE(167) => "ACTIVATION_SWISH",
        DML_OPERATOR_TYPE(171) => "MEAN_VARIANCE_NORMALIZATION2",
        DML_OPERATOR_TYPE(175) => "RESAMPLE3",
        _ => return None,
    })
}

#[derive(Default)]
struct Record {
    /// Types of operators, by address.
    kinds: HashMap<usize, DML_OPERATOR_TYPE>,
    /// Compiled graphs by address, and whether one was recorded in a command list.
    graphs: HashMap<usize, (Vec<Operator>, bool)>,
}

static RECORD: LazyLock<Mutex<Record>> = LazyLock::new(Mutex::default);

fn record() -> MutexGuard<'static, Record> {
    RECORD.lock().expect("nobody panics here")
}

type CreateOperator =
    unsafe extern "system" fn(*mut c_void, *const DML_OPERATOR_DESC, *const GUID, *mut *mut c_void) -> HRESULT;
type CompileGraph = unsafe extern "system" fn(
    *mut c_void,
    *const DML_GRAPH_DESC,
    DML_EXECUTION_FLAGS,
    *const GUID,
    *mut *mut c_void,
) -> HRESULT;
type RecordDispatch = unsafe extern "system" fn(*mut c_void, *mut c_void, *mut c_void, *mut c_void);
static CREATE_OPERATOR: OnceLock<CreateOperator> = OnceLock::new();
static COMPILE_GRAPH: OnceLock<CompileGraph> = OnceLock::new();
static RECORD_DISPATCH: OnceLock<RecordDispatch> = OnceLock::new();

unsafe extern "system" fn create_operator(
    this: *mut c_void,
    desc: *const DML_OPERATOR_DESC,
    id: *const GUID,
    made: *mut *mut c_void,
) -> HRESULT {
    let original = CREATE_OPERATOR.get().expect("the original function");
    // SAFETY: the caller's own arguments, passed on.
    let result = unsafe { original(this, desc, id, made) };
    if result.is_ok() && !made.is_null() {
        // SAFETY: the caller's own description, and the object that was made.
        let (address, kind) = unsafe { (*made as usize, (*desc).Type) };
        record().kinds.insert(address, kind);
    }
    result
}

unsafe extern "system" fn compile_graph(
    this: *mut c_void,
    desc: *const DML_GRAPH_DESC,
    flags: DML_EXECUTION_FLAGS,
    id: *const GUID,
    made: *mut *mut c_void,
) -> HRESULT {
    let original = COMPILE_GRAPH.get().expect("the original function");
    // SAFETY: the caller's own arguments, passed on.
    let result = unsafe { original(this, desc, flags, id, made) };
    if result.is_ok() && !made.is_null() {
        // SAFETY: the caller's own description, and the object that was made.
        let (address, nodes) =
            unsafe { (*made as usize, std::slice::from_raw_parts((*desc).Nodes, (*desc).NodeCount as usize)) };
        let mut record = record();
        // Other nodes are constants.
        let operators = nodes.iter().filter(|node| node.Type == DML_GRAPH_NODE_TYPE_OPERATOR).map(|node| {
            // SAFETY: the description of the node's type.
            let node = unsafe { &*node.Desc.cast::<DML_OPERATOR_GRAPH_NODE_DESC>() };
            let address = node.Operator.as_ref().map_or(0, |operator| operator.as_raw() as usize);
            let kind = *record.kinds.get(&address).expect("an operator that was created after the hooks");
            let name = if node.Name.is_null() {
                String::new()
            } else {
                // SAFETY: the caller's own text, which ends with a zero.
                unsafe { CStr::from_ptr(node.Name.0.cast()) }.to_string_lossy().into_owned()
            };
            Operator { name, kind }
        });
        let operators = operators.collect();
        record.graphs.insert(address, (operators, false));
    }
    result
}

unsafe extern "system" fn record_dispatch(this: *mut c_void, list: *mut c_void, of: *mut c_void, table: *mut c_void) {
    if let Some((_, is_recorded)) = record().graphs.get_mut(&(of as usize)) {
        *is_recorded = true;
    }
    let original = RECORD_DISPATCH.get().expect("the original function");
    // SAFETY: the caller's own arguments, passed on.
    unsafe { original(this, list, of, table) };
}

/// Records the operators of all DirectML devices from now on.
pub(crate) fn install(gpu: &Gpu) {
    let device = directml::device(gpu);
    let table = Interface::vtable(&device);
    replace_function(&raw const table.base__.CreateOperator, &CREATE_OPERATOR, create_operator);
    replace_function(&raw const table.CompileGraph, &COMPILE_GRAPH, compile_graph);
    // SAFETY: a live device.
    let recorder: IDMLCommandRecorder = unsafe { device.CreateCommandRecorder() }.expect("a command recorder");
    replace_function(&raw const Interface::vtable(&recorder).RecordDispatch, &RECORD_DISPATCH, record_dispatch);
}

/// The operators of the compiled graphs that were recorded in a command list since the hooks were installed.
pub(crate) fn recorded_graphs() -> Vec<Vec<Operator>> {
    record().graphs.values().filter(|(_, is_recorded)| *is_recorded).map(|(operators, _)| operators.clone()).collect()
}
