"""Effects that users write as formulas, and the models that are made of effects."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from typing import Any

import numpy as np

from automap.errors import AutoMapError
from tests.unit.scenarios import scenario
from tests.unit.scenarios_effects import _signals, users

FORMULAS = {
    "one": {
        "summary": "of readings",
        "a": {
            "on": "gyro_y",
            "formula": "2.5 * sin(heading)^2 - speed / (1 + rate)",
            "prior_sd": 0.1,
        },
        "b": {"on": "accel_z", "formula": "max(rate_x, -force_y) * pi", "prior_sd": 2, "unit": "m"},
    },
    "two": {
        "c": {"on": "position_across", "formula": "step(time - 3)", "prior_sd": 0.4},
        "d": {"on": "position_along", "formula": "min(speed, 1) + tanh(jerk_x)", "prior_sd": 0.2},
        "e": {"on": "velocity_along", "formula": "+exp(-time) + log(speed)", "prior_sd": 0.2},
        "f": {
            "on": "velocity_across",
            "formula": "sqrt(force) - abs(cos(heading))",
            "prior_sd": 0.2,
        },
        "g": {"on": "height", "formula": "sign(rate_z) + tan(rate_x)", "prior_sd": 0.2},
        "h": {"on": "velocity_down", "formula": "3", "prior_sd": 0.2},
    },
    "three": {
        "i": {"on": "odometer", "formula": "temperature_rate", "prior_sd": 0.4},
        "j": {"on": "nhc_y", "formula": "acceleration", "prior_sd": 0.4},
        "k": {"on": "nhc_z", "formula": "lateral_acceleration", "prior_sd": 0.4},
    },
    "four": {"l": {"on": "camera_time", "formula": "angular_acceleration_z", "prior_sd": 0.4}},
}


WRONG = {
    "no table": {"x": 3},
    "summary": {"x": {"summary": 3}},
    "parameter": {"x": {"a": 3}},
    "key": {"x": {"a": {"on": "gyro_x", "formla": "1", "prior_sd": 1.0}}},
    "far key": {"x": {"a": {"on": "gyro_x", "zzz": "1", "prior_sd": 1.0}}},
    "missing": {"x": {"a": {"on": "gyro_x", "prior_sd": 1.0}}},
    "sd": {"x": {"a": {"on": "gyro_x", "formula": "1", "prior_sd": True}}},
    "text sd": {"x": {"a": {"on": "gyro_x", "formula": "1", "prior_sd": "1"}}},
    "on": {"x": {"a": {"on": 3, "formula": "1", "prior_sd": 1.0}}},
    "unit": {"x": {"a": {"on": "gyro_x", "formula": "1", "prior_sd": 1.0, "unit": 2}}},
    "word": {"x": {"a": {"on": "gyro_x", "formula": "sped", "prior_sd": 1.0}}},
    "far word": {"x": {"a": {"on": "gyro_x", "formula": "qqq", "prior_sd": 1.0}}},
    "left": {"x": {"a": {"on": "gyro_x", "formula": "sped + 1", "prior_sd": 1.0}}},
    "right": {"x": {"a": {"on": "gyro_x", "formula": "1 * sped", "prior_sd": 1.0}}},
    "sign": {"x": {"a": {"on": "gyro_x", "formula": "-sped", "prior_sd": 1.0}}},
    "argument": {"x": {"a": {"on": "gyro_x", "formula": "max(1, sped)", "prior_sd": 1.0}}},
    "function": {"x": {"a": {"on": "gyro_x", "formula": "sinn(speed)", "prior_sd": 1.0}}},
    "count": {"x": {"a": {"on": "gyro_x", "formula": "max(speed)", "prior_sd": 1.0}}},
    "syntax": {"x": {"a": {"on": "gyro_x", "formula": "speed +", "prior_sd": 1.0}}},
    "node": {"x": {"a": {"on": "gyro_x", "formula": "speed > 3", "prior_sd": 1.0}}},
    "not": {"x": {"a": {"on": "gyro_x", "formula": "not speed", "prior_sd": 1.0}}},
    "modulo": {"x": {"a": {"on": "gyro_x", "formula": "speed % 3", "prior_sd": 1.0}}},
    "named": {"x": {"a": {"on": "gyro_x", "formula": "sin(x=3)", "prior_sd": 1.0}}},
    "truth": {"x": {"a": {"on": "gyro_x", "formula": "True", "prior_sd": 1.0}}},
    "text": {"x": {"a": {"on": "gyro_x", "formula": "'a'", "prior_sd": 1.0}}},
    "channel": {"x": {"a": {"on": "gyro_w", "formula": "1", "prior_sd": 1.0}}},
    "no sd": {"x": {"a": {"on": "gyro_x", "formula": "1", "prior_sd": 0.0}}},
    "endless sd": {"x": {"a": {"on": "gyro_x", "formula": "1", "prior_sd": float("inf")}}},
    "families": {
        "x": {
            "a": {"on": "gyro_x", "formula": "1", "prior_sd": 1.0},
            "b": {"on": "nhc_y", "formula": "1", "prior_sd": 1.0},
        }
    },
    "name": {"X": {"a": {"on": "gyro_x", "formula": "1", "prior_sd": 1.0}}},
    "parameter name": {"x": {"A": {"on": "gyro_x", "formula": "1", "prior_sd": 1.0}}},
    "empty": {"x": {}},
    "long": {"x" * 41: {"a": {"on": "gyro_x", "formula": "1", "prior_sd": 1.0}}},
    "just": {"x" * 40: {"a": {"on": "gyro_x", "formula": "1", "prior_sd": 1.0}}},
}


def _told(function: Any, *values: Any) -> str:
    try:
        return f"fine: {function(*values)}"
    except AutoMapError as error:
        return str(error)


@scenario
def effects_users() -> Any:
    """Users' effects from tables: formulas, their signals, and what is wrong with some."""
    from automap.effects import CATALOGUE, user
    from automap.effects.catalogue import (
        alike_to_first_order,
        bias_walks,
        effect_named,
        pairs_of_sign,
    )
    from automap.effects.user_tables import as_table, effects_of_formulas

    rng = np.random.default_rng(10)
    signals = _signals(rng, 8)
    made = effects_of_formulas(FORMULAS, "a.toml")
    odd = user.user_effect("odd", "", user.UserTerm("p", "gyro_x", lambda s: s.speed, 0.1))
    found: dict[str, Any] = {
        "wrong": {
            name: _told(lambda t: [e.name for e in effects_of_formulas(t, "b.toml")], table)
            for name, table in WRONG.items()
        },
        "tables": [as_table(e) for e in (*made, odd)],
        "effects": [
            {f.name: str(getattr(e, f.name)) for f in fields(e) if f.name != "formulas"}
            for e in made
        ],
        "towards": {c: [str(part) for part in user.towards(c)] for c in user.ACTS_ON},
        "half": as_table(
            user.user_effect(
                "half", "", made[0].formulas[0], user.UserTerm("p", "gyro_x", abs, 0.1)
            )
        ),
    }

    def broken(s: Any) -> Any:
        raise ZeroDivisionError("of the user")

    def signal(how: Any) -> Any:
        return user.user_effect("bad", "", user.UserTerm("p", "gyro_x", how, 0.1))

    with users(*made):
        found["signals"] = {
            t.signal: user.user_signal(t.signal, signals) for e in made for t in e.terms
        }
        found["camera"] = user.signal_of("four", "l", signals)
        found["travel"] = [user.user_signal(name, signals) for name in ("travel_n", "travel_e")]
        found["is"] = [user.is_users(x) for x in ("one.a", "travel_n", "speed", "temperature")]
        user.add_user_effect(odd)
        user.add_user_effect(replace(odd, summary="again"))
        found["there"] = [f"{e.name} {e.summary}" for e in user.user_effects()]
        for how in (
            broken, lambda s: 3.0, lambda s: s.speed[:2], lambda s: s.speed * np.nan,
            lambda s: "text", lambda s: None,
        ):  # fmt: skip
            user.add_user_effect(signal(how))
            text = _told(lambda: user.signal_of("bad", "p", signals))
            found[f"bad {len(found)}"] = re.sub(r"at 0x\w+", "", text)
    own = user.UserTerm("x", "gyro_x", lambda s: s.speed, 0.1)
    scale = user.user_effect("gyro", "", replace(own, parameter="scale_x"))
    found["clash"] = [
        _told(user.set_user_effects, chosen)
        for chosen in (
            [user.user_effect("accel_bias", "", own)],
            [odd, odd],
            [scale],
            [
                user.user_effect("a", "", replace(own, parameter="b_c")),
                user.user_effect("a_b", "", replace(own, parameter="c")),
            ],
        )
    ]
    found["no parameter"] = _told(user.user_effect, "odd", "")
    found["twice"] = _told(user.user_effect, "odd", "", own, own)
    found["named"] = [
        _told(effect_named, n).split("(")[0] for n in ("gyro_bais", "xyzzy", "gyro_bias")
    ]
    found["alike"] = [
        str(alike_to_first_order()),
        str(pairs_of_sign(1.0)),
        str(sorted(bias_walks())),
    ]

    def follows(e: Any) -> str:
        own = (
            *(e.nuisance, e.one_signed, e.isotropic, e.follows_accuracy, e.needs_wheels, e.states),
            *(e.sensor, e.of_recorder, e.never_negative, e.resembles, e.resembles_drift),
            e.resembles_velocity_wander,
        )
        acts = [e.acts_on(*on) for on in (("gyro",), ("velocity", "gyro"), ("position",))]
        return " ".join(map(str, (*own, *acts, e.follows("1"), len(e.terms_of("a")))))

    found["properties"] = {e.name: follows(e) for e in CATALOGUE.values()}
    found["made up"] = [follows(e) for e in made_up_effects()]
    return found


def made_up_effects() -> list[Any]:
    """Effects that differ from one another in what follows from their terms."""
    from automap.effects.effect import Effect, Parameter
    from automap.effects.terms import Kind, Term

    high, free = Parameter("a", "m", 1.0, 0.0), Parameter("b", "m", 1.0)
    shapes = {
        "no term": (),
        "wheels": (Term("a", "vehicle", Kind.SCALE, 0), Term("b", "vehicle", Kind.TIME, 0)),
        "aside": (Term("a", "vehicle", Kind.SCALE, 0), Term("b", "vehicle", Kind.AXIS, 1)),
        "slip": (Term("a", "vehicle", Kind.SLIP, 0),),
        "wheels and fixes": (Term("a", "vehicle"), Term("b", "position")),
        "late": (Term("a", "velocity", Kind.TIME), Term("b", "velocity")),
        "course": (Term("a", "position", Kind.COURSE),),
        "lag": (Term("a", "velocity", Kind.LAG),),
        "gyro": (Term("a", "gyro"), Term("b", "gyro", axis=1)),
        "both": (Term("a", "gyro"), Term("b", "accel")),
        "tilt": (Term("a", "vehicle", Kind.TURN), Term("b", "velocity", Kind.POINT)),
        "sizes": (Term("a", "position", signal="position_sd_n"), Term("b", "position")),
    }
    return [
        Effect(name, family, own, "", terms)
        for k, (name, terms) in enumerate(shapes.items())
        for family in ("imu", "gnss", "vehicle")
        for own in [((high, free), (high, replace(high, name="b")), ())[k % 3]]
    ]


@scenario
def effects_model() -> Any:
    """All effects that the filter can estimate, as its state: priors, terms, times."""
    from automap.effects import CATALOGUE
    from automap.effects.measured import MEASURED
    from automap.fusion.model import build_state_model
    from automap.fusion.options import FusionOptions

    names = [e.name for e in CATALOGUE.values() if e.family == "imu" or e.acts_on(*MEASURED)]
    whole = build_state_model(FusionOptions(effects=tuple(names)), {"gyro_bias_x": 0.3})
    # a size beside its name, for a prior that moves alone is small in the sum of all
    priors = {n: float(sd) for n, sd in zip(whole.names, whole.prior_sd, strict=True)}
    ranges = {
        f"{e.name} {p.name}": f"{p.prior_sd:g} {p.at_least:g} {p.at_most:g}"
        for e in CATALOGUE.values()
        for p in e.parameters
    }
    return {"model": replace(whole, terms=()), "priors": priors, "ranges": ranges}


@scenario
def effects_paths() -> Any:
    """Quantities of a drive from its path and from readings, whole and with holes."""
    from automap.effects.path_signals import path_signals
    from automap.effects.signals import signals_of, signals_of_readings
    from automap.records import ImuData, Trajectory

    rng = np.random.default_rng(12)
    n = 60
    t = np.cumsum(rng.uniform(0.03, 0.08, n))
    speed = 6.0 + 4.0 * np.sin(0.9 * t) - 3.9 * (t > 2.0)
    heading = 2.8 + 0.8 * t
    vel = np.column_stack([speed * np.cos(heading), speed * np.sin(heading), 0.4 * np.cos(t)])
    vel[7] = np.nan
    path = Trajectory(
        t_ns=np.int64(5 * 10**9) + np.rint(t * 1e9).astype(np.int64), gps_s=1e9 + t,
        lat_rad=0.6 + 0.001 * t, lon_rad=0.2 + 0.002 * t, height_m=300.0 + 900.0 * t, vel_ned=vel,
        rpy=np.column_stack([0.3 * np.sin(t), 0.2 * np.cos(t), np.angle(np.exp(1j * heading))]),
        sd_pos_ned=np.ones((n, 3)), sd_vel_ned=np.ones((n, 3)), sd_rpy=np.ones((n, 3)),
    )  # fmt: skip
    warm = ImuData(
        np.array([5, 6, 8]) * 10**9,
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.array([20.0, 31.0, 27.0]),
    )
    gyro, accel = rng.normal(size=(n, 3)), rng.normal(0.0, 3.0, (n, 3)) - [0.0, 0.0, 9.8]
    holes = np.where(np.arange(n) % 5 == 2, np.nan, 20.0 + t)
    fixes = (t[::9] + 0.01, np.nan_to_num(vel[::9]))
    one = tuple(a[:1] for a in (t, gyro, accel, holes + 1.0))
    wholly = path_signals(path, warm)
    told = {
        "path": wholly,
        "at": wholly.at(path.t_ns[::7] + 10**7),
        "cold": path_signals(path),
        "readings": signals_of_readings(t, gyro, accel, holes, *fixes),
        "no fixes": signals_of_readings(t, gyro, accel, None, t[:1], vel[:1]),
        "crawl": signals_of_readings(t, gyro, accel, np.full(n, np.nan), fixes[0], 0.05 * fixes[1]),
        "quick": signals_of_readings(0.02 * t, gyro, accel, None, 0.02 * fixes[0], fixes[1]),
        "known": signals_of(t, np.nan_to_num(vel), heading, speed, gyro, accel, holes),
        "one": signals_of(one[0], np.ones((1, 3)), one[0], one[0], one[1], one[2], one[3]),
    }
    named = ("rate", "force", "travel_n", "travel_e")
    sizes = {
        name: [getattr(told[key], name) for name in named]
        for name, key in (("r", "readings"), ("k", "known"))
    }
    return told | {"sizes": sizes}
