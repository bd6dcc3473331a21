"""Write the recorded runs anew: ``python -m tests.golden``."""

from .axes import TABLES, write_rows
from .runs import RUNS, write

for name, run in RUNS.items():
    write(name, run())
    print(f"wrote tests/golden/{name}.csv")
for name in TABLES:
    write_rows(name)
    print(f"wrote tests/golden/{name}.csv")
