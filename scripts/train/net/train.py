"""Trains the hourglass, and resumes from the last checkpoint.

roadplane-train net train --run NAME
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import distributed, multiprocessing, nn

from roadplane_train.batches import prepared
from roadplane_train.net.data import Batch, RealCar, Sampler, Shards, read_real
from roadplane_train.net.evaluate import evaluate, real_crops, shard_crops
from roadplane_train.net.loss import loss_of
from roadplane_train.net.model import INPUT_PX, Deployed, StackedHourglass
from roadplane_train.net.start import read_stages, read_weights, start

PROBE_CROPS = 256


def input_px(progress: float, largest: int) -> int:
    """Returns the input size of a step: small pictures first, as training on them costs a quarter and gains most."""
    return min(largest, 64 if progress < 0.5 else 96 if progress < 0.75 else INPUT_PX)


def shrunk(batch: Batch, size: int) -> Batch:
    """Returns the batch at another input size."""
    if size == INPUT_PX:
        return batch
    image = batch.image.permute(0, 3, 1, 2).float()
    image = nn.functional.interpolate(image, (size, size), mode="bilinear", antialias=True)
    return replace(batch, image=image.permute(0, 2, 3, 1), points=(batch.points + 0.5) * (size / INPUT_PX) - 0.5)


class Average:
    """The exponential moving average of the weights, which is evaluated and exported."""

    def __init__(self, net: nn.Module, decay: float = 0.998) -> None:
        self.decay, self.steps = decay, 0
        self.weights = {k: v.detach().clone() for k, v in net.state_dict().items()}

    def update(self, net: nn.Module) -> None:
        """Adds the current weights; the first steps count more."""
        self.steps += 1
        keep = min(self.decay, (1 + self.steps) / (10 + self.steps))
        for name, value in net.state_dict().items():
            self.weights[name].lerp_(value.detach(), 1 - keep)


def learning_rate(peak: float, progress: float) -> float:
    """Returns the rate of a step: warm-up over the first 3 %, then a cosine to 2 % of the peak."""
    if progress < 0.03:
        return peak * (0.05 + 0.95 * progress / 0.03)
    fall = (progress - 0.03) / 0.97
    return peak * (0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * min(fall, 1.0))))


def split_real(cars: list[RealCar], held_out: list[str]) -> tuple[list[RealCar], list[RealCar]]:
    """Splits real cars into those to train on and those held out, by whole image."""
    return [c for c in cars if c.source not in held_out], [c for c in cars if c.source in held_out]


def average_gradients(net: nn.Module) -> None:
    """Averages over all workers; the result has the same bits in each."""
    gradients = [parameter.grad for parameter in net.parameters()]
    flat = torch.cat([gradient.flatten() for gradient in gradients])
    distributed.all_reduce(flat)
    flat /= distributed.get_world_size()
    for gradient, part in zip(gradients, flat.split([g.numel() for g in gradients]), strict=True):
        gradient.copy_(part.view_as(gradient))


class Training:
    """The state of a training.

    Its checkpoint `last.pt` holds all that the next steps depend on, except crops and options.
    """

    def __init__(self, options: argparse.Namespace, worker: int = 0) -> None:
        self.options, self.worker = options, worker
        torch.set_num_threads(1)
        torch.manual_seed(options.seed)
        self.folder = options.runs / options.run
        self.folder.mkdir(parents=True, exist_ok=True)
        self.device = torch.device(options.device)
        self.net = StackedHourglass(options.stacks, options.channels)
        self.step, self.spent, self.before = 0, 0.0, []
        state = torch.load(self.folder / "last.pt", map_location=self.device) if (self.folder / "last.pt").exists() else None
        if state:
            self.net.load_state_dict(state["net"])
            self.step, self.spent, self.before = state["step"], state["spent"], state["stages"][:-1]
            if not worker:
                print(f"resuming at step {self.step}, {self.spent / 60:.1f} min")
        elif options.start_from:
            start(self.net, read_weights(options.start_from))
            self.before = read_stages(options.start_from)
        self.net.to(self.device, memory_format=torch.channels_last)
        self.optimiser = torch.optim.AdamW(self.net.parameters(), lr=options.rate, weight_decay=1e-4)
        self.average = Average(self.net)
        if state:
            self.optimiser.load_state_dict(state["optimiser"])
            self.average.weights, self.average.steps = state["average"], state["average_steps"]

    def read_crops(self) -> None:
        """Reads all training data, before the first step."""
        options = self.options
        learn, self.held_out = split_real(read_real(options.real) if options.real else [], options.hold_out)
        self.shards = Shards(options.crops / "train")
        if not len(self.shards):
            raise SystemExit(f"no crops in {options.crops / 'train'}: make them with roadplane-train render crops")
        sampler = Sampler(
            self.shards,
            learn,
            options.batch // options.workers,
            options.real_share,
            [options.seed, self.worker],
            not options.no_augmentation,
        )
        self.batches = prepared(sampler, range(self.step, options.steps), options.jobs)
        if not self.worker:
            print(f"{len(self.shards)} rendered crops, {len(learn)} real cars, {len(self.held_out)} held out")
            recipe = {name: str(value) for name, value in vars(options).items()}
            (self.folder / "recipe.json").write_text(json.dumps(recipe, indent=1))
        self.started = time.time()

    def seconds(self) -> float:
        """Returns the wall time so far, including earlier calls."""
        return self.spent + time.time() - self.started

    def size(self) -> int:
        """Returns the picture size of the next step, px."""
        largest = self.options.input_px
        return largest if self.options.start_from else input_px(self.step / self.options.steps, largest)

    def advance(self) -> dict[str, float]:
        """Trains one step and returns the parts of its loss."""
        for group in self.optimiser.param_groups:
            group["lr"] = learning_rate(self.options.rate, self.step / self.options.steps)
        loss, parts = loss_of(self.net, shrunk(next(self.batches).to(self.device), self.size()))
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        if distributed.is_initialized():
            average_gradients(self.net)
        if math.isfinite(float(nn.utils.clip_grad_norm_(self.net.parameters(), 5.0))):
            self.optimiser.step()
            self.average.update(self.net)
        self.step += 1
        return parts

    def stage(self) -> dict:
        """Returns the card's record of this training."""
        options = self.options
        return {
            "run": options.run,
            "steps": self.step,
            "batch": options.batch,
            "rate": options.rate,
            "seed": options.seed,
            "stacks": options.stacks,
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
        """Prints the evaluation of the averaged weights."""
        net = StackedHourglass(self.options.stacks, self.options.channels)
        net.load_state_dict(self.average.weights)
        deployed = Deployed(net, self.size()).eval()
        for name, crops in (("rendered", shard_crops(check, PROBE_CROPS)), ("real held out", real_crops(self.held_out))):
            if crops:
                print(f"  {name}: {evaluate(deployed, crops).line()}", flush=True)


def parse_options(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--crops", type=Path, default=Path(".work/crops"))
    parser.add_argument("--real", type=Path, help="folder of hand-labelled cars (*.json and pictures)")
    parser.add_argument("--hold-out", nargs="*", default=["pklot_ufpr04", "cnd5"], help="real images to hold out (file stems)")
    parser.add_argument("--real-share", type=float, default=0.12)
    parser.add_argument("--run", default="hourglass")
    parser.add_argument("--runs", type=Path, default=Path(".work/runs"))
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--batch", type=int, default=32)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--stacks", type=int, default=2)
    parser.add_argument("--channels", type=int, default=64)
    parser.add_argument("--input-px", type=int, default=INPUT_PX, help="largest picture size to train at")
    parser.add_argument("--no-augmentation", action="store_true", help="uses rendered crops unchanged (ablation)")
    parser.add_argument("--device", default="cpu", help="cpu or cuda")
    parser.add_argument("--jobs", type=int, default=0, help="processes that prepare batches (0: one thread)")
    parser.add_argument("--workers", type=int, default=1, help="processes that share each batch, one thread each")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--start-from",
        type=Path,
        help="checkpoint or .onnx file, perhaps of fewer channels or stacks, to train on from at the largest size throughout",
    )
    options = parser.parse_args(arguments)
    if options.batch % options.workers:
        parser.error("--batch must be a multiple of --workers")
    if options.workers > 1 and (options.jobs or options.device != "cpu"):
        parser.error("--workers is for the CPU, and excludes --jobs")
    return options


def train(options: argparse.Namespace, worker: int) -> None:
    """Trains for the given number of steps; the first worker also reports and writes checkpoints."""
    np.seterr(all="raise", under="ignore")
    training = Training(options, worker)
    if training.step >= options.steps:
        if not worker:
            print("finished earlier")
        return
    training.read_crops()
    if options.workers > 1:
        meeting = (training.folder / "meeting").resolve()
        distributed.init_process_group("gloo", init_method=f"file://{meeting}", rank=worker, world_size=options.workers)
    if worker > 0:
        while training.step < options.steps:
            training.advance()
        return
    check = Shards(options.crops / "eval", limit=PROBE_CROPS)
    saved, shown = time.time(), time.time()
    sums: Counter[str] = Counter()
    while training.step < options.steps:
        size = training.size()
        sums.update(training.advance(), n=1)
        if time.time() - shown > 60:
            n = sums["n"]
            print(
                f"{training.seconds() / 60:.1f} min step {training.step}: heat {sums['heat'] / n:.3f} "
                f"off {sums['off'] / n:.3f} px visible {sums['visible'] / n:.3f} "
                f"{n * options.batch / (time.time() - shown):.0f} crops/s at {size} px",
                flush=True,
            )
            sums, shown = Counter(), time.time()
        if time.time() - saved > 300:
            training.save()
            training.probe(check)
            saved = time.time()
    training.save()
    print(f"done: {training.step} steps of {options.batch} crops")


def main() -> None:
    """Trains, resuming earlier calls."""
    options = parse_options()
    # The workers would wait for ever for a file of an earlier call.
    (options.runs / options.run / "meeting").unlink(missing_ok=True)
    spawn = multiprocessing.get_context("spawn")
    for worker in range(1, options.workers):
        spawn.Process(target=train, args=(options, worker), daemon=True).start()
    train(options, 0)


if __name__ == "__main__":
    main()
