"""The loop of both trainings: it can be stopped and resumed at any time.

The rate of learning is constant until ``decay`` steps before the end and then falls to zero,
so a training may be prolonged, or ended early, by resuming it with another number of steps.
The weights that are used are a running mean of the last ones.

On a graphics processor a training has a time in place of steps, over the last part of which the
rate falls to zero, and keeps the weights alone: it begins anew or from weights, and is not resumed.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader, IterableDataset

from pipeline.train.ranks import follow, join, share_gradients
from pipeline.train.served import Serving, served

T = TypeVar("T")
_LOGGED, _STORED = 50, 100
_LOGGED_TIMED, _STORED_S = 250, 20.0
_DECAYING = 0.6
"""Part of a training of a given time over which the rate falls."""
_GOING_ON = 0.6
"""Part of the rate of a training of a given time that goes on from weights. Chosen: a full rate
takes apart what they know, a small one leaves little time for what is new."""


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
    device: str = "cpu"
    seconds: float = 0.0


@dataclass(frozen=True)
class Recipe:
    """How a network called ``name`` is trained.

    ``rate`` of learning after ``warm_up`` steps, ``weight_decay`` and the largest ``norm`` of
    the gradients; ``mean_steps`` of the running mean; ``batch`` samples a step and process;
    ``stored`` beside the weights in the checkpoint; ``serving`` of samples kept on a device.
    """

    name: str
    rate: float
    weight_decay: float
    warm_up: int
    mean_steps: float
    batch: int
    norm: float = float("inf")
    stored: dict[str, Any] = field(default_factory=dict)
    serving: Serving | None = None


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
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--seconds", type=float, default=0.0, help="in place of steps")
    return Options(**vars(parser.parse_args()))


def fit(
    net: nn.Module,
    recipe: Recipe,
    options: Options,
    samples_from: Callable[[int], IterableDataset[T]],
    collate: Callable[[list[T]], Any],
    judge: Callable[[nn.Module, Any], tuple[Tensor, dict[str, Tensor]]],
) -> None:
    """Train up to ``options.steps``, from the last checkpoint in ``options.work`` if any.

    ``samples_from`` the seed of an endless stream, ``collate`` them to a batch; ``judge`` gives
    a batch's loss and further figures for the log.
    """
    checkpoint = options.work / f"{recipe.name}.pt"
    state = torch.load(checkpoint, weights_only=True) if checkpoint.is_file() else {}
    timed = options.seconds > 0.0
    step = 0 if timed else int(state.get("step", 0))
    batches = _batches(samples_from(step + 100_000 * options.rank), recipe, options, collate)
    net = net.to(options.device, memory_format=torch.channels_last)
    if state:
        net.load_state_dict(state.get("net", state["mean"]))
    mean = copy.deepcopy(net)
    optimizer = torch.optim.AdamW(
        net.parameters(),
        lr=recipe.rate,
        weight_decay=recipe.weight_decay,
        fused=options.device.startswith("cuda"),
    )
    if state:
        mean.load_state_dict(state["mean"])
        # weights that were recovered have none
        if "optimizer" in state:
            optimizer.load_state_dict(state["optimizer"])
    join(options.work / f"{recipe.name}-meeting", options.rank, options.ranks)
    rate = recipe.rate * (_GOING_ON if timed and state else 1.0)
    started = stored = time.time()
    seen: list[dict[str, Tensor]] = []
    for batch in batches:
        elapsed = time.time() - started
        if elapsed >= options.seconds if timed else step >= options.steps:
            break
        for group in optimizer.param_groups:
            group["lr"] = rate * rate_share(step, recipe.warm_up, options, elapsed)
        loss, figures = judge(net, batch)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        share_gradients(net, options.ranks)
        torch.nn.utils.clip_grad_norm_(net.parameters(), recipe.norm)
        optimizer.step()
        step += 1
        follow(mean, net, 1.0 / min(recipe.mean_steps, step / 5.0 + 1.0))
        seen.append({"loss": loss.detach(), **figures})
        last = not timed and step == options.steps
        if options.rank == 0 and (step % (_LOGGED_TIMED if timed else _LOGGED) == 0 or last):
            row = {key: round(float(np.mean([float(s[key]) for s in seen])), 4) for key in seen[0]}
            size = len(batch[0]) * options.ranks
            row |= {"batch": size, "seconds": round(time.time() - started)}
            with (options.work / f"{recipe.name}-log.jsonl").open("a", encoding="utf-8") as log:
                print(json.dumps({"step": step, **row}), file=log)
            seen = []
        if timed and time.time() - stored > _STORED_S:
            stored = time.time()
            _store(checkpoint, {"mean": mean.state_dict(), **recipe.stored, "step": step})
        elif not timed and options.rank == 0 and (step % _STORED == 0 or last):
            _store(checkpoint, {"net": net.state_dict(), "mean": mean.state_dict(),
                                **recipe.stored, "optimizer": optimizer.state_dict(),
                                "step": step})  # fmt: skip
    if timed:
        _store(checkpoint, {"mean": mean.state_dict(), **recipe.stored, "step": step})


def mixed(call: Callable[[Tensor], Tensor], x: Tensor) -> Tensor:
    """What a network or a part of it makes of ``x``: in half precision where that is quick."""
    with torch.autocast(x.device.type, torch.bfloat16, enabled=x.is_cuda):
        made = call(x)
    return made.float()


def rate_share(step: int, warm_up: int, options: Options, elapsed: float = 0.0) -> float:
    """The rate of learning at a step, or after ``elapsed`` s, as a share of the full one."""
    if options.seconds > 0.0:
        left = max(0.0, (options.seconds - elapsed) / (_DECAYING * options.seconds))
    else:
        left = max(0.0, (options.steps - step) / max(options.decay, 1))
    return min(1.0, (step + 1) / warm_up) * min(1.0, left)


def prepare(options: Options, seed: int) -> None:
    """Folder, threads and seed of a training."""
    options.work.mkdir(parents=True, exist_ok=True)
    # a pool of threads does not survive the forking of the workers
    cv2.setNumThreads(0)
    torch.set_num_threads(options.threads)
    torch.manual_seed(seed)


def _store(checkpoint: Path, state: dict[str, Any]) -> None:
    temporary = checkpoint.with_suffix(".pt.tmp")
    # what was trained on a device is read where there is none
    here = {k: v.cpu() for k, v in state["mean"].items()}
    torch.save({**state, "mean": here}, temporary)
    os.replace(temporary, checkpoint)


def _batches(
    samples: IterableDataset[T], recipe: Recipe, options: Options,
    collate: Callable[[list[T]], Any],
) -> Iterator[Any]:  # fmt: skip
    workers, serving = options.workers, recipe.serving if options.seconds > 0.0 else None
    size = recipe.batch if serving is None else serving.fresh
    loader = DataLoader(
        samples, size, num_workers=workers, collate_fn=collate,
        prefetch_factor=4 if workers else None,
        # the pictures are shared with the workers, not copied
        multiprocessing_context="fork" if workers else None,
    )  # fmt: skip
    # the workers are there before the device is, whose state must not be forked
    batches = iter(loader)
    return batches if serving is None else served(batches, serving, torch.device(options.device))
