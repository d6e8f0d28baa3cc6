"""The section on the comparison with a truth, where ``automap evaluate`` has made one."""

from __future__ import annotations

from typing import Any

from automap.io import names
from pipeline.pages.section import Section
from pipeline.shared.products import RunProducts
from pipeline.shared.values import mapping


def evaluation_section(products: RunProducts) -> Section:
    """Errors against the truth from evaluation.json."""
    section = Section(header=("against the truth", "unit", "north / roll", "east / pitch",
                              "down / yaw", "horizontal"))  # fmt: skip
    content = products.json(names.EVALUATION)
    if not content:
        section.absent = "This run was not compared with a truth."
        return section
    if _is_stale(products):
        section.sentences.append(
            "The comparison is older than the results on this page: run automap evaluate again."
        )
    _errors(content, section)
    signs = mapping(content.get("signs"))
    if signs:
        section.sentences += _signs(signs)
    return section


def _is_stale(products: RunProducts) -> bool:
    written = (products.out / names.EVALUATION).stat().st_mtime
    results = [products.out / name for name in (names.TRAJECTORY, names.SIGNS_GEOJSON)]
    # a copied folder has stamps of its own, moments apart
    return any(path.is_file() and path.stat().st_mtime > written + 2.0 for path in results)


def _text(value: Any, digits: int = 3) -> str:
    good = isinstance(value, int | float) and not isinstance(value, bool)
    return f"{value:.{digits}g}" if good else ""


def _errors(content: dict[str, Any], section: Section) -> None:
    rows = (
        ("position, rms", "m", "position_rms_m", ("n", "e", "d", "horizontal")),
        ("raw fixes, rms", "m", "raw_position_rms_m", ("n", "e", "d", "horizontal")),
        ("velocity, rms", "m/s", "velocity_rms", ("n", "e", "d")),
        ("attitude, rms", "deg", "attitude_rms_deg", ("roll", "pitch", "yaw")),
        ("attitude, mean", "deg", "attitude_mean_deg", ("roll", "pitch", "yaw")),
    )
    for title, unit, key, parts in rows:
        values = mapping(content.get(key))
        if values:
            cells = [_text(values.get(part)) for part in parts]
            section.rows.append((title, unit, *cells, *[""] * (4 - len(cells))))
    ratios = mapping(content.get("sigma_ratio"))
    for title, parts in (("position, error / σ", ("n", "e", "d")),
                         ("velocity, error / σ", ("vn", "ve", "vd")),
                         ("attitude, error / σ", ("roll", "pitch", "yaw"))):  # fmt: skip
        if any(part in ratios for part in parts):
            cells = [_text(ratios.get(part), 2) for part in parts]
            section.rows.append((title, "1", *cells, ""))
    ours = mapping(content.get("position_rms_m")).get("horizontal")
    raw = mapping(content.get("raw_position_rms_m")).get("horizontal")
    if isinstance(ours, int | float):
        text = f"The path lies {_text(ours)} m rms from the truth horizontally"
        if isinstance(raw, int | float):
            text += f", the receiver's own fixes {_text(raw)} m"
        section.sentences.append(text + ". An error over σ near 1 means that σ can be believed.")


def _signs(signs: dict[str, Any]) -> list[str]:
    texts = []
    gates = mapping(signs.get("gates"))
    shares = []
    for gate in ("1", "2", "5"):
        entry = mapping(gates.get(gate))
        recall, precision = entry.get("recall"), entry.get("precision")
        if isinstance(recall, int | float) and isinstance(precision, int | float):
            shares.append(f"{gate} m {recall:.0%} and {precision:.0%}")
    if shares:
        texts.append(
            "True signs found, and found signs that are true: within "
            + ", within ".join(shares)
            + "."
        )
    median, p95 = signs.get("median_error_m"), signs.get("p95_error_m")
    if isinstance(median, int | float) and isinstance(p95, int | float):
        text = (
            f"Signs lie {_text(median)} m from the truth in the median, 95 % within {_text(p95)} m"
        )
        coverage, accuracy = signs.get("coverage95"), signs.get("class_accuracy")
        if isinstance(coverage, int | float):
            text += f"; the 95 % ellipse holds the truth for {coverage:.0%}"
        if isinstance(accuracy, int | float):
            text += f"; the class is right for {accuracy:.0%}"
        texts.append(text + ".")
    return texts
