"""Files of Digital DATCOM: the input is read as geometry.toml would say it, the output's tables stand beside."""

import math

import pytest

from testbench.aircraft.geometry.datcom import read_datcom
from testbench.aircraft.geometry.read import read_plan
from testbench.core.errors import ScenarioError

FT = 0.3048
CARDS = """*  A low-wing aircraft
DIM FT
DAMP
DERIV RAD
 $FLTCON NMACH=1.0,MACH(1)=0.158,NALPHA=3.0,ALSCHD(1)=-2.0,0.0,
    4.0,NALT=1.0,ALT(1)=2000.0,VINF=176.0$
 $OPTINS SREF=184.0,CBARR=5.7,BLREF=33.4$
 $SYNTHS XCG=8.0,ZCG=-0.5,XW=6.0,ZW=-2.0,ALIW=1.5,XH=21.0,ZH=0.8,
    ALIH=-1.0,XV=23.0,ZV=0.2,VERTUP=.TRUE.$    ! places
 $BODY NX=4.0,X(1)=0.0,3.0,12.0,27.0,R(1)=0.0,2*2.0,0.1,
    ZU(1)=0.0,2.0,2.5,0.5,ZL(1)=0.0,-2.0,-2.1,-0.4$
NACA-W-4-2412
NACA H 4 0009-25
NACA-V-6-631-012
 $WGPLNF CHRDR=8.0,CHRDBP=6.0,CHRDTP=4.0,SSPN=16.0,SSPNE=14.0,SSPNOP=10.0,
    SAVSI=0.0,SAVSO=10.0,CHSTAT=0.25,TWISTA=-3.0,DHDADI=0.0,DHDADO=6.0,TYPE=3.0$
 $HTPLNF CHRDR=5.0,CHRDTP=2.5,SSPN=6.0,SSPNE=5.5,SAVSI=6.0,CHSTAT=.25,TYPE=1.0$
 $VTPLNF CHRDR=4.5,CHRDTP=2.0,SSPN=5.0,SSPNE=4.0,SAVSI=15.0,CHSTAT=0.0,TYPE=1.0$
 $PROPWR NENGSP=1.0$
 $SYMFLP FTYPE=1.0,NDELTA=3.0,DELTA(1)=-10.,0.,10.,SPANFI=.6,SPANFO=6.0,CHRDFI=1.9,CHRDFO=1.0$
SAVE
CASEID MINE
NEXT CASE
 $ASYFLP STYPE=4.0,NDELTA=2.0,DELTAL(1)=-5.0,5.0,SPANFI=10.0,SPANFO=16.0,CHRDFI=1.2,CHRDFO=0.8$
CASEID MINE WITH AILERONS
"""
REST = """
[mass]
mass_kg = 1200.0
[[fin]]
airfoil = "naca0012"
[control.de]
throw_deg = 25
[control.da]
throw_deg = 20
[control.dr]
surface = "fin"
throw_deg = 20
chord_fraction = 0.4
"""
HEAD = "1   AUTOMATED STABILITY AND CONTROL METHODS\n     CHARACTERISTICS AT ANGLE OF ATTACK AND IN SIDESLIP\n     "
CONDITION = "0  .158    2000.00     175.17   1.9676E+03     511.570     1.0700E+06           184.000      5.700\n"
STATIC = "0 ALPHA     CD       CL       CM       CN       CA       XCP        CLA          CMA          CYB ...\n0\n"
DYNAMIC = "0   ALPHA       CLQ          CMQ           CLAD         CMAD         CLP          CYP ...\n0\n"


def rows(widths, table):
    """Lines as DATCOM prints them: right-aligned, a blank where a value is that of the first line."""
    cells = (line.split("|") for line in table.strip().splitlines())
    return "".join("".join(c.strip().rjust(w) for c, w in zip(row, widths, strict=True)) + "\n" for row in cells)


OUTPUT = (
    "        CONERR - INPUT ERROR CHECKING\n0******************************  INPUT DATA CARDS  ****************\n\n"
    + CARDS.replace("\n", "   \n")
    + "1          THE FOLLOWING IS A LIST OF ALL INPUT CARDS FOR THIS CASE.\n0\n"
    + CARDS
    + f"{HEAD}WING ALONE CONFIGURATION\n{CONDITION}0      ------DERIVATIVE (PER RADIAN)------\n{STATIC}"
    + rows(
        (7, 9, 9, 10, 8, 9, 9, 13, 13, 13, 13, 13),
        "-2.0|.010|.100|.0500|.141|.025|.750|4.000E+00|-1.000E-01|-4.000E-02|1.000E-02|-8.000E-02",
    )
    + f"{HEAD}WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL CONFIGURATION\n{CONDITION}"
    + f"0      ------DERIVATIVE (PER RADIAN)------\n{STATIC}"
    + rows(
        (7, 9, 9, 10, 8, 9, 9, 13, 13, 13, 13, 13),
        """
        -2.0|.020|.200|.1060|.141| .025|.750| 5.600E+00|-6.000E-01|-4.766E-01|5.071E-02|-8.000E-02
          .0|.025|.400|.0841|.341| .025|.247| 5.800E+00|-5.000E-01|          |         |-9.000E-02
         4.0|.049|.800|   NA|.757|-.004|  NA| 6.000E+00|        NA|          |         |-1.000E-01
        20.0|.131|.500|   NA|.881|-.181|  NA|-1.866E+01|        NA|          |         |-7.226E-02""",
    )
    + "0                                    ALPHA     Q/QINF    EPSLON  D(EPSLON)/D(ALPHA)\n"
    + "1   AUTOMATED STABILITY AND CONTROL METHODS\n          DYNAMIC DERIVATIVES\n"
    + f"     WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL CONFIGURATION\n{CONDITION}"
    + f"                    DYNAMIC DERIVATIVES (PER DEGREE)\n{DYNAMIC}"
    + rows(
        (9, 13, 13, 14, 13, 13, 13, 13, 13, 13),
        """
        -2.00|1.000E-01|-2.000E-01| 3.600E-02|-1.000E-01|-8.000E-03|-2.148E-03|-6.165E-05|-1.107E-03|6.000E-04
          .00|         |          | 3.700E-02|-1.000E-01|-8.000E-03|-2.180E-03|-1.808E-04|-1.136E-03|9.000E-04
         4.00|         |          | 3.500E-02|-1.000E-01|-8.000E-03|-2.251E-03|-4.237E-04|-1.219E-03|1.500E-03
        20.00|         |          |-4.831E-02| 1.291E-01| 1.833E-02|-1.468E-03|-2.563E-03|-1.136E-03|7.205E-04""",
    )
    + "1\n"
)


def plan(tmp_path, cards=CARDS, name="for005.dat", rest=REST):
    (tmp_path / name).write_text(cards)
    (tmp_path / "rest.toml").write_text(rest)
    return read_plan(tmp_path / name, tmp_path / "rest.toml")


def at(surface, i):
    s = surface.stations[i]
    return s.x_m, s.y_m, s.z_m, s.chord_m, s.twist_deg


@pytest.mark.parametrize(("cards", "name"), [(CARDS, "for005.dat"), (OUTPUT, "plane.out")])
def test_surfaces_body_and_controls_are_those_of_the_cards(tmp_path, cards, name):
    made = plan(tmp_path, cards, name)
    wing, tail, fin = made.plane.surfaces
    kink, tip = 6.0, 16.0
    aft = 0.25 * 2.0
    further = 10.0 * math.tan(math.radians(10.0)) + 0.25 * 2.0
    up = 10.0 * math.tan(math.radians(6.0))
    assert at(wing, 0) == pytest.approx((6.0 * FT, 0.0, -2.0 * FT, 8.0 * FT, 1.5))
    assert at(wing, 1) == pytest.approx(((6.0 + aft) * FT, kink * FT, -2.0 * FT, 6.0 * FT, 1.5 - 3.0 * kink / tip))
    assert at(wing, 2) == pytest.approx(((6.0 + aft + further) * FT, tip * FT, (up - 2.0) * FT, 4.0 * FT, 1.5 - 3.0))
    assert at(tail, 1)[1:] == pytest.approx((6.0 * FT, 0.8 * FT, 2.5 * FT, -1.0))
    # The fin begins where it leaves the body, a foot above its theoretical root.
    slope = math.tan(math.radians(15.0))
    assert at(fin, 0) == pytest.approx(((23.0 + slope) * FT, 0.0, 1.2 * FT, 4.0 * FT, 0.0))
    assert at(fin, 1) == pytest.approx(((23.0 + 5.0 * slope) * FT, 0.0, 5.2 * FT, 2.0 * FT, 0.0))
    flaps = {f.moves: (s.role, f) for s in made.plane.surfaces for f in s.flaps}
    assert {k: v[0] for k, v in flaps.items()} == {"de": "tail", "da": "wing", "dr": "fin"}
    assert (flaps["de"][1].start, flaps["de"][1].end) == pytest.approx((0.1, 1.0))
    assert flaps["de"][1].chord_fraction == pytest.approx(0.5 * (1.9 / 4.75 + 1.0 / 2.5))
    assert flaps["da"][1].start == pytest.approx(10.0 / 16.0)
    assert [s.airfoil.name for s in (wing.stations[0], tail.stations[0], fin.stations[0])] == [
        "naca2412", "naca0009", "naca0012"
    ]  # fmt: skip
    body = made.plane.body
    assert (body[1].width_m, body[1].height_m, body[2].z_m) == pytest.approx((4.0 * FT, 4.0 * FT, 0.2 * FT))
    assert made.balance.cg_m == pytest.approx((8.0 * FT, 0.0, -0.5 * FT))
    assert (made.plane.S_m2, made.plane.b_m) == pytest.approx((184.0 * FT**2, 33.4 * FT))
    assert (made.said.design_V_m_s, made.said.design_h_m) == pytest.approx((176.0 * FT, 2000.0 * FT), rel=1e-3)
    assert made.title.lower() == "mine"
    assert "propellers ($PROPWR) is left out" in made.plane.notes


def test_what_lies_beside_counts_more_than_the_cards(tmp_path):
    made = plan(tmp_path, rest="design_V_m_s = 40.0\n" + REST + '[wing]\nairfoil = "naca0012"\nincidence_deg = 0.0\n')
    assert made.said.design_V_m_s == 40.0
    assert made.plane.surfaces[0].stations[0].airfoil.name == "naca0012"
    assert at(made.plane.surfaces[0], 2)[3:] == pytest.approx((4.0 * FT, -3.0))


def test_the_tables_are_those_of_the_whole_aircraft_per_radian(tmp_path):
    path = tmp_path / "for006.dat"
    path.write_text(OUTPUT)
    _, tables, _ = read_datcom(path)
    found = tables.at(0.3)
    assert found["CL_alpha"] == pytest.approx(5.7)
    assert found["Cm_alpha"] == pytest.approx(-0.55)
    assert found["Cl_beta"] == pytest.approx(-0.085)
    assert found["CY_beta"] == pytest.approx(-0.4766)  # printed once
    assert found["CL_q"] == pytest.approx(0.1 * 180.0 / math.pi)
    assert found["Cl_r"] == pytest.approx(7.5e-4 * 180.0 / math.pi)
    assert set(tables.at(0.7)) == set(found) - {"Cm_alpha"}  # NA there
    assert tables.at(0.9) == {}  # beyond the greatest lift


def test_units_and_an_all_moving_tail(tmp_path):
    cards = CARDS.replace("DIM FT", "DIM M").replace("ALIH=-1.0", "HINAX=22.0")
    cards = "\n".join(line for line in cards.splitlines() if "SYMFLP" not in line)
    made = plan(tmp_path, cards, "plane.dcm")
    assert made.plane.surfaces[0].stations[0].chord_m == 8.0
    (flap,) = (f for s in made.plane.surfaces for f in s.flaps if f.moves == "de")
    assert flap.chord_fraction == 1.0


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("$WGPLNF", "$XXPLNF", r"must be an input of Digital DATCOM or its output .* got FLTCON, OPTINS"),
        ("SSPN=16.0", "SPAN=16.0", r"\$WGPLNF must give SSPN, got CHRDR"),
        ("CHRDR=8.0", "CHRDR=eight", r"CHRDR of \$WGPLNF must be numbers, got 'EIGHT'"),
        ("R(1)=0.0,2*2.0,0.1,\n    ZU", "ZV", r"\$BODY must give R, S, or ZU and ZL"),
        ("NACA-W-4-2412", "NACA-W-6-64418", r"must say the airfoils of wing by NACA cards .*\[wing\] airfoil"),
    ],
)
def test_what_cannot_be_carried_over_is_refused_with_its_place(tmp_path, old, new, said):
    assert old in CARDS
    with pytest.raises(ScenarioError, match=said):
        plan(tmp_path, CARDS.replace(old, new))


def test_what_the_cards_lack_is_asked_for(tmp_path):
    (tmp_path / "for005").write_text(CARDS)
    with pytest.raises(ScenarioError, match="a file of DATCOM lacks mass"):
        read_plan(tmp_path / "for005")
