"""Chances that are told where nothing is missing: generated drives beside recorded receivers.

    python tests/benchmarks/gap_nulls.py FIRST LAST

Of cases null-FIRST-real to null-LAST-real the base model is fitted with the receiver's delays
given, and the strongest of all candidates judged, without a search; so are what follows manoeuvres
in ways of its own, by chance and by odds (log). A line a case, then how far the chances are from
even ones (Kolmogorov and Smirnov).
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from automap.fusion.options import FusionOptions
from automap.gap import limits
from automap.gap.chance import strongest_by_chance
from automap.gap.drive import in_vehicle_axes, open_drive
from automap.gap.found import Beside
from automap.gap.noise import Log, open_fits
from automap.gap.responses import Response, strongest_responses
from automap.gap.screening import Screening
from automap.gap.selection import Chosen
from pipeline.gap.inputs import gap_drives, gap_model
from tests.hidden_effects.cases import draw_case, write_case


def silent(text: str) -> None:
    """No word of what is going on."""


def strongest(
    case_id: str, log: Log = silent
) -> tuple[str, float, Response | None, Response | None]:
    """The strongest candidate of a case, its chance, and the likeliest and rarest response."""
    drawn = draw_case(case_id)
    assert drawn.setting.replay is not None
    own = drawn.setting.replay.series()
    with tempfile.TemporaryDirectory() as folder:
        drive, _, config = write_case(drawn, Path(folder))
        model, settings = gap_model(config)
        (read,) = gap_drives([drive], Path(folder) / "runs", settings)
    delays = {
        "gnss_latency": own.position_s,
        "gnss_velocity_latency": own.speed_s - own.position_s,
        "gnss_course_latency": own.course_s - own.speed_s,
    }
    model = replace(model, values={**model.values, **{e: {"s": s} for e, s in delays.items()}})
    turned = in_vehicle_axes(read, FusionOptions())
    base = open_fits([open_drive(turned, model.options)], model, log)
    selection = Screening(base, (), log).selection(base, slow=False, may_act=False)
    parts = [(c.name, part) for c in selection.candidates.values() for part in c.parts]
    known = selection.given(Chosen())
    best = strongest_by_chance(known, [part for _, part in parts], limits.NULL_DRAWS)
    assert best is not None
    beside = Beside(selection, Chosen(), lambda *about: [], {})
    later = strongest_responses(beside, base.fits)
    return parts[best.number][0], best.p_value, *later


def main(first: int, last: int) -> None:
    """All cases, one after another."""
    from scipy.stats import kstest

    chances, later = [], []
    for number in range(first, last + 1):
        name, chance, likeliest, rarest = strongest(f"null-{number}-real")
        chances.append(chance)
        line = f"null-{number}-real {chance:.3f} {name}"
        if rarest is not None:
            later.append(rarest.p_value)
            line += f"; {rarest.p_value:.3f} {rarest.name}"
        if likeliest is not None:
            line += f"; odds {likeliest.odds:.1f} {likeliest.name}"
        print(line, flush=True)
    for words, each in (("candidates", chances), ("responses", later)):
        mean, even = sum(each) / max(len(each), 1), kstest(each, "uniform").pvalue
        print(f"{words}: mean {mean:.2f}, as even ones: p {even:.3f}")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
