"""Whether a name is all that there is: what speaks for something like it, but not for it.

The likeliest of the names that are known is told though none may be the truth. It is in doubt where
a formula that is not told apart from it explains more, where held-out data are no likelier with it,
where what it explains is of another size in some stretches than in others, or where its value
drifts or steps: one number is then not what the drive shows.

For the last the columns of every parameter that acts are cut into blocks of time. What a block adds
to a constant is a candidate as any other, beside all that was found: a trend along the drive, what
settles, a step between two blocks, another value on a further drive. Fitted and held-out drives
have a say, for a value is told of both.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.user import INSTALLED
from automap.gap import limits
from automap.gap.candidates import follows_time, is_course
from automap.gap.evidence import Evidence, by_stretch, evidence
from automap.gap.fit import ORIGIN, Fit, Values
from automap.gap.forms import Terms
from automap.gap.found import Beside, Found
from automap.gap.linear import Column, Conditional, Direct, Linear, NodeMotion, Part
from automap.gap.reading_steps import cut_off
from automap.gap.result import Drift
from automap.gap.selection import Chosen, Selection
from automap.gates import exceeds
from automap.records import BoolArray, FloatArray


def doubts(found: Found, values: Values, drifting: Mapping[str, Drift]) -> dict[str, str]:
    """What the named effects of a search that stand with ``values`` may be instead, those about
    which there is doubt; ``drifting`` those that are not constant."""
    out = {}
    for name in found.chosen.names:
        if found.selection.candidates[name].terms or name not in values:
            continue
        # without held-out data these have said nothing
        gain = found.stands.gains.get(name, np.inf)
        told = str(drifting.get(name, "")) or cut_off(found.fitted.fits, name, found.full.of(name))
        out[name] = told or doubt(found.selection, found.chosen, name, gain)
    return out


def doubt(selection: Selection, chosen: Chosen, name: str, gain: float) -> str:
    """What speaks for something like a named effect, but not for it, in words; nothing mostly.
    ``gain`` nats by which held-out data are likelier with it."""
    share = uneven(selection, chosen, name)
    if share > 0.0:
        return f"something of another form, for its size differs by {share:.0%} along the drive"
    if gain <= 0.0:
        return "something else, for held-out data are no likelier with it"
    return formula_in_place(selection, chosen, name)


def formula_in_place(selection: Selection, chosen: Chosen, name: str) -> str:
    """The formula that explains most in the place of a named effect, and more than that one does,
    where the two are not told apart; nothing where none does."""
    # a course of what the name says by a constant is nearly that; whether it is one is asked below
    formulas = [
        c.name
        for c in selection.candidates.values()
        if c.terms and not (follows_time(c.terms) and _of_a_constant(c.terms))
    ]
    best, instead = 0.0, ""
    for rival in selection.rivals(chosen, name, formulas, frozenset()):
        if rival.name in chosen.names:
            continue
        # evidence alone: that formulas are seldom the truth is what is asked here
        ahead = rival.ahead - selection.log_prior(rival.chosen) + selection.log_prior(chosen)
        if ahead > best and not selection.told_apart(rival, chosen, name):
            best, instead = ahead, rival.name
    return instead


def _of_a_constant(terms: Terms) -> bool:
    """Whether a course of time is one of a gain, or of how unit and antenna sit."""
    return not is_course(terms) or terms[0][0] in INSTALLED


def uneven(selection: Selection, chosen: Chosen, name: str) -> float:
    """Share of its size by which a chosen effect differs from stretch to stretch (one sigma);
    nothing where that may be chance, or little.

    Between-stretch variance by moments (DerSimonian and Laird, Controlled Clinical Trials 7 (1986),
    177-188), of the part that explains most.
    """
    part = max(
        (p for n, p, _ in chosen.parts if n == name),
        key=lambda p: _nats(selection, chosen, name, p),
    )
    rest = Chosen(tuple(p for p in chosen.parts if p[:2] != (name, part)))
    known = selection.given(rest)
    if not known.shows(part):
        return 0.0
    scores, sizes = by_stretch(known, part)
    noise = selection.inflated.get(False, 1.0)
    total, count = float(sizes.sum()), len(sizes)
    slope = float(scores.sum()) / total
    q = float(np.sum((scores - slope * sizes) ** 2 / sizes))
    between = (q - noise * (count - 1)) / (total - float(np.sum(sizes**2)) / total)
    if slope <= 0.0 or between <= limits.CHALLENGE * slope**2:
        return 0.0
    sure = exceeds(q / noise, count - 1) < math.exp(-limits.LEAST_ODDS)
    return math.sqrt(between) / slope if sure else 0.0


def _nats(selection: Selection, chosen: Chosen, name: str, part: Part) -> float:
    rest = Chosen(tuple(p for p in chosen.parts if p[:2] != (name, part)))
    return selection.evidence(selection.given(rest), name, part).nats


Key = tuple[str, str]
"""Effect and parameter."""
TREND, SETTLING, STEP, DRIVE = "trend", "settling", "step", "drive"
TESTED = 2
"""Changes that a constant is tested against, whatever the odds of all: a trend, and one between the
halves of the drive."""


def drifts(asked: Beside, fits: Sequence[Fit]) -> dict[str, Drift]:
    """The named effects of a choice that are likelier to change than not, and how the parameter
    changes that shows it most, by ``fits`` of all drives."""
    layout = asked.selection.linear.layout
    acting = [
        (layout[i].effect, layout[i].parameter)
        for name, part, _ in asked.chosen.parts
        if not asked.selection.candidates[name].terms
        # with a clock's rate what it was off by, which may jump
        for i in (*part, *asked.selection.candidates[name].beside)
        # what is there or not, as the Earth's rotation is, has no value that changes
        if layout[i].parameter in _units(layout[i].effect)
    ]
    if not acting:
        return {}
    edges = _edges(fits)
    number = iter(range(len(fits)))

    def blocks(at: NodeMotion) -> list[Column]:
        drive = next(number)
        own = (c for c in asked.columns_of(at) if (c.effect, c.parameter) in acting)
        return [b for c in own for b in _blocks(c, at, edges, drive)]

    raw = asked.linear(fits, blocks, may_act=True)
    linear, shapes = _changes(raw, acting, edges, len(fits))
    known = asked.known(linear)
    found: dict[str, list[tuple[float, Drift]]] = {}
    half = float(edges[limits.DRIFT_BLOCKS // 2])
    unlikely: dict[str, list[tuple[float, Drift]]] = {}
    for i, ((effect, parameter), kind, at_s) in shapes.items():
        if not known.shows((i,)):
            continue
        told = evidence(known, (i,), asked.noise)
        # what one stretch alone says is no change that lasts
        nats = told.nats if told.predicted_without_best > 0.0 else min(told.nats, 0.0)
        change, sd = float(told.estimate[0]), float(told.sd[0])
        unit = _units(effect)[parameter]
        drift = Drift(parameter, kind, change, sd, unit, at_s, nats)
        found.setdefault(effect, []).append((nats, drift))
        if kind == TREND or (kind == STEP and at_s == half):
            chance = exceeds(_squared_sigmas(known, i, told), 1)
            unlikely.setdefault(effect, []).append((chance, drift))
    out = {}
    for effect, changes in found.items():
        # of all shapes together: nobody says beforehand which
        every = np.array([nats for nats, _ in changes])
        odds = float(np.logaddexp.reduce(every) - np.log(len(every)))
        odds += math.log(limits.OUTSIDE_LIBRARY)
        # a constant that the drive's halves contradict is none for being likely beforehand
        chance, drift = min(unlikely.get(effect, [(1.0, changes[0][1])]), key=lambda one: one[0])
        tests = TESTED * sum(key[0] == effect for key in acting)
        if odds > 0.0:
            drift = max(changes, key=lambda change: change[0])[1]
            out[effect] = replace(drift, sure=odds >= limits.LEAST_ODDS)
        elif tests * chance <= limits.SUSPECTED:
            out[effect] = drift
    return out


def _units(effect: str) -> dict[str, str]:
    known = CATALOGUE[effect]
    units = {p.name: p.unit for p in known.parameters}
    if known.unknown_epoch:
        units[ORIGIN] = CATALOGUE[known.unknown_epoch].parameters[0].unit
    return units


def _squared_sigmas(known: Conditional, i: int, told: Evidence) -> float:
    """Of what a column adds, by its own scatter from stretch to stretch."""
    return float(known.score[i] ** 2 / (known.diagonal[i] * told.overdispersion))


def _edges(fits: Sequence[Fit]) -> FloatArray:
    """Instants [b + 1] between blocks, s since the beginning of a drive."""
    begin = min(fit.opened.drive.begin_s for fit in fits)
    end = max(fit.opened.drive.begin_s + float(fit.last.nodes.t[-1]) for fit in fits)
    return np.linspace(begin, end, limits.DRIFT_BLOCKS + 1)


def _blocks(column: Column, at: NodeMotion, edges: FloatArray, drive: int) -> Iterator[Column]:
    """A column in blocks of time of one drive, those that have anything of it."""
    begin = at.fit.opened.drive.begin_s
    place, nodes = (np.digitize(t + begin, edges[1:-1]) for t in (at.motion.t, at.t))
    for number in np.unique(place).tolist():
        yield _within(column, place == number, nodes == number, f"{drive} {number}")


def _within(column: Column, epochs: BoolArray, nodes: BoolArray, name: str) -> Column:
    inertial = tuple(replace(i, signal=i.signal * epochs) for i in column.inertial)
    direct = None
    if column.direct is not None:
        direct = Direct(column.direct.by_channel * nodes[:, None])
    parameter = f"{column.parameter} {name}"
    return replace(column, parameter=parameter, inertial=inertial, direct=direct)


def _changes(
    linear: Linear, acting: Sequence[Key], edges: FloatArray, drives: int
) -> tuple[Linear, dict[int, tuple[Key, str, float]]]:
    """The linear model with changes in place of blocks, and of each such column the effect and
    parameter, the kind of change, and the instant of a step, s."""
    raw = linear.layout
    plain = [i for i, c in enumerate(raw) if " " not in c.parameter]
    layout, mixing = [raw[i] for i in plain], [np.eye(len(raw))[i] for i in plain]
    shapes: dict[int, tuple[Key, str, float]] = {}
    middle = 0.5 * (edges[1:] + edges[:-1])
    along = (middle - edges[0]) / (edges[-1] - edges[0])
    # within a block's time, as what warms up or yields does: nothing quicker is seen
    settled = -np.expm1(-limits.DRIFT_BLOCKS * along)
    forms = [(TREND, along, 0.0), (SETTLING, settled, 0.0)]
    forms += [(STEP, (middle > e).astype(np.float64), float(e)) for e in edges[1:-1]]
    for effect, parameter in acting:
        mine = {
            tuple(map(int, c.parameter.split(" ")[1:])): i
            for i, c in enumerate(raw)
            if c.effect == effect and c.parameter.startswith(f"{parameter} ")
        }
        if not mine:
            continue
        # of a clock every drive has its own offset
        of_drives = [(DRIVE, d) for d in range(1, drives) if parameter != ORIGIN]
        every = [(k, {key: v[key[1]] for key in mine}, s) for k, v, s in forms]
        every += [(k, {key: float(key[0] == d) for key in mine}, float(d)) for k, d in of_drives]
        for kind, weights, at_s in every:
            mixed = np.zeros(len(raw))
            for key, weight in weights.items():
                mixed[mine[key]] = weight
            shapes[len(layout)] = ((effect, parameter), kind, at_s)
            one = raw[next(iter(mine.values()))]
            layout.append(replace(one, parameter=f"{parameter} {kind} {at_s:.1f}"))
            mixing.append(mixed)
    by = np.array(mixing).T
    score, info = by.T @ linear.score, by.T @ linear.info @ by
    values = np.concatenate([linear.values[plain], np.zeros(len(layout) - len(plain))])
    sds = np.array([c.prior_sd for c in layout])
    more = dict(layout=tuple(layout), mixing=by, score=score, info=info)
    return replace(linear, **more, prior_sd=sds, values=values), shapes
