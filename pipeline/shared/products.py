"""What the stages of a run left in OUT, read so that anything may be missing or damaged."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from automap.errors import AutoMapError, InputError, StageError
from automap.io import names
from automap.io.json_text import parse_json
from automap.records import ClockModel, Fixes, Sign, Trajectory
from automap.review.posts import with_posts_by_hand
from automap.review.reviewed import Renamed, apply_review
from pipeline.shared.run_record import SCHEMA, unlike_record, written_results
from pipeline.shared.values import json_object

if TYPE_CHECKING:
    import pyarrow as pa

T = TypeVar("T")


@dataclass
class RunProducts:
    """Results of one run; None (or an empty table) where a stage wrote nothing.

    ``problems`` holds a sentence for every file that is there and cannot be used.
    """

    out: Path
    trajectory: Trajectory | None = None
    signs: list[Sign] | None = None
    observations: pa.Table | None = None
    fixes: Fixes | None = None
    clock: ClockModel | None = None
    rejected: list[Sign] = field(default_factory=list)
    """Signs that a review took off the map."""
    renamed: Renamed = field(default_factory=Renamed)
    """Views that a review gave to other signs."""
    tracks: Mapping[str, Trajectory] = field(default_factory=dict)
    """Trajectories of the drives of a merged map, by name, thinned."""
    problems: list[str] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    """Of these, the files that the system did not let be read: they may be sound."""
    lost: dict[str, str] = field(default_factory=dict)
    """What is wrong with files that the run wrote and that are missing or damaged, by name."""
    written: Mapping[str, int | None] = field(default_factory=dict)
    """What the run wrote, with sizes, as its record says."""

    @property
    def trajectories(self) -> Mapping[str, Trajectory]:
        """That of the run under the name "", or those of a merged map's drives."""
        return self.tracks if self.trajectory is None else {"": self.trajectory}

    def table(self, name: str, required: tuple[str, ...] = ()) -> pa.Table | None:
        """A Parquet file of OUT, None when it is missing, empty or unreadable."""
        from automap.io.tables import read_table

        return self.attempt(name, lambda path: read_table(path, required))

    def json(self, name: str) -> dict[str, Any]:
        """A JSON object of OUT, empty when it is missing or unreadable."""

        def read(path: Path) -> dict[str, Any]:
            try:
                value = parse_json(path.read_text(encoding="utf-8"))
            except ValueError as error:
                raise ValueError(f"it is damaged ({error}); run the drive again") from None
            if not isinstance(value, dict):
                raise ValueError("it is no JSON object; run the drive again")
            return value

        return self.attempt(name, read) or {}

    def attempt(self, name: str, read: Callable[[Path], T]) -> T | None:
        """What ``read`` makes of a file of OUT; None, with a problem noted, when it cannot."""
        path = self.out / name
        unlike = unlike_record(self.out, self.written, name)
        if not path.is_file():
            if unlike:
                self._note(unlike)
                self.lost[name] = unlike
            return None
        try:
            found = read(path)
        except (AutoMapError, OSError, ValueError, TypeError, KeyError) as error:
            if trouble := _of_the_system(error):
                self.refused.append(f"{path} cannot be read ({trouble.strerror})")
            self._note(f"{name} is left out: {error}")
            self.lost[name] = str(error)
            return None
        if unlike:
            self._note(unlike)
        return found

    def readable(self) -> RunProducts:
        """These; StageError where the system refused a file. A map without what is in it would
        count as current when the disk or the share is well again."""
        if self.refused:
            raise StageError(
                f"{self.refused[0]}; check the disk or the network share and run the same command "
                "again."
            )
        return self

    def _note(self, problem: str) -> None:
        if problem not in self.problems:
            self.problems.append(problem)


def _of_the_system(error: BaseException | None) -> OSError | None:
    """The refusal behind an error; a damaged file is none, and has no number of the system's."""
    while error is not None:
        if isinstance(error, OSError) and error.errno is not None:
            return error
        error = error.__cause__
    return None


def load_products(out: Path, signs: bool = True, fresh: bool = False) -> RunProducts:
    """Read the trajectory, ``signs`` if they are wanted, observations, fixes and clock of OUT. What
    is ``fresh``, this process wrote a moment ago: tracks are read drive by drive where they are
    looked at.

    An adjusted trajectory, where geolocation wrote one, is the one the signs rest on; the map
    shows it. What a review decided about signs is applied to them. Raises InputError for a run of
    another version's form.
    """
    from automap.io.map_tables import TRACKS, StoredTracks, read_tracks
    from automap.io.signs_table import read_signs
    from automap.io.tables import read_fixes
    from automap.io.trajectory_table import read_trajectory

    record = json_object(out / names.RUN)
    if record.get("schema", SCHEMA) != SCHEMA:
        raise InputError(
            f"{out / names.RUN}: schema {record['schema']!r} is not known; this version reads "
            f"{SCHEMA}: use the version that wrote it, or run the drive again with this one."
        )
    products = RunProducts(out, written=written_results(record))
    for name in (names.TRAJECTORY_ADJUSTED, names.TRAJECTORY):
        trajectory = products.attempt(name, read_trajectory)
        if trajectory is not None and len(trajectory):
            products.trajectory = trajectory
            break
    products.tracks = products.attempt(TRACKS, StoredTracks if fresh else read_tracks) or {}
    if signs:
        products.signs = products.attempt(names.SIGNS_RAW, read_signs)
        _apply_review(products)
    products.observations = _renamed(products.table(names.OBSERVATIONS), products.renamed)
    fixes = products.attempt(names.FIXES, read_fixes)
    products.fixes = fixes if fixes is not None and len(fixes) else None
    products.clock = _clock(products)
    if not (out / names.RUN).is_file() and (products.signs or products.trajectories):
        products.problems.append(
            f"{out / names.RUN} is missing, so the country, with it the codes of the classes, and "
            "where the map comes from are not known; copy the whole folder of the run."
        )
    return products


def _apply_review(products: RunProducts) -> None:
    from automap.io.review_json import read_review

    actions = products.attempt(names.REVIEW, read_review)
    if actions:
        reviewed = apply_review(products.signs or [], actions)
        if products.signs is not None or reviewed.signs:
            products.rejected = reviewed.rejected
            products.signs = with_posts_by_hand(reviewed.signs, products.signs or [])
        products.renamed = reviewed.renamed
        products.problems += reviewed.problems


def _renamed(table: pa.Table | None, renamed: Renamed) -> pa.Table | None:
    """The observations under the names that their signs have after a review."""
    import pyarrow as pa

    wanted = ("sign_id", "camera", "frame")
    if table is None or not renamed or any(name not in table.column_names for name in wanted):
        return table
    views = zip(*(table[name].to_pylist() for name in wanted), strict=True)
    some = "drive" in table.column_names
    drives = table["drive"].to_pylist() if some else [""] * len(table)
    ids = [
        renamed.name_of(sign, camera, frame, drive or "") if sign else None
        for (sign, camera, frame), drive in zip(views, drives, strict=True)
    ]
    return table.set_column(table.column_names.index("sign_id"), "sign_id", pa.array(ids))


def _clock(products: RunProducts) -> ClockModel | None:
    from automap.export.clock import clock_from_trajectory
    from automap.io.clock_json import read_clock

    found = products.attempt(names.SYNC, read_clock)
    if products.trajectory is None:
        return found
    return clock_from_trajectory(products.trajectory) or found


def geoid_separation(products: RunProducts, t_ns: np.ndarray) -> np.ndarray | None:
    """Height in m of the geoid above the ellipsoid at host stamps [n], from the fixes.

    Linear in time between fixes and constant beyond them; None when no fix tells it or the
    clock is unknown.
    """
    fixes, clock = products.fixes, products.clock
    if fixes is None or clock is None:
        return None
    known = np.isfinite(fixes.geoid_sep_m) & np.isfinite(fixes.gps_s)
    # one of 0 throughout is none: nobody said above what the heights are
    if not fixes.geoid_sep_m[known].any():
        return None
    order = np.argsort(fixes.gps_s[known], kind="stable")
    times, separation = fixes.gps_s[known][order], fixes.geoid_sep_m[known][order]
    return np.interp(clock.gps_s(np.asarray(t_ns, np.int64)), times, separation)
