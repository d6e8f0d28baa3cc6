"""Stage report: one page that shows the run, without the network."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from automap.io import names
from automap.io.vector_layer import layer_files
from pipeline.run.stage import Stage, StageContext
from pipeline.shared.background import background_file

if TYPE_CHECKING:
    from automap.io.drive import Drive


def run(context: StageContext) -> None:
    """Write report.html from whatever the earlier stages left."""
    from automap.errors import InputError
    from automap.io.atomic import write_text
    from automap.io.background import open_background
    from pipeline.report.render import report_html
    from pipeline.shared.products import load_products

    products = load_products(context.out).readable()
    record = products.json(names.RUN)
    context.progress(0.2, "drawing")
    background = None
    if (file := background_file(context.drive, context.settings.report.background)) is not None:
        try:
            background = open_background(file)
        except InputError as error:
            context.warn(f"The report's map has no background: {error}")
    text = report_html(products, context.drive.name, record, background)
    for problem in products.problems:
        context.warn(problem)
    write_text(context.work / names.REPORT, text)
    context.result = f"{len(text.encode()) / 1e6:.1f} MB"


def _inputs(drive: Drive) -> list[Path]:
    own = background_file(drive)
    return [] if own is None else layer_files(own)


STAGE = Stage(
    name="report",
    version=12,
    run=run,
    inputs=_inputs,
    needs=(
        names.RUN,
        names.INGEST,
        names.SYNC,
        names.SYNC_DELAYS,
        names.FIXES,
        names.FUSION,
        names.TRAJECTORY,
        names.TRAJECTORY_ADJUSTED,
        names.IMU_ERRORS,
        names.INNOVATIONS,
        names.SIGNS_RAW,
        names.OBSERVATIONS,
        names.EVALUATION,
        names.REVIEW,
        names.PICTURE_INDEX,
        names.SIGN_ROADS,
    ),
    outputs=(names.REPORT,),
    settings=("report",),
    setting_files=lambda s: layer_files(Path(s.report.background)) if s.report.background else [],
    manifest=("name", "video", "site"),
)
