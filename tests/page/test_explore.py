"""Figures as numbers: what the page holds is what was given, peaks are kept, and texts stay texts."""

import base64
import json

import numpy as np
import pytest

from testbench.page.draw import small_svg
from testbench.page.explore import MOST_VALUES, View, peaks_kept, to_json
from testbench.page.figure import Curve, Panel, Rule

pytestmark = pytest.mark.drawn


def read(views: list[View]) -> dict:
    out = json.loads(to_json(views))
    clocks = [numbers(x) if isinstance(x, str) else x[0] + x[1] * np.arange(x[2]) for x in out["x"]]
    for view in out["views"]:
        for panel in view["panels"]:
            for curve in panel["curves"]:
                curve["x"], curve["y"] = clocks[curve["x"]], numbers(curve["y"])
    return out


def numbers(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), "<f4")


def one(x: np.ndarray, y: np.ndarray, *more, **panel) -> dict:
    draws = [Curve(name="a", x=x, y=y), *more]
    (view,) = read([View(name="v", panels=[Panel(y="p", x="t, s", draws=draws, **panel)])])["views"]
    return view["panels"][0]


def test_a_short_curve_is_read_back_as_it_was_given():
    rng = np.random.default_rng(1)
    for x in (np.arange(500) * 0.02, np.sort(rng.uniform(0.0, 9.0, 500))):
        y = rng.standard_normal(500)
        found = one(x, y)["curves"][0]
        np.testing.assert_allclose(found["x"], x, rtol=1e-6, atol=1e-6)
        np.testing.assert_array_equal(found["y"], y.astype(np.float32))


def test_a_long_curve_keeps_every_peak_where_it_was():
    t = np.arange(600_000) * 0.01
    y = np.sin(t)
    peaks = [1234, 77_777, 599_998]
    y[peaks] = [50.0, -60.0, 70.0]
    panel = one(t, y)
    found = panel["curves"][0]
    assert found["y"].size <= MOST_VALUES + panel["stretch"]
    for k in peaks:
        at = int(np.argmin(np.abs(found["y"] - y[k])))
        assert found["y"][at] == y[k]
        assert abs(found["x"][at] - t[k]) <= panel["stretch"] * 0.01


def test_curves_over_one_clock_keep_one_clock():
    t, rng = np.arange(10_000) * 0.01, np.random.default_rng(2)
    (a, _), (b, _) = (peaks_kept(t, rng.standard_normal(t.size), 800) for _ in range(2))
    np.testing.assert_array_equal(a, b)
    assert np.all(np.diff(a) > 0.0)


def test_what_is_not_finite_is_a_gap_and_no_logarithm_takes_what_has_none():
    t = np.arange(9.0)
    y = np.array([1.0, np.nan, np.inf, -np.inf, 1e300, -2.0, 0.0, 3.0, 4.0])
    assert np.isnan(one(t, y)["curves"][0]["y"]).tolist() == [False, True, True, True, True] + [False] * 4
    found = one(t, y, log_x=True, log_y=True)["curves"][0]
    assert found["x"].tolist() == t[1:].tolist()
    assert np.nanmin(found["y"]) == 3.0
    lost = np.full(3000, np.nan)
    assert np.isnan(peaks_kept(np.arange(3000.0), lost, 100)[1]).all()


def test_marks_and_limits_without_a_number_are_left_out():
    marks = [Rule(at=np.inf, text="never"), Rule(at=1.0, text="once")]
    panel = one(np.arange(3.0), np.ones(3), *marks, y_range=(np.nan, 1.0))
    assert "limits" not in panel
    assert panel["marks"] == [[1.0, "once"]]


@pytest.mark.parametrize("path", ["M 0 0 \nL 10.126 5 \nL 10.133 -5.5 \nz\n", "M 1 1 \nQ 2 3 4.25 5 \nL 6 7 \n"])
def test_a_small_path_ends_where_the_long_one_does(path):
    small = small_svg(f'<svg><path d="{path}" style="fill: none"/></svg>')
    assert 'style="fill:none"' in small
    assert absolute(small.split('d="')[1].split('"')[0]) == pytest.approx(last_of(path), abs=0.006)


def test_a_long_line_gathers_no_error():
    rng = np.random.default_rng(3)
    points = np.cumsum(rng.uniform(-0.07, 0.08, (4000, 2)), axis=0)
    path = "M " + " \nL ".join(f"{x:.6f} {y:.6f}" for x, y in points)
    small = small_svg(f'<svg><path d="{path}"/></svg>')
    assert len(small) < 0.45 * len(path)
    assert absolute(small.split('d="')[1].split('"')[0]) == pytest.approx(points[-1].tolist(), abs=0.051)


def last_of(path: str) -> list[float]:
    return [float(v) for v in path.replace("z", "").split()[-2:]]


def absolute(path: str) -> list[float]:
    import re

    place, command = np.zeros(2), ""
    for letter, rest in re.findall(r"([mlqcz])([^mlqcz]*)", path):
        command = letter
        values = [float(v) for v in re.findall(r"-?(?:\d+\.?\d*|\.\d+)", rest)]
        size = {"m": 2, "l": 2, "q": 4, "c": 6, "z": 1}[command]
        for k in range(0, len(values), size):
            place = place + values[k + size - 2 : k + size]
    return place.tolist()
