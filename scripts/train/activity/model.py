"""The activity net: a bidirectional LSTM, evaluated on every motion and on its mirror image."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from .drives import LABELS
from .features import FEATURES, ODD


def mirrored_labels() -> list[int]:
    """Returns the index of each label's mirror image."""
    swap = {"turning_left": "turning_right", "turning_right": "turning_left"}
    return [LABELS.index(swap.get(label, label)) for label in LABELS]


class Net(nn.Module):
    """Maps features (batch, steps, FEATURES) to logits (batch, steps, LABELS)."""

    def __init__(self, hidden: int = 48, layers: int = 2, dropout: float = 0.3) -> None:
        super().__init__()
        self.lstm = nn.LSTM(FEATURES, hidden, layers, batch_first=True, bidirectional=True, dropout=dropout)
        self.dropout = nn.Dropout(dropout)
        self.out = nn.Linear(2 * hidden, len(LABELS))

    def forward(self, values: torch.Tensor, lengths: torch.Tensor | None = None) -> torch.Tensor:
        if lengths is None:
            return self.out(self.lstm(values)[0])
        packed = pack_padded_sequence(values, lengths, batch_first=True)
        hidden, _ = pad_packed_sequence(self.lstm(packed)[0], batch_first=True)
        return self.out(self.dropout(hidden))


class Both(nn.Module):
    """Returns log probabilities (batch, steps, LABELS): the mean of a net on a motion and on its mirror image.

    The label weights of the training are divided out, as rare labels would be predicted too often otherwise.
    """

    def __init__(self, net: Net, label_weights: torch.Tensor) -> None:
        super().__init__()
        self.net = net
        sign = torch.ones(FEATURES)
        sign[list(ODD)] = -1
        self.register_buffer("sign", sign)
        self.register_buffer("swap", torch.tensor(mirrored_labels()))
        self.register_buffer("log_weights", (label_weights + label_weights[self.swap]).div(2).log())

    def forward(self, values: torch.Tensor, lengths: torch.Tensor | None = None) -> torch.Tensor:
        seen = torch.log_softmax(self.net(values, lengths), 2)
        mirror = torch.log_softmax(self.net(values * self.sign, lengths), 2).index_select(2, self.swap)
        return torch.softmax((seen + mirror) / 2 - self.log_weights, 2)
