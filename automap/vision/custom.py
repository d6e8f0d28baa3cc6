"""Somebody else's detector: an ONNX file with a short description in TOML."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from automap.errors import ConfigError, InputError
from automap.records import FloatArray, Image
from automap.vision.detector import FoundSigns

SCHEMA = "automap.detector/1"

Share = Annotated[FiniteFloat, Field(ge=0, le=1)]
Triple = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
_ALTERNATIVES = 5
"""Class names that are told of a box at most."""


class Description(BaseModel):
    """What stands in the TOML file; see ``docs/detect.md``.

    ``layout`` of the output: "4+nc" is [1, 4 + classes, n] (YOLOv8 and later), "5+nc" is [1, n,
    5 + classes] with the score of being an object fifth (YOLOv5). Boxes are centre and size in
    pixels of the network's input, or in parts of it (``box_unit`` "fraction"). A pixel's value
    v of 0 to 255 goes in as (v * ``scale`` - ``mean``) / ``std``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    schema_: Literal["automap.detector/1"] = Field(alias="schema")
    model: str
    classes: Annotated[tuple[str, ...], Field(min_length=1)]
    layout: Literal["4+nc", "5+nc"] = "4+nc"
    box_unit: Literal["pixels", "fraction"] = "pixels"
    input_size: tuple[Annotated[int, Field(gt=0)], Annotated[int, Field(gt=0)]] | None = None
    resize: Literal["letterbox", "stretch"] = "letterbox"
    channels: Literal["RGB", "BGR"] = "RGB"
    scale: FiniteFloat = 1.0 / 255.0
    mean: Triple = (0.0, 0.0, 0.0)
    std: Triple = (1.0, 1.0, 1.0)
    padding: Annotated[int, Field(ge=0, le=255)] = 114
    score_threshold: Share = 0.25
    nms_iou: Share = 0.5


def parse_description(data: Mapping[str, Any], path: Path) -> Description:
    """Check the content of the TOML file; ConfigError names file, key and what is wrong."""
    if data.get("schema") != SCHEMA:
        raise ConfigError(f'{path}: the first line must be schema = "{SCHEMA}"')
    try:
        return Description.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            known = ", ".join(info.alias or name for name, info in Description.model_fields.items())
            raise ConfigError(f"{path}: unknown key {key}; known are {known}") from None
        if first["type"] == "missing":
            raise ConfigError(f"{path}: the key {key} is missing; add it") from None
        raise ConfigError(
            f"{path}: {key} = {first['input']!r} is not accepted: {first['msg']}"
        ) from None


class CustomDetector:
    """Runs a YOLO-style network on whole pictures."""

    def __init__(self, path: Path, description: Description, threads: int = 1) -> None:
        """Load the detector whose ``description`` stands in ``path``.

        Raises ConfigError when the description is wrong, InputError when the model cannot be
        loaded or gives something else than described.
        """
        self._file = path
        self._description = description
        self.name = self._file.stem
        self._model = self._file.parent / self._description.model
        self._session = _session(self._model, self._file, threads)
        self._input = self._session.get_inputs()[0].name
        self._size = self._input_size()
        self._half = self._session.get_inputs()[0].type == "tensor(float16)"
        # a wrong description is found now, not after an hour of video
        self.detect(np.zeros((self._size[1], self._size[0], 3), np.uint8))

    @property
    def files(self) -> tuple[Path, Path]:
        """The description and the model."""
        return self._file, self._model

    def detect(self, image: Image) -> FoundSigns:
        """Signs in a BGR picture [height, width, 3]."""
        blob, stretch, shift = self._prepare(image)
        try:
            output = self._session.run(None, {self._input: blob})[0]
        except Exception as error:
            raise InputError(
                f"{self._model} cannot be run ({_first_line(error)}); check input_size in "
                f"{self._file} or export it again."
            ) from error
        box, scores = self._parse(np.asarray(output, np.float64))
        top = scores.argmax(axis=1)
        score = scores[np.arange(len(top)), top]
        rows = np.flatnonzero(score >= self._description.score_threshold)
        corners = np.hstack(
            [box[rows, :2] - 0.5 * box[rows, 2:], box[rows, :2] + 0.5 * box[rows, 2:]]
        )
        # from corners of pixels, as networks count, to their centres
        corners = (corners - np.tile(shift, 2)) / np.tile(stretch, 2) - 0.5
        kept = suppress_overlaps(corners, score[rows], self._description.nms_iou)
        rows, corners = rows[kept], corners[kept]
        names = self._description.classes
        return FoundSigns(
            tuple(names[i] for i in top[rows]),
            corners,
            score[rows].clip(0.0, 1.0),
            tuple(_alternatives(names, scores[row]) for row in rows),
        )

    def _prepare(self, image: Image) -> tuple[npt.NDArray[Any], FloatArray, FloatArray]:
        """The network's input, and stretch [2] and shift [2] from the picture to it."""
        about, (width, height) = self._description, self._size
        rows, columns = image.shape[:2]
        stretch = np.array([width / columns, height / rows])
        if about.resize == "letterbox":
            stretch[:] = stretch.min()
        size = np.maximum(np.rint(stretch * (columns, rows)).astype(int), 1)
        shift = (np.array([width, height]) - size) // 2
        way = cv2.INTER_AREA if stretch.min() < 1.0 else cv2.INTER_LINEAR
        canvas = np.full((height, width, 3), about.padding, np.uint8)
        canvas[shift[1] : shift[1] + size[1], shift[0] : shift[0] + size[0]] = cv2.resize(
            image, (int(size[0]), int(size[1])), interpolation=way
        )
        if about.channels == "RGB":
            canvas = canvas[:, :, ::-1]
        mean, std = np.array(about.mean, np.float32), np.array(about.std, np.float32)
        values = (canvas.astype(np.float32) * np.float32(about.scale) - mean) / std
        kind = np.float16 if self._half else np.float32
        blob = np.ascontiguousarray(values.transpose(2, 0, 1)[None], dtype=kind)
        return blob, size / np.array([columns, rows]), shift.astype(np.float64)

    def _parse(self, output: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Boxes [n, 4] (centre, size in pixels of the input) and class scores [n, classes]."""
        about = self._description
        count, extra = len(about.classes), 4 if about.layout == "4+nc" else 5
        axis = 1 if about.layout == "4+nc" else 2
        if output.ndim != 3 or output.shape[0] != 1 or output.shape[axis] != extra + count:
            wanted = f"[1, {4 + count}, n]" if axis == 1 else f"[1, n, {5 + count}]"
            raise InputError(
                f"{self._model} gives {list(output.shape)}; {count} classes in the layout "
                f'"{about.layout}" are {wanted}: correct classes or layout in {self._file}.'
            )
        rows = output[0].T if axis == 1 else output[0]
        box, scores = rows[:, :4], rows[:, extra:]
        if about.layout == "5+nc":
            scores = scores * rows[:, 4:5]
        if about.box_unit == "fraction":
            box = box * np.tile(np.array(self._size, np.float64), 2)
        good = np.isfinite(rows).all(axis=1) & (box[:, 2:] > 0).all(axis=1)
        return box[good], scores[good]

    def _input_size(self) -> tuple[int, int]:
        """Width and height of the input, by the model or else by the description."""
        shape = self._session.get_inputs()[0].shape
        stated = self._description.input_size
        if len(shape) != 4 or (isinstance(shape[1], int) and shape[1] != 3):
            raise InputError(
                f"{self._model} takes {shape}, not one picture of three channels "
                "[1, 3, height, width]; export it again."
            )
        if isinstance(shape[2], int) and isinstance(shape[3], int):
            size = (shape[3], shape[2])
            if stated is not None and stated != size:
                raise ConfigError(
                    f"{self._file}: input_size = {list(stated)}, but {self._model} takes "
                    f"{list(size)} (width, height); correct it or take it out"
                )
            return size
        if stated is None:
            raise ConfigError(
                f"{self._file}: {self._model} takes pictures of any size; add input_size = "
                "[width, height]"
            )
        return stated


def suppress_overlaps(box: FloatArray, score: FloatArray, most: float) -> npt.NDArray[np.int64]:
    """Indices of the boxes [n, 4] to keep, best first: each overlaps no better one by more
    than ``most`` (intersection over union)."""
    order = np.argsort(-score, kind="stable")
    kept: list[int] = []
    area = np.prod(box[:, 2:] - box[:, :2], axis=1)
    while len(order):
        best, rest = int(order[0]), order[1:]
        kept.append(best)
        low = np.maximum(box[best, :2], box[rest, :2])
        high = np.minimum(box[best, 2:], box[rest, 2:])
        shared = np.prod((high - low).clip(min=0.0), axis=1)
        order = rest[shared <= most * (area[best] + area[rest] - shared)]
    return np.array(kept, np.int64)


def _alternatives(names: tuple[str, ...], scores: FloatArray) -> tuple[tuple[str, float], ...]:
    """The best classes, as parts of the sum of all."""
    total = max(float(scores.sum()), 1e-9)
    order = np.argsort(-scores, kind="stable")[:_ALTERNATIVES]
    return tuple((names[i], float(scores[i] / total)) for i in order if scores[i] > 0)


def _session(model: Path, description: Path, threads: int) -> Any:
    import onnxruntime

    if not model.is_file():
        raise InputError(
            f"{model} is missing; {description} names it as its model, relative to itself."
        )
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(str(model), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # the library's own classes have no common base but this
        raise InputError(
            f"{model} is no usable ONNX model ({_first_line(error)}); export it again."
        ) from error


def _first_line(error: BaseException) -> str:
    text = str(error).splitlines()[0] if str(error) else type(error).__name__
    return text if len(text) <= 160 else text[:157] + "..."
