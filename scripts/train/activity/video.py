"""Trains the net of the table's video row on clips with truth, and exports it with its card.

  roadplane-train activity video --clips DIR ... --work WORK/video --out OUT

The net is a small R(2+1)D (Tran et al., CVPR 2018), which alternates convolutions over the picture and over time. It is
trained from random weights on windows (`windows.py`). `DIR` holds a data set with truth, as `render dataset` and
`render busy --pixels` make it. Windows and epochs are stored in WORK; a training that was killed resumes after the last
epoch.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import torch
from torch import nn

from roadplane_train.json_files import read_json

from .drives import LABELS
from .export import write_net
from .model import mirrored_labels
from .train import RARITY, scores
from .windows import BEFORE, LABELLED, LABELLED_BEFORE, REACH, SIDE_PX, STEP_S, STEPS, read_clip, square_around, window

BATCH = 32
RATE = 3e-3
# Steps between two windows of a car: while it moves, and while it is stationary.
EVERY, EVERY_STATIONARY = 2, 16
VERSIONS = 2  # copies of each window, each with a slightly shifted square
HELD_OUT = 6  # one car in so many is held out


class VideoNet(nn.Module):
    """Maps bytes (batch, STEPS, SIDE_PX, SIDE_PX, 3), as numbers, to logits (batch, LABELLED, LABELS)."""

    def __init__(self) -> None:
        super().__init__()

        def layer(inputs: int, outputs: int, kernel: int, stride: int) -> list[nn.Module]:
            half = kernel // 2
            over_space = nn.Conv3d(inputs, outputs, (1, kernel, kernel), (1, stride, stride), (0, half, half), bias=False)
            over_time = nn.Conv3d(outputs, outputs, (3, 1, 1), padding=(1, 0, 0), bias=False)
            return [over_space, nn.BatchNorm3d(outputs), nn.ReLU(), over_time, nn.BatchNorm3d(outputs), nn.ReLU()]

        self.seen = nn.Sequential(*layer(3, 16, 7, 4), *layer(16, 32, 3, 2), *layer(32, 48, 3, 2))
        self.whole = nn.Sequential(nn.Conv3d(48, 64, (3, 3, 3), padding=(1, 0, 0)), nn.ReLU(), nn.Dropout(0.4))
        self.out = nn.Conv1d(64, len(LABELS), 5, padding=2)

    def forward(self, crops: torch.Tensor) -> torch.Tensor:
        # Brightness and contrast are normalised per window.
        middle = crops.mean((1, 2, 3, 4), keepdim=True)
        spread = (crops - middle).pow(2).mean((1, 2, 3, 4), keepdim=True).sqrt() + 4.0
        values = ((crops - middle) / spread).permute(0, 4, 1, 2, 3)
        steps = self.out(self.whole(self.seen(values)).flatten(2))
        first = BEFORE - LABELLED_BEFORE
        return steps[:, :, first : first + LABELLED].transpose(1, 2)


class BothViews(nn.Module):
    """Returns log probabilities (batch, LABELLED, LABELS): the mean of a net on a window and on its mirror image.

    The label weights of the training are divided out.
    """

    def __init__(self, net: VideoNet, label_weights: torch.Tensor) -> None:
        super().__init__()
        self.net = net
        self.register_buffer("swap", torch.tensor(mirrored_labels()))
        self.register_buffer("log_weights", (label_weights + label_weights[self.swap]).div(2).log())

    def forward(self, crops: torch.Tensor) -> torch.Tensor:
        seen = torch.log_softmax(self.net(crops), 2)
        mirror = torch.log_softmax(self.net(crops.flip(3)), 2).index_select(2, self.swap)
        return torch.softmax((seen + mirror) / 2 - self.log_weights, 2)


def windows_of(path: Path, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Returns the windows of a clip's cars, their steps' labels and weights, and which cars are held out."""
    pictures, cars = read_clip(path)
    crops, labels, weights, held_out = [], [], [], []
    for number, car in enumerate(cars):
        place = {int(step): i for i, step in enumerate(car.steps)}
        for k, step in enumerate(car.steps.tolist()):
            labelled = [place.get(step - LABELLED_BEFORE + i) for i in range(LABELLED)]
            near = car.labels[max(k - BEFORE, 0) : k + BEFORE]
            every = EVERY if near.any() else EVERY_STATIONARY
            if step % every:
                continue
            label = [0 if i is None else int(car.labels[i]) for i in labelled]
            weight = [0.0 if i is None else every / EVERY for i in labelled]
            for _ in range(VERSIONS):
                square = square_around(car.boxes[k])
                square[:2] += square[2] / REACH * rng.normal(0, 0.06, 2)
                wider = np.exp(rng.normal(0, 0.1)) - 1
                square += square[2] * wider * np.array([-0.5, -0.5, 1])
                crops.append(window(pictures, step, square))
                labels.append(label)
                weights.append(weight)
                held_out.append(number % HELD_OUT == HELD_OUT - 1)
    return np.array(crops), np.array(labels), np.array(weights, np.float32), np.array(held_out)


def read_windows(folders: list[Path], seed: int, work: Path) -> tuple[np.ndarray, ...]:
    """Returns the windows of all clips of some data sets; those of each clip are stored in `work`."""
    clips = []
    for folder in folders:
        clips += [folder / item for item in read_json(folder / "dataset.json")["items"]]
    parts = []
    for i, path in enumerate(clips):
        kept = work / f"windows_{i:03d}.npz"
        if not kept.exists():
            np.savez(kept.with_suffix(".part.npz"), *windows_of(path, np.random.default_rng([seed, i])))
            kept.with_suffix(".part.npz").rename(kept)
        with np.load(kept) as saved:
            part = [saved[name] for name in saved.files]
        print(f"{path.name}: {len(part[0])} windows", flush=True)
        if len(part[0]):
            parts.append(part)
    return tuple(np.concatenate(of) for of in zip(*parts, strict=True))


def rarity(labels: np.ndarray, weights: np.ndarray) -> torch.Tensor:
    """Returns the weight of each label, as for the other rows.

    A label without samples weighs as much as the rarest one.
    """
    counts = np.bincount(labels.ravel(), weights.ravel(), len(LABELS))
    counts = np.where(counts > 0, counts, counts[counts > 0].min())
    return torch.tensor((counts.sum() / counts / len(LABELS)) ** RARITY, dtype=torch.float32)


def train(data: tuple[np.ndarray, ...], epochs: int, seed: int, work: Path) -> VideoNet:
    """Trains the net for a number of epochs."""
    crops, labels, weights = data
    torch.manual_seed(seed)
    net, swap = VideoNet(), np.array(mirrored_labels())
    optimiser = torch.optim.AdamW(net.parameters(), RATE, weight_decay=0.02)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, epochs * (len(crops) // BATCH))
    rare = rarity(labels, weights)
    state, first = work / "last.pt", 0
    if state.exists():
        saved = torch.load(state)
        first = saved["epoch"]
        for part, of in ((net, "net"), (optimiser, "optimiser"), (schedule, "schedule")):
            part.load_state_dict(saved[of])
    for epoch in range(first, epochs):
        began, total = time.monotonic(), 0.0
        rng = np.random.default_rng([seed, epoch])
        torch.manual_seed(1000 * seed + epoch)
        order = rng.permutation(len(crops))[: len(crops) // BATCH * BATCH].reshape(-1, BATCH)
        net.train()
        for chosen in order:
            seen, right = crops[chosen].astype(np.float32), labels[chosen]
            if rng.random() < 0.5:
                seen, right = np.ascontiguousarray(seen[:, :, :, ::-1]), swap[right]
            seen *= np.exp(rng.normal(0, 0.1, (BATCH, 1, 1, 1, 3))).astype(np.float32)
            logits = net(torch.from_numpy(seen))
            right = torch.from_numpy(right)
            each = nn.functional.cross_entropy(logits.flatten(0, 1), right.flatten(), reduction="none").view_as(right)
            weight = torch.from_numpy(weights[chosen]) * rare[right]
            loss = (each * weight).sum() / weight.sum().clamp(min=1e-6)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            total += float(loss)
        parts = {"net": net.state_dict(), "optimiser": optimiser.state_dict(), "schedule": schedule.state_dict()}
        torch.save({"epoch": epoch + 1, **parts}, state.with_suffix(".part"))
        state.with_suffix(".part").rename(state)
        print(f"epoch {epoch + 1}/{epochs}  loss {total / len(order):.3f}  {time.monotonic() - began:.0f} s", flush=True)
    return net.eval()


def predicted(net: BothViews, crops: np.ndarray) -> np.ndarray:
    """Returns the most probable label of each labelled step (n, LABELLED)."""
    with torch.no_grad():
        parts = [torch.from_numpy(crops[i : i + BATCH].astype(np.float32)) for i in range(0, len(crops), BATCH)]
        return torch.cat([net(part).argmax(2) for part in parts]).numpy()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=Path, nargs="+", required=True, help="data sets with truth and video")
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--epochs", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--about", default="", help="description of the clips, for the card")
    options = parser.parse_args()
    torch.set_num_threads(1)
    options.work.mkdir(parents=True, exist_ok=True)
    crops, labels, weights, held_out = read_windows(options.clips, options.seed, options.work)
    print(f"{len(crops)} windows, {held_out.sum()} of them held out", flush=True)
    learn = ~held_out
    net = train((crops[learn], labels[learn], weights[learn]), options.epochs, options.seed, options.work)
    both = BothViews(net, rarity(labels[learn], weights[learn])).eval()
    counted, right = weights[held_out] > 0, labels[held_out]
    metrics = scores(right[counted], predicted(both, crops[held_out])[counted], np.unique(right[counted]).tolist())
    print(metrics, flush=True)
    about = f"seed {options.seed}, {options.epochs} epochs, {learn.sum()} windows of: {options.about}"
    write_net(
        both,
        options.out / "activity_video.onnx",
        {"crops": ["batch", STEPS, SIDE_PX, SIDE_PX, 3]},
        {"labels": ["batch", LABELLED, len(LABELS)]},
        [crops[:3].astype(np.float32)],
        {
            "licence": "MIT OR Apache-2.0",
            "preprocess": {"labels": list(LABELS), "step_s": STEP_S, "windows": "scripts/train/activity/windows.py"},
            "source": "activities of vehicles, from pixels around them over 3 s (the table's video row)",
            "how_made": f"roadplane-train activity video, {about}",
            "metrics": {"cars of the same clips, held out": metrics},
        },
    )


if __name__ == "__main__":
    main()
