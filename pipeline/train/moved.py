"""Pictures served again: moved, turned and in other light, on the device where they are kept."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F  # noqa: N812


def moved(image: Tensor, turn: float, scale: float, shift: float) -> Tensor:
    """Pictures [n, 3, h, w] turned, stretched and shifted at random.

    Standard deviations: ``turn`` in degrees, ``scale`` as a share, ``shift`` in px.
    """
    n, _, _, wide = image.shape
    at = {"device": image.device}
    angle = torch.deg2rad(torch.randn(n, **at) * turn)
    stretch = torch.exp(torch.randn(n, 2, **at) * 0.5 * scale + torch.randn(n, 1, **at) * scale)
    c, s = angle.cos(), angle.sin()
    off = torch.randn(n, 2, **at) * (2.0 * shift / wide)
    rows = [
        torch.stack([c * stretch[:, 0], -s * stretch[:, 0], off[:, 0]], 1),
        torch.stack([s * stretch[:, 1], c * stretch[:, 1], off[:, 1]], 1),
    ]
    grid = F.affine_grid(torch.stack(rows, 1), list(image.shape), align_corners=False)
    return F.grid_sample(image, grid, padding_mode="border", align_corners=False)


def relit(image: Tensor, noisy: float, blurred: float) -> Tensor:
    """Pictures [n, 3, h, w] of 0..255 with another exposure, tone, inks, noise and sharpness.

    ``noisy`` and ``blurred`` are the shares that get noise, and that are smoothed. Rounded as a
    picture of 8 bits is.
    """
    n = len(image)
    at = {"device": image.device}

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return torch.rand(n, *shape, **at) * (high - low) + low

    image = (image / 255.0).clamp(1e-4, 1.0) ** uniform(0.8, 1.25, 1, 1, 1)
    gain = uniform(0.75, 1.2, 1, 1, 1) * torch.exp(0.05 * torch.randn(n, 3, 1, 1, **at))
    image = 255.0 * gain * image
    soft = F.avg_pool2d(F.pad(image, (1, 1, 1, 1), mode="replicate"), 3, 1)
    share = uniform(0.0, 1.0, 1, 1, 1) * (uniform(0.0, 1.0, 1, 1, 1) < blurred)
    image = torch.lerp(image, soft, share)
    spread = uniform(0.0, 7.0, 1, 1, 1) * (uniform(0.0, 1.0, 1, 1, 1) < noisy)
    image = image + spread * torch.randn(image.shape, **at)
    return image.clamp(0.0, 255.0).round()
