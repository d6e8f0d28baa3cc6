"""The detector's network: anchor-free, strides 8 to 32, read out at stride 4."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

STRIDE = 4
KINDS = 2
"""Heat maps: signs of the kinds that GTSDB labels everywhere, and all others."""
LARGEST_STEP = 5.6
"""Limit of the logarithm of a distance in units of the stride: 1080 px."""

_SETTLED = 3.0
"""Logit beyond which two networks say the same: a sign of 0.95 is found whatever else is there."""


def _convolution(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class Residual(nn.Module):
    """Two plain convolutions and a way around them."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = _convolution(width, width)
        self.second = nn.Sequential(
            nn.Conv2d(width, width, 3, 1, 1, bias=False), nn.BatchNorm2d(width)
        )

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(x + self.second(self.first(x)))


def _stage(inputs: int, width: int, blocks: int) -> nn.Sequential:
    return nn.Sequential(_convolution(inputs, width, 2), *[Residual(width) for _ in range(blocks)])


class SignNet(nn.Module):
    """BGR pictures [n, 3, h, w] of 0..255, h and w multiples of 32, to maps [n, 6, h/4, w/4].

    Channels: logits of the two kinds, then the logarithm of the distances to the left, upper,
    right and lower edge in units of the stride. Plain convolutions are quicker on a processor
    than separable ones at these widths; the last layer works at stride 8 and its channels are
    dealt out to the four cells of stride 4.
    """

    def __init__(
        self,
        widths: tuple[int, int, int, int, int] = (16, 24, 40, 64, 96),
        blocks: tuple[int, int, int] = (1, 2, 2),
    ) -> None:
        super().__init__()
        w2, w4, w8, w16, w32 = widths
        self.stem = nn.Sequential(_convolution(3, w2, 2), _convolution(w2, w4, 2))
        self.s8 = _stage(w4, w8, blocks[0])
        self.s16 = _stage(w8, w16, blocks[1])
        self.s32 = _stage(w16, w32, blocks[2])
        self.from32 = nn.Conv2d(w32, w16, 1)
        self.from16 = nn.Conv2d(w16, w8, 1)
        self.head = _convolution(w8, w8)
        self.out = nn.Conv2d(w8, (KINDS + 4) * 4, 1)
        self.deal = nn.PixelShuffle(2)
        nn.init.normal_(self.out.weight, std=0.01)
        with torch.no_grad():
            self.out.bias.zero_()
            self.out.bias[: KINDS * 4] = -4.5
            self.out.bias[KINDS * 4 :] = 1.0

    def forward(self, x: Tensor) -> Tensor:
        s8 = self.s8(self.stem(x * (1.0 / 64.0) - 2.0))
        s16 = self.s16(s8)
        s32 = self.s32(s16)
        s16 = F.relu(s16 + F.interpolate(self.from32(s32), scale_factor=2.0, mode="nearest"))
        s8 = F.relu(s8 + F.interpolate(self.from16(s16), scale_factor=2.0, mode="nearest"))
        maps: Tensor = self.deal(self.out(self.head(s8)))
        return maps


def detection_loss(maps: Tensor, heat: Tensor, weight: Tensor, box: Tensor, near: Tensor) -> Tensor:
    """Focal loss of the heat maps and 1 - GIoU of the boxes.

    ``heat`` [n, 2, h, w]: 1 at centres, falling off around them; ``weight`` [n, 2, h, w]: 0
    where nothing is to be learnt; ``box`` [n, 4, h, w]: true distances in px; ``near`` [n, h,
    w]: how much each cell's box counts, 0 away from centres. CenterNet (Zhou et al. 2019,
    Objects as Points) and FCOS (Tian et al. 2019).
    """
    logits = maps[:, :KINDS]
    p = torch.sigmoid(logits)
    positive = heat.ge(0.999).float()
    hit = -F.logsigmoid(logits) * (1.0 - p) ** 2 * positive
    miss = -F.logsigmoid(-logits) * p**2 * (1.0 - heat) ** 4 * (1.0 - positive)
    count = positive.sum().clamp(min=4.0)
    focal = ((hit + miss) * weight).sum() / count
    where = near > 0
    steps = maps[:, KINDS:].permute(0, 2, 3, 1)[where]
    share = near[where]
    d = torch.exp(steps.clamp(max=LARGEST_STEP)) * STRIDE
    t = box.permute(0, 2, 3, 1)[where]
    inner = torch.minimum(d, t)
    outer = torch.maximum(d, t)
    common = (inner[:, 0] + inner[:, 2]) * (inner[:, 1] + inner[:, 3])
    union = (
        (d[:, 0] + d[:, 2]) * (d[:, 1] + d[:, 3])
        + (t[:, 0] + t[:, 2]) * (t[:, 1] + t[:, 3])
        - common
    )
    hull = (outer[:, 0] + outer[:, 2]) * (outer[:, 1] + outer[:, 3])
    giou = common / union - (hull - union) / hull
    # edges to a fraction of the sign's size: positions on the map come from the boxes' centres
    size = torch.sqrt((t[:, 0] + t[:, 2]) * (t[:, 1] + t[:, 3]))[:, None]
    edges = F.smooth_l1_loss(d / size, t / size, reduction="none", beta=0.05).sum(dim=1)
    total = share.sum().clamp(min=4.0)
    return focal + 2.0 * (((1.0 - giou) + 1.0 * edges) * share).sum() / total


def loss_behind(maps: Tensor, other: Tensor, heat: Tensor, weight: Tensor) -> Tensor:
    """How far the heat maps of ``maps`` lie behind those of another network, where they do.

    At centres by how much lower the logit is, elsewhere by how much higher, weighed as the focal
    loss weighs it; ``heat`` and ``weight`` as of ``detection_loss``. What the networks in use find
    is kept so, and nothing is held back where the new one is ahead (after Yan et al. 2021,
    *Positive-congruent training: towards regression-free model updates*).
    """
    logits, told = maps[:, :KINDS], other[:, :KINDS].clamp(-_SETTLED, _SETTLED)
    positive = heat.ge(0.999).float()
    missed = F.relu(told - logits) * positive
    p = torch.sigmoid(logits).detach()
    risen = F.relu(logits - told) * p**2 * (1.0 - heat) ** 4 * (1.0 - positive)
    return ((missed + risen) * weight).sum() / positive.sum().clamp(min=4.0)
