//! ONNX's protobuf messages: the numbers of their fields, by the fields' names in `onnx/onnx.proto3` of ONNX 1.17. Fields that no bundle has are here
//! if they are refused by name.

macro_rules! messages {
    ($($message:ident { $($field:ident = $number:literal),* })*) => {$(
        pub(super) enum $message {}

        impl $message {
            $(pub(super) const $field: u32 = $number;)*
        }
    )*};
}

messages! {
    ModelProto {
        IR_VERSION = 1, PRODUCER_NAME = 2, PRODUCER_VERSION = 3, DOMAIN = 4, MODEL_VERSION = 5, DOC_STRING = 6, GRAPH = 7, OPSET_IMPORT = 8,
        METADATA_PROPS = 14, TRAINING_INFO = 20, FUNCTIONS = 25
    }
    OperatorSetIdProto { DOMAIN = 1, VERSION = 2 }
    GraphProto {
        NODE = 1, NAME = 2, INITIALIZER = 5, DOC_STRING = 10, INPUT = 11, OUTPUT = 12, VALUE_INFO = 13, SPARSE_INITIALIZER = 15
    }
    NodeProto { INPUT = 1, OUTPUT = 2, NAME = 3, OP_TYPE = 4, ATTRIBUTE = 5, DOC_STRING = 6, DOMAIN = 7 }
    AttributeProto {
        NAME = 1, F = 2, I = 3, S = 4, G = 6, INTS = 8, GRAPHS = 11, DOC_STRING = 13, TYPE = 20, REF_ATTR_NAME = 21
    }
    TensorProto {
        DIMS = 1, DATA_TYPE = 2, FLOAT_DATA = 4, INT64_DATA = 7, NAME = 8, RAW_DATA = 9, DOUBLE_DATA = 10, UINT64_DATA = 11, DOC_STRING = 12,
        EXTERNAL_DATA = 13, DATA_LOCATION = 14
    }
    StringStringEntryProto { KEY = 1, VALUE = 2 }
    ValueInfoProto { NAME = 1, TYPE = 2, DOC_STRING = 3 }
    TypeProto { TENSOR_TYPE = 1 }
    // `TypeProto.Tensor`, `TensorShapeProto` and its `Dimension`.
    TensorTypeProto { ELEM_TYPE = 1, SHAPE = 2 }
    TensorShapeProto { DIM = 1 }
    DimensionProto { DIM_VALUE = 1, DIM_PARAM = 2, DENOTATION = 3 }
}

/// Values of `AttributeProto.type`.
pub(super) mod attribute_type {
    pub(in crate::bundle::onnx) const FLOAT: i64 = 1;
    pub(in crate::bundle::onnx) const INT: i64 = 2;
    pub(in crate::bundle::onnx) const STRING: i64 = 3;
    pub(in crate::bundle::onnx) const INTS: i64 = 7;
}

/// Values of `TensorProto.data_location`.
pub(super) mod data_location {
    pub(in crate::bundle::onnx) const DEFAULT: i64 = 0;
    pub(in crate::bundle::onnx) const EXTERNAL: i64 = 1;
}
