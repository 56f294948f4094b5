"""Small logs of a short period whose coefficients are known, at any speed, height and mass, each with a description."""

from pathlib import Path

import numpy as np
from scipy.signal import lsim

from testbench.core.atmosphere import air_density

S, B, CBAR = 0.28, 1.27, 0.22
GEOMETRY = f"[geometry]\nS_m2 = {S}\nb_m = {B}\ncbar_m = {CBAR}\n"
TRUE = {"CZ_alpha": -4.6, "CZ_q": -8.0, "CZ_de": -0.3, "Cm_alpha": -0.72, "Cm_q": -13.0, "Cm_de": -0.85}
RATE_HZ, DURATION_S = 50.0, 12.0


def write_record(
    file: Path,
    V_m_s: float,
    h_m: float = 100.0,
    mass_kg: float = 1.8,
    Iyy_kg_m2: float = 0.08,
    noise: float = 1.0,
    seed: int = 0,
    coefficients: dict[str, float] | None = None,
) -> Path:
    """Write V, h, alpha, q and de of a flight with these coefficients as CSV, angles in rad; return the file."""
    c = {**TRUE, **(coefficients or {})}
    force = 0.5 * air_density(h_m) * V_m_s**2 * S
    z, m = force / (mass_kg * V_m_s), force * CBAR / Iyy_kg_m2
    per = CBAR / (2.0 * V_m_s)
    A = np.array([[z * c["CZ_alpha"], 1.0 + z * c["CZ_q"] * per], [m * c["Cm_alpha"], m * c["Cm_q"] * per]])
    Bde = np.array([[z * c["CZ_de"]], [m * c["Cm_de"]]])
    t = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
    de = sum(0.02 * np.sin(2.0 * np.pi * f * t + k) for k, f in enumerate((0.4, 0.9, 1.7, 2.6)))
    x = lsim((A, Bde, np.eye(2), np.zeros((2, 1))), de, t)[1]
    rng = np.random.default_rng(seed)
    alpha, q = (x + noise * np.array([2e-4, 1e-3]) * rng.standard_normal(x.shape)).T
    V = V_m_s + noise * 0.02 * rng.standard_normal(t.size)
    columns = np.column_stack([t, V, np.full(t.size, h_m), 0.05 + alpha, q, de])
    np.savetxt(file, columns, delimiter=",", header="t,V,h,alpha,q,de", comments="", fmt="%.9g")
    return file


def description(
    records: str,
    *,
    head: str = "",
    channels: str = "V h alpha q de",
    tail: str = "",
    condition: str = "",
    extra: str = "",
) -> str:
    """Return a description; ``records`` is TOML of its records, the other parts stand where their names say."""
    units = {"V": "m/s", "h": "m", "q": "rad/s"}
    columns = "\n".join(
        f'[[channel]]\nname = "{n}"\ncolumn = "{n}"\nunit = "{units.get(n, "rad")}"' for n in channels.split()
    )
    return f"""title = "A short period"
source = "made"
rights = "free"
{head}
[time]
column = "t"
{records}
{columns}
{condition}
[preparation]
bias = "mean"
identification_fraction = 0.7
[identification]
inputs = ["de"]
outputs = ["alpha", "q"]
[[identification.estimators]]
method = "output_error"
structure = "short_period"
{extra}
{tail}
"""


def record(name: str, use: str = "split", more: str = "") -> str:
    """Return TOML of the record in NAME.csv."""
    return f'[[record]]\nname = "{name}"\nfile = "{name}.csv"\nuse = "{use}"\n{more}\n'


def write_day(folder: Path, name: str, V_m_s: float, mass_kg: float = 1.8, Iyy: float = 0.08, **more: object) -> Path:
    """Write NAME.csv and a description of it with geometry, mass and inertia; return the description."""
    flight = {k: more.pop(k) for k in ("h_m", "noise", "seed", "coefficients") if k in more}
    write_record(folder / f"{name}.csv", V_m_s, mass_kg=mass_kg, Iyy_kg_m2=Iyy, **flight)  # type: ignore[arg-type]
    condition = f"[condition]\nmass_kg = {mass_kg}\nIyy_kg_m2 = {Iyy}\n"
    more = {"condition": condition, "tail": GEOMETRY, **more}
    (folder / f"{name}.toml").write_text(description(record(name), **more), encoding="utf-8")  # type: ignore[arg-type]
    return folder / f"{name}.toml"
