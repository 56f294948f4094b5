"""The papers' equations that no other table shows, as MathML and as text."""

from __future__ import annotations

from testbench.questions.reproduce.section import Equation


def _row(*parts: str) -> str:
    return "<mrow>" + "".join(parts) + "</mrow>"


def _i(name: str) -> str:
    return f"<mi>{name}</mi>"


def _o(sign: str) -> str:
    return f"<mo>{sign}</mo>"


def _sub(base: str, index: str) -> str:
    return f"<msub>{base}{index}</msub>"


def _sup(base: str, power: str = "<mn>2</mn>") -> str:
    return f"<msup>{base}{power}</msup>"


def _over(above: str, below: str) -> str:
    return f"<mfrac>{_row(above)}{_row(below)}</mfrac>"


def _root(inside: str) -> str:
    return f"<msqrt>{inside}</msqrt>"


def _sum(inside: str, low: str = "", high: str = "") -> str:
    sign = f"<munderover>{_o('∑')}{_row(low)}{_i(high)}</munderover>" if low else _o("∑")
    return sign + inside


def _dot(name: str) -> str:
    return f'<mover accent="true">{_i(name)}{_o("˙")}</mover>'


def _hat(name: str) -> str:
    return f'<mover accent="true">{_i(name)}{_o("^")}</mover>'


_Y, _U = _sub(_i("y"), _i("i")), _sub(_i("u"), _i("i"))
_BELOW = _i("r") + _sum(_sup(_U)) + _o("−") + _sup(_row(_o("("), _sum(_U), _o(")")))

TAURUS_EQUATIONS = (
    Equation(
        "1",
        _row(_dot("x"), _o("="), _i("A"), _i("x"), _o("+"), _i("B"), _i("u")),
        "ẋ = A x + B u",
        "The linear longitudinal model, x = [u q θ h]ᵀ, u = [δe δt]ᵀ. The paper prints no A and B. Ours has angle of "
        "attack among its states, too: without it four states hold no short period.",
    ),
    Equation(
        "2",
        _row(_i("v"), _o("="), _sum(_sup(_sub(_i("e"), _i("i"))), _i("i") + _o("=") + "<mn>1</mn>", "r")),
        "v = Σ eᵢ², i = 1 … r",
        "The cost that least squares makes small; the same here.",
    ),
    Equation(
        "3",
        _row(_sub(_i("e"), _i("i")), _o("="), _Y, _o("−"), f"<msubsup>{_i('y')}{_i('i')}{_i('m')}</msubsup>"),
        "eᵢ = yᵢ − yᵢᵐ",
        "The error: measured output less the model's; the same here.",
    ),
    Equation(
        "4",
        _row(
            _sub(_i("B"), "<mn>0</mn>"), _o("="),
            _over(_sum(_Y) + _sum(_sup(_U)) + _o("−") + _sum(_U) + _sum(_row(_U, _Y)), _BELOW),
        ),
        "B₀ = (Σyᵢ Σuᵢ² − Σuᵢ Σuᵢyᵢ) / (r Σuᵢ² − (Σuᵢ)²)",
        "The offset of the best straight line. It is the textbook's, and fits a line through points, not a transfer "
        "function.",
    ),
    Equation(
        "5",
        _row(
            _sub(_i("B"), "<mn>1</mn>"), _o("="),
            _over(_i("r") + _sum(_row(_U, _Y)) + _o("−") + _sum(_U) + _sum(_Y), _BELOW),
        ),
        "B₁ = (r Σuᵢyᵢ − Σuᵢ Σyᵢ) / (r Σuᵢ² − (Σuᵢ)²)",
        "Its slope, as in the textbook. The line is an example of least squares; equations 6 to 9 are fitted by a "
        "toolbox, here by transfer_function.",
    ),
)  # fmt: skip

_YQ = _sub(_i("y"), _row(_i("k"), _o(","), _i("q")))
EOLO_EQUATIONS = (
    Equation(
        "1",
        _row(_sub(_i("y"), _i("J/1")), _o("="), f"<msubsup>{_i('y')}{_i('J/1')}{_i('d')}</msubsup>", _o("+"),
             _sub(_i("ε"), _i("J/1"))),
        "y_J/1 = y_J/1ᵈ + ε_J/1",
        "Step 1 of DSR_e splits the outputs into signal and innovations; step 1 of dsr_e here.",
    ),
    Equation(
        "2",
        _row(_sub(_i("x"), _i("k+1")), _o("="), _i("A"), _sub(_i("x"), _i("k")), _o("+"), _i("B"),
             _sub(_i("u"), _i("k")), _o("+"), _i("K"), _sub(_i("ε"), _i("k")), _o(","),
             f"<msubsup>{_i('y')}{_i('k')}{_i('d')}</msubsup>", _o("="), _i("C"), _sub(_i("x"), _i("k"))),
        "x_k+1 = A x_k + [B K] [u_k; ε_k],  y_kᵈ = C x_k",
        "Step 2: a deterministic problem with D = 0. The printed D is not zero.",
    ),
    Equation(
        "3",
        _row(_sub(_i("u"), _i("k")), _o("≔"), _o("["), _sub(_i("U"), _i("J/1")), _o(";"), _sub(_i("ε"), _i("J/1")),
             _o("]"), _o(","), _sub(_i("y"), _i("k")), _o("≔"), f"<msubsup>{_i('y')}{_i('J/1')}{_i('d')}</msubsup>"),
        "u_k := [U_J/1; ε_J/1],  y_k := y_J/1ᵈ",
        "Inputs and outputs of step 2, the innovations among the inputs; the same here.",
    ),
    Equation(
        "4",
        _row(_i("MRSE"), _o("="), _over("<mn>100</mn>", _i("l")),
             _sum(_root(_over(_sum(_sup(_row(_o("("), _YQ, _o("−"), _sub(_hat("y"), _row(_i("k"), _o(","), _i("q"))),
                                             _o(")")))), _sum(_sup(_YQ)))), _i("q") + _o("=") + "<mn>1</mn>", "l")),
        "MRSE = (100 / l) Σ_q √( Σ_k (y_k,q − ŷ_k,q)² / Σ_k y_k,q² ) %",
        "The criterion of Tables 3 and 4; the same here.",
    ),
)  # fmt: skip
