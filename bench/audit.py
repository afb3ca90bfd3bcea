"""Known vulnerabilities of the pinned versions (`make audit`), by pip-audit.

pip-audit says "no known vulnerabilities" also where it could look up nothing: without a network, or behind a mirror
that has no such data. Here that is "skipped", in words, and a package that could not be looked up is named.

    python -m bench.audit constraints.txt
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

SECONDS = 600.0


def judge(found: Mapping[str, Any]) -> tuple[int, list[str]]:
    """Exit code and lines for pip-audit's JSON: 1 where something is known, 0 where nothing is or nobody could say."""
    packages = found.get("dependencies", [])
    unknown = [one["name"] for one in packages if "skip_reason" in one]
    known = [one for one in packages if one.get("vulns")]
    if len(unknown) == len(packages):
        return 0, ["skipped: nothing could be looked up; this needs the data of pypi.org or osv.dev"]
    lines = [
        f"{one['name']} {one['version']}: {vulnerability['id']}, mended in "
        f"{', '.join(vulnerability['fix_versions']) or 'no version yet'}"
        for one in known
        for vulnerability in one["vulns"]
    ]
    lines.append(
        f"{len(packages) - len(unknown)} of {len(packages)} packages looked up, {len(known)} with a problem"
    )
    if unknown:
        lines.append(f"not looked up: {', '.join(unknown)}")
    return int(bool(known)), lines


def main() -> None:
    command = [
        sys.executable,
        "-m",
        "pip_audit",
        "--requirement",
        str(Path(sys.argv[1])),
        "--no-deps",
        "--disable-pip",
    ]
    try:
        done = subprocess.run(
            [*command, "--progress-spinner", "off", "--format", "json"],
            capture_output=True, text=True, timeout=SECONDS, check=False,
        )  # fmt: skip
        code, lines = judge(json.loads(done.stdout))
    except subprocess.TimeoutExpired:
        code, lines = 0, [f"skipped: no answer within {SECONDS:.0f} s"]
    except ValueError:
        last = done.stderr.strip().splitlines()[-1:] or ["pip-audit gave no result"]
        code, lines = 0, [f"skipped: {last[0]}"]
    print("\n".join(lines))
    sys.exit(code)


if __name__ == "__main__":
    main()
