"""Signs of real drives: hand-made boxes, the reference trajectory, known positions.

With the reference in place of our own trajectory this measures association and triangulation
alone. The figures required leave room for other numerical libraries, not for a worse method.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from automap.evaluation.sign_matching import match, points_of, summarise_signs
from automap.geolocation.locate import locate_signs
from automap.io.detections_csv import read_detections_csv
from automap.io.drive import load_drive
from automap.io.frame_times import frame_times
from automap.io.sign_points import read_sign_points
from automap.io.truth_trajectory import read_truth_trajectory
from automap.records import SignPoints
from tests.slow_cases import others_slow

SHORT = tuple(f"kitti-20110926-{number}" for number in ("0009", "0014"))
"""Those of few boxes; the others are left to the slow tests."""


@pytest.fixture(scope="module", params=others_slow(["short", "all"]))
def located(
    request: pytest.FixtureRequest, shared_data: Path
) -> list[tuple[str, SignPoints, SignPoints]]:
    """Name, located and true signs of every drive, or of every short one."""
    result = []
    for folder in sorted((shared_data / "drives").glob("kitti-*")):
        if request.param == "short" and folder.name not in SHORT:
            continue
        drive = load_drive(folder)
        reference = read_truth_trajectory(folder / "truth" / "trajectory.csv")
        one = np.ones((len(reference), 3))
        reference = replace(
            reference, sd_pos_ned=0.3 * one, sd_vel_ned=0.02 * one, sd_rpy=0.001 * one
        )
        video = drive.videos["front"]
        assert video.detections is not None
        times = frame_times(video)
        found = read_detections_csv(video.detections, times).data
        signs = locate_signs(reference, [found], drive.cameras()).signs
        truth = read_sign_points(folder / "truth" / "signs.geojson")
        result.append((drive.name, points_of(signs), truth))
    if not result:
        pytest.skip(f"no kitti-* drives in {shared_data / 'drives'}")
    return result


def share(located: list[tuple[str, SignPoints, SignPoints]], gate_m: float) -> tuple[float, float]:
    """Recall and precision over all drives."""
    hits = sum(len(match(found, truth, gate_m)) for _, found, truth in located)
    return (
        hits / sum(len(truth) for _, _, truth in located),
        hits / sum(len(found) for _, found, _ in located),
    )


def test_recall_and_precision(located) -> None:
    recall5, precision5 = share(located, 5.0)
    assert recall5 >= 0.90
    assert precision5 >= 0.89
    recall2, _ = share(located, 2.0)
    assert recall2 >= 0.77
    recall1, _ = share(located, 1.0)
    assert recall1 >= 0.58


def test_errors_and_classes(located) -> None:
    distances, classes = [], []
    for _, found, truth in located:
        distances.append(match(found, truth, 15.0).distance_m)
        classes.append(summarise_signs(found, truth)["class_accuracy"])
    assert np.median(np.concatenate(distances)) < 0.7
    assert np.mean(classes) > 0.9


def test_no_drive_falls_out(located) -> None:
    for name, found, truth in located:
        hits = len(match(found, truth, 5.0))
        assert hits >= 0.6 * len(truth), name
        assert len(found) <= len(truth) + 1, name


def test_covariances_are_honest(located) -> None:
    """Most of the errors lie within the 95 % ellipse; some true positions are metres off."""
    inside = pairs = 0.0
    for _, found, truth in located:
        summary = summarise_signs(found, truth)
        inside += summary["coverage95"] * summary["n_pairs"]
        pairs += summary["n_pairs"]
    assert inside / pairs > 0.8
