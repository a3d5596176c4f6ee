"""Reads a TensorFlow.js graph model (JSON + weight shards), and evaluates it in numpy, op by op.

It supports the ops of NanoDet's graph only; any other op is an error.
"""

import base64
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass
class Node:
    """One node: its op, its inputs (`name` or `name:k`) and its raw attributes."""

    name: str
    op: str
    inputs: list[str]
    attr: dict

    def text(self, key: str) -> str:
        return base64.b64decode(self.attr[key]["s"]).decode()

    def ints(self, key: str) -> list[int]:
        return [int(i) for i in self.attr[key]["list"].get("i", [])]


def load(json_path: Path) -> tuple[list[Node], dict[str, np.ndarray]]:
    """Returns the nodes in an order of evaluation, and the constants (f16 values widened to f32)."""
    model = json.loads(json_path.read_text())
    constants: dict[str, np.ndarray] = {}
    for group in model["weightsManifest"]:
        data = b"".join((json_path.parent / path).read_bytes() for path in group["paths"])
        at = 0
        for weight in group["weights"]:
            stored = np.dtype(weight.get("quantization", weight)["dtype"])
            count = int(np.prod(weight["shape"], dtype=int))
            values = np.frombuffer(data, stored, count, at).reshape(weight["shape"])
            constants[weight["name"]] = values.astype(weight["dtype"])
            at += count * stored.itemsize
        if at != len(data):
            raise ValueError(f"the weights end at byte {at} of {len(data)}")
    nodes = [
        Node(n["name"], n["op"], [i for i in n.get("input", []) if not i.startswith("^")], n.get("attr", {}))
        for n in model["modelTopology"]["node"]
    ]
    return _sorted(nodes), constants


def _sorted(nodes: list[Node]) -> list[Node]:
    by_name = {node.name: node for node in nodes}
    order: dict[str, Node] = {}

    def visit(node: Node) -> None:
        for name in node.inputs:
            source = by_name[name.split(":")[0]]
            if source.name not in order:
                visit(source)
        order[node.name] = node

    for node in nodes:
        if node.name not in order:
            visit(node)
    return list(order.values())


def evaluate(nodes: list[Node], constants: dict[str, np.ndarray], image: np.ndarray) -> dict[str, np.ndarray]:
    """Returns every node's value for a [1, 3, h, w] image; a SplitV's parts are `name`, `name:1`, …"""
    values: dict[str, np.ndarray] = {}
    for node in nodes:
        arguments = [values[name] for name in node.inputs]
        if node.op == "Placeholder":
            values[node.name] = image
        elif node.op == "Const":
            values[node.name] = constants[node.name]
        elif node.op == "SplitV":
            tensor, sizes, axis = arguments
            parts = np.split(tensor, np.cumsum(sizes)[:-1], axis=int(axis))
            values |= {f"{node.name}:{k}" if k else node.name: part for k, part in enumerate(parts)}
        else:
            values[node.name] = _OPS[node.op](node, *arguments)
    return values


def _windows(x: np.ndarray, height: int, width: int, node: Node) -> np.ndarray:
    if node.text("data_format") != "NHWC" or node.text("padding") != "VALID":
        raise ValueError(f"{node.name}: only NHWC without padding is supported")
    if any(dilation != 1 for dilation in (node.ints("dilations") if "dilations" in node.attr else [1])):
        raise ValueError(f"{node.name}: dilation is not supported")
    _, down, right, _ = node.ints("strides")
    return np.lib.stride_tricks.sliding_window_view(x, (height, width), (1, 2))[:, ::down, ::right]


def _conv2d(node: Node, x: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    windows = _windows(x, *kernel.shape[:2], node)  # [n, h, w, c, kh, kw]
    return np.tensordot(windows, kernel, ([3, 4, 5], [2, 0, 1])).astype(np.float32)


def _max_pool(node: Node, x: np.ndarray) -> np.ndarray:
    _, height, width, _ = node.ints("ksize")
    return _windows(x, height, width, node).max((4, 5))


def _resize_bilinear(node: Node, x: np.ndarray, size: np.ndarray) -> np.ndarray:
    if not node.attr["half_pixel_centers"]["b"] or node.attr["align_corners"]["b"]:
        raise ValueError(f"{node.name}: only half-pixel centres are supported")
    for axis, target in zip((1, 2), size, strict=True):
        source = x.shape[axis]
        at = (np.arange(target) + 0.5) * (source / target) - 0.5
        low = np.floor(at)
        part = (at - low).astype(np.float32).reshape([-1 if a == axis else 1 for a in range(4)])
        first, second = (np.clip(low + k, 0, source - 1).astype(int) for k in (0, 1))
        x = np.take(x, first, axis) * (1 - part) + np.take(x, second, axis) * part
    return x


def _sparse_to_dense(node: Node, indices: np.ndarray, shape: np.ndarray, values: np.ndarray, default: np.ndarray) -> np.ndarray:
    if indices.size or values.size:
        raise ValueError(f"{node.name}: only the empty case is supported")
    return np.full(shape, default)


_OPS = {
    "Add": lambda node, a, b: a + b,
    "AddV2": lambda node, a, b: a + b,
    "ConcatV2": lambda node, *a: np.concatenate(a[:-1], int(a[-1])),
    "Conv2D": _conv2d,
    "Identity": lambda node, a: a,
    "LeakyRelu": lambda node, a: np.where(a > 0, a, a * np.float32(node.attr["alpha"]["f"])),
    "MaxPool": _max_pool,
    "Pad": lambda node, a, pads: np.pad(a, pads),
    "PadV2": lambda node, a, pads, value: np.pad(a, pads, constant_values=value),
    "Reshape": lambda node, a, shape: a.reshape(shape),
    "ResizeBilinear": _resize_bilinear,
    "Sigmoid": lambda node, a: 1 / (1 + np.exp(-a)),
    "SparseToDense": _sparse_to_dense,
    "Transpose": lambda node, a, order: a.transpose(order),
}
