"""Whether the service's page grows: hours of its rounds, compressed, with a tuning under way and after it.

The page's own timer runs `--faster` times as fast, so that an hour of rounds takes minutes. Between the parts the
browser collects its garbage; what is left then is the page's.

    python -m bench.browser_hours [--hours 1] [--faster 40]
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from selenium.webdriver import Chrome

from bench.service_rig import Service, write_axis, write_service
from tests.workbench.browser import browser

ROUND = 2.0
"""s, of the page's timer."""
PARTS = 6
HURRY = """
const timer = window.setInterval; window.rounds = 0;
window.setInterval = (what, after) => timer(() => { window.rounds++; what(); }, after / %g);
"""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--faster", type=float, default=40.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_axis(folder, "one", f"sim://edm-vertical?memory={folder}/one.json")
        write_service(folder, ["one"])
        service = Service(folder)
        service.start()
        try:
            with browser(folder / "browser") as driver:
                found = watched(driver, service, options.hours * 3600.0 / ROUND, options.faster)
        finally:
            service.end()
    sys.stdout.write(json.dumps(found | {"load": round(os.getloadavg()[0], 1)}, indent=2) + "\n")


def watched(driver: Chrome, service: Service, rounds: float, faster: float) -> dict[str, Any]:
    """The page's memory and elements after each part of the rounds."""
    driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": HURRY % faster})
    driver.execute_cdp_cmd("Performance.enable", {})
    driver.get(service.address)
    service.submit("one", "run")
    time.sleep(3.0)
    parts = [state(driver)]
    for part in range(1, PARTS + 1):
        while driver.execute_script("return window.rounds") < part * rounds / PARTS:
            time.sleep(0.2)
        parts.append(state(driver))
    return {"rounds": driver.execute_script("return window.rounds"), "parts": parts}


def state(driver: Chrome) -> dict[str, float]:
    driver.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
    metrics = {
        one["name"]: one["value"] for one in driver.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
    }
    return {
        "heap_mb": round(metrics["JSHeapUsedSize"] / 1e6, 2), "nodes": metrics["Nodes"],
        "listeners": metrics["JSEventListeners"],
    }  # fmt: skip


if __name__ == "__main__":
    main()
