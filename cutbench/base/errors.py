"""The two ways a command fails: the input was wrong (exit 2), or the computation failed (exit 1)."""

from __future__ import annotations


class CutbenchError(Exception):
    """Base of every error that cutbench raises on purpose."""

    exit_code = 1


class BadInput(CutbenchError):
    """What a person wrote cannot be used: names the file, the key, the value and what would be right."""

    exit_code = 2

    def __init__(
        self, key: str, value: object, expected: str, *, file: str | None = None, line: int | None = None
    ):
        self.file, self.key, self.value, self.expected, self.line = file, key, value, expected, line
        super().__init__(self.message())

    def message(self) -> str:
        where = "" if self.file is None else f"{self.file}: "
        if self.line is not None:
            where = f"{self.file or '<input>'}, line {self.line}: "
        shown = f"'{self.value}'" if isinstance(self.value, str) else f"{self.value}"
        return f"{where}{self.key} = {shown} cannot be used; expected {self.expected}"


class ComputationFailed(CutbenchError):
    """A run ended before its target; what it reached is kept in ``result`` where there is one."""

    def __init__(self, message: str, result: object = None):
        super().__init__(message)
        self.result = result
