"""Where the next step is looked for: what happened some elements higher, and the front solved first."""
