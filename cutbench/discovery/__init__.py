"""Discovery: what a model gets wrong of measured curves, which cause explains it, and what naming it gains.

``search`` fits the baseline and compares it with models that have one more cause (``comparison``):
``candidates`` says which there are, ``screening`` and ``score`` which of them promise anything.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "search": ["Discovery", "discover"],
        "report": ["gain_sentence", "summary", "verdict_sentence", "write_discovery"],
    },
)
