"""A recording of ten million rows in the workbench: first picture, zoom, memory of the server and of the page.

    python -m bench.browser_long [--rows 10000000] [--zooms 100] [--drop]

The times are the page's own: from the click until the new picture is there and one frame has passed. `--drop` sends
the file from the page instead of naming it on the command line, and tells how long it was on its way and how long
after its last byte the first picture was there.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By

from autotune.recordings.files import write_recording
from autotune.recordings.recording import Metadata, Recording
from tests.workbench.browser import browser

PERIOD = 1e-3
ARRIVED = """
const now = performance.now();
const one = performance.getEntriesByType('resource').find((entry) => entry.name.includes('recordings?name='));
const here = one.responseEnd - one.serverTiming[0].duration;
return [here - one.startTime, now - here].map((ms) => Math.round(ms) / 1e3);
"""
DRAWN = """
const done = arguments[arguments.length - 1], box = document.getElementById('trace-torque');
const began = performance.now();
const seen = new MutationObserver(
  () => { seen.disconnect(); requestAnimationFrame(() => done(performance.now() - began)); });
seen.observe(box, {attributes: true, attributeFilter: ['data-drawn']});
document.getElementById(arguments[0]).click();
"""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rows", type=int, default=10_000_000)
    parser.add_argument("--zooms", type=int, default=100)
    parser.add_argument("--drop", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.parquet"
        write_recording(made(options.rows), path)
        found = measured(path, Path(folder), options.zooms, options.drop)
    found |= {"rows": options.rows, "load": round(os.getloadavg()[0], 1)}
    sys.stdout.write(json.dumps(found, indent=2) + "\n")


def made(rows: int) -> Recording:
    """A sine with friction and noise, 1 kHz."""
    time_ = np.arange(rows) * PERIOD
    phase = 2.0 * np.pi * 0.05 * time_
    position = np.round(np.sin(phase) / 1e-4) * 1e-4
    torque = 0.3 * np.sign(np.cos(phase)) + 0.01 * np.random.default_rng(1).standard_normal(rows)
    columns = {"time": time_, "position": position, "torque": torque, "reference": np.sin(phase)}
    return Recording.from_columns(columns, Metadata(sample_period=PERIOD, torque_limit=1.34), "motion")


def measured(path: Path, folder: Path, zooms: int, drop: bool) -> dict[str, Any]:
    """Starts program and browser, and plays with the page."""
    command = [
        sys.executable,
        "-m",
        "autotune.cli.main",
        "workbench",
        "--no-open",
        *([] if drop else [str(path)]),
    ]
    began = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    try:
        address = process.stdout.readline().strip()
        served = time.monotonic() - began
        with browser(folder) as driver:
            driver.set_script_timeout(120)
            driver.get("about:blank")
            began = time.monotonic()
            driver.get(address)
            if drop:
                driver.find_element(By.ID, "choose").send_keys(str(path))
            until_drawn(driver)
            first = time.monotonic() - began
            arrived = driver.execute_script(ARRIVED) if drop else None
            before = processor(process.pid)
            times = zoomed(driver, zooms)
            each = 1e3 * (processor(process.pid) - before) / max(zooms, 1)
            page = driver.execute_cdp_cmd("Performance.enable", {}) or driver.execute_cdp_cmd(
                "Performance.getMetrics", {}
            )
        peak = memory(process.pid)
    finally:
        process.terminate()
        process.wait(30)
    heap = {one["name"]: one["value"] for one in page.get("metrics", [])}.get("JSHeapUsedSize", 0.0)
    return {
        "command_to_address_s": round(served, 2), "page_to_first_picture_s": round(first, 2),
        "sent_s_arrived_to_picture_s": arrived,
        "zoom_ms": {f"p{q}": round(float(np.percentile(times, q)), 1) for q in (50, 95, 100)},
        "zoom_server_cpu_ms": round(each, 1),
        "server_peak_mb": round(peak / 1e6), "page_heap_mb": round(heap / 1e6, 1),
    }  # fmt: skip


def until_drawn(driver: Chrome) -> None:
    while not driver.execute_script("return document.querySelector('#trace-torque canvas') !== null"):
        time.sleep(0.02)


def processor(process: int) -> float:
    """Seconds of processor time that a process has had."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def zoomed(driver: Chrome, zooms: int) -> list[float]:
    """Milliseconds of each picture, in and out and along the recording."""
    draw = random.Random(1)
    times = []
    for _ in range(zooms):
        name = draw.choice(["closer", "closer", "earlier", "later", "closer", "whole"])
        times.append(float(driver.execute_async_script(DRAWN, name)))
    return times


def memory(process: int) -> int:
    """The most bytes that a process has had."""
    text = Path(f"/proc/{process}/status").read_text()
    return int(next(line for line in text.splitlines() if line.startswith("VmHWM")).split()[1]) * 1024


if __name__ == "__main__":
    main()
