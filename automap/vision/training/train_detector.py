"""Train the sign detector; can be stopped and resumed at any time.

python -m automap.vision.training.train_detector --data DIR --work DIR --steps 4000 --decay 800

The rate of learning is constant until ``decay`` steps before the end and then falls to zero,
so a training may be prolonged, or ended early, by resuming it with another number of steps.
The weights that are used are the running mean of the last thousand steps or so. With
``--ranks N`` as many processes, started with ``--rank`` 0 to N - 1, share the work.
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
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from automap.vision.training.art import load_faces
from automap.vision.training.cache import training_streets
from automap.vision.training.detector_data import Sample, SampleMaker, mirrored
from automap.vision.training.detector_net import SignNet, detection_loss
from automap.vision.training.ranks import follow, join, share_gradients

BATCH = 8
RATE = 2e-3
_WARM_UP = 150
_MEAN_STEPS = 400.0
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


def _rate(step: int, steps: int, decay: int) -> float:
    warm = min(1.0, (step + 1) / _WARM_UP)
    return RATE * warm * min(1.0, max(0.0, (steps - step) / max(decay, 1)))


def train(
    data: Path, work: Path, steps: int, decay: int, workers: int, rank: int, ranks: int
) -> None:
    """Train up to ``steps``, from the last checkpoint in ``work`` if there is one."""
    work.mkdir(parents=True, exist_ok=True)
    # a pool of threads does not survive the forking of the workers
    cv2.setNumThreads(0)
    faces = load_faces(data / "sign-art", work / "faces.pkl")
    streets = training_streets(data, work)
    net = SignNet().to(memory_format=torch.channels_last)
    mean = copy.deepcopy(net)
    optimizer = torch.optim.AdamW(net.parameters(), lr=RATE, weight_decay=1e-3)
    step = 0
    checkpoint = work / "detector.pt"
    if checkpoint.is_file():
        state = torch.load(checkpoint, weights_only=True)
        net.load_state_dict(state["net"])
        mean.load_state_dict(state["mean"])
        optimizer.load_state_dict(state["optimizer"])
        step = int(state["step"])
    loader = DataLoader(
        _Stream(SampleMaker(streets, faces), seed=1000 + step + 100_000 * rank),
        BATCH,
        num_workers=workers,
        collate_fn=_batch,
        prefetch_factor=4 if workers else None,
        # the pictures are shared with the workers, not copied
        multiprocessing_context="fork" if workers else None,
    )
    join(work / "detector-meeting", rank, ranks)
    log = (work / "detector-log.jsonl").open("a", encoding="utf-8")
    started, losses = time.time(), []
    for image, heat, weight, box, near in loader:
        if step >= steps:
            break
        for group in optimizer.param_groups:
            group["lr"] = _rate(step, steps, decay)
        loss = detection_loss(net(image.float()), heat, weight, box, near)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        share_gradients(net, ranks)
        torch.nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimizer.step()
        step += 1
        follow(mean, net, 1.0 / min(_MEAN_STEPS, step / 5.0 + 1.0))
        losses.append(float(loss.detach()))
        if rank == 0 and (step % 50 == 0 or step == steps):
            row = {"step": step, "loss": round(float(np.mean(losses)), 4),
                   "batch": BATCH * ranks, "seconds": round(time.time() - started)}  # fmt: skip
            print(json.dumps(row), file=log, flush=True)
            losses = []
        if rank == 0 and (step % 100 == 0 or step == steps):
            temporary = work / "detector.pt.tmp"
            torch.save(
                {"net": net.state_dict(), "mean": mean.state_dict(),
                 "optimizer": optimizer.state_dict(), "step": step}, temporary)  # fmt: skip
            os.replace(temporary, checkpoint)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Train the sign detector")
    parser.add_argument("--data", type=Path, required=True, help="folder with gtsdb and sign-art")
    parser.add_argument("--work", type=Path, required=True, help="checkpoints and log")
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--decay", type=int, default=800)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rank", type=int, default=0)
    parser.add_argument("--ranks", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    torch.manual_seed(1)
    train(
        options.data, options.work, options.steps, options.decay, options.workers,
        options.rank, options.ranks,
    )  # fmt: skip


if __name__ == "__main__":
    main()
