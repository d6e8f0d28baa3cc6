"""The zone of images' times, by the receiver's."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from automap.io.exif_images import read_images

UTC_S = 1_773_480_000  # 2026-03-14T09:20:00Z


def write(path: Path, taken: str, receiver: tuple[str, tuple[float, ...]] | None) -> None:
    image = Image.new("RGB", (64, 48))
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x9003] = taken
    exif.get_ifd(0x8769)[0x9291] = "25"
    gps = exif.get_ifd(0x8825)
    gps[1], gps[2], gps[3], gps[4] = "S", (35.0, 16.0, 48.0), "E", (149.0, 7.0, 48.0)
    if receiver is not None:
        gps[29], gps[7] = receiver
    image.save(path, exif=exif)


@pytest.mark.parametrize(
    "taken",
    # Sydney's time without summer time, UTC, Nepal, Honolulu
    ["2026:03:14 19:20", "2026:03:14 09:20", "2026:03:14 15:05", "2026:03:13 23:20"],
)
def test_the_receivers_time_tells_the_zone(tmp_path: Path, taken: str) -> None:
    for second in (0, 1, 2):
        # a camera's clock is some seconds off, and its fractions are kept
        write(
            tmp_path / f"{second}.jpg",
            f"{taken}:{second + 3:02d}",
            ("2026:03:14", (9.0, 20.0, float(second))),
        )
    images, said = read_images(tmp_path)
    assert [image.unix_s for image in images] == [UTC_S + s + 3.25 for s in (0, 1, 2)]
    assert not said


def test_without_the_receivers_time_the_zone_is_told_as_unknown(tmp_path: Path) -> None:
    for second in (0, 1):
        write(tmp_path / f"{second}.jpg", f"2026:03:14 09:20:{second:02d}", None)
    images, said = read_images(tmp_path)
    assert images[0].unix_s == UTC_S + 0.25
    assert "times without a zone are taken as UTC" in said[0]


def test_a_damaged_time_of_the_receiver_is_passed_over(tmp_path: Path) -> None:
    for second in (0, 1):
        write(tmp_path / f"{second}.jpg", f"2026:03:14 09:20:{second:02d}", ("0", (9.0, 20.0, 0.0)))
    assert len(read_images(tmp_path)[0]) == 2
