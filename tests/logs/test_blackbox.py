"""A blackbox of Betaflight and iNav is read as blackbox_decode reads it; what is damaged is left out, never wrong.

The encoder stands in for the firmware: frames I, P, S, G, H and E in the codings of iNav (blackbox_decode of iNav reads
its files to the same numbers).
"""

import struct
import sys

import numpy as np
import pytest

from testbench.core.errors import MissingPackage, RecordError
from testbench.logs.blackbox import read_blackbox
from testbench.logs.sidpac import Told
from testbench.questions.importing.ask import import_log

ONE_G, EVERY = 512, 32  # counts; frames from one I to the next
T = np.arange(0.0, 20.0, 0.004)
UNSIGNED, SIGNED, MINUS14, GROUP8, THREE, FOUR, NOTHING = 1, 0, 3, 6, 7, 8, 9
ZERO, PREVIOUS, LINE, AVERAGE, COUNT, HOME = 0, 1, 2, 3, 6, 7

# name, I encoding, P predictor, P encoding
MAIN = (
    ("loopIteration", UNSIGNED, COUNT, NOTHING), ("time", UNSIGNED, LINE, SIGNED),
    *((f"axisI[{i}]", SIGNED, PREVIOUS, THREE) for i in range(3)),
    *((f"rcCommand[{i}]", SIGNED, PREVIOUS, FOUR) for i in range(4)), ("vbat", MINUS14, PREVIOUS, MINUS14),
    *((f"gyroADC[{i}]", SIGNED, AVERAGE, SIGNED) for i in range(3)),
    *((f"accSmooth[{i}]", SIGNED, AVERAGE, SIGNED) for i in range(3)),
    *((f"attitude[{i}]", SIGNED, PREVIOUS, SIGNED) for i in range(3)), ("motor[0]", UNSIGNED, PREVIOUS, SIGNED),
    ("navPos[2]", SIGNED, PREVIOUS, SIGNED), ("BaroAlt", SIGNED, PREVIOUS, GROUP8),
    ("airSpeed", SIGNED, PREVIOUS, GROUP8),
)  # fmt: skip
GPS = (("time", UNSIGNED, 10), ("GPS_numSat", UNSIGNED, ZERO), ("GPS_coord[0]", SIGNED, HOME),
       ("GPS_coord[1]", SIGNED, HOME), ("GPS_altitude", UNSIGNED, ZERO), ("GPS_speed", UNSIGNED, ZERO))  # fmt: skip
HOME_AT = (481234567, 115678901)


def flown():
    """The columns of a flight as the firmware counts them: integers, nose down positive."""
    pitch, bank = 0.1 + 0.05 * np.sin(1.3 * T), 0.3 * np.sin(0.7 * T)
    rates = np.degrees([0.21 * np.cos(0.7 * T), -0.065 * np.cos(1.3 * T), 0.0 * T - 0.02])
    k = np.arange(T.size)
    columns = {"loopIteration": 4 * k, "time": 7_000_000 + 4000 * k + 7 * (k % 3)}
    columns |= {f"axisI[{i}]": (3 + 40 * i) * np.sin(T + i) for i in range(3)}
    columns |= {f"rcCommand[{i}]": (3.0 * 12.0**i) * np.sin(2.0 * T + i) for i in range(4)}
    columns |= {"vbat": 1200 + 30 * np.cos(T)} | {f"gyroADC[{i}]": rates[i] for i in range(3)}
    force = (0.3 * np.sin(T), 0.1 * np.cos(T), 1.0 + 0.4 * np.sin(1.3 * T) ** 2)
    columns |= {f"accSmooth[{i}]": ONE_G * force[i] for i in range(3)}
    columns |= {f"attitude[{i}]": 10.0 * np.degrees(v) for i, v in enumerate((bank, -pitch, 2.0 + 0.02 * T))}
    columns |= {"motor[0]": 1500 + 100 * np.sin(T), "navPos[2]": 12000 + 200 * np.sin(0.2 * T)}
    columns |= {"BaroAlt": 12000 + 210 * np.sin(0.2 * T), "airSpeed": 1800 + 50 * np.sin(0.3 * T)}
    return {name: np.rint(v).astype(int) for name, v in columns.items()}


def vb(x):
    out = bytearray()
    x &= 0xFFFFFFFF
    while x > 0x7F:
        out.append((x & 0x7F) | 0x80)
        x >>= 7
    return bytes([*out, x])


def svb(x):
    return vb((x << 1) ^ (x >> 31))


def three(values):
    low, high = min(values), max(values)
    a, b, c = values
    if low >= -2 and high <= 1:
        return bytes([(a & 3) << 4 | (b & 3) << 2 | (c & 3)])
    if low >= -8 and high <= 7:
        return bytes([0x40 | (a & 15), (b & 15) << 4 | (c & 15)])
    if low >= -32 and high <= 31:
        return bytes([0x80 | (a & 63), b & 63, c & 63])
    sizes = [0 if -128 <= v <= 127 else 1 if -32768 <= v <= 32767 else 3 for v in values]
    return bytes([0xC0 | sizes[0] | sizes[1] << 2 | sizes[2] << 4]) + b"".join(
        (v & 0xFFFFFFFF).to_bytes(4, "little")[: size + 1] for v, size in zip(values, sizes, strict=True)
    )


def four(values):
    """Version 2: nibbles in a row, the high one first."""
    sizes = [0 if v == 0 else 1 if -8 <= v <= 7 else 2 if -128 <= v <= 127 else 4 for v in values]
    nibbles = [(v >> (4 * k)) & 15 for v, n in zip(values, sizes, strict=True) for k in reversed(range(n))]
    nibbles += [0] * (len(nibbles) % 2)
    head = sum((3 if n == 4 else n) << (2 * i) for i, n in enumerate(sizes))
    return bytes([head, *(a << 4 | b for a, b in zip(nibbles[::2], nibbles[1::2], strict=True))])


def group8(values):
    head = sum((v != 0) << i for i, v in enumerate(values))
    return bytes([head]) + b"".join(svb(v) for v in values if v)


ALONE = {UNSIGNED: vb, SIGNED: svb, MINUS14: lambda v: vb(-v & 0x3FFF), NOTHING: lambda v: b""}
TOGETHER = {THREE: three, FOUR: four, GROUP8: group8}


def coded(values, encodings):
    out, i = b"", 0
    while i < len(values):
        kind = encodings[i]
        size = {THREE: 3, FOUR: 4}.get(kind, 1)
        if kind == GROUP8:
            size = next((n for n in range(1, 8) if encodings[i + n : i + n + 1] != [kind]), 8)
        part = values[i : i + size]
        out += TOGETHER[kind](part) if kind in TOGETHER else ALONE[kind](part[0])
        i += size
    return out


def header(craft="Möwe", gyro=1.0):
    fields = {"I name": [m[0] for m in MAIN], "I signed": [1] * len(MAIN), "I predictor": [0] * len(MAIN),
              "I encoding": [m[1] for m in MAIN], "P predictor": [m[2] for m in MAIN],
              "P encoding": [m[3] for m in MAIN],
              "G name": [g[0] for g in GPS], "G signed": [1] * 6, "G predictor": [g[2] for g in GPS],
              "G encoding": [g[1] for g in GPS], "H name": ["GPS_home[0]", "GPS_home[1]"], "H signed": [1, 1],
              "H predictor": [0, 0], "H encoding": [0, 0], "S name": ["flightModeFlags", "stateFlags"],
              "S signed": [0, 0], "S predictor": [0, 0], "S encoding": [1, 1]}  # fmt: skip
    lines = ["Product:Blackbox flight data recorder by Nicholas Sherlock", "Data version:2"]
    lines += [f"Field {key}:{','.join(map(str, values))}" for key, values in fields.items()]
    bits = struct.unpack("<I", struct.pack("<f", gyro))[0]
    lines += ["Firmware type:Cleanflight", "Firmware revision:INAV 7.1.0 (abc) MATEKF405", f"Craft name:{craft}, tail",
              f"I interval:{4 * EVERY}", "P interval:1/4", f"gyro_scale:0x{bits:08x}", f"acc_1G:{ONE_G}",
              "vbatref:1200", "minthrottle:1000", "motorOutput:1000,2000"]  # fmt: skip
    return "".join(f"H {line}\n" for line in lines).encode()


def frames(columns, n=None):
    """The bytes of each frame."""
    rows = np.column_stack([columns[m[0]] for m in MAIN])[:n].tolist()
    out, before, earlier = [], rows[0], rows[0]
    for k, row in enumerate(rows):
        start = b""
        if k == 0:
            start = b"H" + svb(HOME_AT[0]) + svb(HOME_AT[1]) + b"S" + vb(1) + vb(0) + b"E\x1e" + vb(1) + vb(0)
        if k % 50 == 10:
            fix = [0, 9, 10 * k, -7 * k, 130, 1700 + k]
            start += b"G" + coded(fix, [g[1] for g in GPS])
        if k % EVERY == 0:
            out.append(start + b"I" + coded(row, [m[1] for m in MAIN]))
            before = earlier = row
            continue
        by = {ZERO: [0] * len(row), PREVIOUS: before, COUNT: [v + 4 for v in before]}
        by[LINE] = [2 * a - b for a, b in zip(before, earlier, strict=True)]
        by[AVERAGE] = [int((a + b) / 2) for a, b in zip(before, earlier, strict=True)]
        parts = [row[i] - by[m[2]][i] for i, m in enumerate(MAIN)]
        out.append(start + b"P" + coded(parts, [m[3] for m in MAIN]))
        before, earlier = row, before
    return [*out, b"E\xffEnd of log\x00"]


def write(path, *flights):
    path.write_bytes(b"".join(flights))
    return path


def whole(n=None, **options):
    return header(**options) + b"".join(frames(flown(), n))


def table_of(columns, path):
    """The CSV of blackbox_decode --unit-acceleration g."""
    named = {
        "time": "time (us)",
        "BaroAlt": "BaroAlt (cm)",
        **{f"accSmooth[{i}]": f"accSmooth[{i}] (g)" for i in range(3)},
    }
    scaled = {n: v / ONE_G if n.startswith("acc") else v for n, v in columns.items()}
    rows = np.column_stack(list(scaled.values()))
    np.savetxt(path, rows, "%.9g", ", ", header=", ".join(named.get(n, n) for n in columns), comments="")
    return path


def test_every_field_of_every_coding_comes_back(tmp_path):
    flight = read_blackbox(write(tmp_path / "a.bbl", whole()))
    columns = flown()
    got = dict(zip(flight.table.names, flight.table.cells, strict=True))
    assert not flight.warnings
    assert flight.facts == {"firmware": "INAV 7.1.0 (abc) MATEKF405", "craft": "Möwe, tail"}
    assert flight.parameters["acc_1G"] == ONE_G
    assert set(flight.unread) == {"vbat", "axisI[0]", "axisI[1]", "axisI[2]"}
    for name, values in columns.items():
        if name not in flight.unread:
            scale = ONE_G if name.startswith("acc") else 1.0
            np.testing.assert_allclose(scale * got[name], values, atol=1e-6, err_msg=name)
    fixed = np.flatnonzero(np.isfinite(got["GPS_speed"]))
    np.testing.assert_array_equal(fixed, np.arange(10, T.size, 50))
    np.testing.assert_allclose(got["GPS_speed"][fixed], 0.01 * (1700 + fixed))
    np.testing.assert_allclose(got["GPS_coord[0]"][fixed], 1e-7 * (HOME_AT[0] + 10 * fixed))
    np.testing.assert_allclose(got["GPS_coord[1]"][fixed], 1e-7 * (HOME_AT[1] - 7 * fixed))


def test_the_log_is_the_record_that_its_table_is(tmp_path):
    """By content, whatever its name: cards call them LOG00001.TXT."""
    found = import_log(write(tmp_path / "LOG00001.TXT", whole()), rate_hz=250.0)
    same = import_log(table_of(flown(), tmp_path / "LOG00001.01.csv"), rate_hz=250.0)
    assert found.log.kind == "a recording of INAV 7.1.0 (abc) MATEKF405 (blackbox)"
    assert {*"pqr", "ax", "ay", "az", "phi", "theta", "psi", "h", "V"} == set(same.record.channels)
    assert set(found.record.channels) == {*same.record.channels, "Vg"}
    for name in same.record.channels:
        np.testing.assert_allclose(found.record[name], same.record[name], rtol=1e-6, atol=1e-7, err_msg=name)
    assert np.median(found.record["az"]) < -1.15 * 9.80665  # counts over acc_1G, not over their usual size


def test_rates_are_scaled_by_the_header(tmp_path):
    one, other = (read_blackbox(write(tmp_path / "a.bbl", whole(200, gyro=g))).table for g in (1.0, 0.0625))
    np.testing.assert_allclose(other.numbers("gyroADC[0]"), 0.0625 * one.numbers("gyroADC[0]"))


@pytest.mark.parametrize("damage", ["lost", "flipped", "cut"])
def test_nothing_wrong_comes_of_damage(tmp_path, damage):
    parts = frames(flown())
    if damage == "lost":
        del parts[1000:1003]
        content = header() + b"".join([*parts[:1000], b"\x00\x01\x02", *parts[1000:]])
    elif damage == "flipped":
        content = bytearray(header() + b"".join(parts))
        rng = np.random.default_rng(3)
        for i in rng.integers(len(header()) + 200, len(content), 40):
            content[i] ^= int(rng.integers(1, 256))
    else:
        content = header() + b"".join(parts)[:40_000]
    flight = read_blackbox(write(tmp_path / "a.bbl", bytes(content)))
    columns = flown()
    rows = {t: i for i, t in enumerate(columns["time"])}
    got = dict(zip(flight.table.names, flight.table.cells, strict=True))
    kept = np.array([rows.get(t, -1) for t in got["time"]])
    right = kept >= 0
    for name in ("gyroADC[0]", "accSmooth[2]", "attitude[1]", "airSpeed"):
        scale = ONE_G if name.startswith("acc") else 1.0
        right &= np.abs(scale * got[name] - columns[name][kept]) < 1e-6
    if damage == "lost":
        assert right.all()
        assert set(range(T.size)) - set(kept.tolist()) == set(range(999, 1024))  # what no frame follows, to the next I
        assert flight.warnings[0].startswith("1 place is damaged; 21 frames were left out")
    elif damage == "flipped":  # the format has no check sums: a byte that is as good a value is wrong to the next I
        assert right.sum() > T.size - 40 * EVERY
        assert "damaged" in flight.warnings[0]
    else:
        assert right.all()


def test_a_file_of_several_flights(tmp_path):
    idle = header() + b"E\xffEnd of log\x00"
    path = write(tmp_path / "btfl_all.bbl", idle, whole(300), whole(900), idle)
    found = read_blackbox(path)
    assert len(found.table) == 900
    assert "4 flights; number 3 is read, the longest" in found.notes[0]
    assert len(read_blackbox(path, "2").table) == 300
    with pytest.raises(RecordError, match=r"--record must be the number of a flight in .* 1 to 4, got '5'"):
        import_log(path, told=Told(part="5"))
    with pytest.raises(RecordError, match=r"flight 1 of .* must hold 4 whole frames, got 0 .* --record"):
        import_log(path, told=Told(part="1"))


def test_the_clock_of_32_bits_wraps(tmp_path):
    columns = flown()
    columns["time"] = (columns["time"] + (1 << 32) - 8_000_000) % (1 << 32)
    path = write(tmp_path / "a.bbl", header() + b"".join(frames(columns)))
    t = read_blackbox(path).table.numbers("time")
    assert t.size > T.size - EVERY
    assert np.diff(t).min() > 0.0


def test_what_cannot_be_read_says_what_to_do(tmp_path, monkeypatch):
    strange = header().replace(b"Field G encoding:1,1", b"Field G encoding:10,1")
    with pytest.raises(RecordError, match=r"coded in a way that orangebox knows, got encoding 10; .*blackbox_decode"):
        read_blackbox(write(tmp_path / "a.bbl", strange + b"".join(frames(flown(), 40))))
    monkeypatch.setitem(sys.modules, "orangebox", None)
    with pytest.raises(MissingPackage, match=r"needs orangebox, .*\[logs\].*blackbox_decode FILE"):
        import_log(write(tmp_path / "b.bbl", whole(40)))
