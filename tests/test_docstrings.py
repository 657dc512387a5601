"""What the top exports has docstrings: one sentence, sections that fit the signature, examples that run."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import cutbench

#: Sections in the order in which they stand.
SECTIONS = ("Parameters", "Attributes", "Returns", "Raises", "Examples")
#: Words that begin no sentence which says what a thing is.
NOT_FIRST = re.compile(r"(Of|What|Where|Which|The same)\b")


def described(room: str, name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """A public class or function, and the methods and properties of a class that cutbench itself defines."""
    if not callable(value):
        return
    yield f"{room}.{name}", value
    for cls in value.__mro__ if inspect.isclass(value) else ():
        for member, own in vars(cls).items() if cls.__module__.startswith("cutbench") else ():
            own = getattr(own, "__func__", own)
            known = inspect.isfunction(own) or isinstance(own, (property, functools.cached_property))
            if known and not member.startswith("_"):
                yield f"{cls.__module__}.{cls.__name__}.{member}", own


def public() -> dict[str, Any]:
    """All of them by their full names, each once."""
    found: dict[int, tuple[str, Any]] = {}
    for name in cutbench.__all__:
        for full, value in described("cutbench", name, getattr(cutbench, name)):
            found.setdefault(id(value), (full, value))
    return dict(found.values())


PUBLIC = public()
CALLED = {n: v for n, v in PUBLIC.items() if not isinstance(v, (property, functools.cached_property))}


def sections(doc: str) -> dict[str, list[str]]:
    """The lines of each section; what stands before the first is under an empty title."""
    found: dict[str, list[str]] = {"": []}
    lines, now = doc.splitlines(), ""
    for line, below in zip(lines, [*lines[1:], ""], strict=True):
        if line and re.fullmatch("-{3,}", below):
            assert len(line) == len(below), f"the line under {line} is as long"
            now = line
            found[now] = []
        elif not re.fullmatch("-{3,}", line):
            found[now].append(line)
    return found


def entries(lines: list[str]) -> dict[str, str]:
    """Names of a section with their types: a line of several names has one type."""
    found = {}
    for head in (line for line in lines if line and not line.startswith(" ")):
        names, _, type_ = head.partition(" : ")
        found |= {name.lstrip("*"): type_ for name in names.split(", ")}
    return found


def asked_for(value: Any) -> tuple[str, list[str]]:
    """The section that says what a thing is made of or called with, and the names it must have."""
    if dataclasses.is_dataclass(value):
        return "Attributes", [f.name for f in dataclasses.fields(value) if not f.name.startswith("_")]
    if inspect.isclass(value):
        own = vars(value).get("__init__")
        return "Parameters", [] if own is None else arguments(own)
    return "Parameters", arguments(value)


def arguments(call: Callable[..., Any]) -> list[str]:
    return [name for name in inspect.signature(call).parameters if name not in ("self", "cls")]


def first_sentence_fault(value: Any) -> str:
    """What is wrong with the first line."""
    first, *rest = (inspect.getdoc(value) or "").splitlines() or [""]
    if not first.endswith(".") or re.search(r"[.!?] [A-Z]", first):
        return f"no single sentence: {first}"
    if NOT_FIRST.match(first):
        return f"a sentence that does not say what it is: {first}"
    return "no empty line after the first sentence" if rest and rest[0] else ""


def sections_fault(value: Any) -> str:
    """Whether sections are numpydoc's, in their order."""
    titles = [title for title in sections(inspect.getdoc(value) or "") if title]
    wanted = [title for title in SECTIONS if title in titles]
    return "" if titles == wanted else f"sections {titles}, not {wanted}"


def parameters_fault(value: Any) -> str:
    """Whether parameters are those of the signature, each with a type."""
    title, wanted = asked_for(value)
    named = entries(sections(inspect.getdoc(value) or "").get(title, []))
    if (wanted or title == "Parameters") and list(named) != wanted:
        return f"{title} {[*named]}, not {wanted}"
    return "" if all(named.values()) else "one without a type"


def returned_fault(value: Any) -> str:
    """Whether what is returned is said, and nothing else."""
    if inspect.isclass(value):
        return ""
    returns = inspect.signature(value).return_annotation not in (None, "None")
    return "" if ("Returns" in sections(inspect.getdoc(value) or "")) == returns else "Returns"


@pytest.mark.parametrize(
    ("rule", "names"),
    [
        (first_sentence_fault, PUBLIC),
        (sections_fault, PUBLIC),
        (parameters_fault, CALLED),
        (returned_fault, CALLED),
    ],
)
def test_docstrings_are_those_of_numpydoc(rule, names):
    assert not {name: fault for name, value in names.items() if (fault := rule(value))}


@pytest.mark.parametrize(
    ("doc", "names"),
    [
        ("Do it.\n\nParameters\n----------\na, b : int\n    Two.\n**more : object\n    Others.", "a b more"),
        ("Do it.\n\nReturns\n-------\nint\n    One.", ""),
    ],
)
def test_parameters_are_read(doc, names):
    assert " ".join(entries(sections(doc).get("Parameters", []))) == names


def test_the_examples_run():
    """In a process of their own: some take up laws."""
    script = Path(__file__).with_name("docstring_examples.py")
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=True, timeout=300
    )
    examples = json.loads(done.stdout.splitlines()[-1])
    names = [n for n in cutbench.__all__ if callable(getattr(cutbench, n))]
    assert not {name: examples[name][1] for name in names if examples[name][1]}
    assert not [name for name in names if not examples[name][0]], "there is an example"


def test_run2d_names_each_parameter_of_the_default_model_with_its_unit():
    text = cutbench.run2d.__doc__
    for name, q in cutbench.load_case("gelatin").model.parameters().items():
        assert f"``{name}``" in text and (q.unit == "1" or f"({q.unit})" in text)
