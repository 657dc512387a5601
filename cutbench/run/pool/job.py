"""What a pool is given, and what it gives back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Job:
    """A function that other processes can import, and what it is called with; ``key`` is for who asks."""

    key: Any
    call: Callable[..., Any]
    args: tuple = ()


@dataclass(frozen=True)
class Done:
    """A job that has ended: with a value, or with the error that it raised or that took its process."""

    key: Any
    value: Any = None
    error: BaseException | None = None

    def result(self) -> Any:
        """The value. Raises the job's error."""
        if self.error is not None:
            raise self.error
        return self.value
