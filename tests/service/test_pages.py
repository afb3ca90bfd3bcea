"""The service's pages in a real browser: a tuning from the page, what people with bad eyes or hands meet, troubles."""

from __future__ import annotations

import json
import os
import re
import signal
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By

from autotune.view.report import Change, Report, Table, write_report
from tests.service.conftest import a_check
from tests.service.test_live import Live, live
from tests.workbench.browser import browser, needs_browser, serious
from tests.workbench.test_page import Page, until

__all__ = ["live"]

BEGUN = re.compile("run running, (?!start)")  # whichever stage: a simulated one may be over in 2 s
SIZES = [(1366, 768), (820, 1180), (400, 850)]


class Desk:
    """What a person does on the service's page."""

    def __init__(self, driver: Chrome, live: Live, pictures: Path) -> None:
        self.driver, self.live, self.pictures, self.taken = driver, live, pictures, 0

    def text(self, where: str) -> str:
        try:
            return " ".join(one.text for one in self.driver.find_elements(By.CSS_SELECTOR, where))
        except StaleElementReferenceException:
            return ""

    def wait(self, where: str, words: str) -> None:
        until(lambda: words in self.text(where))

    def press(self, words: str) -> None:
        """The button of that name on the axis's card; the page may draw it anew at any moment."""

        def pressed() -> bool:
            try:
                for one in self.driver.find_elements(By.CSS_SELECTOR, "#axes button"):
                    if one.text == words and one.is_enabled():
                        self.driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", one)
                        one.click()
                        return True
            except StaleElementReferenceException:
                pass
            return False

        until(pressed)

    def agree(self) -> None:
        box = self.driver.find_element(By.ID, "sure-box")
        until(box.is_displayed)
        self.driver.find_element(By.CSS_SELECTOR, "#sure-box button[value=yes]").click()

    def give_token(self) -> None:
        box = self.driver.find_element(By.ID, "token-box")
        until(box.is_displayed)
        token = (self.live.folder / "runs" / ".service" / "token").read_text().strip()
        self.driver.find_element(By.ID, "token").send_keys(token)
        self.driver.find_element(By.CSS_SELECTOR, "#token-box button[value=go]").click()

    def picture(self, name: str) -> None:
        self.taken += 1
        self.driver.save_screenshot(str(self.pictures / f"service-{self.taken}-{name}.png"))


def fitted(driver: Chrome, recording: Path) -> Page:
    """The open workbench after a recording was dropped there and fitted."""
    page = Page(driver)
    until(lambda: "Drop a recording" in page.text("status"))
    driver.find_element(By.ID, "choose").send_keys(str(recording))
    until(lambda: "rows" in page.text("status"))
    page.press("fit")
    until(lambda: page.text("figures") and page.idle())
    return page


def kept_pictures(folder: Path) -> Path:
    """Where screenshots stay: AUTOTUNE_PICTURES, else with the test's other files."""
    pictures = Path(os.environ.get("AUTOTUNE_PICTURES", folder / "pictures"))
    pictures.mkdir(parents=True, exist_ok=True)
    return pictures


@needs_browser
@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_tuning_is_started_watched_approved_and_rolled_back(live: Live, tmp_path: Path) -> None:
    live.start()
    with browser(tmp_path) as driver:
        desk = Desk(driver, live, kept_pictures(tmp_path))
        driver.get(live.address)
        desk.wait("#axes", "one")
        desk.press("Tune")
        desk.agree()
        desk.give_token()
        desk.wait("#axes .verdict", "run running")
        desk.picture("running")
        until(lambda: BEGUN.search(desk.text("#axes .verdict")))
        assert driver.find_elements(By.CSS_SELECTOR, "#axes progress")
        until(lambda: "waits for a person" in desk.text("#first"))
        desk.picture("approve")
        assert "mrad" in desk.text("#axes article")
        desk.wait("#jobs", "tuning: proved, waits for a person")
        assert "not applied" not in desk.text("#status")
        desk.press("Approve")
        desk.agree()
        desk.wait("#status", "Approved")
        until(lambda: [job["state"] for job in live.get("/api/jobs") if job["kind"] == "commit"] == ["done"])
        (commit,) = [job for job in live.get("/api/jobs") if job["kind"] == "commit"]
        assert commit["outcome"] == "kept"
        until(lambda: "Nothing waits" in desk.text("#first"))
        desk.wait("#jobs", "tuning: proved, approved")
        desk.picture("kept")
        desk.press("Roll back")
        desk.agree()
        until(
            lambda: [job["state"] for job in live.get("/api/jobs") if job["kind"] == "rollback"] == ["done"]
        )
        (rollback,) = [job for job in live.get("/api/jobs") if job["kind"] == "rollback"]
        assert rollback["exit_code"] == 0
        desk.wait("#jobs", "roll-back: restored")
        desk.picture("rolled-back")
        link = until(lambda: driver.find_elements(By.CSS_SELECTOR, "#reports a"))[-1]  # of the tuning itself
        driver.get(str(link.get_attribute("href")))
        until(lambda: driver.find_elements(By.CSS_SELECTOR, ".js-plotly-plot"))
        assert "Proved, not written" in desk.text(".badge")
        desk.picture("report")
        assert not [one for one in driver.get_log("browser") if one["level"] == "SEVERE"]


@pytest.fixture
def filled(live: Live) -> Iterator[Live]:
    """A service with a history, a proposal that waits, and a report."""
    past(live.folder / "runs", "one")
    live.start()
    yield live
    live.end(signal.SIGTERM)


def past(runs: Path, axis: str, days: int = 30) -> None:
    """Checks of a month and the report of a run, as a service finds them on its start."""
    start = datetime.now(UTC).replace(microsecond=0) - timedelta(days=days)
    for day in range(days):
        at = start + timedelta(days=day)
        folder = runs / f"{at:%Y%m%d-%H%M%S}-{axis}"
        folder.mkdir(parents=True)
        (folder / "check.json").write_text(json.dumps(a_check(axis, at, 0.33 * (1.0 + 0.01 * day))))
    changes = [Change("Quadrant glitch", 2e-3, 5e-4, "rad")]
    tables = [Table("Notes", ("what the experiments say",), [["nothing unusual"]])]
    run = runs / f"{start:%Y%m%d}-235900-{axis}"
    run.mkdir()
    write_report(
        run / "report.html", Report(axis, "kept", "Four times less.", changes=changes, tables=tables)
    )


@needs_browser
@pytest.mark.long
@pytest.mark.parametrize("dark", [False, True])
def test_no_page_has_a_serious_fault_for_who_sees_or_moves_badly(
    dark: bool, filled: Live, tmp_path: Path
) -> None:
    pictures = kept_pictures(tmp_path)
    (report,) = filled.get("/api/reports")
    with browser(tmp_path, dark=dark) as driver:
        for name, path in (
            ("axes", "/"), ("api", "/docs"), ("workbench", "/workbench"), ("report", f"/api/reports/{report['id']}"),
        ):  # fmt: skip
            for width, height in SIZES:
                driver.set_window_size(width, height)
                driver.get(filled.address + path)
                time.sleep(1.5)
                driver.save_screenshot(str(pictures / f"{name}-{width}-{'dark' if dark else 'light'}.png"))
                assert not serious(driver), (name, width)
                assert driver.execute_script("return document.documentElement.scrollWidth - innerWidth") <= 0


@needs_browser
def test_the_pages_open_and_have_no_serious_fault(live: Live, tmp_path: Path) -> None:
    live.start()
    with browser(tmp_path) as driver:
        driver.get(live.address)
        desk = Desk(driver, live, tmp_path)
        desk.wait("#axes", "one")
        assert not serious(driver)
        driver.get(live.address + "/docs")
        desk.wait("#status", "autotune")
        assert not serious(driver)


@needs_browser
@pytest.mark.long
def test_a_service_that_is_started_again_under_an_open_page_is_found_again(
    live: Live, tmp_path: Path
) -> None:
    live.start()
    port = live.address.rpartition(":")[2]
    (live.folder / "service.toml").write_text(
        (live.folder / "service.toml").read_text().replace("port = 0", f"port = {port}")
    )
    with browser(tmp_path) as driver:
        driver.get(live.address)
        desk = Desk(driver, live, tmp_path)
        desk.wait("#axes", "one")
        live.end(signal.SIGTERM)
        desk.wait("#status", "does not answer")
        assert "one" in desk.text("#axes")
        live.start()
        desk.wait("#status", "answers again")
        desk.press("Check")
        desk.agree()
        desk.give_token()
        until(lambda: [job["kind"] for job in live.get("/api/jobs")] == ["check"])


@needs_browser
@pytest.mark.long
@pytest.mark.timeout(600)
def test_the_workbench_loses_nothing_when_the_service_is_started_again(live: Live, tmp_path: Path) -> None:
    """Recordings that a page was given are sent again, models are the page's own; the service's token is the same."""
    import autotune

    recording = tmp_path / "mine.parquet"
    played = autotune.simulate("sim://lugre?seed=3&effect=gravity_imbalance:0.05", programme="high-speed")
    autotune.write_recording(played, recording)
    live.start()
    port = live.address.rpartition(":")[2]
    settings = live.folder / "service.toml"
    settings.write_text(settings.read_text().replace("port = 0", f"port = {port}"))
    with browser(tmp_path / "browser") as driver:
        driver.get(live.address + "/workbench")
        token = (live.folder / "runs" / ".service" / "token").read_text().strip()
        until(driver.find_element(By.ID, "token-box").is_displayed)
        driver.find_element(By.ID, "token").send_keys(token + "\n")
        page = fitted(driver, recording)
        live.end(signal.SIGTERM)
        live.start()
        assert live.address.endswith(f":{port}")
        page.press("compare")
        until(page.idle)
        until(lambda: "mine.parquet" in page.text("list") and page.text("figures"))
        assert "not here any more" not in page.text("status")
        page.press("reversal")  # the traces are there again, too
        until(lambda: driver.find_elements(By.CSS_SELECTOR, "#trace-torque canvas"))


@needs_browser
@pytest.mark.long
@pytest.mark.timeout(600)
def test_a_doubt_is_decided_and_a_model_sent_to_the_axis_from_the_workbench(
    live: Live, tmp_path: Path
) -> None:
    """The experiment that a diagnosis asks for is asked about, watched, and its recording there; so is a tuning."""
    import autotune

    recording = tmp_path / "mine.parquet"
    played = autotune.simulate("sim://lugre?seed=3&effect=gravity_imbalance:0.05", programme="high-speed")
    autotune.write_recording(played.with_metadata(axis="", fingerprint=""), recording)
    live.start()
    with browser(tmp_path / "browser") as driver:
        token = (live.folder / "runs" / ".service" / "token").read_text().strip()
        driver.get(f"{live.address}/workbench#token={token}")
        page = fitted(driver, recording)
        assert not driver.find_element(By.ID, "decide").is_displayed()
        page.press("diagnose")
        until(lambda: "suspected" in page.text("verdict") and page.idle())
        page.press("decide-play")
        box = driver.find_element(By.ID, "sure-box")
        until(box.is_displayed)
        assert "gravity imbalance" in page.text("sure-why")
        assert not serious(driver)
        driver.find_element(By.CSS_SELECTOR, "#sure-box button[value=no]").click()
        assert live.get("/api/jobs") == []
        page.press("decide-play")
        until(box.is_displayed)
        driver.find_element(By.CSS_SELECTOR, "#sure-box button[value=yes]").click()
        until(lambda: "one: " in page.text("doing"))
        until(lambda: "diagnose again with both" in page.text("status"))
        assert page.idle()
        assert "mine.parquet" in page.text("list")
        until(lambda: " decide: " in page.text("list"))
        page.press("send-model")
        until(box.is_displayed)
        assert "waits for approval" in page.text("sure-why")
        driver.find_element(By.CSS_SELECTOR, "#sure-box button[value=yes]").click()
        until(lambda: "one: experiment" in page.text("doing"))
        until(lambda: page.idle() and page.text("status").startswith("one: "))
        (waits,) = live.get("/api/proposals")
        assert waits["state"] == "open"
        assert not page.complaints()
