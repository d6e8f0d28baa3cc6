"""Write a simulated drive as a drive folder with its truth."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from automap.effects import Signals
from automap.effects.camera_user import depends_on_the_drive, drift
from automap.effects.vehicle import parameter
from automap.errors import ConfigError
from automap.io import names
from automap.io.atomic import write_json
from automap.io.imu_csv import write_imu_csv
from automap.io.nmea_writer import gga_rmc
from automap.io.odometer_csv import write_odometer_csv
from automap.io.ubx_writer import nav_pvt
from automap.records import ClockModel, FixErrors, Fixes, FloatArray, IntArray
from automap.signs.vocabulary import load_vocabulary
from automap.simulation.boxes import detections_csv, sign_boxes, stated_camera
from automap.simulation.camera import Painter, camera_views
from automap.simulation.errors import error_values
from automap.simulation.gnss import arrivals
from automap.simulation.imu import temperature, true_signals
from automap.simulation.replay import Replayed, other_errors
from automap.simulation.scenario import CameraSetup, Gnss, Scenario
from automap.simulation.scene import Scene, SceneSign, build_scene
from automap.simulation.sensors import random_streams, simulate_sensors
from automap.simulation.trajectory import DriveMotion, Motion
from pipeline.shared.progress import Progress
from pipeline.simulate.replay import recorded_errors

_VIDEO_CLOCK = 90_000
_SIGNAL_STEP_S = 0.01
ODOMETER_FILE = "odometer.csv"
DETECTIONS_FILE = "front_detections.csv"


def write_drive(
    scenario: Scenario,
    folder: Path,
    seed: int | None = None,
    progress: Progress = lambda fraction, text: None,
    signs: Sequence[SceneSign] = (),
) -> list[str]:
    """Simulate a scenario into an existing empty folder, in the layout of ``automap.drive/1``.

    Each sensor draws from its own random stream, so that changing one leaves the others as
    they were. ``seed`` replaces the scenario's. ``signs`` stand there besides the scenario's own,
    as those of a town through which other drives go too, in metres about its start. Returns a
    sentence for each place where replayed errors begin anew. Raises ConfigError for effects or sign
    classes that do not exist, InputError for errors that cannot be replayed, OSError when the
    folder cannot be written.
    """
    _check_signs(scenario)
    streams = random_streams(scenario.seed if seed is None else seed)
    given = scenario.gnss.replay if scenario.gnss is not None else None
    recorded = recorded_errors(Path(given.errors)) if given is not None else None
    sensors = simulate_sensors(scenario, streams, progress, recorded)
    drive, imu = sensors.drive, sensors.imu
    write_imu_csv(folder / "imu.csv", imu)
    truth = folder / names.TRUTH_DIR
    truth.mkdir()
    # the vehicle's state at the instants of the stamps, whatever is wrong with these
    motion = drive.at(sensors.seconds(imu.t_ns))
    write_truth(truth / names.TRUTH_TRAJECTORY, motion, imu.t_ns, sensors.begin_gps_s)
    if sensors.fixes is not None and scenario.gnss is not None:
        _write_gnss(folder, sensors.fixes, scenario.gnss, sensors.clock, streams.gnss)
    if sensors.odometer is not None:
        write_odometer_csv(folder / ODOMETER_FILE, sensors.odometer)
    scene = build_scene(scenario, drive, streams.scene)
    scene = replace(scene, signs=(*scene.signs, *signs))
    _write_signs(truth / names.TRUTH_SIGNS, scene)
    if scenario.camera is not None:
        (folder / "video").mkdir()
        _write_video(folder / "video", scenario, drive, scene, streams.camera, progress)
    (folder / names.MANIFEST).write_text(_manifest(scenario), encoding="utf-8")
    write_json(truth / "errors.json", _errors(scenario, recorded, sensors.replayed))
    return _seams(sensors.replayed)


def _errors(
    scenario: Scenario, recorded: FixErrors | None, replayed: Replayed | None
) -> dict[str, Any]:
    """What the simulated sensors have, for comparison with what is found."""
    errors = error_values(scenario.errors)
    out: dict[str, Any] = {"errors": errors}
    if scenario.gnss is not None and scenario.gnss.receiver:
        out["receiver"] = scenario.gnss.receiver
    if recorded is not None and replayed is not None:
        out["errors"] = dict(other_errors(errors, recorded))
        out["replay"] = {"start_s": replayed.start_s, "seams_s": list(replayed.seams_s)}
    return out


def _seams(replayed: Replayed | None) -> list[str]:
    """A sentence for each seam."""
    seams = () if replayed is None else replayed.seams_s
    return [f"the receiver's recorded errors begin anew {at:.1f} s into the drive" for at in seams]


def _check_signs(scenario: Scenario) -> None:
    known = load_vocabulary().classes
    for placed in scenario.signs:
        if placed.sign not in known:
            raise ConfigError(
                f"the scenario has a sign '{placed.sign}' at {placed.at_m} m that is not in the "
                "vocabulary; use a name of automap/signs/data/vocabulary.toml"
            )


def write_truth(path: Path, motion: Motion, t_ns: IntArray, begin_gps_s: float) -> None:
    degrees = np.degrees(motion.rpy)
    degrees[:, 2] %= 360.0
    with path.open("w", encoding="utf-8", newline="\n") as out:
        out.write("t_ns,gps_s,lat_deg,lon_deg,height_m,vn,ve,vd,roll_deg,pitch_deg,yaw_deg\n")
        for i in range(len(t_ns)):
            v, a = motion.vel_ned[i], degrees[i]
            out.write(
                f"{t_ns[i]},{begin_gps_s + motion.t_s[i]:.6f},"
                f"{np.degrees(motion.lat_rad[i]):.9f},{np.degrees(motion.lon_rad[i]):.9f},"
                f"{motion.height_m[i]:.4f},{v[0]:.5f},{v[1]:.5f},{v[2]:.5f},"
                f"{a[0]:.5f},{a[1]:.5f},{a[2]:.5f}\n"
            )


def _write_gnss(
    folder: Path, fixes: Fixes, setup: Gnss, clock: ClockModel, rng: np.random.Generator
) -> None:
    messages = gga_rmc(fixes) if setup.format == "nmea" else nav_pvt(fixes)
    stamps = arrivals(fixes.gps_s, setup, clock.t_ns, rng)
    (folder / f"gnss.{setup.format}").write_bytes(b"".join(messages))
    offsets = np.cumsum([0] + [len(m) for m in messages[:-1]])
    lines = [f"{o},{t}\n" for o, t in zip(offsets, stamps, strict=True)]
    text = "offset,t_ns\n" + "".join(lines)
    (folder / "gnss_arrival.csv").write_text(text, encoding="utf-8", newline="\n")


def _write_signs(path: Path, scene: Scene) -> None:
    from automap import earth

    features = []
    for number, sign in enumerate(scene.signs):
        lat, lon, height = earth.from_local_ned(sign.centre, scene.ref)
        features.append(
            {
                "type": "Feature",
                "id": f"sign-{number + 1}",
                "geometry": {
                    "type": "Point",
                    "coordinates": [
                        round(float(np.degrees(lon)), 9),
                        round(float(np.degrees(lat)), 9),
                        round(float(height), 3),
                    ],
                },
                "properties": {
                    "class": sign.name,
                    "facing_deg": round(float(np.degrees(sign.facing_rad) % 360.0), 2),
                    "height_above_road_m": round(float(sign.foot[2] - sign.centre[2]), 3),
                    "size_m": sign.size_m,
                    "sd_m": 0.0,
                },
            }
        )
    collection = {"type": "FeatureCollection", "features": features}
    path.write_text(json.dumps(collection, indent=1) + "\n", encoding="utf-8", newline="\n")


def _write_video(
    folder: Path,
    scenario: Scenario,
    drive: DriveMotion,
    scene: Scene,
    rng: np.random.Generator,
    progress: Progress,
) -> None:
    """Frames at jittered true times; the container's stamps are exact, the table's are noisy.

    A camera whose boxes are wanted has these in place of the video.
    """
    setup = scenario.camera
    assert setup is not None
    period = 1.0 / setup.frame_rate_hz
    count = int((drive.duration_s - 0.2) / period)
    times: FloatArray = 0.1 + np.arange(count) * np.float64(period)
    times += np.clip(rng.standard_normal(count) * setup.frame_jitter_s, -period / 3, period / 3)
    errors = error_values(scenario.errors)
    signals = _camera_signals(scenario, drive) if depends_on_the_drive(errors) else None
    if setup.box_sd_px is not None:
        boxes = sign_boxes(drive, setup, errors, times, scene, rng, signals)
        path = folder / DETECTIONS_FILE
        path.write_text(detections_csv(boxes), encoding="utf-8", newline="\n")
    else:
        _draw_video(folder / "front.mp4", scenario, setup, drive, scene, times, rng, progress)
    rate = 1.0 + scenario.clock.drift_ppm * 1e-6
    stamps = times + rng.standard_normal(count) * setup.stamp_noise_s
    stamps -= parameter(errors, "camera_time_offset")
    if signals is not None:
        stamps -= drift(errors, signals.at(times))[1]
    t_ns = scenario.clock.start_ns + np.rint(stamps / rate * 1e9).astype(np.int64)
    text = "frame,t_ns\n" + "".join(f"{i},{t}\n" for i, t in enumerate(t_ns))
    (folder / "front_frames.csv").write_text(text, encoding="utf-8", newline="\n")


def _camera_signals(scenario: Scenario, drive: DriveMotion) -> Signals:
    """The quantities of the drive that users' effects of its camera are functions of."""
    grid = np.arange(0.0, drive.duration_s, _SIGNAL_STEP_S)
    return true_signals(drive.at(grid), temperature(scenario, grid))


def _draw_video(
    path: Path,
    scenario: Scenario,
    setup: CameraSetup,
    drive: DriveMotion,
    scene: Scene,
    times: FloatArray,
    rng: np.random.Generator,
    progress: Progress,
) -> None:
    import av

    count = len(times)
    painter = Painter(scene, setup, scenario.scenery.brightness, rng)
    views = camera_views(drive, setup, times, scene.ref)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(setup.frame_rate_hz))
        stream.width, stream.height, stream.pix_fmt = setup.width, setup.height, "yuv420p"
        stream.time_base = stream.codec_context.time_base = Fraction(1, _VIDEO_CLOCK)
        # one thread and no macroblock tree, whose AVX-512 code reads memory that nobody wrote:
        # the same pictures give the same file
        stream.codec_context.thread_count = 1
        stream.options = {
            "crf": str(setup.quality),
            "preset": "fast",
            "x264-params": "mbtree=0:rc-lookahead=0",
        }
        for i, (view, t) in enumerate(zip(views, times, strict=True)):
            frame = av.VideoFrame.from_ndarray(painter.paint(view), format="bgr24")
            frame.pts = round((t - times[0]) * _VIDEO_CLOCK)
            frame.time_base = Fraction(1, _VIDEO_CLOCK)
            container.mux(stream.encode(frame))
            if i % 10 == 0:
                progress(i / count, f"frame {i} of {count}")
        container.mux(stream.encode())


def _output_delay(gnss: Gnss) -> list[str]:
    return [f"output_delay_s = {gnss.output_delay_s}"] if gnss.output_delay_known else []


def _manifest(scenario: Scenario) -> str:
    lines = [
        'schema = "automap.drive/1"',
        f'name = "{scenario.name}"',
        "",
        "[imu]",
        'file = "imu.csv"',
        'axes = "FRD"',
        'time = "boot_ns"',
        'gyro_unit = "rad/s"',
        'accel_unit = "m/s^2"',
    ]
    if scenario.gnss is not None:
        lines += [
            "",
            "[gnss]",
            f'file = "gnss.{scenario.gnss.format}"',
            'arrival = "gnss_arrival.csv"',
            'arrival_time = "boot_ns"',
            *_output_delay(scenario.gnss),
            f"lever_arm_m = {list(scenario.gnss.lever_arm_m)}",
        ]
    if scenario.odometer is not None:
        lines += ["", "[odometer]", f'file = "{ODOMETER_FILE}"']
    if scenario.camera is not None:
        lines += _video_section(scenario.camera)
    lines += [
        "",
        "[site]",
        *(f'{key} = "{value}"' for key, value in scenario.place if value is not None),
        "",
        "[vehicle]",
        f"imu_above_road_m = {scenario.vehicle.imu_height_m!r}",
    ]
    return "\n".join(lines) + "\n"


def _video_section(setup: CameraSetup) -> list[str]:
    cx, cy = stated_camera(setup).matrix[:2, 2].tolist()
    f = setup.focal_px
    mount = np.array(setup.mount_rpy_deg) + np.array(setup.mount_error_deg)
    return [
        "",
        "[video.front]",
        'files = ["video/front.mp4"]'
        if setup.box_sd_px is None
        else f'detections = "video/{DETECTIONS_FILE}"',
        'frames = "video/front_frames.csv"',
        'time = "boot_ns"',
        f"width = {setup.width}",
        f"height = {setup.height}",
        f"camera_matrix = [[{f}, 0.0, {cx}], [0.0, {f}, {cy}], [0.0, 0.0, 1.0]]",
        "distortion = [0.0, 0.0, 0.0, 0.0, 0.0]",
        f"lever_arm_m = {list(setup.lever_arm_m)}",
        f"lever_arm_sigma_m = {setup.lever_arm_sigma_m}",
        f"mount_rpy_deg = {[round(float(a), 6) for a in mount]}",
        f"mount_rpy_sigma_deg = {setup.mount_rpy_sigma_deg}",
        "time_offset_s = 0.0",
        f"time_offset_sigma_s = {setup.time_offset_sigma_s}",
    ]
