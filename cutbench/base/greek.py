"""Symbols as a page writes them: Greek letters in place of their names, no markup."""

from __future__ import annotations

import re
from html import escape

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "eta": "η", "kappa": "κ", "lambda": "λ", "mu": "μ",
    "nu": "ν", "phi": "φ", "psi": "ψ", "rho": "ρ", "sigma": "σ", "tau": "τ",
}  # fmt: skip


def plain_symbol(symbol: str) -> str:
    """A symbol as pictures set it, without its markup: ``$\\delta_\\mathrm{c}$`` is δ_c."""
    text = re.sub(r"\\mathrm\{(\w+)\}", r"\1", symbol.replace("$", "").replace("\\,", " "))
    return re.sub(r"\\(\w+?)(?=_|\W|$)", lambda m: GREEK.get(m[1], m[1]), text)


def plain_formula(text: str) -> str:
    """``eta_reg v/delta_c`` as η_reg v/δ_c."""
    return re.sub(r"(?<![A-Za-z_])[A-Za-z]+", lambda m: GREEK.get(m[0], m[0]), text)


def set_subscripts(text: str) -> str:
    """``τ_W/(G_c/δ_c)`` with its subscripts as Matplotlib sets them."""
    return re.sub(r"(\w)_(\w+)", r"$\1_{\\mathrm{\2}}$", text)


def subscripted(text: str) -> str:
    """``G_c/δ_c`` as HTML."""
    return re.sub(r"_(\w+)", r"<sub>\1</sub>", escape(text))
