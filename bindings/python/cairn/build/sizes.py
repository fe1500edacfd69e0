"""Shapes and sizes of the values of a graph."""

from __future__ import annotations

import math
from typing import Protocol

import onnx
from onnx import shape_inference

from . import contrib

# Bytes of one number by its ONNX type.
ITEM_BYTES = {onnx.TensorProto.FLOAT: 4, onnx.TensorProto.FLOAT16: 2, onnx.TensorProto.INT64: 8, onnx.TensorProto.UINT8: 1}


class HasModel(Protocol):
    """A graph to be built, or one of a bundle."""

    def model(self) -> onnx.ModelProto:
        """A model that the caller may change."""


def value_sizes(graph: HasModel, dimensions: dict[str, int]) -> tuple[onnx.ModelProto, dict[str, tuple[list[int], int]]]:
    """The model with its symbolic dimensions fixed, and the shape and size in bytes of every node's output."""
    contrib.register()
    model = graph.model()
    for value in [*model.graph.input, *model.graph.output]:
        for d in value.type.tensor_type.shape.dim:
            if d.dim_param:
                d.dim_value = dimensions[d.dim_param]
    inferred = shape_inference.infer_shapes(model, check_type=True, strict_mode=True, data_prop=True)
    sizes = {}
    for value in [*inferred.graph.value_info, *inferred.graph.output]:
        tensor = value.type.tensor_type
        shape = [d.dim_value for d in tensor.shape.dim]
        sizes[value.name] = (shape, math.prod(shape) * ITEM_BYTES[tensor.elem_type])
    return inferred, sizes
