"""One drive in a process of its own, which ``pipeline/fleet/fork_server.py`` forks.

It ends when its worker ends, however that ends, and by itself writes nothing but ``OUT`` and the
answer.
"""

from __future__ import annotations

import errno
import json
import math
import os
import resource
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import AutoMapError
from automap.io.atomic import write_json

if TYPE_CHECKING:
    from automap.mapping.sightings import DriveSigns

FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS})
"""What it says of a disk on which nothing can be written."""
PASSING = frozenset(
    {
        *(errno.EIO, errno.ESTALE, errno.ETIMEDOUT),
        *(errno.ECONNRESET, errno.ECONNREFUSED, errno.ENOTCONN, errno.EHOSTUNREACH),
        *(errno.ENETUNREACH, errno.EMFILE, errno.ENFILE, errno.EBUSY, errno.EAGAIN),
    }
)
"""What a machine or a network does to a file, not what is wrong with a drive."""


def kind_of(error: BaseException) -> str:
    """``memory``, ``full`` where it could not be written, ``io`` for what may pass, else ``data``:
    it will be the same every time."""
    link: BaseException | None = error
    while link is not None:
        if isinstance(link, MemoryError):
            return "memory"
        if isinstance(link, OSError) and link.errno in FULL:
            return "full"
        if isinstance(link, OSError) and link.errno in PASSING:
            return "io"
        link = link.__cause__ or link.__context__
    return "data"


def run_one(drive: Path, out: Path, echo: dict[str, Any]) -> dict[str, Any]:
    """Run a drive to ``out`` and say what came of it, as JSON has it."""
    from pipeline.merge.inputs import read_run
    from pipeline.run.registry import ORDER, load_stages
    from pipeline.run.runner import Request, run_drive
    from pipeline.settings.load import settings_of_echo
    from pipeline.shared.verdicts import KEYS

    started, processor = time.monotonic(), time.process_time()
    settings = settings_of_echo(echo, "the store's settings")
    outcome = run_drive(drive, out, Request(load_stages(), ORDER, settings))
    if outcome.error is not None:
        return {"kind": kind_of(outcome.error), "error": str(outcome.error)}
    try:
        run = read_run(out)
    except AutoMapError as error:
        return {"kind": kind_of(error), "error": str(error)}
    path = run.signs.path
    record = outcome.record
    return {
        "name": outcome.name,
        "recording": run.signs.key,
        "marks": None if run.candidate.marks is None else run.candidate.marks.told(),
        "country": run.country,
        "signs": len(run.signs),
        "start_gps_s": run.signs.start_gps_s,
        "hours": 0.0 if path is None else (path.gps_s[-1] - path.gps_s[0]) / 3600.0,
        "km": 0.0 if path is None else _length_km(path),
        "cell": begin_of(run.signs),
        "sd_m": None if path is None else _typical_sd(path),
        **{key: record.get(key) for key in KEYS.values()},
        "warnings": record.get("warnings", []),
        "automap": record.get("automap"),
        "seconds": time.monotonic() - started,
        "processor_s": time.process_time() - processor,
        "peak_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
    }


def begin_of(signs: DriveSigns) -> str:
    """The cell where a drive began, "" unknown: drives that are put into cells together should lie
    together."""
    import numpy as np

    from automap.mapping.cells import cell_of, quadkey

    lat, lon = (
        (signs.lat_rad, signs.lon_rad)
        if signs.path is None
        else (signs.path.lat_rad, signs.path.lon_rad)
    )
    known = np.flatnonzero(np.isfinite(lat) & np.isfinite(lon))[:1]
    return "".join(map(quadkey, cell_of(lat[known], lon[known]).tolist()))


def _length_km(path: Any) -> float:
    import numpy as np

    from automap.earth import metres_per_radian

    north, east = metres_per_radian(path.lat_rad[:-1], 0.0)
    steps = np.hypot(np.diff(path.lat_rad) * north, np.diff(np.unwrap(path.lon_rad)) * east)
    return float(steps.sum()) / 1000.0


def _typical_sd(path: Any) -> list[float | None]:
    import numpy as np

    middle = np.nanmedian(path.sd_enu, axis=0).tolist()
    return [value if math.isfinite(value) else None for value in middle]


def _end_with_parent() -> None:
    while os.read(0, 1):
        pass
    os._exit(1)


def answer(path: Path) -> None:
    """Do what the request in a file says and write the answer."""
    # the worker holds the other end and says nothing meanwhile
    threading.Thread(target=_end_with_parent, daemon=True).start()
    request = json.loads(path.read_text(encoding="utf-8"))
    from automap.io.trust import allowing

    with allowing([Path(folder) for folder in request["outside"]]):
        said = run_one(Path(request["drive"]), Path(request["out"]), request["settings"])
    write_json(Path(request["answer"]), said)
