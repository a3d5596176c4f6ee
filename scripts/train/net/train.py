"""Trains the hourglass: `python -m net.train --run NAME`; goes on from the last checkpoint by itself."""

from __future__ import annotations

import argparse
import json
import math
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import nn

from net.data import Batch, RealCar, Sampler, Shards, read_real
from net.evaluate import evaluate, real_crops, shard_crops
from net.model import INPUT_PX, STRIDE, Deployed, StackedHourglass
from net.start import read_stages, read_weights, start

TARGET_SD_CELLS = 0.6
PROBE_CROPS = 256
CPU_INFO = Path("/proc/cpuinfo")
# About three times as fast where the CPU has instructions for it.
HAS_BF16 = CPU_INFO.exists() and bool({"avx512_bf16", "amx_bf16"} & set(CPU_INFO.read_text().split()))


def targets(points: torch.Tensor, cells: int) -> torch.Tensor:
    """Narrow Gaussian over the cells [B, K, n²], sum 1, around locations [B, K, 2] in input px."""
    cell = (points - (STRIDE - 1) / 2) / STRIDE
    grid = torch.arange(cells, dtype=torch.float32)
    x = -((grid - cell[..., :1]) ** 2) / (2 * TARGET_SD_CELLS**2)
    y = -((grid - cell[..., 1:]) ** 2) / (2 * TARGET_SD_CELLS**2)
    return (y.softmax(-1).unsqueeze(-1) * x.softmax(-1).unsqueeze(-2)).flatten(2)


def input_px(progress: float, largest: int) -> int:
    """Small pictures first: most of what is to be learnt can be learnt at a quarter of the price."""
    return min(largest, 64 if progress < 0.5 else 96 if progress < 0.75 else INPUT_PX)


def shrunk(batch: Batch, size: int) -> Batch:
    """The batch at another input size."""
    if size == INPUT_PX:
        return batch
    image = np.stack([cv2.resize(i, (size, size), interpolation=cv2.INTER_AREA) for i in batch.image])
    return replace(batch, image=image, points=(batch.points + 0.5) * (size / INPUT_PX) - 0.5)


def loss_of(net: nn.Module, batch: Batch) -> tuple[torch.Tensor, dict[str, float]]:
    """Cross-entropy of each stack's heatmaps plus binary cross-entropy of visibility."""
    image = torch.from_numpy(batch.image).permute(0, 3, 1, 2).float().div(255)
    with torch.autocast("cpu", enabled=HAS_BF16):
        heatmaps, visibility = net(image.contiguous(memory_format=torch.channels_last))
    visibility = visibility.float()
    located = torch.from_numpy(batch.located).float()
    target = targets(torch.from_numpy(batch.points), image.shape[-1] // STRIDE)
    count = located.sum().clamp(min=1)
    parts = []
    for logits in heatmaps:
        entropy = -(target * logits.flatten(2).log_softmax(2)).sum(2)
        parts.append((entropy * located).sum() / count)
    judged = torch.from_numpy(batch.judged).float()
    seen = nn.functional.binary_cross_entropy_with_logits(
        visibility, torch.from_numpy(batch.visible).float(), reduction="none"
    )
    visible = (seen * judged).sum() / judged.sum().clamp(min=1)
    loss = sum(parts[:-1], start=torch.tensor(0.0)) * 0.5 + parts[-1] + visible
    return loss, {"heat": float(parts[-1]), "visible": float(visible)}


class Average:
    """Exponential moving average of the weights: what is evaluated and exported."""

    def __init__(self, net: nn.Module, decay: float = 0.998):
        self.decay, self.steps = decay, 0
        self.weights = {k: v.detach().clone() for k, v in net.state_dict().items()}

    def update(self, net: nn.Module) -> None:
        """Takes in the current weights; the first steps count more."""
        self.steps += 1
        keep = min(self.decay, (1 + self.steps) / (10 + self.steps))
        for name, value in net.state_dict().items():
            self.weights[name].lerp_(value.detach(), 1 - keep)


def learning_rate(peak: float, progress: float) -> float:
    """Warm-up over the first 3 %, then a cosine to 2 % of the peak."""
    if progress < 0.03:
        return peak * (0.05 + 0.95 * progress / 0.03)
    fall = (progress - 0.03) / 0.97
    return peak * (0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * min(fall, 1.0))))


def split_real(cars: list[RealCar], held_out: list[str]) -> tuple[list[RealCar], list[RealCar]]:
    """To learn from, and held out by whole image."""
    return [c for c in cars if c.source not in held_out], [c for c in cars if c.source in held_out]


class Training:
    """A net on its way; its checkpoint `last.pt` holds all that the next steps depend on but crops and options."""

    def __init__(self, options: argparse.Namespace):
        self.options = options
        torch.set_num_threads(options.threads)
        torch.manual_seed(options.seed)
        self.folder = options.runs / options.run
        self.folder.mkdir(parents=True, exist_ok=True)
        self.net = StackedHourglass(options.stacks, options.channels).to(memory_format=torch.channels_last)
        self.optimiser = torch.optim.AdamW(self.net.parameters(), lr=options.rate, weight_decay=1e-4)
        self.step, self.spent, self.before = 0, 0.0, []
        state = torch.load(self.folder / "last.pt") if (self.folder / "last.pt").exists() else None
        if state:
            self.net.load_state_dict(state["net"])
            self.optimiser.load_state_dict(state["optimiser"])
            self.step, self.spent, self.before = state["step"], state["spent"], state["stages"][:-1]
            print(f"resuming at step {self.step}, {self.spent / 60:.1f} min")
        elif options.start_from:
            start(self.net, read_weights(options.start_from))
            self.before = read_stages(options.start_from)
        self.average = Average(self.net)
        if state:
            self.average.weights, self.average.steps = state["average"], state["average_steps"]

    def read_crops(self) -> None:
        """Everything that is learnt from, before the first step."""
        options = self.options
        learn, self.held_out = split_real(read_real(options.real) if options.real else [], options.hold_out)
        self.shards = Shards(options.crops / "train")
        if not len(self.shards):
            raise SystemExit(f"no crops in {options.crops / 'train'}: make them with python -m render.crops")
        augment = not options.no_augmentation
        self.sampler = Sampler(
            self.shards, learn, options.batch, options.real_share, options.seed, self.step, augment
        )
        print(f"{len(self.shards)} rendered crops, {len(learn)} real cars, {len(self.held_out)} held out")
        recipe = {name: str(value) for name, value in vars(options).items()}
        (self.folder / "recipe.json").write_text(json.dumps(recipe, indent=1))
        self.started = time.time()

    def seconds(self) -> float:
        """Wall time so far, that of earlier calls included."""
        return self.spent + time.time() - self.started

    def size(self) -> int:
        """Picture size of the next step, px."""
        largest = self.options.input_px
        return largest if self.options.start_from else input_px(self.step / self.options.steps, largest)

    def advance(self) -> dict[str, float]:
        """One step; the parts of its loss."""
        for group in self.optimiser.param_groups:
            group["lr"] = learning_rate(self.options.rate, self.step / self.options.steps)
        loss, parts = loss_of(self.net, shrunk(self.sampler.next(), self.size()))
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        if math.isfinite(float(loss)):
            self.optimiser.step()
            self.average.update(self.net)
        self.step += 1
        return parts

    def stage(self) -> dict:
        """What the card says of this training."""
        options = self.options
        return {
            "run": options.run,
            "steps": self.step,
            "batch": options.batch,
            "rate": options.rate,
            "seed": options.seed,
            "channels": options.channels,
            "px": options.input_px if options.start_from else f"64 → {options.input_px}",
            "minutes": round(self.seconds() / 60, 1),
        }

    def save(self) -> None:
        """Writes the checkpoint, whole or not at all."""
        state = {
            "net": self.net.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "average": self.average.weights,
            "average_steps": self.average.steps,
            "step": self.step,
            "spent": self.seconds(),
            "stages": [*self.before, self.stage()],
            "stacks": self.options.stacks,
            "channels": self.options.channels,
            "shards": len(self.shards),
            "input_px": self.size(),
        }
        torch.save(state, self.folder / "last.tmp")
        (self.folder / "last.tmp").rename(self.folder / "last.pt")

    def probe(self, check: Shards) -> None:
        """Prints how good the averaged weights are by now."""
        net = StackedHourglass(self.options.stacks, self.options.channels)
        net.load_state_dict(self.average.weights)
        deployed = Deployed(net, self.size()).eval()
        for name, crops in (("rendered", shard_crops(check, PROBE_CROPS)), ("real held out", real_crops(self.held_out))):
            if crops:
                print(f"  {name}: {evaluate(deployed, crops).line()}", flush=True)


def parse_options(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--crops", type=Path, default=Path(".work/crops"))
    parser.add_argument("--real", type=Path, help="folder of hand-labelled cars (*.json and pictures)")
    parser.add_argument(
        "--hold-out", nargs="*", default=["pklot_ufpr04", "cnd5"], help="real images not learnt from"
    )
    parser.add_argument("--real-share", type=float, default=0.12)
    parser.add_argument("--run", default="hourglass")
    parser.add_argument("--runs", type=Path, default=Path(".work/runs"))
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--batch", type=int, default=32)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--stacks", type=int, default=2)
    parser.add_argument("--channels", type=int, default=64)
    parser.add_argument("--input-px", type=int, default=INPUT_PX, help="largest picture size to train at")
    parser.add_argument("--no-augmentation", action="store_true", help="rendered crops as they are (ablation)")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--start-from",
        type=Path,
        help="checkpoint or .onnx file, perhaps of fewer channels, to train on from at the largest size throughout",
    )
    return parser.parse_args(arguments)


def main() -> None:
    """Trains for the given number of steps, spread over as many calls as it takes."""
    training = Training(parse_options())
    options = training.options
    if training.step >= options.steps:
        print("finished before")
        return
    training.read_crops()
    check = Shards(options.crops / "eval", limit=PROBE_CROPS)
    saved, shown = time.time(), time.time()
    sums = {"heat": 0.0, "visible": 0.0, "n": 0}
    while training.step < options.steps:
        size = training.size()
        for key, value in training.advance().items():
            sums[key] += value
        sums["n"] += 1
        if time.time() - shown > 60:
            n = sums["n"]
            print(
                f"{training.seconds() / 60:.1f} min step {training.step}: heat {sums['heat'] / n:.3f} "
                f"visible {sums['visible'] / n:.3f} {n * options.batch / (time.time() - shown):.0f} crops/s "
                f"at {size} px",
                flush=True,
            )
            sums, shown = {"heat": 0.0, "visible": 0.0, "n": 0}, time.time()
        if time.time() - saved > 300:
            training.save()
            training.probe(check)
            saved = time.time()
    training.save()
    print(f"done: {training.step} steps of {options.batch} crops")


if __name__ == "__main__":
    np.seterr(all="raise", under="ignore")
    main()
