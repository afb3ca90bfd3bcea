"""`make pictures`: the README's picture, viewer, workbench and report, drawn from a run on the simulated axis."""

from __future__ import annotations

import argparse
import io
import tempfile
from datetime import datetime
from pathlib import Path

import numpy as np
from PIL import Image

from autotune.core.axis import read_axis
from autotune.core.errors import ConfigurationError
from autotune.core.paths import config_directory
from autotune.recordings.files import read_recording
from autotune.tuning.links import open_link
from autotune.tuning.progress import Silent
from autotune.tuning.proof import fold
from autotune.tuning.run import Request, tune
from autotune.tuning.stage_prove import AFTER, BEFORE, COMMITTED, windows_of
from autotune.view.data import BeforeAfter
from autotune.view.snapshot import headless_viewer
from autotune.view.svg import before_after_svg
from bench.browser_pictures import browser_pictures

SHOWN = ("Traces", "Diagnosis", "Proof")
WIDTH = 1200


def viewer_pictures(rrd: Path, folder: Path) -> None:
    """`viewer-….png`: pages of a run as the Rerun viewer shows them; said and left where nothing can draw them."""
    try:
        with headless_viewer() as viewer:
            viewer.open(rrd)
            for tab in viewer.tabs():
                if tab in SHOWN:
                    picture = Image.open(io.BytesIO(viewer.picture())).convert("RGB")
                    small = picture.resize((WIDTH, WIDTH * picture.height // picture.width))
                    small.quantize(64).save(folder / f"viewer-{tab.lower()}.png", optimize=True)
    except ConfigurationError as reason:
        print(f"viewer's pictures left as they are: {reason}")


def main() -> None:
    """Tunes the simulated axis, and writes the pictures of that run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/pictures"))
    folder = parser.parse_args().out
    axis = read_axis(config_directory() / "axes" / "edm-vertical.toml").model_copy(
        update={"link": "sim://edm-vertical"}
    )
    with tempfile.TemporaryDirectory() as scratch:
        runs = Path(scratch)
        result = tune(Request(axis, lambda: open_link(axis, runs), runs, Silent(), datetime.now))
        recordings = result.run_directory / "recordings"
        folder.mkdir(parents=True, exist_ok=True)
        viewer_pictures(result.run_directory / "run.rrd", folder)
        browser_pictures(result.run_directory, folder)
        proof = read_recording(recordings / "proof.parquet")
        alone = read_recording(recordings / "committed.parquet")
    samples = round(1.0 / (axis.benchmark.frequency * proof.period))
    errors = {
        label: np.array(
            [fold(w["reference"] - w["position"], samples).mean(axis=0) for w in windows_of(rows, label)]
        )
        for rows, label in ((proof, BEFORE), (proof, AFTER), (alone, COMMITTED))
    }
    shown = BeforeAfter(
        np.asarray(np.arange(samples) * proof.period),
        fold(windows_of(proof, "before")[0]["reference"], samples).mean(axis=0),
        errors[BEFORE],
        errors[AFTER],
        axis.position_resolution,
        axis.motion_unit,
        after_name="while a host plays",
        committed=errors[COMMITTED],
        committed_name="in the drive",
    )
    (folder / "before-after.svg").write_text(before_after_svg(shown), encoding="utf-8")


if __name__ == "__main__":
    main()
