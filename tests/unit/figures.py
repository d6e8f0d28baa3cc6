"""Results as figures: what a computation gives, small enough to be kept and compared.

``python -m tests.unit.figures`` writes those of all scenarios anew, for who changes results on
purpose; ``CHANGELOG.md`` says by how much. Where those of a stage move, its version has to be
raised first: results that its code of before wrote would count as current.
"""

from __future__ import annotations

import importlib
import json
import zlib
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

FOLDER = Path(__file__).parent / "figures"
KEPT_FOR = Path(__file__).parent / "figure_versions.json"
"""Of each file of figures its checksum, and the version of its stage that it is of."""
STAGES = {
    "ingest": "ingest",
    "sync": "sync",
    "fusion": "fuse",
    "kernels": "fuse",
    "calibration": "fuse",
    "geolocation": "geolocate",
    "mapping": "merge",
}
"""The stage whose results move with the figures whose name begins so."""
Figure = str | list[float]


def figures_of(result: Any) -> dict[str, Figure]:
    """The figures of a result by the place where they stand in it.

    Of an array its size, its root mean square and two sums with weights that no permutation and
    no sign leaves alone; of anything that is no number its text.
    """
    return dict(_walk("", result))


def _walk(place: str, value: Any) -> Iterator[tuple[str, Figure]]:
    if is_dataclass(value) and not isinstance(value, type):
        for item in fields(value):
            yield from _walk(f"{place}.{item.name}", getattr(value, item.name))
    elif callable(value):
        return  # what is computed only when it is asked for
    elif isinstance(value, dict):
        for key, each in value.items():
            yield from _walk(f"{place}.{key}", each)
    elif isinstance(value, bool | int | float | complex | np.ndarray | np.generic) or (
        isinstance(value, list | tuple)
        and value
        and all(isinstance(v, int | float | np.number) for v in value)
    ):
        array = np.asarray(value)
        if array.dtype == object or array.dtype.kind in "US":
            yield place, " ".join(map(str, array.ravel().tolist()))
            return
        yield place, _sums(array)
    elif isinstance(value, list | tuple):
        yield place, f"{len(value)} of them"
        for k, each in enumerate(value):
            yield from _walk(f"{place}.{k}", each)
    else:
        yield place, str(value)


def _sums(array: np.ndarray) -> list[float]:
    if array.dtype.kind == "c":
        array = np.concatenate([array.real.ravel(), array.imag.ravel()])
    flat = array.ravel().astype(np.float64)
    known = np.isfinite(flat)
    number = np.arange(len(flat))[known]
    x = flat[known]
    rms = float(np.sqrt(np.mean(x**2))) if len(x) else 0.0
    sums = [float(np.cos(1.0 + 0.7 * number) @ x), float(np.cos(2.0 + 1.9 * number) @ x)]
    return [float(len(flat)), float(len(x)), rms, *sums]


def differences(found: dict[str, Figure], kept: dict[str, Figure], rel: float) -> list[str]:
    """The places at which figures differ by more than ``rel`` of their size."""
    told = [f"{place}: there or not" for place in sorted(found.keys() ^ kept.keys())]
    for place in found.keys() & kept.keys():
        a, b = found[place], kept[place]
        if isinstance(a, str) or isinstance(b, str):
            same = a == b
        else:
            size = rel * b[2] * max(1.0, b[1]) ** 0.5 + 1e-12
            same = a[:2] == b[:2] and bool(np.all(np.abs(np.subtract(a, b)[2:]) <= size))
        if not same:
            told.append(f"{place}: {a} in place of {b}")
    return told


def kept(name: str) -> dict[str, Figure]:
    """The figures of a scenario as they were."""
    found: dict[str, Figure] = json.loads((FOLDER / f"{name}.json").read_text())
    return found


def stage_version(name: str) -> int | None:
    """The version of the stage that the figures are of; None where they are of none."""
    stage = STAGES.get(name.partition("_")[0])
    if stage is None:
        return None
    if stage == "merge":
        from pipeline.merge.cell_files import STEPS_VERSION

        return STEPS_VERSION
    found: int = importlib.import_module(f"pipeline.run.stages.{stage}").STAGE.version
    return found


def checksum(name: str) -> int:
    """Of a file of figures."""
    return zlib.crc32((FOLDER / f"{name}.json").read_bytes())


def not_raised(name: str, versions: dict[str, list[int]]) -> str | None:
    """What is to be done where figures moved and the version of their stage did not."""
    now = stage_version(name)
    if now is None or name not in versions:
        return None
    before, version = versions[name]
    if checksum(name) == before or now > version:
        return None
    return (
        f"the figures {name} moved: raise the version {now} of the stage "
        f"{STAGES[name.partition('_')[0]]}, so that older results are made again, then keep them "
        "by `python -m tests.unit.figures` (or with --same-results where only the scenario moved)"
    )


def main() -> None:
    """Write the figures of all scenarios, or of those named."""
    import sys

    from tests.unit.scenarios import SCENARIOS

    FOLDER.mkdir(exist_ok=True)
    scenarios: dict[str, Callable[[], Any]] = SCENARIOS
    names = [word for word in sys.argv[1:] if word != "--same-results"] or sorted(scenarios)
    versions: dict[str, list[int]] = json.loads(KEPT_FOR.read_text())
    told = []
    for name in names:
        lines = (
            f"{json.dumps(k)}: {json.dumps(v)}" for k, v in figures_of(scenarios[name]()).items()
        )
        (FOLDER / f"{name}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")
        said = None if "--same-results" in sys.argv else not_raised(name, versions)
        now = stage_version(name)
        if said is not None:
            told.append(said)
        elif now is not None and versions.get(name, [None])[0] != checksum(name):
            versions[name] = [checksum(name), now]
    rows = (f"{json.dumps(name)}: {json.dumps(versions[name])}" for name in sorted(versions))
    KEPT_FOR.write_text("{\n" + ",\n".join(rows) + "\n}\n")
    sys.exit("\n".join(told) or None)


if __name__ == "__main__":
    main()
