"""What the chapters share: the bearing, the trained experts, the filters, and the step response."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ambkit.control.control import Control
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.noise_model import FilterNoise
from ambkit.fuzzy.expert import Expert
from ambkit.fuzzy.training import train
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ClosedLaw, ConstantStiffness, MagnetModel
from ambkit.machine.stiffness import StiffnessMap, stiffness_map
from ambkit.result.report import Axis
from ambkit.result.report.blocks import Chapter
from ambkit.simulation.run import Run, simulate_run
from ambkit.simulation.scenario import Scenario
from ambkit.simulation.waveforms import Constant, Step
from paper.printed import INITIAL_WIDTH
from paper.verdicts import SummaryRow

SEEDS = 20
"""Runs that a figure of merit is the mean of."""

STEP_TIME, LOAD_TIME, DURATION = 0.05, 0.25, 0.5  # s; the paper gives none of them

# f_d as a random walk of 1e-2 N^2 a sample of 0.1 ms. The paper: "experimentally initialized".
DISTURBANCE = 100.0  # N^2/s

# A textbook PID, as the paper gives none: all of the reference goes to kp.
CONTROLLER = Control(
    kp=3000.0, ki=20000.0, kd=12.0, derivative_filter=0.2e-3, anti_windup=25e-3,
    setpoint_weight=1.0, feedback="estimate",
)  # fmt: skip

WIDE_BOX = 0.8e-3  # m: the step of 0.5 mm overshoots the box of the paper's rules, 0.5 mm

TIME = Axis("time", "s")
TIME_MS = Axis("time", "ms", 1e3)
POSITION = Axis("displacement $x$", "mm", 1e3)
CURRENT = Axis("control current $i_u$", "A")


@dataclass(frozen=True)
class Part:
    """One chapter of the reproduction, its lines of the summary, and the tables it writes."""

    chapter: Chapter
    rows: Sequence[SummaryRow]
    tables: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Study:
    """The paper's rig, and everything that more than one chapter needs; made when first asked."""

    seed: int = 0

    @cached_property
    def bearing(self) -> Machine:
        """The paper's rig."""
        return Machine.preset("zittau_axial")

    @cached_property
    def noise(self) -> FilterNoise:
        """Q and R, the same for every filter."""
        return FilterNoise(disturbance=DISTURBANCE)

    @cached_property
    def law(self) -> ClosedLaw:
        """The closed force law of the bearing."""
        return ClosedLaw(self.bearing)

    @cached_property
    def constant(self) -> ConstantStiffness:
        """The stiffnesses of the origin."""
        return ConstantStiffness.of(self.bearing)

    @cached_property
    def map(self) -> StiffnessMap:
        """k_i and k_s at the 25 operating points."""
        return stiffness_map(self.bearing)

    @cached_property
    def descended(self) -> Expert:
        """Widths by steepest gradient from 0.4, inputs in A and mm, as far as the paper tells."""
        return train(self.map, method="steepest-gradient", scaling="unit", widths=INITIAL_WIDTH)

    @cached_property
    def widths(self) -> Expert:
        """Widths by least squares."""
        return train(self.map)

    @cached_property
    def expert(self) -> Expert:
        """Widths and weights by least squares: the expert that the adaptive filter asks."""
        return train(self.map, weights=True)

    @cached_property
    def wide_expert(self) -> Expert:
        """As many rules, spread over all that the step of 0.5 mm overshoots to."""
        wide = stiffness_map(self.bearing, displacements=np.linspace(-WIDE_BOX, WIDE_BOX, 5))
        return train(wide, weights=True)

    @property
    def filters(self) -> dict[str, Callable[[], KalmanFilter]]:
        """The filters that are compared, by the name of their signal in the figures."""
        # With the sampled model of the paper, eq. 19 as printed.
        return self.filters_of(self.bearing, as_printed=True)

    def filters_of(
        self, bearing: Machine, *, as_printed: bool
    ) -> dict[str, Callable[[], KalmanFilter]]:
        """Return the same filters for a bearing with another sensor, or by the exact model."""
        knows: dict[str, Callable[[], MagnetModel]] = {
            "estimate linear": lambda: self.constant,
            "estimate adaptive": lambda: self.expert,
            "estimate wide box": lambda: self.wide_expert,
            "estimate closed law": lambda: self.law,
        }

        def made(magnet: Callable[[], MagnetModel]) -> Callable[[], KalmanFilter]:
            return lambda: KalmanFilter(bearing, magnet(), noise=self.noise, as_printed=as_printed)

        return {name: made(magnet) for name, magnet in knows.items()}

    def scenario(
        self, step: float, load: float = 0.0, *, noise: bool = True, seed: int | None = None
    ) -> Scenario:
        """Step of the reference [m] at 50 ms, and, where there is one, a load [N] at 250 ms."""
        return Scenario(
            duration=DURATION,
            reference=Step(amplitude=step, time=STEP_TIME),
            disturbance=Step(amplitude=load, time=LOAD_TIME) if load else Constant(value=0.0),
            controller=CONTROLLER,
            noise=noise,
            seed=self.seed if seed is None else seed,
        )

    def run(self, scenario: Scenario, signal: str = "estimate linear") -> Run:
        """Simulate with one of the filters in the loop."""
        return simulate_run(self.bearing, scenario, estimator=self.filters[signal]())

    @property
    def one_run(self) -> str:
        """What a caption says of a picture of a single run."""
        return f"One run, seed {self.seed}."

    @property
    def seeds(self) -> range:
        """Seeds of what is done more than once."""
        return range(self.seed, self.seed + SEEDS)

    def over_seeds(
        self, figures: Callable[[int], Iterable[float]], count: int = SEEDS
    ) -> NDArray[np.float64]:
        """Find some figures of a run for one seed after the other, (figures, seeds)."""
        with ThreadPoolExecutor(2) as pool:
            rows = pool.map(lambda seed: tuple(figures(seed)), range(self.seed, self.seed + count))
            return np.array(list(rows), dtype=float).T


def row(
    id: str,
    what: str,
    paper: float | str | None,
    ours: float | str | None,
    unit: str,
    verdict: str,
    runs: int | None = None,
) -> SummaryRow:
    """Build one line of the summary: of what chance has no part in, or of so many runs."""
    return SummaryRow(
        id=id, what=what, paper=paper, ours=ours, unit=unit, verdict=verdict, spread=None, runs=runs
    )


def mean_row(
    id: str, what: str, ours: NDArray[np.float64], unit: str, verdict: str = "not given"
) -> SummaryRow:
    """Build one line of the summary: mean and standard deviation over the seeds."""
    line = row(id, what, None, float(ours.mean()), unit, verdict, ours.size)
    line["spread"] = float(ours.std(ddof=1))
    return line


def smaller(ours: NDArray[np.float64], other: NDArray[np.float64] | float) -> str:
    """Verdict of an error beside another, seed by seed."""
    return "better" if float(np.mean(ours - other)) < 0 else "worse"


def reached(holds: bool) -> str:
    """Verdict of a goal."""
    return "reached" if holds else "missed"


def agrees(holds: bool) -> str:
    """Verdict of a comparison with the paper's own figure."""
    return "agrees" if holds else "differs"
