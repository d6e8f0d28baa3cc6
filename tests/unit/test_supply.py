"""Pins with hashes, the bill of materials, and the audit's sentences."""

from __future__ import annotations

import json
import sys
from importlib import metadata
from pathlib import Path

import pytest

from release.audit import audit
from release.pins import BUILD, DEV, ROOT, RUNTIME, read_pins
from release.sbom import bill


@pytest.mark.parametrize("name", [RUNTIME, BUILD, DEV])
def test_every_pin_has_the_hashes_of_its_files(name: str) -> None:
    pins = read_pins(ROOT / name)
    assert len(pins) >= 7
    assert [pin.name for pin in pins if not pin.hashes] == []
    assert len({pin.name for pin in pins}) == len(pins)


def test_what_pins_nothing_is_refused(tmp_path: Path) -> None:
    (tmp_path / "lock").write_text("numpy>=1.26\n")
    with pytest.raises(ValueError, match="pins no package"):
        read_pins(tmp_path / "lock")


def test_the_bill_of_materials_names_all_that_automap_runs_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    pins = read_pins(ROOT / RUNTIME)
    try:
        made = bill()
    except metadata.PackageNotFoundError as error:
        pytest.skip(f"{error.name} is not installed")
    assert (made["bomFormat"], made["specVersion"]) == ("CycloneDX", "1.6")
    assert made == bill()
    components = made["components"]
    assert [(c["name"], c["version"]) for c in components] == [(p.name, p.version) for p in pins]
    assert [c["name"] for c in components if not c["licenses"]] == []
    refs = {c["bom-ref"] for c in components} | {"automap"}
    assert len(refs) == len(pins) + 1
    # every package is there because something needs it
    needed = {need for d in made["dependencies"] for need in d["dependsOn"]}
    assert {d["ref"] for d in made["dependencies"]} == refs
    assert refs - needed == {"automap"}
    assert "timestamp" not in made["metadata"]
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert bill()["metadata"]["timestamp"] == "2023-11-14T22:13:20Z"


def stand_in(tmp_path: Path, answer: str) -> list[str]:
    """A command that answers like pip-audit."""
    script = tmp_path / "answer.py"
    script.write_text(f"print({answer!r})")
    return [sys.executable, str(script)]


SOUND = {"name": "a", "version": "1", "vulns": []}
BAD = {"name": "b", "version": "2", "vulns": [{"id": "CVE-1", "fix_versions": ["3"]}]}
UNKNOWN = {"name": "c", "skip_reason": "not found"}


@pytest.mark.parametrize(
    ("answer", "code", "said"),
    [
        ([SOUND], 0, "1 of 1 pinned packages audited, 0 vulnerabilities"),
        ([SOUND, BAD], 1, "b 2: CVE-1; mended in 3"),
        ([SOUND, UNKNOWN], 3, "the index tells nothing"),
        ([], 3, "0 of 0"),
        (None, 3, "nothing was audited"),
    ],
)
def test_what_an_audit_says(tmp_path: Path, answer: object, code: int, said: str) -> None:
    text = "no network" if answer is None else json.dumps({"dependencies": answer})
    found, lines = audit(stand_in(tmp_path, text))
    assert found == code
    assert said in "\n".join(lines)


def test_an_audit_without_its_tool_says_so(tmp_path: Path) -> None:
    code, (line,) = audit([str(tmp_path / "none")])
    assert code == 3
    assert "nothing was audited" in line
