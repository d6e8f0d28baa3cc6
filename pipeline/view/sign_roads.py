"""Where a map's signs stand on the roads of its layer, as the panel of a sign shows it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import AutoMapError
from automap.export.fields import ROAD_FIELDS
from automap.io import names

if TYPE_CHECKING:
    from automap.export.roads import RoadRow


@dataclass(frozen=True)
class SignRoads:
    """``rows`` by the names of the signs that stand on a road; the map's ``country``."""

    rows: Mapping[str, RoadRow]
    country: str | None

    def values(self, sign: str, class_name: str) -> dict[str, Any]:
        """The columns of a sign's road, without those that are not known."""
        from automap.signs.on_roads import road_check

        row = self.rows.get(sign)
        if row is None:
            return {}
        found: dict[str, Any] = {}
        for field in ROAD_FIELDS:
            text = row.get(field.name, "")
            if field.kind == "real":
                number = float(text or "nan")
                found[field.name] = round(number, 2) if math.isfinite(number) else None
            else:
                found[field.name] = text
        # the class may be another one since
        found["road_check"] = road_check(class_name, row["road_kind"], self.country)
        return {name: value for name, value in found.items() if value not in (None, "")}


def read_sign_roads(out: Path, problems: list[str]) -> SignRoads:
    """What the map in ``out`` has of roads, nothing where it was made without a layer; a file that
    cannot be read is one of the ``problems``."""
    from automap.export.roads import read_roads_csv
    from pipeline.shared.run_record import country_of
    from pipeline.shared.values import json_object

    path = out / names.SIGN_ROADS
    if not path.is_file():
        return SignRoads({}, None)
    try:
        rows = {row["sign_id"]: row for row in read_roads_csv(path)}
    except (AutoMapError, OSError) as error:
        problems.append(f"{path.name}: {error}")
        return SignRoads({}, None)
    return SignRoads(rows, country_of(json_object(out / names.RUN)))
