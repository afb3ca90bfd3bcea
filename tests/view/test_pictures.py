"""The pages as a person sees them, rendered by the viewer without a screen; kept where AUTOTUNE_PICTURES says.

The check on the blueprints' contents is in `test_pages.py`; here are real runs and real pictures.
"""

from __future__ import annotations

import io
import os
import time
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import autotune
from autotune.core.axis import read_axis
from autotune.core.errors import ConfigurationError
from autotune.diagnosis.fit_recordings import compared_or_none
from autotune.diagnosis.fit_result import summary
from autotune.recordings.files import read_recording
from autotune.tuning.link_check import check_link
from autotune.tuning.links import open_link
from autotune.tuning.preparation import SessionRequest
from autotune.tuning.progress import Silent
from autotune.tuning.run import Request, tune
from autotune.view.compared_pages import write_fit_rrd
from autotune.view.live import LiveSettings, LiveView
from autotune.view.snapshot import HeadlessViewer, headless_viewer
from tests.view.rerun_contents import empty_views, views_of

EXAMPLE = Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical.toml"
pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]


@pytest.fixture(scope="module")
def viewer() -> Iterator[HeadlessViewer]:
    try:
        with headless_viewer() as found:
            yield found
    except ConfigurationError as reason:
        pytest.skip(str(reason))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """run.rrd of a whole run, and what every command with --rrd makes of its recordings."""
    folder = tmp_path_factory.mktemp("run")
    axis = read_axis(EXAMPLE).model_copy(update={"link": "sim://edm-vertical"})
    done = tune(Request(axis, lambda: open_link(axis, folder), folder, Silent(), datetime.now))
    recordings = [
        read_recording(done.run_directory / "recordings" / f"{name}.parquet")
        for name in ("experiment", "confirmation")
    ]
    fitted = autotune.fit(recordings[0])
    base = fitted.model
    assert base is not None
    shown = compared_or_none(recordings[:1], base)
    write_fit_rrd(folder / "fit.rrd", recordings[:1], base, summary(fitted), shown)
    autotune.compare(recordings, base).write_rrd(folder / "compare.rrd", recordings)
    autotune.diagnose(recordings, base).write_rrd(folder / "diagnose.rrd", recordings)
    added = autotune.add_effect("torque_ripple", recordings, base)
    added.write_rrd(folder / "add.rrd", recordings, base)
    names = ("fit", "compare", "diagnose", "add")
    return {"run": done.run_directory / "run.rrd"} | {name: folder / f"{name}.rrd" for name in names}


@pytest.mark.parametrize("name", ["run", "fit", "compare", "diagnose", "add"])
def test_every_view_shows_something(viewer: HeadlessViewer, files: dict[str, Path], name: str) -> None:
    assert empty_views(files[name]) == []
    kinds = {view.name: view.kind for view in views_of(files[name])}
    viewer.open(files[name])
    try:
        assert set(_look(viewer, name, kinds)) == set(kinds)
    finally:
        viewer.close()


def test_the_page_of_a_link_shows_something_while_it_is_measured(
    viewer: HeadlessViewer, tmp_path: Path
) -> None:
    axis = read_axis(EXAMPLE).model_copy(update={"link": "sim://edm-vertical"})
    with LiveView(LiveSettings(name=axis.name, period=axis.cycle, window=False, web=False)) as live:
        viewer.open(live.url)
        asked = SessionRequest(
            axis, lambda: open_link(axis, tmp_path), tmp_path, Silent(), datetime.now, [live]
        )
        check_link(asked, None)
        end = time.monotonic() + 60.0
        while "Cycles" not in viewer.views().values() and time.monotonic() < end:
            time.sleep(0.2)
        try:
            seen = _look(viewer, "link", {"Cycles": "TextDocument"})
            assert {"Time between answers [ms]", "Round trip and jitter", "Cycles"} <= set(seen)
        finally:
            viewer.close()


def _look(viewer: HeadlessViewer, name: str, kinds: Mapping[str, str]) -> list[str]:
    """Keeps a picture of every tab; titles of the views, none of which is empty."""
    seen: dict[str, int] = {}
    for number, tab in enumerate(viewer.tabs()):
        _keep(f"{name}-{number}-{tab or 'page'}", viewer.picture())
        for identity, title in viewer.views().items():
            if picture := viewer.picture(identity, still=False):
                painted = _painted(picture, kinds.get(title, "TimeSeries"))
                seen[title] = max(seen.get(title, 0), painted)
    assert [title for title, count in seen.items() if count < 100] == []
    assert viewer.problems() == []
    return list(seen)


def _painted(picture: bytes, kind: str) -> int:
    """Pixels that data have painted: coloured ones, in a text bright ones. Frames, grids and ticks are grey."""
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=int)
    if kind == "TextDocument":
        return int(np.count_nonzero(pixels.min(axis=2) > 120))
    return int(np.count_nonzero(np.ptp(pixels, axis=2) > 60))


def _keep(name: str, picture: bytes) -> None:
    folder = os.environ.get("AUTOTUNE_PICTURES")
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        (Path(folder) / f"{name.lower().replace(' ', '-')}.png").write_bytes(picture)
