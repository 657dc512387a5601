"""Measured data: a campaign file, its experiments, tables and units, noise, displacement fields.

Files are only read. Nothing is fitted here.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "campaign": ["Campaign", "FitPlan", "load_campaign", "start_case"],
        "example_files": ["copy_examples"],
        "experiment": ["Experiment"],
        "field_comparison": ["Comparison", "at_travel", "compare", "sample"],
        "fields": ["Field", "read_fields"],
        "repetition": ["Averaged", "Repetition"],
    },
)
