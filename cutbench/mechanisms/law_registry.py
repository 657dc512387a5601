"""The registry: the laws below this folder, those of installed packages, and those of a user's folders.

A file is found by being there; no list is kept. A package offers laws by the entry point group
``cutbench.mechanisms``, each entry a module with laws, or a package of such modules.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import inspect
import pkgutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

from cutbench.base.errors import BadInput
from cutbench.mechanisms.base import Mechanism
from cutbench.mechanisms.law_validation import BASES, refuse_incomplete

SLOTS = tuple(BASES)
GROUP = "cutbench.mechanisms"
#: The folders in use, in the order in which they were named.
_folders: tuple[Path, ...] = ()


@cache
def registry() -> dict[str, Mechanism]:
    """All mechanisms by name, in the order of slots and, within a slot, of rank and name.

    Raises BadInput for a law that lacks something, and for two of one name.
    """
    laws = [law for module in _modules() for law in laws_of(module)]
    laws.sort(key=lambda law: (SLOTS.index(law.slot), law.rank, law.name))
    by_name: dict[str, Mechanism] = {}
    for law in laws:
        other = by_name.setdefault(law.name, law)
        if other is not law and type(other) is not type(law):
            expected = f"a name that no other mechanism has; {file_of(other)} has it"
            raise BadInput(file=str(file_of(law)), key="name", value=law.name, expected=expected)
    for law in by_name.values():
        refuse_incomplete(law, by_name)
    return by_name


def known_mechanisms() -> dict[str, Mechanism]:
    """Return the known mechanisms by name: the laws that a model can be made of.

    They stand in the order of slots, the parts of the problem that laws belong to.

    Returns
    -------
    dict of str to Mechanism
        A copy of the registry: laws of the package, of installed packages, and of folders that were taken up.

    Examples
    --------
    >>> import cutbench
    >>> law = cutbench.known_mechanisms()["neo_hookean"]
    >>> law.slot, [q.name for q in law.parameters]
    ('bulk', ['G'])
    """
    return dict(registry())


def folders_in_use() -> tuple[Path, ...]:
    """The folders that laws are looked for in, in the order in which they were named."""
    return _folders


def look_in(folders: Iterable[Path]) -> None:
    """Look for laws in these folders from now on; files may have been edited."""
    global _folders
    _folders = tuple(folders)
    registry.cache_clear()


def file_of(law: Mechanism) -> Path:
    """The file that a law is written in."""
    return Path(inspect.getfile(type(law))).resolve()


def laws_of(module: ModuleType) -> list[Mechanism]:
    """The laws that a module defines: its own classes with a name and a slot."""
    return [
        item()
        for item in vars(module).values()
        if isinstance(item, type)
        and issubclass(item, Mechanism)
        and issubclass(item, tuple(base for base, _ in BASES.values()))
        and item.__module__ == module.__name__
        and "name" in vars(item)
    ]


def load_file(path: Path, helper: bool = False) -> ModuleType:
    """The module in a file of laws; a ``helper`` of others need not have any. Raises BadInput."""
    try:
        path.read_bytes()
    except OSError as error:
        expected = f"a file ({error.strerror})"
        raise BadInput(file=str(path), key="file", value=path.name, expected=expected) from error
    try:
        with _neighbours(path):
            module = importlib.import_module(f"{_package(path.parent)}.{path.stem}")
    except Exception as error:
        raise BadInput(
            file=str(path), key="import", value=f"{type(error).__name__}: {error}",
            expected="a file of Python that can be imported",
        ) from error  # fmt: skip
    if not helper and not laws_of(module):
        expected = "a class with a name, derived from Bulk, Cut, Blade, Skin, Support or Rig"
        raise BadInput(file=str(path), key="file", value=path.name, expected=expected)
    return module


def _package(folder: Path) -> str:
    """The package that the files of a folder are modules of.

    It has the folder and its content in its name: a file that was edited, or one of the same name elsewhere,
    is another module.
    """
    files = sorted(folder.glob("*.py"))
    content = b"|".join([str(folder).encode(), *(file.name.encode() + file.read_bytes() for file in files)])
    name = f"cutbench_laws_{hashlib.sha256(content).hexdigest()[:12]}"
    sys.modules.setdefault(name, ModuleType(name)).__path__ = [str(folder)]
    return name


@contextmanager
def _neighbours(path: Path) -> Iterator[None]:
    """In which what a file imports from beside it is known by its bare name, as to a script."""
    asked = {*_imported(path)} - {path.stem, __name__.partition(".")[0]} - sys.stdlib_module_names
    files = {name: file for name in asked if (file := path.with_name(f"{name}.py")).is_file()}
    beside = {name: load_file(file, helper=True) for name, file in files.items()}
    before, writes = {name: sys.modules.get(name) for name in beside}, sys.dont_write_bytecode
    sys.modules.update(beside)
    sys.dont_write_bytecode = True  # what is kept by the second would be taken for a file edited within it
    importlib.invalidate_caches()
    try:
        yield
    finally:
        sys.dont_write_bytecode = writes
        for name, module in before.items():
            sys.modules.pop(name)
            if module:
                sys.modules[name] = module


def files_of_laws(folder: Path) -> list[Path]:
    """The files of a folder that have laws; others are there for those. Raises BadInput."""
    files = sorted(folder.glob("[!_]*.py"))
    helpers = {name for file in files for name in _imported(file)}
    return [file for file in files if laws_of(load_file(file, helper=file.stem in helpers))]


def _imported(file: Path) -> Iterator[str]:
    """First parts of the names of modules that a file imports, if it can be read."""
    with suppress(OSError, SyntaxError, ValueError):  # said where it is loaded
        for node in ast.walk(ast.parse(file.read_bytes())):
            if isinstance(node, ast.Import):
                yield from (name.name.partition(".")[0] for name in node.names)
            elif isinstance(node, ast.ImportFrom):
                yield from [node.module.partition(".")[0]] if node.module else (n.name for n in node.names)


def _modules() -> Iterator[ModuleType]:
    for slot in SLOTS:
        yield from _inside(importlib.import_module(f"cutbench.mechanisms.{slot}"))
    for entry in entry_points(group=GROUP):
        try:
            module = entry.load()
        except Exception as error:
            expected = f"a module with laws ({error})"
            raise BadInput(key=f"entry point {entry.name}", value=entry.value, expected=expected) from error
        yield from _inside(module) if hasattr(module, "__path__") else (module,)
    for folder in _folders:
        yield from map(load_file, files_of_laws(folder))


def _inside(package: ModuleType) -> Iterator[ModuleType]:
    for info in pkgutil.iter_modules(package.__path__):
        if not info.name.startswith("_"):
            yield importlib.import_module(f"{package.__name__}.{info.name}")
