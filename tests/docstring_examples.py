"""Run the examples of all names of cutbench; the last line is JSON: how many there were, and what failed."""

from __future__ import annotations

import doctest
import inspect
import json

import cutbench


def tried(name: str) -> tuple[int, str]:
    """How many examples a name has, and what is wrong with them; empty where nothing is."""
    said: list[str] = []
    text = inspect.getdoc(getattr(cutbench, name)) or ""
    found = doctest.DocTestParser().get_doctest(text, {}, name, None, 0)
    done = doctest.DocTestRunner(verbose=False).run(found, out=said.append)
    return done.attempted, "".join(said)


if __name__ == "__main__":
    names = [name for name in cutbench.__all__ if callable(getattr(cutbench, name))]
    print(json.dumps({name: tried(name) for name in names}))
