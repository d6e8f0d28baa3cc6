"""Whether a pinned package has a known vulnerability, by pip-audit.

    python -m release.audit [COMMAND...]

COMMAND is pip-audit unless told otherwise. Its data are in the net: where they cannot be had, that
is said, and nothing was audited. Exit code 0: none known, 1: some are, 3: not (all) audited.
"""

from __future__ import annotations

import json
import subprocess
import sys

from release.pins import BUILD, DEV, ROOT, RUNTIME


def audit(command: list[str]) -> tuple[int, list[str]]:
    """Exit code and lines to say."""
    files = [word for name in (RUNTIME, BUILD, DEV) for word in ("-r", str(ROOT / name))]
    words = [*command, "--no-deps", "--disable-pip", "--format", "json", *files]
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=600)
        told = json.loads(done.stdout)["dependencies"]
    except (OSError, ValueError, KeyError, TypeError, subprocess.TimeoutExpired) as error:
        why = f"{command[0]} gives no answer ({type(error).__name__})"
        return 3, [f"{why}; nothing was audited: install it and go online."]
    skipped = [one["name"] for one in told if "skip_reason" in one]
    bad = [(one, vulnerability) for one in told for vulnerability in one.get("vulns", [])]
    lines = [
        f"{one['name']} {one['version']}: {vulnerability['id']}; mended in "
        f"{', '.join(vulnerability.get('fix_versions', [])) or 'no version'}"
        for one, vulnerability in bad
    ]
    audited = len(told) - len(skipped)
    lines.append(
        f"{audited} of {len(told)} pinned packages audited, {len(bad)} vulnerabilities known."
    )
    if skipped:
        lines.append(
            f"Of {len(skipped)} packages ({', '.join(skipped[:3])} ...) the index tells nothing; "
            "audit again where it does."
        )
    return (1 if bad else 3 if skipped or not told else 0), lines


def main() -> int:
    code, lines = audit(sys.argv[1:] or ["pip-audit"])
    print("\n".join(lines))
    return code


if __name__ == "__main__":
    sys.exit(main())
