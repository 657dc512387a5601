"""Maps: a study's axes and samples, its sweep, the data set of its runs, regimes and their pictures.

``guidance`` reads decisions off a map; ``confirmation`` repeats points of one in three dimensions.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "confirmation": ["confirm"],
        "dataset": ["build_map", "load_map", "save_map"],
        "guidance": ["guide"],
        "phase": ["save_phase"],
        "study": ["Study", "load_study"],
        "sweep": ["Sweep", "run_study"],
    },
)
