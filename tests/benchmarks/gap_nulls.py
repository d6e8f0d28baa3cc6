"""Chances that are told where nothing is missing: generated drives beside recorded receivers.

    python tests/benchmarks/gap_nulls.py FIRST LAST

Of cases null-FIRST-real to null-LAST-real the base model is fitted with the receiver's delays
given, and the strongest of all candidates judged, without a search. A line a case, then how far
the chances are from even ones (Kolmogorov and Smirnov).
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
from automap.gap.noise import Log, open_fits
from automap.gap.screening import Screening
from automap.gap.selection import Chosen
from pipeline.gap.inputs import gap_drives, gap_model
from tests.hidden_effects.cases import draw_case, write_case


def silent(text: str) -> None:
    """No word of what is going on."""


def strongest(case_id: str, log: Log = silent) -> tuple[str, float]:
    """The strongest candidate of a case, and its chance."""
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
    return parts[best.number][0], best.p_value


def main(first: int, last: int) -> None:
    """All cases, one after another."""
    from scipy.stats import kstest

    chances = []
    for number in range(first, last + 1):
        name, chance = strongest(f"null-{number}-real")
        chances.append(chance)
        print(f"null-{number}-real {chance:.3f} {name}", flush=True)
    mean = sum(chances) / len(chances)
    print(f"mean {mean:.2f}, as even ones: p {kstest(chances, 'uniform').pvalue:.3f}")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
