"""Train the sign detector; can be stopped and resumed at any time.

python -m pipeline.train.train_detector --data DIR --work DIR

With ``--ranks N`` as many processes, started with ``--rank`` 0 to N - 1, share the work.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import IterableDataset, get_worker_info

from pipeline.train.art import load_faces
from pipeline.train.cache import training_streets
from pipeline.train.detector_data import Sample, SampleMaker, mirrored
from pipeline.train.detector_net import SignNet, detection_loss, loss_behind
from pipeline.train.loop import Recipe, fit, mixed, prepare, read_options
from pipeline.train.moved import in_motion, relit
from pipeline.train.served import Serving

RECIPE = Recipe(
    "detector", rate=2e-3, weight_decay=1e-3, warm_up=150, mean_steps=400.0, batch=8, norm=5.0
)
TIMED = replace(
    RECIPE, rate=2.5e-3, weight_decay=5e-3, warm_up=300, mean_steps=1000.0,
    serving=Serving(size=128, kept=60_000, fresh=32),
)  # fmt: skip
_WAITING = 96
_IN_MOTION = 0.15
"""Share of the pictures that are smeared when they are served: each time along another line, so
that a sign is learnt sharp and in many motions."""
_KEPT = 0.5
"""Weight of what lies behind the network in use: at a heat of 0.5 as steep as the focal loss."""
IN_USE = "detector-in-use.pt"
"""Beside the checkpoint, the weights whose finds a training on a device keeps."""

Batch = tuple[Tensor, ...]
"""Pictures, then heat, weight, boxes and nearness."""


class _Stream(IterableDataset[Sample]):
    """Endless samples; every worker and every resumption draws its own."""

    def __init__(self, maker: SampleMaker, seed: int, fresh: bool) -> None:
        self.maker, self.seed, self.fresh = maker, seed, fresh

    def __iter__(self):  # type: ignore[no-untyped-def]
        info = get_worker_info()
        rng = np.random.default_rng([self.seed, 0 if info is None else info.id])
        waiting: list[Sample] = []
        while True:
            sample = self.maker.make(rng)
            if self.fresh:
                yield sample
                continue
            # every picture serves twice, the second time later and mirrored
            waiting.append(mirrored(sample))
            yield sample
            if len(waiting) >= _WAITING:
                yield waiting.pop(int(rng.integers(len(waiting))))


def _batch(samples: list[Sample]) -> Batch:
    images = np.stack([s.image for s in samples]).transpose(0, 3, 1, 2)
    parts = [np.stack([getattr(s, k) for s in samples]) for k in ("heat", "weight", "box", "near")]
    tensors = [torch.from_numpy(np.ascontiguousarray(p)) for p in (images, *parts)]
    tensors[0] = tensors[0].contiguous(memory_format=torch.channels_last)
    return tuple(tensors)


def _judge(net: nn.Module, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
    image, heat, weight, box, near = batch
    maps = net(image.float().contiguous(memory_format=torch.channels_last))
    return detection_loss(maps, heat, weight, box, near), {}


def _judged_beside(
    in_use: SignNet | None,
) -> Callable[[nn.Module, Batch], tuple[Tensor, dict[str, Tensor]]]:
    """The loss of pictures in other light and in motion, and of what lies behind a network in use,
    which sees them sharp."""

    def judge(net: nn.Module, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        image, heat, weight, box, near = _turned(batch[0].float(), *batch[1:])
        seen = relit(in_motion(image, _IN_MOTION), 0.2, 0.2)
        maps = mixed(net, seen.contiguous(memory_format=torch.channels_last))
        loss = detection_loss(maps, heat, weight, box, near)
        if in_use is None:
            return loss, {}
        with torch.no_grad():
            # only now, since a device's state must not be there when the workers are forked
            in_use.to(image.device, memory_format=torch.channels_last)
            told = mixed(in_use, image.contiguous(memory_format=torch.channels_last))
        behind = loss_behind(maps, told, heat, weight)
        return loss + _KEPT * behind, {"behind": behind.detach()}

    return judge


def _turned(image: Tensor, *targets: Tensor) -> Batch:
    """A batch, half of it mirrored; ``targets`` heat, weight, box and near."""
    turned = torch.rand(len(image), device=image.device) < 0.5

    def flipped(x: Tensor) -> Tensor:
        return torch.where(turned.reshape(-1, *[1] * (x.dim() - 1)), x.flip(-1), x)

    heat, weight, box, near = (flipped(x) for x in targets)
    box = torch.where(turned[:, None, None, None], box[:, [2, 1, 0, 3]], box)
    return flipped(image), heat, weight, box, near


def _in_use(path: Path) -> SignNet | None:
    """The network whose finds are kept, if there is one."""
    if not path.is_file():
        return None
    net = SignNet()
    net.load_state_dict(torch.load(path, weights_only=True)["mean"])
    net.eval()
    net.requires_grad_(False)
    return net


def main() -> None:
    """Command line."""
    options = read_options("Train the sign detector", steps=19500, decay=2600)
    prepare(options, seed=1)
    faces = load_faces(options.data / "sign-art", options.work / "faces.pkl")
    maker = SampleMaker(training_streets(options.data, options.work), faces)
    timed = options.seconds > 0.0
    recipe = TIMED if timed else RECIPE
    in_use = _in_use(options.work / IN_USE) if timed else None
    judge = _judged_beside(in_use) if timed else _judge
    fit(SignNet(), recipe, options, lambda seed: _Stream(maker, 1000 + seed, timed), _batch, judge)


if __name__ == "__main__":
    main()
