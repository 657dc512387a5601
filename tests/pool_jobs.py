"""Jobs that other processes can import, for tests of the pool."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def double(x):
    return 2 * x


def wrong(x):
    raise ValueError(f"no {x}")


def deadly(marks: str, times: int):
    """Takes its process down so many times, then answers."""
    with open(marks, "a", encoding="utf-8") as file:
        file.write("x")
    if len(Path(marks).read_text(encoding="utf-8")) <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return "alive"


def slow(seconds: float):
    time.sleep(seconds)
    return seconds
