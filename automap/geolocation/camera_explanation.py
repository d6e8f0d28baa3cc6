"""Signs of cameras that are not as stated: located again as what is wrong with them explains."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.geolocation import limits
from automap.geolocation.camera_doubt import as_unknown, beyond_stated, doubtful, misfit
from automap.geolocation.camera_hypotheses import Hypothesis, better_explanations, in_turned_picture
from automap.geolocation.result import GeolocationResult
from automap.geolocation.rules import GeolocationRules
from automap.records import Camera, Detections, Trajectory


@dataclass(frozen=True)
class Trial:
    """Boxes, cameras and rules that signs are located with."""

    detections: Sequence[Detections]
    cameras: Mapping[str, Camera]
    rules: GeolocationRules

    def assuming(self, name: str, one: Hypothesis) -> Trial:
        """The same with what a hypothesis says of a camera, and with focal lengths let go."""
        return Trial(
            [one.found if d.camera == name else d for d in self.detections],
            {**self.cameras, name: one.camera},
            replace(self.rules, camera=replace(self.rules.camera, focal_sd=limits.DOUBTED_FOCAL)),
        )

    def rows(self, name: str) -> slice:
        """The rows of a camera's boxes among all."""
        place = [record.camera for record in self.detections].index(name)
        first = sum(map(len, self.detections[:place]))
        return slice(first, first + len(self.detections[place]))


Locate = Callable[[Trial, Callable[[float], None]], GeolocationResult]


def explain_doubted(
    trajectory: Trajectory, stated: Trial, found: GeolocationResult, locate: Locate
) -> GeolocationResult:
    """The signs ``found`` with all cameras as ``stated``; those of cameras that are not so as the
    best explanation gives them, and doubtful where there is none. ``locate`` locates anew."""
    focal_sd = stated.rules.camera.focal_sd
    trial, sentences = stated, []
    names = [
        record.camera
        for record in stated.detections
        if record.camera in found.corrections
        and (
            beyond_stated(found.corrections[record.camera], stated.cameras[record.camera], focal_sd)
            or _unfit(found, stated.rows(record.camera))
            or in_turned_picture(trajectory, record, stated.cameras[record.camera])
        )
    ]
    for name in names:
        trial, found, what = _best_explanation(name, trajectory, trial, found, locate)
        if what:
            sentences.append(
                f"camera {name}: its boxes do not fit the path as stated, and fit it if {what}. "
                "That was assumed; check the manifest, and run again."
            )
    # what was assumed of the last camera moved the signs of those before it
    left = [name for name in names if not _fits(found, stated.rows(name))]
    sentences += found.warnings
    for name in left:
        found = _with_doubtful(found, stated.rows(name))
        sentences.append(
            f"What is wrong with camera {name} was not found: no turn, time offset, pace of "
            "stamps, focal length or turned picture makes its boxes fit the path. Its signs are "
            "doubtful and their ellipses as wide as they were away; check the frames' stamps, "
            "camera_matrix and that the video is of this drive."
        )
    return replace(found, warnings=sentences)


def _best_explanation(
    name: str, trajectory: Trajectory, trial: Trial, found: GeolocationResult, locate: Locate
) -> tuple[Trial, GeolocationResult, str]:
    """What explains the boxes of a camera best, the signs that it gives, and what it says."""
    rows = trial.rows(name)
    record = next(d for d in trial.detections if d.camera == name)
    camera = trial.cameras[name]
    explanations = better_explanations(trajectory, record, camera)[: limits.MOST_TRIED]
    best, what = (trial, found), ""
    for one in [Hypothesis("", record, as_unknown(camera)), *explanations]:
        tried = trial.assuming(name, one)
        again = locate(tried, lambda done: None)
        more = float(again.observations.used[rows].mean() - best[1].observations.used[rows].mean())
        # what is open is fitted no worse; anything else must be worth its assumption
        closer = _scatter(again) < limits.CLOSER_BOXES * _scatter(best[1])
        if more > limits.MORE_BOXES or (more >= 0.0 and (closer or not one.what)):
            best, what = (tried, again), one.what
    return *best, what


def _fits(found: GeolocationResult, rows: slice) -> bool:
    share = float(found.observations.used[rows].mean())
    return share >= limits.FITS_SHARE and not _unfit(found, rows)


def _unfit(found: GeolocationResult, rows: slice) -> bool:
    """Whether boxes of one camera do not fit the path, or scatter as none do."""
    if min(found.noise.scales[:2]) >= limits.SCATTER_LIMITS[1]:
        return True
    seen = set(found.observations.sign_id[rows])
    signs = [sign for sign in found.signs if sign.id in seen]
    return bool(misfit(found.observations.used[rows], found.observations.note[rows], signs))


def _scatter(found: GeolocationResult) -> float:
    """How far directions of boxes are off their signs, over what the settings say."""
    return float(np.hypot(*found.noise.scales[:2]))


def _with_doubtful(found: GeolocationResult, rows: slice) -> GeolocationResult:
    """The same with the signs that boxes of a camera show as unsure as such a camera leaves
    them."""
    seen = set(found.observations.sign_id[rows])
    signs = [
        doubtful(sign, float(np.nanmin(found.observations.range_m[sign.detection_rows])))
        if sign.id in seen and sign.status != "doubtful"
        else sign
        for sign in found.signs
    ]
    return replace(found, signs=signs)
