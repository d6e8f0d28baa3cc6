"""Take the mean of the weights of two trainings that have one start.

python -m pipeline.train.mean_weights --data DIR --work DIR --other DIR --share 0.5

Weights that were trained on from others lie in the same valley of the loss, so that those between
them are a network too, which often loses less on what the first knew than it gains on what the
second learned (Wortsman et al. 2022, *Robust fine-tuning of zero-shot models*). The checkpoints in
the work folder (of ``recover``, say) are moved by ``share`` of the way towards those in the other
folder. What the layers between see has other moments than the mean of both, so that these are
measured anew on training pictures. A training that had no picture of a class learns that nothing is
of it: ``--unseen`` names such classes of the other, whose outputs stay those of the work folder.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

import cv2
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import update_bn

from pipeline.train.art import load_faces
from pipeline.train.cache import face_data
from pipeline.train.classifier_data import CropMaker
from pipeline.train.classifier_net import FaceNet
from pipeline.train.detector_data import SampleMaker
from pipeline.train.detector_net import SignNet
from pipeline.train.recover import training_crops, training_pictures

_CROPS, _CROPS_AT_ONCE = 2048, 256
_PICTURES, _PICTURES_AT_ONCE = 256, 64
"""What the moments are taken of: as many at once as spread over all kinds of pictures."""


def between(one: dict[str, Tensor], other: dict[str, Tensor], share: float) -> dict[str, Tensor]:
    """The weights ``share`` of the way from ``one`` to ``other``; counts of steps as in ``one``.

    Raises ValueError where these are not weights of the same network.
    """
    if {k: v.shape for k, v in one.items()} != {k: v.shape for k, v in other.items()}:
        raise ValueError("the checkpoints are of networks with other layers or outputs")
    return {
        name: torch.lerp(value, other[name], share) if value.is_floating_point() else value
        for name, value in one.items()
    }


def with_outputs_of(
    state: dict[str, Tensor], one: dict[str, Tensor], rows: list[int]
) -> dict[str, Tensor]:
    """Weights of a classifier with these rows of its last layer as they are in ``one``."""
    kept = {name: state[name].clone() for name in ("out.weight", "out.bias")}
    for name, value in kept.items():
        value[rows] = one[name][rows]
    return {**state, **kept}


def with_moments(
    net: nn.Module, state: dict[str, Tensor], batches: Iterable[Tensor]
) -> dict[str, Tensor]:
    """The weights ``state`` with the moments of ``batches`` [n, 3, h, w] of 0..255."""
    net.load_state_dict(state)
    update_bn(batches, net)
    net.eval()
    moved: dict[str, Tensor] = net.state_dict()
    return moved


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Mean of the weights of two trainings")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True, help="checkpoints that are moved")
    parser.add_argument("--other", type=Path, required=True, help="checkpoints to move towards")
    parser.add_argument("--share", type=float, required=True, help="of the way, 0 to 1")
    parser.add_argument("--unseen", default="", help="classes that the other never saw")
    options = parser.parse_args()
    if not any((options.other / name).is_file() for name in ("classifier.pt", "detector.pt")):
        parser.error(f"{options.other} holds no classifier.pt and no detector.pt")
    if not 0.0 <= options.share <= 1.0:
        parser.error("--share is from 0 to 1")
    cv2.setNumThreads(0)
    torch.set_num_threads(1)
    faces = load_faces(options.data / "sign-art", options.work / "faces.pkl")
    streets, crops = face_data(options.data, options.work)
    if (options.other / "classifier.pt").is_file():
        maker = CropMaker(streets, crops, faces)
        shown = training_crops(maker, _CROPS).split(_CROPS_AT_ONCE)
        _move(FaceNet(len(maker.names)), "classifier.pt", options, shown)
    if (options.other / "detector.pt").is_file():
        pictures = training_pictures(SampleMaker(streets, faces), _PICTURES)
        shown = pictures.split(_PICTURES_AT_ONCE)
        _move(SignNet(), "detector.pt", options, shown)


def _move(net: nn.Module, name: str, options: argparse.Namespace, shown: Iterable[Tensor]) -> None:
    kept, other = (
        torch.load(folder / name, weights_only=True) for folder in (options.work, options.other)
    )
    if kept.get("labels") != other.get("labels"):
        raise ValueError(f"{options.other / name} has other outputs than that in the work folder")
    state = between(kept["mean"], other["mean"], options.share)
    if isinstance(net, FaceNet):
        unseen, labels = list(filter(None, options.unseen.split(","))), kept["labels"]
        if strangers := set(unseen) - set(labels):
            raise ValueError(f"--unseen: {', '.join(sorted(strangers))}: not a class's name")
        rows = [labels.index(name) for name in unseen]
        state = with_outputs_of(state, kept["mean"], rows)
    state = with_moments(net, state, shown)
    torch.save({**kept, "net": state, "mean": state}, options.work / name)


if __name__ == "__main__":
    main()
