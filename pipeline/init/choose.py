"""Which of the files that were found are the drive's, and the manifest that says so."""

from __future__ import annotations

import re
from pathlib import Path

from automap.io.table_form import ACCEL, GYRO
from automap.io.table_guess import TableGuess
from pipeline.init import other_logs
from pipeline.init.cameras import Ask, cameras
from pipeline.init.draft import AS_UTC, Draft
from pipeline.init.found import Found

_LOG_KINDS = {
    "ubx": "u-blox messages",
    "nmea": "NMEA sentences",
    "mixed": "u-blox and NMEA messages",
    "rtklib": "an RTKLIB solution",
    "gpx": "a GPX track",
}
_CLOCKS = {"unix": "unix_ns", "gps": "gps_ns"}
_COUNTRY = re.compile(r"[A-Za-z]{2}")


def draft_of(found: Found, folder: Path, ask: Ask | None) -> Draft:
    """The manifest that the files suggest; ``ask`` settles what they do not, where it is given."""
    draft = Draft(folder)
    imu = _choose("inertial readings", [t.path for t in found.of_kind("imu")], "imu.csv", ask)
    guesses = {table.path: table.guesses for table in found.tables}
    if imu is not None:
        _imu(draft, imu, guesses[imu]["imu"], [t.path for t in found.of_kind("imu")])
    else:
        draft.note("imu", "no table of inertial readings was found: the path is the fixes' own")
    _receiver(draft, found, imu, ask)
    _wheels(draft, found, (imu, draft.get("gnss", "file")), ask)
    cameras(draft, found, ask)
    _site(draft, ask)
    return draft


def _choose(what: str, paths: list[Path], usual: str, ask: Ask | None) -> Path | None:
    """The file of several: the one of the usual name, else as the user says, else the largest."""
    named = [path for path in paths if path.name == usual]
    if named or len(paths) < 2:
        return next(iter(named or paths), None)
    if ask is not None:
        answer = ask(f"Several files hold {what}; which is the drive's?", [p.name for p in paths])
        return next(path for path in paths if path.name == answer)
    return max(paths, key=lambda path: path.stat().st_size)


def _imu(draft: Draft, path: Path, guess: TableGuess, candidates: list[Path]) -> None:
    others = [other.name for other in candidates if other != path]
    draft.set("imu", "file", path, "its columns are turn rates and accelerations")
    _beside(draft, "imu", others, "readings")
    draft.set("imu", "axes", "unknown", "how the sensor sits in the vehicle is not in the file")
    clock = "host" if guess.time is None else guess.time.clock
    time = _CLOCKS.get(clock, "boot_ns")
    why = "its stamps count from no date" if time == "boot_ns" else f"its stamps are {clock} time"
    draft.set("imu", "time", time, why)
    for key, triad in (("gyro_unit", GYRO), ("accel_unit", ACCEL)):
        told = {guess.units.get(role) for role in triad}
        unit = told.pop() if len(told) == 1 else None
        if unit is not None:
            draft.set("imu", key, unit, "the names of the columns tell it")
    _form(draft, "imu", guess)


def _wheels(draft: Draft, found: Found, taken: tuple[Path | None, ...], ask: Ask | None) -> None:
    """Speeds of a table that is neither the receiver's nor the IMU's."""
    tables = {
        table.path: table
        for table in found.of_kind("odometer")
        if table.path not in taken and (table.of_car or not {"imu", "gnss"} & set(table.guesses))
    }
    path = _choose("wheel speeds", list(tables), "odometer.csv", ask)
    if path is None:
        return
    of_car = "a car's own computer wrote it, by its other columns"
    why = of_car if tables[path].of_car else "a column is a speed, none is a place"
    draft.set("odometer", "file", path, why)
    guess = tables[path].guesses["odometer"]
    clock = _CLOCKS.get("host" if guess.time is None else guess.time.clock)
    if clock is not None and draft.get("imu", "file") is not None:
        draft.set("odometer", "time", clock, "its stamps have a date")
    _form(draft, "odometer", guess)


def _form(draft: Draft, section: str, guess: TableGuess) -> None:
    """How a table is read, where it does not have our names."""
    form = guess.form
    ours = {role: "t_ns" if role == "t" else role for role in form.columns}
    if dict(form.columns) == ours and (form.separator, form.decimal) == (",", "."):
        return
    draft.set(section, "columns", dict(form.columns), "by the names in the file's header")
    if form.separator != ",":
        draft.set(section, "separator", form.separator, "what stands between the cells")
    if form.decimal != ".":
        draft.set(section, "decimal", form.decimal, "numbers have a decimal comma")
    if form.time_format is not None:
        draft.set(section, "time_format", form.time_format, "by what the times look like")
    if form.units:
        draft.set(section, "units", dict(form.units), "by the names of the columns")
    if form.time_format is not None and guess.time is not None and guess.time.is_local:
        draft.set(section, "utc_offset_h", 0, AS_UTC)
    for doubt in guess.doubts:
        draft.doubt(section, doubt)


def _receiver(draft: Draft, found: Found, imu: Path | None, ask: Ask | None) -> None:
    logs = dict(found.logs)
    tables = {table.path: table.guesses["gnss"] for table in found.of_kind("gnss")}
    usual = next((p.name for p in logs if p.name in ("gnss.ubx", "gnss.nmea", "gnss.pos")), "")
    of_car = {table.path for table in found.tables if table.of_car}
    # a receiver's own words say more than a table of some of them, a table beside the readings is
    # of their clock, and a car's computer tells the places of a receiver last
    candidates = [p for p in tables if p == imu] or [p for p in tables if p not in of_car]
    path = _choose("what a receiver said", list(logs) or candidates or list(tables), usual, ask)
    if path is None:
        draft.note("gnss", "no receiver log and no table of fixes was found")
        return
    if path in logs:
        draft.set("gnss", "file", path, f"it holds {_LOG_KINDS[logs[path]]}")
        for text in other_logs.told(path, [log for log in logs if log != path]):
            draft.doubt("gnss", text)
    else:
        draft.set("gnss", "file", path, "its columns are latitude and longitude")
        _form(draft, "gnss", tables[path])
    others = [other.name for other in tables if other not in (path, imu)]
    _beside(draft, "gnss", others, "fixes")
    arrivals = [table.path for table in found.of_kind("arrival")]
    arrival = _choose("arrival times", arrivals, "gnss_arrival.csv", ask)
    if arrival is not None and path in logs:
        draft.set("gnss", "arrival", arrival, "when the log's bytes came, by their offset")
        clock = draft.get("imu", "time") or "boot_ns"
        draft.set("gnss", "arrival_time", clock, "taken as the clock of the inertial readings")
        draft.note("gnss", "add output_delay_s where the receiver's data sheet tells it")
    elif path == imu:
        clock = draft.get("imu", "time")
        draft.set("gnss", "arrival_time", clock, "rows came by the stamps of the readings beside")
    arm = None if ask is None else _three(ask("IMU to antenna in m, forward right down?", ()))
    if arm is not None:
        draft.set("gnss", "lever_arm_m", arm, "IMU to antenna, forward, right, down: as you said")
    else:
        draft.note("gnss", "measure IMU to antenna and add: lever_arm_m = [forward, right, down]")


def _beside(draft: Draft, section: str, others: list[str], what: str) -> None:
    """That ``others`` than the file that was taken hold the same."""
    if others:
        have = "has" if len(others) == 1 else "have"
        draft.doubt(section, f"not taken: {', '.join(others)}, which {have} {what} too")


def _three(text: str) -> list[float] | None:
    parts = text.replace(",", " ").split()
    try:
        values = [float(part) for part in parts]
    except ValueError:
        return None
    return values if len(values) == 3 and all(abs(v) < 1e3 for v in values) else None


def _site(draft: Draft, ask: Ask | None) -> None:
    country = "" if ask is None else ask("Country (two letters, as DE)?", ())
    if _COUNTRY.fullmatch(country):
        draft.set("site", "country", country.upper(), "as you said: the faces of its signs")
    else:
        draft.note(
            "site", 'add country = "DE", or another of two letters, for the right sign faces'
        )
