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

TARGET_SD_CELLS = 0.6


def targets(points: torch.Tensor, cells: int) -> torch.Tensor:
    """Narrow Gaussian over the cells [B, K, n²], sum 1, around locations [B, K, 2] in input px."""
    cell = (points - (STRIDE - 1) / 2) / STRIDE
    grid = torch.arange(cells, dtype=torch.float32)
    x = -((grid - cell[..., :1]) ** 2) / (2 * TARGET_SD_CELLS**2)
    y = -((grid - cell[..., 1:]) ** 2) / (2 * TARGET_SD_CELLS**2)
    return (y.softmax(-1).unsqueeze(-1) * x.softmax(-1).unsqueeze(-2)).flatten(2)


def input_px(progress: float, fine_tuning: bool) -> int:
    """Small pictures first: most of what is to be learnt can be learnt at a quarter of the price."""
    if fine_tuning:
        return INPUT_PX
    return 64 if progress < 0.35 else 96 if progress < 0.6 else INPUT_PX


def shrunk(batch: Batch, size: int) -> Batch:
    """The batch at another input size."""
    if size == INPUT_PX:
        return batch
    image = np.stack([cv2.resize(i, (size, size), interpolation=cv2.INTER_AREA) for i in batch.image])
    return replace(batch, image=image, points=(batch.points + 0.5) * (size / INPUT_PX) - 0.5)


def loss_of(net: nn.Module, batch: Batch) -> tuple[torch.Tensor, dict[str, float]]:
    """Cross-entropy of each stack's heatmaps plus binary cross-entropy of visibility."""
    image = torch.from_numpy(batch.image).permute(0, 3, 1, 2).float().div(255)
    heatmaps, visibility = net(image.contiguous(memory_format=torch.channels_last))
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


def main() -> None:
    """Trains for the given minutes of wall time, spread over as many calls as it takes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--crops", type=Path, default=Path(".work/crops"))
    parser.add_argument("--real", type=Path, help="folder of hand-labelled cars (*.json and pictures)")
    parser.add_argument(
        "--hold-out", nargs="*", default=["pklot_ufpr04", "cnd5"], help="real images not learnt from"
    )
    parser.add_argument("--real-share", type=float, default=0.12)
    parser.add_argument("--run", default="hourglass")
    parser.add_argument("--runs", type=Path, default=Path(".work/runs"))
    parser.add_argument("--minutes", type=float, default=75)
    parser.add_argument("--batch", type=int, default=32)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--stacks", type=int, default=2)
    parser.add_argument("--channels", type=int, default=48)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--start-from", type=Path, help="weights to start from: fine-tuning, all of it at full size")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    folder = args.runs / args.run
    folder.mkdir(parents=True, exist_ok=True)
    fine_tuning = args.start_from is not None
    net = StackedHourglass(args.stacks, args.channels).to(memory_format=torch.channels_last)
    optimiser = torch.optim.AdamW(net.parameters(), lr=args.rate, weight_decay=1e-4)
    average, step, spent, samples = Average(net), 0, 0.0, 0
    last = folder / "last.pt"
    if last.exists():
        state = torch.load(last)
        net.load_state_dict(state["net"])
        optimiser.load_state_dict(state["optimiser"])
        average.weights, average.steps = state["average"], state["step"]
        step, spent, samples = state["step"], state["spent"], state["samples"]
        print(f"resuming at step {step}, {spent / 60:.1f} min")
    elif args.start_from:
        net.load_state_dict(torch.load(args.start_from)["average"])
        average = Average(net)
    learn, held = split_real(read_real(args.real) if args.real else [], args.hold_out)
    shards = Shards(args.crops / "train")
    sampler = Sampler(shards, learn, args.batch, args.real_share, args.seed + step)
    check = Shards(args.crops / "eval", limit=512)
    print(f"{len(shards)} rendered crops, {len(learn)} real cars, {len(held)} held out")
    (folder / "recipe.json").write_text(json.dumps({k: str(v) for k, v in vars(args).items()}, indent=1))

    started, saved, shown = time.time(), time.time(), time.time()
    sums = {"heat": 0.0, "visible": 0.0, "n": 0}

    def save() -> None:
        state = {
            "net": net.state_dict(),
            "optimiser": optimiser.state_dict(),
            "average": average.weights,
            "step": step,
            "spent": spent + time.time() - started,
            "samples": samples,
            "stacks": args.stacks,
            "channels": args.channels,
            "shards": len(shards),
            "input_px": input_px(min(1.0, (spent + time.time() - started) / (args.minutes * 60)), fine_tuning),
        }
        torch.save(state, folder / "last.tmp")
        (folder / "last.tmp").rename(last)

    while (elapsed := spent + time.time() - started) < args.minutes * 60:
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(args.rate, elapsed / (args.minutes * 60))
        size = input_px(elapsed / (args.minutes * 60), fine_tuning)
        loss, parts = loss_of(net, shrunk(sampler.next(), size))
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        if math.isfinite(float(loss)):
            optimiser.step()
            average.update(net)
        step, samples = step + 1, samples + args.batch
        for key, value in parts.items():
            sums[key] += value
        sums["n"] += 1
        if time.time() - shown > 60:
            n = sums["n"]
            rate = n * args.batch / (time.time() - shown)
            print(
                f"{elapsed / 60:.1f} min step {step}: heat {sums['heat'] / n:.3f} "
                f"visible {sums['visible'] / n:.3f} {rate:.0f} crops/s at {size} px, {len(shards)} rendered",
                flush=True,
            )
            sums, shown = {"heat": 0.0, "visible": 0.0, "n": 0}, time.time()
            shards.rescan()
        if time.time() - saved > 300:
            save()
            saved = time.time()
            probe = StackedHourglass(args.stacks, args.channels)
            probe.load_state_dict(average.weights)
            probe_net = Deployed(probe, size).eval()
            if len(check) < 512:
                check.rescan()
            for name, crops in (("rendered", shard_crops(check, 256)), ("real held out", real_crops(held))):
                if crops:
                    print(f"  {name}: {evaluate(probe_net, crops).line()}", flush=True)
    save()
    print(f"done: {step} steps, {samples} samples")


if __name__ == "__main__":
    np.seterr(all="raise", under="ignore")
    main()
