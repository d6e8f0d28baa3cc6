"""The GeoPackage in QGIS itself, without a screen, where it is installed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unit"))

from export_inputs import write_run

from automap.io import names
from pipeline.export.command import export_run

LOAD = """
import json, sqlite3, sys
from qgis.core import QgsApplication, QgsRenderContext, QgsVectorLayer
QgsApplication.setPrefixPath("/usr", True)
application = QgsApplication([], False)
application.initQgis()
found = {}
for name in ("signs", "observations", "trajectory", "ellipses"):
    layer = QgsVectorLayer(f"{sys.argv[1]}|layername={name}", name, "ogr")
    renderer = layer.renderer()
    found[name] = {
        "valid": layer.isValid(),
        "count": layer.featureCount(),
        "crs": layer.crs().authid(),
        "renderer": renderer.type() if renderer else None,
        "epoch": layer.crs().coordinateEpoch(),
        "tabs": [tab.name() for tab in layer.editFormConfig().tabs()],
        "tip": layer.mapTipTemplate(),
        "shown_as": layer.displayExpression(),
        "aliases": {f.name(): f.alias() for f in layer.fields()},
        "scales": layer.hasScaleBasedVisibility() and layer.minimumScale(),
        "legend": [item.label() for item in renderer.legendSymbolItems()],
        "turned": [
            part.dataDefinedProperties().property(part.PropertyAngle).expressionString()
            for symbol in renderer.symbols(QgsRenderContext())
            for part in symbol.symbolLayers()
        ],
        "symbols": [
            [part.layerType() for part in symbol.symbolLayers()]
            for symbol in renderer.symbols(QgsRenderContext())
        ],
    }
    row = sqlite3.connect(sys.argv[1]).execute(
        "SELECT styleSLD FROM layer_styles WHERE f_table_name = ?", (name,)).fetchone()
    if row[0]:
        open(sys.argv[1] + ".sld", "w").write(row[0])
        found[name]["sld"] = layer.loadSldStyle(sys.argv[1] + ".sld")[1]
        found[name]["by_sld"] = [item.label() for item in layer.renderer().legendSymbolItems()]
print("FOUND" + json.dumps(found))
application.exitQgis()
"""


def qgis_python() -> str | None:
    """A Python that has QGIS: Debian's, for its packages are not in the project's environment."""
    for python in (os.environ.get("AUTOMAP_QGIS_PYTHON"), shutil.which("python3", path="/usr/bin")):
        if python is None:
            continue
        done = subprocess.run([python, "-c", "import qgis.core"], capture_output=True, check=False)
        if done.returncode == 0:
            return python
    return None


@pytest.mark.slow
def test_qgis_opens_the_map_with_its_styles(tmp_path: Path) -> None:
    python = qgis_python()
    if python is None:
        pytest.skip("QGIS is not installed: Debian's package python3-qgis, or AUTOMAP_QGIS_PYTHON")
    out = write_run(tmp_path / "out")
    path, _ = export_run(out, "gpkg")
    done = subprocess.run(
        [python, "-c", LOAD, str(path)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "QT_QPA_PLATFORM": "offscreen", "PYTHONPATH": ""},
        timeout=120,
    )
    line = next((text for text in done.stdout.splitlines() if text.startswith("FOUND")), None)
    assert line is not None, done.stderr
    found = json.loads(line.removeprefix("FOUND"))
    assert path.name == names.GPKG
    assert all(layer["valid"] for layer in found.values())
    assert {layer["crs"] for layer in found.values()} == {"EPSG:4979"}
    assert all(abs(layer["epoch"] - 2026.197) < 1e-3 for layer in found.values())
    assert found["signs"]["tabs"] == ["Sign", "Place", "Sightings", "Condition"]
    assert all(found[name]["sld"] for name in ("signs", "trajectory", "ellipses"))
    assert found["signs"]["by_sld"][:3] == found["signs"]["legend"][:3]
    assert found["signs"]["count"] == found["ellipses"]["count"] == 12
    assert found["signs"]["renderer"] == "categorizedSymbol"
    assert found["signs"]["symbols"] == [["RasterMarker", "SimpleMarker"]] * 3 + [["SimpleMarker"]]
    assert found["signs"]["turned"].count('"facing_deg"') == 3
    assert "picture_file" in found["signs"]["tip"]
    assert "name" in found["signs"]["shown_as"]
    assert found["signs"]["aliases"]["height_above_road_m"] == "height above road (m)"
    assert len(set(found["signs"]["legend"])) == len(found["signs"]["legend"])
    # ellipses are clicked as often as signs
    assert found["ellipses"]["aliases"]["ce95_m"] == "95 % radius (m)"
    assert found["observations"]["scales"] == 1000
    assert not found["signs"]["scales"]
    assert found["trajectory"]["renderer"] == "graduatedSymbol"
    assert found["ellipses"]["symbols"] == [["SimpleFill"]]
