"""`veriray bench all` and `veriray bench report`: what it costs, beside other renderers.

`scenarios` is the table of what is measured and what it should reach, `kinds` how, `run` the runner
that writes one JSON file a device, `report` the page made of it. `matrix` measures scenes made by
rule (`matrix_rules`). Other renderers run in processes
of their own (`peers`).
"""

from veriray.extras import need

need("veriray bench", "bench")

from .measure import BenchError
from .run import run
from .scenarios import SCENARIOS, Scenario, Target

__all__ = ["SCENARIOS", "BenchError", "Scenario", "Target", "run"]
