"""Tables as machines of many makers export them, each with the readings of one strip."""

from __future__ import annotations

import numpy as np
import pytest
import tables_made as made

from cutbench.data.campaign import load_campaign

V = made.readings(n=60)


def de(value: float, digits: int = 3) -> str:
    """A number with a decimal comma."""
    return f"{value:.{digits}f}".replace(".", ",")


#: The table, its columns, and more in the experiment.
EXPORTS = {
    "instron": (
        '"Results Table 1"\n"","Specimen label","Maximum Load","Tensile strain at Break"\n'
        '"","","(N)","(mm/mm)"\n"1","S1","1.7","0.5"\n"Mean","","1.7","0.5"\n\n'
        '"Time","Extension","Load"\n"(s)","(mm)","(N)"\n'
        + "".join(f'"{t:.4f}","{u:.4f}","{F:.5f}"\n' for t, u, F in V),
        made.COLUMNS,
        "",
    ),
    "zwick": (
        '"Prüfprotokoll"\n"Probenbezeichnung:";"Gel 3"\n\n'
        '"Prüfzeit";"Standardweg";"Standardkraft"\n"s";"mm";"N"\n'
        + "".join(f"{de(t)};{de(u)};{de(F, 5)}\n" for t, u, F in V),
        '{ time="Prüfzeit", displacement="Standardweg", force="Standardkraft" }',
        "",
    ),
    "lvm": (
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\n***End_of_Header***\t\n"
        "Channels\t2\t\nSamples\t1\t1\nDate\t2024/05/02\t2024/05/02\nTime\t12:03:04,5\t12:03:04,5\n"
        "Y_Unit_Label\tNewton\tmm\n***End_of_Header***\t\nX_Value\tKraft\tWeg\tComment\n"
        + "".join(f"{de(t)}\t{de(F, 5)}\t{de(u)}\n" for t, u, F in V),
        '{ time="X_Value", displacement="Weg", force="Kraft" }',
        'units = { time="s", displacement="mm", force="N" }\n',
    ),
    "shimadzu": (
        '"1 _ 1",,,"1 _ 2",,\n"Time","Force","Stroke","Time","Force","Stroke"\n'
        '"sec","N","mm","sec","N","mm"\n'
        + "".join(f"{t:.3f},{F:.5f},{u:.4f},{t:.3f},{1.02 * F:.5f},{u:.4f}\n" for t, u, F in V),
        '{ time="Time", displacement="Stroke", force="Force" }',
        "",
    ),
    "cellscale": (
        "SetName,Cycle,Time_S,Size_mm,Displacement_mm,Force_mN\n"
        + "".join(f"Test,1-Stretch,{t:.2f},{40 + u:.4f},{u:.4f},{1e3 * F:.3f}\n" for t, u, F in V),
        '{ time="Time", displacement="Displacement", force="Force" }',
        "",
    ),
    "mark10": (
        "Reading,Load [lbF],Travel [in],Time [sec.]\n"
        + "".join(f"{k},{F / 4.4482216:.6f},{u / 25.4:.6f},{t:.2f}\n" for k, (t, u, F) in enumerate(V)),
        '{ time="Time", displacement="Travel", force="Load" }',
        "",
    ),
    "bose": (
        "WinTest Data\nTotal Points 60\nPoints, Elapsed Time , Disp, Load\n, sec , mm , N\n"
        + "".join(f"{k}, {t:.3f} , {u:.4f}, {F:.5f}\n" for k, (t, u, F) in enumerate(V)),
        '{ time="Elapsed Time", displacement="Disp", force="Load" }',
        "",
    ),
    "excel datetime": (
        "Timestamp;Weg (mm);Kraft (N)\n"
        + "".join(
            f"02.05.2024 12:{int(t) // 60:02d}:{t % 60:06.3f};{u:.3f};{F:.5f}\n".replace(".", ",").replace(
                "02,05,2024", "02.05.2024"
            )
            for t, u, F in V
        ),
        '{ time="Timestamp", displacement="Weg", force="Kraft" }',
        "",
    ),
    "segments mts": (
        "\ufeffMTS793\n\n"
        + "".join(
            f"Data Acquisition:\tTimed {k}\nStation Name:\tx\n\nAxial Displacement\tAxial Force\tTime\n"
            f"mm\tN\tSec\n" + "".join(f"{u:.4f}\t{F:.5f}\t{t + 20 * k:.3f}\n" for t, u, F in V) + "\n"
            for k in range(2)
        ),
        '{ time="Time", displacement="Axial Displacement", force="Axial Force" }',
        "",
    ),
    "dehnung/%": (
        "Dehnung/%;Spannung/KPa\n" + "".join(f"{u * 2.5:.4f};{1e3 * F / 20:.5f}\n" for t, u, F in V),
        '{ strain="Dehnung", stress="Spannung" }',
        "",
    ),
    "footer stats xl": (
        made.HEAD + "\n" + made.rows(V) + ",,\nAverage,,0.9\nStDev,,0.1\n,,\nCOV (%),,3\n",
        made.COLUMNS,
        "",
    ),
    "blank rows blocks numbers": (
        "Specimen,Time (s),Extension (mm),Load (N)\n"
        + "".join(
            "".join(f"{k},{t:.3f},{u:.4f},{F:.5f}\n" for t, u, F in V)
            + "\nSpecimen,Time (s),Extension (mm),Load (N)\n"
            for k in (1, 2)
        ),
        '{ repetition="Specimen", time="Time", displacement="Extension", force="Load" }',
        "",
    ),
    "pages": (
        "".join(
            made.HEAD + "\n" + made.rows(V[20 * k : 20 * k + 20]) + f"Page {k + 1} of 3\n" for k in range(3)
        ),
        made.COLUMNS,
        "",
    ),
    "hash blocks": (
        "".join(
            f"# Cycle {k + 1}\n# Time(s) Extension(mm) Load(N)\n"
            + "".join(f"{t + 20 * k:.3f} {u:.4f} {F:.5f}\n" for t, u, F in V)
            + "\n\n"
            for k in range(2)
        ),
        made.COLUMNS,
        "",
    ),
    "kgf title comma": (
        "Time, s;Extension, mm;Load, kgf\n"
        + "".join(f"{t:.3f};{u:.4f};{F / 9.80665:.6f}\n" for t, u, F in V),
        made.COLUMNS,
        "",
    ),
}
#: Specimens in a table, where there are several; times as often as the strip is pulled.
SPECIMENS = {"shimadzu": 2, "blank rows blocks numbers": 2}
PULLS = {"segments mts": 2, "hash blocks": 2}


@pytest.mark.parametrize("name", EXPORTS)
def test_the_strip_is_read(tmp_path, name):
    text, columns, more = EXPORTS[name]
    (e,) = load_campaign(made.campaign(tmp_path, text, more, columns=columns)).experiments
    assert len(e.repetitions) == SPECIMENS.get(name, 1)
    for r in e.repetitions:
        assert r.x.size == 60 * PULLS.get(name, 1)
        np.testing.assert_allclose(r.x[:60], 1 + V[:, 1] / made.LENGTH_MM, atol=2e-3)
        np.testing.assert_allclose(r.y[:60], V[:, 2] / made.AREA_MM2, rtol=0.03, atol=1e-4)
        if r.time_s is not None:
            assert r.time_s[59] - r.time_s[0] == pytest.approx(V[-1, 0] - V[0, 0], abs=1e-2)
