"""Which computation a run is of: a digest of the source of all that computes it.

The engine counts, that is what the two marches (``ROOTS``) import, directly or not, and so do the laws in the
model with their bases and what those import. No list is kept: a module that is imported counts. Modules that
draw do not, nor do blank lines, lines of comment only, line endings, or where a file lies.
"""

from __future__ import annotations

import hashlib
import inspect
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache, cached_property, lru_cache
from pathlib import Path

from cutbench.base.errors import BadInput
from cutbench.case.model import Model

#: The modules that march a case to its end: a cut, and a strip in tension.
ROOTS = ("cutbench.run.runner", "cutbench.run.tension")

_FROM = re.compile(r"^[ \t]*from\s+([\w.]+)\s+import\s+(\((?:[^)#]|#[^\n]*)*\)|[^\n#]*)", re.M)
_IMPORT = re.compile(r"^[ \t]*import\s+([^\n#]+)", re.M)
_TYPING = re.compile(r"^if TYPE_CHECKING:\n(?:[ \t]+[^\n]*\n)+", re.M)
_DRAWS = re.compile(r"^[ \t]*(?:from|import)\s+matplotlib\b", re.M)


def read_text(path: Path) -> str:
    """A source file as it stands."""
    return path.read_text(encoding="utf-8")


def normalised(text: str) -> str:
    """``text`` without what no computation depends on: line endings, blank lines, lines of comment only."""
    lines = (line.rstrip() for line in text.splitlines())
    return "\n".join(line for line in lines if line and not line.lstrip().startswith("#")) + "\n"


class Sources:
    """The source files of this package and of laws, each read once by ``read``."""

    def __init__(self, read: Callable[[Path], str] = read_text):
        self._read = read
        self._package = Path(next(iter(sys.modules[__name__.partition(".")[0]].__path__)))
        self._texts: dict[Path, str] = {}
        self._places: dict[tuple[str, Path], Path | None] = {}

    @cached_property
    def engine(self) -> frozenset[Path]:
        """The files that count in every run."""
        roots = {name: self._module(name, self._package / "__init__.py") for name in ROOTS}
        if missing := [name for name, path in roots.items() if path is None]:
            raise LookupError(f"no module {', '.join(missing)}: ROOTS must name the modules that march")
        return self._closure(path for path in roots.values() if path)

    def law(self, kind: type) -> frozenset[Path]:
        """The files that count where a law of this class is in the model."""
        found = []
        for base in kind.__mro__:
            if base.__module__.partition(".")[0] not in sys.stdlib_module_names:
                file = getattr(sys.modules.get(base.__module__), "__file__", None)
                found.append(Path(file) if file else self._typed_in(base))
        return self._closure(found)

    def digest(self, laws: Iterable[type]) -> str:
        """12 hex digits of the engine and these laws."""
        files = self.engine.union(*(self.law(kind) for kind in laws))
        parts = sorted({hashlib.sha256(self._text(file).encode()).hexdigest() for file in files})
        return hashlib.sha256("".join(parts).encode()).hexdigest()[:12]

    def _text(self, path: Path) -> str:
        if path not in self._texts:
            self._texts[path] = normalised(self._read(path))
        return self._texts[path]

    def _typed_in(self, kind: type) -> Path:
        """A name for the source of a law that is in no file, such as one in a notebook. Raises BadInput."""
        try:
            text = inspect.getsource(kind)
        except (OSError, TypeError) as error:
            expected = "a law in a file, for its source counts in a run's identity"
            raise BadInput(key="mechanisms", value=kind.__qualname__, expected=expected) from error
        path = Path(f"<{kind.__module__}.{kind.__qualname__}>")
        self._texts[path] = normalised(text)
        return path

    def _closure(self, start: Iterable[Path]) -> frozenset[Path]:
        """``start`` and all that those files import from their own packages and from this one."""
        found: set[Path] = set()
        todo = list(start)
        while todo:
            path = todo.pop()
            if path not in found and not _DRAWS.search(self._text(path)):
                found.add(path)
                todo += self._imports(path)
        return frozenset(found)

    def _imports(self, path: Path) -> Iterator[Path]:
        for module, names in _imported(self._text(path)):
            for name in names or ("",):
                if target := self._target(module, name, path):
                    yield target

    def _target(self, module: str, name: str, importer: Path) -> Path | None:
        """The file in which ``name`` of ``module`` is made: a room's ``__init__`` only hands it on."""
        path = self._module(module, importer)
        if path is None or not name or path.name != "__init__.py":
            return path
        if inner := self._module(f"{module}.{name}" if module.strip(".") else module + name, importer):
            return inner
        if late := re.search(rf'"(\w+)": \[[^\]]*"{re.escape(name)}"', self._text(path)):  # lazy_loader's way
            return self._module(f".{late[1]}", path) or path
        for source, names in _imported(self._text(path)):
            if name in names:
                return self._target(source, name, path) or path
        return path

    def _module(self, name: str, importer: Path) -> Path | None:
        """The file of a module as ``importer`` names it; None for another package's."""
        key = name, importer.parent
        if key not in self._places:
            base = self._base(name, importer)
            place = base and base.joinpath(*name.strip(".").split("."))
            files = (place.with_name(f"{place.name}.py"), place / "__init__.py") if place else ()
            self._places[key] = next((path for path in files if path.is_file()), None)
        return self._places[key]

    def _base(self, name: str, importer: Path) -> Path | None:
        """The folder from which ``importer`` looks for a module."""
        top, dots = name.partition(".")[0], len(name) - len(name.lstrip("."))
        if dots:
            return importer.parents[dots - 1]
        if top == self._package.name:
            return self._package.parent
        if top in sys.stdlib_module_names or self._package in importer.parents:
            return None
        root = importer.parent
        while (root / "__init__.py").is_file():
            root = root.parent
        if root != importer.parent:
            return root if top == importer.relative_to(root).parts[0] else None
        # Of a file beside the law, but not of whatever is installed beside it.
        return None if root.name.endswith("-packages") else root


def _imported(text: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Modules that a file imports, each with the names that it takes from it."""
    text = _TYPING.sub("", text)
    for module, names in _FROM.findall(text):
        plain = re.sub(r"#[^\n]*|[()]", " ", names).split(",")
        yield module, tuple(name.split()[0] for name in plain if name.strip())
    for modules in _IMPORT.findall(text):
        for module in modules.split(","):
            yield module.split()[0], ()


@cache
def _sources() -> Sources:
    return Sources()


@lru_cache(maxsize=256)
def _digest(laws: tuple[type, ...]) -> str:
    return _sources().digest(laws)


def computation_of(model: Model) -> str:
    """12 hex digits of what computes ``model``, by the files that this process runs on.

    Raises BadInput for a law whose source cannot be read.
    """
    return _digest(tuple(type(law) for law in model.all))


def computation_here(mechanisms: Iterable[str]) -> str | None:
    """That of a model of these mechanisms; None where one of them is not known."""
    try:
        return computation_of(Model(tuple(mechanisms)))
    except BadInput:
        return None


def mesh_digest(mesh: str) -> str:
    """64 hex digits of a mesh file's content. Raises BadInput if it cannot be read."""
    try:
        return hashlib.sha256(Path(mesh).read_bytes()).hexdigest()
    except OSError as error:
        expected = f"a mesh file that can be read ({error.strerror})"
        raise BadInput(key="mesh", value=mesh, expected=expected) from error
