"""``python -m cutbench`` is ``cutbench``."""

from cutbench.cli import main

if __name__ == "__main__":
    main()
