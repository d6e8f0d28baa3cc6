"""The classifier's network: a crop of 48 px to logits."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

_FACE_PX = 18.0
"""Radius of what belongs to the face in a crop whatever its shape."""
_BRIGHTEST = 3.0
HIDDEN = 288
_LEAST = 1e-30


def _convolution(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class FaceNet(nn.Module):
    """BGR crops [n, 3, 48, 48] of 0..255 to logits [n, labels]."""

    def __init__(self, labels: int, hidden: int = HIDDEN) -> None:
        super().__init__()
        self.body = nn.Sequential(
            _convolution(3, 24),
            _convolution(24, 32, 2),
            _convolution(32, 48),
            _convolution(48, 64, 2),
            _convolution(64, 96),
            _convolution(96, 128, 2),
            _convolution(128, 160),
        )
        self.squeeze = nn.Conv2d(160, 32, 1)
        self.hidden = nn.Linear(32 * 6 * 6, hidden)
        self.drop = nn.Dropout(0.25)
        self.out = nn.Linear(hidden, labels)
        across = torch.arange(48.0) - 23.5
        inside = (across[:, None] ** 2 + across**2 < _FACE_PX**2).float()
        self.register_buffer("inside", inside / inside.sum(), persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        # every face by its own light, whatever stands around it: its mean and spread, all channels
        # alike so that colour stays
        x = x * (1.0 / 255.0)
        inside: Tensor = self.inside
        grey = x.mean(dim=1, keepdim=True)
        mean = (grey * inside).sum(dim=(2, 3), keepdim=True)
        power = ((x - mean) ** 2).mean(dim=1, keepdim=True)
        spread = (power * inside).sum(dim=(2, 3), keepdim=True).sqrt()
        x = ((x - mean) / (1.25 * spread + 0.004)).clamp(-_BRIGHTEST, _BRIGHTEST)
        x = F.relu(self.squeeze(self.body(x))).flatten(1)
        x = self.drop(F.relu(self.hidden(x)))
        logits: Tensor = self.out(x)
        return logits


def trained(state: dict[str, Any]) -> FaceNet:
    """The running mean of a training, of the size that its checkpoint has."""
    mean = state["mean"]
    net = FaceNet(len(state["labels"]), mean["hidden.bias"].numel())
    net.load_state_dict(mean)
    net.eval()
    return net


def membership(outputs: list[str], labels: list[str]) -> Tensor:
    """Which of ``outputs``, named as after folding, belongs to which of ``labels``: [n, m]."""
    return torch.tensor([[float(a == b) for b in labels] for a in outputs])


def fold(logits: Tensor, belongs: Tensor) -> Tensor:
    """Logits [k, n] to logits [k, m] whose softmax adds up what belongs together."""
    top = logits.amax(dim=1, keepdim=True)
    parts = (logits - top).exp() @ belongs
    return parts.clamp_min(_LEAST).log() + top


class Folded(nn.Module):
    """A network whose kinds of unknown faces are one output for each group.

    Crops [n, 3, 48, 48] to logits [n, labels] by ``belongs`` of ``membership``.
    """

    def __init__(self, net: nn.Module, belongs: Tensor) -> None:
        super().__init__()
        self.net = net
        self.register_buffer("belongs", belongs, persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        belongs: Tensor = self.belongs
        return fold(self.net(x), belongs)
