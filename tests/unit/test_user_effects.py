"""Effects of users: formulas, Python files, and their part in simulator, filter and gap finder."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from automap.effects import CATALOGUE, Signals, UserTerm, distort_imu, user_effect
from automap.effects.formula_text import parse_formula
from automap.effects.signals import FIELDS, signals_of, signals_of_readings
from automap.effects.user import set_user_effects, signal_of, towards, turned
from automap.effects.user_tables import as_table, effects_of_formulas
from automap.errors import ConfigError
from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.options import FusionOptions
from automap.fusion.result import Prior
from automap.gap import base_model
from automap.gap.columns import effect_columns, term_columns
from automap.gap.drive import open_drive
from automap.gap.fit import fit_drive
from automap.gap.motion import motion_of
from automap.gap.nodes import node_motion
from automap.gap.sensitivity import sensitivities
from automap.simulation.sensors import random_streams, simulate_sensors
from pipeline.settings.load import load_settings
from pipeline.settings.user_effects import activate, effects_of_python
from pipeline.simulate.command import simulate
from tests.docs_commands import DOCS, files
from tests.unit.gap_linear import changes
from tests.unit.gap_values import estimates
from tests.unit.test_gap import ARM, scenario_with, simulated

PULL = {"k": {"on": "accel_x", "formula": "sin(heading)", "prior_sd": 0.05, "unit": "m/s^2"}}
STRETCH = {"k": {"on": "position_along", "formula": "speed^2 / 100", "prior_sd": 0.5}}


@pytest.fixture(autouse=True)
def no_effects_stay() -> Iterator[None]:
    yield
    set_user_effects([])


def some_signals(n: int = 50) -> Signals:
    t = np.linspace(0.0, 5.0, n)
    names = [name for name in FIELDS if name != "time"]
    return Signals(time=t, **{name: np.sin(t + i) for i, name in enumerate(names)})


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("sin(heading) * speed^2", lambda s: np.sin(s.heading) * s.speed**2),
        ("max(force_x, 0) - -2e-1", lambda s: np.maximum(s.force_x, 0.0) + 0.2),
        ("step(time - 2) / (1 + abs(rate_z))", lambda s: (s.time > 2) / (1 + abs(s.rate_z))),
        ("exp(-time / 30) * pi", lambda s: np.exp(-s.time / 30.0) * np.pi),
        ("rate + force", lambda s: s.rate + s.force),
        ("climb", lambda s: s.speed * (s.force_x - s.acceleration) / 9.80665),
        ("1", lambda s: np.ones(len(s.time))),
        ("lag(time, 2)", lambda s: s.time - 2.0 * (1.0 - np.exp(-s.time / 2.0))),
        ("play(time, 1)", lambda s: np.maximum(s.time - 1.0, 0.0)),
    ],
)
def test_a_formula_means_what_it_says(text: str, value: object) -> None:
    signals = some_signals()
    assert callable(value)
    np.testing.assert_allclose(parse_formula(text)(signals), value(signals), rtol=1e-10)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("sin(haeding)", "did you mean 'heading'"),
        ("sine(heading)", "did you mean 'sin'"),
        ("max(speed)", "1 of 2"),
        ("speed +", "not understood"),
        ("__import__('os')", "function '__import__'"),
        ("speed.real", "speed.real"),
        ("'a'", "not understood"),
        ("lag(speed, speed)", "a number above 0"),
        ("play(speed, 0)", "a number above 0"),
        ("[x for x in speed]", "not understood"),
    ],
)
def test_a_wrong_formula_is_refused(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match="formula") as caught:
        parse_formula(text)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({}, "no parameter"),
        ({"k": 3}, "a.k is 3"),
        ({"k": {**PULL["k"], "onn": "x"}}, "did you mean on?"),
        ({"k": {"on": "accel_x", "formula": "1"}}, "prior_sd is missing"),
        ({"k": {**PULL["k"], "prior_sd": -1.0}}, "above 0"),
        ({"k": {**PULL["k"], "on": "accel_w"}}, "accel_w"),
        ({"k": PULL["k"], "m": STRETCH["k"]}, "make an effect for each"),
        ({"K l": PULL["k"]}, "small letters"),
    ],
)
def test_a_wrong_table_names_the_key(table: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        effects_of_formulas({"a": table}, "mine.toml")
    assert said in str(caught.value)
    assert "mine.toml" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("EFFECTS = [", "line 1"),
        ("x = 1\ny = x / 0\n", "line 2: ZeroDivisionError"),
        ("x = 1\n", "no list EFFECTS"),
        ("EFFECTS = [3]\n", "EFFECTS holds 3"),
        (
            "from automap.effects import UserTerm, user_effect\n"
            "EFFECTS = [user_effect('a', 'b', UserTerm('k', 'up', abs, 1.0))]\n",
            "acts on 'up'",
        ),
    ],
)
def test_a_broken_file_says_where(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "mine.py"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"mine\.py") as caught:
        effects_of_python(path)
    assert said in str(caught.value)
    with pytest.raises(ConfigError, match="no such file"):
        effects_of_python(tmp_path / "other.py")


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (lambda s: s.speed[:3], "one number an instant"),
        (lambda s: s.nothing, "AttributeError"),
        (lambda s: np.log(s.speed * 0.0), "no number 0.0 s"),
    ],
)
def test_a_function_that_fails_is_named(function: object, said: str) -> None:
    assert callable(function)
    set_user_effects([user_effect("mine", "", UserTerm("k", "accel_x", function, 1.0))])
    with pytest.raises(ConfigError, match="'mine', parameter 'k'") as caught:
        signal_of("mine", "k", some_signals())
    assert said in str(caught.value)


def test_names_that_exist_are_refused_and_the_catalogue_comes_back() -> None:
    before = list(CATALOGUE)
    term = UserTerm("x", "accel_x", lambda s: s.speed, 1.0)
    with pytest.raises(ConfigError, match="already"):
        set_user_effects([user_effect("gyro_bias", "", term)])
    with pytest.raises(ConfigError, match="already"):
        set_user_effects([user_effect("accel", "", replace(term, parameter="bias_x"))])
    with pytest.raises(ConfigError, match="twice"):
        set_user_effects([user_effect("mine", "", term), user_effect("mine", "", term)])
    set_user_effects([user_effect("mine", "", term)])
    assert list(CATALOGUE) == [*before, "mine"]
    set_user_effects([])
    assert list(CATALOGUE) == before


def test_a_configuration_finds_the_file_beside_it(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "from automap.effects import UserTerm, user_effect\n"
        "def hum(s):\n    return s.speed * s.force_z\n"
        "EFFECTS = [user_effect('hum', 'wheels hum', UserTerm('k', 'gyro_z', hum, 1e-4))]\n",
        encoding="utf-8",
    )
    config = tmp_path / "mine.toml"
    config.write_text(
        '[effects]\nfiles = ["mine.py"]\n[effects.formulas.pull]\n'
        'k = { on = "accel_x", formula = "sin(heading)", prior_sd = 0.05 }\n',
        encoding="utf-8",
    )
    settings = load_settings(config)
    activate(settings.effects)
    assert CATALOGUE["hum"].summary == "wheels hum"
    assert CATALOGUE["pull"].family == "imu"
    activate(load_settings().effects)
    assert "hum" not in CATALOGUE
    config.write_text('[effects]\nfiles = ["none.py"]\n', encoding="utf-8")
    with pytest.raises(ConfigError, match="no such file"):
        load_settings(config)


def test_a_reading_gets_the_signal_and_a_table_comes_back() -> None:
    effects = effects_of_formulas({"pull": PULL}, "x")
    set_user_effects(effects)
    signals = some_signals()
    rest = np.zeros((len(signals.time), 3))
    gyro, accel = distort_imu(rest, rest, {"pull": {"k": 0.2}}, signals=signals)
    np.testing.assert_allclose(accel[:, 0], 0.2 * np.sin(signals.heading))
    assert not gyro.any()
    assert not accel[:, 1:].any()
    assert as_table(effects[0]) == {"summary": effects[0].summary, **PULL}


def test_directions_of_the_fixes() -> None:
    t = np.zeros(2)
    east = Signals(t, **{n: t for n in FIELDS if n != "time"})
    signals = replace(east, heading=np.array([0.0, 0.5 * np.pi]))

    def direction(channel: str) -> np.ndarray:
        out = np.zeros((2, 3))
        for part in towards(channel):
            out[:, part.axis] += part.weight * turned(np.ones(2), part.turned, signals)
        return out

    np.testing.assert_allclose(direction("position_along"), [[1, 0, 0], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(direction("velocity_across"), [[0, 1, 0], [-1, 0, 0]], atol=1e-12)
    assert direction("height")[0, 2] == -1.0


def test_readings_and_fixes_show_the_quantities_of_the_motion() -> None:
    t = np.arange(0.0, 60.0, 0.01)
    speed = 10.0 + 3.0 * np.sin(0.2 * t)
    heading = 0.5 + 0.1 * t
    gyro = np.zeros((len(t), 3))
    gyro[:, 2] = 0.1
    accel = np.zeros((len(t), 3))
    # a tilted sensor: the acceleration's slow part must come from the fixes
    accel[:, 0], accel[:, 2] = 0.6 * np.cos(0.2 * t) + 0.5, -9.8
    fixes = np.arange(0, len(t), 20)
    vel = np.stack([speed * np.cos(heading), speed * np.sin(heading), 0.0 * t], axis=1)[fixes]
    found = signals_of_readings(t, gyro, accel, None, t[fixes], vel)
    inner = slice(400, -400)
    assert np.abs(found.speed - speed)[inner].max() < 0.02
    assert np.abs(found.heading - heading)[inner].max() < 0.02
    assert np.abs(found.acceleration - 0.6 * np.cos(0.2 * t))[inner].max() < 0.05
    later = found.at(np.array([10.005]))
    assert later.rate_z[0] == pytest.approx(0.1, abs=1e-6)


def test_an_effect_of_the_user_is_estimated_by_the_filter_and_shows_in_the_screening() -> None:
    set_user_effects(effects_of_formulas({"pull": PULL}, "x"))
    model = base_model()
    opened = open_drive(simulated({"pull": {"k": 0.15}}), model.options)
    plain = fit_drive(opened, model)
    found = fit_drive(opened, model, {"pull": 1.0}, plain)
    value, sd = estimates(found, "pull")["k"]
    assert abs(value - 0.15) < 4.0 * sd
    assert sd < 0.02
    # the effect at its value, as a later run takes it from the settings
    known = fit_drive(opened, replace(model, values={"pull": {"k": 0.15}}), linearised_at=plain)
    assert known.score > plain.score + 20.0
    motion = motion_of(plain.last)
    columns = effect_columns("pull", node_motion(plain, motion), {"k": 0.05})
    phi = sensitivities(plain, motion, columns)[:, 0]
    seen, at = changes(plain, known)
    assert np.corrcoef(phi[at], seen)[0, 1] > 0.95


def test_an_effect_on_the_fixes_is_found_and_taken_out() -> None:
    set_user_effects(effects_of_formulas({"stretch": STRETCH}, "x"))
    model = base_model()
    opened = open_drive(simulated({"stretch": {"k": 0.8}}), model.options)
    plain = fit_drive(opened, model)
    found = fit_drive(opened, model, {"stretch": 1.0, "gyro_scale": 1.0}, plain)
    value, sd = estimates(found, "stretch")["k"]
    assert abs(value - 0.8) < 4.0 * sd
    assert sd < 0.2
    known = fit_drive(opened, replace(model, values={"stretch": {"k": 0.8}}), linearised_at=plain)
    assert known.score > plain.score + 10.0
    assert [e for e, _ in found.names] == ["stretch", "gyro_scale", "gyro_scale", "gyro_scale"]


SLIPS, SWINGS = "(1 + tanh((time - 60) / 0.3))", "sin(2 * pi * time / 20)"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("on", "text", "size"),
    [
        ("imu_yaw", SLIPS, 0.02),
        ("imu_time", SLIPS, 0.1),
        ("imu_time", SWINGS, 0.1),
        ("antenna_x", SLIPS, 2.0),
    ],
)
def test_a_unit_that_slips_in_its_mount_or_its_time_is_found(
    on: str, text: str, size: float
) -> None:
    own = {"k": {"on": on, "formula": text, "prior_sd": size}}
    set_user_effects(effects_of_formulas({"slips": own}, "x"))
    model = base_model()
    recorded = simulated({"slips": {"k": 0.5 * size}})
    opened = open_drive(recorded, model.options)
    plain = fit_drive(opened, model)
    # beside an angle or an offset that stays
    same = {"imu_time": "imu_time_offset", "imu_yaw": "imu_mounting"}.get(on, "gnss_lever_arm")
    found = fit_drive(opened, model, {"slips": 1.0, same: 1.0}, plain)
    value, sd = estimates(found, "slips")["k"]
    assert abs(value - 0.5 * size) < 4.0 * sd
    assert sd < 0.1 * size
    at = node_motion(plain, motion_of(plain.last))
    (column,) = effect_columns("slips", at, {"k": 0.05})
    (formula,) = term_columns(at, [(on, text)])
    unit, asked = (sensitivities(plain, at.motion, [c])[:, 0] for c in (column, formula))
    assert np.abs(unit).max() > 0.0
    np.testing.assert_allclose(asked, unit, atol=1e-5 * np.abs(unit).max())
    assert CATALOGUE["slips"].family == CATALOGUE[same].family


@pytest.mark.slow
def test_the_path_is_that_of_the_vehicle_whatever_the_unit_does_in_it() -> None:
    tables = {
        "slips": {"k": {"on": "imu_yaw", "formula": SLIPS, "prior_sd": 0.1}},
        "steps": {"k": {"on": "imu_time", "formula": SLIPS, "prior_sd": 0.1}},
    }
    set_user_effects(effects_of_formulas(tables, "x"))
    errors = {"slips": {"k": 0.03}, "steps": {"k": 0.05}}
    sensors = simulate_sensors(scenario_with(errors), random_streams(4))
    assert sensors.fixes is not None
    offs = []
    for fixed in ({}, errors):
        options = replace(FusionOptions(), fixed=fixed)
        given = (sensors.imu, sensors.fixes, sensors.clock, options, Prior(0.0, 1e-3), ARM)
        path = fuse_imu_gnss(*given, delay_is_clock=True).trajectory
        t = path.gps_s - sensors.begin_gps_s
        true = sensors.drive.at(np.maximum(t, 0.0))
        off = np.remainder(path.rpy[:, 2] - true.rpy[:, 2] + np.pi, 2.0 * np.pi) - np.pi
        offs.append(float(np.sqrt(np.mean(off[t > 62.0] ** 2))))
    assert offs[0] > 0.01
    assert offs[1] < 0.003


def test_the_files_of_the_documentation_are_accepted(tmp_path: Path) -> None:
    for name, content in files(DOCS / "gap.md").items():
        (tmp_path / name).write_text(content, encoding="utf-8")
    settings = load_settings(tmp_path / "magnet.toml")
    activate(settings.effects)
    assert settings.fuse.fixed == {"magnet_pull": {"k": 0.1}}
    assert CATALOGUE["magnet_pull"].parameters[0].unit == "m/s^2"
    both = tmp_path / "both.toml"
    text = (tmp_path / "my_effects.toml").read_text(encoding="utf-8")
    both.write_text('[effects]\nfiles = ["my_effects.py"]\n' + text, encoding="utf-8")
    activate(load_settings(both).effects)
    signals = some_signals()
    hum = signal_of("tyre_hum", "k", signals)
    np.testing.assert_allclose(hum, signals.speed * np.abs(signals.rate_z))


def test_a_model_gives_a_scenario_its_errors(tmp_path: Path) -> None:
    for name, content in files(DOCS / "gap.md").items():
        (tmp_path / name).write_text(content, encoding="utf-8")
    scenario = tmp_path / "short.toml"
    scenario.write_text(
        'schema = "automap.scenario/1"\nname = "short"\n[start]\nutc = 2026-03-14T09:20:00Z\n'
        "lat_deg = -35.28\nlon_deg = 149.13\nheading_deg = 90.0\n[errors]\n"
        "gyro_bias = { x = 0.001 }\n[gnss]\n"
        "[route]\nlegs = [{ length_m = 30.0, speed_m_s = 10.0 }]\n",
        encoding="utf-8",
    )
    simulate(scenario, tmp_path / "plain")
    simulate(scenario, tmp_path / "pulled", config=tmp_path / "magnet.toml")
    read = [
        np.loadtxt(tmp_path / name / "imu.csv", delimiter=",", skiprows=1)
        for name in ("plain", "pulled")
    ]
    off = read[1][:, 4] - read[0][:, 4]
    # to the east the sine of the heading is one
    assert np.abs(off - 0.1).max() < 1e-3
    np.testing.assert_array_equal(read[0][:, :4], read[1][:, :4])


def test_changes_of_a_noisy_turn_are_those_of_the_vehicle() -> None:
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 60.0, 0.01)
    swing = 2.0 * np.pi / 8.0
    rate = np.zeros((len(t), 3))
    rate[:, 2] = 0.3 * np.sin(swing * t)
    force = np.column_stack([np.cos(swing * t), np.zeros_like(t), np.full_like(t, -9.8)])
    noisy = rate + 0.003 * rng.standard_normal(rate.shape)
    found = signals_of(t, np.zeros((len(t), 3)), t, t, noisy, force, None)
    inside = slice(50, -50)
    true = 0.3 * swing * np.cos(swing * t)
    off = (found.angular_acceleration_z - true)[inside]
    # plain differences of the readings would be off by 0.2 rad/s^2
    assert np.std(off) < 0.03
    np.testing.assert_allclose(found.jerk_x[inside], -swing * np.sin(swing * t)[inside], atol=2e-3)
    assert np.std(found.angular_acceleration_x[inside]) < 0.03
