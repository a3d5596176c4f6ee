"""From heatmap logits to keypoints: the rule of ARCHITECTURE.md (Rust: crates/keypoints/src/heatmap.rs)."""

from __future__ import annotations

import numpy as np

WINDOW_CELLS = 3


def decode(logits: np.ndarray, input_px: int = 128) -> tuple[np.ndarray, np.ndarray]:
    """Logits [..., n, n] → mean [..., 2] (crop px: x, y), covariance [..., 2, 2] (crop px²), uncalibrated."""
    cells = logits.shape[-1]
    stride = input_px / cells
    flat = logits.reshape(-1, cells, cells).astype(np.float64)
    means = np.empty((len(flat), 2))
    covariances = np.empty((len(flat), 2, 2))
    for i, heat in enumerate(flat):
        row, column = divmod(int(heat.argmax()), cells)
        r0, r1 = max(row - WINDOW_CELLS, 0), min(row + WINDOW_CELLS + 1, cells)
        c0, c1 = max(column - WINDOW_CELLS, 0), min(column + WINDOW_CELLS + 1, cells)
        p = np.exp(heat[r0:r1, c0:c1] - heat[row, column])
        p /= p.sum()
        xs, ys = np.arange(c0, c1), np.arange(r0, r1)
        x, y = (p.sum(0) * xs).sum(), (p.sum(1) * ys).sum()
        dx, dy = xs - x, ys - y
        xy = (p * dy[:, None] * dx[None, :]).sum()
        covariances[i] = (
            np.array([[(p.sum(0) * dx**2).sum(), xy], [xy, (p.sum(1) * dy**2).sum()]]) * stride**2
        )
        means[i] = np.array([x, y]) * stride + (stride - 1) / 2
    return means.reshape(*logits.shape[:-2], 2), covariances.reshape(*logits.shape[:-2], 2, 2)
