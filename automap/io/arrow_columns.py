"""Between Arrow columns and numpy arrays, by their buffers.

pyarrow's own conversions import pandas first, which takes longer than reading a drive.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pyarrow as pa

_PLAIN = frozenset(np.dtype(name) for name in ("f8", "f4", "i8", "i4", "i2", "i1", "u1"))


def column_to_numpy(column: pa.ChunkedArray) -> np.ndarray[Any, Any]:
    """A column of numbers as a numpy array [n]; nulls become NaN in floats, 0 in integers."""
    dtype = np.dtype(column.type.to_pandas_dtype())
    if dtype not in _PLAIN:
        return np.asarray(column.to_numpy())
    parts = [_chunk_to_numpy(chunk, dtype) for chunk in column.chunks]
    if len(parts) == 1:
        return parts[0]
    return np.concatenate(parts) if parts else np.zeros(0, dtype)


def _chunk_to_numpy(chunk: pa.Array, dtype: np.dtype[Any]) -> np.ndarray[Any, Any]:
    n, start = len(chunk), chunk.offset
    validity, data = chunk.buffers()
    if n == 0 or data is None:
        return np.zeros(n, dtype)
    values = np.frombuffer(data, dtype, count=start + n)[start:]
    if chunk.null_count == 0:
        return values
    bits = np.frombuffer(validity, np.uint8)
    valid = np.unpackbits(bits, count=start + n, bitorder="little")[start:].astype(bool)
    missing = np.nan if dtype.kind == "f" else 0
    return np.where(valid, values, np.asarray(missing, dtype))


def numpy_to_array(values: np.ndarray[Any, Any]) -> pa.Array:
    """An array [n] of numbers, truths or texts as an Arrow array; NaN stays NaN."""
    import pyarrow as pa

    values = np.ascontiguousarray(values)
    if values.ndim == 1 and values.dtype == np.bool_:
        bits = np.packbits(values, bitorder="little")
        return pa.Array.from_buffers(pa.bool_(), len(values), [None, pa.py_buffer(bits)])
    if values.ndim == 1 and values.dtype.kind in "OU":
        texts = values.tolist()
        if all(type(text) is str for text in texts):
            return _text_array(texts)
    if values.ndim != 1 or values.dtype not in _PLAIN:
        return pa.array(values)
    kind = pa.from_numpy_dtype(values.dtype)
    return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(values)])


def _text_array(texts: list[str]) -> pa.Array:
    import pyarrow as pa

    encoded = [text.encode() for text in texts]
    ends = np.cumsum([0, *map(len, encoded)], dtype=np.int64)
    if ends[-1] > np.iinfo(np.int32).max:
        return pa.array(texts, pa.large_string())
    buffers = [None, pa.py_buffer(ends.astype(np.int32)), pa.py_buffer(b"".join(encoded))]
    return pa.Array.from_buffers(pa.string(), len(texts), buffers)
