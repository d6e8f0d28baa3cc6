"""Speed and memory of the fusion on long drives at 100 Hz with fixes at 5 Hz.

    python tests/benchmarks/fusion_speed.py [--hours H] [--folder DIR]

Printed: epochs a second of the forward filter and of filter and smoother (21 states and the
default model; processor time of one core, best of three), seconds of the whole fusion, peak
memory. With ``--folder`` the drive is also written there and ``automap run --to fuse`` timed.
"""

from __future__ import annotations

import argparse
import gc
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.kernel_runs import Start, run_forward, run_smoother
from automap.fusion.model import build_state_model
from automap.fusion.nodes import Nodes, Shift, build_nodes, model_fixes
from automap.fusion.options import DEFAULT_EFFECTS, FusionOptions
from automap.fusion.problem import make_problem
from automap.fusion.result import Prior
from automap.io.ubx_writer import nav_pvt
from automap.records import Fixes, ImuData
from tests.unit.fusion_drive import BASE_NS, CLOCK, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_problem import true_start
from tests.unit.fusion_receiver import GPS0, Receiver, receive

STATES_21 = ("accel_bias", "gyro_bias", "accel_scale", "gyro_scale")


def make_drive(seconds: float) -> tuple[ImuData, Fixes, Start]:
    """A simulated drive and its true start."""
    motion = city_drive(seconds, 1)
    return (
        record(motion, Sensor(), 2),
        receive(motion, Receiver(), 3),
        true_start(motion),
    )


def nodes_of(imu: ImuData, fixes: Fixes, options: FusionOptions) -> Nodes:
    """The nodes of a drive with the vehicle constraint."""
    model = model_fixes(fixes, fixes.gps_s - GPS0, options)
    speed = np.hypot(model.values[:, 3], model.values[:, 4])
    span = (0.0, float((imu.t_ns[-1] - imu.t_ns[0]) * 1e-9))
    return build_nodes(
        model=model,
        shift=Shift(),
        span=span,
        standstill=[],
        speed_t=model.t,
        speed=speed,
        lateral=np.zeros_like(speed),
        odometer=None,
        options=options,
        constrained=True,
    )


def time_kernels(imu: ImuData, fixes: Fixes, start: Start, effects: tuple[str, ...]) -> str:
    """Epochs a second of forward filter, and with the smoother."""
    options = FusionOptions(effects=effects)
    problem = make_problem(imu, build_state_model(options), options)
    nodes = nodes_of(imu, fixes, options)
    forward_s, both_s = np.inf, np.inf
    for _ in range(3):
        begin = time.process_time()
        forward = run_forward(problem, nodes, start, Shift())
        middle = time.process_time()
        smooth = run_smoother(problem, forward)
        both_s = min(both_s, time.process_time() - begin)
        forward_s = min(forward_s, middle - begin)
        del forward, smooth
        gc.collect()
    n = len(imu)
    return (
        f"{problem.model.size} states: forward {n / forward_s / 1e6:.2f} million epochs/s, "
        f"with smoothing {n / both_s / 1e6:.2f}"
    )


def peak_mb() -> float:
    """Peak resident memory of this process since it began, without its parent's."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return float(line.split()[1]) / 1024.0
    return float("nan")


# a small process in between: the peak that a child reports includes that of who started it
_RESOURCES = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0)
"""


def write_folder(folder: Path, imu: ImuData, fixes: Fixes) -> None:
    """A drive folder with an IMU table, a UBX log and arrival times."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = np.column_stack([imu.gyro, imu.accel])
    with (folder / "imu.csv").open("w") as file:
        file.write("t_ns,gx,gy,gz,ax,ay,az\n")
        for t, row in zip(imu.t_ns, rows, strict=True):
            file.write(f"{t}," + ",".join(f"{v:.7f}" for v in row) + "\n")
    messages = nav_pvt(fixes)
    (folder / "gnss.ubx").write_bytes(b"".join(messages))
    jitter = np.random.default_rng(0).exponential(0.004, len(fixes))
    arrival = BASE_NS + np.rint((fixes.gps_s - GPS0 + 0.07 + jitter) * 1e9).astype(np.int64)
    size = len(messages[0])
    with (folder / "gnss_arrival.csv").open("w") as file:
        file.write("offset,t_ns\n")
        for i, t in enumerate(arrival):
            file.write(f"{i * size},{t}\n")
    (folder / "drive.toml").write_text(
        'schema = "automap.drive/1"\n[imu]\nfile = "imu.csv"\n[gnss]\nfile = "gnss.ubx"\n'
        'arrival = "gnss_arrival.csv"\noutput_delay_s = 0.07\nlever_arm_m = [0.0, 0.0, 0.0]\n'
    )


def time_command(folder: Path) -> str:
    """``automap run --to fuse`` into a fresh folder, kernels compiled: times, memory."""
    command = Path(sys.executable).parent / "automap"
    wall, figures = 0.0, ["nan", "nan"]
    for attempt in range(2):
        out = folder / f"out-{attempt}"
        begin = time.perf_counter()
        run = [str(command), "run", str(folder), "-o", str(out), "--to", "fuse", "--force"]
        done = subprocess.run(
            [sys.executable, "-c", _RESOURCES, *run], check=True, capture_output=True, text=True
        )
        wall, figures = time.perf_counter() - begin, done.stdout.split()
    return (
        f"automap run --to fuse: {wall:.1f} s, processor time {float(figures[0]):.1f} s "
        f"(target 15), peak {float(figures[1]):.0f} MB (target 1000)"
    )


def measure_fusion(imu: ImuData, fixes: Fixes) -> str:
    """The whole fusion in a process of its own, so that the memory is its own."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drive.npz"
        columns = {f"fix_{k}": v for k, v in vars(fixes).items()}
        np.savez(path, t_ns=imu.t_ns, gyro=imu.gyro, accel=imu.accel, **columns)
        done = subprocess.run(
            [sys.executable, __file__, "--measure", str(path)],
            check=True,
            capture_output=True,
            text=True,
            env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
        )
    return done.stdout.strip()


def _measured(path: Path) -> None:
    stored = np.load(path)
    imu = ImuData(stored["t_ns"], stored["gyro"], stored["accel"])
    fixes = Fixes(**{k[4:]: stored[k] for k in stored.files if k.startswith("fix_")})
    loaded, begin, wall = peak_mb(), time.process_time(), time.perf_counter()
    fuse_imu_gnss(imu, fixes, CLOCK, FusionOptions(), Prior(0.0, 0.02), lever_arm=np.zeros(3))
    print(
        f"whole fusion: processor time {time.process_time() - begin:.1f} s, wall "
        f"{time.perf_counter() - wall:.1f} s, peak {peak_mb():.0f} MB (of it {loaded:.0f} MB "
        "with the readings loaded; targets 600 for an hour, 3000 for ten)"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--whole-only", action="store_true", help="time and memory of the fusion")
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure is not None:
        _measured(options.measure)
        return
    imu, fixes, start = make_drive(options.hours * 3600.0)
    print(f"{len(imu)} samples, {len(fixes)} fixes")
    if not options.whole_only:
        print(time_kernels(imu, fixes, start, STATES_21), "(targets 0.8 and 0.4)")
        print(time_kernels(imu, fixes, start, (*DEFAULT_EFFECTS, "gnss_lever_arm")))
    print(measure_fusion(imu, fixes))
    if options.folder is not None:
        write_folder(options.folder, imu, fixes)
        print(time_command(options.folder))


if __name__ == "__main__":
    main()
