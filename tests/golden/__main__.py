"""Write the recorded runs anew: ``python -m tests.golden``."""

from .runs import RUNS, write

for name, run in RUNS.items():
    write(name, run())
    print(f"wrote tests/golden/{name}.csv")
