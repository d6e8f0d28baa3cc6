"""Train the classifier of sign faces; can be stopped and resumed at any time.

python -m automap.vision.training.train_classifier --data DIR --work DIR --steps 2500 --decay 600
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import time
from pathlib import Path

import cv2
import numpy as np
import torch
from torch.nn import functional as F  # noqa: N812
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from automap.vision.training.art import load_faces
from automap.vision.training.cache import face_data
from automap.vision.training.classifier_data import CropMaker, Image, labels
from automap.vision.training.classifier_net import FaceNet
from automap.vision.training.degrade import tone
from automap.vision.training.ranks import follow, join, share_gradients

BATCH = 64
RATE = 1.5e-3
_SHARES = (0.33, 0.39, 0.16, 0.12)
"""Real signs, drawn classes, unknown faces, no signs."""
_WARM_UP = 100
_MEAN_STEPS = 200.0
_WAITING = 2000


class _Stream(IterableDataset[tuple[Image, int]]):
    def __init__(self, maker: CropMaker, seed: int) -> None:
        self.maker, self.seed = maker, seed

    def __iter__(self):  # type: ignore[no-untyped-def]
        info = get_worker_info()
        rng = np.random.default_rng([self.seed, 0 if info is None else info.id])
        makers = (self.maker.real, self.maker.drawn, self.maker.other, self.maker.nothing)
        waiting: list[tuple[Image, int]] = []
        while True:
            sample = makers[int(rng.choice(4, p=_SHARES))](rng)
            waiting.append(sample)
            yield sample
            if len(waiting) >= _WAITING:
                # every crop serves twice, the second time later and in other light
                image, label = waiting.pop(int(rng.integers(len(waiting))))
                yield tone(image, rng.uniform(0.8, 1.2), rng.uniform(0.8, 1.25), 1.0), label


def _batch(samples: list[tuple[Image, int]]) -> tuple[torch.Tensor, torch.Tensor]:
    images = torch.from_numpy(np.stack([image for image, _ in samples]).transpose(0, 3, 1, 2))
    return images.contiguous(memory_format=torch.channels_last), torch.tensor(
        [label for _, label in samples]
    )


def train(
    data: Path, work: Path, steps: int, decay: int, workers: int, rank: int, ranks: int
) -> None:
    """Train up to ``steps``, from the last checkpoint in ``work`` if there is one."""
    work.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(0)
    faces = load_faces(data / "sign-art", work / "faces.pkl")
    streets, crops = face_data(data, work)
    maker = CropMaker(streets, crops, faces)
    names = labels()
    net = FaceNet(len(names)).to(memory_format=torch.channels_last)
    mean = copy.deepcopy(net)
    optimizer = torch.optim.AdamW(net.parameters(), lr=RATE, weight_decay=2e-3)
    step = 0
    checkpoint = work / "classifier.pt"
    if checkpoint.is_file():
        state = torch.load(checkpoint, weights_only=True)
        net.load_state_dict(state["net"])
        mean.load_state_dict(state["mean"])
        optimizer.load_state_dict(state["optimizer"])
        step = int(state["step"])
    loader = DataLoader(
        _Stream(maker, seed=5000 + step + 100_000 * rank),
        BATCH, num_workers=workers, collate_fn=_batch,
        prefetch_factor=4 if workers else None,
        multiprocessing_context="fork" if workers else None,
    )  # fmt: skip
    join(work / "classifier-meeting", rank, ranks)
    log = (work / "classifier-log.jsonl").open("a", encoding="utf-8")
    started, losses, hits = time.time(), [], []
    for image, label in loader:
        if step >= steps:
            break
        rate = RATE * min(1.0, (step + 1) / _WARM_UP) * min(1.0, max(0.0, (steps - step) / decay))
        for group in optimizer.param_groups:
            group["lr"] = rate
        logits = net(image.float())
        loss = F.cross_entropy(logits, label, label_smoothing=0.02)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        share_gradients(net, ranks)
        optimizer.step()
        step += 1
        follow(mean, net, 1.0 / min(_MEAN_STEPS, step / 5.0 + 1.0))
        losses.append(float(loss.detach()))
        hits.append(float((logits.argmax(1) == label).float().mean()))
        if rank == 0 and (step % 50 == 0 or step == steps):
            row = {"step": step, "loss": round(float(np.mean(losses)), 4),
                   "right": round(float(np.mean(hits)), 4),
                   "seconds": round(time.time() - started)}  # fmt: skip
            print(json.dumps(row), file=log, flush=True)
            losses, hits = [], []
        if rank == 0 and (step % 100 == 0 or step == steps):
            temporary = work / "classifier.pt.tmp"
            torch.save(
                {"net": net.state_dict(), "mean": mean.state_dict(), "labels": names,
                 "optimizer": optimizer.state_dict(), "step": step}, temporary)  # fmt: skip
            os.replace(temporary, checkpoint)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Train the classifier of sign faces")
    parser.add_argument("--data", type=Path, required=True, help="gtsdb, gtsrb and sign-art")
    parser.add_argument("--work", type=Path, required=True, help="checkpoints and log")
    parser.add_argument("--steps", type=int, default=2500)
    parser.add_argument("--decay", type=int, default=600)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rank", type=int, default=0)
    parser.add_argument("--ranks", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    torch.manual_seed(2)
    train(
        options.data, options.work, options.steps, options.decay, options.workers,
        options.rank, options.ranks,
    )  # fmt: skip


if __name__ == "__main__":
    main()
