"""Signs of cameras that are not as stated: located again as what is wrong with them explains."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.geolocation import limits
from automap.geolocation.camera_doubt import as_unknown, beyond_stated, doubtful, misfit
from automap.geolocation.camera_hypotheses import (
    Hypothesis,
    better_explanations,
    contradicted,
    explanation_by_tracks,
)
from automap.geolocation.left_out import Notes, no_signs
from automap.geolocation.result import GeolocationResult
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.track_evidence import NOTHING_TOLD, Evidence, evidence_of
from automap.records import Camera, Detections, IntArray, Trajectory


@dataclass(frozen=True)
class Trial:
    """Boxes, cameras and rules that signs are located with, and per camera why boxes [n] are of no
    sign, "" for all others: what moves along, say, depends on where they lie and when."""

    detections: Sequence[Detections]
    cameras: Mapping[str, Camera]
    rules: GeolocationRules
    notes: Sequence[Notes]

    def assuming(self, name: str, one: Hypothesis, trajectory: Trajectory) -> Trial:
        """The same with what a hypothesis says of a camera."""
        detections, notes = list(self.detections), list(self.notes)
        at = self.place(name)
        detections[at] = one.found
        notes[at] = no_signs(trajectory, one.found, one.camera, self.rules)
        return Trial(detections, {**self.cameras, name: one.camera}, self.rules, notes)

    def place(self, name: str) -> int:
        """Which record is a camera's."""
        return [record.camera for record in self.detections].index(name)

    def rows(self, name: str) -> IntArray:
        """The rows of a camera's boxes among all, without those of no sign."""
        place = self.place(name)
        return sum(map(len, self.notes[:place])) + np.flatnonzero(self.notes[place] == "")


Locate = Callable[[Trial, Callable[[float], None]], GeolocationResult]


def explain_doubted(
    trajectory: Trajectory, stated: Trial, found: GeolocationResult, locate: Locate
) -> GeolocationResult:
    """The signs ``found`` with all cameras as ``stated``; those of cameras that are not so as the
    best explanation gives them, and doubtful where there is none. ``locate`` locates anew."""
    focal_sd = stated.rules.focal_sd
    trial = stated
    told = {name: _evidence(name, trajectory, stated, found) for name in found.corrections}
    names = [
        record.camera
        for record, note in zip(stated.detections, stated.notes, strict=True)
        if record.camera in found.corrections
        and (
            beyond_stated(found.corrections[record.camera], stated.cameras[record.camera], focal_sd)
            or _unfit(found, stated.rows(record.camera))
            or told[record.camera].doubts
            or contradicted(
                *(trajectory, record, stated.cameras[record.camera]), np.asarray(note != "")
            )
        )
    ]
    assumed = {}
    for name in names:
        trial, found, assumed[name] = _best_explanation(
            *(name, trajectory, trial, found, locate, told[name])
        )
    # what was assumed of the last camera moved the signs of those before it
    told |= {name: _evidence(name, trajectory, trial, found) for name in names}
    left = [
        name
        for name in names
        if not _fits(found, trial.rows(name)) or not told[name].allows(assumed[name] != "")
    ]
    sentences = [
        f"camera {name}: its boxes do not fit the path as stated, and fit it if {what}. "
        "That was assumed; check the manifest, and run again."
        for name, what in assumed.items()
        if what and name not in left
    ]
    # what a camera that fits nothing seems to be is nothing to go by
    seems = tuple(f"camera {name} seems" for name in left)
    sentences += [text for text in found.warnings if not text.startswith(seems)]
    for name in left:
        found = _with_doubtful(found, trial.rows(name))
        nearest = f" (they fit best if {assumed[name]})" if assumed[name] else ""
        sentences.append(
            f"What is wrong with camera {name} was not found: no turn, time offset, pace of "
            "stamps, focal length or turned picture makes its boxes fit the path better than boxes "
            f"of another drive do by chance{nearest}. Its signs are "
            "doubtful and their ellipses as wide as they were away; check the frames' stamps and "
            "order, camera_matrix and that the video is of this drive."
        )
    for name in told:
        n = len(set(found.observations.sign_id[trial.rows(name)]) - {""})
        if n and name not in left and not told[name].shown:
            sentences.append(
                f"camera {name}: nothing shows that its boxes are of this drive: the tracks of its "
                f"{n} {'sign' if n == 1 else 'signs'} fit other times of the path about as well as "
                "their own, as on a straight road or where signs are few. See that the video is "
                "this drive's."
            )
    return replace(found, warnings=sentences)


def _evidence(
    name: str, trajectory: Trajectory, trial: Trial, found: GeolocationResult
) -> Evidence:
    """What speaks against a camera as it was ``found``, by the boxes that its signs are made of."""
    if name not in found.corrections:
        return NOTHING_TOLD
    place = trial.place(name)
    record, first = trial.detections[place], sum(map(len, trial.notes[:place]))
    rows = slice(first, first + len(record))
    track = np.where(found.observations.used[rows], found.observations.track[rows], -1)
    camera = found.corrections[name].applied(trial.cameras[name])
    return evidence_of(trajectory, replace(record, track=track), camera, trial.rules)


def _best_explanation(
    name: str,
    trajectory: Trajectory,
    trial: Trial,
    found: GeolocationResult,
    locate: Locate,
    told: Evidence,
) -> tuple[Trial, GeolocationResult, str]:
    """What explains the boxes of a camera best, the signs that it gives, and what it says; ``told``
    by its tracks with the camera as it was found."""
    place = trial.place(name)
    record, camera, out = trial.detections[place], trial.cameras[name], trial.notes[place] != ""
    unknown = Hypothesis("", record, as_unknown(camera))
    explanations = better_explanations(trajectory, record, camera, np.asarray(out))
    by_tracks = explanation_by_tracks(unknown, told, found.corrections[name].time_s)
    best, what = (trial, found), ""

    def located(one: Hypothesis) -> tuple[tuple[Trial, GeolocationResult], float, float]:
        """What comes of a hypothesis, how many boxes more it places than the best, as a part, and
        how far they are off over those of that."""
        some = trial.assuming(name, one, trajectory)
        again = locate(some, lambda done: None)
        more = _used(again, some.rows(name)) - _used(best[1], best[0].rows(name))
        part = more / max(int(np.count_nonzero(~out)), 1)
        return (some, again), part, _scatter(again) / _scatter(best[1])

    for one in [unknown, *by_tracks, *explanations[: limits.MOST_TRIED]]:
        tried, more, apart = located(one)
        # what is open is fitted no worse; anything else must be worth its assumption
        closer = apart < limits.CLOSER_BOXES or not one.what
        if more > limits.MORE_BOXES or (more >= 0.0 and closer):
            best, what = tried, one.what
    assumed = best[0].cameras[name]
    as_mounted = np.array_equal(assumed.mount_rpy, camera.mount_rpy)
    if what and as_mounted and np.array_equal(assumed.matrix, camera.matrix):
        # with other stamps or another picture, turn, lens and focal length may be as stated
        as_stated = replace(
            *(assumed,), mount_sd=camera.mount_sd, distortion_sd=camera.distortion_sd,
            focal_sd=camera.focal_sd,
        )  # fmt: skip
        tried, more, apart = located(Hypothesis(what, best[0].detections[place], as_stated))
        best = tried if more >= 0.0 and apart * limits.CLOSER_BOXES < 1.0 else best
    return *best, what


def _used(found: GeolocationResult, rows: IntArray) -> float:
    return float(np.count_nonzero(found.observations.used[rows]))


def _fits(found: GeolocationResult, rows: IntArray) -> bool:
    share = float(found.observations.used[rows].mean())
    return share >= limits.FITS_SHARE and not _unfit(found, rows)


def _unfit(found: GeolocationResult, rows: IntArray) -> bool:
    """Whether boxes of one camera do not fit the path, or scatter as none do."""
    if min(found.noise.scales[:2]) >= limits.SCATTER_LIMITS[1]:
        return True
    seen = set(found.observations.sign_id[rows])
    signs = [sign for sign in found.signs if sign.id in seen]
    return bool(misfit(found.observations.used[rows], found.observations.note[rows], signs))


def _scatter(found: GeolocationResult) -> float:
    """How far directions of boxes are off their signs, over what the settings say."""
    return float(np.hypot(*found.noise.scales[:2]))


def _with_doubtful(found: GeolocationResult, rows: IntArray) -> GeolocationResult:
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
