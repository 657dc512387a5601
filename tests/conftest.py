"""One thread a process: the suite runs several at once, and threads that wait for each other would spin."""

import os

from cutbench.threads import ONE_THREAD

for name, count in ONE_THREAD.items():
    os.environ.setdefault(name, count)
