"""Which computation a run is of: a digest of the source of all that computes it.

The engine counts, that is what the two marches (``ROOTS``) import, directly or not, and so do the laws in the
model with their bases and what those import. No list is kept: a module that is imported counts. Modules that
draw do not. Of a file its syntax tree counts, without docstrings and imports for type checkers: comments,
layout, line endings and the place of the file change nothing.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import NamedTuple

from cutbench.base.errors import BadInput
from cutbench.case.model import Model
from cutbench.mechanisms import registry
from cutbench.mechanisms.own_laws import folders_of

#: The modules that march a case to its end: a cut, and a strip in tension.
ROOTS = ("cutbench.run.runner", "cutbench.run.tension")


def read_text(path: Path) -> str:
    """A source file as it stands."""
    return path.read_text(encoding="utf-8")


class Source(NamedTuple):
    """One file: the digest of its tree, the modules that it imports, each with the names that it takes from
    it, and of names that ``lazy_loader`` hands on the module that makes them."""

    digest: str
    imports: tuple[tuple[str, tuple[str, ...]], ...]
    handed_on: dict[str, str]

    @classmethod
    @cache
    def of(cls, text: str) -> Source:
        tree = ast.parse(text)
        imports: list[tuple[str, tuple[str, ...]]] = []
        handed_on: dict[str, str] = {}
        for node in ast.walk(tree):
            if isinstance(body := getattr(node, "body", None), list):
                body[:] = [each for each in body if not (_is_text(each) or _is_for_typing(each))]
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                imports.append(
                    ("." * node.level + (node.module or ""), tuple(name.name for name in node.names))
                )
            elif isinstance(node, ast.Import):
                imports += [(name.name, ()) for name in node.names]
            elif isinstance(node, ast.keyword) and node.arg == "submod_attrs":
                table = ast.literal_eval(node.value)
                handed_on |= {name: module for module, names in table.items() for name in names}
        words: list[str] = []
        _spell(tree, words)
        digest = hashlib.sha256("\n".join(words).encode("utf-8", "surrogatepass")).hexdigest()
        return cls(digest, tuple(imports), handed_on)

    @property
    def draws(self) -> bool:
        return any(module.partition(".")[0] == "matplotlib" for module, _ in self.imports)


def _is_text(node: ast.stmt) -> bool:
    """Whether it is a docstring, or any other text that stands by itself."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _is_for_typing(node: ast.stmt) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def _spell(node: object, words: list[str]) -> None:
    """Append the tree in words, without empty fields: versions of Python differ in those."""
    if isinstance(node, ast.AST):
        words.append(type(node).__name__)
        for name in node._fields:
            if (value := getattr(node, name, None)) not in (None, []):
                words.append(name)
                _spell(value, words)
        words.append(")")
    elif isinstance(node, list):
        for each in node:
            _spell(each, words)
        words.append("]")
    else:
        words.append(repr(node))


class Sources:
    """The source files of this package and of laws, each read once by ``read``."""

    def __init__(self, read: Callable[[Path], str] = read_text):
        self._read = read
        self._package = Path(next(iter(sys.modules[__name__.partition(".")[0]].__path__)))
        self._known: dict[Path, Source] = {}
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
        files = []
        for base in kind.__mro__:
            if base.__module__.partition(".")[0] not in sys.stdlib_module_names:
                file = getattr(sys.modules.get(base.__module__), "__file__", None)
                files.append(Path(file) if file else self._typed_in(base))
        return self._closure(files)

    def digest(self, laws: Iterable[type]) -> str:
        """12 hex digits of the engine and these laws."""
        # A user's files may have been edited since, and are loaded anew where they were.
        self._known = {path: source for path, source in self._known.items() if self._ours(path)}
        return self.digest_of(self.engine.union(*(self.law(kind) for kind in laws)))

    def digest_of(self, files: Iterable[Path]) -> str:
        """12 hex digits of files."""
        parts = sorted({self._source(file).digest for file in files})
        return hashlib.sha256("".join(parts).encode()).hexdigest()[:12]

    def own(self, kind: type) -> frozenset[Path]:
        """The files of a law that are not of this package."""
        return frozenset(path for path in self.law(kind) if not self._ours(path))

    def _ours(self, path: Path) -> bool:
        return self._package in path.parents

    def _source(self, path: Path) -> Source:
        if path not in self._known:
            self._known[path] = Source.of(self._read(path))
        return self._known[path]

    def _typed_in(self, kind: type) -> Path:
        """A name for the source of a law that is in no file, such as one in a notebook. Raises BadInput."""
        try:
            text = inspect.getsource(kind)
        except (OSError, TypeError) as error:
            expected = "a law in a file, for its source counts in a run's identity"
            raise BadInput(key="mechanisms", value=kind.__qualname__, expected=expected) from error
        path = Path(f"<{kind.__module__}.{kind.__qualname__}>")
        self._known[path] = Source.of(textwrap.dedent(text))
        return path

    def _closure(self, start: Iterable[Path]) -> frozenset[Path]:
        """``start`` and all that those files import from their own packages and from this one."""
        closure: set[Path] = set()
        todo = list(start)
        while todo:
            path = todo.pop()
            if path not in closure and not self._source(path).draws:
                closure.add(path)
                todo += self._imports(path)
        return frozenset(closure)

    def _imports(self, path: Path) -> Iterator[Path]:
        for module, names in self._source(path).imports:
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
        room = self._source(path)
        if name in room.handed_on:
            return self._module(f".{room.handed_on[name]}", path) or path
        for source, names in room.imports:
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
        if top in sys.stdlib_module_names or self._ours(importer):
            return None
        root = importer.parent
        while (root / "__init__.py").is_file():
            root = root.parent
        if root != importer.parent:
            return root if top == importer.relative_to(root).parts[0] else None
        # Of a file beside the law, but not of whatever is installed beside it.
        return None if root.name.endswith("-packages") else root


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


def own_sources(model: Model) -> dict[str, tuple[str, dict[str, Path]]]:
    """Of each law of ``model`` that is from a user's folder, a digest and its files, with those beside them
    that they import, by the place of their copies in a run's folder: one folder for each of the user's."""
    kinds = {name: type(registry()[name]) for name in model.mechanisms if folders_of((name,))}
    files = {name: _sources().own(kind) for name, kind in kinds.items()}
    every, digest = frozenset[Path]().union(*files.values()), _sources().digest_of
    roots = {path.parent for path in every}
    folders = {root: f"laws-{digest(path for path in every if path.parent == root)}" for root in roots}
    return {
        name: (digest(own), {f"{folders[path.parent]}/{path.name}": path for path in sorted(own)})
        for name, own in files.items()
    }


def mesh_digest(mesh: str) -> str:
    """64 hex digits of a mesh file's content. Raises BadInput if it cannot be read."""
    try:
        return hashlib.sha256(Path(mesh).read_bytes()).hexdigest()
    except OSError as error:
        expected = f"a mesh file that can be read ({error.strerror})"
        raise BadInput(key="mesh", value=mesh, expected=expected) from error
