"""The trajectory in a KML document: Google's timed track, and a line coloured by its sigma."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import fields
from functools import partial
from typing import Any

import numpy as np

from automap.export.clock import iso_texts
from automap.export.kml_cells import xml_text
from automap.export.path import Path
from automap.export.pieces import TextPiece, code
from automap.export.uncertainty import sigma_classes
from automap.records import FloatArray, IntArray

SIGMA_COLOURS = ("#2c7fb8", "#41ae9b", "#8fc447", "#e0b32c", "#d7553a")
"""From the surest to the least sure part of the path."""
UNKNOWN_COLOUR = "#8a8f98"
"""Where nothing tells how sure it is."""

_ARRAYS = (
    ("speed_m_s", "speed (m/s)"),
    ("sd_h_m", "horizontal sigma of north and east together (m)"),
    ("sd_d_m", "vertical sigma (m)"),
)

TRACK_SCHEMA = (
    '<Schema name="track" id="track-values">'
    + "".join(
        f'<gx:SimpleArrayField name="{name}" type="float"><displayName>{label}</displayName>'
        "</gx:SimpleArrayField>"
        for name, label in _ARRAYS
    )
    + "</Schema>"
)


def track_elements(
    path: Path, altitude: FloatArray, keyed: bool = False
) -> Iterator[str | TextPiece]:
    """The folder with the track and the uncertainty of it, a piece of each drive, with a key where
    they are to be ``keyed``.

    ``altitude`` [n] is above the sea, NaN where unknown. Without UTC the track is a line.
    """
    absolute = bool(np.isfinite(altitude).all())
    mode = "absolute" if absolute else "clampToGround"
    altitudes = altitude if absolute else np.zeros(len(path))
    head = f"<altitudeMode>{mode}</altitudeMode>"
    yield "<Folder><name>Trajectory</name>"
    for name, rows in path.pieces:
        own = path.part(rows), altitudes[rows], xml_text(name or "Track"), head
        yield TextPiece(_key(keyed, "track", *own), partial(_lines, _track, *own))
    yield from _uncertainty(path, keyed)
    yield "</Folder>"


def _lines(write: Callable[..., Iterable[str]], *words: Any) -> Iterator[bytes]:
    for text in write(*words):
        yield f"{text}\n".encode("utf-8", "replace")


def _key(keyed: bool, kind: str, path: Path, *words: Any) -> str:
    """Names a text by all that it is made of."""
    if not keyed:
        return ""
    whole = hashlib.sha256(f"{code()} {kind}".encode())
    for value in (*(getattr(path, f.name) for f in fields(path)), *words):
        array = isinstance(value, np.ndarray)
        whole.update(np.ascontiguousarray(value).tobytes() if array else repr(value).encode())
    return whole.hexdigest()[:32]


def _track(path: Path, altitudes: FloatArray, name: str, head: str) -> Iterator[str]:
    if np.isnat(path.utc).any():
        for run in path.runs:
            yield (
                f"<Placemark><name>{name}</name><styleUrl>#track</styleUrl><LineString>"
                f"{head}<coordinates>{_corners(path, run, altitudes)}</coordinates>"
                "</LineString></Placemark>"
            )
    else:
        yield f"<Placemark><name>{name}</name><styleUrl>#track</styleUrl><gx:Track>{head}"
        yield from (f"<when>{when}</when>" for when in iso_texts(path.utc))
        for lon, lat, alt in zip(
            path.lon_deg.tolist(), path.lat_deg.tolist(), altitudes.tolist(), strict=True
        ):
            yield f"<gx:coord>{lon:.7f} {lat:.7f} {alt:.2f}</gx:coord>"
        rpy = np.nan_to_num(path.rpy_deg)
        for roll, pitch, yaw in rpy.tolist():
            # heading, tilt, roll
            yield f"<gx:angles>{yaw % 360.0:.2f} {pitch:.2f} {roll:.2f}</gx:angles>"
        yield from _values(path)
        yield "</gx:Track></Placemark>"


def _values(path: Path) -> Iterator[str]:
    yield '<ExtendedData><SchemaData schemaUrl="#track-values">'
    for name, _ in _ARRAYS:
        yield f'<gx:SimpleArrayData name="{name}">'
        for value in getattr(path, name).tolist():
            text = f"{value:.3f}" if np.isfinite(value) else ""
            yield f"<gx:value>{text}</gx:value>"
        yield "</gx:SimpleArrayData>"
    yield "</SchemaData></ExtendedData>"


def _uncertainty(path: Path, keyed: bool) -> Iterator[str | TextPiece]:
    classes, labels = sigma_classes(path.sd_h_m)
    if not labels or len(path) < 2:
        return
    yield "<Folder><name>Horizontal sigma</name><visibility>0</visibility>"
    for _, rows in path.pieces:
        own = path.part(rows), classes[rows], labels
        yield TextPiece(_key(keyed, "sigma", *own), partial(_lines, _shaded, *own))
    yield "</Folder>"


def _shaded(path: Path, classes: IntArray, labels: Sequence[str]) -> Iterator[str]:
    """The lines of a drive, by the classes [n] of their sigmas."""
    ground = np.zeros(len(path))
    shades = np.linspace(0, len(SIGMA_COLOURS) - 1, len(labels)).round().astype(int)
    for run in path.runs:
        # a line from each point to the next has the class of its start
        own = classes[run.start : run.stop - 1]
        cuts = (np.flatnonzero(np.diff(own)) + 1 + run.start).tolist()
        edges = [run.start, *cuts, run.stop - 1]
        for a, b in itertools.pairwise(edges):
            if b <= a or classes[a] < 0:
                continue
            yield (
                f"<Placemark><name>{xml_text(labels[classes[a]])}</name>"
                f"<visibility>0</visibility><styleUrl>#sigma-{shades[classes[a]]}</styleUrl>"
                "<LineString><tessellate>1</tessellate>"
                "<altitudeMode>clampToGround</altitudeMode>"
                f"<coordinates>{_corners(path, slice(a, b + 1), ground)}</coordinates>"
                "</LineString></Placemark>"
            )


def _corners(path: Path, run: slice, altitudes: FloatArray) -> str:
    return " ".join(
        f"{lon:.7f},{lat:.7f},{alt:.2f}"
        for lon, lat, alt in zip(
            path.lon_deg[run].tolist(),
            path.lat_deg[run].tolist(),
            altitudes[run].tolist(),
            strict=True,
        )
    )
