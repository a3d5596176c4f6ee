"""Reads the net from its ONNX file, and writes a trained net in the same form.

The written file has the graph of models/detector_coco.onnx: the same names, inputs and outputs, other weights. So the
product and `scripts/models/quantise.py` take it as it is. The card changes in its sha256, and perhaps in its classes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from roadplane_train.cars.mesh import REPOSITORY
from roadplane_train.detect.model import BINS, STRIDES, NanoDet

ORIGINAL = REPOSITORY / "models" / "detector_coco.onnx"


def read_net(path: Path = ORIGINAL) -> NanoDet:
    """Returns the net with the weights of an ONNX file."""
    graph = onnx.load(path).graph
    arrays = {tensor.name: numpy_helper.to_array(tensor).astype(np.float32) for tensor in graph.initializer}
    nodes = {node.name: node for node in graph.node if node.op_type == "Conv"}
    names = [_name(k) for k in range(len(NanoDet().convolutions()))]
    if sorted(nodes) != sorted(names):
        raise ValueError(f"{path} has other convolutions than NanoDet-g")
    arrays |= {node.output[0]: arrays[node.input[0]] for node in graph.node if node.op_type == "Cast"}
    net = NanoDet(len(arrays[nodes[names[-1]].input[1]]) - 4 * BINS)
    layers = net.convolutions()
    with torch.no_grad():
        for k, layer in enumerate(layers):
            kernel, bias = (arrays[name] for name in nodes[_name(k)].input[1:])
            if kernel.shape != tuple(layer.weight.shape):
                raise ValueError(f"{path}: {_name(k)} has the shape {kernel.shape} instead of {tuple(layer.weight.shape)}")
            layer.weight.copy_(torch.from_numpy(kernel))
            layer.bias.copy_(torch.from_numpy(bias))
    return net


def write_net(net: NanoDet, path: Path, half: bool = False) -> None:
    """Writes the net with the graph of the original file; `half` stores kernels and biases as f16."""
    model = onnx.load(ORIGINAL)
    graph = model.graph
    weights = {}
    for k, layer in enumerate(net.convolutions()):
        weights[f"{_name(k)}.kernel"] = layer.weight.detach().contiguous().numpy()
        weights[f"{_name(k)}.bias"] = layer.bias.detach().numpy()
    # The kernel that divides by the sd was f32 in the original, too: it has few weights and reads the picture.
    halved = {name for name in weights if half and name != "convolution.kernel"}
    others = [tensor for tensor in graph.initializer if tensor.name.removesuffix(".f16") not in weights]
    nodes = [node for node in graph.node if node.op_type != "Cast"]
    casts = [helper.make_node("Cast", [f"{name}.f16"], [name], name=name, to=TensorProto.FLOAT) for name in sorted(halved)]
    stored = [
        numpy_helper.from_array(array.astype(np.float16), f"{name}.f16")
        if name in halved
        else numpy_helper.from_array(array, name)
        for name, array in weights.items()
    ]
    sizes = [numpy_helper.from_array(np.array([net.classes, 4 * BINS], np.int64), f"split_{stride}.sizes") for stride in STRIDES]
    fixed = [tensor for tensor in others if not tensor.name.startswith("split_")]
    for value in graph.output:
        if value.name.startswith("scores_"):
            value.type.tensor_type.shape.dim[1].dim_value = net.classes
    del graph.node[:], graph.initializer[:], graph.value_info[:]
    graph.node.extend(casts + nodes)
    graph.initializer.extend(fixed + sizes + stored)
    onnx.checker.check_model(model, full_check=True)
    path.write_bytes(model.SerializeToString(deterministic=True))


def rounded(net: NanoDet) -> NanoDet:
    """Returns a copy of the net with the weights that `write_net(half=True)` stores."""
    copy = NanoDet(net.classes)
    copy.load_state_dict(net.state_dict())
    first = copy.stem.weight
    for parameter in copy.parameters():
        if parameter is not first:
            parameter.data = parameter.data.half().float()
    return copy


def answers(net: nn.Module, image: torch.Tensor) -> dict[str, np.ndarray]:
    """Returns the outputs of the ONNX file, computed by the module."""
    with torch.no_grad():
        levels = net(image)
    found = {}
    for stride, (logits, bins) in zip(STRIDES, levels, strict=True):
        found |= {f"scores_{stride}": logits.sigmoid().numpy(), f"bins_{stride}": bins.numpy()}
    return found


def _name(k: int) -> str:
    return f"convolution_{k}" if k else "convolution"
