"""``automap simulate --like OUT``: the twin of a recorded drive as a drive folder."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import InputError
from automap.io import names
from automap.io.json_text import parse_json

if TYPE_CHECKING:
    import numpy as np

    from automap.effects.measured import Values
    from automap.simulation.twin import NoiseModel, Twin

ODOMETER_FILE = "odometer.csv"


def write_twin(
    out: Path,
    folder: Path,
    seed: int,
    changed: Values | None = None,
    trusted: Collection[Path] = (),
) -> None:
    """Write the twin of the run in OUT into an existing empty folder; effects that are ``changed``
    have other sizes than the run found. Of the Python files of effects that the run names those are
    run that are ``trusted``.

    Raises InputError where OUT is no finished run of a drive with an IMU, or names another one.
    """
    import numpy as np

    from automap.io.clock_json import read_clock
    from automap.io.tables import read_fixes, read_imu, read_odometer
    from automap.io.trajectory_table import read_trajectory
    from automap.simulation.twin import make_twin
    from pipeline.settings.effects import EffectsSettings
    from pipeline.settings.user_effects import activate

    run, fusion = _json(out / names.RUN), _json(out / names.FUSION)
    if fusion.get("method") != "inertial":
        raise InputError(
            f"{out}: this run had no IMU, so there is no model of one to simulate; run a drive "
            "with an IMU"
        )
    # the users' effects of that run
    effects = EffectsSettings.model_validate(run["settings"].get("effects", {}))
    for path in effects.paths():
        if path.resolve() not in {each.resolve() for each in trusted}:
            raise InputError(
                f"{out / names.RUN}: the run took effects from {path}, a Python file, which is not "
                "run because a results folder names it; if you trust it, give the settings that "
                "name it with --config."
            )
    activate(effects)
    trajectory = read_trajectory(out / names.TRAJECTORY)
    fixes, imu = read_fixes(out / names.FIXES), read_imu(out / names.IMU)
    clock = read_clock(out / names.SYNC)
    late = 0.0 if fusion["delay_is_clock"] else float(fusion["imu_delay_s"])
    errors = dict(_last_errors(out))
    if late:
        errors["imu_time_offset"] = {"s": late}
    angles = np.radians(fusion["mounting_rpy_deg"])
    errors["imu_mounting"] = dict(zip(("roll", "pitch", "yaw"), map(float, angles), strict=True))
    settings = run["settings"]["fuse"]
    factors = fusion.get("noise_factors", {})
    for sensor in ("accel", "gyro"):
        walk = settings[f"{sensor}_bias_walk"] * factors.get(f"{sensor}_bias_walk", 1.0)
        errors[f"{sensor}_bias_walk"] = dict.fromkeys("xyz", float(walk))
    errors |= changed or {}
    # where no reading was the path has rows of the fixes
    trajectory = trajectory.at(np.flatnonzero(np.isin(trajectory.t_ns, imu.t_ns)))
    if len(imu.t_ns) != len(trajectory.t_ns):
        raise InputError(f"{out}: trajectory and IMU have different lengths; run it with --force")
    wheels = out / names.ODOMETER
    odometer = read_odometer(wheels) if wheels.is_file() else None
    twin = make_twin(
        trajectory,
        fixes,
        errors,
        _noise(settings, factors),
        late,
        np.random.default_rng(seed),
        imu.temp_c,
        odometer,
        None if odometer is None else clock.gps_s(odometer.t_ns),
    )
    begin = float(trajectory.gps_s[0])
    name = str(run.get("drive", {}).get("name", out.name))
    known = bool(_json(out / names.INGEST).get("imu", {}).get("axes_known", True))
    _write(folder, twin, begin, name, out, clock.output_delay_s, known)


def _json(path: Path) -> dict[str, Any]:
    try:
        return dict(parse_json(path.read_text(encoding="utf-8")))
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(
            f"{path} is missing; give the output folder of a finished `automap run`"
        ) from None
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); check its rights") from None
    except ValueError as error:
        raise InputError(f"{path} is damaged ({error}); run the drive again") from None


def _last_errors(out: Path) -> Values:
    """The fitted errors at the end of the run."""
    from automap.effects import CATALOGUE
    from automap.effects.user import UserEffect
    from automap.io.tables import floats, read_table
    from automap.simulation.twin import estimated_errors

    table = read_table(out / names.IMU_ERRORS, ("t_ns",))
    last = {c: float(floats(table, c)[-1]) for c in table.column_names if c != "t_ns"}
    # the vehicle's own (slip, springs, where the axle is) are in the path already
    kept = [e for e in CATALOGUE.values() if e.of_recorder or isinstance(e, UserEffect)]
    known = {e.name: [p.name for p in e.parameters] for e in kept}
    return estimated_errors(last, known)


def _noise(settings: Mapping[str, Any], factors: Mapping[str, float]) -> NoiseModel:
    import numpy as np

    from automap.fusion.measurements.position import unseen_errors
    from automap.simulation.twin import NoiseModel
    from pipeline.settings.fuse import FuseSettings

    options = FuseSettings.model_validate(settings).options()
    if "gnss_multipath" not in options.effects:
        options = replace(options, multipath_share=0.0)

    def level(name: str) -> float:
        return float(factors.get(name, 1.0))

    def by_axis(horizontal: str, vertical: str) -> np.ndarray:
        return np.array([level(horizontal), level(horizontal), level(vertical)])

    def sizes(horizontal: float, vertical: float) -> np.ndarray:
        return np.array([horizontal, horizontal, vertical])

    return NoiseModel(
        accel=options.accel_noise * level("accel"),
        gyro=options.gyro_noise * level("gyro"),
        wander_tau_s=options.wander_tau_s * level("wander_tau"),
        wander=options.wander_share * by_axis("wander", "wander_v"),
        multipath_tau_s=options.multipath_tau_s,
        multipath=np.full(3, options.multipath_share * level("multipath")),
        white=options.white_share * by_axis("position_h", "position_v"),
        bias=unseen_errors(np.ones((1, 3)), options, factors)[0],
        velocity=by_axis("velocity_h", "velocity_v"),
        velocity_wander_tau_s=options.velocity_wander_tau_s * level("velocity_wander_tau"),
        velocity_wander=options.velocity_wander_sd * level("velocity_wander"),
        position_sd=sizes(options.horizontal_sd_m, options.vertical_sd_m),
        common_sd=sizes(options.common_horizontal_sd_m, options.common_vertical_sd_m),
        velocity_sd=np.full(3, options.velocity_sd),
        odometer=options.odometer_sd,
    )


def _write(
    folder: Path,
    twin: Twin,
    begin_gps_s: float,
    name: str,
    source: Path,
    delay_s: float | None,
    axes_known: bool,
) -> None:
    """The drive folder; its stamps are the recorder's where arrival times tie them to GPS."""
    import numpy as np

    from automap.io.atomic import write_json
    from automap.io.imu_csv import write_imu_csv
    from automap.io.odometer_csv import write_odometer_csv
    from automap.io.ubx_writer import nav_pvt
    from automap.records import NO_TIME
    from pipeline.simulate.drive_writer import write_truth

    arrived = bool((twin.fixes.arrival_ns != NO_TIME).all())
    imu = twin.imu
    if not arrived:
        imu = replace(imu, t_ns=np.rint((twin.truth.t_s + begin_gps_s) * 1e9).astype(np.int64))
    write_imu_csv(folder / "imu.csv", imu)
    messages = nav_pvt(twin.fixes)
    (folder / "gnss.ubx").write_bytes(b"".join(messages))
    manifest = [
        'schema = "automap.drive/1"',
        f"name = {json.dumps(name + ' (twin)')}",
        "",
        "[imu]",
        'file = "imu.csv"',
        f'axes = "{"FRD" if axes_known else "unknown"}"',
        f'time = "{"boot_ns" if arrived else "gps_ns"}"',
        'gyro_unit = "rad/s"',
        'accel_unit = "m/s^2"',
        "",
        "[gnss]",
        'file = "gnss.ubx"',
    ]
    if arrived:
        offsets = np.cumsum([0] + [len(m) for m in messages[:-1]])
        rows = zip(offsets, twin.fixes.arrival_ns, strict=True)
        text = "offset,t_ns\n" + "".join(f"{o},{t}\n" for o, t in rows)
        (folder / "gnss_arrival.csv").write_text(text, encoding="utf-8", newline="\n")
        manifest += ['arrival = "gnss_arrival.csv"', 'arrival_time = "boot_ns"']
        manifest += [] if delay_s is None else [f"output_delay_s = {delay_s}"]
    manifest.append(f"lever_arm_m = {twin.lever_arm_m}")
    if twin.odometer is not None and arrived:
        write_odometer_csv(folder / ODOMETER_FILE, twin.odometer)
        manifest += ["", "[odometer]", f'file = "{ODOMETER_FILE}"']
    truth = folder / names.TRUTH_DIR
    truth.mkdir()
    write_truth(truth / names.TRUTH_TRAJECTORY, twin.truth, imu.t_ns, begin_gps_s)
    # what the simulated sensors have, for comparison with what is found
    write_json(truth / "errors.json", {"source": source.name, "errors": twin.errors})
    (folder / names.MANIFEST).write_text("\n".join(manifest) + "\n", encoding="utf-8")
