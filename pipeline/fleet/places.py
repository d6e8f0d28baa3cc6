"""Where a store lies: a folder, also of a network share, or an object store (``s3://``)."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Protocol

from automap.errors import ConfigError
from automap.io.atomic import atomic_path, is_temporary, make_folder, write_bytes

_CHUNK = 1 << 20


class Place(Protocol):
    """Files by names with slashes. What is written under a name is there whole or not at all."""

    url: str
    folder: Path | None
    """Of a store in a folder; None for an object store."""

    def read(self, name: str) -> bytes | None:
        """The content; None where there is no such file."""

    def write(self, name: str, data: bytes) -> None:
        """Write a small file."""

    def put(self, source: Path, name: str) -> None:
        """Write a file from this machine."""

    def get(self, name: str, target: Path) -> None:
        """Copy a file, or all that lies below a name, to this machine."""

    def names(self, name: str) -> list[str]:
        """What lies directly below a name, ascending; [] where nothing does."""

    def files(self, name: str) -> list[tuple[str, int]]:
        """Name below it and size of every file, ascending."""

    def open(self, name: str) -> Any:
        """A file to read and seek in, as a context."""

    def remove(self, name: str) -> None:
        """Remove a file, or all that lies below a name; nothing where there is none."""


def place_at(url: str) -> Place:
    """The place that a folder's name or an address names; ConfigError for one of no known kind."""
    if "://" not in url:
        return Folder(Path(url))
    return ObjectStore(url)


class Folder:
    """A folder of a file system."""

    def __init__(self, path: Path) -> None:
        self._root = path.absolute()
        self.folder: Path | None = self._root
        self.url = str(self._root)

    def read(self, name: str) -> bytes | None:
        try:
            return (self._root / name).read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None

    def write(self, name: str, data: bytes) -> None:
        write_bytes(self._root / name, data)

    def put(self, source: Path, name: str) -> None:
        with atomic_path(self._root / name) as temporary:
            shutil.copyfile(source, temporary)

    def get(self, name: str, target: Path) -> None:
        source = self._root / name
        if source.is_dir():
            shutil.copytree(source, target, dirs_exist_ok=True)
        else:
            make_folder(target.parent)
            shutil.copyfile(source, target)

    def names(self, name: str) -> list[str]:
        try:
            return sorted(p.name for p in (self._root / name).iterdir() if not is_temporary(p))
        except (FileNotFoundError, NotADirectoryError):
            return []

    def files(self, name: str) -> list[tuple[str, int]]:
        root = self._root / name
        found: list[Path] = []
        seen: set[str] = set()
        # videos often lie on another disk, behind a link
        for folder, below, files in os.walk(root, followlinks=True):
            real = os.path.realpath(folder)
            # of a link that leads back nothing is new
            below[:] = [] if real in seen else sorted(below)
            found += [] if real in seen else [Path(folder, file) for file in files]
            seen.add(real)
        sizes = ((p.relative_to(root).as_posix(), p.stat()) for p in found if p.is_file())
        return sorted((file, stat.st_size) for file, stat in sizes)

    def open(self, name: str) -> IO[bytes]:
        return (self._root / name).open("rb")

    def remove(self, name: str) -> None:
        path = self._root / name
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


class ObjectStore:
    """A part of a bucket; a file that is put there appears whole."""

    folder: Path | None = None

    def __init__(self, url: str) -> None:
        self.url = url
        import pyarrow as pa
        from pyarrow import fs

        try:
            self._fs, self._root = fs.FileSystem.from_uri(url)
        except (pa.ArrowException, ValueError, OSError) as error:
            reason = str(error).splitlines()[0]
            raise ConfigError(
                f"{url}: not an address that can be used ({reason}); give a folder or s3://"
            ) from None

    def _path(self, name: str) -> str:
        return f"{self._root.rstrip('/')}/{name}" if name else self._root

    def read(self, name: str) -> bytes | None:
        try:
            with self._told(), self._fs.open_input_stream(self._path(name)) as stream:
                return bytes(stream.read())
        except FileNotFoundError:
            return None

    def write(self, name: str, data: bytes) -> None:
        with self._told(), self._fs.open_output_stream(self._path(name)) as stream:
            stream.write(data)

    def put(self, source: Path, name: str) -> None:
        with (
            source.open("rb") as stream,
            self._told(),
            self._fs.open_output_stream(self._path(name)) as out,
        ):
            while block := stream.read(_CHUNK):
                out.write(block)

    def get(self, name: str, target: Path) -> None:
        found = self.files(name)
        pairs = [(f"{name}/{file}", target / file) for file, _ in found] or [(name, target)]
        for source, path in pairs:
            make_folder(path.parent)
            with (
                self._told(),
                self._fs.open_input_stream(self._path(source)) as stream,
                path.open("wb") as out,
            ):
                shutil.copyfileobj(stream, out, _CHUNK)

    def names(self, name: str) -> list[str]:
        from pyarrow import fs

        selector = fs.FileSelector(self._path(name), allow_not_found=True)
        with self._told():
            return sorted(info.base_name for info in self._fs.get_file_info(selector))

    def files(self, name: str) -> list[tuple[str, int]]:
        from pyarrow import fs

        root = self._path(name).rstrip("/")
        selector = fs.FileSelector(root, allow_not_found=True, recursive=True)
        with self._told():
            found = self._fs.get_file_info(selector)
        return sorted((i.path[len(root) + 1 :], i.size) for i in found if i.is_file)

    def open(self, name: str) -> Any:
        with self._told():
            return self._fs.open_input_file(self._path(name))

    def remove(self, name: str) -> None:
        from pyarrow import fs

        with self._told():
            kind = self._fs.get_file_info(self._path(name)).type
            if kind == fs.FileType.Directory:
                self._fs.delete_dir(self._path(name))
            elif kind == fs.FileType.File:
                self._fs.delete_file(self._path(name))

    @contextmanager
    def _told(self) -> Iterator[None]:
        """What an object store says, as failures of reading and writing that may pass."""
        try:
            yield
        except FileNotFoundError:
            raise
        except OSError as error:
            raise OSError(error.errno or 5, str(error).splitlines()[0], self.url) from error
