"""The two ways a command fails: the input was wrong (exit 2), or the computation failed (exit 1)."""

from __future__ import annotations


class CutbenchError(Exception):
    """This is the base of every error that cutbench raises on purpose.

    Attributes
    ----------
    exit_code : int
        What a command ends with: 1 where a computation failed, 2 where the input was wrong.

    Examples
    --------
    >>> import cutbench
    >>> try:
    ...     cutbench.load_case("no such material")
    ... except cutbench.CutbenchError as error:
    ...     print(type(error).__name__, error.exit_code)
    BadInput 2
    """

    exit_code = 1


class DoubtfulInput(UserWarning):
    """This warning says of input that can be used what there is to know before its results are believed.

    Examples
    --------
    >>> import warnings
    >>> import cutbench
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     found = cutbench.run2d("gelatin", G="7.5 MPa", depth="0.1 mm", h="0.8 mm", element="P1")
    >>> caught[0].category is cutbench.DoubtfulInput
    True
    """


def in_short(raw: object) -> object:
    """What a person wrote, in a message about its key: of a section its keys; nothing is missing."""
    if raw is None:
        return "(missing)"
    sections = raw if isinstance(raw, list) else [raw]
    if sections and isinstance(sections[0], dict) and sections[0]:
        raw = f"{'sections' if sections is raw else 'a section'} with {', '.join(map(str, sections[0]))}"
    return str(raw)[:60] if isinstance(raw, (list, tuple, dict)) else raw


class BadInput(CutbenchError):
    """This error says that what a person wrote cannot be used, and names what would be right.

    Its text names the file with the line, the key, the value and what was expected. These are its attributes,
    too.

    Parameters
    ----------
    key : str
        The parameter, option or section that is wrong, as it is written.
    value : object
        What was written there.
    expected : str
        What would be right, in words.
    file : str, optional
        The file in which it stands.
    line : int, optional
        The line of that file, counted from 1.

    Examples
    --------
    >>> import cutbench
    >>> try:
    ...     cutbench.load_case("gelatin", {"G": "7.5 mm"})
    ... except cutbench.BadInput as error:
    ...     print(error)
    G = '7.5 mm' cannot be used; expected a value with a unit, such as '1 kPa'
    """

    exit_code = 2

    def __init__(
        self, key: str, value: object, expected: str, *, file: str | None = None, line: int | None = None
    ):
        self.file, self.key, self.value, self.expected, self.line = file, key, value, expected, line
        super().__init__(self.message())

    def message(self) -> str:
        """Return the text of the error, put together from its parts.

        Returns
        -------
        str
            One line: file and line where they are known, the key, the value and what was expected.
        """
        where = "" if self.file is None else f"{self.file}: "
        if self.line is not None:
            where = f"{self.file or '<input>'}, line {self.line}: "
        value = in_short(self.value)
        shown = f"{value}"
        if isinstance(value, str):
            shown = f"'{value if value.isprintable() else repr(value)[1:-1]}'"
        return f"{where}{self.key} = {shown} cannot be used; expected {self.expected}"


def require(
    holds: object, key: str, value: object, expected: str, file: object = None, line: int | None = None
) -> None:
    """Raise BadInput unless what ``expected`` says ``holds``."""
    if not holds:
        raise BadInput(key, value, expected, file=None if file is None else str(file), line=line)


class ComputationFailed(CutbenchError):
    """This error says that a computation ended before its target.

    Parameters
    ----------
    message : str
        What failed, and where.
    result : object, optional
        What was reached until then, where there is anything.

    Examples
    --------
    >>> import cutbench
    >>> error = cutbench.ComputationFailed("no smaller step converges at 3 mm")
    >>> print(error, error.result)
    no smaller step converges at 3 mm None
    """

    def __init__(self, message: str, result: object = None):
        super().__init__(message)
        self.result = result
