"""Prepares the batches of a training while the net learns, and says how a device computes."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

import torch
from torch.utils.data import DataLoader, Dataset

T = TypeVar("T")

CPU_INFO = Path("/proc/cpuinfo")
# About three times as fast where the CPU has instructions for it.
HAS_BF16 = CPU_INFO.exists() and bool({"avx512_bf16", "amx_bf16"} & set(CPU_INFO.read_text().split()))


def fast(device: torch.device) -> torch.autocast:
    """Returns the context in which nets compute in bfloat16, where the device has instructions for it."""
    return torch.autocast(device.type, dtype=torch.bfloat16, enabled=device.type == "cuda" or HAS_BF16)


def prepared(batches: Dataset[T], steps: range, jobs: int) -> Iterator[T]:
    """Yields the batches of steps, in order. A thread or `jobs` processes prepare the next ones meanwhile."""
    if jobs:
        yield from DataLoader(batches, batch_size=None, sampler=steps, num_workers=jobs)
        return
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(batches.__getitem__, steps.start)
        for step in steps:
            batch = future.result()
            if step + 1 < steps.stop:
                future = pool.submit(batches.__getitem__, step + 1)
            yield batch
