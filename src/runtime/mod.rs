//! ONNX Runtime on one device: sessions, buffers and their bindings.
