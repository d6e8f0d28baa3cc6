"""RTKLIB solution files (.pos) in all their forms of time and position.

Reference: RTKLIB 2.4.2 manual, appendix B.1; solution.c of RTKLIB (outpos, outecef, outenu,
outsolheads), velocity columns as RTKLIB demo5 writes them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap import timebase as tb
from automap.earth import ecef_axes
from automap.errors import InputError
from automap.io.kernel import Kernel
from automap.io.scan_kernel import Bytes
from automap.records import NO_TIME, Fixes, FixType, FloatArray, IntArray

_MAX_TOKENS = 40
_JST_S = 9 * 3600.0

QUALITY = np.array(
    [
        FixType.NONE,
        FixType.FIXED,
        FixType.FLOAT,
        FixType.DGNSS,  # SBAS
        FixType.DGNSS,
        FixType.THREE_D,  # single
        FixType.FLOAT,  # PPP: converging carrier phase without fixed ambiguities
        FixType.DEAD_RECKONING,
    ],
    np.int64,
)

_FIRST_LINE = re.compile(
    rb"\s*(\d{4}/\d{1,2}/\d{1,2}[\s,;]+\d{1,2}:\d{1,2}:\d|\d{3,4}[\s,;]+\d{1,6}(\.\d+)?[\s,;]+-?\d)"
)


def looks_like_pos(data: bytes) -> bool:
    """Whether a file begins as an RTKLIB solution does: a ``%`` header or a dated row."""
    for line in data[:4096].split(b"\n")[:40]:
        if line.strip():
            return line.lstrip().startswith(b"%") or _FIRST_LINE.match(line) is not None
    return False


@dataclass(frozen=True)
class _Form:
    """How the rows of a file are written."""

    utc_offset_s: float | None  # None: GPS time
    calendar: bool
    position: str  # llh, dms, xyz, enu
    geodetic: bool
    reference: tuple[float, float, float] | None  # rad, rad, m


@Kernel
def _tokens_kernel(
    data: Bytes, values: FloatArray, count: npt.NDArray[np.int32], offset: IntArray
) -> int:
    """Numbers of each row that is no comment; returns the number of rows.

    Blanks, control characters, commas and semicolons separate, and so do the slashes and
    colons of a calendar time. What is no number becomes NaN. The sign of -0 is kept, as an
    angle of -0 degrees and some minutes needs it.
    """
    n = len(data)
    i = 0
    row = 0
    while i < n:
        start = i
        while i < n and (data[i] == 32 or data[i] == 9 or data[i] == 13):
            i += 1
        if i >= n:
            break
        if data[i] == 10:
            i += 1
            continue
        if data[i] == 37 or data[i] == 35:
            while i < n and data[i] != 10:
                i += 1
            continue
        offset[row] = start
        tokens = 0
        while i < n and data[i] != 10:
            c = data[i]
            if c <= 32 or c == 44 or c == 59 or c == 47 or c == 58:
                i += 1
                continue
            mantissa = 0.0
            scale = 1.0
            digits = 0
            negative = False
            point = False
            number = True
            first = i
            while i < n:
                c = data[i]
                if c <= 32 or c == 44 or c == 59 or c == 47 or c == 58:
                    break
                digit = c - 48
                if 0 <= digit <= 9:
                    if digits < 17:
                        mantissa = mantissa * 10.0 + digit
                        digits += 1
                        if point:
                            scale *= 10.0
                    elif not point:
                        number = False
                elif c == 46 and not point:
                    point = True
                elif (c == 45 or c == 43) and i == first:
                    negative = c == 45
                else:
                    number = False
                i += 1
            if tokens < _MAX_TOKENS:
                if number and digits > 0:
                    value = mantissa / scale
                    values[row, tokens] = -value if negative else value
                else:
                    values[row, tokens] = np.nan
            tokens += 1
        count[row] = tokens
        row += 1
    return row


def decode_pos(data: bytes, name: str) -> tuple[Fixes, list[str], str | None, int]:
    """Fixes of an RTKLIB solution, warnings, what was cut off at the end, rows not read.

    ``name`` stands for the file in messages. Raises InputError when there is no row, or when
    positions are baselines from a base station that the header does not give.
    """
    raw = np.frombuffer(data, np.uint8)
    capacity = int(np.count_nonzero(raw == 10)) + 1
    values = np.full((capacity, _MAX_TOKENS), np.nan)
    count = np.zeros(capacity, np.int32)
    offset = np.zeros(capacity, np.int64)
    rows = _tokens_kernel.run(len(raw), raw, values, count, offset)
    if rows == 0:
        raise InputError(
            f"{name}: an RTKLIB solution without any position; "
            "look in RTKLIB's trace for why nothing was solved"
        )
    values, count, offset = values[:rows], count[:rows], offset[:rows]
    header = _header(data)
    warnings: list[str] = []
    first = data[int(offset[0]) :].split(b"\n", 1)[0]
    form = _form(header, first, values[0], name, warnings)

    time_tokens = 6 if form.calendar else 2
    position_tokens = 7 if form.position == "dms" else 3
    least = time_tokens + position_tokens
    needed = np.isfinite(values[:, :least])
    if form.position in ("llh", "dms"):
        # a receiver without a height says nan there, which is no damage
        for row in np.flatnonzero(~needed[:, -1] & (count >= least)).tolist():
            needed[row, -1] = _nth(data, int(offset[row]), least - 1) == b"nan"
    good = (count >= least) & needed.all(axis=1)
    truncated = None
    usual = int(np.median(count))
    if not data.endswith(b"\n") and count[-1] < usual:
        truncated = f"the last row, at byte {offset[-1]}, is cut off"
        good[-1] = False
    bad = np.flatnonzero(~good)
    if truncated is not None:
        bad = bad[bad != rows - 1]
    if len(bad):
        line = data.count(b"\n", 0, int(offset[bad[0]])) + 1
        warnings.append(f"{len(bad)} rows cannot be read, the first in line {line}")
    if not good.any():
        raise InputError(
            f"{name}: none of its {rows} rows reads as time and position; "
            "it is not an RTKLIB solution, or its format is unknown"
        )
    values, offset = values[good], offset[good]
    fixes = _fixes(values, offset, time_tokens, position_tokens, form)
    return fixes, warnings, truncated, len(bad)


def _nth(data: bytes, start: int, place: int) -> bytes:
    """What stands in place ``place`` of the row that begins at ``start``, in small letters; cells
    are parted as the kernel parts them."""
    row = data[start : data.find(b"\n", start) + 1 or None]
    cells: list[bytes] = re.findall(rb"[^\x00-\x20,;/:]+", row)
    return cells[place].lower()


def _header(data: bytes) -> list[str]:
    lines = []
    for line in data[:65536].split(b"\n"):
        text = line.strip()
        if text and not text.startswith((b"%", b"#")):
            break
        if text:
            lines.append(text.decode("ascii", "replace").lstrip("%# \t"))
    return lines


def _form(
    header: list[str], first: bytes, row: FloatArray, name: str, warnings: list[str]
) -> _Form:
    calendar = b"/" in first
    columns = next((h for h in header if re.match(r"(GPST|UTC|JST)\b", h)), "")
    note = next((h for h in header if h.startswith("(") and "=" in h), "")
    start = 6 if calendar else 2
    if "d'" in columns:
        position = "dms"
    elif "x-ecef" in columns or "x/y/z-ecef" in note:
        position = "xyz"
    elif "e-baseline" in columns or "e/n/u-baseline" in note:
        position = "enu"
    elif (
        not columns
        and np.all(np.abs(row[start : start + 3]) < 1e8)
        and (np.linalg.norm(row[start : start + 3]) > 6e6)
    ):
        position = "xyz"
    else:
        position = "llh"
    datum = re.search(r"=\s*([A-Za-z0-9]+)", note)
    if datum and datum.group(1).upper() != "WGS84":
        warnings.append(f"positions are on the datum {datum.group(1)} and taken as WGS-84")
    reference = None
    if position == "enu":
        reference = _reference(header)
        if reference is None:
            raise InputError(
                f"{name}: positions are baselines (e, n, u) and the header gives no `ref pos`; "
                "write the solution as latitude, longitude, height"
            )
    if not columns:
        warnings.append("no column header: times are taken as GPS time")
    utc_offset = {"UTC": 0.0, "JST": _JST_S}.get(columns[:3])
    return _Form(utc_offset, calendar, position, "geodetic" in note, reference)


def _reference(header: list[str]) -> tuple[float, float, float] | None:
    """Base station as latitude, longitude (rad), ellipsoidal height; None when not given."""
    line = next((h for h in header if h.startswith("ref pos")), None)
    if line is None or ":" not in line:
        return None
    try:
        numbers = [float(t) for t in re.split(r"[\s,;]+", line.split(":", 1)[1].strip())]
    except ValueError:
        return None
    if len(numbers) == 7:
        angles = _from_dms(np.asarray([numbers]))
        return float(angles[0, 0]), float(angles[0, 1]), numbers[6]
    if len(numbers) != 3:
        return None
    if np.linalg.norm(numbers) > 6e6:
        import pymap3d

        lat, lon, height = pymap3d.ecef2geodetic(*numbers, deg=False)
        return float(lat), float(lon), float(height)
    return float(np.radians(numbers[0])), float(np.radians(numbers[1])), numbers[2]


def _from_dms(values: FloatArray) -> FloatArray:
    """Latitude and longitude [n, 2], rad, of degrees, minutes, seconds twice [n, 6+]."""
    angles = []
    for at in (0, 3):
        size = np.abs(values[:, at]) + values[:, at + 1] / 60.0 + values[:, at + 2] / 3600.0
        angles.append(np.radians(np.copysign(size, values[:, at])))
    return np.stack(angles, axis=1)


def _gps_time(values: FloatArray, form: _Form) -> FloatArray:
    if not form.calendar:
        time = tb.week_to_gps(values[:, 0], values[:, 1])
        if form.utc_offset_s is None:
            return time
        return tb.utc_to_gps(time - form.utc_offset_s)
    days = tb.days_since_epoch(*(values[:, k].astype(np.int64) for k in range(3)))
    of_day = values[:, 3] * 3600.0 + values[:, 4] * 60.0 + values[:, 5]
    time = days * float(tb.DAY_S) + of_day
    if form.utc_offset_s is None:
        return np.asarray(time, np.float64)
    return tb.utc_to_gps(time - form.utc_offset_s)


def _fixes(
    values: FloatArray, offset: IntArray, time_tokens: int, position_tokens: int, form: _Form
) -> Fixes:
    n = len(values)
    at = time_tokens
    lat, lon, height = _positions(values[:, at : at + position_tokens], form)
    at += position_tokens

    def columns(first: int, size: int) -> FloatArray:
        return np.asarray(values[:, at + first : at + first + size], np.float64)

    quality = np.nan_to_num(columns(0, 1)[:, 0], nan=5.0).astype(np.int64)
    n_sats = np.nan_to_num(columns(1, 1)[:, 0], nan=-1.0).astype(np.int64)
    fix = QUALITY[np.clip(quality, 0, len(QUALITY) - 1)]
    good = (np.abs(lat) <= np.pi / 2) & (np.abs(lon) <= np.pi) & (fix != FixType.NONE)
    fix = np.where(good, fix, FixType.NONE)
    fix = np.where(np.isnan(height) & (fix > FixType.TWO_D), FixType.TWO_D, fix)
    sd_pos = _sd_ned(columns(2, 3), columns(5, 3), lat, lon, form.position)
    velocity = _vector_ned(columns(10, 3), lat, lon, form.position)
    sd_vel = _sd_ned(columns(13, 3), columns(16, 3), lat, lon, form.position)
    for array in (lat, lon, height):
        array[~good] = np.nan
    for table in (sd_pos, velocity, sd_vel):
        table[~good] = np.nan
    return Fixes(
        gps_s=_gps_time(values, form),
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        vel_ned=velocity,
        sd_pos_ned=sd_pos,
        sd_vel_ned=sd_vel,
        fix_type=fix.astype(np.int64),
        n_sats=n_sats,
        hdop=np.full(n, np.nan),
        geoid_sep_m=np.full(n, 0.0 if form.geodetic else np.nan),
        offset=offset,
        arrival_ns=np.full(n, NO_TIME, np.int64),
    )


def _positions(values: FloatArray, form: _Form) -> tuple[FloatArray, FloatArray, FloatArray]:
    if form.position == "llh":
        return np.radians(values[:, 0]), np.radians(values[:, 1]), values[:, 2].copy()
    if form.position == "dms":
        angles = _from_dms(values)
        return angles[:, 0].copy(), angles[:, 1].copy(), values[:, 6].copy()
    import pymap3d

    if form.position == "xyz":
        place = pymap3d.ecef2geodetic(values[:, 0], values[:, 1], values[:, 2], deg=False)
    else:
        assert form.reference is not None
        place = pymap3d.enu2geodetic(
            values[:, 0], values[:, 1], values[:, 2], *form.reference, deg=False
        )
    # of a single row pymap3d gives numbers
    lat, lon, height = (np.atleast_1d(np.array(part, np.float64)) for part in place)
    return lat, lon, height


def _ned_rows(lat: FloatArray, lon: FloatArray, position: str) -> FloatArray:
    """C [n, 3, 3] that takes a file's vector components to north, east, down."""
    if position == "xyz":
        return np.swapaxes(ecef_axes(lat, lon), 1, 2)
    c = np.zeros((len(lat), 3, 3))
    north, east = (1, 0) if position == "enu" else (0, 1)
    c[:, 0, north] = c[:, 1, east] = 1.0
    c[:, 2, 2] = -1.0
    return c


def _vector_ned(vector: FloatArray, lat: FloatArray, lon: FloatArray, position: str) -> FloatArray:
    if vector.shape[1] < 3:
        return np.full((len(vector), 3), np.nan)
    turned = np.einsum("nij,nj->ni", _ned_rows(lat, lon, position), vector)
    return np.asarray(turned, np.float64)


def _sd_ned(
    sd: FloatArray, mixed: FloatArray, lat: FloatArray, lon: FloatArray, position: str
) -> FloatArray:
    """Sd north, east, down [n, 3] of sd [n, 3] and the signed roots of covariances [n, 3]."""
    if sd.shape[1] < 3:
        return np.full((len(lat), 3), np.nan)
    cov = np.zeros((len(sd), 3, 3))
    for axis in range(3):
        cov[:, axis, axis] = sd[:, axis] ** 2
        root = mixed[:, axis] if mixed.shape[1] > axis else np.full(len(sd), np.nan)
        term = np.nan_to_num(np.sign(root) * root**2)
        other = (axis + 1) % 3
        cov[:, axis, other] = cov[:, other, axis] = term
    c = _ned_rows(lat, lon, position)
    variance = np.einsum("nij,njk,nik->ni", c, cov, c)
    # RTKLIB writes zero where it has no figure
    usable = np.isfinite(variance) & (variance > 0.0)
    return np.where(usable, np.sqrt(np.where(usable, variance, 1.0)), np.nan)
