"""``map.kmz``: a KML document with the pictures it shows in one archive."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from automap.io.atomic import atomic_path

DOCUMENT = "doc.kml"
_DATE = (1980, 1, 1, 0, 0, 0)


def write_kmz(
    path: Path,
    document: Iterable[bytes | memoryview],
    files: Mapping[str, bytes],
    large: bool = False,
) -> None:
    """Write the document and the files that it refers to by these names; ``large`` where the
    document may be more than 2 GB, which is a form of archive of its own (ZIP64).

    The document comes first in the archive, as readers expect; the same content gives the same
    bytes.
    """
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        head = zipfile.ZipInfo(DOCUMENT, _DATE)
        head.compress_type = zipfile.ZIP_DEFLATED
        with archive.open(head, "w", force_zip64=large) as stream:
            for chunk in document:
                stream.write(chunk)
        for name, data in files.items():
            # pictures are compressed already
            archive.writestr(zipfile.ZipInfo(name, _DATE), data, zipfile.ZIP_STORED)
