"""Fine-tunes the detector, and resumes from the last checkpoint.

  roadplane-train detect train --preset small|full [--run NAME]

It writes checkpoints and the averaged net, `net.onnx`, into the folder of the run.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import time
from collections import Counter
from pathlib import Path

import numpy as np
import torch
from torch import nn

from roadplane_train.batches import fast, prepared
from roadplane_train.cars.mesh import REPOSITORY
from roadplane_train.detect.boxes import cells_of, detections, flat
from roadplane_train.detect.data import Batch, Lesson, Sampler, whole_pictures
from roadplane_train.detect.loss import Losses, losses_of
from roadplane_train.detect.metrics import Judged
from roadplane_train.detect.model import CLASSES, INPUT_PX, NanoDet, with_classes
from roadplane_train.detect.onnx_file import ORIGINAL, read_net, write_net
from roadplane_train.detect.pictures import Picture, empty_pictures, labelled_pictures, rendered_pictures, with_mistakes
from roadplane_train.net.train import Average, learning_rate

WORK = REPOSITORY / ".runtime/detect"
PRESETS = {
    # A check of the code on pictures of the repository. They are for evaluation, so its net is never used.
    "small": {
        "rendered": [REPOSITORY / "tests/data/lots/scenes"],
        "real": None,
        "empty": None,
        "shapes": None,
        "mistakes": None,
        "steps": 40,
        "batch": 8,
        "run": "small",
        "hold_out": 5,
    },
    "full": {
        "rendered": [WORK / "rendered"],
        "real": REPOSITORY.parent / "shared/data/detect/train.jsonl",
        "empty": WORK / "empty/learn",
        "shapes": WORK / "shapes",
        "mistakes": WORK / "mistakes.json",
        "steps": 10_000,
        "batch": 16,
        "run": "full",
        "hold_out": 25,
    },
}
# Where all kinds are present. Without renderings of lorries and buses, only real pictures have them.
SHARES = {"rendered": 0.5, "real": 0.35, "empty": 0.08, "shapes": 0.07}
LONGEST_GRADIENT = 10.0
CHECKPOINT_S, LINE_S = 240.0, 30.0
PROBE_PICTURES = 24
CLIP_FRAME = re.compile(r"(?<=_\d{4})_\d{5}\.jpg$")  # end of the names that `detect frames` gives
PROBE_PX = 640  # about the smallest size at which the product sees a picture


def split(pictures: list[Picture], every: int) -> tuple[list[Picture], list[Picture]]:
    """Splits pictures into those to learn from and every n-th one, held out to watch the training.

    Frames of a clip count as one picture.
    """
    scenes: dict[str, int] = {}
    numbers = [scenes.setdefault(CLIP_FRAME.sub("", str(p.path)), len(scenes)) for p in pictures]
    learn = [p for p, k in zip(pictures, numbers, strict=True) if k % every]
    return learn, [p for p, k in zip(pictures, numbers, strict=True) if k % every == 0]


def pictures_of(options: argparse.Namespace) -> dict[str, list[Picture]]:
    """Returns the pictures of each kind, held-out ones too; a kind whose folder is missing has none."""
    rendered = [picture for folder in options.rendered for picture in rendered_pictures(folder)]
    real = labelled_pictures(options.real) if options.real and options.real.exists() else []
    empty, shapes = (empty_pictures(f) if f and f.exists() else [] for f in (options.empty, options.shapes))
    return {"rendered": rendered, "real": real, "empty": empty, "shapes": shapes}


def averaged_net(checkpoint: Path) -> NanoDet:
    """Returns the net with the averaged weights of a checkpoint."""
    state = torch.load(checkpoint)
    net = NanoDet(state["classes"])
    net.load_state_dict(state["average"])
    return net


class Training:
    """The state of a training.

    Its checkpoint `last.pt` holds all that the next steps depend on, except pictures and options.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        torch.set_num_threads(options.threads)
        np.finfo(np.float32), np.finfo(np.float64)  # computed once, as NumPy warns where subnormals are zero
        torch.set_flush_denormal(True)  # else steps take many times as long
        torch.manual_seed(options.seed)
        self.device = torch.device(options.device)
        self.folder = options.runs / options.run
        self.folder.mkdir(parents=True, exist_ok=True)
        net = read_net(options.start_from)
        self.net = with_classes(net, max(net.classes, len(CLASSES))).to(self.device, memory_format=torch.channels_last)
        self.original = read_net().to(self.device, memory_format=torch.channels_last)
        self.optimiser = torch.optim.AdamW(self.net.parameters(), lr=options.rate, weight_decay=options.decay)
        self.average = Average(self.net)
        self.step, self.spent = 0, 0.0
        if (self.folder / "last.pt").exists():
            state = torch.load(self.folder / "last.pt", map_location=self.device)
            if state["classes"] != self.net.classes:
                raise SystemExit(f"the run {options.run} has {state['classes']} classes: choose another --run")
            self.net.load_state_dict(state["net"])
            self.optimiser.load_state_dict(state["optimiser"])
            self.average.weights, self.average.steps = state["average"], state["average_steps"]
            self.step, self.spent = state["step"], state["spent"]
            print(f"resuming at step {self.step}, {self.spent / 60:.1f} min")
        self.cells = cells_of(options.input_px, options.input_px).to(self.device)
        self.started = time.time()

    def read_pictures(self) -> None:
        """Finds all training pictures, before the first step."""
        options = self.options
        kinds = {}
        self.held_out: dict[str, list[Batch]] = {}
        for name, pictures in pictures_of(options).items():
            learn, held_out = split(pictures, options.hold_out)
            kinds[name] = with_mistakes(learn, options.mistakes)
            print(f"{name}: {len(kinds[name])} pictures, {len(held_out)} held out")
            if any(kind >= 0 for picture in held_out for kind in picture.classes):
                self.held_out[name] = whole_pictures(held_out[:PROBE_PICTURES], PROBE_PX)
        sampler = Sampler(list(kinds.values()), list(SHARES.values()), options.batch, options.seed, options.input_px)
        self.lessons = prepared(sampler, range(self.step, options.steps), options.jobs)
        recipe = {name: str(value) for name, value in vars(options).items()}
        (self.folder / "recipe.json").write_text(json.dumps(recipe, indent=1))
        self.started = time.time()

    def seconds(self) -> float:
        """Returns the wall time so far, including earlier calls."""
        return self.spent + time.time() - self.started

    def losses(self, lesson: Lesson) -> Losses:
        """Returns the losses of a lesson."""
        image, real = lesson.input(self.device), lesson.real.to(self.device)
        hold = self.options.hold if bool(lesson.real.any()) else 0.0
        original = None
        with fast(self.device):
            logits, bins = flat(self.net(image))
            if hold > 0:
                with torch.no_grad():
                    original = torch.zeros_like(logits[..., : self.original.classes])
                    original[real] = flat(self.original(image[real]))[0]
        return losses_of(logits, bins, self.cells, lesson.targets.to(self.device), original, real, hold)

    def advance(self) -> dict[str, float]:
        """Trains one step and returns the parts of its loss."""
        for group in self.optimiser.param_groups:
            group["lr"] = learning_rate(self.options.rate, self.step / self.options.steps)
        losses = self.losses(next(self.lessons))
        self.optimiser.zero_grad(set_to_none=True)
        losses.total().backward()
        if math.isfinite(float(nn.utils.clip_grad_norm_(self.net.parameters(), LONGEST_GRADIENT))):
            self.optimiser.step()
            self.average.update(self.net)
        self.step += 1
        return losses.parts()

    def averaged(self) -> NanoDet:
        """Returns the net with the averaged weights, on the CPU."""
        net = NanoDet(self.net.classes)
        net.load_state_dict(self.average.weights)
        return net.to(memory_format=torch.channels_last)

    def save(self) -> None:
        """Writes the checkpoint, whole or not at all, and the averaged net."""
        state = {
            "net": self.net.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "average": self.average.weights,
            "average_steps": self.average.steps,
            "step": self.step,
            "spent": self.seconds(),
            "classes": self.net.classes,
        }
        torch.save(state, self.folder / "last.tmp")
        (self.folder / "last.tmp").rename(self.folder / "last.pt")
        write_net(self.averaged(), self.folder / "net.onnx", half=True)

    def probe(self) -> None:
        """Prints the figures of the averaged net on pictures that are held out."""
        net = self.averaged().to(self.device)
        for name, batches in self.held_out.items():
            figures = " ".join(f"{figure} {value:.1f}" for figure, value in probe(net, batches).items())
            print(f"  held out, {name}: {figures}", flush=True)


def found_in(net: NanoDet, batch: Batch, least: float = 0.05) -> np.ndarray:
    """Returns the boxes [n, 6] that the net finds in a batch of one picture, as `detections` does."""
    device = net.mean.device
    with torch.no_grad(), fast(device):
        levels = net(batch.input(device))
    (rows,) = detections([(scores.cpu(), bins.cpu()) for scores, bins in levels], least)
    return rows.numpy().astype(float)


def probe(net: NanoDet, batches: list[Batch]) -> dict[str, float]:
    """Returns average precisions on whole pictures, %.

    AP50 and AP70 take all vehicles as one class. The others are AP50 of one class each, if it occurs.
    """
    judged = {"AP50": Judged(0.5), "AP70": Judged(0.7)}
    of_class = {name: Judged(0.5) for name in CLASSES}
    for batch in batches:
        found, true, classes = found_in(net, batch), batch.boxes[0].numpy(), batch.classes[0].numpy()
        ignored = batch.ignored[0].numpy()
        for each in judged.values():
            each.add(found, true, ignored)
        for number, each in enumerate(of_class.values()):
            each.add(found[found[:, 5] == number], true[classes == number], ignored)
    present = judged | {name: each for name, each in of_class.items() if each.vehicles}
    return {name: each.average_precision() for name, each in present.items()}


def parse_options(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parses the command line; a preset gives the defaults."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", choices=PRESETS, default="small")
    parser.add_argument("--run", help="name of the run")
    parser.add_argument("--runs", type=Path, default=WORK / "runs")
    parser.add_argument("--rendered", type=Path, nargs="*", help="folders of `roadplane-train render dataset`")
    parser.add_argument("--real", type=Path, help="train.jsonl of real pictures, if it exists")
    parser.add_argument("--empty", type=Path, help="folder of photographs without vehicles, if it exists")
    parser.add_argument("--shapes", type=Path, help="folder of `detect shapes`, if it exists")
    parser.add_argument("--mistakes", type=Path, help="file of `detect mistakes`, if it exists")
    parser.add_argument("--hold-out", type=int, help="every n-th picture is held out")
    parser.add_argument("--steps", type=int)
    parser.add_argument("--batch", type=int)
    parser.add_argument("--rate", type=float, default=2e-4, help="highest learning rate")
    parser.add_argument("--decay", type=float, default=0.01, help="weight decay")
    parser.add_argument("--hold", type=float, default=1.0, help="weight of the original net's answers on photographs")
    parser.add_argument("--input-px", type=int, default=INPUT_PX, help="side of the net's input; a multiple of 32")
    parser.add_argument("--device", default="cpu", help="cpu or cuda")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=0, help="processes that prepare batches (0: one thread)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--start-from", type=Path, default=ORIGINAL, help="ONNX file")
    options = parser.parse_args(arguments)
    for name, value in PRESETS[options.preset].items():
        if getattr(options, name) is None:
            setattr(options, name, value)
    if options.input_px % 32:
        parser.error("--input-px must be a multiple of 32")
    return options


def train(options: argparse.Namespace) -> Training:
    """Trains for the given number of steps, with checkpoints and log lines."""
    np.seterr(all="raise", under="ignore")
    training = Training(options)
    if training.step >= options.steps:
        print("finished earlier")
        return training
    training.read_pictures()
    if not training.step:
        training.probe()
    saved = shown = time.time()
    sums: Counter[str] = Counter()
    while training.step < options.steps:
        sums.update(training.advance(), n=1)
        if time.time() - shown > LINE_S:
            n = sums.pop("n")
            parts = " ".join(f"{name} {total / n:.3f}" for name, total in sums.items())
            speed = n * options.batch / (time.time() - shown)
            print(f"{training.seconds() / 60:.1f} min step {training.step}: {parts}, {speed:.1f} pictures/s", flush=True)
            sums, shown = Counter(), time.time()
        if time.time() - saved > CHECKPOINT_S:
            training.save()
            training.probe()
            saved = time.time()
    training.save()
    training.probe()
    print(f"done: {training.step} steps of {options.batch} pictures, {training.seconds() / 60:.1f} min")
    return training


def main() -> None:
    """Trains, resuming earlier calls."""
    train(parse_options())


if __name__ == "__main__":
    main()
