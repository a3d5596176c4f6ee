"""NanoDet-g as a PyTorch module, with the weights of models/detector_coco.onnx.

The net has a CSP backbone, path aggregation without weights, and one head per level. It has no batch normalisation,
because the published weights have it folded into the convolutions. `onnx_file` reads and writes its ONNX form.
"""

from __future__ import annotations

import torch
from torch import nn

# The published net has the first three.
CLASSES = ("car", "truck", "bus", "motorcycle")
STRIDES = (8, 16, 32)
BINS = 11
INPUT_PX = 416
# Of RGB in 0…1. The card's BGR figures in 0…255 are 103.53, 116.28, 123.675. The first convolution divides by the sd.
MEAN_RGB = (123.675 / 255, 116.28 / 255, 103.53 / 255)
LEAK = 0.1
LEVEL_CHANNELS = 128

# Score logits [B, classes, rows, columns] and bin logits [B, 44, rows, columns] of one level.
Level = tuple[torch.Tensor, torch.Tensor]


def act(x: torch.Tensor) -> torch.Tensor:
    """Returns the leaky rectifier of the net."""
    return nn.functional.leaky_relu(x, LEAK)


class Conv(nn.Conv2d):
    """A 3 × 3 convolution that keeps the size up to the stride, with the rectifier."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__(inputs, outputs, 3, stride, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return act(super().forward(x))


class Pair(nn.Module):
    """Two convolutions in a row; their outputs are joined, the second one first."""

    def __init__(self, inputs: int, half: int) -> None:
        super().__init__()
        self.first, self.second = Conv(inputs, half), Conv(half, half)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        first = self.first(x)
        return torch.cat([self.second(first), first], 1)


class Stage(nn.Module):
    """A stage of the backbone: an entry, pairs, an exit, and the entry again beside it. It doubles the channels."""

    def __init__(self, channels: int, pairs: int, stride: int) -> None:
        super().__init__()
        half = channels // 2
        self.entry = Conv(channels, channels, stride)
        self.pairs = nn.Sequential(*(Pair(channels, half) for _ in range(pairs)))
        self.exit = Conv(channels, channels)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        entry = self.entry(x)
        return torch.cat([self.exit(self.pairs(entry)), entry], 1)


class Head(nn.Module):
    """The head of one level: a convolution, then the score logits and the bin logits of each cell."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.classes = classes
        self.tower = Conv(LEVEL_CHANNELS, LEVEL_CHANNELS)
        self.out = nn.Conv2d(LEVEL_CHANNELS, classes + 4 * BINS, 1)

    def forward(self, x: torch.Tensor) -> Level:
        tower = self.tower(x)
        # Three digits of bfloat16 are too few for the logits of the bins.
        with torch.autocast(x.device.type, enabled=False):
            return tuple(self.out(tower.float()).split([self.classes, 4 * BINS], 1))


class NanoDet(nn.Module):
    """Maps RGB in 0…1 [B, 3, height, width], sides multiples of 32 px, to the logits of three levels.

    The convolutions come in the order of the ONNX file: the k-th one of `modules()` is `convolution_k` there.
    """

    def __init__(self, classes: int = len(CLASSES)) -> None:
        super().__init__()
        self.classes = classes
        self.register_buffer("mean", torch.tensor(MEAN_RGB).view(1, 3, 1, 1))
        self.stem = Conv(3, 32, 2)
        self.stages = nn.ModuleList([Stage(32, 1, 1), Stage(64, 2, 2), Stage(128, 2, 2), Stage(256, 3, 2)])
        self.lateral = nn.ModuleList(nn.Conv2d(channels, LEVEL_CHANNELS, 1) for channels in (128, 256, 512))
        self.heads = nn.ModuleList(Head(classes) for _ in STRIDES)

    def forward(self, image: torch.Tensor) -> list[Level]:
        x = nn.functional.max_pool2d(self.stem(image - self.mean), 3, 2, 1)
        features = []
        for stage in self.stages:
            x = stage(x)
            features.append(x)
        fine, middle, coarse = (layer(x) for layer, x in zip(self.lateral, features[1:], strict=True))
        middle = middle + _enlarged(coarse)
        fine = fine + _enlarged(middle)
        middle = middle + nn.functional.avg_pool2d(fine, 2)
        coarse = coarse + nn.functional.avg_pool2d(middle, 2)
        return [head(level) for head, level in zip(self.heads, (fine, middle, coarse), strict=True)]

    def convolutions(self) -> list[nn.Conv2d]:
        """Returns all convolutions in the order of the ONNX file."""
        return [module for module in self.modules() if isinstance(module, nn.Conv2d)]


def _enlarged(x: torch.Tensor) -> torch.Tensor:
    return nn.functional.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)


def with_classes(net: NanoDet, classes: int) -> NanoDet:
    """Returns a copy with more classes: the new ones score 0.01 everywhere at first, all others are unchanged."""
    wider = NanoDet(classes)
    state = net.state_dict()
    for k in range(len(STRIDES)):
        for kind in ("weight", "bias"):
            name = f"heads.{k}.out.{kind}"
            old = state[name]
            new = torch.zeros(classes - net.classes, *old.shape[1:])
            if kind == "bias":
                new -= 4.595  # the logit of 0.01
            state[name] = torch.cat([old[: net.classes], new, old[net.classes :]])
    wider.load_state_dict(state)
    return wider
