"""Makes the int8 files of the nets: models/<net>.int8.onnx and its entry among the `variants` of the net's card.

  python3 scripts/models/quantise.py detector [--real DIR]
  python3 scripts/models/quantise.py hourglass --crops .work/crops/train [--real DIR]

Processors with VNNI run these files two to three times as fast. `--real` is the folder of hand-labelled real cars that
the keypoint net was trained on (scripts/train/run --real). `--crops` is a folder of rendered training crops
(`roadplane-train render crops --count 512 --seed 77 --split train`). Nothing is random: the same pictures give the same
file on the same kind of CPU. It needs the environment of scripts/train: .runtime/train/bin/python.

The quantised parts and their ranges: qdq.py, models/detector.md, models/hourglass.md.
"""

import argparse
import hashlib
import json
import tempfile
from pathlib import Path

import cv2
import numpy as np
import onnx
from onnx import helper, numpy_helper
from onnxruntime.quantization.shape_inference import quant_pre_process
from qdq import Feed, Quantiser, Range, consumers, initializers, session

from roadplane_train.net.data import Shards, crop_from_box, crop_from_rendered, read_real, warp

ROOT = Path(__file__).resolve().parents[2]

# Pictures of the evaluation, so neither training nor calibration uses them.
HELD_OUT = ("pklot_ufpr04", "cnd5")

# Longer sides of the detector's calibration pictures: the smallest and the largest pass of the defaults.
SIDES_PX = (640, 1280)
MULTIPLE_PX = 32
PADDING = 114 / 255
# Nodes that predict from features; their output is read unchanged.
DETECTOR_HEADS = ("convolution_29", "convolution_31", "convolution_33")
DETECTOR_INTEGER = ("Conv", "LeakyRelu", "Concat", "Add", "Resize", "MaxPool")

CROPS = 128
BATCH = 8
# The convolutions that read the picture, the heads, and the features that the last heads read: their errors go straight
# into the heatmaps.
HOURGLASS_FLOAT = ("/stem.1/Conv", "/fine.0/Conv", "/heads.", "/features.2.2/Conv")


def detector_pictures(real: Path | None) -> list[np.ndarray]:
    """Yields the first frames of the rendered clips, and real pictures."""
    pictures = []
    for path in sorted((ROOT / "tests/data/lots/scenes").glob("clip_*.mp4")):
        frames = cv2.VideoCapture(str(path))
        done, frame = frames.read()
        if not done:
            raise ValueError(f"{path} cannot be read")
        pictures.append(frame)
    for path in sorted(real.glob("*.json")) if real else []:
        if path.stem not in HELD_OUT:
            pictures.append(cv2.imread(str(real / json.loads(path.read_text())["image"])))
    return [picture[..., ::-1] for picture in pictures]


def detector_feed(picture: np.ndarray, side: int) -> Feed:
    """Returns a picture as `crates/detect` passes it to the net."""
    scale = min(1.0, side / max(picture.shape[:2]))
    height, width = (max(1, round(length * scale)) for length in picture.shape[:2])
    scaled = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    image = np.full((1, 3, *(-(-n // MULTIPLE_PX) * MULTIPLE_PX for n in (height, width))), PADDING, np.float32)
    image[0, :, :height, :width] = scaled.transpose(2, 0, 1) / 255
    return {"image": image}


def hourglass_feeds(crops: Path, real: Path | None) -> list[Feed]:
    """Yields rendered training crops and crops of the real cars of the training, as the net's input."""
    shards = Shards(crops, CROPS)
    images = [warp(image, crop_from_rendered()) for image in shards.images[:CROPS]]
    for car in read_real(real) if real else []:
        if car.source not in HELD_OUT:
            images.append(warp(car.patch, crop_from_box(car.box)))
    values = np.stack(images).transpose(0, 3, 1, 2).astype(np.float32) / 255
    return [{"image": values[i : i + BATCH]} for i in range(0, len(values), BATCH)]


def replace(graph: onnx.GraphProto, name: str, value: np.ndarray) -> None:
    """Changes the value of a constant."""
    constant = next(i for i in graph.initializer if i.name == name)
    constant.CopyFrom(numpy_helper.from_array(np.ascontiguousarray(value, np.float32), name))


def attributes(node: onnx.NodeProto) -> dict[str, onnx.AttributeProto]:
    """Returns a node's attributes by name."""
    return {a.name: a for a in node.attribute}


def swap(graph: onnx.GraphProto, old: onnx.NodeProto, *new: onnx.NodeProto) -> None:
    """Replaces one node by several."""
    at = next(i for i, node in enumerate(graph.node) if node is old or node == old)
    del graph.node[at]
    for node in reversed(new):
        graph.node.insert(at, node)


def border_instead_of_mean(graph: onnx.GraphProto) -> None:
    """Moves the subtraction of the mean into the bias of the first convolution, and adds a fourth, empty channel.

    The runtime's fast integer convolution needs a multiple of four channels. The border of the convolution is then no
    longer zero but the same grey for all channels, instead of each channel's mean (a difference of 0.04).
    """
    constants = initializers(graph)
    centre = next(n for n in graph.node if n.name == "centred")
    first = consumers(graph)[centre.output[0]][0]
    kernel, bias, mean = (constants[name] for name in (*first.input[1:], centre.input[1]))
    replace(graph, first.input[1], np.concatenate([kernel, np.zeros_like(kernel[:, :1])], 1))
    replace(graph, first.input[2], bias - (kernel * mean).sum((1, 2, 3)))
    attributes(first)["pads"].ints[:] = [0, 0, 0, 0]
    graph.initializer.append(numpy_helper.from_array(np.array([0, 0, 1, 1, 0, 1, 1, 1]), "border"))
    graph.initializer.append(numpy_helper.from_array(np.float32(115 / 255), "border.value"))
    swap(graph, centre, helper.make_node("Pad", ["image", "border", "border.value"], list(centre.output), "bordered"))


def pools_as_convolutions(graph: onnx.GraphProto, channels: int) -> None:
    """Replaces averages over 2 × 2 cells by depthwise convolutions, which the runtime computes faster in integers."""
    for pool in [n for n in graph.node if n.op_type == "AveragePool"]:
        kernel = np.full((channels, 1, 2, 2), 0.25, np.float32)
        graph.initializer.append(numpy_helper.from_array(kernel, f"{pool.name}.kernel"))
        swap(
            graph,
            pool,
            helper.make_node(
                "Conv",
                [pool.input[0], f"{pool.name}.kernel"],
                list(pool.output),
                pool.name,
                group=channels,
                kernel_shape=[2, 2],
                strides=[2, 2],
            ),
        )


def fold_gains(graph: onnx.GraphProto) -> None:
    """Multiplies the gains behind convolutions into their kernels and biases."""
    constants, readers = initializers(graph), consumers(graph)
    by_output = {node.output[0]: node for node in graph.node}
    for product in [n for n in graph.node if n.op_type == "Mul"]:
        gain, source = product.input
        convolution = by_output.get(source)
        single = gain in constants and constants[gain].size == 1
        if single and convolution and convolution.op_type == "Conv" and len(readers[source]) == 1:
            for name in convolution.input[1:]:
                replace(graph, name, constants[name] * constants[gain])
            convolution.output[0] = product.output[0]
            swap(graph, product)


def blocks_into_convolutions(graph: onnx.GraphProto) -> None:
    """Replaces convolutions of 2 × 2 px blocks, laid out as channels, by ones of the picture with twice the stride."""
    nodes, readers, constants = {n.name: n for n in graph.node}, consumers(graph), initializers(graph)
    before, turn, after = (nodes[f"/net/stem/stem.0/{name}"] for name in ("Reshape", "Transpose", "Reshape_1"))
    if list(attributes(turn)["perm"].ints) != [0, 1, 3, 5, 2, 4]:
        raise ValueError("the blocks have another layout")
    for convolution in readers[after.output[0]]:
        kernel = constants[convolution.input[1]]
        count, size = len(kernel), kernel.shape[2]
        # Channel, row and column in the block, row and column of the block.
        parts = kernel.reshape(count, 3, 2, 2, size, size).transpose(0, 1, 4, 2, 5, 3)
        replace(graph, convolution.input[1], parts.reshape(count, 3, 2 * size, 2 * size))
        convolution.input[0] = before.input[0]
        for name in ("pads", "strides", "kernel_shape"):
            attributes(convolution)[name].ints[:] = [2 * length for length in attributes(convolution)[name].ints]
    for node in (before, turn, after):
        swap(graph, node)


def split_by_source(graph: onnx.GraphProto) -> None:
    """Splits convolutions (1 × 1) of features beside heatmaps into a sum: heatmaps need steps of their own."""
    constants, by_output = initializers(graph), {node.output[0]: node for node in graph.node}
    for whole in [n for n in graph.node if "/back." in n.name and n.op_type == "Conv"]:
        joined, kernel = by_output[whole.input[0]], constants[whole.input[1]]
        heatmaps = len(constants[next(n for n in graph.node if n.name == "/net/heads.0/Conv").input[1]])
        parts = np.split(kernel, [kernel.shape[1] - heatmaps], 1)
        made = []
        for source, part, bias in zip(joined.input, parts, (list(whole.input[2:]), []), strict=True):
            name = f"{whole.name}.{len(made)}"
            graph.initializer.append(numpy_helper.from_array(np.ascontiguousarray(part), f"{name}.kernel"))
            inputs = [source, f"{name}.kernel", *bias]
            made.append(helper.make_node("Conv", inputs, [f"{name}.sum"], name, kernel_shape=[1, 1]))
        total = helper.make_node("Add", [node.output[0] for node in made], list(whole.output), f"{whole.name}.sum")
        swap(graph, whole, *made, total)
        swap(graph, joined)


def simplified(path: Path) -> onnx.ModelProto:
    """Returns the f32 net with its constants folded."""
    with tempfile.TemporaryDirectory() as folder:
        quant_pre_process(path, Path(folder) / "net.onnx", skip_symbolic_shape=True)
        model = onnx.load(Path(folder) / "net.onnx")
    own = [entry for entry in model.opset_import if not entry.domain]
    del model.opset_import[:], model.graph.value_info[:]
    model.opset_import.extend(own)
    return model


def detector(models: Path, name: str, real: Path | None) -> tuple[onnx.ModelProto, str]:
    """Returns a detector in int8, and a description of the changes."""
    model = simplified(models / f"{name}.onnx")
    kernels = initializers(model.graph)
    border_instead_of_mean(model.graph)
    pools_as_convolutions(model.graph, kernels["convolution_28.kernel"].shape[1])
    pictures = detector_pictures(real)
    feeds = [detector_feed(picture, side) for picture in pictures for side in SIDES_PX]
    integer = [n.name for n in model.graph.node if n.op_type in DETECTOR_INTEGER and n.name not in DETECTOR_HEADS]
    quantiser = Quantiser(model, integer)
    # Pictures have 256 levels.
    ranges = quantiser.ranges(feeds) | {"centred": Range(0.0, 1.0)}
    check_same(models / f"{name}.onnx", model, feeds[1], tolerance=0.5)
    return quantiser.build(ranges), f"scripts/models/quantise.py {name}, {len(pictures)} pictures at {SIDES_PX} px"


def hourglass(models: Path, crops: Path, real: Path | None) -> tuple[onnx.ModelProto, str]:
    """Returns the keypoint net in int8, and a description of the changes."""
    model = simplified(models / "hourglass.onnx")
    fold_gains(model.graph)
    blocks_into_convolutions(model.graph)
    split_by_source(model.graph)
    feeds = hourglass_feeds(crops, real)
    check_same(models / "hourglass.onnx", model, feeds[0], tolerance=0.01)
    integer = [n.name for n in model.graph.node if n.op_type == "Conv" and all(f not in n.name for f in HOURGLASS_FLOAT)]
    quantiser = Quantiser(model, integer)
    count = sum(len(feed["image"]) for feed in feeds)
    return quantiser.build(quantiser.ranges(feeds)), f"scripts/models/quantise.py hourglass, {count} crops"


def check_same(path: Path, model: onnx.ModelProto, feed: Feed, tolerance: float) -> None:
    """Rejects a rewritten net whose numbers differ from the original's."""
    onnx.checker.check_model(model)
    before, after = (session(m).run(None, feed) for m in (onnx.load(path), model))
    difference = max(float(np.abs(a - b).max()) for a, b in zip(before, after, strict=True))
    print(f"{path.name}: rewritten in f32, largest difference {difference:.2g}")
    if not difference <= tolerance:
        raise ValueError("the rewritten net differs from the original")


def main() -> None:
    """Makes the int8 file of a net."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("net", choices=("detector", "detector_coco", "hourglass"))
    parser.add_argument("--models", type=Path, default=ROOT / "models", help="folder of the nets and their cards")
    parser.add_argument("--crops", type=Path, help="folder of rendered crops (*.npz) of the split train")
    parser.add_argument("--real", type=Path, help="folder of labelled real cars (*.json with pictures)")
    args = parser.parse_args()
    if args.net.startswith("detector"):
        model, how_made = detector(args.models, args.net, args.real)
    elif args.crops:
        model, how_made = hourglass(args.models, args.crops, args.real)
    else:
        parser.error("hourglass needs --crops")
    data = model.SerializeToString(deterministic=True)
    file = f"{args.net}.int8.onnx"
    (args.models / file).write_bytes(data)
    path = args.models / f"{args.net}.card.json"
    text = path.read_text()
    card = json.loads(text)
    variant = {
        "precision": "int8",
        "file": file,
        "sha256": hashlib.sha256(data).hexdigest(),
        "licence": card["licence"],
        "how_made": how_made,
    }
    others = card.get("variants", [])
    # Measurements belong to exactly this file.
    variant |= {"metrics": v["metrics"] for v in others if v["sha256"] == variant["sha256"] and "metrics" in v}
    card["variants"] = [v for v in others if v["precision"] != "int8"] + [variant]
    path.write_text(json.dumps(card, indent=text.index('"') - 2) + "\n")
    print(f"{file}: {len(data)} bytes, sha256 {variant['sha256']}")


if __name__ == "__main__":
    main()
