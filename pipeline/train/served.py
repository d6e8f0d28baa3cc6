"""Samples kept on the device and served several times: drawing them is what takes long there."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

Parts = tuple[Tensor, ...]
_READY = 0.02
"""Part of a store that is filled before the first batch."""
_PATIENCE_S = 10.0
"""For the last samples at the end."""


@dataclass(frozen=True)
class Serving:
    """How samples are served: ``size`` of a batch, of which every source has one of ``shares``;
    ``kept`` samples of all sources together, the oldest of which give way; ``fresh`` of them come
    at once. The last part of a batch tells its samples' sources, as numbers, if there are several.
    """

    size: int
    kept: int
    fresh: int
    shares: tuple[float, ...] = (1.0,)


class Store:
    """The last ``kept`` samples of one source, in memory of ``device``."""

    def __init__(self, kept: int, device: torch.device) -> None:
        self._kept, self._device = kept, device
        self._parts: list[Tensor] = []
        self.count = 0
        # of a sample no part may be of another
        self._lock = threading.Lock()

    @property
    def ready(self) -> bool:
        """Whether there is enough to begin with."""
        return self.count >= max(1, int(_READY * self._kept))

    def add(self, parts: Parts) -> None:
        """Take samples in, in the place of the oldest."""
        if not self._parts:
            self._parts = [
                torch.empty((self._kept, *p.shape[1:]), dtype=p.dtype, device=self._device)
                for p in parts
            ]
        first = self.count % self._kept
        place = (torch.arange(len(parts[0])) + first) % self._kept
        where = place.to(self._device)
        there = [part.to(self._device) for part in parts]
        with self._lock:
            for store, part in zip(self._parts, there, strict=True):
                store[where] = part
            self.count += len(place)

    def draw(self, count: int) -> Parts:
        """Any ``count`` of the samples."""
        with self._lock:
            chosen = torch.randint(0, min(self.count, self._kept), (count,), device=self._device)
            return tuple(part[chosen] for part in self._parts)


def served(batches: Iterable[Parts], serving: Serving, device: torch.device) -> Iterator[Parts]:
    """Endless batches on the device, out of stores that ``batches`` go on to fill meanwhile."""
    stores = [Store(max(1, int(serving.kept * share)), device) for share in serving.shares]
    failed: list[BaseException] = []
    ended = threading.Event()
    filling = threading.Thread(target=_fill, args=(batches, stores, failed, ended), daemon=True)
    filling.start()
    counts = [round(serving.size * share) for share in serving.shares]
    try:
        while not all(store.ready for store in stores):
            _raise(failed)
            time.sleep(0.05)
        while True:
            _raise(failed)
            drawn = [store.draw(n) for store, n in zip(stores, counts, strict=True)]
            yield tuple(torch.cat(parts) for parts in zip(*drawn, strict=True))
    finally:
        # a thread that works on while the interpreter goes down takes it along
        ended.set()
        filling.join(_PATIENCE_S)


def _fill(
    batches: Iterable[Parts], stores: list[Store], failed: list[BaseException],
    ended: threading.Event,
) -> None:  # fmt: skip
    try:
        for parts in batches:
            if ended.is_set():
                return
            for source, store in enumerate(stores):
                rows = parts[-1] == source if len(stores) > 1 else None
                store.add(parts if rows is None else tuple(part[rows] for part in parts))
    except BaseException as error:
        failed.append(error)


def _raise(failed: list[BaseException]) -> None:
    if failed:
        raise RuntimeError("no more samples come") from failed[0]
