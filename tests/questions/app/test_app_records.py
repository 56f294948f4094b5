"""What views show of records: the numbers that were recorded, on one clock; spectra and paths that are known."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from two_flights import OTHER, RATE_HZ, RECORD, TONE_HZ, write_results_of

from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord
from testbench.flight import load_aircraft
from testbench.questions.app.records import (
    channels_figure,
    list_records,
    motion_told,
    record_told,
    settings_told,
    shown,
    spectra_figure,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("bench")
    write_results_of(place)
    return place


def numbers(text: Any) -> np.ndarray:
    if isinstance(text, str):
        return np.frombuffer(base64.b64decode(text), "<f4")
    return text[0] + text[1] * np.arange(text[2])


def curves(figure: str, view: int = 0) -> list[list[tuple[str, np.ndarray, np.ndarray]]]:
    out = json.loads(figure)
    return [
        [(c["name"], numbers(out["x"][c["x"]]), numbers(c["y"])) for c in panel["curves"]]
        for panel in out["views"][view]["panels"]
    ]


def test_every_record_is_listed_and_none_is_read_from_elsewhere(folder):
    assert {r["path"] for r in list_records(folder)} == {RECORD, OTHER}
    assert {r["of"] for r in list_records(folder)} == {"results/first_log", "results/second"}
    for path in ("../x.nc", "/etc/passwd", "results", "results/\0.nc", None, f"{RECORD}/../../../../etc/passwd"):
        with pytest.raises(RecordError, match=r"a \.nc file in the folder of the app must be named"):
            shown(folder, path)


def test_a_record_is_told_with_its_timeline(folder):
    told = record_told(folder, {"record": RECORD})
    assert [c["name"] for c in told["channels"]] == ["de", "V", "q"]
    assert (told["rate_hz"], told["controls"], told["settings"]) == (RATE_HZ, ["de"], 2)
    assert [s["kind"] for s in told["log"]["stretches"]] == ["parked", "cruise"]
    assert record_told(folder, {"record": OTHER})["log"] == {}


def test_one_record_is_shown_as_recorded_and_broken_where_it_was_silent(folder):
    record = shown(folder, RECORD).record
    de, V = curves(channels_figure(folder, {"records": [RECORD], "channels": ["de", "V", "beta"]}))
    np.testing.assert_allclose(de[0][2], record["de"] / DEG_RAD, rtol=1e-6)
    broken = np.isnan(V[0][2])
    assert broken[600:890].all()
    assert not broken[:540].any()
    assert not broken[900:].any()
    bands = json.loads(channels_figure(folder, {"records": [RECORD], "channels": ["de"]}))["views"][0]["panels"][0]
    assert bands["bands"] == [[15.0, 20.0]]


@pytest.mark.parametrize(("align", "zero"), [("log", 0.0), ("flight", 10.0), ("manoeuvre", 15.0)])
def test_several_are_laid_over_each_other_from_a_common_zero(folder, align, zero):
    asked = {"records": [RECORD, OTHER], "channels": ["de"], "align": align}
    ((first, second),) = curves(channels_figure(folder, asked))
    np.testing.assert_array_equal(first[1], second[1])
    at = np.flatnonzero(np.isfinite(first[2]))[0]
    assert first[1][at] == pytest.approx(-zero, abs=1.0 / RATE_HZ)
    record = shown(folder, RECORD).record
    there = np.isfinite(first[2])
    np.testing.assert_allclose(
        first[2][there], np.interp(first[1][there] + zero, record.t_s, record["de"] / DEG_RAD), atol=0.02
    )
    assert np.isfinite(second[2]).any()


def test_a_tone_stands_in_the_spectrum_and_what_follows_the_control_is_coherent(folder):
    asked = {"records": [RECORD], "channels": ["de", "q"], "control": "de", "begin_s": 2.0, "end_s": 38.0}
    figure = spectra_figure(folder, asked)
    for ((_, f, density),) in curves(figure):
        assert f[np.argmax(density)] == pytest.approx(TONE_HZ, abs=0.15)
    ((name, f, coherence), (chance, _, line)) = curves(figure, 1)[0]
    assert (name, chance) == ("as recorded", "by chance, 95 %")
    assert np.nanmin(coherence) > 0.99 > np.nanmax(line)
    with pytest.raises(RecordError, match="spectra need a stretch of 64 samples"):
        spectra_figure(folder, asked | {"begin_s": 3.0, "end_s": 3.5})


def test_settings_that_differ_are_told_and_equal_ones_counted(folder):
    told = settings_told(folder, {"records": [RECORD, OTHER]})
    assert told["rows"] == [["GAIN", 2.0, None], ["SAME", 1.0, None]]
    assert settings_told(folder, {"records": [RECORD, RECORD]})["equal"] == 2


def test_a_level_turn_is_a_circle(tmp_path):
    t = np.arange(0.0, 40.0, 0.02)
    turn, V = 2.0 * np.pi / 40.0, 10.0
    data = np.stack([np.full(t.size, V), np.full(t.size, turn), 0.0 * t], axis=1)
    FlightRecord(t, ("V", "r", "theta"), data, "measured").save(tmp_path / "turn.nc")
    told = motion_told(tmp_path, {"record": "turn.nc"})
    north, east = numbers(told["north"]), numbers(told["east"])
    radius = V / turn
    np.testing.assert_allclose(np.hypot(north, east - radius), radius, rtol=1e-3)
    assert "psi from r" in told["said"]
    assert "path from speed, pitch and heading" in told["said"]


@pytest.mark.parametrize("name", ["taurus", "jsbsim:c172p"])
def test_the_aircraft_that_flew_is_drawn_from_its_own_outline(tmp_path, name):
    """Span, foremost and rearmost point of the faces are those of the three-view drawing; both sides are alike."""
    t = np.arange(0.0, 1.0, 0.1)
    made = {"suite": "x", "seed": 1, "truth": {"aircraft": name}}
    FlightRecord(t, ("phi",), np.zeros((t.size, 1)), "measured", None, made).save(tmp_path / "a.nc")
    craft = motion_told(tmp_path, {"record": "a.nc"})["craft"]
    outline = load_aircraft(name).outline
    points = np.array([p for face in craft["faces"] for p in face])
    assert craft["name"] == name.removeprefix("jsbsim:")
    assert np.ptp(points[:, 1]) == pytest.approx(craft["span_m"]) == pytest.approx(outline.wing.span_m)
    assert (points[:, 0].max(), points[:, 0].min()) == pytest.approx(outline.ends_m)
    assert -points[:, 2].min() == pytest.approx(outline.fin.z_m + outline.fin.span_m)
    sides = [sorted(map(tuple, np.round(points * (1.0, side, 1.0), 9).tolist())) for side in (1.0, -1.0)]
    assert {*sides[0]} == {*sides[1]}


def test_whose_a_flight_is_stands_beside_it_or_in_the_project_else_a_usual_one_is_drawn(tmp_path):
    t = np.arange(0.0, 1.0, 0.1)
    (tmp_path / "log").mkdir()
    FlightRecord(t, ("phi",), np.zeros((t.size, 1)), "measured").save(tmp_path / "log" / "whole.nc")

    def drawn() -> str:
        craft = motion_told(tmp_path, {"record": "log/whole.nc"})["craft"]
        assert len(craft["faces"]) > 20
        return craft["name"]

    assert drawn() == ""
    (tmp_path / "project.toml").write_text('aircraft = "eolo"\n', encoding="utf-8")
    assert drawn() == "eolo"
    (tmp_path / "log" / "mine.toml").write_text('aircraft = "taurus"\n', encoding="utf-8")
    assert drawn() == "taurus"
    (tmp_path / "log" / "mine.toml").write_text('aircraft = "nowhere"\n', encoding="utf-8")
    assert drawn() == "eolo"
