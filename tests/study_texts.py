"""Studies as texts, for tests of what is read and what is refused."""

GOOD = """title = "A small study"
base = "gelatin"

[parameters]
G = "10 kPa"

[numerics]
h = "0.5 mm"

[[axis]]
name = "cohesion"
from = 1.0
to = 100.0
points = 3
scale = "log"

[[axis]]
name = "speed"
values = ["0.01 mm/s", "1.2 mm/min"]

[regime]
drop = 0.2

[plot]
mark = ["meat"]
"""


SAMPLED = """mode = "sobol"
base = "gelatin"
[[axis]]
name = "cohesion"
from = 1.0
to = 100.0
scale = "log"
[[axis]]
name = "speed"
values = ["0.01 mm/s", "0.02 mm/s"]
[[axis]]
mechanism = "adhesion"
[sample]
points = 16
seed = 3
"""


BOUNDARY = """mode = "boundary"
base = "gelatin"
[[axis]]
name = "cohesion"
from = 1.0
to = 16.0
scale = "log"
tolerance = "1/16"
[[axis]]
name = "speed"
from = "0.01 mm/s"
to = "0.1 mm/s"
tolerance = 0.125
[[axis]]
name = "adhesion"
values = [0.0, 0.1]
[boundary]
runs = 60
"""
