"""Mistakes that once passed the unit tests, each with the tests that notice it now."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Known:
    """In ``source`` the text ``old`` becomes ``new``; ``tests`` are files of ``tests/unit``."""

    name: str
    source: str
    old: str
    new: str
    tests: tuple[str, ...]


KNOWN = (
    Known(
        "coning about z dropped",
        "automap/fusion/mechanisation.py",
        "    wz += k * (p0 * r1 - p1 * r0)\n",
        "",
        ("test_fusion_mechanisation.py",),
    ),
    Known(
        "the noise of one channel taken for another's",
        "automap/fusion/kernels/forward.py",
        "var[a] = nodes.var[k, first + a]",
        "var[a] = nodes.var[k, a]",
        ("test_fusion_dense.py",),
    ),
    Known(
        "the smoother's gain of the epoch before",
        "automap/fusion/kernels/smoother.py",
        "undo_interval(lam, big, store.trans[k], decay)",
        "undo_interval(lam, big, store.trans[k - 1], decay)",
        ("test_fusion_smoother.py", "test_fusion_dense.py"),
    ),
    Known(
        "the smoother's measurement gain of the epoch before",
        "automap/fusion/kernels/smoother.py",
        "lam, big, store.h[a:b], store.gain[a:b], store.nu[a:b], store.var[a:b], error, spread",
        "lam, big, store.h[a:b], store.gain[max(2 * a - b, 0) : max(2 * a - b, 0) + b - a], "
        "store.nu[a:b], store.var[a:b], error, spread",
        ("test_fusion_smoother.py", "test_fusion_dense.py"),
    ),
    Known(
        "the receiver's fix type no longer widening velocities",
        "automap/fusion/nodes.py",
        "sd_vel = velocity_errors(fixes, factor, options)",
        "sd_vel = velocity_errors(fixes, np.ones(len(fixes)), options)",
        ("test_fusion_nodes.py",),
    ),
    Known(
        "start longitude without the cosine of the latitude",
        "automap/fusion/alignment.py",
        "nominal[4] * wait / (earth.A * np.cos(nominal[0]))",
        "nominal[4] * wait / earth.A",
        ("test_fusion_nodes.py",),
    ),
    Known(
        "lateral acceleration that keeps the gyro's bias",
        "automap/fusion/passes.py",
        "gyro - np.median(gyro, axis=0)",
        "gyro",
        ("test_fusion_nodes.py",),
    ),
    Known(
        "the sign of the calm rate",
        "automap/fusion/kernels/readings.py",
        "rate[a] += d[i, a] + s * (d[i + 1, a] - d[i, a])",
        "rate[a] -= d[i, a] + s * (d[i + 1, a] - d[i, a])",
        ("test_fusion_readings.py",),
    ),
    Known(
        "calibrated time tags of ESF-MEAS read as readings",
        "automap/io/ubx.py",
        "np.maximum(room - calibrated, 0)",
        "room",
        ("test_receiver_sensors.py",),
    ),
    Known(
        "the clock's sigma without its unseen part",
        "automap/sync/arrival.py",
        " + unseen**2",
        "",
        ("test_sync_arrival.py",),
    ),
    Known(
        "warnings of the clock lost",
        "automap/sync/clock.py",
        "return SyncResult(fit.clock, fit=fit, warnings=list(fit.warnings))",
        "return SyncResult(fit.clock, fit=fit)",
        ("test_sync_arrival.py",),
    ),
    Known(
        "a gate's slack not squared",
        "automap/geolocation/landmark_kernels.py",
        "sd[box, 0] ** 2 + slack_rad**2",
        "sd[box, 0] ** 2 + slack_rad",
        ("test_geolocation_landmark.py",),
    ),
    Known(
        "the sign of the east-north weight where sightings are merged",
        "automap/mapping/candidates.py",
        "own[i, 2] / det, -own[i, 1] / det, own[i, 0] / det",
        "own[i, 2] / det, own[i, 1] / det, own[i, 0] / det",
        ("test_merge_correlation.py",),
    ),
    Known(
        "the sign of the bias-scale covariance of the accelerometer",
        "automap/calibration/accelerometer.py",
        "-np.diag(unit * centre)",
        "np.diag(unit * centre)",
        ("test_calibration_covariance.py",),
    ),
    Known(
        "the wrong rest's uncertainty in the gyro's fit",
        "automap/calibration/gyroscope.py",
        "direction_var[i] + direction_var[i + 1]",
        "direction_var[i] + direction_var[i]",
        ("test_calibration_covariance.py",),
    ),
    Known(
        "held-out colour not divided by its variance",
        "automap/gap/scoring.py",
        "float(np.mean(rest**2)) / max(variance, 1e-12)",
        "float(np.mean(rest**2))",
        ("test_gap_heldout.py",),
    ),
    Known(
        "the cache's key without the files behind settings",
        "pipeline/run/cache.py",
        "(*stage.inputs(drive), *stage.setting_files(settings))",
        "stage.inputs(drive)",
        ("test_cache_inputs.py",),
    ),
)
