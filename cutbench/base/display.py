"""How results show themselves: a short text, a table and a picture in a notebook, frames, files.

What is heavy stands in a module that a class names and that is loaded when it is first used.
"""

from __future__ import annotations

import html
import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def _pictures() -> Any:
    return importlib.import_module("cutbench.base.figure_style")


class Displayed:
    """This is the base of results that can be drawn, tabulated and, where it makes sense, saved."""

    #: The module with the functions ``summary_lines``, ``plot``, ``table`` and, perhaps, ``dataset`` and
    #: ``write``.
    display_module: ClassVar[str]

    @property
    def _display(self) -> Any:
        return importlib.import_module(self.display_module)

    def _function(self, name: str) -> Any:
        found = getattr(self._display, name, None)
        if found is None:
            raise AttributeError(f"a {type(self).__name__} has nothing of that kind")
        return found

    def __repr__(self) -> str:
        head, *lines = self._display.summary_lines(self)
        width = max((len(name) for name, _ in lines), default=0)
        shown = [f"  {name:<{width}}  {text}" for name, text in lines]
        return "\n".join([f"{type(self).__name__}: {head}", *shown])

    def _repr_html_(self) -> str:
        head, *lines = self._display.summary_lines(self)
        rows = "".join(
            f'<tr><th style="text-align:left">{html.escape(name)}</th>'
            f'<td style="text-align:left">{html.escape(text)}</td></tr>'
            for name, text in lines
        )
        drawn = ""
        if hasattr(self._display, "plot"):
            drawn = f'<div style="max-width:36em">{_pictures().svg_of(lambda ax: self.plot(ax))}</div>'
        return f"<div><b>{html.escape(head)}</b><table>{rows}</table>{drawn}</div>"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the result into axes of matplotlib; nothing is shown or saved.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw; axes of a new figure unless given.

        Returns
        -------
        matplotlib.axes.Axes
            The axes that were drawn into.
        """
        draw = self._function("plot")
        ax = _pictures().own_axes() if ax is None else ax
        draw(self, ax)
        return ax

    def to_dataframe(self) -> Any:
        """Make a table of the result for pandas, which must be installed.

        Returns
        -------
        pandas.DataFrame
            Units stand in the names of columns.
        """
        return importlib.import_module("pandas").DataFrame(dict(self._function("table")(self)))

    def to_xarray(self) -> Any:
        """Make a data set of the result for xarray.

        Returns
        -------
        xarray.Dataset
            Units stand in the attributes of its variables.
        """
        return self._function("dataset")(self)

    def save(self, folder: str | Path) -> Path:
        """Write the result into a folder, as the command line does; ``cutbench.load`` reads it back.

        Parameters
        ----------
        folder : str or Path
            The folder, made where it is not there.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        BadInput
            For a folder that cannot be written.
        """
        self._function("write")(self, Path(folder))
        return Path(folder)
