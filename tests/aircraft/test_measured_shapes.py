"""Shapes of a ground vibration test at their stations: what an asymmetric one may show in the plane of symmetry."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from testbench.aircraft.strips.reading import _Columns, _shape
from testbench.core.errors import Faults

TAIL = dict.fromkeys(("tail_up_m", "tail_pitch_rad", "tail_side_m", "tail_roll_rad", "tail_yaw_rad"), 0.0)


def read(symmetry: str, bend: list[float], twist: list[float] | None = None, first_m: float = 0.0):
    mode = SimpleNamespace(symmetry=symmetry, csv=None, bend_m=bend, twist_rad=twist, curvature_1_m=None, **TAIL)
    content = SimpleNamespace(mode=[mode], shapes=None, stations_m=[first_m + k for k in range(len(bend))])
    faults = Faults(Path("test.toml"))
    return _shape(Path("test.toml"), content, 0, _Columns({}, {}), faults), list(faults)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_asymmetric_shape_is_zero_in_the_plane_of_symmetry_up_to_a_twentieth(sign):
    for root, bad in ((0.049, False), (0.051, True)):
        shape, faults = read("asymmetric", [sign * root, 0.01, -1.0])
        assert (shape is None) == bad
        assert [("an asymmetric shape must be 0 at y = 0" in f) for f in faults] == [True] * bad
        _, faults = read("asymmetric", [0.0, 0.5, 1.0], [sign * root * 0.1, 0.0, 0.1])
        assert len(faults) == bad
    assert read("symmetric", [sign, 0.5, 0.2])[1] == []
    assert read("asymmetric", [sign, 0.5, 0.2], first_m=0.3)[1] == []  # no station at the root


def test_a_shape_needs_stations_that_rise_and_something_that_moves():
    assert "something must move" in read("symmetric", [0.0, 0.0, 0.0])[1][0]
    assert "at least 3 stations must rise" in read("symmetric", [0.0, 1.0])[1][0]
    shape, faults = read("symmetric", [0.0, 0.5, 1.0], [0.1, 0.2, 0.3])
    assert faults == []
    assert (shape.bend_m.tolist(), shape.twist_rad.tolist()) == ([0.0, 0.5, 1.0], [0.1, 0.2, 0.3])
