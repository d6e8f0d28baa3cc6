"""Train the sign detector; can be stopped and resumed at any time.

python -m pipeline.train.train_detector --data DIR --work DIR

With ``--ranks N`` as many processes, started with ``--rank`` 0 to N - 1, share the work.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import IterableDataset, get_worker_info

from pipeline.train.art import load_faces
from pipeline.train.cache import training_streets
from pipeline.train.detector_data import Sample, SampleMaker, mirrored
from pipeline.train.detector_net import SignNet, detection_loss
from pipeline.train.loop import Recipe, fit, prepare, read_options

RECIPE = Recipe(
    "detector", rate=2e-3, weight_decay=1e-3, warm_up=150, mean_steps=400.0, batch=8, norm=5.0
)
_WAITING = 96


class _Stream(IterableDataset[Sample]):
    """Endless samples; every worker and every resumption draws its own."""

    def __init__(self, maker: SampleMaker, seed: int) -> None:
        self.maker, self.seed = maker, seed

    def __iter__(self):  # type: ignore[no-untyped-def]
        info = get_worker_info()
        rng = np.random.default_rng([self.seed, 0 if info is None else info.id])
        waiting: list[Sample] = []
        while True:
            sample = self.maker.make(rng)
            # every picture serves twice, the second time later and mirrored
            waiting.append(mirrored(sample))
            yield sample
            if len(waiting) >= _WAITING:
                yield waiting.pop(int(rng.integers(len(waiting))))


def _batch(samples: list[Sample]) -> tuple[torch.Tensor, ...]:
    images = np.stack([s.image for s in samples]).transpose(0, 3, 1, 2)
    parts = [np.stack([getattr(s, k) for s in samples]) for k in ("heat", "weight", "box", "near")]
    tensors = [torch.from_numpy(np.ascontiguousarray(p)) for p in (images, *parts)]
    tensors[0] = tensors[0].contiguous(memory_format=torch.channels_last)
    return tuple(tensors)


def _judge(net: nn.Module, batch: tuple[torch.Tensor, ...]) -> tuple[Tensor, dict[str, float]]:
    image, heat, weight, box, near = batch
    return detection_loss(net(image.float()), heat, weight, box, near), {}


def main() -> None:
    """Command line."""
    options = read_options("Train the sign detector", steps=19500, decay=2600)
    prepare(options, seed=1)
    faces = load_faces(options.data / "sign-art", options.work / "faces.pkl")
    maker = SampleMaker(training_streets(options.data, options.work), faces)
    fit(SignNet(), RECIPE, options, lambda seed: _Stream(maker, 1000 + seed), _batch, _judge)


if __name__ == "__main__":
    main()
