"""Newton, steps, linear solvers and the energy ledger."""
