"""Pictures of what the Rerun viewer shows, without a screen: for documents, and for tests that look.

Needs a software renderer where there is no graphics card (Debian: mesa-vulkan-drivers).
"""

from __future__ import annotations

import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from autotune.core.errors import ConfigurationError
from autotune.view.viewer_server import HOST, any_port, quiet, quiet_environment, rerun_binary

START_SECONDS = 30.0
LOAD_SECONDS = 60.0
STILL_SECONDS = 0.4
MOST_FRAMES = 40


class HeadlessViewer:
    """A viewer without a window. `url`: where a stream connects; `process`: its own."""

    def __init__(self, client: Any, url: str, process: subprocess.Popen[bytes]) -> None:
        self._client = client
        self.url = url
        self.process = process

    def seconds(self) -> float:
        """How long what it has lasts [s]; 0 where it has nothing."""
        spans = [
            (timeline.end - timeline.start) / 1e9
            for recording in self._client.get_state().recordings
            for timeline in recording.timelines
            if timeline.time_type == "duration" and timeline.end is not None and timeline.start is not None
        ]
        return max(spans, default=0.0)

    def open(self, path: str | Path) -> None:
        """Loads a file, or connects to a server's url, and waits until all is there.

        Raises:
            ConfigurationError: it does not load in time.
        """
        opened = self._client.open(str(path))
        end = time.monotonic() + LOAD_SECONDS
        while "://" not in str(path) and not self._shows(opened.store_ids):
            if time.monotonic() > end:
                raise ConfigurationError(f"the viewer has not loaded {path} within {LOAD_SECONDS:.0f} s")
            time.sleep(0.2)

    def _shows(self, stores: list[str]) -> bool:
        """What was opened is there, whole and in front."""
        state = self._client.get_state()
        return not state.loading and bool(state.views) and (not stores or state.active_recording in stores)

    def close(self) -> None:
        """Closes what is open."""
        self._client.close("all")
        end = time.monotonic() + LOAD_SECONDS
        while self._client.get_state().recordings and time.monotonic() < end:
            time.sleep(0.2)

    def picture(self, view: str | None = None, still: bool = True) -> bytes:
        """A picture (PNG) of the window or of one view, once two in a row are the same; b"" of a view not in front."""
        before = b""
        for _ in range(MOST_FRAMES):
            try:
                now = bytes(self._client.take_screenshot(view))
            except (RuntimeError, ConnectionError):
                if view is None:
                    raise
                return b""
            if now == before or not still:
                return now
            before = now
            time.sleep(STILL_SECONDS)
        return before

    def views(self) -> dict[str, str]:
        """Names of the views by their ids."""
        return {str(view.view_id): str(view.name) for view in self._client.get_state().views}

    def problems(self) -> list[str]:
        """What the viewer or a view of it complains of."""
        logged = [entry.message for entry in self._client.get_logs() if entry.level in ("WARN", "ERROR")]
        reports = [one.summary for view in self._client.get_state().views for one in view.reports]
        return [*logged, *reports]

    def tabs(self) -> Iterator[str]:
        """Brings each tab to the front, one after the other; yields its name ("" where there are none)."""
        found = self._client.get_blueprint("recording").blueprint
        tabs = next(
            (
                one
                for one in found.values()
                if one.get("ContainerBlueprint", {}).get("container_kind") == "Tabs"
            ),
            None,
        )
        if tabs is None:
            yield ""
            return
        for entity in list(tabs["ContainerBlueprint"]["contents"]):
            tabs["ContainerBlueprint"]["active_tab"] = entity
            self._client.set_blueprint(found, "recording")
            yield str(found[f"/{entity}"]["ContainerBlueprint"].get("display_name", ""))


@contextmanager
def headless_viewer(width: int = 1600, height: int = 900) -> Iterator[HeadlessViewer]:
    """A viewer for the time of the block.

    Raises:
        ConfigurationError: no viewer, or nothing that it can draw with.
    """
    quiet()
    port = any_port()
    options = ["--headless", "--bind", HOST, "--port", str(port), "--window-size", f"{width}x{height}"]
    process = subprocess.Popen(
        [rerun_binary(), *options],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=dict(quiet_environment()),
    )
    try:
        url = f"rerun+http://{HOST}:{port}/proxy"
        yield HeadlessViewer(_client(process, url), url, process)
    finally:
        process.kill()
        process.wait()


def _client(process: subprocess.Popen[bytes], url: str) -> Any:
    from rerun.experimental import ViewerClient

    end = time.monotonic() + START_SECONDS
    while process.poll() is None and time.monotonic() < end:
        try:
            client = ViewerClient.connect(url)
            client.get_state()
        except (RuntimeError, ValueError, ConnectionError):
            time.sleep(0.3)
        else:
            return client
    raise ConfigurationError(
        "the viewer does not start without a screen; without a graphics card it needs a software renderer "
        "(Debian: apt-get install mesa-vulkan-drivers)"
    )
