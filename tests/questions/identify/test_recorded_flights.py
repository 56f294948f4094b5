"""The descriptions in scenarios/records on the real flights: what is read, its signs, and the modes found in it.

The data are not part of the project. Where they are absent the tests are skipped, saying what is missing.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from testbench.core.channels import CONTROLS
from testbench.core.constants import DEG_RAD, FT_M, G0_M_S2
from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord
from testbench.estimators import estimate
from testbench.estimators.prepare import prepare
from testbench.estimators.settings import DsrE
from testbench.estimators.subspace import dsr_e
from testbench.logs.layout import ENVIRONMENT
from testbench.logs.read import read_records
from testbench.logs.tables import read_table
from testbench.questions.identify.scenario import RecordDescription

FOLDER = Path(os.environ.get(ENVIRONMENT) or Path(__file__).resolve().parents[4] / "shared" / "flight_data")


def need(*files: str) -> list[Path]:
    absent = [file for file in files if not (FOLDER / file).is_file()]
    if absent:
        pytest.skip(
            f"recorded flights are missing: {', '.join(absent)} in '{FOLDER}'; set {ENVIRONMENT} to their folder"
        )
    return [FOLDER / file for file in files]


def raw(file: str, variable: str) -> np.ndarray:
    from scipy.io import loadmat

    return loadmat(need(file)[0])[variable]


def records(name: str) -> dict[str, tuple[str, FlightRecord]]:
    description = RecordDescription.load(name)
    need(*(record.file for record in description.record))
    return {part: (use, record) for part, use, record in read_records(description, FOLDER)}


def modes(
    name: str, used: list[FlightRecord], past: int | None = None, future: int | None = None, filtered: bool = True
) -> np.ndarray:
    """Return (frequency rad/s, damping ratio) of the oscillatory poles that DSR_e finds as the description sets it."""
    description = RecordDescription.load(name)
    settings = next(e for e in description.identification.estimators if e.method == "dsr_e")
    preparation = description.preparation
    lowpass = preparation.lowpass_hz if filtered else None
    model = dsr_e.estimate(
        [prepare(record, bias=preparation.bias, trim_s=description.trim_s, lowpass_hz=lowpass) for record in used],
        description.identification.inputs,
        description.outputs,
        DsrE(
            order=settings.order,
            past_horizon=past or settings.past_horizon,
            future_horizon=future or settings.future_horizon,
        ),
    )
    poles = np.concatenate(list(model.poles().values()))
    poles = poles[poles.imag > 0.0]
    return np.array(sorted((abs(pole), -pole.real / abs(pole)) for pole in poles))[::-1]


def derivatives(record: FlightRecord, output: str, regressors: list[str]) -> dict[str, float]:
    """Fit ``output`` = sum of coefficient x regressor + constant by least squares (equation error)."""
    matrix = np.column_stack([record.columns(regressors), np.ones(len(record))])
    return dict(zip(regressors, np.linalg.lstsq(matrix, record[output], rcond=None)[0], strict=False))


def test_attas_is_read_in_si_units():
    found = records("attas_short_period")
    assert [(name, use) for name, (use, _) in found.items()] == [("Elv1", "identification"), ("Elv2", "validation")]
    for name, (_, record) in found.items():
        source = raw(f"attas/fAttas{name}.mat", f"fAttas{name}")
        assert np.array_equal(record.t_s, source[:, 0])
        assert np.allclose(record.data, source[:, [21, 12, 7]] * DEG_RAD, rtol=1e-15)  # one rounding
        assert record.dt_s == pytest.approx(0.04, rel=1e-9)
        assert record.valid.all()
        assert record.kind == "measured"


@pytest.mark.parametrize("filtered", [True, False], ids=["filtered", "as_recorded"])
@pytest.mark.parametrize(("past", "future"), [(None, None), (20, 10), (40, 30)])
def test_attas_short_period_agrees_with_the_printed_one(past, future, filtered):
    reference = RecordDescription.load("attas_short_period").reference_values
    found = [record for _, record in records("attas_short_period").values()]
    [(frequency, damping)] = modes("attas_short_period", found, past, future, filtered)
    # Measured over horizons of 5 to 40 and 5 to 30 samples: 2.42 to 2.52 rad/s and 0.48 to 0.49, as recorded 2.50 to
    # 2.55 rad/s and 0.487 to 0.494.
    assert frequency == pytest.approx(reference["wn_rad_s"], rel=0.05)
    assert damping == pytest.approx(reference["zeta"], abs=0.08)


def test_attas_records_agree_with_each_other():
    first, second = (modes("attas_short_period", [record])[0] for _, record in records("attas_short_period").values())
    assert first[0] == pytest.approx(second[0], rel=0.05)  # measured: 2.477 and 2.478 rad/s
    assert first[1] == pytest.approx(second[1], abs=0.05)  # measured: 0.467 and 0.496


@pytest.mark.parametrize("identified_on", ["Elv1", "Elv2"])
def test_attas_models_predict_the_record_that_they_never_saw(identified_on):
    description = RecordDescription.load("attas_short_period")
    parts = {
        name: prepare(record, bias="mean", trim_s=0.0, lowpass_hz=description.preparation.lowpass_hz)
        for name, (_, record) in records("attas_short_period").items()
    }
    fit = parts.pop(identified_on)
    [judge] = parts.values()
    for spec in description.identification.estimators:
        model = estimate(spec, [fit], description.identification.inputs, description.outputs, [judge])
        y = judge.columns(description.outputs)
        error = np.linalg.norm(y - model.simulate(judge), axis=0) / np.linalg.norm(y, axis=0)
        assert np.all(error < 0.2), spec.method  # measured: at most 0.11; a model of nothing gives 1


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "d.toml"
    head = 'title = "t"\nsource = "s"\nrights = "r"\n[time]\ncolumn = 1\n'
    tail = '[[identification.estimators]]\nmethod = "dsr_e"\npast_horizon = 5\nfuture_horizon = 5\n'
    path.write_text(head + text + tail, encoding="utf-8")
    return path


def channels(**columns: tuple[int, str] | tuple[int, str, str]) -> str:
    return "".join(
        f'[[channel]]\nname = "{name}"\ncolumn = {column}\nunit = "{unit}"\n{"".join(rest)}\n'
        for name, (column, unit, *rest) in columns.items()
    )


def test_attas_elevator_has_the_sign_of_the_channel_table(tmp_path):
    files = need("attas/fAttasElv1.mat", "attas/fAttasElv2.mat")
    text = "".join(f'[[record]]\nname = "{f.stem}"\nfile = "attas/{f.name}"\nuse = "split"\n' for f in files)
    text += channels(de=(22, "deg"), alpha=(13, "deg"), q=(8, "deg/s"), qdot=(18, "deg/s2"))
    text += '[identification]\ninputs = ["de"]\n'
    for _, _, record in read_records(RecordDescription.load(write(tmp_path, text)), FOLDER):
        fit = derivatives(record, "qdot", ["alpha", "q", "de"])
        # Printed (output error, both records): -4.9265, -2.0057, -7.2081; by equation error within 10 %.
        assert fit["de"] == pytest.approx(-7.2081, rel=0.1)
        assert fit["alpha"] == pytest.approx(-4.9265, rel=0.1)
        assert fit["q"] == pytest.approx(-2.0057, rel=0.1)


AILERON_RUDDER = (
    channels(
        da=(28, "deg", "minus_column = 29\nscale = 0.5"),  # the source's da has the other sign
        dr=(30, "deg"),
        beta=(14, "deg"),
        p=(7, "deg/s"),
        r=(9, "deg/s"),
        pdot=(17, "deg/s2"),
        rdot=(19, "deg/s2"),
    )
    + '[identification]\ninputs = ["da", "dr", "beta"]\noutputs = ["p", "r"]\n'
)


def test_attas_glued_records_say_how_to_cut_them(tmp_path):
    need("attas/fAttasAilRud1.mat")
    text = '[[record]]\nname = "lateral"\nfile = "attas/fAttasAilRud1.mat"\nuse = "split"\n' + AILERON_RUDDER
    with pytest.raises(RecordError, match=r"gap from t = 80\.08 to 110\.16 s in .*row 752") as error:
        read_records(RecordDescription.load(write(tmp_path, text)), FOLDER)
    advice = "segments = [[50.08, 80.08], [110.16, 140.16]]"
    assert advice in str(error.value)
    cut = text.replace('use = "split"\n', f'use = "split"\n{advice}\n')
    found = read_records(RecordDescription.load(write(tmp_path, cut)), FOLDER)
    assert [(name, len(record)) for name, _, record in found] == [("lateral_1", 751), ("lateral_2", 751)]
    assert all(record.dt_s == pytest.approx(0.04, rel=1e-6) for _, _, record in found)


def test_attas_aileron_and_rudder_have_the_signs_of_the_channel_table(tmp_path):
    files = need("attas/fAttasAilRud1.mat")
    advice = "segments = [[50.08, 80.08], [110.16, 140.16]]"
    text = f'[[record]]\nname = "l"\nfile = "attas/{files[0].name}"\nuse = "split"\n{advice}\n' + AILERON_RUDDER
    parts = [record for _, _, record in read_records(RecordDescription.load(write(tmp_path, text)), FOLDER)]
    whole = FlightRecord(
        np.concatenate([part.t_s for part in parts]),
        parts[0].channels,
        np.vstack([part.data for part in parts]),
        "measured",
    )
    roll = derivatives(whole, "pdot", ["p", "r", "da", "dr", "beta"])
    yaw = derivatives(whole, "rdot", ["p", "r", "da", "dr", "beta"])
    # Printed (output error, two such records): L_da 6.3059 (sign as here), L_p -2.0675, N_dr -1.7609, N_beta 3.0314.
    assert roll["da"] == pytest.approx(6.3059, rel=0.1)
    assert roll["p"] == pytest.approx(-2.0675, rel=0.1)
    assert yaw["dr"] == pytest.approx(-1.7609, rel=0.1)
    assert yaw["beta"] == pytest.approx(3.0314, rel=0.1)


def test_hfb_is_the_same_with_and_without_its_header():
    [with_header, plain] = need("hfb320/hfb320_1_10_withHeader.asc", "hfb320/hfb320_1_10.asc")
    table, bare = read_table(with_header, "text"), read_table(plain, "text")
    assert table.names[:4] == ("T", "DELV", "PDYN", "THRUST")
    assert table.units[:4] == ("S", "RAD", "PA", "N")
    assert bare.names == ("",) * 20
    assert len(table) == len(bare) == 601
    source = np.loadtxt(plain)
    for number, name in enumerate(table.names, start=1):
        assert np.array_equal(table.numbers(name), source[:, number - 1])
        assert np.array_equal(bare.numbers(number), source[:, number - 1])


def test_hfb_elevator_has_the_sign_of_the_channel_table_and_its_modes_lie_near_the_filter_error_ones():
    [(use, record)] = records("hfb320_longitudinal").values()
    assert use == "split"
    assert np.array_equal(record["V"], np.loadtxt(need("hfb320/hfb320_1_10.asc")[0])[:, 4])
    rate = record.with_columns({"qdot": np.gradient(record["q"], record.t_s)})
    # Cm_de S cbar qbar / Iyy = -5.8 1/s2 at the mean dynamic pressure; differences at 10 Hz smooth the steps: 25 %.
    assert derivatives(rate, "qdot", ["alpha", "q", "de"])["de"] == pytest.approx(-5.8, rel=0.25)
    reference = RecordDescription.load("hfb320_longitudinal").reference_values
    short, phugoid = modes("hfb320_longitudinal", [record])
    # Turbulence is not modelled: the printed output error, which does not either, is off by 0.11 rad/s and 0.10.
    assert short[0] == pytest.approx(reference["wn_rad_s"], rel=0.05)  # measured 2.262
    assert short[1] == pytest.approx(reference["zeta"], abs=0.12)  # measured 0.429
    assert phugoid[0] == pytest.approx(reference["wn_phugoid_rad_s"], rel=0.1)  # measured 0.123


def test_twin_otter_is_read_in_si_units_and_its_short_period_agrees_with_the_published_one():
    [(_, record)] = records("twin_otter_longitudinal").values()
    source = raw("twin_otter/totter_lon_020213f1_018.mat", "fdata")
    assert np.allclose(record["V"], source[:, 1] * FT_M, rtol=1e-15)
    assert np.allclose(record["az"], source[:, 12] * G0_M_S2, rtol=1e-15)
    assert record.t_s[0] == 0.0
    assert record.dt_s == pytest.approx(0.02, rel=1e-6)
    rate = record.with_columns({"qdot": source[:, 42] * DEG_RAD})
    # Cm_de qbar S cbar / Iyy = -11.7 1/s2 with the printed -1.869 +- 0.020 and the record's mean dynamic pressure.
    assert derivatives(rate, "qdot", ["alpha", "q", "de"])["de"] == pytest.approx(-11.7, rel=0.05)
    reference = RecordDescription.load("twin_otter_longitudinal").reference_values
    [(frequency, damping)] = modes("twin_otter_longitudinal", [record])
    assert frequency == pytest.approx(reference["wn_rad_s"], rel=0.05)  # measured 4.02
    assert damping == pytest.approx(reference["zeta"], abs=0.08)  # measured 0.63


@pytest.mark.parametrize("name", ["hfb320_longitudinal", "twin_otter_longitudinal"])
def test_the_part_left_to_judge_by_holds_motion_and_is_predicted(name):
    description = RecordDescription.load(name)
    [(use, record)] = records(name).values()
    assert use == "split"
    prepared = prepare(record, bias=description.preparation.bias, trim_s=description.trim_s)
    fit, judge = prepared.split(description.preparation.identification_fraction)
    assert np.ptp(judge["de"]) > 0.3 * np.ptp(fit["de"])
    model = estimate(description.identification.estimators[0], [fit], ("de",), description.outputs)
    y = judge.columns(description.outputs)
    fit_percent = 100.0 * (1.0 - np.std(y - model.simulate(judge), axis=0) / np.std(y, axis=0))
    assert np.all(fit_percent > 50.0)  # measured: 65 to 93 %; a model of nothing gives 0


@pytest.mark.parametrize("name", ["attas_short_period", "hfb320_longitudinal", "twin_otter_longitudinal"])
def test_every_file_format_gives_a_real_record_back(name, tmp_path):
    for part, (_, record) in records(name).items():
        for save, suffix in ((record.save, ".nc"), (record.save_csv, ".csv"), (record.save_mat, ".mat")):
            stored = read_table(
                save(tmp_path / (part + suffix)), {".nc": "netcdf", ".csv": "csv", ".mat": "mat"}[suffix]
            )
            assert np.array_equal(stored.numbers("t"), record.t_s)
            for channel in record.channels:
                assert np.array_equal(stored.numbers(channel), record[channel])


def test_f16_file_with_quotes_and_a_column_that_is_empty_but_for_one_cell():
    table = read_table(need("f16_gvt/F16Data_FullMSine_Level1.csv")[0], "csv")
    assert table.names == ("Force", "Voltage", "Acceleration1", "Acceleration2", "Acceleration3", "Fs")
    assert len(table) == 9 * 8192
    rate = table.numbers("Fs")
    assert rate[0] == 400.0
    assert np.isnan(rate[1:]).all()
    force = table.numbers("Force").reshape(9, 8192)
    assert np.isfinite(force).all()
    # The input is periodic: periods differ by 0.5 % of its rms, and would by 141 % if a row were lost.
    assert np.std(force[8] - force[1]) < 0.02 * np.std(force)


def test_the_controls_described_are_controls():
    for name in ("attas_short_period", "hfb320_longitudinal", "twin_otter_longitudinal"):
        assert set(RecordDescription.load(name).identification.inputs) <= set(CONTROLS)
