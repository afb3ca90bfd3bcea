"""The picture without a browser: well-formed, inside its frame, and true."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest

from autotune.view.data import BeforeAfter
from autotune.view.svg import HEIGHT, WIDTH, before_after_svg

NAMESPACE = "{http://www.w3.org/2000/svg}"


def parsed(text: str) -> ElementTree.Element:
    return ElementTree.fromstring(text)


def coordinates(root: ElementTree.Element) -> np.ndarray:
    shapes = [*root.iter(f"{NAMESPACE}polyline"), *root.iter(f"{NAMESPACE}polygon")]
    return np.array(
        [[float(n) for n in pair.split(",")] for s in shapes for pair in s.attrib["points"].split()]
    )


def test_picture_is_well_formed_and_inside_its_frame(sampled) -> None:
    root = parsed(before_after_svg(sampled.before_after, "Axis <1> & more"))
    points = coordinates(root)
    assert points.min() >= 0
    assert points[:, 0].max() <= WIDTH
    assert points[:, 1].max() <= HEIGHT
    assert len(list(root.iter(f"{NAMESPACE}polyline"))) == 3
    assert len(list(root.iter(f"{NAMESPACE}polygon"))) == 2


def test_picture_names_peaks_and_count(sampled) -> None:
    text = before_after_svg(sampled.before_after)
    assert re.search(r"before: peak 2\.0\d mrad", text)
    assert re.search(r"after: peak 0\.[45]\d+ mrad", text)
    assert "± one encoder count (126 µrad)" in text
    assert len(text) < 100_000
    assert "http" not in text.replace("http://www.w3.org/2000/svg", "")


def test_peak_is_drawn_where_it_is(sampled) -> None:
    root = parsed(before_after_svg(sampled.before_after))
    before = list(root.iter(f"{NAMESPACE}polyline"))[1]
    points = np.array([[float(n) for n in pair.split(",")] for pair in before.attrib["points"].split()])
    time = sampled.before_after.time[np.argmax(sampled.before_after.before.mean(axis=0))]
    x = points[np.argmin(points[:, 1]), 0]
    # the panel is 720 pixels wide for 0.999 s; a pixel is 1.4 ms
    assert (x - 78) / 720 * 0.999 == pytest.approx(time, abs=0.004)


def test_flat_and_single_data(sampled) -> None:
    flat = BeforeAfter(np.arange(10.0), np.zeros(10), np.zeros(10), np.zeros((1, 10)))
    root = parsed(before_after_svg(flat))
    assert np.isfinite(coordinates(root)).all()
    one = replace(sampled.before_after, resolution=None, motion_unit="m")
    assert "encoder" not in before_after_svg(one)
    assert "[mm]" in before_after_svg(one)
