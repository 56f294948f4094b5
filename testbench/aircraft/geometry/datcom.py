"""Reader of Digital DATCOM's files (AFFDL-TR-79-3032): the input, for005, and the output, for006, which repeats it.

The input is cards of namelists, ``$WGPLNF CHRDR=7.29, ...$``, lengths in ft unless a card DIM says otherwise, x aft and
z up. It says wing, tail, fin, body, references, the flap on the aftmost surface and where the moments are taken. DATCOM
has no rudder, mass or motor. The output adds tables of derivatives, which stand beside those that are computed here.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from testbench.core.constants import DEG_RAD, FT_M, G0_M_S2, LBF_N
from testbench.core.door import read_text
from testbench.core.errors import ScenarioError
from testbench.core.record import FloatArray

SUFFIXES = (".dcm", ".dat", ".inp", ".out")
_UNITS = {"FT": FT_M, "IN": FT_M / 12.0, "M": 1.0, "CM": 0.01}
_NAMELIST = re.compile(r"\$\s*([A-Z]+)\s(.*?)\$", re.DOTALL)
_ITEM = re.compile(
    r"([A-Z][A-Z0-9]*)\s*(?:\(\s*\d+\s*\))?\s*=\s*([^=]*?)\s*(?=,\s*[A-Z][A-Z0-9]*\s*(?:\(\s*\d+\s*\))?\s*=|,?\s*$)"
)
_FOIL = re.compile(r"^\s*NACA[-\s]+([WHV])[-\s]+(\S)[-\s]+(\S+)", re.MULTILINE)
_SECTIONS = {"W": "wing", "H": "tail", "V": "fin"}
_PLANFORMS = {"WGPLNF": "wing", "HTPLNF": "tail", "VTPLNF": "fin"}
_LEFT_OUT = {"VFPLNF": "a second fin", "TVTPAN": "twin fins", "JETPWR": "jets", "PROPWR": "propellers",
             "LARWB": "a body that lifts", "TRNJET": "a control jet", "CONTAB": "tabs"}  # fmt: skip
_SOUND_M_S, _LAPSE = 340.294, 2.25577e-5  # at sea level; temperature's share a metre up to 11 km
_PLAIN_AILERONS = 4.0  # STYPE
_STATIC = {"CLA": "CL_alpha", "CMA": "Cm_alpha", "CYB": "CY_beta", "CNB": "Cn_beta", "CLB": "Cl_beta"}
_DYNAMIC = {"CLQ": "CL_q", "CMQ": "Cm_q", "CLAD": "CL_alphadot", "CMAD": "Cm_alphadot", "CLP": "Cl_p", "CYP": "CY_p",
            "CNP": "Cn_p", "CNR": "Cn_r", "CLR": "Cl_r"}  # fmt: skip
_ROW = re.compile(r"\s+-?\d*\.\d+(\s|$)")


@dataclass(frozen=True)
class Derivatives:
    """Derivatives that the output of DATCOM tables, per rad, over alpha: of the largest configuration in it."""

    CL: FloatArray  # (n,) lift coefficient, rising, up to its greatest
    # derivative -> (n,) values at these, NaN where none is printed
    values: Mapping[str, FloatArray] = field(default_factory=dict)

    def at(self, CL: float) -> dict[str, float]:
        """Return derivative -> its value at a lift coefficient within the table."""
        out = {name: float(np.interp(CL, self.CL, v, np.nan, np.nan)) for name, v in self.values.items()}
        return {name: v for name, v in out.items() if math.isfinite(v)}


def is_datcom(path: Path) -> bool:
    """Say whether a file is named as one of DATCOM."""
    return path.suffix.lower() in SUFFIXES or path.name.lower() in ("for005", "for006")


def read_datcom(path: Path) -> tuple[dict[str, Any], Derivatives | None, tuple[str, ...]]:
    """Return what geometry.toml would say, the derivatives if the file is an output, and what was left out, in words.

    Raises:
        RecordError: the file cannot be read.
        ScenarioError: it is none of DATCOM, or holds what cannot be carried over; names namelist and variable.
    """
    text = read_text(path, "geometry", "utf-8", "replace").upper()
    output = "INPUT DATA CARDS" in text
    cards = text
    if output:  # the cards come twice, each case's again before its tables
        cards = re.split(
            r"^1", text.partition("INPUT DATA CARDS")[2].partition("\n")[2], maxsplit=1, flags=re.MULTILINE
        )[0]
    lines = [line.partition("!")[0] for line in cards.splitlines() if not line.lstrip().startswith("*")]
    given, de, da = _namelists(path, "\n".join(lines))
    if "WGPLNF" not in given:
        raise ScenarioError(
            f"{path} must be an input of Digital DATCOM or its output ($WGPLNF ...$), got "
            f"{', '.join(given) or 'neither'}"
        )
    dim = next((u for u in _UNITS if re.search(rf"^\s*DIM\s+{u}\s*$", "\n".join(lines), re.MULTILINE)), "FT")
    unit = _UNITS[dim] * _one(given.get("SYNTHS", {}), "SCALE", 1.0)
    out = _plan(path, given, unit, dict(_foils("\n".join(lines))))
    if weight := _one(given.get("FLTCON", {}), "WT", 0.0):
        out["mass"]["mass_kg"] = weight * (LBF_N if dim in ("FT", "IN") else 1.0) / G0_M_S2
    tail = "tail" in out
    control = {}
    if de is not None:
        control["de"] = _flap(path, "SYMFLP", de, given["HTPLNF" if tail else "WGPLNF"]) | {
            "surface": "tail" if tail else "wing"
        }
    elif tail and "HINAX" in given.get("SYNTHS", {}):
        control["de"] = {"surface": "tail", "chord_fraction": 1.0}
    if da is not None:
        control["da"] = _flap(path, "ASYFLP", da, given["WGPLNF"]) | {"surface": "wing"}
    title = re.search(r"^\s*CASEID\s+(?:TOTAL:\s*)?(.+?)\s*$", "\n".join(lines), re.MULTILINE)
    out |= {"control": control, "title": title[1].title() if title else path.stem}
    left = [f"{words} (${name}) is left out" for name, words in _LEFT_OUT.items() if name in given]
    return out, _tables(text) if output else None, tuple(left)


def _namelists(path: Path, cards: str) -> tuple[dict[str, Any], dict[str, Any] | None, dict[str, Any] | None]:
    """Return the namelists of all cases, the first of each name, then the flap of the elevator, and of the ailerons.

    A symmetrical flap moves the aftmost surface that its case has.
    """
    given: dict[str, dict[str, list[float]]] = {}
    held: set[str] = set()
    de = da = None
    cases = [{m[1]: _values(path, m[1], m[2]) for m in _NAMELIST.finditer(case)} for case in cards.split("NEXT CASE")]
    tailed = any("HTPLNF" in case for case in cases)
    for case, text in zip(cases, cards.split("NEXT CASE"), strict=True):
        held |= set(case)
        given |= {name: values for name, values in case.items() if name not in given}
        if "SYMFLP" in case and de is None and ("HTPLNF" in held or not tailed):
            de = case["SYMFLP"]
        if "ASYFLP" in case and da is None and _one(case["ASYFLP"], "STYPE", _PLAIN_AILERONS) == _PLAIN_AILERONS:
            da = case["ASYFLP"]
        if not re.search(r"^\s*SAVE\s*$", text, re.MULTILINE):
            held = set()
    return given, de, da


def _values(path: Path, name: str, body: str) -> dict[str, list[float]]:
    out: dict[str, list[float]] = {}
    for key, text in _ITEM.findall(" ".join(body.split())):
        numbers: list[float] = []
        for word in filter(None, re.split(r"[,\s]+", text)):
            times, _, value = word.rpartition("*")
            try:
                number = {".TRUE.": 1.0, ".FALSE.": 0.0, "T": 1.0, "F": 0.0}.get(value)
                numbers += [float(value.replace("D", "E")) if number is None else number] * int(times or 1)
            except ValueError as error:
                raise ScenarioError(f"{path}: {key} of ${name} must be numbers, got '{word}'") from error
        out[key] = numbers
    return out


def _one(values: Mapping[str, list[float]], key: str, otherwise: float) -> float:
    return values[key][0] if values.get(key) else otherwise


def _need(path: Path, name: str, values: Mapping[str, list[float]], key: str) -> float:
    if not values.get(key):
        raise ScenarioError(f"{path}: ${name} must give {key}, got {', '.join(values) or 'nothing'}")
    return values[key][0]


def _foils(cards: str) -> Iterator[tuple[str, str]]:
    """Yield surface and airfoil of the NACA cards whose section has a formula here: four and five digits."""
    for surface, series, digits in _FOIL.findall(cards):
        plain = re.match(r"\d+", digits)
        if series in "45" and plain and len(plain[0]) in (4, 5):
            yield _SECTIONS[surface], f"naca{plain[0]}"


def _plan(path: Path, given: Mapping[str, Any], unit: float, foils: Mapping[str, str]) -> dict[str, Any]:
    """Return surfaces, body, references, centre of gravity, mass and design condition as geometry.toml has them."""
    at, out = given.get("SYNTHS", {}), dict[str, Any]()
    for name, surface in _PLANFORMS.items():
        if name not in given:
            continue
        letter = {"wing": "W", "tail": "H", "fin": "V"}[surface]
        x, z = (unit * _one(at, f"{axis}{letter}", 0.0) for axis in "XZ")
        made: dict[str, Any] = {"section": _sections(path, name, given[name], unit, (x, z), surface == "fin", at)}
        made |= {"airfoil": foils[surface]} if surface in foils else {}
        if surface == "fin":
            out["fin"] = [made]
        else:
            out[surface] = made | {"incidence_deg": _one(at, f"ALI{letter}", 0.0)}
    if "BODY" in given:
        sections = _body(path, given["BODY"], unit)
        out |= {"fuselage": {"section": sections}} if len(sections) > 1 else {}
    said = given.get("OPTINS", {})
    power = {"SREF": ("S_m2", 2), "CBARR": ("cbar_m", 1), "BLREF": ("b_m", 1)}
    out["reference"] = {key: said[k][0] * unit**n for k, (key, n) in power.items() if said.get(k)}
    out["mass"] = {"cg_m": [unit * _one(at, "XCG", 0.0), 0.0, unit * _one(at, "ZCG", 0.0)]} if "XCG" in at else {}
    flight = given.get("FLTCON", {})
    h = unit * _one(flight, "ALT", 0.0)
    out |= {"design_h_m": h} if flight.get("ALT") else {}
    if flight.get("VINF"):
        speed = unit * flight["VINF"][0]
    else:
        speed = _one(flight, "MACH", 0.0) * _SOUND_M_S * math.sqrt(max(1.0 - _LAPSE * h, 0.75))
    out |= {"design_V_m_s": float(f"{speed:.4g}")} if speed else {}
    return out


def _sections(
    path: Path, name: str, p: Mapping[str, list[float]], unit: float, apex_m: tuple[float, float], upright: bool,
    at: Mapping[str, list[float]],
) -> list[dict[str, float]]:  # fmt: skip
    """Return the sections of a planform from the middle, of a fin from where it leaves the body, to the tip, m."""
    x, z = apex_m
    span, root, tip = (_need(path, name, p, key) for key in ("SSPN", "CHRDR", "CHRDTP"))
    outer = _one(p, "SSPNOP", 0.0)
    share = _one(p, "CHSTAT", 0.0)
    ends = (
        [(0.0, root), (span - outer, _one(p, "CHRDBP", tip)), (span, tip)]
        if outer > 0.0
        else [(0.0, root), (span, tip)]
    )
    sweeps = [_one(p, "SAVSI", 0.0), _one(p, "SAVSO", _one(p, "SAVSI", 0.0))]
    tilts = [_one(p, "DHDADI", 0.0), _one(p, "DHDADO", 0.0) if outer > 0.0 else 0.0]
    aft, up, points = 0.0, 0.0, [(0.0, 0.0, 0.0, root)]
    for i, ((s0, c0), (s1, c1)) in enumerate(pairwise(ends)):
        aft += (s1 - s0) * math.tan(sweeps[i] * DEG_RAD) + share * (c0 - c1)
        up += (s1 - s0) * math.tan(tilts[i] * DEG_RAD)
        points.append((s1, aft, up, c1))
    if upright:
        hidden = max(span - _one(p, "SSPNE", span), 0.0)
        s, a, _, c = np.array(points).T
        kept = [(hidden, float(np.interp(hidden, s, a)), 0.0, float(np.interp(hidden, s, c)))]
        points = kept + [q for q in points if q[0] > hidden]
    twist, way = _one(p, "TWISTA", 0.0), -1.0 if "VERTUP" in at and at["VERTUP"] == [0.0] else 1.0
    return [
        {
            "x_m": x + unit * a,
            "y_m": 0.0 if upright else unit * s,
            "z_m": z + unit * (way * s if upright else u),
            "chord_m": unit * max(c, 0.01 * root),  # a tip that is a point has no section
            "twist_deg": twist * s / span,
        }
        for s, a, u, c in points
    ]


def _body(path: Path, p: Mapping[str, list[float]], unit: float) -> list[dict[str, float]]:
    """Return the cross-sections of the body; width from R, else from the area S, or round."""
    xs = p.get("X", [])[: int(_one(p, "NX", 99.0))]
    out: list[dict[str, float]] = []
    for i, x in enumerate(xs):
        row = {key: p[key][i] for key in ("R", "S", "ZU", "ZL") if len(p.get(key, [])) > i}
        if not row.keys() & {"R", "S"} and not {"ZU", "ZL"} <= row.keys():
            raise ScenarioError(
                f"{path}: $BODY must give R, S, or ZU and ZL at each of {len(xs)} X, got none at X = {x:g}"
            )
        round_ = 2.0 * row["R"] if "R" in row else math.sqrt(4.0 / math.pi * max(row.get("S", 0.0), 0.0))
        tall = row["ZU"] - row["ZL"] if {"ZU", "ZL"} <= row.keys() else round_
        wide = round_ if "R" in row or not tall else 4.0 / math.pi * row["S"] / tall if "S" in row else tall
        if not out or x * unit > out[-1]["x_m"]:
            middle = 0.5 * (row["ZU"] + row["ZL"]) if {"ZU", "ZL"} <= row.keys() else 0.0
            out.append({"x_m": unit * x, "z_m": unit * middle, "width_m": unit * wide, "height_m": unit * tall})
    return out


def _flap(
    path: Path, name: str, flap: Mapping[str, list[float]], planform: Mapping[str, list[float]]
) -> dict[str, Any]:
    """Return the part of a surface that moves: its span and the mean share of the chord."""
    span = planform["SSPN"][0]
    inner, outer = (min(max(_need(path, name, flap, key) / span, 0.0), 1.0) for key in ("SPANFI", "SPANFO"))
    root, tip = planform["CHRDR"][0], planform["CHRDTP"][0]
    shares = [
        _need(path, name, flap, key) / (root + (tip - root) * y) for key, y in (("CHRDFI", inner), ("CHRDFO", outer))
    ]
    return {"span_from": inner, "span_to": outer, "chord_fraction": min(0.5 * sum(shares), 1.0)}


# --- the output -------------------------------------------------------------------------------------------------------


def _tables(text: str) -> Derivatives | None:
    """Return the derivatives of the configuration with most parts at the first of its flight conditions."""
    pages = re.split(r"^1", text, flags=re.MULTILINE)
    static = _largest(pages, "CHARACTERISTICS AT ANGLE OF ATTACK")
    if static is None:
        return None
    rows = _rows(static, ("ALPHA", "CD", "CL", "CM", "CN", "CA", "XCP", "CLA", "CMA", "CYB", "CNB", "CLB"))
    dynamic = _largest(pages, "DYNAMIC DERIVATIVES\n")
    more = {} if dynamic is None else _rows(dynamic, ("ALPHA", *_DYNAMIC))
    if not rows or not np.isfinite(rows["CL"]).any():
        return None
    end = int(np.nanargmax(rows["CL"])) + 1
    CL = rows["CL"][:end]
    if not (np.isfinite(CL).all() and np.all(np.diff(CL) > 0.0)):
        return None
    values = {name: _per_rad(static) * rows[key][:end] for key, name in _STATIC.items()}
    if more and len(more["ALPHA"]) == len(rows["ALPHA"]):
        values |= {name: _per_rad(dynamic or "") * more[key][:end] for key, name in _DYNAMIC.items()}
    return Derivatives(CL, {name: v for name, v in values.items() if np.isfinite(v).any()})


def _per_rad(page: str) -> float:
    return 1.0 if "(PER RADIAN)" in page else 1.0 / DEG_RAD


def _largest(pages: list[str], title: str) -> str | None:
    held = [page for page in pages if title in page and "CONFIGURATION" in page]
    return max(held, key=lambda page: page.partition(title)[2].split("CONFIGURATION")[0].count("-"), default=None)


def _rows(page: str, names: tuple[str, ...]) -> dict[str, FloatArray]:
    """Return the columns of the first table of a page; a column that does not change is printed once."""
    after = re.split(r"^0\s+ALPHA.*$", page, maxsplit=1, flags=re.MULTILINE)
    lines = (after[1] if len(after) > 1 else "").split("\n")
    table: list[list[tuple[int, str]]] = []
    for line in lines[1:]:
        if _ROW.match(line):
            table.append([(m.end(), m[0]) for m in re.finditer(r"\S+", line)])
        elif table:
            break
    if not table or len(table[0]) != len(names):
        return {}
    ends = np.array([end for end, _ in table[0]])
    out = np.full((len(table), len(names)), np.nan)
    for i, row in enumerate(table):
        for end, word in row:
            k = int(np.argmin(np.abs(ends - end)))
            out[i, k] = float(word) if re.fullmatch(r"[-+]?\d*\.?\d+(E[-+]?\d+)?", word) else np.nan
    constant = [
        k for k in range(len(names)) if len(table) > 1 and np.isfinite(out[0, k]) and np.isnan(out[1:, k]).all()
    ]
    out[1:, constant] = out[0, constant]
    return dict(zip(names, out.T, strict=True))
