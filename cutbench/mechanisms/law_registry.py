"""The registry: the laws below this folder, those of installed packages, and those of a user's folders.

A file is found by being there; no list is kept. A package offers laws by the entry point group
``cutbench.mechanisms``, each entry a module with laws, or a package of such modules.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import pkgutil
import sys
from collections.abc import Iterable, Iterator
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


def load_file(path: Path) -> ModuleType:
    """The module in a file of laws. Raises BadInput."""
    try:
        content = path.read_bytes()
    except OSError as error:
        expected = f"a file ({error.strerror})"
        raise BadInput(file=str(path), key="file", value=path.name, expected=expected) from error
    # A file that was edited is another module.
    digest = hashlib.sha256(str(path).encode() + content).hexdigest()
    name = f"cutbench_laws_{digest[:12]}_{path.stem}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise BadInput(file=str(path), key="file", value=path.name, expected="a file of Python with laws")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise BadInput(
            file=str(path), key="import", value=f"{type(error).__name__}: {error}",
            expected="a file of Python that can be imported",
        ) from error  # fmt: skip
    if not laws_of(module):
        del sys.modules[name]
        expected = "a class with a name, derived from Bulk, Cut, Blade, Skin, Support or Rig"
        raise BadInput(file=str(path), key="file", value=path.name, expected=expected)
    return module


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
        for path in sorted(folder.glob("[!_]*.py")):
            yield load_file(path)


def _inside(package: ModuleType) -> Iterator[ModuleType]:
    for info in pkgutil.iter_modules(package.__path__):
        if not info.name.startswith("_"):
            yield importlib.import_module(f"{package.__name__}.{info.name}")
