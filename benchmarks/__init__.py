"""What runs cost on this machine, and how they stand what may happen: each module says how it is called."""
