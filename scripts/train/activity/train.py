"""Trains a net for one row of the table and evaluates it on cameras that it was not trained on.

roadplane-train activity train --meva DIR --row 3d --out WORK/3d.pt
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import nn

from .data import INSTANCE_LABELS, ROWS, Sequence, made_sequences, meva_sequences
from .drives import LABELS
from .features import FEATURES, ODD
from .meva import TEST_CAMERAS
from .model import Both, Net, mirrored_labels

BATCH = 48
RATE = 4e-3
# Exponent of the label weights: rarer labels weigh more.
RARITY = 0.5


def batches(sequences: list[Sequence], rng: np.random.Generator) -> Iterator[list[Sequence]]:
    """Returns all sequences in batches of similar length, shuffled."""
    order = rng.permutation(len(sequences))
    pools = [order[first : first + 24 * BATCH] for first in range(0, len(order), 24 * BATCH)]
    groups = []
    for pool in pools:
        pool = sorted(pool, key=lambda k: -len(sequences[k].labels))
        groups += [pool[first : first + BATCH] for first in range(0, len(pool), BATCH)]
    for k in rng.permutation(len(groups)):
        yield [sequences[i] for i in groups[k]]


def stacked(batch: list[Sequence]) -> tuple[torch.Tensor, ...]:
    """Returns values, lengths, labels, weights and the whole-instance flag, padded with zeros.

    The longest sequence must be first.
    """
    lengths = [len(sequence.labels) for sequence in batch]
    values = np.zeros((len(batch), lengths[0], FEATURES), np.float32)
    labels, weights = np.zeros(values.shape[:2], int), np.zeros(values.shape[:2], np.float32)
    for row, (sequence, length) in enumerate(zip(batch, lengths, strict=True)):
        values[row, :length], labels[row, :length] = sequence.values, sequence.labels
        weights[row, :length] = sequence.weights
    instance = torch.tensor([sequence.instance for sequence in batch])
    return torch.tensor(values), torch.tensor(lengths), torch.tensor(labels), torch.tensor(weights), instance


def rarity(sequences: list[Sequence]) -> torch.Tensor:
    """Returns the weight of each label, computed from the steps."""
    counts = sum(np.bincount(s.labels, s.weights, len(LABELS)) for s in sequences)
    weight = (counts.sum() / np.maximum(counts, 1) / len(LABELS)) ** RARITY
    return torch.tensor(weight, dtype=torch.float32)


def train(sequences: list[Sequence], epochs: int, hidden: int, seed: int, minutes: float) -> Both:
    """Trains a net for a number of epochs, or until the minutes are over."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    net = Net(hidden)
    swap = torch.tensor(mirrored_labels())
    sign = torch.ones(FEATURES)
    sign[list(ODD)] = -1
    steps = epochs * -(-len(sequences) // BATCH) + epochs
    optimiser = torch.optim.AdamW(net.parameters(), RATE, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, steps)
    frames = rarity(sequences)
    instances = [Sequence(s.values[:1], s.labels[:1], np.ones(1), True) for s in sequences if s.instance]
    whole = rarity(instances) if instances else torch.ones(len(LABELS))
    began = time.monotonic()
    for epoch in range(epochs):
        total, count = 0.0, 0
        for batch in batches(sequences, rng):
            values, lengths, labels, weights, instance = stacked(batch)
            if rng.random() < 0.5:
                values, labels = values * sign, swap[labels]
            logits = net(values, lengths)
            weights = weights * frames[labels]
            each = nn.functional.cross_entropy(logits.flatten(0, 1), labels.flatten(), reduction="none").view_as(weights)
            loss = (each * weights).sum() / weights.sum()
            if instance.any():
                # An instance is classified by the mean logits of its steps, among the labels that instances have.
                inside = (weights > 0)[..., None]
                mean = ((logits * inside).sum(1) / inside.sum(1))[instance][:, INSTANCE_LABELS]
                truth = torch.tensor([INSTANCE_LABELS.index(k) for k in labels[instance, 0].tolist()])
                loss = loss + nn.functional.cross_entropy(mean, truth, whole[INSTANCE_LABELS])
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            optimiser.step()
            schedule.step()
            total, count = total + float(loss), count + 1
        print(f"epoch {epoch + 1}/{epochs}  loss {total / count:.3f}  {time.monotonic() - began:.0f} s", flush=True)
        if time.monotonic() - began > 60 * minutes:
            break
    return Both(net, frames).eval()


def probabilities(net: Both, sequences: list[Sequence]) -> list[np.ndarray]:
    """Returns the probabilities (n, LABELS) of the steps of each sequence."""
    with torch.no_grad():
        return [net(torch.tensor(sequence.values)[None])[0].numpy() for sequence in sequences]


def instance_label(found: np.ndarray) -> int:
    """Returns the label of a whole instance, among those that instances have."""
    return INSTANCE_LABELS[int(np.log(found[:, INSTANCE_LABELS] + 1e-9).mean(0).argmax())]


def scores(truth: np.ndarray, predicted: np.ndarray, labels: list[int]) -> dict:
    """Returns accuracy, precision and recall, per label and as the mean over labels."""
    counts = np.zeros((len(LABELS), len(LABELS)), int)
    np.add.at(counts, (truth, predicted), 1)
    hit = np.diag(counts)[labels]
    precision = hit / np.maximum(counts.sum(0)[labels], 1)
    recall = hit / np.maximum(counts.sum(1)[labels], 1)
    each = {LABELS[k]: [round(float(p), 3), round(float(r), 3)] for k, p, r in zip(labels, precision, recall, strict=True)}
    mean = {"accuracy": np.trace(counts) / counts.sum(), "precision": precision.mean(), "recall": recall.mean()}
    return {**{name: round(float(value), 3) for name, value in mean.items()}, "each": each}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meva", type=Path, help="folder of MEVA's instances; without it, training uses synthetic drives alone")
    parser.add_argument("--row", choices=ROWS, default="3d")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--epochs", type=int, default=14)
    parser.add_argument("--hidden", type=int, default=48)
    parser.add_argument("--made", type=int, default=3000, help="number of pieces of synthetic drives")
    parser.add_argument("--made-test", type=int, default=300, help="number of further pieces, for the evaluation")
    parser.add_argument("--versions", type=int, default=2, help="augmented copies of each instance")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=25, help="starts no epoch after this time")
    parser.add_argument("--least", type=float, default=0.0, help="the command fails if the accuracy on synthetic drives is lower")
    parser.add_argument("--test-cameras", nargs="*", default=list(TEST_CAMERAS))
    options = parser.parse_args()
    torch.set_num_threads(1)
    began = time.monotonic()
    learn = []
    if options.meva:
        learn = meva_sequences(options.meva, options.row, tuple(options.test_cameras), False, options.versions, options.seed)
    learn += made_sequences(options.row, options.made, options.seed)
    print(f"{len(learn)} sequences in {time.monotonic() - began:.0f} s", flush=True)
    net = train(learn, options.epochs, options.hidden, options.seed, options.minutes)
    metrics = {}
    if options.meva:
        test = meva_sequences(options.meva, options.row, tuple(options.test_cameras), True, 0, 0)
        truth = np.array([sequence.labels[0] for sequence in test])
        predicted = np.array([instance_label(found) for found in probabilities(net, test)])
        about = {"instances": len(test), "cameras": options.test_cameras}
        metrics["meva, cameras not learnt from"] = {**about, **scores(truth, predicted, INSTANCE_LABELS)}
    made = made_sequences(options.row, options.made_test, options.seed + 1000)
    predicted = np.concatenate([found.argmax(1) for found in probabilities(net, made)])
    metrics["made-up drives"] = scores(np.concatenate([s.labels for s in made]), predicted, list(range(len(LABELS))))
    seconds = {"wall_s": round(time.monotonic() - began), "processor_s": round(time.process_time())}
    result = {"row": options.row, "hidden": options.hidden, "seed": options.seed, **seconds, "metrics": metrics}
    options.out.parent.mkdir(parents=True, exist_ok=True)
    torch.save({"state": net.net.state_dict(), "label_weights": rarity(learn), "result": result}, options.out)
    for name, metric in metrics.items():
        print(name, metric, flush=True)
    print(seconds, flush=True)
    if metrics["made-up drives"]["accuracy"] < options.least:
        raise SystemExit(f"training failed: accuracy on synthetic drives is below {options.least}")


if __name__ == "__main__":
    main()
