"""Sections against printed ordinates, and files in the orders that people have."""

from __future__ import annotations

import numpy as np
import pytest

from testbench.aircraft.geometry.airfoils import airfoil, naca
from testbench.core.errors import ScenarioError

# Abbott and von Doenhoff, Theory of Wing Sections, appendix III, in per cent of the chord: x -> y of the upper side.
NACA_0012 = {1.25: 1.894, 5.0: 3.555, 10.0: 4.683, 30.0: 6.002, 60.0: 4.563, 90.0: 1.448}
NACA_2412_UPPER = {5.0: 4.13, 10.0: 5.63, 20.0: 7.26, 30.0: 7.88, 40.0: 7.80, 60.0: 6.36, 80.0: 3.75}


def test_symmetric_ordinates_are_those_printed():
    points = naca("0012")
    upper = points[: np.argmin(points[:, 0]) + 1][::-1]
    for x, y in NACA_0012.items():
        assert np.interp(x / 100.0, upper[:, 0], upper[:, 1]) == pytest.approx(y / 100.0, abs=1e-4)


def test_cambered_ordinates_are_those_printed():
    points = naca("2412")
    upper = points[: np.argmin(points[:, 0]) + 1][::-1]
    for x, y in NACA_2412_UPPER.items():
        assert np.interp(x / 100.0, upper[:, 0], upper[:, 1]) == pytest.approx(y / 100.0, abs=1e-4)


def test_mean_lines():
    x, z = airfoil("naca4408").camber
    assert np.interp(0.4, x, z) == pytest.approx(0.04, abs=2e-4)
    x, z = airfoil("NACA 23012").camber
    assert z.max() == pytest.approx(0.0184, abs=2e-4)
    assert x[np.argmax(z)] == pytest.approx(0.15, abs=0.02)


def test_files_in_three_orders_give_one_section(tmp_path):
    selig = naca("2412")
    nose = int(np.argmin(selig[:, 0]))
    upper, lower = selig[: nose + 1][::-1], selig[nose:]

    def text(rows):
        return "\n".join(f"{x:.6f} {y:.6f}" for x, y in rows)

    (tmp_path / "selig.dat").write_text("NACA 2412\n" + text(selig))
    (tmp_path / "below.dat").write_text("from below\n" + text(3.0 * selig[::-1] + [1.0, 2.0]))
    (tmp_path / "lednicer.dat").write_text(f"x\n{len(upper)}. {len(lower)}.\n\n{text(upper)}\n\n{text(lower)}\n")
    _, known = airfoil("naca2412").camber
    for name in ("selig.dat", "below.dat", "lednicer.dat"):
        _, z = airfoil(name, tmp_path).camber
        assert np.abs(z - known).max() < 3e-4, name


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("naca99999", "the middle two must be 10, 20"),
        ("naca2400", "thickness"),
        ("naca4008", "camber behind the nose"),
        ("e205", "no such file lies at"),
        ("empty.dat", "at least ten rows"),
        ("line.dat", "round the nose and back"),
    ],
)
def test_what_is_no_section_is_refused(tmp_path, name, words):
    (tmp_path / "empty.dat").write_text("E 205\n")
    (tmp_path / "line.dat").write_text("\n".join(f"{i / 20} 0.0" for i in range(20)))
    with pytest.raises(ScenarioError, match=words):
        airfoil(name, tmp_path)


def test_digits_that_are_none_are_refused():
    """An AVL file's NACA line may say anything."""
    with pytest.raises(ScenarioError, match="digits must be digits"):
        naca("24q2")
