"""The classifier's network: a crop of 48 px to logits."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812


def _convolution(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class FaceNet(nn.Module):
    """BGR crops [n, 3, 48, 48] of 0..255 to logits [n, labels]."""

    def __init__(self, labels: int) -> None:
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
        self.hidden = nn.Linear(32 * 6 * 6, 192)
        self.drop = nn.Dropout(0.25)
        self.out = nn.Linear(192, labels)

    def forward(self, x: Tensor) -> Tensor:
        # every crop by its own light: its mean and spread, all channels alike so that colour stays
        x = x * (1.0 / 255.0)
        mean = x.mean(dim=(1, 2, 3), keepdim=True)
        spread = ((x - mean) ** 2).mean(dim=(1, 2, 3), keepdim=True).sqrt()
        x = (x - mean) / (spread + 0.05)
        x = F.relu(self.squeeze(self.body(x))).flatten(1)
        x = self.drop(F.relu(self.hidden(x)))
        logits: Tensor = self.out(x)
        return logits
