"""Train the classifier of sign faces; can be stopped and resumed at any time.

python -m pipeline.train.train_classifier --data DIR --work DIR
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812
from torch.utils.data import IterableDataset, get_worker_info

from pipeline.train.art import load_faces
from pipeline.train.cache import face_data
from pipeline.train.classifier_data import CropMaker, Image, label_of, labels
from pipeline.train.classifier_net import FaceNet, fold, membership
from pipeline.train.degrade import tone
from pipeline.train.loop import Recipe, fit, prepare, read_options

SHARES = (0.3, 0.41, 0.21, 0.08)
"""Real signs, drawn classes, unknown faces, no signs."""
KINDS_SHARE = 0.2
Judge = Callable[
    [nn.Module, tuple[torch.Tensor, torch.Tensor]], tuple[torch.Tensor, dict[str, float]]
]
_WAITING, _SERVINGS = 4000, 5


class _Stream(IterableDataset[tuple[Image, int]]):
    def __init__(self, maker: CropMaker, seed: int) -> None:
        self.maker, self.seed = maker, seed
        self._index = {name: i for i, name in enumerate(maker.names)}

    def __iter__(self):  # type: ignore[no-untyped-def]
        info = get_worker_info()
        rng = np.random.default_rng([self.seed, 0 if info is None else info.id])
        makers = (self.maker.real, self.maker.drawn, self.maker.other, self.maker.nothing)
        waiting: list[tuple[Image, int, int]] = []
        while True:
            image, name = makers[int(rng.choice(4, p=SHARES))](rng)
            sample = image, self._index[name]
            waiting.append((*sample, _SERVINGS - 1))
            yield sample
            if len(waiting) < _WAITING:
                continue
            # every crop serves several times, later and a little other: drawing takes longer
            for _ in range(_SERVINGS - 1):
                at = int(rng.integers(len(waiting)))
                image, label, left = waiting[at]
                yield again(image, rng), label
                if left > 1:
                    waiting[at] = image, label, left - 1
                else:
                    waiting[at] = waiting[-1]
                    waiting.pop()


def again(image: Image, rng: np.random.Generator) -> Image:
    """A crop moved, turned and in other light."""
    middle = (image.shape[0] - 1) / 2
    turn = cv2.getRotationMatrix2D((middle, middle), rng.normal(0.0, 3.0), rng.normal(1.0, 0.04))
    matrix = np.asarray(turn, np.float64) + np.outer(rng.normal(0.0, 1.2, 2), [0.0, 0.0, 1.0])
    moved = cv2.warpAffine(
        image, matrix, image.shape[1::-1], flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return tone(np.asarray(moved, np.uint8), rng.uniform(0.8, 1.2), rng.uniform(0.8, 1.25), 1.0)


def _batch(samples: list[tuple[Image, int]]) -> tuple[torch.Tensor, torch.Tensor]:
    images = torch.from_numpy(np.stack([image for image, _ in samples]).transpose(0, 3, 1, 2))
    return images.contiguous(memory_format=torch.channels_last), torch.tensor(
        [label for _, label in samples]
    )


def _judged_by(belongs: Tensor) -> Judge:
    """The loss of the labels as they are used, and for a part of the kinds of unknown faces."""
    label_of_output = belongs.argmax(dim=1)

    def judge(
        net: nn.Module, batch: tuple[torch.Tensor, torch.Tensor]
    ) -> tuple[Tensor, dict[str, float]]:
        image, output = batch
        logits = net(image.float())
        label = label_of_output[output]
        folded = fold(logits, belongs)
        right = float((folded.argmax(1) == label).float().mean())
        kinds = F.cross_entropy(logits, output)
        return F.cross_entropy(folded, label) + KINDS_SHARE * kinds, {"right": right}

    return judge


def main() -> None:
    """Command line."""
    options = read_options("Train the classifier of sign faces", steps=23600, decay=7000)
    prepare(options, seed=2)
    faces = load_faces(options.data / "sign-art", options.work / "faces.pkl")
    maker = CropMaker(*face_data(options.data, options.work), faces)
    names = maker.names
    recipe = Recipe(
        "classifier", rate=1.5e-3, weight_decay=2e-3, warm_up=100, mean_steps=200.0, batch=64,
        stored={"labels": names},
    )  # fmt: skip
    net = FaceNet(len(names))
    judge = _judged_by(membership([label_of(name) for name in names], labels()))
    fit(net, recipe, options, lambda seed: _Stream(maker, 5000 + seed), _batch, judge)


if __name__ == "__main__":
    main()
