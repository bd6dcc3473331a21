"""Tests of an identified model's structure against alternatives, with a verdict.

Process noise absorbs deviations of the plant from its model: the NIS remains 1, but the innovations
depend on what the model lacks. Each alternative adds one parameter, which is zero in the model. Its
score statistic (Rao 1948) needs no search: it is twice the gain of log likelihood to second order,
with all other parameters adapted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ambkit.base.arrays import Array, Bools
from ambkit.data.reading.faults import without_spikes
from ambkit.data.record import Record
from ambkit.estimate.batch import run_many
from ambkit.identification.maximum_likelihood.alternatives import (
    KINDS,
    Alternative,
    Motion,
    alternatives,
    change,
    jump,
)
from ambkit.identification.maximum_likelihood.likelihood import Data, between_blocks
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import named, usual
from ambkit.identification.maximum_likelihood.refits import Departure, Refits, implausible
from ambkit.identification.maximum_likelihood.result import MaximumLikelihood
from ambkit.identification.maximum_likelihood.search import maximise
from ambkit.machine.magnets import own_time
from ambkit.result.row import Row, put

MOST = 4  #: Maximum number of named structures.
FULL = 1.0  #: Maximum size of a relative structure [1].
SMALL = 1e-4  #: Excluded shares of the bias current and of the sensor's noise as divisors.
JUMPS = ("load jump", "sensor jump")
SETTLED = 20.0  #: Time constants of the plant after which a jump has no effect.
LONGEST = 100_000  #: Maximum number of tested samples, the first of a record.
CHANCE = 0.01  #: Probability that any of the tests exceeds its limit by chance.


@dataclass(frozen=True)
class Structure:
    """Results of the structural tests."""

    departures: Sequence[Departure] = field(default=())
    remarks: Sequence[str] = field(default=())  #: Implausible values, in sentences.
    tested: bool = False  #: False if no record has a complete control signal, and motion.
    #: By kind, the size that half of such records would reveal, by Fisher's information.
    detectable: Mapping[str, float] = field(default_factory=dict)

    @property
    def suspect(self) -> str:
        """Names of the defects; empty if there are none."""
        names = [item.kind.name for item in self.departures if not item.kind.innocent]
        names += ["implausible offsets"] if self.remarks else []
        return ", ".join(dict.fromkeys(names))

    @property
    def notes(self) -> list[str]:
        """Departures, and undetectable structures, in sentences."""
        notes = [*(item.text for item in self.departures), *self.remarks]
        shown = {item.kind.name for item in self.departures}
        hidden = [
            f"{kind.name} below {Row('', '', self.detectable[kind.name], kind.unit, 2).text()}"
            for kind in KINDS.values()
            if kind.name not in shown and self.detectable.get(kind.name, 0.0) > kind.common > 0
        ]
        if hidden:
            notes.append(
                f"These records cannot show {' or '.join(hidden)}: move the rotor over the range "
                "that it will use."
            )
        return notes

    def rows(self) -> list[Row]:
        """Return verdict and figures as rows."""
        verdict = "no departure" if self.tested else "not tested: no motion, or gaps in u"
        verdict = self.suspect or verdict
        rows = [Row("verdict", "verdict", verdict, of="structure")]
        rows += [
            Row(f"detectable.{name}", f"smallest {name} shown", size, KINDS[name].unit, 2,
                of="structure", detail=True)
            for name, size in self.detectable.items()
        ]  # fmt: skip
        for item in self.departures:
            rows += put(item.rows(), of=item.kind.name)
        return put(rows, section=("structure",))


@dataclass(frozen=True, eq=False)
class _Tests:
    """Normalised residuals of n samples, and their derivatives by p parameters and c structures."""

    r: Array  #: (n,)
    by_parameters: Array  #: (p, n)
    scores: Array  #: (p, n)
    information: Array  #: (p, p) And the score (p,) of the priors.
    pull: Array
    kinds: list[Alternative]
    owners: list[int]  #: Records of those that begin at a sample.
    by_structures: Array  #: (c, n)
    limits: Array  #: (c,)
    S: Array  #: (n,) Variances of the innovations [m^2].
    used: Bools  #: Which samples of the records count.


def examine(result: MaximumLikelihood, records: Sequence[Record]) -> Structure:
    """Test the structure of an identified model on its records."""
    start, settling = result.start, result.settling
    records, _ = without_spikes([_first(r) for r in records if np.isfinite(r["u"]).all()])
    if not records:
        return Structure()
    model = result.model.replace(rotor__clearance=start.isolated.clearance)  # as in the search
    data = Data(records, settling)
    if "position_offset" in model.known:
        # Without the prior a wrong force law drives the zero beyond the stops, which tells it.
        free = {name: prior for name, prior in model.known.items() if name != "position_offset"}
        begins = [one.replace(known=free) for one in (start, model)]
        freed = [maximise(data, begin, list(result.parameters)) for begin in begins]
        model = max(freed, key=lambda one: one.value).model
    remarks = list(implausible(model, result.model.isolated.clearance))
    noise = math.sqrt(model.isolated.sensor.noise_variance)
    if max(float(np.std(Motion.of(model, record).x)) for record in records) < noise:
        return Structure(remarks=remarks)
    refits = Refits(data, start, model, result.parameters)
    centred = refits.centred()
    if centred is not None and refits.gain_of_offsets(centred) <= 0:
        remarks = []  # about as likely without
    departures = [] if remarks else [*refits.lag()]
    if centred is not None and (remarks or not refits.needs_offsets(centred)):
        # Diverging offsets imitate a wrong force law or sensor, and hide which.
        model = centred.model
    tests = _tests(model, data)
    selected = _select(tests, model, data)
    if remarks and centred is not None:
        clearest = max((d.statistic for d in selected if not d.kind.innocent), default=0.0)
        limit = max(clearest, float(min(tests.limits)))
        for departure, saturating in refits.saturation(centred, limit):
            departures.append(departure)
            selected = _select(_tests(saturating, data), saturating, data)
    known = [departure.kind for departure in departures]
    departures += [departure for departure in selected if departure.kind not in known]
    return Structure(departures, remarks, True, _detectable(tests))


def _first(record: Record) -> Record:
    """Return the first samples of a record."""
    if len(record) <= LONGEST:
        return record
    signals = {name: record[name][:LONGEST] for name in record}
    return replace(record, t=record.t[:LONGEST], signals=signals)


def _tests(model: LoopModel, data: Data) -> _Tests:
    """Run the filter with each alternative along all records."""
    parameters, records = named(usual(model)), data.records
    likelihood = data.likelihood(model, parameters)
    e, S, by_e, by_S, used = likelihood.slopes(np.zeros(len(parameters)), rough=True)
    r = e / np.sqrt(S)
    pull, known = likelihood.priors(model)
    own = own_time(model.isolated) / model.isolated.sampling_time
    everything: list[tuple[list[Alternative], Array]] = []
    edges = np.cumsum([0, *(len(record) for record in records)])
    for record, first, last in zip(records, edges[:-1], edges[1:], strict=True):
        here = used[first:last]
        motion = Motion.of(model, record)
        at = np.count_nonzero(used[:first])
        scale = 1 / np.sqrt(S[at : at + np.count_nonzero(here)])
        mine = r[at : at + scale.size]
        places = np.flatnonzero(here)
        if not places.size:
            continue
        half = places.size // 2
        middle = [jump(motion, kind, int(places[half])) for kind in JUMPS]
        of_middle = _responses(motion, record, middle)[:, here] * scale
        kinds = list(alternatives(motion))
        for kind, response in zip(JUMPS, of_middle, strict=True):
            shape = response[half : half + round(SETTLED * own)]
            sample = int(places[_likeliest(mine, shape)])
            kinds.append(jump(motion, kind, sample))
            if kind == "load jump":
                kinds.append(change(motion, sample))
        by_e_here = _responses(motion, record, kinds)[:, here] * scale
        everything.append((kinds, by_e_here))
    return _Tests(
        r=r,
        by_parameters=by_e,
        scores=-(by_e * r + 0.5 * by_S * (1 - r**2)),
        information=by_e @ by_e.T + 0.5 * by_S @ by_S.T + known + 1e-9 * np.eye(len(pull)),
        pull=pull,
        S=S,
        used=used,
        **_of_all_records(everything),
    )


def _of_all_records(parts: Sequence[tuple[list[Alternative], Array]]) -> dict[str, Any]:
    """Join records: permanent structures are common to all, jumps belong to one."""
    from scipy.special import chdtri

    n = sum(responses.shape[1] for _, responses in parts)
    kinds: list[Alternative] = []
    owners: list[int] = []
    rows: list[Array] = []
    at = 0
    common: dict[tuple[str, str, float], int] = {}
    for number, (of_record, responses) in enumerate(parts):
        columns = slice(at, at + responses.shape[1])
        at = columns.stop
        for one, response in zip(of_record, responses, strict=True):
            lasts = one.kind.name not in (*JUMPS, "change")
            key = one.kind.name, one.where, one.scale
            if lasts and key in common:
                rows[common[key]][columns] = response
                continue
            common[key] = len(rows)
            kinds.append(one)
            owners.append(number)
            rows.append(np.zeros(n))
            rows[-1][columns] = response
    # By Bonferroni's inequality: a jump may be at any sample.
    places = [n if one.kind.name in JUMPS else len(kinds) for one in kinds]
    limits = chdtri(1, CHANCE / np.array(places))
    return {
        "kinds": kinds, "owners": owners, "by_structures": np.array(rows), "limits": limits
    }  # fmt: skip


def _likeliest(r: Array, shape: Array) -> int:
    """Return the sample at which a response of some shape most likely begins."""
    from scipy.signal import fftconvolve

    length, n = shape.size, r.size
    correlation = fftconvolve(r, shape[::-1])[length - 1 :][:n]
    energy = np.cumsum(shape**2)[np.minimum(n - np.arange(n), length) - 1]
    enough = energy > 0.5 * energy[0]
    gain = np.where(enough, correlation**2 / np.where(enough, energy, 1.0), 0.0)
    return int(np.argmax(gain))


def _responses(motion: Motion, record: Record, kinds: Sequence[Alternative]) -> Array:
    """Return the derivatives (c, samples) of the innovations [m] by the factors of alternatives."""
    model, b = motion.model, motion.model.isolated
    y, u = model.acting_signals(record)
    kalman = model.kalman()
    start = model.begin(kalman, y, record["u"][:1])
    k_i = float(np.median(np.abs(motion.k_i)))
    of_force = SMALL * b.magnet.bias_current * k_i
    of_reading = SMALL * math.sqrt(b.sensor.noise_variance)
    rows, steps = [(y, u)], []
    reads, acts = (_column(signal, k) for signal, k in ((y, model.reading), (u, model.number)))
    for one in kinds:
        size = float(np.sqrt(np.mean(one.signal**2))) or 1.0
        if one.kind.of_reading:
            steps.append(of_reading / size)
            rows.append((y - np.multiply.outer(steps[-1] * one.signal, reads), u))
        else:
            steps.append(of_force / size)
            volts = steps[-1] * one.signal / (motion.k_i * b.amplifier.gain)
            rows.append((y, u + np.multiply.outer(volts, acts)))
    if kalman.machine.single:
        ys, us = (np.array(side) for side in zip(*rows, strict=True))
        e = run_many(kalman, ys, us, start=start, history=("innovation",)).innovation
        assert e is not None
    else:
        runs = []
        for reading, control in rows:
            kalman.reset(*start)
            runs.append(kalman.core.run(reading, control)["innovation"][:, model.reading])
        e = np.array(runs)
    e = e[:, :: model.substeps]
    return np.asarray(np.nan_to_num((e[1:] - e[0]) / np.array(steps)[:, None]))


def _column(signal: Array, number: int) -> Array:
    """Return a unit column among several."""
    return np.eye(signal.shape[1])[number] if signal.ndim > 1 else np.array(1.0)


def _one_more(tests: _Tests, taken: Sequence[int]) -> tuple[Array, Array, Array]:
    """Return a structure's contribution to selected ones (c, n), score (c,), precision (c,)."""
    d, p = tests.by_structures, len(tests.information)
    J = np.vstack([tests.by_parameters, d[taken]])
    information = J @ J.T
    information[:p, :p] = tests.information
    score = np.concatenate([tests.scores.sum(axis=1) + tests.pull, -d[taken] @ tests.r])
    along = np.linalg.solve(information, J @ d.T).T  # (c, p + taken)
    own = np.sum(d * d, axis=1)
    precision = own - np.sum(along * (d @ J.T), axis=1)
    return d - along @ J, -d @ tests.r - along @ score, np.maximum(precision, 1e-9 * own + 1e-300)


def _detectable(tests: _Tests) -> dict[str, float]:
    """Return the least size of each kind whose expected statistic reaches the limit."""
    _, _, precision = _one_more(tests, [])
    sizes: dict[str, float] = {}
    factors: dict[str, float] = {}
    for one, factor in zip(tests.kinds, np.sqrt(tests.limits / precision).tolist(), strict=True):
        # Of lags and widths that show themselves the one of a factor near 1.
        name, size = one.kind.name, factor * one.scale
        by = abs(math.log(factor)) if one.scale != 1 else factor
        if by < factors.get(name, math.inf):
            factors[name], sizes[name] = by, size
    return sizes


def _select(tests: _Tests, model: LoopModel, data: Data) -> list[Departure]:
    """Select the most significant structures one by one, while they are beyond chance."""
    result: list[Departure] = []
    taken: list[int] = []
    refused: list[int] = []
    while len(result) < MOST:
        best, statistic = _best_candidate(tests, model, taken, refused)
        if best < 0:
            return result
        _, slope, precision = _one_more(tests, taken)
        size, one = float(slope[best] / precision[best]), tests.kinds[best]
        if not one.kind.innocent and not _raises(tests, model, data, [*taken, best]):
            refused.append(best)
            continue
        taken.append(best)
        result.append(
            Departure(
                one.kind,
                one.where,
                size * one.scale,
                statistic,
                float(tests.limits[best]),
                abs(size * one.scale) / math.sqrt(statistic),
                tests.owners[best],
                one.begins,
            )
        )
    return result


def _best_candidate(
    tests: _Tests, model: LoopModel, taken: Sequence[int], refused: Sequence[int] = ()
) -> tuple[int, float]:
    """Return the most significant structure beside those taken and its statistic; -1 if none is."""
    names = np.array([one.kind.name for one in tests.kinds])
    signs = np.array([one.kind.sign for one in tests.kinds])
    # A change by more than the quantity itself is what a rotor at rest makes of its noise.
    # The coefficients of a force law's terms have no such limit.
    shares = np.array([one.kind.unit == "%" for one in tests.kinds]) & (names != "force law")
    limits = np.where(shares, FULL, math.inf)
    scales = np.array([one.scale for one in tests.kinds])
    left, slope, precision = _one_more(tests, taken)
    size, plain = slope / precision, slope**2 / precision
    possible = (plain > tests.limits) & (signs * size >= 0)
    possible &= ~np.isin(names, names[list(taken)]) & (np.abs(size * scales) <= limits)
    possible[list(refused)] = False
    best, statistic = -1, 0.0
    for c in np.flatnonzero(possible):
        # Coloured noise correlates scores within a block (White 1982).
        scores = left[c] * (tests.r + left[c] * size[c])
        robust = float(between_blocks(scores[None], model.isolated)[0, 0])
        value = float(slope[c] ** 2 / max(precision[c], robust))
        if value > tests.limits[c] and names[c] in JUMPS:
            value = float(plain[c])  # one or two blocks have no scatter to compare by
        if value > max(statistic, tests.limits[c]):
            best, statistic = int(c), value
    return best, statistic


def _raises(tests: _Tests, model: LoopModel, data: Data, taken: Sequence[int]) -> bool:
    """Whether the likelihood rises with the last of the taken structures as its score promises."""
    # To second order it must. Where records hardly determine the parameters it need not: there the
    # other parameters cannot adapt as far as the score lets them.
    parameters, values = named(usual(model)), []
    limit = float(tests.limits[taken[-1]])
    best = maximise(data, model, parameters)
    if 2 * (best.value - data.log_likelihood(model)) > limit:
        return True  # the model is no optimum to compare with
    for among in (taken[:-1], taken):
        moved = np.zeros(tests.used.size)
        moved[tests.used] = _sizes(tests, among) @ tests.by_structures[among] * np.sqrt(tests.S)
        optimum = maximise(replace(data, moved=moved), model, parameters)
        model = optimum.model
        values.append(optimum.value)
    return 2 * (values[1] - values[0]) > limit


def _sizes(tests: _Tests, taken: Sequence[int]) -> Array:
    """Return the most likely sizes (c,) of some structures together."""
    left, slope, _ = _one_more(tests, [])
    own = left[taken]
    return np.asarray(np.linalg.solve(own @ tests.by_structures[taken].T, slope[taken]))
