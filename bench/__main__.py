"""`make bench`: the benchmarks, one after the other; `python -m bench NAME …` runs those named.

Each prints its table; what is worth keeping goes to docs/benchmarks.md with the date and the commit. All
are seeded. The long ones run only when named.
"""

from __future__ import annotations

import subprocess
import sys

from autotune.core.threads import one_thread

USUAL: dict[str, list[list[str]]] = {
    "identify_speed": [[]],
    "identify": [[]],
    "diagnosis": [["singles"], ["nulls", "--runs", "20"], ["pairs"], ["aliens"], ["removed"]],
    "commit_cut": [[]],
    "recorder": [[]],
    "measured": [[]],
    "worlds.rivals": [["--singles", "4", "--nulls", "2", "--aliens", "1"]],
    "export_c": [["--samples", "1000000"]],
}
LONG: dict[str, list[list[str]]] = {
    "service_axes": [[]],
    "service_reads": [[], ["--pages", "3", "--hung", "30"]],
    "browser_long": [[], ["--drop"]],
    "browser_hours": [[]],
    "service_schema": [[]],
    "service_kills": [[], ["--wire", "--kills", "20"]],
    "year": [[]],
    "live_view": [["cost"], ["suspended"], ["attach"], ["hour"]],
    "tuning": [["--seed", "100"]],
    "gains": [["thesis"], ["boundary"], ["axes"]],
    "gains_identified": [[]],
    "friction_scale": [[]],
    "fuzz": [["--inputs", "1000000"]],
    "worlds": [["--singles", "32", "--nulls", "16", "--aliens", "11", "--workers", "2"]],
}


def main(names: list[str]) -> int:
    """Runs benchmarks as processes of their own; returns the first exit code that is not 0."""
    known = USUAL | LONG
    unknown = [name for name in names if name not in known]
    if unknown:
        sys.stderr.write(f"bench: there is no {', '.join(unknown)}; there are {', '.join(known)}\n")
        return 2
    one_thread()
    codes = []
    for name in names or USUAL:
        for options in known[name]:
            sys.stdout.write(f"\n== {' '.join([name, *options])}\n")
            sys.stdout.flush()
            command = [sys.executable, "-m", f"bench.{name}", *options]
            codes.append(subprocess.run(command, check=False).returncode)
    return next((code for code in codes if code), 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
