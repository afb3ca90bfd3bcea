"""Recordings of the standard programme on simulated axes whose truth is known."""

from functools import cache

import pytest

from autotune.identify.run import Identification, identify_run
from autotune.recordings.recording import Recording
from autotune_sim.plant import PlantParameters
from autotune_sim.presets import Preset, preset
from tests.support.identification_programme import play, varied_axis


@cache
def _played(name: str, seed: int) -> tuple[Preset, Recording]:
    axis = varied_axis(seed) if name == "varied" else preset(name)
    return axis, play(axis, seed, ("identification", "benchmark"))


@pytest.fixture(scope="session")
def varied() -> tuple[Preset, Recording]:
    """A LuGre axis with ripple, its parameters up to 30 % off the nominal ones."""
    return _played("varied", 3)


@pytest.fixture(scope="session")
def identified(varied: tuple[Preset, Recording]) -> tuple[PlantParameters, Identification]:
    """The plant of `varied` and what the whole programme tells of it."""
    return varied[0].plant, identify_run(varied[1], precision=1e-3)


@pytest.fixture(scope="session")
def vertical() -> tuple[Preset, Recording]:
    """The axis of Table 6.2, whose friction has six elastic elements."""
    return _played("edm-vertical", 1)
