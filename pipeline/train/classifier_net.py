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
WIDTHS = (24, 32, 48, 64, 96, 128, 160, 32)
_STRIDES = (1, 2, 1, 2, 1, 2, 1)
_LEAST = 1e-30


def _convolution(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class FaceNet(nn.Module):
    """BGR crops [n, 3, 48, 48] of 0..255 to logits [n, labels].

    ``widths`` channels of the convolutions and of the squeezed layer.
    """

    def __init__(self, labels: int, hidden: int = HIDDEN, widths: tuple[int, ...] = WIDTHS) -> None:
        super().__init__()
        *body, squeezed = widths
        pairs = zip((3, *body[:-1]), body, _STRIDES, strict=True)
        self.body = nn.Sequential(*[_convolution(a, b, stride) for a, b, stride in pairs])
        self.squeeze = nn.Conv2d(body[-1], squeezed, 1)
        self.hidden = nn.Linear(squeezed * 6 * 6, hidden)
        self.drop = nn.Dropout(0.25)
        self.out = nn.Linear(hidden, labels)
        across = torch.arange(48.0) - 23.5
        inside = (across[:, None] ** 2 + across**2 < _FACE_PX**2).float()
        self.register_buffer("inside", inside / inside.sum(), persistent=False)

    def features(self, x: Tensor) -> Tensor:
        """What the squeezed layer sees of crops, [n, channels * 36]."""
        # every face by its own light, whatever stands around it: its mean and spread, all channels
        # alike so that colour stays
        x = x * (1.0 / 255.0)
        inside: Tensor = self.inside
        grey = x.mean(dim=1, keepdim=True)
        mean = (grey * inside).sum(dim=(2, 3), keepdim=True)
        power = ((x - mean) ** 2).mean(dim=1, keepdim=True)
        spread = (power * inside).sum(dim=(2, 3), keepdim=True).sqrt()
        x = ((x - mean) / (1.25 * spread + 0.004)).clamp(-_BRIGHTEST, _BRIGHTEST)
        return F.relu(self.squeeze(self.body(x))).flatten(1)

    def tell(self, features: Tensor) -> Tensor:
        """The logits of what the squeezed layer sees."""
        logits: Tensor = self.out(self.drop(F.relu(self.hidden(features))))
        return logits

    def forward(self, x: Tensor) -> Tensor:
        return self.tell(self.features(x))


def trained(state: dict[str, Any]) -> FaceNet:
    """The running mean of a training, of the size that its checkpoint has."""
    mean = state["mean"]
    body = [value.shape[0] for key, value in mean.items() if key.endswith(".0.weight")]
    widths = (*body, mean["squeeze.bias"].numel())
    net = FaceNet(len(state["labels"]), mean["hidden.bias"].numel(), widths)
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
