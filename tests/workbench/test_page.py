"""The page in a real browser: the story of a hidden effect by mouse and by keyboard, accessibility, and troubles."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

import autotune
from tests.support.axes import plain_axis
from tests.support.diagnosis_programme import play, programme
from tests.workbench.browser import browser, needs_browser, serious, workbench

T = TypeVar("T")
PATIENCE = 240.0


def until(asked: Callable[[], T], seconds: float = PATIENCE) -> T:
    end = time.monotonic() + seconds
    while True:
        found = asked()
        if found:
            return found
        if time.monotonic() > end:
            raise AssertionError("waited in vain")
        time.sleep(0.1)


class Page:
    """What a person does on the page."""

    def __init__(self, driver: Chrome, keyboard: bool = False) -> None:
        self.driver, self.keyboard = driver, keyboard

    def text(self, id: str) -> str:
        return self.driver.find_element(By.ID, id).text

    def press(self, id: str) -> None:
        element = self.driver.find_element(By.ID, id)
        until(element.is_enabled)
        if not self.keyboard:  # as a person does, who scrolls until it stands in the middle
            self.driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
            element.click()
            return
        for _ in range(80):  # by Tab alone
            self.driver.switch_to.active_element.send_keys(Keys.TAB)
            if self.driver.switch_to.active_element.get_attribute("id") == id:
                self.driver.switch_to.active_element.send_keys(Keys.ENTER)
                return
        raise AssertionError(f"{id} cannot be reached by keyboard")

    def idle(self) -> bool:
        return not self.driver.find_element(By.ID, "work").is_displayed()

    def complaints(self) -> list[str]:
        return [
            str(entry["message"]) for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"
        ]


@pytest.fixture(scope="module")
def hidden(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """86 s in which a load out of balance shows: sines, scans over the travel and moves from place to place."""
    path = tmp_path_factory.mktemp("hidden") / "hidden.parquet"
    axis = plain_axis(3, {"gravity_imbalance": 0.05})
    autotune.write_recording(play(axis, 3, programme(("sine", "scans", "points"))), path)
    return path


@needs_browser
@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("keyboard", [False, pytest.param(True, marks=pytest.mark.long)])
def test_a_hidden_effect_is_found_added_and_saved(keyboard: bool, hidden: Path, tmp_path: Path) -> None:
    with workbench(hidden) as address, browser(tmp_path) as driver:
        driver.get(address)
        page = Page(driver, keyboard)
        until(lambda: "rows" in page.text("status"))
        assert "token" not in driver.current_url
        page.press("fit")
        until(lambda: page.text("figures") and page.idle())
        page.press("diagnose")
        assert "gravity_imbalance" in until(lambda: page.text("verdict"))
        until(page.idle)
        page.press("add")
        until(lambda: "after" in page.text("status"))
        until(page.idle)
        error, floor = (
            float(value.text.split()[0]) for value in driver.find_elements(By.CSS_SELECTOR, "#figures b")[::2]
        )
        assert error <= 1.1 * floor
        page.press("save")
        saved = until(lambda: list(tmp_path.glob("model*.toml")))
        assert "gravity_imbalance" in saved[0].read_text()
        assert not page.complaints()
        driver.refresh()  # a tab that was closed: models are kept in the browser
        until(lambda: "gravity imbalance" in page.text("stairs"))
        page.press("undo")
        until(lambda: page.idle() and "gravity imbalance" not in page.text("stairs"))


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("size", [(1366, 768), (820, 1180), (400, 850)])
def test_nothing_serious_for_who_sees_or_moves_badly(
    size: tuple[int, int], dark: bool, hidden: Path, tmp_path: Path
) -> None:
    with workbench(hidden) as address, browser(tmp_path, width=size[0], height=size[1], dark=dark) as driver:
        driver.get(address)
        page = Page(driver)
        until(lambda: "rows" in page.text("status"))
        assert not serious(driver)
        wide = driver.execute_script("return document.documentElement.scrollWidth - innerWidth")
        assert wide <= 0


@needs_browser
@pytest.mark.slow
def test_a_program_that_is_gone_is_said_and_nothing_is_lost(hidden: Path, tmp_path: Path) -> None:
    with browser(tmp_path) as driver:
        with workbench(hidden) as address:
            driver.get(address)
            page = Page(driver)
            until(lambda: "rows" in page.text("status"))
        page.press("fit")
        until(lambda: "does not answer" in page.text("status"))
        assert "hidden.parquet" in page.text("list")


@needs_browser
@pytest.mark.slow
def test_without_the_token_the_page_asks_for_it(hidden: Path, tmp_path: Path) -> None:
    with workbench(hidden) as address, browser(tmp_path) as driver:
        where, _, token = address.partition("#token=")
        driver.get(where)
        page = Page(driver)
        box = until(lambda: driver.find_element(By.ID, "token-box"))
        until(box.is_displayed)
        driver.find_element(By.ID, "token").send_keys("wrong" + Keys.ENTER)
        until(lambda: "not the" in page.text("status") or "token" in page.text("token-why"))
        until(box.is_displayed)
        field = driver.find_element(By.ID, "token")
        field.clear()
        field.send_keys(token + Keys.ENTER)
        until(lambda: "rows" in page.text("status"))
        assert not box.is_displayed()
