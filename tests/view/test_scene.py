"""What a live view shows, step by step: never an empty view, the last minute again on a new server."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from autotune.core.loop import ROW_FIELDS
from autotune.view import stage_pages
from autotune.view.pages import page_to_json
from autotune.view.scene import Scene
from tests.view.conftest import Sampled
from tests.view.rerun_contents import View, data_of, empty_views, views_of

LIMITS = {"velocity": (-2.0, 2.0), "temperature": (np.nan, 80.0), "error": (-0.1, 0.1)}


def rows(start: float, count: int = 1000, speed: float = 1.0, temperature: float = np.nan) -> np.ndarray:
    time = start + np.arange(count) * 1e-3
    block = np.zeros((count, len(ROW_FIELDS)))
    block[:, 0] = time
    block[:, 1] = block[:, 2] = np.sin(time)
    block[:, 3] = speed * np.cos(time)
    block[:, 4:8] = 0.3 * np.sign(np.cos(time))[:, None]
    block[:, 8] = temperature
    return block


def make_scene() -> Scene:
    return Scene("Axis test", "rad", 1e-3, LIMITS)


@contextlib.contextmanager
def file_stream(path: Path, scene: Scene) -> Iterator[Any]:
    """A stream to a file, as a new server has it."""
    import rerun as rr

    stream = rr.RecordingStream("test")
    stream.save(path, default_blueprint=scene.blueprint())
    scene.send_all(stream)
    yield stream
    stream.flush()
    stream.disconnect()


def shown(path: Path) -> set[str]:
    return {view.name for view in views_of(path)}


def test_before_the_first_sample_it_says_that_it_waits(tmp_path: Path) -> None:
    path, scene = tmp_path / "a.rrd", make_scene()
    with file_stream(path, scene):
        pass
    assert shown(path) == {"Waiting"}
    assert empty_views(path) == []


def test_no_view_is_empty_at_any_stage(tmp_path: Path, sampled: Sampled) -> None:
    path, scene = tmp_path / "a.rrd", make_scene()
    page = stage_pages.proof_page(sampled.before_after)
    notes = [
        {"kind": "labels", "base": 0, "names": ["approach"]},
        {"kind": "stage", "name": "adapt"},
        {"kind": "parameters", "values": {"stiffness": [40.0, 0.5, "N m/rad"]}},
        {"kind": "parameters", "values": {"stiffness": [41.0, None, "N m/rad"]}},
        {"kind": "page", "page": page_to_json(page)},
        {"kind": "nobody knows"},
    ]
    with file_stream(path, scene) as stream:
        for number, note in enumerate(notes):
            scene.note(stream, note)
            scene.rows(stream, rows(number))
    assert empty_views(path) == []
    assert {"Position [rad]", "Torque over velocity, last 5 s", "stiffness [N m/rad]"} <= shown(path)
    assert not any("Temperature" in name for name in shown(path))  # it has none
    again = tmp_path / "b.rrd"
    with file_stream(again, scene):
        pass
    assert empty_views(again) == []


def test_a_new_server_has_the_last_minute(tmp_path: Path) -> None:
    path, scene = tmp_path / "a.rrd", make_scene()
    with file_stream(path, scene) as stream:
        for second in range(90):
            scene.rows(stream, rows(second))
    again = tmp_path / "b.rrd"
    with file_stream(again, scene):
        pass
    error = data_of(again)["/traces/error"]["Scalars:scalars"]
    assert 60_000 <= sum(value is not None for value in error) <= 61_000


def test_what_the_axis_begins_to_tell_and_limits_that_come_near_are_shown_then(tmp_path: Path) -> None:
    path, scene = tmp_path / "a.rrd", make_scene()
    with file_stream(path, scene) as stream:
        scene.rows(stream, rows(0, speed=0.01))
        assert "Velocity [rad/s], limits −2 to 2" in names_of(scene)
        scene.rows(stream, rows(1, speed=2.0, temperature=31.0))
        assert {"Velocity [rad/s], red: limits", "Temperature [°C], red: limits"} <= names_of(scene)
    assert "Tracking error [mrad], limits −100 to 100" in names_of(scene)


def test_the_plane_grows_with_the_motion_and_old_points_go(tmp_path: Path) -> None:
    path, scene = tmp_path / "a.rrd", make_scene()
    with file_stream(path, scene) as stream:
        scene.rows(stream, np.zeros((10, len(ROW_FIELDS))))
        assert "Torque over velocity, last 5 s" not in names_of(scene)
        scene.rows(stream, rows(0, speed=0.01))
        scene.rows(stream, rows(1, speed=8.0))
    planes = [view.origin for view in views_of(path) if view.kind == "2D"]
    assert planes == [*dict.fromkeys(planes)]
    assert set(planes) == {"/plane/1", "/plane/2"}


def names_of(scene: Scene) -> set[str]:
    """Titles of the plots at present."""
    plane = {scene._plane.title} if scene._plane is not None else set()
    return {plot.title for plot in scene._shown} | plane


@pytest.mark.parametrize("width", [len(ROW_FIELDS), 20])
def test_rows_may_have_more_columns(tmp_path: Path, width: int) -> None:
    path, scene = tmp_path / "a.rrd", make_scene()
    wide = np.zeros((1000, width))
    wide[:, : len(ROW_FIELDS)] = rows(0)
    with file_stream(path, scene) as stream:
        scene.rows(stream, wide)
    assert empty_views(path) == []
    assert all(isinstance(view, View) for view in views_of(path))
