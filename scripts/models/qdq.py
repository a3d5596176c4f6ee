"""Converts f32 ONNX graphs to int8 ones that ONNX Runtime computes in integers from end to end.

The graphs have pairs of QuantizeLinear and DequantizeLinear (QDQ), with ranges measured by running the f32 graph on
pictures. Activations are u8 with one range per tensor, weights i8 with one scale per output channel, biases and sums
i32.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import onnx
import onnxruntime
from onnx import helper, numpy_helper

Feed = dict[str, np.ndarray]

BINS = 2048
# Values of a tensor per picture in its histogram.
SAMPLES = 200_000
# Shares of the full range that are tried; the error decides.
SHARES = np.linspace(0.3, 1.0, 36)
# These keep the values of their input: one range before and after. (Concat does, too, for its inputs.)
SAME_RANGE = ("MaxPool", "Resize")


@dataclass
class Range:
    """The range of a u8 tensor."""

    low: float
    high: float

    @property
    def scale(self) -> np.float32:
        """Returns the size of a step."""
        return np.float32(max(self.high - self.low, 1e-6) / 255)

    @property
    def zero(self) -> np.uint8:
        """Returns the level of zero."""
        return np.uint8(np.clip(round(-self.low / float(self.scale)), 0, 255))


def session(model: onnx.ModelProto) -> onnxruntime.InferenceSession:
    """Returns a session with one thread; the numbers do not depend on the number of threads."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])


def exposing(model: onnx.ModelProto, tensors: Iterable[str]) -> onnx.ModelProto:
    """Returns the model with these tensors as its only outputs."""
    copy = onnx.ModelProto()
    copy.CopyFrom(model)
    del copy.graph.output[:]
    copy.graph.output.extend(helper.make_tensor_value_info(t, onnx.TensorProto.FLOAT, None) for t in tensors)
    return copy


def initializers(graph: onnx.GraphProto) -> dict[str, np.ndarray]:
    """Returns the constants of a graph."""
    return {i.name: numpy_helper.to_array(i) for i in graph.initializer}


def consumers(graph: onnx.GraphProto) -> dict[str, list[onnx.NodeProto]]:
    """Returns the nodes that read each tensor."""
    readers: dict[str, list[onnx.NodeProto]] = {}
    for node in graph.node:
        for name in node.input:
            readers.setdefault(name, []).append(node)
    return readers


def best_range(histogram: np.ndarray, low: float, high: float, negative_slope: float) -> Range:
    """Returns the range with the least expected squared error: rounding inside it, clipping outside.

    The next node multiplies negative values by `negative_slope`, so their errors count that much less.
    """
    edges = np.linspace(low, high, len(histogram) + 1)
    middle = (edges[:-1] + edges[1:]) / 2
    weight = histogram * np.where(middle < 0, negative_slope**2, 1.0)
    best, least = Range(min(low, 0.0), max(high, 0.0)), np.inf
    for bottom in np.unique(np.minimum(low * SHARES, 0.0)):
        for top in np.unique(np.maximum(high * SHARES, 0.0)):
            beyond = middle - np.clip(middle, bottom, top)
            error = float((weight * np.where(beyond == 0, ((top - bottom) / 255) ** 2 / 12, beyond**2)).sum())
            if error < least:
                best, least = Range(float(bottom), float(top)), error
    return best


def ranges(model: onnx.ModelProto, tensors: list[str], feeds: list[Feed], slopes: dict[str, float]) -> dict[str, Range]:
    """Returns the ranges of tensors of the f32 model on these pictures; `slopes` as in `best_range`, 1 by default."""
    run = session(exposing(model, tensors))
    lows, highs = np.full(len(tensors), np.inf), np.full(len(tensors), -np.inf)
    for feed in feeds:
        values = run.run(None, feed)
        lows = np.minimum(lows, [v.min() for v in values])
        highs = np.maximum(highs, [v.max() for v in values])
    histograms = np.zeros((len(tensors), BINS))
    for feed in feeds:
        for i, value in enumerate(run.run(None, feed)):
            flat = value.ravel()[:: max(1, value.size // SAMPLES)]
            histograms[i] += np.histogram(flat, BINS, (lows[i], highs[i] + 1e-9))[0]
    found = zip(tensors, histograms, lows, highs, strict=True)
    return {t: best_range(h, float(a), float(b), slopes.get(t, 1.0)) for t, h, a, b in found}


class Quantiser:
    """Decides which nodes of a graph compute in integers, and how."""

    def __init__(self, model: onnx.ModelProto, nodes: Iterable[str]) -> None:
        self.model, self.chosen = model, set(nodes)
        self.constants, self.readers = initializers(model.graph), consumers(model.graph)
        self.outputs = {o.name for o in model.graph.output}
        self.slopes: dict[str, float] = {}
        self.gives: dict[str, str] = {}  # node → its tensor: of the Relu after it, which a range from zero replaces
        self.same: dict[str, str] = {}  # tensor → the tensor whose range it shares
        self.dropped: set[str] = set()
        if unknown := self.chosen - {n.name for n in model.graph.node}:
            raise ValueError(f"no such nodes: {sorted(unknown)}")
        for node in model.graph.node:
            if node.name in self.chosen:
                self._plan(node)

    def _plan(self, node: onnx.NodeProto) -> None:
        out = self.gives[node.name] = node.output[0]
        if out in self.outputs:
            raise ValueError(f"{out} is an output of the net, which stays in f32")
        readers = self.readers.get(out, [])
        only = readers[0] if len(readers) == 1 else None
        if node.op_type in SAME_RANGE:
            self.same[out] = node.input[0]
        elif node.op_type == "Concat":
            self.same |= {name: out for name in node.input}
        elif only and only.op_type == "LeakyRelu":
            self.slopes[out] = float(helper.get_attribute_value(only.attribute[0]))
        elif only and only.op_type == "Relu":
            self.dropped.add(only.name)
            self.gives[node.name] = only.output[0]

    def _takes(self, node: onnx.NodeProto) -> list[str]:
        """Returns the tensors among a node's inputs."""
        count = 1 if node.op_type in ("Conv", *SAME_RANGE) else len(node.input)
        return [name for name in node.input[:count] if name]

    def _root(self, tensor: str) -> str:
        """Returns the tensor that shares its range with this one."""
        while tensor in self.same:
            tensor = self.same[tensor]
        return tensor

    def tensors(self) -> list[str]:
        """Returns all tensors that need a range."""
        chosen = [node for node in self.model.graph.node if node.name in self.chosen]
        names = [name for node in chosen for name in [*self._takes(node), self.gives[node.name]]]
        return list(dict.fromkeys(self._root(name) for name in names))

    def ranges(self, feeds: list[Feed]) -> dict[str, Range]:
        """Returns their ranges on these pictures."""
        return ranges(self.model, self.tensors(), feeds, self.slopes)

    def build(self, found: dict[str, Range]) -> onnx.ModelProto:
        """Builds the int8 model."""
        made = Graph()
        for node in self.model.graph.node:
            if node.name in self.dropped:
                continue
            copy = onnx.NodeProto()
            copy.CopyFrom(node)
            if node.name not in self.chosen:
                copy.input[:] = [made.twins.get(name, name) for name in node.input]
                made.nodes.append(copy)
                continue
            for name in self._takes(node):
                if name not in made.twins:
                    made.pair(name, name, self._root(name), found)
            copy.input[:] = [made.twins.get(name, name) for name in node.input]
            if node.op_type == "Conv":
                kernel = self.constants[node.input[1]]
                bias = self.constants[node.input[2]] if len(node.input) > 2 else np.zeros(len(kernel))
                copy.input[1:] = made.weights(node.name, kernel, bias, found[self._root(node.input[0])])
            out = self.gives[node.name]
            copy.output[0] = raw(out)
            made.nodes.append(copy)
            made.pair(out, raw(out), self._root(out), found)
        return made.model(self.model)


def raw(tensor: str) -> str:
    """Returns a tensor before it becomes u8."""
    return f"{tensor}.raw"


class Graph:
    """An int8 graph under construction."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: dict[str, np.ndarray] = {}
        self.twins: dict[str, str] = {}  # tensor → the same after it was a u8

    def pair(self, tensor: str, source: str, range_of: str, found: dict[str, Range]) -> None:
        """Quantises and dequantises `source`, as a replacement of `tensor`."""
        levels = [f"{range_of}.scale", f"{range_of}.zero"]
        self.constants |= dict(zip(levels, [found[range_of].scale, found[range_of].zero]))
        u8 = f"{tensor}.u8"
        self.twins[tensor] = f"{tensor}.f32"
        self.nodes.append(helper.make_node("QuantizeLinear", [source, *levels], [u8], f"{tensor}.quantise"))
        self.nodes.append(helper.make_node("DequantizeLinear", [u8, *levels], [f"{tensor}.f32"], f"{tensor}.dequantise"))

    def weights(self, name: str, kernel: np.ndarray, bias: np.ndarray, source: Range) -> list[str]:
        """Stores a convolution's kernel and bias as integers; returns the names by which it reads them."""
        scale = np.maximum(np.abs(kernel).max((1, 2, 3)) / 127, 1e-9).astype(np.float32)
        levels = np.round(kernel / scale[:, None, None, None]).clip(-127, 127).astype(np.int8)
        sums = scale * source.scale
        offsets = np.round(bias / sums).clip(-(2**31) + 1, 2**31 - 1).astype(np.int32)
        parts = {"kernel": (levels, scale), "bias": (offsets, sums)}
        for part, (values, steps) in parts.items():
            of = f"{name}.{part}"
            self.constants |= {f"{of}.integer": values, f"{of}.scale": steps}
            zero = f"{of}.zero"
            self.constants[zero] = np.zeros(len(steps), values.dtype)
            reads = [f"{of}.integer", f"{of}.scale", zero]
            self.nodes.append(helper.make_node("DequantizeLinear", reads, [f"{of}.f32"], f"{of}.dequantise", axis=0))
        return [f"{name}.{part}.f32" for part in parts]

    def model(self, like: onnx.ModelProto) -> onnx.ModelProto:
        """Returns the whole model, with inputs, outputs and the remaining constants of the f32 model."""
        model = onnx.ModelProto()
        model.CopyFrom(like)
        graph = model.graph
        used = {name for node in self.nodes for name in node.input}
        kept = [i for i in graph.initializer if i.name in used]
        del graph.node[:], graph.initializer[:], graph.value_info[:]
        graph.node.extend(self.nodes)
        graph.initializer.extend(kept)
        graph.initializer.extend(numpy_helper.from_array(np.asarray(v), n) for n, v in self.constants.items())
        onnx.checker.check_model(model)
        return model
