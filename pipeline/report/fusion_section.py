"""The section on the fusion: what it estimated about the installation and the noise, in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from automap.io import names
from pipeline.pages.section import Section
from pipeline.report.figures import duration_text
from pipeline.shared.products import RunProducts

_NOISE = {
    "accel": ("accelerometer noise", "the setting"),
    "gyro": ("gyro noise", "the setting"),
    "position_h": ("GPS position, horizontal", "what the receiver states"),
    "position_v": ("GPS position, vertical", "what the receiver states"),
    "velocity_h": ("GPS velocity, horizontal", "what the receiver states"),
    "velocity_v": ("GPS velocity, vertical", "what the receiver states"),
    "accel_bias_walk": ("accelerometer drift", "the setting"),
    "gyro_bias_walk": ("gyro drift", "the setting"),
    "wander": ("slow error of GPS positions, horizontal", "what the receiver states"),
    "wander_v": ("slow error of GPS positions, vertical", "what the receiver states"),
    "multipath": ("GPS position error of seconds", "what the receiver states"),
    "velocity_wander": ("GPS velocity error that lasts", "the setting"),
    "wander_tau": ("correlation time of the slow error", "the setting"),
    "velocity_wander_tau": ("correlation time of the velocity's error", "the setting"),
}
_METHODS = {
    "none": "There was neither a usable IMU nor a usable receiver log: there is no path.",
    "finished trajectory": "The path is the drive's own finished trajectory; nothing was fused.",
    "gnss only": "The path is the receiver's fixes alone, smoothed: roll and pitch are unknown, "
    "and the heading is the direction of travel.",
}
_CLEAR_NATS, _FAIR_NATS = 10.0, 3.0


def fusion_section(products: RunProducts) -> Section:
    """Method, delay, mounting, standstill and noise from fusion.json."""
    section = Section()
    content = products.json(names.FUSION)
    method = content.get("method")
    if not content:
        section.absent = "Nothing was fused."
        return section
    if method != "inertial":
        section.sentences.append(_METHODS.get(str(method), f"The path was found by: {method}."))
        return section
    section.sentences += _start(content)
    section.sentences += _presets(content)
    section.sentences += _delay(content)
    section.sentences += _mounting(content, section)
    section.sentences += _wheels(content)
    section.sentences += _standstill(content)
    section.sentences += _noise(content, section)
    return section


def _number(value: Any) -> float | None:
    good = isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value)
    return float(value) if good else None


def _triple(value: Any) -> Sequence[float] | None:
    if not isinstance(value, list) or len(value) != 3:
        return None
    numbers = [_number(part) for part in value]
    return [n for n in numbers if n is not None] if None not in numbers else None


def _start(content: dict[str, Any]) -> list[str]:
    refused = _number(content.get("refused_share"))
    text = "The path joins the inertial sensor with the receiver's "
    text += (
        f"{_count(content, 'position_n')}positions and {_count(content, 'velocity_n')}velocities"
    )
    text += ", filtered forwards and smoothed backwards"
    if refused is not None:
        share = "none" if refused == 0 else f"{refused:.1%}"
        text += f"; {share} of the measurements {'was' if refused == 0 else 'were'} refused"
    texts = [text + "."]
    margin = _number(content.get("align_margin_nats"))
    if margin is not None:
        if margin >= _CLEAR_NATS:
            words = "left no doubt"
        elif margin >= _FAIR_NATS:
            words = "were fairly clear"
        else:
            words = "were doubtful: a second choice explains the drive nearly as well"
        texts.append(
            f"Heading and mounting at the start {words} (the best start leads the next by "
            f"{margin:,.0f} nats of log-likelihood; {_CLEAR_NATS:.0f} are plenty)."
        )
    return texts


def _count(content: dict[str, Any], channel: str) -> str:
    channels = content.get("channels")
    entry = channels.get(channel) if isinstance(channels, dict) else None
    count = _number(entry.get("count")) if isinstance(entry, dict) else None
    return "" if count is None else f"{count:,.0f} "


def _presets(content: dict[str, Any]) -> list[str]:
    presets = content.get("presets")
    if not isinstance(presets, dict):
        return []
    told = [
        f"{what} of type {entry['name']}"
        for role, what in (("imu", "the inertial sensor is"), ("gnss", "the receiver is"))
        if isinstance(entry := presets.get(role), dict) and "name" in entry
    ]
    if not told:
        return []
    text = " and ".join(told)
    return [f"{text[0].upper()}{text[1:]}: its data sheet gave the noise and the spread of its "
            "errors that the fusion began with."]  # fmt: skip


def _delay(content: dict[str, Any]) -> list[str]:
    delay, sd = _number(content.get("imu_delay_s")), _number(content.get("imu_delay_sd_s"))
    if delay is None or sd is None:
        return []
    size = f"{abs(delay) * 1e3:.0f} ms (σ {sd * 1e3:.0f} ms)"
    if content.get("delay_is_clock"):
        if abs(delay) < 2 * sd:
            return [f"No delay of the receiver's output can be told from zero ({size})."]
        if delay < 0:
            return [f"The receiver handed its positions out {size} after their time; the output "
                    "is corrected for it."]  # fmt: skip
        return [f"The clock found from the arrivals was {size} late; the output is corrected."]
    if abs(delay) < 2 * sd:
        return [f"The IMU's stamps fit the positions: their delay is {size}, no more than its σ "
                "explains."]  # fmt: skip
    side = "later" if delay > 0 else "earlier"
    return [f"The IMU's stamps are {size} {side} than the positions show; the fusion took that "
            "out."]  # fmt: skip


def _mounting(content: dict[str, Any], section: Section) -> list[str]:
    angles = _triple(content.get("mounting_rpy_deg"))
    sds = _triple(content.get("mounting_rpy_sd_deg"))
    if angles is None or sds is None:
        return []
    section.header = ("mounting, sensor to vehicle", "angle, deg", "σ, deg")
    for part, angle, sd in zip(("roll", "pitch", "yaw"), angles, sds, strict=True):
        section.rows.append((part, f"{angle:.2f}", f"{sd:.2f}"))
    turn = _turn_deg(angles)
    if all(abs(a) < max(2 * s, 0.5) for a, s in zip(angles, sds, strict=True)):
        text = "The sensor sits in the vehicle as the manifest says, as far as can be told."
    else:
        text = f"The sensor is turned by {turn:.1f} deg against the axes of the manifest, and the "
        text += "readings were turned back."
    if sds[0] > 1.0:
        text += f" Its roll is the least certain (σ {sds[0]:.1f} deg): driving shows it hardly."
    return [text]


def _turn_deg(rpy_deg: Sequence[float]) -> float:
    from automap.frames import rpy_to_matrix

    matrix = rpy_to_matrix(np.radians(np.asarray(rpy_deg, np.float64)))
    return float(np.degrees(np.arccos(np.clip((np.trace(matrix) - 1.0) / 2.0, -1.0, 1.0))))


def _wheels(content: dict[str, Any]) -> list[str]:
    wheels = content.get("wheels")
    if not isinstance(wheels, dict) or (rate := _number(wheels.get("odometer_rate_hz"))) is None:
        return []
    scale, late, scale_sd, late_sd = (
        _number(wheels.get(f"odometer_{name}"))
        for name in ("scale", "time_offset_s", "scale_sd", "time_offset_sd_s")
    )
    if scale is None or scale_sd is None or late is None or late_sd is None:
        return ["The wheel speed was left out, for it is not the speed of this drive."]
    step, stuck = _number(wheels.get("odometer_step_m_s")), _number(wheels.get("odometer_stuck"))
    text = (
        f"The wheel speed, {rate:.3g} times a second, is {abs(late) * 1e3:.0f} ms "
        f"(σ {late_sd * 1e3:.0f} ms) {'late' if late >= 0 else 'early'} and "
        f"{abs(scale - 1.0):.2%} (σ {scale_sd:.2%}) too {'long' if scale >= 1 else 'short'}; the "
        "fusion took that out"
    )
    if step:
        text += f". It counts in steps of {step:.2f} m/s"
    if stuck:
        text += f". {stuck:.0f} of its values, stuck while the vehicle drove, were left out"
    return [text + "."]


def _standstill(content: dict[str, Any]) -> list[str]:
    spans = content.get("standstill")
    if not isinstance(spans, list):
        return []
    good = [s for s in spans if isinstance(s, list) and len(s) == 2]
    if not good:
        return ["The vehicle never stood still, so the sensors' biases rest on the motion alone."]
    total = duration_text(sum(float(b) - float(a) for a, b in good))
    times = "once" if len(good) == 1 else f"{len(good)} times"
    return [f"The vehicle stood still {times}, {total} in all (shaded in the plot of the speed); "
            "there velocity and turn rate are known to be zero."]  # fmt: skip


def _noise(content: dict[str, Any], section: Section) -> list[str]:
    factors = content.get("noise_factors")
    if not isinstance(factors, dict):
        return []
    told: dict[str, list[str]] = {}
    for key, value in factors.items():
        factor = _number(value)
        if factor is None or abs(factor - 1.0) < 0.01:
            continue
        what, against = _NOISE.get(str(key), (str(key).replace("_", " "), "what was assumed"))
        told.setdefault(against, []).append(f"{what} {factor:.3g}")
    if not told:
        return ["The drive's noise is as the settings and the receiver state it."]
    return [
        f"What the drive shows of its noise, in times {against}: {'; '.join(own)}."
        for against, own in told.items()
    ]
