"""``python -m cutbench`` is ``cutbench``."""

from cutbench.cli.main import main

if __name__ == "__main__":
    main()
