"""The drives of a store, run on Dask: one drive is one task, and nothing is known but the store."""

from __future__ import annotations

import importlib.util
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import ConfigError, StageError
from automap.io.trust import allowed_folders
from pipeline.fleet.fork_server import end_idle
from pipeline.fleet.orders import Order, key_of
from pipeline.fleet.store import ASIDE, Entry, Store
from pipeline.fleet.task import Result, run_task
from pipeline.shared.interrupts import told_to_end
from pipeline.shared.progress import Progress

if TYPE_CHECKING:
    from pipeline.settings.load import Settings

TRIES = 3
"""Of a drive whose files could not be read, or that lacked memory or room for temporary files: what
a network does for a moment it does not do three times in the minutes between."""
LOST = 10
"""A drive whose worker or process was ended from outside is done again so often: that is not its
fault, but a drive that ends its machine must not go round for ever."""
PATIENCE = "20s"
"""For a scheduler to answer."""
_LOOK_S = 0.1
"""How often Dask looks itself whether a drive is done."""
MORE = 2
"""Times the memory, for a drive that lacked it."""


@dataclass
class Ran:
    """Digests of drives that were ``done``, those put ``aside`` with the reason, those that wait
    since their folders are ``away``, likewise, and those of them that are done whose path is
    ``doubtful`` or worse."""

    done: list[str] = field(default_factory=list)
    aside: dict[str, str] = field(default_factory=dict)
    away: dict[str, str] = field(default_factory=dict)
    doubtful: list[str] = field(default_factory=list)
    seconds: float = 0.0


@dataclass
class _Try:
    entry: Entry
    order: Order
    tries: int = 0
    lost: int = 0


def order_for(store: Store, settings: Settings, memory: int) -> Order:
    """What every drive of the store is to be run with."""
    outside = tuple(str(folder) for folder in allowed_folders())
    return Order(settings.echo(), key_of(settings), outside, memory)


def fitting_workers(memory: int) -> int:
    """How many drives this machine runs at once: by its cores and its memory."""
    cores = len(os.sched_getaffinity(0))
    free = 0
    for line in Path("/proc/meminfo").read_text().splitlines():
        if line.startswith("MemAvailable:"):
            free = int(line.split()[1]) * 1024
    return max(1, min(cores, free // memory))


def run(
    store: Store,
    order: Order,
    scheduler: str | None = None,
    workers: int | None = None,
    progress: Progress = lambda fraction, text: None,
    say: Callable[[str], None] = lambda text: None,
    task: Callable[[str, str, str, Order], Result] = run_task,
) -> Ran:
    """Run the drives that wait; a drive that fails for good is put aside with the reason.

    Without ``scheduler`` ``workers`` drives at a time on this machine. Raises StageError where the
    store cannot be written to or the scheduler is gone, ConfigError without Dask.
    """
    entries = store.entries()
    for name in store.leftovers(entries, order.key):
        store.place.remove(name)
    waiting = [entry for entry in entries if entry.state(order.key) == "waiting"]
    # a long one that came last would have one worker alone
    waiting.sort(key=lambda entry: -entry.size)
    ran = Ran()
    if not waiting:
        return ran
    started = time.monotonic()
    number = min(workers or fitting_workers(order.memory), len(waiting))
    with _client(scheduler, number) as client:
        if client.dashboard_link and importlib.util.find_spec("bokeh"):
            say(f"Dask's dashboard: {client.dashboard_link}")
        _Round(store, client, progress, task, ran, sum(e.size for e in waiting) or 1).run(
            [_Try(entry, order) for entry in waiting]
        )
    ran.seconds = time.monotonic() - started
    return ran


@dataclass
class _Round:
    store: Store
    client: Any
    progress: Progress
    task: Callable[[str, str, str, Order], Result]
    ran: Ran
    size: int
    gone: int = 0
    later: list[_Try] = field(default_factory=list)

    def run(self, tries: Sequence[_Try]) -> None:
        """All of them, then those that need more memory one at a time, as a machine has it."""
        self._at_once(tries)
        while self.later:
            self._at_once([self.later.pop(0)])

    def _at_once(self, tries: Sequence[_Try]) -> None:
        from distributed import as_completed

        running = {self._submit(one): one for one in tries}
        futures = as_completed(list(running), loop=self.client.loop)
        while running:
            ready = futures.has_ready()
            if told_to_end.wait(0.0 if ready else _LOOK_S):
                raise KeyboardInterrupt
            if not ready:
                continue
            future = next(futures)
            one = running.pop(future)
            result = self._result(future, one)
            again = self._settled(one, result)
            if again is not None:
                fresh = self._submit(again)
                running[fresh] = again
                futures.add(fresh)

    def _submit(self, one: _Try) -> Any:
        entry = one.entry
        return self.client.submit(
            self.task, self.store.place.url, entry.digest, entry.path, one.order,
            # by the first word Dask sees that all are alike, and hands each worker what it does
            # next; else it would hand out all of them at once, count the end of a worker against
            # every drive that waits there, and remember a kind of task for each drive
            key=f"drive-{entry.digest}-{one.order.key[:8]}-{one.tries}-{one.lost}-{time.time_ns()}",
            # what is submitted within a moment comes in no order
            pure=False, priority=entry.size,
        )  # fmt: skip

    def _result(self, future: Any, one: _Try) -> Result:
        from concurrent.futures import CancelledError

        from distributed import KilledWorker
        from distributed.comm import CommClosedError

        try:
            result: Result = future.result()
        except KilledWorker:
            return Result(one.entry.digest, "lost", f"{one.entry.path}: its workers were ended.")
        except (CancelledError, CommClosedError):
            raise StageError(
                "the scheduler is gone; start it again, and the same command goes on from here."
            ) from None
        except OSError as error:
            return Result(one.entry.digest, "io", f"{one.entry.path}: {error}")
        return result

    def _settled(self, one: _Try, result: Result) -> _Try | None:
        """Take a result in; the drive once more where it is to be done again at once."""
        digest, tried = one.entry.digest, one.tries + 1
        if result.kind == "store" or (result.kind == "full" and tried == TRIES):
            raise StageError(
                f"{result.error} What is done stays, and the same command goes on from here."
            )
        if result.kind == "lost" and one.lost + 1 < LOST:
            return _Try(one.entry, one.order, one.tries, one.lost + 1)
        if result.kind in ("io", "full", "away") and tried < TRIES:
            return _Try(one.entry, one.order, tried, one.lost)
        if result.kind == "memory" and tried < TRIES:
            order = one.order
            if one.tries == 0:
                more = MORE * order.memory
                order = Order(order.echo, order.key, order.outside, more)
            self.later.append(_Try(one.entry, order, tried, one.lost))
            return None
        if result.kind == "done":
            self.ran.done.append(digest)
            if result.doubtful:
                self.ran.doubtful.append(digest)
        elif result.kind == "away":
            self.ran.away[digest] = result.error
        else:
            self.ran.aside[digest] = result.error
            told = {"kind": result.kind, "error": result.error, "tries": tried + one.lost}
            self.store.mark(digest, ASIDE, told)
        self.gone += one.entry.size
        left = f"{len(self.ran.done)} done, {len(self.ran.aside)} put aside"
        self.progress(self.gone / self.size, left)
        return None


@contextmanager
def _client(scheduler: str | None, workers: int) -> Iterator[Any]:
    if importlib.util.find_spec("distributed") is None:
        raise ConfigError(
            "automap fleet run needs Dask; install it with pip install 'automap[fleet]'."
        )
    import dask
    from distributed import Client, LocalCluster

    quiet = {"logging.distributed": "error", "distributed.scheduler.allowed-failures": LOST}
    with dask.config.set(quiet):
        if scheduler is not None:
            try:
                client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
            except (OSError, ValueError) as error:
                raise ConfigError(
                    f"--scheduler {scheduler}: no scheduler answers there ({error}); start one "
                    "with dask scheduler."
                ) from None
            with client:
                yield client
            return
        # every drive is a process by itself: the workers need not be
        with (
            LocalCluster(
                n_workers=1, threads_per_worker=workers, processes=False, memory_limit=0,
                # without bokeh too there are servers, which else listen to the whole network
                dashboard_address="127.0.0.1:0", worker_dashboard_address="127.0.0.1:0",
                silence_logs=40,
            ) as cluster,
            Client(cluster, set_as_default=False) as client,
        ):  # fmt: skip
            try:
                yield client
            finally:
                end_idle()
