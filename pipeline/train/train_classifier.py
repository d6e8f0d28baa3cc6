"""Train the classifier of sign faces; can be stopped and resumed at any time.

python -m pipeline.train.train_classifier --data DIR --work DIR

On a graphics processor crops are drawn by ``--workers`` processes and served several times.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

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
from pipeline.train.classifier_net import FaceNet, fold, membership
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
RECIPE = Recipe("classifier", 1.5e-3, 2e-3, warm_up=100, mean_steps=200.0, batch=64)
TIMED = Recipe(
    "classifier", 2.5e-3, 0.02, warm_up=300, mean_steps=500.0, batch=64,
    serving=Serving(size=1024, kept=400_000, fresh=256, shares=SHARES),
)  # fmt: skip
_TEACHER, _TEACHER_HIDDEN, _TAUGHT = (32, 48, 72, 96, 144, 192, 240, 48), 432, 0.5
"""Widths of the teacher, about half as much again, and the weight of what it says in the loss."""
_MOVED, _RELIT = (3.5, 0.04, 1.3), (0.25, 0.25)
BETWEEN, HALFWAY = 0.05, (0.35, 0.65)
"""Weight of the halfway points in the loss, and between which parts of the way they lie. Of 0,
0.08, 0.1, 0.15 and 0.4, tried with the last layers alone in streets to tune on and half of the held
drawings, the first helped foreign faces of no class more, 0.08 to 0.15 Australian ones, and 0.4
named fewer classes."""


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


class Taught(nn.Module):
    """A network and a wider one that is trained beside it and teaches it."""

    def __init__(self, outputs: int) -> None:
        super().__init__()
        self.teacher = FaceNet(outputs, _TEACHER_HIDDEN, _TEACHER)
        self.net = FaceNet(outputs)


def _judged_by(names: list[str]) -> Judge:
    """The loss of the labels as they are used, and for a part of the kinds of unknown faces."""
    belongs = membership([label_of(name) for name in names], labels())
    label_of_output = belongs.argmax(dim=1)

    def judge(net: nn.Module, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        image, output, _ = batch
        logits = net(image.float())
        label = label_of_output[output]
        folded = fold(logits, belongs)
        right = (folded.argmax(1) == label).float().mean()
        kinds = F.cross_entropy(logits, output)
        return F.cross_entropy(folded, label) + KINDS_SHARE * kinds, {"right": right}

    return judge


def _taught_by(names: list[str], device: str) -> Judge:
    """The same for a network and its teacher, whose probabilities the network is to give as well.

    Crops are moved and relit, and halfway points between two drawn classes of one shape and colour,
    in what the convolutions see, are taught as unknown faces of it, as in ``last_layers``. After
    Hinton, Vinyals and Dean 2015, *Distilling the knowledge in a neural network*; both learn at
    once, as in Zhang et al. 2018, *Deep mutual learning*, but one way.
    """
    told, classes = labels(), load_classes()
    belongs = membership([label_of(name) for name in names], told).to(device)
    label_of_output = belongs.argmax(dim=1)
    group_of_output = torch.tensor(
        [told.index(classes[name].group) if name in classes else -1 for name in names]
    ).to(device)

    def judge(net: nn.Module, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        assert isinstance(net, Taught)
        crops, output, source = batch
        crops = relit(moved(crops.float(), *_MOVED), *_RELIT)
        n, label, group = len(crops), label_of_output[output], group_of_output[output]
        drawn = torch.nonzero((source == 1) & (group >= 0))[:, 0]
        other = drawn[torch.randperm(len(drawn), device=device)]
        pair = (group[drawn] == group[other]) & (output[drawn] != output[other])
        one, two = drawn[pair], other[pair]
        low, high = HALFWAY
        part = torch.rand(len(one), 1, device=device) * (high - low) + low
        losses: list[Tensor] = []
        said: list[Tensor] = []
        figures: dict[str, Tensor] = {}
        for which in (net.teacher, net.net):
            seen = mixed(which.features, crops)
            between = part * seen[one] + (1.0 - part) * seen[two]
            logits = mixed(which.tell, torch.cat([seen, between]))
            plain, folded = logits[:n], fold(logits, belongs)
            # a batch may have no halfway point
            unknown = F.cross_entropy(folded[n:], group[one], reduction="sum") / max(len(one), 1)
            kinds = F.cross_entropy(plain, output)
            own = F.cross_entropy(folded[:n], label) + KINDS_SHARE * kinds + BETWEEN * unknown
            said.append(plain.log_softmax(1))
            losses.append(own)
            right = (folded[:n].argmax(1) == label).float().mean()
            figures = {"right": right, "right of the teacher": figures.get("right", right)}
        alike = F.kl_div(said[1], said[0].detach(), reduction="batchmean", log_target=True)
        # one that begins anew beside a network that goes on has nothing to teach at first
        ahead = (losses[0] < losses[1]).float().detach()
        return losses[0] + losses[1] + _TAUGHT * ahead * alike, figures

    return judge


def main() -> None:
    """Command line."""
    options = read_options("Train the classifier of sign faces", steps=23600, decay=7000)
    prepare(options, seed=2)
    faces = load_faces(options.data / "sign-art", options.work / "faces.pkl")
    maker = CropMaker(*face_data(options.data, options.work), faces)
    maker.require_every_class()
    names = maker.names
    timed = options.seconds > 0.0
    recipe = replace(TIMED if timed else RECIPE, stored={"labels": names})
    net = Taught(len(names)) if timed else FaceNet(len(names))
    checkpoint = options.work / "classifier.pt"
    if isinstance(net, Taught) and checkpoint.is_file():
        take_up(net, checkpoint)
    judge = _taught_by(names, options.device) if timed else _judged_by(names)
    fit(net, recipe, options, lambda seed: _Stream(maker, 5000 + seed, timed), _batch, judge)
    if timed:
        keep_taught(checkpoint)


def take_up(taught: Taught, checkpoint: Path) -> None:
    """Let a training go on from a checkpoint of the network alone, whose teacher begins anew, or
    of both."""
    state = torch.load(checkpoint, weights_only=True)["mean"]
    both = any(key.startswith("net.") for key in state)
    (taught if both else taught.net).load_state_dict(state)
    torch.save({"mean": taught.state_dict()}, checkpoint)


def keep_taught(checkpoint: Path) -> None:
    """Leave the network alone in a checkpoint of it and its teacher, and both in one beside it."""
    state = torch.load(checkpoint, weights_only=True)
    torch.save(state, checkpoint.with_stem(f"{checkpoint.stem}-taught"))
    mine = {k.removeprefix("net."): v for k, v in state["mean"].items() if k.startswith("net.")}
    torch.save({**state, "mean": mine}, checkpoint)


if __name__ == "__main__":
    main()
