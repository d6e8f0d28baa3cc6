"""What comes of locating the signs of a drive."""

from __future__ import annotations

from dataclasses import dataclass

from automap.geolocation.facing import Faces
from automap.geolocation.observations import Observations
from automap.geolocation.trajectory_adjustment import AdjustedTrajectory
from automap.geolocation.views import CameraCorrection, MeasurementNoise
from automap.records import Sign, Trajectory


@dataclass(frozen=True)
class GeolocationResult:
    """Signs in the order of first sight, what became of every detection, what was found out
    about each camera, and sentences for the user; ``adjusted`` trajectory, as signs seen again and
    control signs put it right (None: not at all), ``n_control`` control signs that were used,
    ``noise`` of the boxes as it was taken, ``faces`` what was found of all faces."""

    signs: list[Sign]
    observations: Observations
    corrections: dict[str, CameraCorrection]
    warnings: list[str]
    adjusted: AdjustedTrajectory | None
    n_control: int
    noise: MeasurementNoise
    faces: Faces

    @property
    def trajectory(self) -> Trajectory | None:
        """The adjusted trajectory, made anew at each call."""
        return None if self.adjusted is None else self.adjusted.whole()
