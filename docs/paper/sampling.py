"""Chapter 7: the sampled model, as printed and exact (eq. 19)."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ambkit.data.record import Record
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.kalman import ExtendedKalmanFilter
from ambkit.judge.comparison import compare
from ambkit.machine.machine import Machine
from ambkit.result.report import Axis, Figure, Line, Panel
from ambkit.result.report.blocks import Chapter, Equation, FigureBlock, Remark, TableBlock, Text
from ambkit.simulation.run import simulate
from paper.study import SEEDS, STEP_TIME, TIME_MS, Part, Study, mean_row, smaller

Array = NDArray[np.float64]

STEP, LOAD = 0.5e-3, 3.0  # m, N
PRINTED, EXACT = "as printed", "exact"
SLOW, FAST = "the paper's sensor", "a fast sensor"

WINDOW = 20e-3
"""Of the step that is shown [s]."""


def sampling(study: Study) -> Part:
    """Run both filters along the same records, with two sensors."""
    bearings = {SLOW: study.bearing, FAST: fast_sensor(study.bearing)}
    errors = {
        name: study.over_seeds(partial(_errors, study, bearing))
        for name, bearing in bearings.items()
    }
    raw, printed, exact, _, _ = 1e6 * errors[FAST]
    alike = {name: _alike(study, bearing) for name, bearing in bearings.items()}
    gained = 100 * (1 - errors[SLOW][2] / errors[SLOW][1])
    ahead = {name: 1e6 * lead(bearing) for name, bearing in bearings.items()}
    return Part(
        Chapter(
            id="sampling",
            title="The sampled model",
            lead="Eq. 19 holds the position over a sample in the sensor's lag. An exact model "
            "with the force held costs two more coefficients, and is valid for every sensor.",
            blocks=[
                Text("The chapters so far filter by the equations as the paper prints them. In "
                     "eq. 19 the position at the sensor's input is constant over a sample, while "
                     "the rotor moves. So every estimate is ahead of the rotor, at a "
                     r"constant speed by $T/(1 - e^{-T/T_\mathrm{Sen}}) - T_\mathrm{Sen}$: "
                     f"{ahead[SLOW]:.0f} µs on the paper's rig, "
                     f"{ahead[FAST]:.0f} µs for a sensor of 20 µs, "
                     "nearly a whole sample. The innovations do not show it, as prediction "
                     "and measurement share the error: only a comparison with the truth does."),
                Text("With the force held over the sample, the lag follows the parabola on which "
                     r"the rotor moves. With $a = 1 - e^{-T/T_\mathrm{Sen}}$ and all force $F$ on "
                     "the rotor, taken at the mean displacement $x + v T/2$, that is exact:"),
                Equation(r"x_M(k+1) = (1 - a) x_M + K_\mathrm{Sen} \left[ a x + "
                         r"(T - T_\mathrm{Sen} a) v + \left( \frac{T^2}{2} - T T_\mathrm{Sen} + "
                         r"T_\mathrm{Sen}^2 a \right) \frac{F}{m} \right]", "exact, for eq. 19"),
                FigureBlock(_figure(study, bearings)),
                _table(errors),
                Remark("A filter worse than its own sensor",
                       "With a sensor of 20 µs and 0.5 µm the filter as printed has "
                       f"{printed.mean():.2f} µm where the raw measurement has "
                       f"{raw.mean():.2f} µm; the exact one has {exact.mean():.2f} µm. On the "
                       "paper's own rig the exact model reduces the position error by "
                       f"{gained.mean():.1f} %. It is the default everywhere except in the "
                       "chapters that reproduce the paper."),
                Text("Filters with different magnet models still hardly differ in position. "
                     "With the exact model and linear, adaptive and closed law each in its "
                     f"own loop, the worst of a run is {alike[SLOW].mean():.1f} ± "
                     f"{alike[SLOW].std(ddof=1):.1f} % above the best with the paper's sensor, "
                     f"and {alike[FAST].mean():.1f} ± {alike[FAST].std(ddof=1):.1f} % with the "
                     "fast one."),
            ],
        ),
        [
            mean_row("sampling.raw", "Sensor 20 µs, 0.5 µm: raw sensor", raw,
                     "µm rms"),
            mean_row("sampling.printed", "Sensor 20 µs, 0.5 µm: eq. 19 as printed",
                     printed, "µm rms", smaller(printed, raw)),
            mean_row("sampling.exact",
                     "Sensor 20 µs, 0.5 µm: exact model",
                     exact, "µm rms",
                     smaller(exact, raw)),
            mean_row("sampling.alike", "Worst over best filter, x: exact "
                     "model", alike[SLOW], "%"),
            mean_row("sampling.paper_rig", "Paper's rig: gain by exact model",
                     gained, "%"),
        ],
    )  # fmt: skip


def fast_sensor(bearing: Machine) -> Machine:
    """Return a bearing with an ordinary eddy-current probe: 20 µs, 0.5 µm."""
    return bearing.replace(sensor__lag=20e-6, sensor__noise_variance=0.25e-12)


def lead(bearing: Machine) -> float:
    """Return how far eq. 19 puts an estimate ahead of the rotor [s]."""
    T, lag = bearing.sampling_time, bearing.sensor.lag
    return T / -math.expm1(-T / lag) - lag


def _record(study: Study, bearing: Machine, seed: int) -> Record:
    """Return the step, in a loop that no filter takes part in."""
    scenario = study.scenario(STEP, LOAD, seed=seed)
    measured = scenario.controller.model_copy(update={"feedback": "measurement"})
    return simulate(bearing, scenario.model_copy(update={"controller": measured}))


def _estimates(study: Study, bearing: Machine, record: Record) -> dict[str, Estimate]:
    return {
        name: ExtendedKalmanFilter(
            bearing, noise=study.noise, as_printed=name == PRINTED
        ).run(record)
        for name in (PRINTED, EXACT)
    }  # fmt: skip


def _errors(study: Study, bearing: Machine, seed: int) -> tuple[float, ...]:
    """Position of raw sensor, as printed, exact [m]; disturbance force of both [N]."""
    record = _record(study, bearing, seed)
    estimates = _estimates(study, bearing, record)
    settled = record.t > STEP_TIME / 2

    def rms(error: Array) -> float:
        return float(np.sqrt(np.mean(error[settled] ** 2)))

    raw = record["y"] / bearing.sensor.gain - record["x"]
    return (
        rms(raw),
        *(rms(estimates[name].x - record["x"]) for name in (PRINTED, EXACT)),
        *(rms(estimates[name].f_d - record["f_d"]) for name in (PRINTED, EXACT)),
    )


def _alike(study: Study, bearing: Machine) -> Array:
    """By how much the worst position of a run is above the best, (seeds,) [%]."""
    filters = study.filters_of(bearing, as_printed=False)
    scores = compare(bearing, study.scenario(STEP, LOAD), filters, study.seeds)
    position = np.array([score.figures["x"] for score in scores.values()])
    return np.asarray(100 * (position.max(axis=0) / position.min(axis=0) - 1))


def _table(errors: dict[str, Array]) -> TableBlock:
    def entry(values: Array, factor: float, digits: int) -> str:
        scaled = factor * values
        return f"{scaled.mean():.{digits}f} ± {scaled.std(ddof=1):.{digits}f}"

    rows = []
    for name, (raw, x_printed, x_exact, f_printed, f_exact) in errors.items():
        rows += [
            [name, "raw sensor", entry(raw, 1e6, 2), "–"],
            [name, PRINTED, entry(x_printed, 1e6, 2), entry(f_printed, 1.0, 3)],
            [name, EXACT, entry(x_exact, 1e6, 2), entry(f_exact, 1.0, 3)],
        ]
    return TableBlock(
        id="sampling_table",
        title=f"Root mean square errors, mean and standard deviation over {SEEDS} seeds",
        headers=["sensor", "extended Kalman filter", "x [µm]", r"$f_d$ [N]"],
        rows=rows,
        caption="Step of 0.5 mm and load of 3 N, the controller fed by the measurement, so that "
        "all see the same records. The fast sensor: 20 µs, 0.5 µm.",
    )


def _figure(study: Study, bearings: dict[str, Machine]) -> Figure:
    panels: list[Panel] = []
    for name, bearing in bearings.items():
        record = _record(study, bearing, study.seed)
        shown = record.between(STEP_TIME - 2e-3, STEP_TIME + WINDOW)
        estimates = _estimates(study, bearing, record)
        part = np.searchsorted(record.t, shown.t)
        panels.append(Panel(TIME_MS, Axis(f"error of $x$, {name}", "µm", 1e6), [
            Line(shown.t, shown["y"] / bearing.sensor.gain - shown["x"], signal="measured",
                 label="raw sensor" if not panels else ""),
            Line(shown.t, estimates[PRINTED].x[part] - shown["x"], signal="estimate linear",
                 label=PRINTED if not panels else ""),
            Line(shown.t, estimates[EXACT].x[part] - shown["x"], signal="estimate closed law",
                 label=EXACT if not panels else ""),
        ]))  # fmt: skip
    return Figure(
        id="sampling_error",
        title="Error of the position during the step of 0.5 mm",
        caption="The same extended filter with both sampled models, and the raw sensor. Top: "
        "with the paper's slow sensor the noise hides the lead. Bottom: with a fast "
        "sensor the filter as printed is worse than the raw sensor wherever the rotor "
        f"moves. {study.one_run}",
        panels=panels,
    )
