"""Train the classifier of sign faces; can be stopped and resumed at any time.

python -m pipeline.train.train_classifier --data DIR --work DIR

On a graphics processor crops are drawn by ``--workers`` processes and served several times.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812
from torch.utils.data import IterableDataset, get_worker_info

from automap.signs.classes import load_classes
from pipeline.train.art import load_faces
from pipeline.train.cache import face_data
from pipeline.train.classifier_data import CropMaker, Image, label_of, labels
from pipeline.train.classifier_net import HIDDEN, WIDTHS, FaceNet, fold, membership
from pipeline.train.degrade import tone
from pipeline.train.loop import Recipe, fit, mixed, prepare, read_options
from pipeline.train.moved import moved, relit
from pipeline.train.served import Serving

SHARES = (0.3, 0.41, 0.21, 0.08)
"""Real signs, drawn classes, unknown faces, no signs."""
KINDS_SHARE = 0.2
Batch = tuple[Tensor, Tensor, Tensor]
"""Crops, their outputs, and their sources as in ``SHARES``."""
Judge = Callable[[nn.Module, Batch], tuple[Tensor, dict[str, Tensor]]]
_WAITING, _SERVINGS = 4000, 5
_MADE = (0.16, 0.40, 0.36, 0.08)
"""Shares of what is drawn where crops are kept by source: drawn ones differ more."""
SERVING = Serving(size=1024, kept=400_000, fresh=256, shares=SHARES)
_BETWEEN, _HALFWAY = 0.05, (0.35, 0.65)


class _Stream(IterableDataset[tuple[Image, int, int]]):
    """Endless crops; drawn once and served several times, or ``fresh`` alone."""

    def __init__(self, maker: CropMaker, seed: int, fresh: bool) -> None:
        self.maker, self.seed, self.fresh = maker, seed, fresh
        self._index = {name: i for i, name in enumerate(maker.names)}

    def __iter__(self):  # type: ignore[no-untyped-def]
        info = get_worker_info()
        rng = np.random.default_rng([self.seed, 0 if info is None else info.id])
        makers = (self.maker.real, self.maker.drawn, self.maker.other, self.maker.nothing)
        waiting: list[tuple[Image, int, int, int]] = []
        while True:
            source = int(rng.choice(4, p=_MADE if self.fresh else SHARES))
            image, name = makers[source](rng)
            sample = image, self._index[name], source
            yield sample
            if self.fresh:
                continue
            waiting.append((*sample, _SERVINGS - 1))
            if len(waiting) < _WAITING:
                continue
            # every crop serves several times, later and a little other: drawing takes longer
            for _ in range(_SERVINGS - 1):
                at = int(rng.integers(len(waiting)))
                image, label, source, left = waiting[at]
                yield again(image, rng), label, source
                if left > 1:
                    waiting[at] = image, label, source, left - 1
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


def _batch(samples: list[tuple[Image, int, int]]) -> Batch:
    images = torch.from_numpy(np.stack([image for image, _, _ in samples]).transpose(0, 3, 1, 2))
    told = torch.tensor([rest for _, *rest in samples])
    return images.contiguous(memory_format=torch.channels_last), told[:, 0], told[:, 1]


def _judged_by(names: list[str], timed: bool) -> Judge:
    """The loss of the labels as they are used, and for a part of the kinds of unknown faces.

    On a device crops are moved and relit, and halfway points between two drawn classes of one
    shape and colour, in what the convolutions see, are taught as unknown faces of it.
    """
    told, classes = labels(), load_classes()
    belongs = membership([label_of(name) for name in names], told)
    label_of_output = belongs.argmax(dim=1)
    group_of_output = torch.tensor(
        [told.index(classes[name].group) if name in classes else -1 for name in names]
    )

    def judge(net: nn.Module, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        crops, output, source = batch
        at = crops.device
        if at.type == "cuda" or timed:
            crops = relit(moved(crops.float(), 3.5, 0.04, 1.3), 0.25, 0.25)
        label, group = label_of_output.to(at)[output], group_of_output.to(at)[output]
        drawn = torch.nonzero((source == 1) & (group >= 0))[:, 0]
        other = drawn[torch.randperm(len(drawn), device=at)]
        pair = (group[drawn] == group[other]) & (output[drawn] != output[other])
        drawn, other = drawn[pair], other[pair]
        part = torch.rand(len(drawn), 1, device=at) * (_HALFWAY[1] - _HALFWAY[0]) + _HALFWAY[0]
        whole, figures, taught = torch.zeros((), device=at), {}, None
        for k, one in enumerate(net.nets):
            seen = mixed(one.features, crops)
            between = part * seen[drawn] + (1.0 - part) * seen[other]
            logits = mixed(one.tell, torch.cat([seen, between]))
            plain, folded = logits[: len(crops)], fold(logits, belongs.to(at))
            loss = (
                F.cross_entropy(folded[: len(crops)], label)
                + KINDS_SHARE * F.cross_entropy(plain, output)
                + _BETWEEN * F.cross_entropy(folded[len(crops) :], group[drawn])
            )
            if taught is not None:
                loss = loss + 0.5 * F.kl_div(
                    plain.log_softmax(1), taught, reduction="batchmean", log_target=True
                )
            taught = plain.detach().log_softmax(1)
            whole = whole + loss
            right = (folded[: len(crops)].argmax(1) == label).float().mean()
            figures |= {f"right{k}": right.detach(), f"loss{k}": loss.detach()}
        return whole, figures

    return judge


class Nets(nn.Module):
    """Several sizes trained at once; the first teaches the second."""

    def __init__(self, nets: list[FaceNet]) -> None:
        super().__init__()
        self.nets = nn.ModuleList(nets)


def main() -> None:
    """Command line."""
    options = read_options("Train the classifier of sign faces", steps=23600, decay=7000)
    prepare(options, seed=2)
    faces = load_faces(options.data / "sign-art", options.work / "faces.pkl")
    maker = CropMaker(*face_data(options.data, options.work), faces)
    names = maker.names
    timed = options.seconds > 0.0
    recipe = Recipe(
        "classifier", rate=2.5e-3 if timed else 1.5e-3, weight_decay=0.02 if timed else 2e-3,
        warm_up=300 if timed else 100, mean_steps=500.0 if timed else 200.0, batch=64,
        stored={"labels": names}, serving=SERVING,
    )  # fmt: skip
    wide = tuple(8 * round(1.5 * w / 8) for w in WIDTHS)
    net = Nets([FaceNet(len(names), 432, wide), FaceNet(len(names), HIDDEN)])
    judge = _judged_by(names, timed)
    fit(net, recipe, options, lambda seed: _Stream(maker, 5000 + seed, timed), _batch, judge)


if __name__ == "__main__":
    main()
