"""Short recordings of pseudo-terminals, and everything that can happen to them."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from automap.errors import ConfigError, InputError
from automap.io.arrival import read_arrival
from automap.io.drive import load_drive
from automap.io.recording import read_recording
from pipeline.record import ublox_keys as keys
from pipeline.record.clock import HostClock
from pipeline.record.devices import _probe_named
from pipeline.record.imu_format import known_formats, load_format
from pipeline.record.manifest_text import read_rig
from pipeline.record.ports import PortInfo, PortSpec, SerialPort, parse_port
from pipeline.record.probe import probe_port
from pipeline.record.reader import PortReader
from pipeline.record.receiver_setup import ReceiverSetup
from pipeline.record.recorder import LOG, Plan, Recorder
from pipeline.record.replay import Terminal
from pipeline.record.ublox import Setup
from tests.unit.recorded_drive import (
    BAUD,
    feed_of,
    plan_for,
    play_in_background,
    record_command,
    recording,
    terminals,
    wait_until,
    write_drive,
)
from tests.unit.simulated_receiver import SimulatedReceiver, nav_pvt

Make = Callable[..., SimulatedReceiver]

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo-terminals")


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return write_drive(tmp_path / "drive")


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Callable[..., SimulatedReceiver]]:
    """Makes a simulated receiver at ``gnss`` that is unplugged in the end."""
    made: list[SimulatedReceiver] = []

    def simulated(**options: object) -> SimulatedReceiver:
        made.append(SimulatedReceiver(tmp_path / "gnss", **options))  # type: ignore[arg-type]
        made[-1].start()
        return made[-1]

    yield simulated
    for receiver in made:
        receiver.stop()


def events(folder: Path) -> str:
    return (folder / "recording.log").read_text(encoding="utf-8")


def imu_rows(folder: Path) -> np.ndarray:
    return np.genfromtxt(folder / "imu.csv", delimiter=",", names=True, dtype=None)


def test_every_byte_is_there_and_the_drive_can_be_read(drive: Path, tmp_path: Path) -> None:
    out, links = tmp_path / "out", tmp_path / "car"
    with terminals(drive, links) as player:
        with recording(out, plan_for(links, rig=read_rig(drive)), factor=5.0) as recorder:
            play_in_background(player, speed=5.0, settle_s=0.3, logs=links).join(30)
            assert wait_until(lambda: recorder.snapshot().imu.samples == 300)
            ending = recorder.stop()
        assert (out / "gnss.ubx").read_bytes() == feed_of(player, "gnss").data
        assert (out / "imu.raw").read_bytes() == feed_of(player, "imu").data
    assert (ending.epochs, ending.samples, ending.lost_bytes) == (30, 300, 0)
    found = load_drive(out)
    assert found.imu.axes == "FLU"
    assert found.gnss.lever_arm_m == (0.4, 0.1, -1.2)
    recorded, original = read_recording(found), read_recording(load_drive(drive))
    assert not recorded.failures
    assert recorded.imu is not None
    assert original.imu is not None
    np.testing.assert_array_equal(recorded.imu.accel, original.imu.accel)
    np.testing.assert_array_equal(recorded.imu.gyro, original.imu.gyro)
    # the device's clock is the original's, brought to the host's: one shift for all
    shift = recorded.imu.t_ns - original.imu.t_ns
    # the host may be late by tens of milliseconds when it is busy, a wrong clock is by seconds
    assert np.std(shift) < 50_000_000
    assert recorded.fixes is not None
    assert np.all(np.diff(recorded.fixes.arrival_ns) >= 0)
    summary = json.loads((out / "recording.json").read_text())
    assert summary["gnss"]["bytes"] == 3000
    assert summary["imu"]["samples"] == 300


def test_bytes_are_stamped_when_they_come(tmp_path: Path) -> None:
    out, links = tmp_path / "out", tmp_path / "car"
    links.mkdir()
    terminal = Terminal(links / "gnss")
    plan = Plan(gnss=PortSpec(str(links / "gnss"), BAUD))
    spans = []
    with recording(out, plan) as recorder:
        for number in range(12):
            before = time.monotonic_ns()
            terminal.write(b"%03d\n" % number)
            spans.append((before, time.monotonic_ns()))
            time.sleep(0.03)
        recorder.stop()
    terminal.close()
    arrival = read_arrival(out / "gnss_arrival.csv")
    offset, t_ns = arrival.offset, arrival.t_ns
    assert offset.tolist() == [4 * k for k in range(12)]
    late_ms = [(t - after) * 1e-6 for t, (_, after) in zip(t_ns.tolist(), spans, strict=True)]
    assert all(t >= before for t, (before, _) in zip(t_ns.tolist(), spans, strict=True))
    # a loaded machine delays some; a systematic delay would show in all
    assert np.median(late_ms) < 2.0


def test_unplugging_and_replugging(drive: Path, tmp_path: Path) -> None:
    """Both devices go away and come back as another terminal under the same name."""
    out, links = tmp_path / "out", tmp_path / "car"
    with recording_of(drive, links, out) as (recorder, sent):
        assert wait_until(lambda: (out / "gnss.ubx").stat().st_size == len(sent[0]))
        time.sleep(0.4)
        assert wait_until(lambda: not recorder._gnss.reader.connected)
        assert wait_until(lambda: any("away" in text for text in recorder.snapshot().troubles))
        with terminals(drive, links) as player:
            play_in_background(player, speed=10.0, settle_s=0.2).join(30)
            assert wait_until(lambda: recorder.snapshot().imu.samples == 600)
            assert wait_until(lambda: recorder.snapshot().gnss.epochs == 60)
        ending = recorder.stop()
    assert (out / "gnss.ubx").read_bytes() == sent[0] * 2
    assert (out / "imu.raw").read_bytes() == sent[1] * 2
    assert ending.summary["gnss"]["interruptions"] >= 1
    assert "is lost" in events(out)
    assert "is back after" in events(out)
    stamps = imu_rows(out)["t_ns"]
    assert len(stamps) == 600
    assert np.all(np.diff(stamps) > 0)
    # the second half lies where it was recorded, although the device's clock started anew
    assert stamps[300] - stamps[299] > 200_000_000


class recording_of:  # noqa: N801
    """A recorder that has recorded a drive once and then lost its devices."""

    def __init__(self, drive: Path, links: Path, out: Path) -> None:
        self.drive, self.links, self.out = drive, links, out

    def __enter__(self) -> tuple[Recorder, tuple[bytes, bytes]]:
        with terminals(self.drive, self.links) as player:
            self.recorder = Recorder(self.out, plan_for(self.links), HostClock())
            self.recorder.start()
            play_in_background(player, speed=10.0, settle_s=0.2).join(30)
            assert wait_until(lambda: self.recorder.snapshot().imu.samples == 300)
            return self.recorder, (feed_of(player, "gnss").data, feed_of(player, "imu").data)

    def __exit__(self, *error: object) -> None:
        if not self.recorder.stopped:
            self.recorder.stop()


def test_settings_are_undone_at_the_end_and_after_a_crash(make: Make, tmp_path: Path) -> None:
    from pipeline.record.restore_receiver import restore_receiver

    receiver = make(generation=8)
    spec = PortSpec(str(tmp_path / "gnss"), 38400)
    with recording(
        tmp_path / "a", Plan(gnss=spec, setup=Setup(rate_hz=5), restore=True)
    ) as recorder:
        assert wait_until(lambda: receiver.on == {keys.NAV_PVT})
        assert wait_until(lambda: (tmp_path / "a" / "ublox_before.json").exists())
        recorder.stop()
    assert (receiver.on, receiver.period_ms) == (set(), 1000)
    with recording(tmp_path / "b", Plan(gnss=spec, setup=Setup(rate_hz=5))):
        assert wait_until(lambda: (tmp_path / "b" / "ublox_before.json").exists())
    assert receiver.on == {keys.NAV_PVT}
    assert restore_receiver(tmp_path / "b") == []
    assert (receiver.on, receiver.period_ms) == (set(), 1000)


def test_a_receiver_that_does_not_answer_is_recorded_and_told(make: Make, tmp_path: Path) -> None:
    receiver = make(deaf=True, chatter=True)
    receiver.period_ms = 50
    plan = Plan(gnss=PortSpec(str(tmp_path / "gnss"), 38400), setup=Setup(rate_hz=5))
    with recording(tmp_path / "out", plan) as recorder:
        assert wait_until(lambda: any("does not answer" in text for text in recorder.warnings))
        assert wait_until(lambda: recorder.snapshot().gnss.messages > 10)


# ---- ports, probing, wrong usage


def test_probing_finds_rate_and_kind(make: Make, tmp_path: Path) -> None:
    receiver = make(baud=38400, chatter=True)
    receiver.period_ms = 200
    found = probe_port(str(tmp_path / "gnss"), [], (9600, 38400))
    assert (found.kind, found.baud, found.detail) == ("gnss", 38400, "NMEA")


def test_probing_asks_a_receiver_that_says_nothing(make: Make, tmp_path: Path) -> None:
    make(baud=38400)
    found = probe_port(str(tmp_path / "gnss"), [], (38400,), ask=True)
    assert (found.kind, found.baud) == ("gnss", 38400)


def test_a_sensor_on_the_receivers_port_is_known_by_its_lines(tmp_path: Path) -> None:
    formats = [load_format(name) for name in known_formats()]
    terminal = Terminal(tmp_path / "imu")
    lines = b"".join(b"%d,0.1,0.2,0.3,0.4,0.5,9.8\r\n" % (k * 10_000_000) for k in range(40))
    timer = threading.Timer(0.5, lambda: terminal.write(lines))
    timer.start()
    words = r"what --imu names \(AutoMap CSV\) was heard there; exchange --gnss and --imu"
    with pytest.raises(InputError, match=words):
        _probe_named("gnss", PortSpec(str(tmp_path / "imu"), BAUD), formats)
    timer.join()
    terminal.close()


def test_ports_are_named_with_their_rate() -> None:
    assert parse_port("/dev/ttyACM0") == PortSpec("/dev/ttyACM0")
    assert parse_port("COM3@115200") == PortSpec("COM3", 115200)
    for wrong in ("@9600", "COM3@", "COM3@fast", "COM3@10"):
        with pytest.raises(ConfigError, match="PORT@BAUD"):
            parse_port(wrong)


def test_a_port_that_is_not_there(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "out", Plan(gnss=PortSpec("/dev/nothing", 9600)), HostClock())
    with pytest.raises(InputError, match=r"no such port.*--list-ports"):
        recorder.start()
    assert not (tmp_path / "out").exists()


def test_a_receiver_on_the_network(tmp_path: Path) -> None:
    """A port may be a URL, such as that of a serial server."""
    server = socket.create_server(("127.0.0.1", 0))
    plan = Plan(gnss=PortSpec(f"socket://127.0.0.1:{server.getsockname()[1]}", 9600))
    with recording(tmp_path / "out", plan) as recorder:
        line, _ = server.accept()
        sent = b"".join(nav_pvt(100 * k) for k in range(20))
        line.sendall(sent)
        assert wait_until(lambda: recorder.snapshot().gnss.epochs == 20)
        line.close()
        line, _ = server.accept()  # it calls again
        reader = recorder._gnss.reader
        assert wait_until(lambda: reader.interruptions == 1 and reader.connected)
        line.sendall(sent)
        assert wait_until(lambda: recorder.snapshot().gnss.messages == 40)
    line.close()
    server.close()
    assert (tmp_path / "out" / "gnss.ubx").read_bytes() == sent * 2


def test_a_usb_device_is_found_under_another_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = PortSpec(str(tmp_path / "ttyACM0"), 9600)
    reader = PortReader("gnss", spec, HostClock(), lambda level, text: None)
    reader._info = PortInfo(spec.device, "u-blox", "1546:01A8 7")
    others = [
        PortInfo("/dev/ttyUSB0", "", "0403:6001 A5"),
        PortInfo("/dev/ttyACM1", "", "1546:01A8 7"),
    ]
    monkeypatch.setattr("pipeline.record.reader.list_ports", lambda: others)
    assert reader._find() == "/dev/ttyACM1"
    monkeypatch.setattr("pipeline.record.reader.list_ports", lambda: others[:1])
    assert reader._find() is None
    assert reader.native_usb


def test_a_port_in_use(tmp_path: Path) -> None:
    terminal = Terminal(tmp_path / "gnss")
    plan = Plan(gnss=PortSpec(str(tmp_path / "gnss"), 9600))
    with (
        recording(tmp_path / "first", plan),
        pytest.raises(InputError, match="another program has it open"),
    ):
        Recorder(tmp_path / "second", plan, HostClock()).start()
    terminal.close()


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["--gnss=/dev/nothing@9600", "--imu=none"], 3, "no such port"),
        (["--gnss=none", "--imu=none"], 3, "nothing to record"),
        (["--imu=COM@x", "--gnss=none"], 2, "PORT@BAUD"),
        (["--imu-format=nonsense"], 2, "no IMU line format"),
        (["--camera=front", "--gnss=none", "--imu=none"], 2, "NAME=SOURCE"),
        (["--camera=front=/dev/video9", "--gnss=none", "--imu=none"], 3, "there is no /dev/video9"),
        (["--replay", "nowhere", "--links", "x"], 3, "no such drive folder"),
        (["--restore-receiver", "nowhere"], 3, "ublox_before.json is missing"),
        (["--rig", "nowhere.toml"], 3, "is missing"),
    ],
)
def test_wrong_usage_is_one_sentence(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    code: int,
    sentence: str,
) -> None:
    from pipeline.cli.root import run_command

    monkeypatch.chdir(tmp_path)
    assert run_command(["record", "-o", "out", *arguments]) == code
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_folder_with_a_drive_is_left_alone(drive: Path, tmp_path: Path) -> None:
    command = record_command(drive, tmp_path)
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 2
    assert "holds a drive already" in result.stderr


def test_a_recording_of_nothing_that_can_be_read_is_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from pipeline.cli.root import run_command

    terminal = Terminal(tmp_path / "gnss")  # which says nothing
    port = f"--gnss={tmp_path / 'gnss'}@9600"
    command = ["record", "-o", str(tmp_path / "out"), port, "--imu=none", "--duration=0.3"]
    assert run_command([*command, "--plain"]) == 3
    assert "is empty" in capsys.readouterr().err
    terminal.close()


@pytest.mark.parametrize(("sent", "empty"), [(b"\x00\xff" * 40, True), (nav_pvt(0), False)])
def test_noise_is_nothing_that_can_be_read_and_one_message_is(
    tmp_path: Path, sent: bytes, empty: bool
) -> None:
    terminal = Terminal(tmp_path / "gnss")
    plan = Plan(gnss=PortSpec(str(tmp_path / "gnss"), 9600))
    with recording(tmp_path / "out", plan) as recorder:
        terminal.write(sent)
        assert wait_until(lambda: recorder._gnss.log.data.size == len(sent))
        assert recorder.stop().empty == empty
    terminal.close()


def test_bytes_that_come_while_a_port_opens_leave_no_hole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is kept is one piece of what was sent, however long the recorder takes to set up."""
    discard = SerialPort.discard

    def often(port: SerialPort) -> None:
        for _ in range(300):
            discard(port)
            time.sleep(0.001)

    monkeypatch.setattr(SerialPort, "discard", often)
    terminal, halt = Terminal(tmp_path / "imu"), threading.Event()
    sent = bytearray()

    def send() -> None:
        number = 0
        while not halt.is_set():
            line = b"%08d\n" % number
            sent.extend(line[: terminal.write(line)])
            number += 1
            time.sleep(0.0002)

    reader = PortReader(
        "imu", PortSpec(str(tmp_path / "imu"), BAUD), HostClock(), lambda *told: None
    )
    reader.open()
    sender = threading.Thread(target=send, daemon=True)
    sender.start()
    reader.start()
    assert wait_until(lambda: reader.total_bytes > 20_000)
    reader.stop()
    reader.join()
    halt.set()
    sender.join()
    terminal.close()
    kept = b"".join(data or b"" for _, data in reader.take())
    assert kept in sent


def test_troubles_are_told_while_line_rates_are_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ports that are exchanged: the search for the receiver's rate held up every other word."""
    stuck = threading.Event()
    monkeypatch.setattr(ReceiverSetup, "recover", lambda _self: stuck.wait(60.0))
    with terminals(write_drive(tmp_path / "drive", 12.0), tmp_path / "car") as player:
        plan = plan_for(tmp_path / "car")
        plan = replace(plan, gnss=plan.imu, imu=plan.gnss)
        with recording(tmp_path / "rec", plan) as recorder:
            play_in_background(player)
            log = recorder.folder / LOG
            assert wait_until(lambda: "--gnss and --imu exchanged?" in log.read_text())
            stuck.set()
