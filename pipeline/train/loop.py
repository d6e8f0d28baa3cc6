"""The loop of both trainings: it can be stopped and resumed at any time.

The rate of learning is constant until ``decay`` steps before the end and then falls to zero,
so a training may be prolonged, or ended early, by resuming it with another number of steps.
The weights that are used are a running mean of the last ones.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader, IterableDataset

from pipeline.train.ranks import follow, join, share_gradients

T = TypeVar("T")
_LOGGED, _STORED = 50, 100


@dataclass(frozen=True)
class Options:
    """What the command line says."""

    data: Path
    work: Path
    steps: int
    decay: int
    workers: int
    threads: int
    rank: int
    ranks: int


@dataclass(frozen=True)
class Recipe:
    """How a network called ``name`` is trained.

    ``rate`` of learning after ``warm_up`` steps, ``weight_decay`` and the largest ``norm`` of
    the gradients; ``mean_steps`` of the running mean; ``batch`` samples a step and process;
    ``stored`` beside the weights in the checkpoint.
    """

    name: str
    rate: float
    weight_decay: float
    warm_up: int
    mean_steps: float
    batch: int
    norm: float = float("inf")
    stored: dict[str, Any] = field(default_factory=dict)


def read_options(description: str, steps: int, decay: int) -> Options:
    """The command line of a training."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--data", type=Path, required=True, help="gtsdb, gtsrb and sign-art")
    parser.add_argument("--work", type=Path, required=True, help="checkpoints and log")
    parser.add_argument("--steps", type=int, default=steps)
    parser.add_argument("--decay", type=int, default=decay)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rank", type=int, default=0)
    parser.add_argument("--ranks", type=int, default=1)
    return Options(**vars(parser.parse_args()))


def fit(
    net: nn.Module,
    recipe: Recipe,
    options: Options,
    samples_from: Callable[[int], IterableDataset[T]],
    collate: Callable[[list[T]], Any],
    judge: Callable[[nn.Module, Any], tuple[Tensor, dict[str, float]]],
) -> None:
    """Train up to ``options.steps``, from the last checkpoint in ``options.work`` if any.

    ``samples_from`` the seed of an endless stream, ``collate`` them to a batch; ``judge`` gives
    a batch's loss and further figures for the log.
    """
    net = net.to(memory_format=torch.channels_last)
    mean = copy.deepcopy(net)
    optimizer = torch.optim.AdamW(
        net.parameters(), lr=recipe.rate, weight_decay=recipe.weight_decay
    )
    checkpoint = options.work / f"{recipe.name}.pt"
    step = 0
    if checkpoint.is_file():
        state = torch.load(checkpoint, weights_only=True)
        net.load_state_dict(state["net"])
        mean.load_state_dict(state["mean"])
        # weights that were recovered have none
        if "optimizer" in state:
            optimizer.load_state_dict(state["optimizer"])
        step = int(state["step"])
    batches = _loader(samples_from(step + 100_000 * options.rank), recipe.batch, options, collate)
    join(options.work / f"{recipe.name}-meeting", options.rank, options.ranks)
    started = time.time()
    seen: list[dict[str, float]] = []
    for batch in batches:
        if step >= options.steps:
            break
        for group in optimizer.param_groups:
            group["lr"] = recipe.rate * rate_share(step, recipe.warm_up, options)
        loss, figures = judge(net, batch)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        share_gradients(net, options.ranks)
        torch.nn.utils.clip_grad_norm_(net.parameters(), recipe.norm)
        optimizer.step()
        step += 1
        follow(mean, net, 1.0 / min(recipe.mean_steps, step / 5.0 + 1.0))
        seen.append({"loss": float(loss.detach()), **figures})
        last = step == options.steps
        if options.rank == 0 and (step % _LOGGED == 0 or last):
            row = {key: round(float(np.mean([s[key] for s in seen])), 4) for key in seen[0]}
            row |= {"batch": recipe.batch * options.ranks, "seconds": round(time.time() - started)}
            with (options.work / f"{recipe.name}-log.jsonl").open("a", encoding="utf-8") as log:
                print(json.dumps({"step": step, **row}), file=log)
            seen = []
        if options.rank == 0 and (step % _STORED == 0 or last):
            temporary = checkpoint.with_suffix(".pt.tmp")
            torch.save(
                {"net": net.state_dict(), "mean": mean.state_dict(), **recipe.stored,
                 "optimizer": optimizer.state_dict(), "step": step}, temporary)  # fmt: skip
            os.replace(temporary, checkpoint)


def rate_share(step: int, warm_up: int, options: Options) -> float:
    """The rate of learning at a step, as a share of the full one."""
    left = max(0.0, (options.steps - step) / max(options.decay, 1))
    return min(1.0, (step + 1) / warm_up) * min(1.0, left)


def prepare(options: Options, seed: int) -> None:
    """Folder, threads and seed of a training."""
    options.work.mkdir(parents=True, exist_ok=True)
    # a pool of threads does not survive the forking of the workers
    cv2.setNumThreads(0)
    torch.set_num_threads(options.threads)
    torch.manual_seed(seed)


def _loader(
    samples: IterableDataset[T], batch: int, options: Options, collate: Callable[[list[T]], Any]
) -> DataLoader[Any]:
    workers = options.workers
    return DataLoader(
        samples, batch, num_workers=workers, collate_fn=collate,
        prefetch_factor=4 if workers else None,
        # the pictures are shared with the workers, not copied
        multiprocessing_context="fork" if workers else None,
    )  # fmt: skip
