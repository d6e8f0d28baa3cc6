"""Run the gap finder on one hidden case."""

from __future__ import annotations

import json
import shutil
import tempfile
import time
from pathlib import Path

from tests.hidden_effects.cases import draw_case, write_case
from tests.hidden_effects.judge import Verdict, judge, judge_refusal


def run_case(case_id: str, keep: Path | None = None) -> Verdict:
    """Draw a case, hand its folders to ``automap gap`` and judge the answer.

    The drives lie in a temporary folder and are removed, or stay under ``keep``.
    """
    from automap.errors import AutoMapError
    from pipeline.gap.command import find

    drawn = draw_case(case_id)
    folder = Path(tempfile.mkdtemp(prefix="hidden-")) if keep is None else keep / case_id
    try:
        drive, held_out, config = write_case(drawn, folder)
        start = time.process_time()
        find([drive], [held_out], config, drawn.case.left_out, folder / "gap")
        cpu = time.process_time() - start
        answer = json.loads((folder / "gap" / "gap.json").read_text(encoding="utf-8"))
    except AutoMapError as error:
        verdict = judge_refusal(drawn, str(error))
        verdict.cpu_s = time.process_time() - start
        return verdict
    finally:
        if keep is None:
            shutil.rmtree(folder, ignore_errors=True)
    verdict = judge(drawn, answer)
    verdict.cpu_s = cpu
    return verdict
