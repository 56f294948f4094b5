"""The committed study of the static margin: its margins are the aircraft's, and its table holds what is said of it."""

import math

import pytest

from testbench.flight import load_aircraft
from tests.studies import static_margin


def test_the_margin_of_rigid_wings_is_that_of_the_coefficients():
    """-Cm_alpha / CL_alpha of eolo.xml, less the little that drag adds to Z_alpha: CL_alpha + CD."""
    eolo = load_aircraft("eolo")
    found = static_margin.margin(eolo.with_rigid_wings())
    assert found.flown == found.held
    expected = -100.0 * eolo.coefficient("Cm_alpha") / (eolo.coefficient("CL_alpha") + 0.045)
    assert found.held == pytest.approx(expected, rel=0.01)


def test_flexible_wings_take_most_of_the_margin_of_eolo():
    found = static_margin.margin(load_aircraft("eolo"))
    assert (round(found.held, 1), round(found.flown, 1)) == (2.6, 0.3)
    assert (round(found.M_alpha_held, 2), round(found.M_alpha_flown, 2)) == (-2.79, -0.38)


def test_a_margin_that_is_asked_for_is_the_one_that_is_flown():
    with static_margin.with_cm_alpha(static_margin.cm_alpha_for(5.0)) as folder:
        found = static_margin.margin(load_aircraft(str(folder)))
    assert found.flown == pytest.approx(5.0, abs=1e-3)


def test_the_table_holds_what_the_documents_say():
    rows = static_margin.read()
    margins = list(dict.fromkeys(float(r["flown_margin_percent"]) for r in rows))
    assert margins == [0.29, 1.0, 2.6, 5.0, 10.0]
    sure = [r for r in rows if r["surely_smaller"] == "yes"]
    assert (len(sure), len(rows)) == (27, 214)
    assert all(4 <= sum(float(r["flown_margin_percent"]) == m for r in sure) <= 7 for m in margins)

    def predicted(name, *at):
        of = [float(r["predicted"]) for r in rows if r["quantity"] == name and float(r["flown_margin_percent"]) in at
              and r["estimator"] == "best case"]  # fmt: skip
        return round(min(of), 2), round(max(of), 2)

    assert predicted("M_alpha", 0.29) == (0.87, 0.89)
    assert predicted("M_alpha", 2.6, 5.0) == (0.25, 0.37)
    assert predicted("M_de", 0.29, 1.0, 2.6) == (0.22, 0.44)
    assert predicted("M_de", 10.0) == (0.44, 0.58)
    assert predicted("Z_alpha", *margins) == (0.19, 0.34)
    found = {(float(r["flown_margin_percent"]), r["input"]) for r in sure if r["quantity"] == "M_alpha"}
    assert found == {(2.6, "3-2-1-1"), (2.6, "doublet"), (5.0, "3-2-1-1"), (5.0, "doublet"), (10.0, "doublet")}
    assert all(math.isfinite(float(r["with"])) for r in sure)
