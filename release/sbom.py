"""The software bill of materials: what automap runs with, in CycloneDX 1.6 (ECMA-424), JSON.

    python -m release.sbom [FILE]

Versions and hashes are those of ``requirements.lock``, licences those that the installed packages
state. The same lock file gives the same bytes; a date is only in it where SOURCE_DATE_EPOCH says.
"""

from __future__ import annotations

import datetime as dt
import json
import os
import re
import sys
import tomllib
import uuid
from importlib import metadata
from pathlib import Path
from typing import Any

from automap import __version__
from release.pins import ROOT, RUNTIME, Pin, normal, read_pins

_CLASSIFIER = "License :: OSI Approved :: "
_LONGEST = 100
"""Characters of a licence's name; some packages put its whole text there."""


def bill() -> dict[str, Any]:
    """The document; PackageNotFoundError where a package is not installed."""
    pins = read_pins(ROOT / RUNTIME)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    own = {
        "type": "application",
        "bom-ref": "automap",
        "name": "automap",
        "version": __version__,
        "licenses": [{"expression": project["license"]}],
    }
    refs = {pin.name: _purl(pin) for pin in pins}
    needs = {"automap": _names(project["dependencies"])}
    needs |= {pin.name: _names(metadata.requires(pin.name) or []) for pin in pins}
    document: dict[str, Any] = {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": own},
        "components": [_component(pin) for pin in pins],
        "dependencies": [
            {
                "ref": refs.get(name, name),
                "dependsOn": sorted(
                    {refs[need] for need in found if need in refs and need != name}
                ),
            }
            for name, found in needs.items()
        ],
    }
    if os.environ.get("SOURCE_DATE_EPOCH", "").isdecimal():
        made = dt.datetime.fromtimestamp(int(os.environ["SOURCE_DATE_EPOCH"]), dt.UTC)
        document["metadata"]["timestamp"] = made.strftime("%Y-%m-%dT%H:%M:%SZ")
    content = json.dumps(document, sort_keys=True)
    return document | {"serialNumber": uuid.uuid5(uuid.NAMESPACE_OID, content).urn}


def _component(pin: Pin) -> dict[str, Any]:
    return {
        "type": "library",
        "bom-ref": _purl(pin),
        "name": pin.name,
        "version": pin.version,
        "hashes": [{"alg": "SHA-256", "content": value} for value in pin.hashes],
        "licenses": licences(pin.name),
        "purl": _purl(pin),
    }


def licences(name: str) -> list[dict[str, Any]]:
    """What an installed package states: an SPDX expression, classifiers, or a name."""
    told = metadata.metadata(name)
    if expression := told.get("License-Expression"):
        return [{"expression": expression}]
    named = [
        text.removeprefix(_CLASSIFIER)
        for text in told.get_all("Classifier") or []
        if text.startswith(_CLASSIFIER)
    ]
    stated = (told.get("License") or "").strip().split("\n")[0]
    if not named and stated and len(stated) <= _LONGEST:
        named = [stated]
    return [{"license": {"name": text}} for text in named]


def _names(requirements: list[str]) -> list[str]:
    """Names of what is required without an extra."""
    plain = [text for text in requirements if "extra ==" not in text]
    return [normal(re.split(r"[<>=!~;\[ (]", text, maxsplit=1)[0]) for text in plain]


def _purl(pin: Pin) -> str:
    return f"pkg:pypi/{pin.name}@{pin.version}"


def main() -> None:
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "build/automap.cdx.json")
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(bill(), indent=1) + "\n", encoding="utf-8")
    print(out)


if __name__ == "__main__":
    main()
