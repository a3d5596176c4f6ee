"""Initial weights of a training: a checkpoint or an exported net, perhaps of fewer channels or stacks."""

from __future__ import annotations

import json
from pathlib import Path

import torch

from roadplane_train.net.model import KEYPOINTS, StackedHourglass

# Weights of this part may be missing: it starts at zero.
ADDED_LATER = ".fine."


def read_weights(path: Path) -> dict[str, torch.Tensor]:
    """Reads the averaged weights of a checkpoint (`.pt`) or the weights of an exported net (`.onnx`)."""
    if path.suffix != ".onnx":
        return torch.load(path, map_location="cpu")["average"]
    import onnx

    stored = onnx.load(str(path)).graph.initializer
    return {
        tensor.name.removeprefix("net."): torch.from_numpy(onnx.numpy_helper.to_array(tensor).copy())
        for tensor in stored
        if tensor.name.startswith("net.")
    }


def read_stages(path: Path) -> list[dict]:
    """Reads the earlier trainings of a checkpoint or, from its card, of an exported net (`Training.stage`)."""
    if path.suffix != ".onnx":
        return torch.load(path, map_location="cpu")["stages"]
    return json.loads(path.with_suffix(".card.json").read_text())["how_made"]["stages"]


def _with_stacks(weights: dict[str, torch.Tensor], stacks: int) -> dict[str, torch.Tensor]:
    """Adds copies of the last stack after it; their input from its output starts at zero."""
    weights = dict(weights)
    for added in range(sum(name.startswith("heads.") for name in weights) // 2, stacks):
        for name in list(weights):
            part, _, rest = name.partition(f".{added - 1}.")
            if part in ("hourglasses", "features", "heads"):
                weights[f"{part}.{added}.{rest}"] = weights[name]
        outputs, inputs = weights[f"heads.{added}.weight"].shape[:2]
        weights[f"back.{added - 1}.weight"] = torch.zeros(inputs, inputs + outputs, 1, 1)
        weights[f"back.{added - 1}.bias"] = torch.zeros(inputs)
    return weights


def start(net: StackedHourglass, weights: dict[str, torch.Tensor]) -> None:
    """Copies the weights of a net of at most as many channels and stacks into `net`, which then computes the same.

    Added channels keep their random weights on the layers before them. Their weights towards the old channels start at
    zero (after Net2Net, Chen et al. 2016).
    """
    state = net.state_dict()
    weights = _with_stacks(weights, len(net.heads))
    differ = sorted(name for name in state.keys() ^ weights.keys() if ADDED_LATER not in name)
    if differ:
        raise ValueError(f"the initial weights are of a net with other parts: {differ[0]} and {len(differ) - 1} more")
    for name, old in weights.items():
        value = state[name]
        if any(n < m for n, m in zip(value.shape, old.shape, strict=True)):
            raise ValueError(f"{name}: the initial weights have more channels ({tuple(old.shape)})")
        if value.ndim == 0:
            value.copy_(old)
        elif value.ndim == 1:
            value[: len(old)] = old
        else:
            inputs = torch.arange(old.shape[1])
            if name.startswith("back."):
                inputs[-KEYPOINTS:] += value.shape[1] - old.shape[1]  # features first, then heatmaps
            value[: len(old)] = 0
            value[: len(old), inputs] = old
