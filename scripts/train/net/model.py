"""A stacked hourglass for 36 car keypoints: heatmap logits and visibility, at 128 px input.

It has no batch normalisation: residual branches start small instead (SkipInit), which is half as fast again on a CPU.
"""

from __future__ import annotations

import torch
from torch import nn

KEYPOINTS = 36
INPUT_PX = 128
CELLS = 32
STRIDE = INPUT_PX // CELLS


def conv(inputs: int, outputs: int, kernel: int, stride: int = 1) -> nn.Conv2d:
    """Returns a convolution that keeps the size (up to the stride), He-initialised."""
    return _initialised(nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2))


def _initialised(layer: nn.Conv2d) -> nn.Conv2d:
    nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
    nn.init.zeros_(layer.bias)
    return layer


class Residual(nn.Module):
    """x + g · branch(x), with g starting at a tenth."""

    def __init__(self, channels: int, middle: int | None = None) -> None:
        super().__init__()
        if middle is None:
            layers = [nn.ReLU(), conv(channels, channels, 3), nn.ReLU(), conv(channels, channels, 3)]
        else:
            layers = [nn.ReLU(), conv(channels, middle, 1), nn.ReLU(), conv(middle, middle, 3)]
            layers += [nn.ReLU(), conv(middle, channels, 1)]
        self.branch = nn.Sequential(*layers)
        self.gain = nn.Parameter(torch.tensor(0.1))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x + self.gain * self.branch(x)


class Halving(nn.Conv2d):
    """Halves the size: a convolution with stride, plus two for finer edges before it, which start at zero."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(inputs, outputs, 3, 2, 1)
        _initialised(self)
        self.fine = nn.Sequential(conv(inputs, outputs // 2, 3), nn.ReLU(), conv(outputs // 2, outputs, 3, 2))
        nn.init.zeros_(self.fine[-1].weight)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return super().forward(x) + self.fine(x)


class Hourglass(nn.Module):
    """Reduces to 4 × 4 and enlarges again, with a skip at each size (Newell et al. 2016)."""

    def __init__(self, channels: int, depth: int, outermost: bool = True) -> None:
        super().__init__()
        self.skip = Residual(channels, channels // 2) if outermost else nn.Identity()
        self.down = Residual(channels)
        self.inner = Hourglass(channels, depth - 1, False) if depth > 1 else Residual(channels)
        self.up = Residual(channels)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        low = self.up(self.inner(self.down(nn.functional.max_pool2d(x, 2))))
        return self.skip(x) + nn.functional.interpolate(low, scale_factor=2.0, mode="nearest")


class StackedHourglass(nn.Module):
    """Maps [B, 3, n, n] RGB in 0…1 to heatmap logits [B, 36, n/4, n/4] per stack, and visibility logits [B, 36].

    n = 128, or any multiple of 32 while training.
    """

    def __init__(self, stacks: int = 2, channels: int = 64) -> None:
        super().__init__()
        # Pixels of 2 × 2 blocks become channels first, as a CPU is slow at convolutions of 3 channels.
        self.stem = nn.Sequential(
            nn.PixelUnshuffle(2),
            Halving(12, channels),
            Residual(channels),
            Residual(channels, channels // 2),
        )
        self.hourglasses = nn.ModuleList(Hourglass(channels, 3) for _ in range(stacks))
        self.features = nn.ModuleList(
            nn.Sequential(Residual(channels, channels // 2), nn.ReLU(), conv(channels, channels, 1), nn.ReLU())
            for _ in range(stacks)
        )
        self.heads = nn.ModuleList(nn.Conv2d(channels, KEYPOINTS, 1) for _ in range(stacks))
        self.back = nn.ModuleList(nn.Conv2d(channels + KEYPOINTS, channels, 1) for _ in range(stacks - 1))
        # Visibility reads the features at the keypoint, and the whole crop.
        self.visible_here = nn.Parameter(torch.zeros(KEYPOINTS, channels))
        self.visible_overall = nn.Linear(channels, KEYPOINTS)

    def forward(self, image: torch.Tensor) -> tuple[list[torch.Tensor], torch.Tensor]:
        x = self.stem((image - 0.45) * 4.0)
        heatmaps = []
        features = x
        for i, hourglass in enumerate(self.hourglasses):
            features = self.features[i](hourglass(x))
            with torch.autocast(features.device.type, enabled=False):  # logits range over tens of units: too coarse in bfloat16
                logits = self.heads[i](features.float())
            heatmaps.append(logits)
            if i < len(self.back):
                # Logits range over tens of units: they are squashed before they mix with features.
                x = x + self.back[i](torch.cat([features, torch.tanh(logits * 0.2)], 1))
        where = heatmaps[-1].flatten(2).softmax(2)
        here = torch.matmul(where, features.flatten(2).transpose(1, 2))
        visibility = (here * self.visible_here).sum(2) + self.visible_overall(features.mean((2, 3)))
        return heatmaps, visibility


class Deployed(nn.Module):
    """The exported net: the last stack's heatmap logits and the visibility as a probability, at 128 px input.

    A net trained at `work_px` < 128 gets the picture reduced to that size; its logits are enlarged to 32 × 32.
    """

    def __init__(self, net: StackedHourglass, work_px: int = INPUT_PX) -> None:
        super().__init__()
        self.net, self.work_px = net, work_px

    def forward(self, image: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        if self.work_px == INPUT_PX:
            heatmaps, visibility = self.net(image)
            return heatmaps[-1], visibility.sigmoid()
        size = (self.work_px, self.work_px)
        image = nn.functional.interpolate(image, size, mode="bilinear", align_corners=False)
        heatmaps, visibility = self.net(image)
        whole = nn.functional.interpolate(heatmaps[-1], (CELLS, CELLS), mode="bilinear", align_corners=False)
        return whole, visibility.sigmoid()


def gflop(net: nn.Module) -> float:
    """Returns the floating-point operations (a multiply-add counts two) of the convolutions on one crop, 10⁹."""
    count = 0

    def add(layer: nn.Conv2d, _: tuple, out: torch.Tensor) -> None:
        nonlocal count
        count += 2 * layer.weight.numel() * out.shape[2] * out.shape[3]

    hooks = [m.register_forward_hook(add) for m in net.modules() if isinstance(m, nn.Conv2d)]
    with torch.no_grad():
        net(torch.zeros(1, 3, INPUT_PX, INPUT_PX))
    for hook in hooks:
        hook.remove()
    return count / 1e9
