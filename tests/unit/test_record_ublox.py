"""Setting up a u-blox receiver that acknowledges, refuses, keeps silent or forgets."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pipeline.record import ublox_keys as keys
from pipeline.record.messages import ubx_frame
from pipeline.record.ports import SerialPort
from pipeline.record.restore import port_exchange
from pipeline.record.ublox import Outcome, Receiver, RefusedError, Setup, SilentError
from pipeline.record.ublox_version import parse_version
from tests.slow_cases import others_slow
from tests.unit.simulated_receiver import PVT_KEY_UART1, RAWX_KEY_UART1, SimulatedReceiver

Make = Callable[..., SimulatedReceiver]


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Make]:
    """Makes simulated receivers that are unplugged in the end."""
    made: list[SimulatedReceiver] = []

    def simulated(**options: object) -> SimulatedReceiver:
        receiver = SimulatedReceiver(tmp_path / f"gnss{len(made)}", **options)  # type: ignore[arg-type]
        receiver.start()
        made.append(receiver)
        return receiver

    yield simulated
    for receiver in made:
        receiver.stop()


def talk(
    simulated: SimulatedReceiver, setup: Setup, timeout_s: float = 1.0
) -> tuple[Outcome, SerialPort, Receiver]:
    port = SerialPort(str(simulated.terminal.link), simulated.baud)
    receiver = Receiver(port_exchange(port), timeout_s=timeout_s, tries=2)
    return receiver.configure(setup, port.set_baud), port, receiver


def test_keys_are_those_of_the_interface_description() -> None:
    from pyubx2 import UBX_CONFIG_DATABASE

    def number(name: str) -> int:
        return int(UBX_CONFIG_DATABASE[name][0])

    assert number("CFG_RATE_MEAS") == keys.KEY_RATE_MEAS
    assert number("CFG_RATE_NAV") == keys.KEY_RATE_NAV
    names = {
        keys.NAV_PVT: "UBX_NAV_PVT",
        keys.RXM_RAWX: "UBX_RXM_RAWX",
        keys.RXM_SFRBX: "UBX_RXM_SFRBX",
    }
    for message, name in names.items():
        for port, step in keys.PORTS.items():
            assert number(f"CFG_MSGOUT_{name}_{port}") == keys.MSGOUT[message] + step
    for port, key in keys.BAUD_KEYS.items():
        assert number(f"CFG_{port}_BAUDRATE") == key
    for port, key in keys.UBX_OUT.items():
        assert number(f"CFG_{port}OUTPROT_UBX") == key


def test_messages_are_those_that_pyubx2_writes() -> None:
    from pyubx2 import SET, UBXMessage

    theirs = UBXMessage.config_set(1, 0, [("CFG_RATE_MEAS", 200), ("CFG_UART1_BAUDRATE", 460800)])
    values = {keys.KEY_RATE_MEAS: 200, 0x40520001: 460800}
    assert ubx_frame(keys.CFG_VALSET, keys.valset_payload(values)) == theirs.serialize()
    rate = UBXMessage("CFG", "CFG-RATE", SET, measRate=200, navRate=1, timeRef=1)
    assert ubx_frame(keys.CFG_RATE, b"\xc8\0\1\0\1\0") == rate.serialize()


def test_generation_nine_is_set_read_back_and_restored(make: Make) -> None:
    simulated = make(generation=9)
    before = dict(simulated.keys)
    outcome, port, receiver = talk(simulated, Setup(raw=True, rate_hz=5))
    assert outcome.version is not None
    assert outcome.version.model == "ZED-F9P"
    assert not outcome.refused
    assert simulated.keys[PVT_KEY_UART1] == 1
    assert simulated.keys[RAWX_KEY_UART1] == 1
    assert simulated.period_ms == 200
    assert receiver.restore(outcome.before, port.set_baud) == []
    assert simulated.keys == before
    port.close()


@pytest.mark.parametrize("generation", [5, 6, 8])
def test_older_generations_are_set_by_messages(make: Make, generation: int) -> None:
    simulated = make(generation=generation)
    outcome, port, receiver = talk(simulated, Setup(raw=True, rate_hz=4))
    assert not outcome.refused
    assert simulated.period_ms == 250
    if generation == 8:
        assert simulated.on == {keys.NAV_PVT, keys.RXM_RAWX, keys.RXM_SFRBX}
    else:
        assert {keys.NAV_SOL, keys.NAV_POSLLH, keys.NAV_VELNED, keys.RXM_RAW} < simulated.on
        assert keys.NAV_PVT not in simulated.on
    assert receiver.restore(outcome.before, port.set_baud) == []
    assert simulated.on == set()
    assert simulated.period_ms == 1000
    port.close()


@pytest.mark.parametrize(("generation", "refused"), [(9, RAWX_KEY_UART1), (8, keys.RXM_RAWX)])
def test_a_refusal_is_told_and_the_rest_is_done(make: Make, generation: int, refused: int) -> None:
    simulated = make(generation=generation, refuses={refused})
    outcome, port, _ = talk(simulated, Setup(raw=True, rate_hz=2))
    assert any("RAWX" in text and "refused" in text for text in outcome.refused)
    assert keys.NAV_PVT in simulated.on
    assert simulated.period_ms == 500
    port.close()


@pytest.mark.parametrize("generation", [6, 9])
def test_what_was_acknowledged_but_not_done_is_found_by_reading_back(
    make: Make, generation: int
) -> None:
    simulated = make(generation=generation, forgets=True)
    outcome, port, _ = talk(simulated, Setup(rate_hz=5))
    assert not outcome.done
    assert outcome.refused
    assert all("reads back" in text for text in outcome.refused)
    port.close()


def test_a_silent_receiver_is_not_waited_for_long(make: Make) -> None:
    simulated = make(deaf=True)
    with pytest.raises(SilentError, match="MON-VER"):
        talk(simulated, Setup(rate_hz=5), timeout_s=0.2)
    assert simulated.commands == [keys.MON_VER] * 2


@pytest.mark.parametrize("generation", others_slow([9, 6]))
def test_both_sides_change_the_line_rate_and_go_back(make: Make, generation: int) -> None:
    simulated = make(generation=generation, baud=9600)
    outcome, port, receiver = talk(simulated, Setup(rate_hz=2, baud=115200))
    assert simulated.baud == port.baud == 115200
    assert "115200 baud" in outcome.done
    assert receiver.restore(outcome.before, port.set_baud) == []
    assert simulated.baud == port.baud == 9600
    assert receiver.version() == outcome.version
    port.close()


def test_refused_polls_raise(make: Make) -> None:
    simulated = make(generation=9)
    port = SerialPort(str(simulated.terminal.link), simulated.baud)
    receiver = Receiver(port_exchange(port), tries=2)
    with pytest.raises(RefusedError):
        receiver.get_keys([0x20910999])
    port.close()


def test_versions_of_real_receivers() -> None:
    def payload(*texts: str) -> bytes:
        first, second, *more = (text.encode() for text in texts)
        tail = b"".join(text.ljust(30, b"\0") for text in more)
        return first.ljust(30, b"\0") + second.ljust(10, b"\0") + tail

    old = parse_version(payload("7.03 (45969)", "00040007"))
    assert not old.by_keys
    assert not old.has_pvt
    m8 = parse_version(
        payload("EXT CORE 3.01 (107900)", "00080000", "ROM BASE 2.01 (75331)", "FWVER=SPG 3.01",
                "PROTVER=18.00", "GPS;GLO;GAL;BDS")
    )  # fmt: skip
    assert m8.has_pvt
    assert not m8.by_keys
    m10 = parse_version(
        payload("ROM SPG 5.10 (7b202e)", "000A0000", "FWVER=SPG 5.10", "PROTVER=34.10")
    )
    assert m10.by_keys
