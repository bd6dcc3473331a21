"""Many closed loops with the nonlinear plant in one call, for Monte Carlo and campaigns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.estimate.batch import processors
from ambkit.simulation.plans import Counts, Planned, Plans
from ambkit.simulation.run_figures import FIGURES, FLAGS

CHUNK = 256  #: Axes per batch: a multiple of the number of SIMD lanes.


@dataclass(frozen=True)
class Many:
    """Results of many runs, in order."""

    #: (runs,) By the names of :data:`FIGURES`, in SI; NaN where one does not apply.
    figures: Mapping[str, Array]
    #: (runs,) By the names of :class:`ambkit.Status` in lower case: number of samples with the
    #: flag.
    status: Mapping[str, Counts]

    def __len__(self) -> int:
        return len(self.figures["touched"])

    def columns(self) -> dict[str, Array | Counts]:
        """All figures and, as ``samples_missing`` and so on, the counts of flags."""
        return {**self.figures, **{f"samples_{name}": n for name, n in self.status.items()}}


def simulate_many(
    runs: Iterable[Planned],
    *,
    settling: float = 0.0,
    band: float = 0.05,
    threads: int | None = None,
    instructions: str | None = None,
    done: Callable[[int], None] | None = None,
) -> Many:
    """Simulate many closed loops and evaluate each against the truth, without storing samples.

    The results have the bits of `simulate_run`, for any order, threads, lanes and batch.

    Parameters
    ----------
    runs : iterable of Planned
        Any mixture of machines, consumed one by one, so that 10^6 runs need not be in memory. Plain
        runs of one axis are computed side by side in vectors.
    settling : float
        Time at the start of each run that is excluded from the errors [s]; the first sample always
        is.
    band : float
        Control error below which a rotor has recovered, relative to its clearance.
    threads : int, optional
        Default: all that are available to the process.
    instructions : str, optional
        Vector instructions, one of `ambkit.estimate.batch.instruction_sets`; default: the fastest.
    done : callable, optional
        Called periodically with the number of runs completed since the last call.

    Returns
    -------
    Many

    Raises
    ------
    ValueError
        A run has no sample after the settling time.

    Examples
    --------
    >>> machine = ambkit.preset("zittau_axial")
    >>> scenario = ambkit.Scenario(duration=0.1, seed=1)
    >>> kalman = ambkit.KalmanFilter(machine)
    >>> runs = [Planned(machine, scenario, kalman, number=k) for k in range(20)]
    >>> simulate_many(runs).figures["f_d_rms"].shape
    (20,)
    """
    plans = Plans(settling, band, processors() if threads is None else threads, instructions)
    parts: list[tuple[Array, Counts]] = []
    # While some are simulated, the next ones are planned: C needs no interpreter.
    ahead: Future[tuple[Array, Counts]] | None = None
    last = 0
    with ThreadPoolExecutor(1) as pilot:

        def finish() -> None:
            if ahead is not None:
                parts.append(ahead.result())
                if done is not None:
                    done(last)

        for chunk in _chunks(runs):
            ready = plans.ready(chunk)
            finish()
            ahead, last = pilot.submit(plans.simulate, ready), len(chunk)
        finish()
    figures, flags = zip(*parts, strict=True) if parts else ((), ())
    return Many(_columns(FIGURES, figures, float), _columns(FLAGS, flags, np.int64))


def _chunks(runs: Iterable[Planned]) -> Iterator[list[Planned]]:
    """Return the runs in batches, which are smaller for longer runs."""
    rest = iter(runs)
    for first in rest:
        yield [first, *islice(rest, CHUNK // len(first.machine.axes) - 1)]


def _columns(names: Iterable[str], parts: Sequence[NDArray[Any]], kind: Any) -> dict[str, Any]:
    """Return the columns of tables stacked vertically."""
    return {
        name: np.concatenate([part[:, k] for part in parts]) if parts else np.empty(0, kind)
        for k, name in enumerate(names)
    }
