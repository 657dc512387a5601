"""What a run costs on this machine: ``python -m benchmarks [--quick] [--json FILE]``."""
