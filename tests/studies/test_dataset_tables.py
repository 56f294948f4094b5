"""The committed scores of the packaged data sets: they agree with the blind test, and with what the guide says."""

from pathlib import Path

from tables import read_rows

RESULTS = Path(__file__).resolve().parents[2] / "results"


def table(name):
    return read_rows(RESULTS / name)


def test_the_workflow_is_scored_as_in_the_blind_test():
    rates = {r["rate"]: (r["count"], r["of"]) for r in table("gap/rates.csv") if r["manoeuvres"] == "six"}
    found = {r["stratum"]: r for r in table("dataset/naming.csv") if r["method"] == "workflow"}
    for stratum in ("library form", "other form", "turbulence"):
        row = found[stratum]
        assert (row["right"], row["cases"]) == rates[f"{stratum}: right name"]
        assert (row["wrong"], row["cases"]) == rates[f"{stratum}: wrong name"]
    assert (found["two at once"]["right"], "30") == rates["two at once: both found"]


def test_every_method_answered_every_stratum_and_level():
    names = table("dataset/naming.csv")
    assert {r["method"] for r in names} == {"neural classifier", "workflow"}
    assert all(r["answered"] == r["cases"] for r in names)
    figures = table("dataset/identification.csv")
    assert {(r["method"], r["level"]) for r in figures} == {
        (m, v) for m in ("stepwise regression", "output error") for v in ("clean", "sensed", "turbulent", "flexible")
    }


def test_clean_flights_give_their_labels_back():
    """Labels and flights belong together: without noise, output error comes within 1.2 % of the truth in the median."""
    clean = [r for r in table("dataset/identification.csv") if (r["method"], r["level"]) == ("output error", "clean")]
    assert len(clean) == 3
    assert max(float(r["median error, %"]) for r in clean) < 1.2
