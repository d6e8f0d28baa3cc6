"""Train the classifier's last two layers anew, on what the layers before them see of crops.

python -m pipeline.train.last_layers --data DIR --work DIR

Goes on from the classifier's checkpoint in the work folder. What its convolutions see is computed
once and kept there, so that many ways to tell known faces from unknown ones can be tried in minutes
on one core. Beside faces of no class that are drawn, halfway points between two classes of one
shape and colour are taught as unknown faces of it: what lies between classes is none of them
(mixing as Verma et al. 2019, Manifold mixup; as outliers after Hendrycks, Mazeika and Dietterich
2019, Deep anomaly detection with outlier exposure).
"""

from __future__ import annotations

import argparse
import copy
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from automap.records import IntArray
from automap.signs.classes import load_classes
from pipeline.train.art import load_faces
from pipeline.train.cache import face_data
from pipeline.train.classifier_data import CropMaker, label_of, labels
from pipeline.train.classifier_net import FaceNet, fold, membership, trained
from pipeline.train.loop import Options, rate_share
from pipeline.train.ranks import follow
from pipeline.train.train_classifier import BETWEEN, HALFWAY, KINDS_SHARE, SHARES, again

CROPS = 30720
"""Crops that are made; each is seen as it is and once moved, turned and in other light."""
_MADE = (0.16, 0.36, 0.40, 0.08)
"""Shares of real signs, drawn classes, unknown faces and no signs in what is made: the drawn ones
differ more, so that more of them are needed for the shares that training has."""
_AT_ONCE, _CHUNK = 64, 512
_RATE, _DECAY, _BATCH, _STEPS, _WARM_UP, _MEAN_STEPS = 5e-4, 2e-3, 384, 800, 100, 300.0
_SEED, _CROPS_SEED = 0, 1


@dataclass(frozen=True)
class Seen:
    """What the squeezed layer sees of crops [n, 1152], which output each is of [n], and whether it
    is real, drawn, unknown or nothing [n], as 0 to 3."""

    features: Tensor
    output: Tensor
    source: Tensor


class LastLayers(nn.Module):
    """The layers after the squeezed one of a network: features [n, 1152] to logits [n, outputs]."""

    def __init__(self, net: FaceNet) -> None:
        super().__init__()
        self.hidden, self.drop, self.out = net.hidden, net.drop, net.out

    def forward(self, x: Tensor) -> Tensor:
        logits: Tensor = self.out(self.drop(F.relu(self.hidden(x))))
        return logits


def see(net: FaceNet, maker: CropMaker, crops: int) -> Seen:
    """What the network sees of ``crops`` crops, each in two versions."""
    rng = np.random.default_rng(_CROPS_SEED)
    makers = (maker.real, maker.drawn, maker.other, maker.nothing)
    index = {name: i for i, name in enumerate(maker.names)}
    features: list[Tensor] = []
    output: list[int] = []
    source: list[int] = []
    watch = net.hidden.register_forward_hook(lambda _m, i, _o: features.append(i[0].half()))
    for start in range(0, crops, _CHUNK):
        images = []
        for _ in range(min(_CHUNK, crops - start)):
            kind = int(rng.choice(len(makers), p=_MADE))
            image, name = makers[kind](rng)
            images += [image, again(image, rng)]
            output += 2 * [index[name]]
            source += 2 * [kind]
        stack = torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2)
        with torch.no_grad():
            for i in range(0, len(stack), _AT_ONCE):
                net(stack[i : i + _AT_ONCE].float())
    watch.remove()
    return Seen(torch.cat(features), torch.tensor(output), torch.tensor(source))


def between(
    seen: Seen, rows: dict[int, IntArray], count: int, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """Features halfway between two classes of one group, and the label of the group's unknown
    faces; at most ``count``, from the ``rows`` of drawn classes by that label."""
    share = np.array([len(of) for of in rows.values()]) ** 0.5
    mixed, label = [], []
    for (group, of), n in zip(
        rows.items(), rng.multinomial(count, share / share.sum()).tolist(), strict=True
    ):
        a, b = rng.choice(of, n), rng.choice(of, n)
        other = (seen.output[a] != seen.output[b]).numpy()
        part = torch.from_numpy(rng.uniform(*HALFWAY, (int(other.sum()), 1))).float()
        one, two = seen.features[a[other]].float(), seen.features[b[other]].float()
        mixed.append(part * one + (1.0 - part) * two)
        label += len(part) * [group]
    return torch.cat(mixed), torch.tensor(label, dtype=torch.int64)


def rows_by_group(seen: Seen, names: list[str]) -> dict[int, IntArray]:
    """Rows of drawn classes by the label of their group's unknown faces, where it has several."""
    classes, told = load_classes(), labels()
    group = {i: told.index(classes[n].group) for i, n in enumerate(names) if n in classes}
    output = seen.output.numpy()
    drawn = np.flatnonzero(seen.source.numpy() == 1)
    of = np.array([group[int(k)] for k in output[drawn]])
    parts = {int(g): drawn[of == g] for g in np.unique(of)}
    return {g: rows for g, rows in parts.items() if len(np.unique(output[rows])) > 1}


def train(
    layers: LastLayers, seen: Seen, names: list[str], steps: int,
    tell: Callable[[dict[str, float]], object] = print,
) -> LastLayers:  # fmt: skip
    """The layers after ``steps`` of training, as a running mean; ``names`` of the outputs.

    Every hundredth step is told for the log.
    """
    rng = np.random.default_rng(_SEED)
    torch.manual_seed(_SEED)
    belongs = membership([label_of(name) for name in names], labels())
    label_of_output = belongs.argmax(dim=1)
    rows = rows_by_group(seen, names)
    pools = [np.flatnonzero(seen.source.numpy() == kind) for kind in range(len(SHARES))]
    optimizer = torch.optim.AdamW(layers.parameters(), lr=_RATE, weight_decay=_DECAY)
    mean = copy.deepcopy(layers)
    options = Options(Path(), Path(), steps, steps // 2, 0, 1, 0, 1)
    layers.train()
    for step in range(steps):
        for group in optimizer.param_groups:
            group["lr"] = _RATE * rate_share(step, _WARM_UP, options)
        chosen = [rng.choice(pool, int(_BATCH * s)) for pool, s in zip(pools, SHARES, strict=True)]
        batch = torch.from_numpy(np.concatenate(chosen))
        output = seen.output[batch]
        mixed, unknown = between(seen, rows, round(_BATCH * BETWEEN), rng)
        logits = layers(torch.cat([seen.features[batch].float(), mixed]))
        plain, folded = logits[: len(batch)], fold(logits, belongs)
        loss = (
            F.cross_entropy(folded[: len(batch)], label_of_output[output])
            + KINDS_SHARE * F.cross_entropy(plain, output)
            + BETWEEN * F.cross_entropy(folded[len(batch) :], unknown)
        )
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        follow(mean, layers, 1.0 / min(_MEAN_STEPS, step / 5.0 + 1.0))
        if (step + 1) % 100 == 0:
            told = round(float(loss.detach()), 4)
            tell({"last layers, step": step + 1, "loss": told, "batch": _BATCH})
    mean.eval()
    return mean


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Train the classifier's last layers anew")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=_STEPS)
    options = parser.parse_args()
    cv2.setNumThreads(0)
    torch.set_num_threads(1)
    checkpoint = options.work / "classifier.pt"
    state = torch.load(checkpoint, weights_only=True)
    net, kept = trained(state), options.work / "face-features.pt"
    if kept.is_file():
        seen = Seen(*torch.load(kept, weights_only=True))
    else:
        faces = load_faces(options.data / "sign-art", options.work / "faces.pkl")
        seen = see(net, CropMaker(*face_data(options.data, options.work), faces), CROPS)
        torch.save((seen.features, seen.output, seen.source), kept)
    rows: list[dict[str, float]] = []
    layers = train(LastLayers(net), seen, state["labels"], options.steps, rows.append)
    net.hidden, net.out = layers.hidden, layers.out
    kept_too = {"labels": state["labels"], "step": state["step"]}
    torch.save({"net": net.state_dict(), "mean": net.state_dict(), **kept_too}, checkpoint)
    with (options.work / "classifier-log.jsonl").open("a", encoding="utf-8") as log:
        log.writelines(f"{json.dumps(row)}\n" for row in rows)


if __name__ == "__main__":
    main()
