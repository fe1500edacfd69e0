"""Schemas of ONNX Runtime's own operators, so that onnx checks their nodes and infers their shapes."""

from __future__ import annotations

import onnx
from onnx import defs

from .graph import CONTRIB_DOMAIN

_FLOATS = [("T", ["tensor(float)", "tensor(float16)"], "float32 or float16")]
_Schema = defs.OpSchema


def _like_first(context) -> None:
    context.set_output_type(0, context.get_input_type(0))


def _product(context) -> None:
    """a b^T where `transB` is 1, else a b, over the last two axes."""
    a, b = context.get_input_type(0), context.get_input_type(1)
    if not (a.tensor_type.HasField("shape") and b.tensor_type.HasField("shape")):
        return
    out = onnx.TypeProto()
    out.CopyFrom(a)
    last = b.tensor_type.shape.dim[-2 if context.get_attribute("transB").i else -1]
    out.tensor_type.shape.dim[-1].CopyFrom(last)
    context.set_output_type(0, out)


def _product_of_blocks(context) -> None:
    """a b, where b is stored in blocks and has `N` columns."""
    a = context.get_input_type(0)
    if not a.tensor_type.HasField("shape"):
        return
    out = onnx.TypeProto()
    out.CopyFrom(a)
    out.tensor_type.shape.dim[-1].Clear()
    out.tensor_type.shape.dim[-1].dim_value = context.get_attribute("N").i
    context.set_output_type(0, out)


def _register(name: str, domain: str, inputs: list[tuple[str, str]], attributes: dict, infer) -> None:
    schema = _Schema(
        name,
        domain,
        1,
        doc="An operator of ONNX Runtime.",
        inputs=[_Schema.FormalParameter(i, kind) for i, kind in inputs],
        outputs=[_Schema.FormalParameter("Y", "T")],
        type_constraints=_FLOATS,
        attributes=[_Schema.Attribute(n, kind, "") for n, kind in attributes.items()],
    )
    schema.set_type_and_shape_inference_function(infer)
    defs.register_schema(schema)


_INT, _FLOAT = _Schema.AttrType.INT, _Schema.AttrType.FLOAT


def register() -> None:
    """Registers the schemas, once in a process."""
    if defs.has("SimplifiedLayerNormalization"):
        return
    norm = {"axis": _INT, "epsilon": _FLOAT}
    _register("SimplifiedLayerNormalization", "", [("X", "T"), ("scale", "T")], norm, _like_first)
    _register("FusedMatMul", CONTRIB_DOMAIN, [("A", "T"), ("B", "T")], {"alpha": _FLOAT, "transB": _INT}, _product)
    sizes = dict.fromkeys(("K", "N", "bits", "block_size", "accuracy_level"), _INT)
    inputs = [("A", "T"), ("B", "tensor(uint8)"), ("scales", "T")]
    _register("MatMulNBits", CONTRIB_DOMAIN, inputs, sizes, _product_of_blocks)
    inputs = [("X", "T"), ("position_ids", "tensor(int64)"), ("cos_cache", "T"), ("sin_cache", "T")]
    _register("RotaryEmbedding", CONTRIB_DOMAIN, inputs, {"interleaved": _INT}, _like_first)
