"""Chromium without a screen, where this machine has it; tests that need it are skipped by name elsewhere."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

from tests.support.forked import AUTOTUNE, Program

BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
needs_browser = pytest.mark.skipif(
    not (BROWSER and DRIVER), reason="no Chromium here (Debian: apt-get install chromium chromium-driver)"
)
_FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage",
)  # fmt: skip


@contextmanager
def browser(
    folder: Path, *, width: int = 1366, height: int = 900, dark: bool = False
) -> Iterator[webdriver.Chrome]:
    """A browser with an empty profile; downloads go to `folder`."""
    options = Options()
    options.binary_location = str(BROWSER)
    for flag in (*_FLAGS, f"--user-data-dir={folder / 'profile'}", f"--window-size={width},{height}"):
        options.add_argument(flag)
    if dark:
        options.add_argument("--force-dark-mode")
        options.add_argument("--blink-settings=preferredColorScheme=0")
    options.add_experimental_option("prefs", {"download.default_directory": str(folder)})
    driver = webdriver.Chrome(options=options, service=Service(str(DRIVER)))
    try:
        yield driver
    finally:
        driver.quit()


@contextmanager
def workbench(*files: Path) -> Iterator[str]:
    """`autotune workbench` in a process of its own; the address that it prints."""
    process = Program(AUTOTUNE, "workbench", "--no-open", *map(str, files))
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        process.communicate(timeout=20)


def serious(driver: webdriver.Chrome) -> list[tuple[str, str]]:
    """Serious and critical faults of accessibility on the page (axe-core), each with where it is."""
    from axe_core_python.selenium import Axe

    return [
        (one["id"], one["nodes"][0]["html"][:120])
        for one in Axe().run(driver)["violations"]
        if one["impact"] in ("serious", "critical")
    ]
