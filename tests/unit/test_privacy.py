"""Nobody can be recognised in a picture that leaves the drive, and its signs stay sharp."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from automap.export.pictures import context_picture
from automap.records import Image
from automap.vision.crops import BestCrops
from automap.vision.privacy import (
    GREATEST_SHARE,
    LEGIBLE_PX_PER_M,
    NEAREST_M,
    hide_street,
    reduction,
    rimmed,
    street_hidden,
)
from pipeline.detect.images import search_images

ROOT = Path(__file__).parents[2]
WRITES_PICTURES = {
    "automap/export/icons.py": "faces that are drawn",
    "automap/export/pictures.py": "signs, and streets that are hidden",
    "automap/io/web_tiles.py": "tiles of a map that the user gives",
    "pipeline/report/background.py": "a part of a map that the user gives",
    "automap/vision/contact_sheet.py": "pictures of crops.py",
    "automap/vision/crops.py": "hides the street",
    "pipeline/detect/annotated_video.py": "hides the street",
    "pipeline/detect/images.py": "hides the street",
    "automap/io/image_video.py": "a recording, which stays in its drive",
    "pipeline/record/video_chapter.py": "a recording, which stays in its drive",
    "pipeline/simulate/drive_writer.py": "a drive in which nobody is",
    "pipeline/train/degrade.py": "pictures to train on, kept in memory",
    "pipeline/view/frames.py": "frames that the viewer shows on the drive's own computer",
}


def street(seed: int = 1, height: int = 360, width: int = 640) -> Image:
    """A frame in which each pixel says something."""
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3)).astype(np.uint8)


def test_nothing_is_left_of_what_a_cell_holds_but_its_mean() -> None:
    """However the pixels of a cell are shuffled, what is shown is the same."""
    image, factor = street(), 20
    cells = image.reshape(18, factor, 32, factor, 3).swapaxes(1, 2).reshape(18, 32, -1, 3)
    shuffled = np.random.default_rng(2).permuted(cells, axis=2)
    other = shuffled.reshape(18, 32, factor, factor, 3).swapaxes(1, 2).reshape(image.shape)
    none = np.zeros((0, 4))
    # the channels are shuffled each by itself; every mean stays
    shown = hide_street(image, none, factor).astype(int)
    np.testing.assert_allclose(hide_street(other, none, factor), shown, atol=1)
    assert shown.std() < 0.1 * image.std()


def test_the_signs_stay_as_they_are() -> None:
    image = street()
    box = np.array([100.0, 50.0, 159.0, 120.0])
    shown = street_hidden(image, [box, np.array([400.0, 300.0, 430.0, 330.0])], 600.0)
    for own in (box, [400, 300, 430, 330]):
        x0, y0, x1, y1 = (int(v) for v in own)
        np.testing.assert_array_equal(
            shown[y0 : y1 + 1, x0 : x1 + 1], image[y0 : y1 + 1, x0 : x1 + 1]
        )
    left, top, right, bottom = rimmed(box, 640, 360)
    assert (left, top, right, bottom) == (96, 46, 164, 125)
    changed = (shown != image).any(axis=2)
    assert changed[:, :90].mean() > 0.95


@pytest.mark.parametrize("box", [[0.0, 0.0, 400.0, 300.0], [np.nan] * 4, [700.0, 0.0, 720.0, 9.0]])
def test_a_box_that_is_no_sign_shows_no_street(box: list[float]) -> None:
    image = street()
    shown = street_hidden(image, [np.array(box)])
    np.testing.assert_array_equal(shown, street_hidden(image, []))


def test_what_is_nearest_has_no_more_pixels_than_are_allowed() -> None:
    for focal in (400.0, 1000.0, 3000.0):
        per_m = focal / NEAREST_M / reduction(1280, focal)
        assert per_m == pytest.approx(LEGIBLE_PX_PER_M)
    # of an unknown camera as of a narrow one; nothing is ever enlarged
    assert reduction(1280) > reduction(1280, 1280.0)
    assert reduction(1280, 10.0) == 1.0
    assert 0.05 < GREATEST_SHARE < 0.3


def test_the_street_around_a_sign_is_hidden_unless_it_is_wanted() -> None:
    image = street(height=720, width=1280)
    box = np.array([600.0, 300.0, 660.0, 360.0])
    hidden, shown = context_picture(image, box, 900.0), context_picture(image, box, 900.0, False)
    assert hidden is not None
    assert shown is not None
    picture = cv2.imdecode(np.frombuffer(hidden, np.uint8), cv2.IMREAD_COLOR)
    bare = cv2.imdecode(np.frombuffer(shown, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == bare.shape == (270, 480, 3)
    assert picture[:100].std() < 0.4 * bare[:100].std()
    inside = slice(115, 133), slice(228, 245)
    np.testing.assert_allclose(picture[inside], bare[inside], atol=60)
    assert picture[inside].std() > 0.8 * bare[inside].std()
    assert context_picture(image, np.array([0.0, 0.0, 1200.0, 700.0])) is None


def test_a_crop_shows_its_sign_alone() -> None:
    image = street(height=720, width=1280)
    best = BestCrops("front", 900.0)
    best.offer(image, 0, 0, 1, "regulatory--stop--g1", np.array([600.0, 300, 680, 380]), 0.9)
    (crop,) = best.crops({})
    picture = cv2.imdecode(np.frombuffer(crop.jpeg, np.uint8), cv2.IMREAD_COLOR)
    x0, y0, x1, y1 = (round(v) for v in crop.box_in_crop)
    assert picture[: y0 - 8].std() < 0.4 * picture[y0:y1, x0:x1].std()


class OneSign:
    """A detector that finds one sign in each picture."""

    names = ("regulatory--stop--g1",)

    def detect(self, image: Image) -> object:
        from automap.vision.detector import FoundSigns

        return FoundSigns(self.names, np.array([[100.0, 50.0, 160.0, 110.0]]), np.array([0.9]))


@pytest.mark.parametrize("hide", [True, False])
def test_pictures_with_the_signs_drawn_in_hide_the_street(tmp_path: Path, hide: bool) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), street())
    detector, out = OneSign(), tmp_path / "drawn"
    search_images([path], detector, 0.3, out, print, lambda f, text: None, hide)  # type: ignore[arg-type]
    shown = cv2.imread(str(out / "a.jpg"))
    assert (shown[200:].std() < 20.0) == hide
    assert shown[60:100, 110:150].std() > 40.0


def test_every_place_that_writes_pictures_is_known() -> None:
    """Who adds one decides what of a street it shows, and says so above."""
    writes = re.compile(
        r"\.imencode\(|\.imwrite\(|VideoWriter|add_stream\(\"|\.save\(.*\.(jpg|png)"
    )
    found = {
        str(path.relative_to(ROOT))
        for package in ("automap", "pipeline")
        for path in (ROOT / package).rglob("*.py")
        if writes.search(path.read_text(encoding="utf-8"))
    }
    assert found == set(WRITES_PICTURES)
