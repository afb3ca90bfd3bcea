"""schemathesis against the service's own OpenAPI, with the token, on an axis that has been tuned.

The axis, a job, a model and a recording that exist are given to it, so that it gets behind the 404s.

    python -m bench.service_schema [--examples 500] [--seed 1]
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.service_rig import Service, write_axis, write_service

AXIS = "one"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--examples", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="autotune-schema-"))
    service = Service(folder)
    try:
        write_axis(folder, AXIS, f"sim://edm-vertical?memory={folder / 'memory.json'}")
        write_service(folder, [AXIS])
        service.start()
        for kind in ("run", "check"):
            service.submit(AXIS, kind)
        service.wait_until_done(600.0)
        _write_settings(service, folder)
        code = subprocess.run(
            [Path(sys.executable).with_name("schemathesis"), "run", f"{service.address}/openapi.json", "--no-color",
             "--max-examples", str(options.examples), "--seed", str(options.seed), "--request-timeout", "150",
             "-H", f"Authorization: Bearer {service.token}"],
            cwd=folder, check=False,
        ).returncode  # fmt: skip
        problems = [line for line in (folder / "log").read_text().splitlines() if "Error" in line]
        print("\n".join(problems[-20:]))
    finally:
        service.end()
        shutil.rmtree(folder, ignore_errors=True)
    sys.exit(code)


def _write_settings(service: Service, folder: Path) -> None:
    """Names and ids of what exists; event streams are read for a second."""
    model = service.get(f"/api/axes/{AXIS}/models")[0]["id"]
    recordings = service.get(f"/api/axes/{AXIS}/recordings")
    smallest = min(recordings, key=lambda one: int(one["bytes"]))["id"]
    streams = "".join(
        f'[[operations]]\ninclude-path = "{path}"\nrequest-timeout = 1.0\n'
        for path in ("/api/events", "/api/jobs/{job}/events", "/api/axes/{axis}/live")
    )
    known = {"axis": AXIS, "job": service.jobs()[0]["id"], "model": model, "recording": smallest}
    (folder / "schemathesis.toml").write_text(
        "[parameters]\n"
        + "".join(f"{name} = {json.dumps(value)}\n" for name, value in known.items())
        + streams
    )


if __name__ == "__main__":
    main()
