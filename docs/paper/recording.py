"""Chapter 10: the filters on a recording of a real rig, where nobody knows the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ambkit.data.record import Record
from ambkit.data.recordings import folder
from ambkit.estimate.constant_velocity import tune
from ambkit.estimate.errors import LAGS, Whiteness, prediction_error, whiteness
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.noise_model import FilterNoise
from ambkit.fuzzy.expert import Expert
from ambkit.fuzzy.training import train
from ambkit.identification.forces.lift_off import LiftOff, LiftOffFit, fit_lift_off, load_points
from ambkit.judge.comparison import ConstantVelocityFilter
from ambkit.judge.evaluation import Evaluation, evaluate
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ClosedLaw, ConstantStiffness, MagnetModel
from ambkit.machine.parts import GRAVITY
from ambkit.machine.stiffness import stiffness_map
from ambkit.result.report import Axis, Figure, Line, Panel, Points, Rule
from ambkit.result.report.blocks import Chapter, FigureBlock, Remark, TableBlock, Text
from ambkit.result.report.style import style_of
from ambkit.workflow.tuning import tune_disturbance
from paper.study import POSITION, TIME, Part, Study, row

WORK_GAP = 0.010  # m: the ball's distance from the magnet at x = 0
FIT_RANGE = (0.004, 0.016)  # m: where one law fits the lift-off points
LOOP_RANGE = (0.008, 0.012)  # m: where the ball moves in the closed loop
BOX = (0.4, 3e-3)  # A, m: where the rules of its expert are
TUNED_ON = 1.5  # s of each log; judged on what follows
LOGS = {
    "sinus_no_filter": "no filter in the rig's loop",
    "sinus_kalman": "the rig's own Kalman filter in its loop",
}
FILTERS = ("estimate linear", "estimate adaptive", "estimate closed law")


@dataclass(frozen=True)
class Rig:
    """The rig as its own recordings tell it."""

    @cached_property
    def points(self) -> list[LiftOff]:
        """All lift-off points."""
        return load_points(folder() / "lift_off_points.csv")

    @cached_property
    def fit(self) -> LiftOffFit:
        """The law fitted to the usable points in the range."""
        mass = Machine.preset("inteco_ml").rotor.mass
        return fit_lift_off(self.points, mass, gap_range=FIT_RANGE)

    @cached_property
    def bearing(self) -> Machine:
        """The preset with the law just fitted. The logs count iu from the preset's bias current."""
        gap, _ = self.fit.operating_point(WORK_GAP)
        return Machine.preset("inteco_ml").replace(
            magnet__magnet_constant=self.fit.magnet_constant, magnet__air_gap=gap
        )

    @cached_property
    def measurement(self) -> float:
        """Measurement noise [m^2]: at rest before lift-off, where the ball later moves."""
        low, high = LOOP_RANGE
        return float(np.mean([p.noise_variance for p in self.points if low <= p.gap <= high]))

    @cached_property
    def expert(self) -> Expert:
        """25 rules for the range in which the ball moves."""
        current, displacement = BOX
        return train(
            stiffness_map(
                self.bearing,
                currents=np.linspace(-current, current, 5),
                displacements=np.linspace(-displacement, displacement, 5),
            ),
            weights=True,
        )

    def maker(self, name: str) -> Callable[[float], KalmanFilter]:
        """Return what builds a filter from the growth of its disturbance force [N^2/s]."""
        magnets: dict[str, MagnetModel] = {
            "estimate linear": ConstantStiffness.of(self.bearing),
            "estimate adaptive": self.expert,
            "estimate closed law": ClosedLaw(self.bearing),
        }
        return lambda growth: KalmanFilter(
            self.bearing,
            magnets[name],
            noise=FilterNoise(measurement=self.measurement, disturbance=growth),
        )

    def evaluated(self, record: Record, name: str) -> tuple[float, Evaluation]:
        """Tune on the beginning of the record, judge on the rest; also the growth found."""
        make = self.maker(name)
        beginning = record.between(None, record.t[0] + TUNED_ON)
        growth = tune_disturbance(self.bearing, beginning, make).intensity
        return growth, evaluate(make(growth), record, settling=TUNED_ON)

    def naive(self, record: Record) -> Naive:
        """Tune the filter that knows no magnet on the same beginning, judge it on the same rest."""
        beginning = record.between(None, record.t[0] + TUNED_ON)["y"]
        kf = tune(beginning, record.sampling_time, R=self.measurement)
        first = round(TUNED_ON / record.sampling_time)
        y = record["y"]
        errors = {
            ahead: prediction_error(kf.predict(y, ahead), record, ahead, first)
            for ahead in (1, 10)
        }  # fmt: skip
        e, S = (values[first:] for values in kf.innovations(y))
        return Naive(kf, errors, float(np.nanmean(e**2 / S)), whiteness(e[np.isfinite(e)], LAGS))


@dataclass(frozen=True)
class Naive:
    """What the filter without a magnet came to: RMS error [m] by samples ahead, and its NIS."""

    filter: ConstantVelocityFilter
    prediction: dict[int, float]
    nis: float
    whiteness: Whiteness


def recording(study: Study) -> Part:
    """Fit the law, tune each filter alike, and judge by prediction."""
    del study  # another rig
    rig = Rig()
    records = {log: Record.load(folder() / f"{log}.csv") for log in LOGS}
    evaluated = {
        log: {name: rig.evaluated(record, name) for name in FILTERS}
        for log, record in records.items()
    }
    naive = {log: rig.naive(record) for log, record in records.items()}
    best = evaluated["sinus_kalman"]["estimate linear"][1]
    other = naive["sinus_kalman"].prediction
    adaptive = evaluated["sinus_kalman"]["estimate adaptive"][1]
    fit = rig.fit
    k_error, gap_error = fit.standard_errors["magnet_constant"], fit.standard_errors["gap_offset"]
    return Part(
        Chapter(
            id="recording",
            title="On a recording of a real rig",
            lead="A steel ball below one electromagnet (INTECO MLS2EM), logged by others at 1 "
                 "kHz. The true position is unknown; the filters are compared by their "
                 "predictions of the next measurements.",
            blocks=[
                Text("**The law, from lift-off.** The current above the resting ball rises "
                     "until it lifts off; at that instant the magnet carries the weight, so "
                     r"$i = (z + z_\mathrm{off}) \sqrt{m g / k}$ is a straight line. "
                     f"Between {FIT_RANGE[0] * 1e3:g} and {FIT_RANGE[1] * 1e3:g} mm it gives "
                     f"k = {fit.magnet_constant * 1e6:.1f} ± {k_error * 1e6:.1f} N mm²/A² and an "
                     f"offset of {fit.gap_offset * 1e3:.2f} ± {gap_error * 1e3:.2f} mm."),
                FigureBlock(_figure_law(rig)),
                Text("**The noise, from rest.** Before it lifts off, the measured position "
                     f"scatters by {1e6 * np.sqrt(rig.measurement):.1f} µm where the ball "
                     "later moves; the authors give 27 µm for the whole range. The process "
                     "noise of the disturbance force is the only free parameter, and is tuned "
                     "with the same effort for each filter: the maximum-likelihood value on "
                     f"the first {TUNED_ON:g} s of the log. All results are from the remainder."),
                Text("**Two baselines.** The last measurement held; and a Kalman filter "
                     "without a magnet model and control signal, whose velocity is a random "
                     "walk. It has the same sensor noise, and its only free parameter is "
                     "tuned by maximum likelihood on the same part of the log."),
                _table(evaluated, naive),
                FigureBlock(_figure_run(records["sinus_kalman"], evaluated["sinus_kalman"])),
                FigureBlock(_figure_white(evaluated["sinus_kalman"])),
                Remark("Result",
                       "All three filters predict better than holding the last measurement, "
                       "and the rig's own filter has a bias of about 30 µm. "
                       + _bought(rig, evaluated, naive) +
                       " The three hardly differ: the ball moves slowly by ±2 mm, and the "
                       "disturbance state compensates for errors of the stiffness. The linear "
                       "filter is slightly better, if at all; a fitted law with systematic "
                       "residuals is worth no more than its slope. The innovations are not "
                       "quite white: eddy currents and the inductance of the coil are not "
                       "modelled."),
            ],
        ),
        [
            row("recording.naive_one", "Real rig, 1 ms ahead: no magnet (held "
                f"{best.held[1] * 1e6:.1f})", None, other[1] * 1e6, "µm rms",
                _verdict(other[1], best.held[1]), 1),
            row("recording.one", "Real rig, 1 ms ahead: linear filter",
                None, best.prediction[1] * 1e6,
                "µm rms", _verdict(best.prediction[1], other[1]), 1),
            row("recording.naive_ten", "Real rig, 10 ms ahead: no magnet (held "
                f"{best.held[10] * 1e6:.1f})", None, other[10] * 1e6, "µm rms",
                _verdict(other[10], best.held[10]), 1),
            row("recording.ten", "Real rig, 10 ms ahead: linear filter",
                None, best.prediction[10] * 1e6,
                "µm rms", _verdict(best.prediction[10], other[10]), 1),
            row("recording.adaptive", "Real rig, 10 ms ahead: adaptive filter",
                None, adaptive.prediction[10] * 1e6, "µm rms",
                _verdict(adaptive.prediction[10], best.prediction[10]), 1),
        ],
    )  # fmt: skip


def _bought(
    rig: Rig, evaluated: dict[str, dict[str, tuple[float, Evaluation]]], naive: dict[str, Naive]
) -> str:
    """Say what the model buys over the filter that knows no magnet."""

    def of_log(log: str, ahead: int) -> tuple[float, float]:
        model = evaluated[log]["estimate linear"][1].prediction[ahead]
        return 1e6 * model, 1e6 * naive[log].prediction[ahead]

    def less_noise(error: float) -> float:
        return float(np.sqrt(max(0.0, error**2 - 1e12 * rig.measurement)))

    said = []
    for ahead in (1, 10):
        pairs = [of_log(log, ahead) for log in LOGS]
        share = [100 * (1 - model / other) for model, other in pairs]
        said.append(
            f"{ahead} ms ahead the linear filter has "
            + " and ".join(f"{model:.1f}" for model, _ in pairs)
            + " µm on the two logs where the filter without a magnet has "
            + " and ".join(f"{other:.1f}" for _, other in pairs)
            + f" µm, {min(share):.0f} to {max(share):.0f} % less"
        )
    far = [tuple(map(less_noise, of_log(log, 10))) for log in LOGS]
    return (
        f"**Benefit of the model:** {said[0]}; {said[1]}. Most of each value is the noise of the "
        "predicted measurement; without it, "
        + " and ".join(f"{model:.0f} µm are left of {other:.0f}" for model, other in far)
        + " at 10 ms. So the magnet model hardly improves a prediction over one sample, but does "
        "so over a time in which the acceleration matters. The baseline does not estimate forces."
    )


def _verdict(error: float, other: float) -> str:
    return "better" if error < other else "worse"


def _table(
    evaluated: dict[str, dict[str, tuple[float, Evaluation]]], naive: dict[str, Naive]
) -> TableBlock:
    rows: list[list[str | float | None]] = []
    for log, by_filter in evaluated.items():
        for name, (growth, j) in by_filter.items():
            rows.append([
                LOGS[log], style_of(name).label, 1e6 * j.prediction[1], 1e6 * j.prediction[10],
                f"{j.nis:.2f}", f"{100 * j.whiteness.share_within:.0f} %" if j.whiteness else None,
                f"{1e3 * j.disturbance_mean:.0f} ± {1e3 * j.disturbance_std:.0f}",
                f"{growth:.1e}",
            ])  # fmt: skip
        simple = naive[log]
        rows.append([
            LOGS[log], "constant velocity, no magnet", 1e6 * simple.prediction[1],
            1e6 * simple.prediction[10], f"{simple.nis:.2f}",
            f"{100 * simple.whiteness.share_within:.0f} %", None, None,
        ])  # fmt: skip
        j = next(iter(by_filter.values()))[1]
        others = {"last measurement held": j.held} | {
            {"x_logged held": "logged by the rig, position held",
             "x_logged and v_logged": "logged by the rig, with its velocity"}.get(way, way): errors
            for way, errors in j.logged.items()
        }  # fmt: skip
        for way, errors in others.items():
            rows.append([LOGS[log], way, 1e6 * errors[1], 1e6 * errors[10], *[None] * 4])
    return TableBlock(
        id="recording_table",
        title="Prediction of the measured position, 1 ms and 10 ms ahead",
        headers=["log", "predicted by", "1 ms [µm rms]", "10 ms [µm rms]", "mean NIS",
                 "white lags", r"$f_d$ [mN]", "its growth [N²/s]"],
        rows=rows,
        digits=".1f",
        row_heads=False,
        caption="NIS is 1, and 95 % of the lags are white, if model and noise are correct. Force: "
        "mean and standard deviation along the log; the weight is 594 mN. Each log is one "
        "recording: there is no spread over runs.",
    )  # fmt: skip


def _figure_law(rig: Rig) -> Figure:
    gap, current = Axis("distance from the magnet $z$", "mm", 1e3), Axis("current", "A")
    usable = [p for p in rig.points if not p.problem]
    used = [p for p in usable if p in rig.fit.points]
    other = [p for p in usable if p not in rig.fit.points]
    z = np.linspace(0.0, 0.02, 50)

    def at(points: list[LiftOff], signal: str, label: str, *, less: bool) -> Points:
        where = np.array([p.gap for p in points])
        # The current that would have carried it at rest: at lift-off it accelerates a little.
        carrying = np.array([p.current / np.sqrt(1 - p.acceleration / GRAVITY) for p in points])
        law = rig.fit.current(where) if less else 0.0
        return Points(where, carrying - law, signal=signal, label=label)

    return Figure(
        id="lift_off",
        title="Lift-off: the current that carries the ball, against its distance",
        caption="The line is the law $F = k (i / (z + z_{\\mathrm{off}}))^2$. It holds in the "
                "middle; near the magnet and far from it the points deviate, as the residuals "
                "show. The current is corrected for the small acceleration at the instant of "
                "lift-off.",
        panels=[
            Panel(gap, current, [
                Line(z, rig.fit.current(z), signal="fit", label="fitted law"),
                at(used, "fit", "points of the fit", less=False),
                at(other, "constant", "points left out", less=False),
            ]),
            Panel(gap, Axis("point less law", "mA", 1e3), [
                at(used, "fit", "", less=True),
                at(other, "constant", "", less=True),
                Rule(0.0, signal="bound", label=""),
            ]),
        ],
    )  # fmt: skip


def _figure_run(record: Record, evaluated: dict[str, tuple[float, Evaluation]]) -> Figure:
    t = record.t
    estimates = {name: j.estimate for name, (_, j) in evaluated.items()}
    some = estimates["estimate adaptive"]
    late = t >= t[0] + TUNED_ON
    return Figure(
        id="recording_run",
        title="The filters on the log with the rig's own Kalman filter in the loop",
        caption="Position as measured, as logged and as estimated; the disturbance force that the "
        "filters need to explain the motion; the adaptive filter's innovations with twice the "
        "deviation that it expects. The logged estimate differs "
        "from the measurement by about 30 µm, visible when zoomed in. One recording.",
        panels=[
            Panel(TIME, POSITION, [
                Line(t, record["y"], signal="measured"),
                Line(t, record["r"], signal="reference"),
                *([Line(t, record["x_logged"], signal="logged")] if "x_logged" in record else []),
                Line(t, some.x, signal="estimate adaptive"),
            ]),
            Panel(TIME, Axis(r"disturbance force $f_d$", "mN", 1e3), [
                Line(t[late], e.f_d[late], signal=name, label=None)
                for name, e in estimates.items()
            ]),
            Panel(TIME, Axis("innovation", "µm", 1e6), [
                Line(t[late], some.innovation[late], signal="innovation"),
                Line(t[late], 2 * np.sqrt(some.innovation_variance[late]), signal="bound",
                     label="twice the expected deviation"),
                Line(t[late], -2 * np.sqrt(some.innovation_variance[late]), signal="bound",
                     label=""),
            ]),
        ],
    )  # fmt: skip


def _figure_white(evaluated: dict[str, tuple[float, Evaluation]]) -> Figure:
    lags = Axis("lag", "ms", 1e3)
    white = {name: j.whiteness for name, (_, j) in evaluated.items() if j.whiteness is not None}
    bound = next(iter(white.values())).bound
    return Figure(
        id="recording_white",
        title="Autocorrelation of the innovations",
        caption="White innovations would stay between the dashed lines at 95 % of the lags. One "
        "recording.",
        panels=[
            Panel(lags, Axis("correlation"), [
                *(Points(1e-3 * np.arange(1.0, w.correlation.size + 1), w.correlation, signal=name)
                  for name, w in white.items()),
                Rule(bound, signal="bound", label="95 % of white noise"),
                Rule(-bound, signal="bound", label=""),
            ]),
        ],
    )  # fmt: skip
