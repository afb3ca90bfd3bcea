"""On the page: what the chosen recordings used of the limits of their axis, or what is known without one."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import uvicorn
from fastapi import FastAPI
from selenium.webdriver.common.by import By

from autotune.core.axis import Axis, read_axis
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Recording
from autotune.view.viewer_server import any_port
from autotune.workbench.engine import Engine
from autotune.workbench.files import Files
from autotune.workbench.routes import page_routes, workbench_routes
from tests.workbench.browser import browser, needs_browser, serious
from tests.workbench.test_page import TOO_WIDE, Page, until

EXAMPLE = Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical.toml"
SHARES = """
return [...document.querySelectorAll('#used .row')].map(row => {
  const track = row.querySelector('.track'), fill = row.querySelector('.fill');
  return fill ? fill.getBoundingClientRect().width / track.getBoundingClientRect().width : null;
});
"""


@contextmanager
def page_with(axis: Axis, folder: Path) -> Iterator[str]:
    """The workbench of a service that has this axis; its address."""
    engine = Engine()
    app = FastAPI()
    app.include_router(page_routes())
    app.include_router(workbench_routes(Files(folder), engine, [axis]))
    port = any_port()
    server = uvicorn.Server(uvicorn.Config(app, port=port, log_level="error"))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        while not server.started:
            time.sleep(0.05)
        yield f"http://127.0.0.1:{port}/workbench#token=none"
    finally:
        server.should_exit = True
        thread.join(10.0)
        engine.close()


@needs_browser
@pytest.mark.long
def test_what_was_used_of_the_limits_is_on_the_page(short: Recording, tmp_path: Path) -> None:
    axis = read_axis(EXAMPLE)
    limits = axis.limits
    known = short.with_metadata(axis=axis.name, fingerprint=axis.fingerprint)
    write_recording(known, tmp_path / "known.parquet")
    write_recording(short.with_metadata(axis="", fingerprint=""), tmp_path / "unknown.parquet")
    with page_with(axis, tmp_path / "held") as address, browser(tmp_path) as driver:
        driver.get(address)
        page = Page(driver)
        until(lambda: "Drop a recording" in page.text("status"))
        driver.find_element(By.ID, "choose").send_keys(str(tmp_path / "known.parquet"))
        until(lambda: axis.name in page.text("used-about"))
        expected = [
            np.ptp(short["position"]) / (limits.position_max - limits.position_min),
            np.abs(short["velocity"]).max() / limits.speed,
            np.abs(short["torque"]).max() / limits.torque,
        ]
        shares = driver.execute_script(SHARES)
        assert shares == pytest.approx(np.clip(expected, 0.0, 1.0), abs=0.01)  # a bar has some hundred pixels
        assert "%" in page.text("used")
        for theme in ("light", "dark"):
            wanted = {"features": [{"name": "prefers-color-scheme", "value": theme}]}
            driver.execute_cdp_cmd("Emulation.setEmulatedMedia", wanted)
            for width, height in ((1366, 768), (820, 1180), (400, 850)):
                driver.set_window_size(width, height)
                until(lambda: driver.execute_script(TOO_WIDE) <= 0)  # plots are drawn anew a moment later
                assert not serious(driver), (theme, width)
        driver.find_element(By.ID, "choose").send_keys(str(tmp_path / "unknown.parquet"))
        until(lambda: "not compared" in page.text("used-about"))
        assert driver.execute_script(SHARES)[:2] == [
            None,
            None,
        ]  # of the torque the recordings know it themselves
        assert not page.complaints()
