"""Pictures served again: moved, turned and in other light, on the device where they are kept."""

from __future__ import annotations

from functools import cache

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from pipeline.train.degrade import motion_kernel

_LENGTHS, _SLOPE_DEG, _KERNELS = (3.0, 14.0), 40.0, 256
"""Of motion blur, px: the longest is 10 px of a camera's picture enlarged 1.4 times, as one of 1360
px is that is searched. Slopes are normal; how many lines are kept to choose from."""


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


def in_motion(image: Tensor, share: float) -> Tensor:
    """Pictures [n, 3, h, w], a ``share`` of them smeared along a line of any length and slope."""
    n, _, high, wide = image.shape
    chosen = torch.nonzero(torch.rand(n, device=image.device) < share)[:, 0]
    if len(chosen) == 0:
        return image
    lines = _lines(image.device)
    line = lines[torch.randint(0, len(lines), (len(chosen),), device=image.device)]
    reach = line.shape[-1] // 2
    part = F.pad(image[chosen], (reach, reach, reach, reach), mode="reflect")
    weight = line[:, None].repeat_interleave(3, dim=0)
    smeared = F.conv2d(part.reshape(1, -1, *part.shape[2:]), weight, groups=len(weight))
    result = image.clone()
    result[chosen] = smeared.reshape(len(chosen), 3, high, wide)
    return result


@cache
def _lines(device: torch.device) -> Tensor:
    """Kernels [count, size, size] of motion blur, all of one size."""
    rng = np.random.default_rng(41)
    size = int(np.ceil(_LENGTHS[1])) | 1
    lines = np.zeros((_KERNELS, size, size), np.float32)
    for into in lines:
        kernel = motion_kernel(rng.uniform(*_LENGTHS), rng.normal(0.0, _SLOPE_DEG))
        first = (size - len(kernel)) // 2
        into[first : first + len(kernel), first : first + len(kernel)] = kernel
    return torch.from_numpy(lines).to(device)
