"""The calibration table's G_c/δ_c and τ_W in N/m² (paper, table of calibrated parameters)."""

from studies.paper.base import Ask, Claim, Finding, near
from studies.paper.reading import end_of_indentation, measure

#: Gelatin as printed: G_c/δ_c = 75.7 N/m² with δ_c = 0.07 mm, and τ_W = 0.0008 N/m².
PRINTED = {"G_c": "0.005299 J/m^2", "tau_W": "0.0000008 kPa"}


def read(runs):
    printed, kilo = runs["printed"], runs["kilo"]
    end = end_of_indentation(kilo)
    force = measure(printed, "max_N")
    onset = measure(printed, "onset_mm")
    slope = measure(kilo, "slope_N_per_mm")
    return (
        Finding("onset of the cut, table read in N/m²", "mm", "about 4 mm", onset, near(onset, 4.19)),
        Finding("force of adhesion and cohesion, read in N/m²: largest force to 7 mm", "N",
                "1 to 2 N", force, near(force, 1.0, 2.0)),
        Finding("end of indentation, read in kPa", "mm", "about 4 mm", end, near(end, 4.19)),
        Finding("slope after it, read in kPa", "N/mm", "0.048 N/mm", slope, near(slope, 0.048, within=0.5)),
    )  # fmt: skip


CLAIM = Claim(
    "units",
    "The calibration table gives G_c/δ_c and τ_W in N/m².",
    {"printed": Ask("gelatin", PRINTED, 7.0), "kilo": Ask("gelatin")},
    read,
)
