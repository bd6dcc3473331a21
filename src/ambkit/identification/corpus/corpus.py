"""Identification of a rig from all of its logs: individually, pooled, and cross-validated."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ambkit.base.errors import AmbkitError, RecordError
from ambkit.base.units import engineering, figure
from ambkit.data.reading.faults import without_spikes
from ambkit.data.record import Record
from ambkit.estimate.constant_velocity import ConstantVelocityFilter, tune
from ambkit.estimate.errors import rms
from ambkit.identification.corpus.magnet_strength import StrengthLoss, strength_loss
from ambkit.identification.corpus.pooling import Deviation, Pooled, deviation, pool
from ambkit.identification.corpus.segmentation import SMOOTHED, Stretch, cut, flights
from ambkit.identification.maximum_likelihood.axis_model import AxisModel
from ambkit.identification.maximum_likelihood.baselines import AHEAD, PREDICTORS, Baselines
from ambkit.identification.maximum_likelihood.current_state import is_interpolated
from ambkit.identification.maximum_likelihood.estimate import maximum_likelihood
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import (
    NOISES,
    OFFSETS,
    Parameter,
    named,
    priors_of,
    usual,
)
from ambkit.identification.maximum_likelihood.result import MaximumLikelihood
from ambkit.identification.maximum_likelihood.validation import Validation, validate
from ambkit.identification.noise import white_noise, with_steps
from ambkit.machine.accessories import Hum
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import own_time
from ambkit.result.report import Axis, Bars, Figure, Panel
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put

SAME_LINE = 0.02
"""Relative tolerance for frequencies of one line in different logs: the mains keep to 1 %."""

FEWEST = 2  #: Minimum number of logs for pooling.
SETTLED = 4.0  #: Time constants of the plant after which predictions count.
THREADS = 2  #: Logs identified in parallel.


@dataclass(frozen=True, eq=False, repr=False)
class Corpus(Result):
    """Result of many logs of a rig."""

    start: LoopModel  #: Prior.
    model: LoopModel  #: Model with the pooled parameters.
    pooled: Pooled  #: Pooled parameters, errors, and scatter between logs.
    by_log: Mapping[str, MaximumLikelihood]  #: Individual result of each log.
    predictions: Sequence[Validation]  #: Prediction of each log by a model of the others.
    stretches: Mapping[str, Sequence[Stretch]]  #: Segmentation of each log.
    left_out: Mapping[str, str]  #: Logs that were not used, with reasons.
    #: Logs with spikes in their positions, with the number of rejected samples.
    spikes: Mapping[str, str]
    #: Deviations of logs, if there are enough to estimate a scatter.
    deviations: Mapping[str, Deviation]
    #: Loss of strength of a one-sided magnet during levitation, relative to its description, and
    #: its amplitude.
    strength_loss: StrengthLoss | None = None

    @property
    def machine(self) -> Machine:
        """The identified machine: dead time, current lag, smallest quantisation of its logs."""
        steps = [item.position_step for item in self.by_log.values()]
        known = [step for step in steps if step is not None]
        step = min(known) if known and len(known) == len(steps) else None
        has_noise = any(p.name == "measurement_noise" for p in self.pooled.parameters)
        machine = with_steps(self.model.delayed_machine(), step, has_noise=has_noise)
        return self.model.with_isolated(machine)

    TITLE = "Identification of {0.model.isolated.name} from many logs"
    SECTIONS = {
        ("predictions",): Section(
            "Cross-validation: each log predicted by a model of the others", across=True
        ),
        ("parameters",): Section("All logs together", across=True),
        ("alone",): Section("Each log separately", across=True),
        ("levitated", "flights"): Section(
            "The magnet during levitation, the gap as described", across=True
        ),
        ("cut",): Section("Segments of the logs", across=True),
    }

    @property
    def finding(self) -> str:
        good = sum(prediction.good for prediction in self.predictions)
        off = [
            f" {name} differs from the others."
            for name, one in self.deviations.items() if one.far
        ]  # fmt: skip
        return (
            f"{good} of {len(self.predictions)} logs of {self.model.isolated.name} are predicted "
            f"well by a model of the others. {self._better_baselines}{''.join(off)}"
        )

    @property
    def _better_baselines(self) -> str:
        """Yield cases in which a baseline without magnet model predicts better from the past."""
        k, own, by = AHEAD[-1], "without_later_controls", list[str]()
        for kind, (name, _, _) in PREDICTORS.items():
            gains = [
                1 - one.errors[kind][k] / one.errors[own][k]
                for one in self.predictions if one.best == kind != own
            ]  # fmt: skip
            if gains:
                by.append(f"{name} {len(gains)}, by up to {max(gains):.1%}")
        if not by:
            return f"No baseline predicts any of them better {k} samples ahead."
        return f"From the past alone, {k} samples ahead, baselines predict better: {'; '.join(by)}."

    @property
    def rows(self) -> list[Row]:
        p, result = self.pooled, []
        for prediction in self.predictions:
            off = self.deviations.get(prediction.name)
            far = None if off is None else abs(off.ratio) / off.limit
            deviating = Row("deviation", "deviation / limit", far, digits=3, below=1.0)
            rows = [*prediction.rows(), deviating]
            result += put(rows, section=("predictions",), of=prediction.name)
        for k, one in enumerate(p.parameters):
            name, value = one.name.replace("_", " "), float(p.values[k])
            error, scatter = (float(of[k]) for of in (p.errors, p.scatter))
            result += put([
                Row("value", "identified", value, one.unit, error=error * _scale(one, value)),
                Row("scatter_between_logs", "scatter between logs", scatter,
                    "%" if one.positive else one.unit),
            ], section=("parameters",), of=name)  # fmt: skip
            for log, value, error in zip(
                self.by_log, p.by_log[:, k], p.log_errors[:, k], strict=True
            ):
                error = float(error) * _scale(one, float(value))
                result.append(Row(one.name, name, float(value), one.unit, of=log, error=error,
                                 section=("alone",)))  # fmt: skip
        for log, flight in self.strength_loss.flights.items() if self.strength_loss else ():
            result += put([
                Row("amplitude", "current amplitude", flight.amplitude, "A", 2),
                Row("factor", "described / identified", flight.factor,
                    error=flight.factor * flight.error),
            ], section=("levitated", "flights"), of=log)  # fmt: skip
        for log, parts in self.stretches.items():
            said = [f"{s.kind} {s.begin:.3g} to {s.end:.3g} s" for s in parts]
            cuts = "; ".join(said[:8] + ["..."] * (len(said) > 8))
            result.append(Row("parts", "segments", cuts, of=log, section=("cut",)))
        return result

    @property
    def notes(self) -> list[str]:
        weaker = [] if self.strength_loss is None else [self.strength_loss.text]
        left_out = [*self.left_out.items(), *self.spikes.items()]
        return [
            "Errors are rms of predictions that many samples ahead, with the controls since. Past "
            "only: controls predicted from the past, as ARX and the subspace model (canonical "
            "variates of the past) have them; their lags, states, use of the duty and gains linear "
            "in the position are chosen by cross-validation. Velocity: a Kalman filter without a "
            "magnet. All are fitted to the other logs. Predictable: share of the "
            "residuals that their past predicts. Good: no baseline with the same information is "
            "better, NIS is near 1, and little is predictable.",
            *["The model has the signals of all axes, with the other axes' later controls as they "
              "are in the log; the baselines have those of this axis."
              for _ in range(isinstance(self.start, AxisModel))],
            *(f"{name} differs from the others: {_difference(one)}."
              for name, one in self.deviations.items() if one.far),
            *(f"{said[0].upper()}{said[1:]}." for said in weaker),
            *(f"A line at {figure(h.frequency, 'Hz')} in the position, of "
              f"{figure(h.amplitude, 'm', 2)}, in more than half of the logs."
              for h in self.model.isolated.sensor.hum),
            *(f"Left out of {name}: {why}" for name, why in left_out),
        ]  # fmt: skip

    @property
    def series(self) -> dict[str, Any]:
        return {
            "stretches": {
                name: [{"kind": s.kind, "from": s.begin, "to": s.end} for s in cuts]
                for name, cuts in self.stretches.items()
            },
            "lines": [h.model_dump() for h in self.model.isolated.sensor.hum],
            "left_out": dict(self.left_out),
            "spikes": dict(self.spikes),
            "levitated": None if self.strength_loss is None else asdict(self.strength_loss),
        }  # fmt: skip

    def figures(self) -> list[Figure]:
        return [corpus_figure(self)]


def _difference(of: Deviation) -> str:
    """Return in which parameter a log deviates, and by how much, in words."""
    by = f"{math.expm1(of.difference):+.1%}" if of.parameter.positive else engineering(
        of.difference, of.parameter.unit, 2
    )  # fmt: skip
    return (
        f"{of.parameter.name.replace('_', ' ')} by {by}, {abs(of.ratio):.1f} standard deviations "
        f"where chance has {of.limit:.1f}"
    )


def _scale(of: Parameter, value: float) -> float:
    """Return the scale from an error of a parameter to one of its value."""
    return value if of.positive else 1.0


def corpus_figure(corpus: Corpus) -> Figure:
    """Plot the prediction errors of each log, with those of the baselines."""
    logs = {str(k): one for k, one in enumerate(corpus.predictions, 1)}
    panels = [
        Panel(Axis("log"), Axis(f"error {ahead} ahead", "µm rms", 1e6), [
            Bars(tuple(logs), np.array([one.errors[kind][ahead] for one in logs.values()]),
                 signal=signal, label=label)
            for kind, (_, signal, label) in PREDICTORS.items() if kind != "of_start"
        ])
        for ahead in AHEAD
    ]  # fmt: skip
    caption = ", ".join(f"{number}: {one.name}" for number, one in logs.items())
    title = "Cross-validation: each log predicted by a model of the others"
    return Figure("corpus", title, caption, panels)


def identify_corpus(
    records: Mapping[str, Record],
    start: LoopModel,
    free: Sequence[str] | None = None,
    *,
    note: Callable[[str], object] = lambda _: None,
) -> Corpus:
    """Identify a rig from all of its logs."""
    note("cutting the logs")
    cleaned: dict[str, Record] = {}
    spikes: dict[str, str] = {}
    for name, record in records.items():
        [cleaned[name]], remark = without_spikes([record])
        if remark:
            spikes[name] = remark
    stretches = {name: cut(record, start) for name, record in cleaned.items()}
    flight_records, left_out = _levitated_parts(cleaned, stretches, start)
    if len(flight_records) < FEWEST:
        why = "; ".join(f"{name}: {text}" for name, text in left_out.items())
        raise AmbkitError(
            f"a corpus needs {FEWEST} logs of a flight, {len(flight_records)} are left: {why}"
        )
    free = usual(start) if free is None else free
    if all(is_interpolated(r) for parts in flight_records.values() for r in parts):
        start = start.replace(line=True)
    # The sampled model is exact, except for the fraction of a sample in a delay: nanometres.
    start = start.replace(substeps=1)
    start = start.replace(known=priors_of(start, free))
    names = list(flight_records)
    result = _identify_each(flight_records, start, free, note)
    for name in [name for name in names if isinstance(result[name], str)]:
        left_out[name] = str(result.pop(name))
        names.remove(name)
    likelihoods = {name: one for name, one in result.items() if isinstance(one, MaximumLikelihood)}
    if len(names) < FEWEST:
        raise AmbkitError(f"a corpus needs {FEWEST} usable logs: {left_out}")
    parts = [flight_records[name] for name in names]
    fitted = Baselines.of(parts)
    naive = [tune([one["y"] for one in part], part[0].sampling_time) for part in parts]

    def by_the_others(name: str) -> tuple[Validation, Deviation | None]:
        own = names.index(name)
        note(f"predicting {own + 1} of {len(names)}: {name}")
        rest = [k for k in range(len(names)) if k != own]
        others, model = _together([likelihoods[names[k]] for k in rest], start)
        baselines = Baselines.joint([fitted[k] for k in rest])
        T = parts[own][0].sampling_time
        prediction = validate(
            model, parts[own], name=name, horizons=AHEAD, baselines=baselines,
            naive=in_the_mean([naive[k] for k in rest]),
            settling=max(SETTLED * own_time(model.isolated), baselines.layout.lags * T),
        )  # fmt: skip
        return prediction, deviation(likelihoods[name], others, len(names))

    with ThreadPoolExecutor(THREADS) as workers:
        predicted, off = zip(*workers.map(by_the_others, names), strict=True)
    joint, model = _together(list(likelihoods.values()), start)
    note("the magnet during levitation and as described")
    weaker = strength_loss(flight_records, likelihoods, start, THREADS)
    deviations = {name: one for name, one in zip(names, off, strict=True) if one}
    return Corpus(
        start, model, joint, likelihoods, predicted, stretches, left_out, spikes, deviations, weaker
    )


def in_the_mean(several: Sequence[ConstantVelocityFilter]) -> ConstantVelocityFilter:
    """Return the mean of filters tuned to several logs."""
    q, R = (float(np.exp(np.mean(np.log([getattr(one, name) for one in several]))))
            for name in ("q", "R"))  # fmt: skip
    return ConstantVelocityFilter(several[0].T, q, R)


def _together(results: Sequence[MaximumLikelihood], start: LoopModel) -> tuple[Pooled, LoopModel]:
    """Pool the results of logs, with the lines of more than half of them."""
    pooled = pool(results)
    lines = [line for one in results for line in one.lines]
    shared: list[Hum] = []
    while lines:
        near = [h for h in lines if abs(h.frequency / lines[0].frequency - 1) < SAME_LINE]
        lines = [h for h in lines if h not in near]
        if 2 * len(near) > len(results):
            frequencies = [h.frequency for h in near]
            shared.append(
                Hum(
                    frequency=float(np.median(frequencies)),
                    amplitude=rms(np.array([h.amplitude for h in near])),
                    # A line with a different frequency in each log varies by that.
                    bandwidth=max(float(np.median([h.bandwidth for h in near])),
                                  float(np.std(frequencies))),
                )
            )  # fmt: skip
    values = {p.place: float(v) for p, v in zip(pooled.parameters, pooled.values, strict=True)}
    # A parameter that no log determines keeps the value at which they hold it, such as a noise.
    held = {name for one in results for name in one.held} - set(OFFSETS)
    for p in named([*held - {p.name for p in pooled.parameters}]):
        values[p.place] = float(np.median([p.of(one.model) for one in results]))
    return pooled, start.replace(**values, sensor__hum=(*start.isolated.sensor.hum, *shared))


def _levitated_parts(
    records: Mapping[str, Record], stretches: Mapping[str, list[Stretch]], start: LoopModel
) -> tuple[dict[str, list[Record]], dict[str, str]]:
    """Return the levitated parts of each log, and the reasons why others have none."""
    machine = start.isolated
    cuts = {name: flights(record, stretches[name], machine) for name, record in records.items()}
    noise = {
        name: float(np.median([white_noise(part["y"]) for part in parts]))
        for name, parts in cuts.items() if parts
    }  # fmt: skip
    usual_noise = float(np.median([*noise.values(), math.sqrt(machine.sensor.noise_variance)]))
    flight_records, left_out = {}, {}
    for name, parts in cuts.items():
        if not parts:
            kinds = sorted({s.kind for s in stretches[name]})
            only = ", ".join(kinds) or "samples"
            left_out[name] = f"no levitation that is long enough, only {only}"
        elif noise[name] < SMOOTHED * usual_noise:
            left_out[name] = (
                f"smoothed before it was logged: its position has a noise of "
                f"{engineering(noise[name], 'm', 2)}, elsewhere it is "
                f"{engineering(usual_noise, 'm', 2, like=noise[name])}"
            )
        else:
            flight_records[name] = parts
    return flight_records, left_out


def _identify_each(
    flight_records: Mapping[str, list[Record]],
    start: LoopModel,
    free: Sequence[str],
    note: Callable[[str], object],
) -> dict[str, MaximumLikelihood | str]:
    """Identify each log; the first one provides the initial values of the others."""
    names = list(flight_records)
    done = 0

    def searched(
        name: str, begin: LoopModel, free: Sequence[str], improve: bool
    ) -> MaximumLikelihood | str:
        nonlocal done
        try:
            return maximum_likelihood(
                flight_records[name], begin, free, improve_start=improve, profile=False,
                lines=not isinstance(start, AxisModel),
            )  # fmt: skip
        except (AmbkitError, RecordError) as error:
            return str(error)
        finally:
            done += 1
            note(f"identified from {done} of {len(names)}: {name}")

    note(f"identifying from {names[0]}")
    first = searched(names[0], start, free, improve=True)
    begin, parameters = start, list(free)
    if isinstance(first, MaximumLikelihood):
        # A parameter that one log does not determine is held in all, such as a lag; noises are
        # individual.
        parameters = [name for name in free if name not in first.held or name in NOISES]
        begin = first.model.replace(
            known=start.known, current_offset=start.current_offset,
            position_offset=start.position_offset, sensor__hum=start.isolated.sensor.hum,
        )  # fmt: skip
    with ThreadPoolExecutor(THREADS) as workers:
        rest = workers.map(lambda name: searched(name, begin, parameters, improve=False), names[1:])
        return {names[0]: first, **dict(zip(names[1:], rest, strict=True))}
