"""Pictures of the workbench and of a run's report in Chromium, for the docs; part of `make pictures`."""

from __future__ import annotations

import io
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from PIL import Image
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By

from tests.workbench.browser import BROWSER, DRIVER, browser, workbench

WIDTH, HEIGHT = 1200, 900
COLOURS = 64
PATIENCE = 300.0


def browser_pictures(run: Path, folder: Path) -> None:
    """`workbench-….png` and `report.png` of a run's folder; said and left where there is no browser."""
    if not (BROWSER and DRIVER):
        print("pages' pictures left as they are: no Chromium here")
        return
    with tempfile.TemporaryDirectory() as scratch:
        with (
            workbench(run / "recordings" / "experiment.parquet") as address,
            browser(Path(scratch), width=WIDTH, height=HEIGHT) as driver,
        ):
            _workbench(driver, address, folder)
        with browser(Path(scratch), width=WIDTH, height=HEIGHT) as driver:
            driver.get((run / "report.html").resolve().as_uri())
            time.sleep(2.0)
            _keep(driver.get_screenshot_as_png(), folder / "report.png")


def _workbench(driver: Chrome, address: str, folder: Path) -> None:
    """A base model of the experiments, what it lacks, and the first candidate laid over its error."""
    driver.get(address)
    _until(lambda: "rows" in _text(driver, "status"))
    driver.find_element(By.ID, "fit").click()
    _until(lambda: _text(driver, "figures") != "" and _idle(driver))
    driver.find_element(By.ID, "diagnose").click()
    _until(lambda: _text(driver, "verdict") != "" and _idle(driver))
    over = driver.find_element(By.CSS_SELECTOR, "#candidates button")
    driver.execute_script("arguments[0].click()", over)
    for name, title in (("where", "where-title"), ("missing", "missing-title")):
        section = driver.find_element(By.CSS_SELECTOR, f"section[aria-labelledby={title}]")
        driver.set_window_size(WIDTH, section.size["height"] + 200)
        driver.execute_script("arguments[0].scrollIntoView()", section)
        time.sleep(1.0)
        _keep(section.screenshot_as_png, folder / f"workbench-{name}.png", HEIGHT)


def _keep(picture: bytes, path: Path, high: int = 0) -> None:
    """Few colours suffice; a long one is cut."""
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    if high and image.height > high:
        image = image.crop((0, 0, image.width, high))
    image.quantize(COLOURS).save(path, optimize=True)


def _text(driver: Chrome, id: str) -> str:
    return driver.find_element(By.ID, id).text


def _idle(driver: Chrome) -> bool:
    return not driver.find_element(By.ID, "work").is_displayed()


def _until(asked: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not asked():
        if time.monotonic() > end:
            raise TimeoutError("the page did not come so far")
        time.sleep(0.2)
