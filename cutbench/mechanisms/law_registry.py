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
from importlib.abc import Loader, MetaPathFinder
from importlib.metadata import entry_points
from importlib.util import spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

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
    found: dict[str, Mechanism] = {}
    for law in laws:
        other = found.setdefault(law.name, law)
        if other is not law and type(other) is not type(law):
            expected = f"a name that no other mechanism has; {file_of(other)} has it"
            raise BadInput(file=str(file_of(law)), key="name", value=law.name, expected=expected)
    for law in found.values():
        refuse_incomplete(law, found)
    return found


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
        with _neighbours(path.parent) as package:
            module = importlib.import_module(f"{package}.{path.stem}")
    except Exception as error:
        raise BadInput(
            file=str(path), key="import", value=f"{type(error).__name__}: {error}",
            expected="a file of Python that can be imported",
        ) from error  # fmt: skip
    if not helper and not laws_of(module):
        expected = "a class with a name, derived from Bulk, Cut, Blade, Skin, Support or Rig"
        raise BadInput(file=str(path), key="file", value=path.name, expected=expected)
    return module


class _Beside(MetaPathFinder, Loader):
    """Finds modules of a ``package`` by their bare ``names``, as a script finds what lies beside it."""

    def __init__(self, package: str, names: set[str]):
        self._package, self._names, self._specs = package, names, dict[str, Any]()

    def find_spec(self, name, path=None, target=None):
        return spec_from_loader(name, self) if name in self._names else None

    def create_module(self, spec):
        module = importlib.import_module(f"{self._package}.{spec.name}")
        self._specs[spec.name] = module.__spec__
        return module

    def exec_module(self, module):
        # It was executed under its own name, and keeps that.
        module.__spec__ = self._specs[module.__name__.rpartition(".")[2]]


@contextmanager
def _neighbours(folder: Path) -> Iterator[str]:
    """The package that the files of a folder are modules of; in the block they import one another.

    It has the folder and its content in its name: a file that was edited, or one of the same name elsewhere,
    is another module. By their bare names they are known in the block alone.
    """
    files = sorted(folder.glob("*.py"))
    parts = [
        str(folder).encode(),
        *(part for file in files for part in (file.name.encode(), file.read_bytes())),
    ]
    package = f"cutbench_laws_{hashlib.sha256(b'|'.join(parts)).hexdigest()[:12]}"
    if package not in sys.modules:
        sys.modules[package] = ModuleType(package)
        sys.modules[package].__path__ = [str(folder)]
    names = {file.stem for file in files} - {__name__.partition(".")[0]} - sys.stdlib_module_names
    hidden = {name: sys.modules.pop(name) for name in names & sys.modules.keys()}
    finder, writes = _Beside(package, names), sys.dont_write_bytecode
    sys.meta_path.insert(0, finder)
    sys.dont_write_bytecode = True  # what is kept by the second would be taken for a file edited within it
    importlib.invalidate_caches()
    try:
        yield package
    finally:
        sys.meta_path.remove(finder)
        sys.dont_write_bytecode = writes
        for name in names:
            sys.modules.pop(name, None)
        sys.modules.update(hidden)


def files_of_laws(folder: Path) -> list[Path]:
    """The files of a folder that have laws; others are there for those. Raises BadInput."""
    files = sorted(folder.glob("[!_]*.py"))
    helpers = {name for file in files for name in _imported(file)}
    return [file for file in files if laws_of(load_file(file, helper=file.stem in helpers))]


def _imported(file: Path) -> Iterator[str]:
    """First parts of the names of modules that a file imports, as far as it can be read."""
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
