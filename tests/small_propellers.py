"""Small aircraft with propellers of our own: the Taurus, which has none, with a motor and a propeller in its nose."""

from __future__ import annotations

from testbench.aircraft.source import Source, read_source
from testbench.core.paths import AIRCRAFT_MODELS

ELECTRIC = '<electric_engine name="motor"><power unit="WATTS">600</power></electric_engine>'
BRUSHLESS = (
    '<brushless_dc_motor name="motor"><velocityconstant>500</velocityconstant><coilresistance>0.04</coilresistance>'
    "<noloadcurrent>1.2</noloadcurrent><maxvolts>18.5</maxvolts></brushless_dc_motor>"
)
# Coefficients over the advance ratio, of a two-bladed wooden propeller of 14 inches; it drives the motor above 0.95.
CT = ((0.0, 0.095), (0.2, 0.085), (0.4, 0.066), (0.6, 0.042), (0.8, 0.012), (1.0, -0.02), (1.5, -0.09))
CP = ((0.0, 0.048), (0.2, 0.047), (0.4, 0.043), (0.6, 0.033), (0.8, 0.017), (1.0, -0.006), (1.5, -0.08))


def propeller(inertia_kg_m2: float, diameter_in: float = 14.0) -> str:
    """Return a propeller with these coefficients."""
    out = f'<propeller name="propeller"><ixx unit="KG*M2">{inertia_kg_m2}</ixx><numblades>2</numblades>'
    out += f'<diameter unit="IN">{diameter_in}</diameter>'
    for name, rows in (("C_THRUST", CT), ("C_POWER", CP)):
        data = "\n".join(f"{J} {c}" for J, c in rows)
        out += f'<table name="{name}" type="internal"><tableData>{data}</tableData></table>'
    return f"{out}</propeller>"


def with_propeller(motor: str, inertia_kg_m2: float = 1e-4, engines: int = 1) -> Source:
    """Return the Taurus with so many motors, each with a propeller, in place of its law of thrust."""
    plain = read_source(AIRCRAFT_MODELS / "taurus" / "taurus.xml")
    xml = plain.xml.replace('file="direct"', 'file="propeller"')
    xml = xml.replace("<output>fcs/throttle-pos-norm</output>", "<output>fcs/static-thrust</output>")
    start, end = xml.index("<engine "), xml.index("</engine>") + len("</engine>")
    files = {"motor.xml": motor, "propeller.xml": propeller(inertia_kg_m2)}
    return Source("small", plain.path, xml[:start] + engines * xml[start:end] + xml[end:], files, (), ())
