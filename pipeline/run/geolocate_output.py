"""What the stage geolocate writes: what became of every detection, and the figures of the run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.io import names
from pipeline.run.stage import StageContext

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    import pyarrow as pa

    from automap.geolocation.result import GeolocationResult
    from automap.records import Detections, IntArray

_LISTED = 3


def signs_verdict(statuses: Sequence[str], boxes: int) -> dict[str, Any] | None:
    """Whether signs of these ``statuses``, from so many ``boxes``, may be relied on, for run.json;
    None without boxes.

    Not where a camera's boxes go with no path (its signs are ``doubtful``), where most signs are
    placed uncertainly, or where no sign came of the boxes."""
    if not boxes:
        return None
    texts = []
    if not statuses:
        texts.append(f"no sign came of {boxes} boxes: see the warnings")
    weak = Counter(status for status in statuses if status != "ok")
    if weak["doubtful"] or 2 * weak.total() > len(statuses):
        each = ", ".join(f"{count} {status}" for status, count in weak.most_common())
        texts.append(
            f"{weak.total()} of {len(statuses)} signs are placed uncertainly ({each}): see the "
            "warnings"
        )
    reasons = [{"code": "signs_unsure", "text": text} for text in texts]
    return {"state": "doubtful" if reasons else "good", "reasons": reasons}


def write_observations_of(
    path: Path,
    table: pa.Table,
    parts: list[tuple[Detections, IntArray]],
    result: GeolocationResult,
) -> None:
    """Every detection with its track, sign and residual; unused ones with the reason."""
    import numpy as np

    from automap.io.observations_table import write_observations

    rows = np.concatenate([own for _, own in parts])

    def spread(values: npt.NDArray[Any], missing: Any) -> npt.NDArray[Any]:
        column: np.ndarray[Any, Any] = np.full(len(table), missing, values.dtype)
        column[rows] = values
        return column

    observations = result.observations
    t_ns = table["t_ns"].to_numpy().copy()
    for record, own in parts:
        t_ns[own] = record.t_ns
    results = {
        "t_ns": t_ns,
        "track": spread(observations.track, -1),
        "sign_id": spread(observations.sign_id, ""),
        "residual_x_px": spread(observations.residual_px[:, 0], np.nan),
        "residual_y_px": spread(observations.residual_px[:, 1], np.nan),
        "range_m": spread(observations.range_m, np.nan),
        "used": spread(observations.used, False),
        "note": spread(observations.note, "no_camera"),
    }
    write_observations(path, table, results)


def write_nothing(context: StageContext, table: pa.Table) -> None:
    """No signs; every detection is still listed, unused."""
    import numpy as np

    from automap.io.observations_table import write_observations
    from automap.io.signs_table import write_signs

    n = len(table)
    unknown = np.full(n, np.nan)
    columns = {
        "track": np.full(n, -1, np.int64),
        "sign_id": np.full(n, "", np.object_),
        "residual_x_px": unknown,
        "residual_y_px": unknown,
        "range_m": unknown,
        "used": np.zeros(n, np.bool_),
        "note": np.full(n, "no_pose", np.object_),
    }
    write_observations(context.work / names.OBSERVATIONS, table, columns)
    write_signs(context.work / names.SIGNS_RAW, [])
    context.metric("detections", n)
    context.metric("detections_used", 0)
    context.signs_verdict = signs_verdict([], n)
    context.result = f"0 signs from {n} detections"
    if n:
        context.result += "; none has both a camera and a place on the path: see the warnings"


def report_result(context: StageContext, result: GeolocationResult) -> None:
    """Figures for the record of the run, and what the user should look at."""
    import numpy as np

    from automap.effects.lens import focal_length
    from automap.geolocation.landmark_kernels import FOCAL_LOG, MARGIN, RADIAL
    from automap.geolocation.result import mostly_left_out

    signs, observations = result.signs, result.observations
    context.signs_verdict = signs_verdict([s.status for s in signs], len(observations.used))
    context.metric("detections", len(observations.used))
    context.metric("detections_used", int(observations.used.sum()))
    statuses = sorted({s.status for s in signs})
    context.metric("sign_status", {k: sum(s.status == k for s in signs) for k in statuses})
    context.metric("box_scatter_scales", list(result.noise.scales))
    context.metric("box_margin_scatter_px", result.noise.margin_sd_px)
    context.metric("stamp_scatter_s", result.noise.stamp_sd_s)
    context.metric(
        "faces",
        {
            "turned_sd_deg": float(np.degrees(result.faces.turned_sd)),
            "elsewhere": result.faces.elsewhere,
            "aspect_sd": result.faces.aspect_sd,
            "sd_deg": float(np.degrees(np.median([s.facing_sd_rad for s in signs])))
            if signs
            else None,
        },
    )
    if result.adjusted is not None:
        context.metric("control_signs_used", result.n_control)
        context.metric("trajectory_adjusted", True)
    cameras = context.drive.cameras()
    for name, found in result.corrections.items():
        sd = np.sqrt(np.diag(found.covariance))
        context.metric(
            f"camera_{name}",
            {
                "boresight_rpy_deg": np.degrees(found.turn).tolist(),
                "boresight_rpy_sd_deg": np.degrees(sd[:3]).tolist(),
                "time_offset_s": found.time_s,
                "time_offset_sd_s": float(sd[3]),
                "focal_scale": float(np.exp(found.focal_log)),
                "focal_scale_sd": float(sd[FOCAL_LOG]),
                "k1_added": found.radial,
                "k1_sd": float(sd[RADIAL]),
                "box_margin_px": found.margin * focal_length(cameras[name]),
                "box_margin_sd_px": float(sd[MARGIN]) * focal_length(cameras[name]),
            },
        )
    context.result = f"{len(signs)} signs from {len(observations.used)} detections"
    if signs:
        sd = np.sqrt([0.5 * (s.cov_enu[0, 0] + s.cov_enu[1, 1]) for s in signs])
        context.result += f", median sd {float(np.median(sd)):.1f} m"
        residual = observations.residual_px[observations.used]
        if len(residual):
            context.metric("residual_rms_px", float(np.sqrt(np.mean(residual**2))))
    lost = mostly_left_out(observations.used, observations.note)
    context.result += f"; {lost}" if lost else ""
    flagged = [s for s in signs if s.status != "ok"]
    if flagged:
        some = ", ".join(f"{s.id} {s.status}" for s in flagged[:_LISTED])
        more = f" and {len(flagged) - _LISTED} more" if len(flagged) > _LISTED else ""
        context.warn(f"{len(flagged)} of {len(signs)} signs are placed uncertainly: {some}{more}.")
