"""An ONNX network that comes with the package, run on the processor."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from automap.errors import InputError

Floats = npt.NDArray[np.float32]


class OnnxModel:
    """A network with one input and one output, loaded when it is first used.

    ``path`` None takes ``name`` from the package. It may be handed to another process.
    """

    def __init__(self, name: str, path: Path | None = None, threads: int = 1) -> None:
        self.name, self.path, self.threads = name, path, threads
        self._session: Any = None
        self._notes: dict[str, Any] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_session": None}

    @property
    def notes(self) -> dict[str, Any]:
        """What its maker wrote into it."""
        self._load()
        return self._notes

    def run(self, values: npt.NDArray[Any]) -> Floats:
        """The output for an input."""
        session = self._load()
        result = session.run(None, {session.get_inputs()[0].name: values})[0]
        return np.asarray(result, np.float32)

    def _load(self) -> Any:
        if self._session is None:
            self._session = self._open()
            text = self._session.get_modelmeta().custom_metadata_map.get("automap", "{}")
            self._notes = json.loads(text)
        return self._session

    def _open(self) -> Any:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = self.threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        # waiting threads sleep: the other processor decodes meanwhile
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        packaged = files("automap.vision").joinpath(f"models/{self.name}")
        source = packaged if self.path is None else self.path
        if not source.is_file():
            raise InputError(f"{source} is missing; install the package again")
        try:
            # a user's own may keep its weights in files beside it; onnxruntime calls a file that
            # it could not read to its end a broken network, reading it here says which
            network = packaged.read_bytes() if self.path is None else str(self.path)
            return onnxruntime.InferenceSession(
                network, options, providers=["CPUExecutionProvider"]
            )
        except OSError as error:
            raise InputError(f"{source} cannot be read: {error.strerror}") from None
        except Exception as error:
            # onnxruntime raises its own types, all of them directly below Exception
            raise InputError(
                f"{source} is no network that can be used ({type(error).__name__}); install the "
                "package again"
            ) from None
