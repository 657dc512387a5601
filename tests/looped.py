"""One test over many values, as one case: quick ones that are many cost more to collect than to run."""

from __future__ import annotations

import functools
import inspect


def over(name, values):
    """As ``pytest.mark.parametrize``, in one case; what fails says with which value."""

    def of(test):
        signature = inspect.signature(test)
        left = [p for p in signature.parameters.values() if p.name != name]

        @functools.wraps(test)
        def case(*args, **given):
            for value in values:
                try:
                    test(*args, **given, **{name: value})
                except BaseException as error:
                    error.add_note(f"with {name} = {value}")
                    raise

        case.__signature__ = signature.replace(parameters=left)
        return case

    return of
