"""What makes the transition abrupt or smooth (paper, section on the stability of the transition)."""

from studies.paper.base import Ask, Claim, Finding, at_least
from studies.paper.reading import measure

#: Far enough for the transition, mm.
DEPTH = 7.0
#: A difference of the falls below this says nothing.
MORE = 0.02
#: Little dissipation: gelatin without adhesion, with a tenth of the viscosity.
LITTLE = {"tau_W": "0 kPa", "eta_v": "0.005 mm"}


def read(runs):
    fall = {name: measure(run, "drop_rel") for name, run in runs.items()}
    base = fall["base"]

    def smoother(name, what):
        less = base - fall[name]
        return Finding(f"less fall of the force with {what}", "1", "smooth (0.02 or more here)", less,
                       at_least(less, MORE))  # fmt: skip

    return (
        Finding("fall of the force with little dissipation, relative", "1", "abrupt (0.1 or more here)", base,
                at_least(base, 0.1)),
        smoother("tougher", "twice the G_c/δ_c against G"),
        smoother("viscous", "a hundred times the viscosity"),
        smoother("adhesive", "adhesion of 8 kPa"),
        smoother("friction", "friction, μ = 0.5"),
    )  # fmt: skip


CLAIM = Claim(
    "C15",
    "Low G_c/δ_c against G with little dissipation: abrupt; friction, adhesion or viscosity: smooth.",
    {
        "base": Ask("gelatin", LITTLE, DEPTH),
        "tougher": Ask("gelatin", {**LITTLE, "G_c": "10.6 J/m^2"}, DEPTH),
        "viscous": Ask("gelatin", {**LITTLE, "eta_v": "0.5 mm"}, DEPTH),
        "adhesive": Ask("gelatin", {**LITTLE, "tau_W": "8 kPa"}, DEPTH),
        "friction": Ask("gelatin", {**LITTLE, "mu": 0.5}, DEPTH),
    },
    read,
    changes=("order", "viscous"),
    note="Gelatin without adhesion and with a tenth of its viscosity, then one thing at a time. Where nothing"
    " is cut within the travel there is no fall to compare.",
)
