"""cutbench: a workbench for cutting soft solids with a blade.

    import cutbench
    result = cutbench.run2d("gelatin", eta_reg="0.5 s", h="0.4 mm")
    result.displacement_mm, result.force_N

These are the public names; what is heavy is loaded when it is first used.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "base.errors": ["BadInput", "ComputationFailed", "CutbenchError", "DoubtfulInput"],
        "calibration.fitting": ["Fit", "fit"],
        "case.case": ["Case", "known_materials", "load_case"],
        "case.model": ["DEFAULT", "PAPER", "Model"],
        "case.numerics": ["Numerics"],
        "data.campaign": ["Campaign", "load_campaign"],
        "data.example_files": ["copy_examples"],
        "discovery.search": ["Discovery", "discover"],
        "emulator.atlas": ["Estimate"],
        "emulator.estimates": ["estimate"],
        "loading": ["load"],
        "maps.dataset": ["load_map"],
        "maps.map_folder": ["Map"],
        "maps.study": ["Study", "load_study"],
        "maps.sweep": ["run_study"],
        "mechanisms": ["known_mechanisms", "use_mechanisms"],
        "run.band": ["Band", "band"],
        "run.cutting": ["run2d", "run3d"],
        "run.result": ["Outcome", "Result"],
        "run.runner": ["run_case"],
    },
)
