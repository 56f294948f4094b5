"""Messages of Paparazzi with the definitions beside them: channels in their units and signs, and clear refusals."""

from __future__ import annotations

import numpy as np
import pytest
from short_flight import DE, Q, T

from testbench.core.constants import DEG_RAD
from testbench.core.errors import RecordError
from testbench.questions.importing.ask import import_log

DEFINITIONS = """<?xml version="1.0"?>
<configuration time_of_day="1714564800.0" data_file="f.data">
 <conf><aircraft name="Glider" ac_id="7"/></conf>
 <airframe><commands><axis name="THROTTLE"/><axis name="ROLL"/><axis name="PITCH"/></commands></airframe>
 <protocol><msg_class name="datalink"><message name="ATTITUDE"><field name="x" type="float"/></message></msg_class>
 <msg_class name="telemetry">
  <message name="ATTITUDE" id="6"><field name="phi" type="float" unit="rad"/><field name="psi" type="float" unit="rad"/>
   <field name="theta" type="float" unit="rad"/></message>
  <message name="IMU_GYRO_SCALED" id="131"><field name="gp" type="int32" alt_unit="deg/s" alt_unit_coef="0.0139882"/>
   <field name="gq" type="int32" alt_unit="deg/s" alt_unit_coef="0.0139882"/>
   <field name="gr" type="int32" alt_unit="deg/s" alt_unit_coef="0.0139882"/></message>
  <message name="COMMANDS" id="102"><field name="values" type="int16[]"/></message>
  <message name="ALIVE" id="2"><field name="md5sum" type="uint8[]"/></message>
 </msg_class></protocol>
</configuration>
"""


def lines():
    out = []
    for i, t in enumerate(T):
        out.append(f"{t:.4f} 7 IMU_GYRO_SCALED 0 {round(Q[i] / 0.0139882)} 0")
        out.append(f"{t:.4f} 7 COMMANDS 4800,960,{round(-9600 * DE[i] / 25.0)}")
        if i % 2 == 0:
            out.append(f"{t:.4f} 7 ATTITUDE 0.01 1.5 {0.1 + 0.02 * np.cos(t):.6f}")
        if i % 50 == 0:
            out += [f"{t:.4f} 7 ALIVE 12,34,56", f"{t:.4f} 9 ATTITUDE 3.0 3.0 3.0"]
    return out


def write(folder, rows=None, definitions=DEFINITIONS):
    (folder / "f.data").write_text("\n".join([*(rows or lines()), ""]))
    if definitions:
        (folder / "f.log").write_text(definitions)
    return folder / "f.data"


def test_channels_in_their_units_and_signs(tmp_path):
    found = import_log(write(tmp_path))
    record = found.record
    np.testing.assert_allclose(record["q"], DEG_RAD * Q, atol=0.5 * 0.014 * DEG_RAD)  # half a step of the integers
    np.testing.assert_allclose(record["de_cmd"], DEG_RAD * DE, atol=1e-12)  # 25 deg assumed; nose up is elevator up
    np.testing.assert_allclose(record["da_cmd"], 0.1 * 25.0 * DEG_RAD, rtol=1e-12)
    np.testing.assert_allclose(record["thr_cmd"], 0.5, rtol=1e-12)
    taken = record.valid[:, record.channels.index("theta")]
    np.testing.assert_allclose(record["theta"][taken], (0.1 + 0.02 * np.cos(T))[taken], atol=1e-5)
    assert [m.controls for m in found.search.manoeuvres] == [("de_cmd",)]
    assert found.log.facts == {"commands": "throttle roll pitch", "aircraft": "Glider"}
    assert found.log.unread == {"ALIVE": 16}
    assert any("16 messages of other aircraft than number 7" in text for text in found.log.warnings)


def test_damaged_messages_are_left_out_and_said(tmp_path):
    rows = lines()
    rows[300], rows[400] = "6.0 7 IMU_GYRO_SCALED 1", "\ufffd\ufffd"
    found = import_log(write(tmp_path, rows))
    assert any("IMU_GYRO_SCALED: 1 messages are damaged" in text for text in found.log.warnings)


@pytest.mark.parametrize(
    ("definitions", "law"),
    [("", r"is a log of Paparazzi, .* put 'f\.log' beside it"), ("<a", "must be a file of message definitions"),
     ("<configuration/>", "must define the messages of 'f.data', but it defines none")],
)  # fmt: skip
def test_without_definitions_the_message_says_what_to_put_beside(definitions, law, tmp_path):
    with pytest.raises(RecordError, match=law):
        import_log(write(tmp_path, definitions=definitions))


def test_the_definitions_alone_are_no_log(tmp_path):
    write(tmp_path)
    with pytest.raises(RecordError, match=r"message definitions of a Paparazzi log; give the \.data file"):
        import_log(tmp_path / "f.log")


def test_flight_plans_with_bare_ampersands_and_modes_are_read(tmp_path):
    """Paparazzi writes the conditions of its flight plans as they are: no log with one could be read."""
    plan = '<plan><circle until="10 > a && b"/></plan></configuration>'
    mode = '<message name="PPRZ_MODE" id="11"><field name="ap_mode" type="uint8"/></message><message name="ALIVE"'
    definitions = DEFINITIONS.replace("</configuration>", plan).replace('<message name="ALIVE"', mode)
    rows = [*lines(), "0.01 7 PPRZ_MODE 0", "5.0 7 PPRZ_MODE 2"]
    found = import_log(write(tmp_path, sorted(rows, key=lambda row: float(row.split()[0])), definitions))
    assert [m.said for m in found.log.modes] == ["MANUAL (manual)", "AUTO2 (automatic)"]
