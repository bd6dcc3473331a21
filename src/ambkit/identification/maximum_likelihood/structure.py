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

import numpy as np

from ambkit.data.reading.faults import without_spikes
from ambkit.data.record import Record
from ambkit.identification.maximum_likelihood.alternatives import JUMPS, KINDS, Alternative, Motion
from ambkit.identification.maximum_likelihood.likelihood import Data, between_blocks
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import named, usual
from ambkit.identification.maximum_likelihood.refits import Departure, Refits, implausible
from ambkit.identification.maximum_likelihood.result import MaximumLikelihood
from ambkit.identification.maximum_likelihood.score import Tests, one_more, sizes_of, tests_of
from ambkit.identification.maximum_likelihood.search import Optimum, maximise
from ambkit.identification.maximum_likelihood.sizes import optimum_beside, refined
from ambkit.result.row import Row, put

MOST = 4  #: Maximum number of named structures.
FULL = 1.0  #: Maximum size of a relative structure [1].
SHARES = (1.0, 0.6)  #: Of the sizes by score, which are a third too large, for a likelihood.
LONGEST = 100_000  #: Maximum number of tested samples, the first of a record.


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
        for kind in KINDS.values():
            least = self.detectable.get(kind.name, 0.0)
            if kind.name not in shown and least > kind.common > 0:
                full = kind.unit == "%" and least >= FULL
                below = "" if full else f" below {Row('', '', least, kind.unit, 2).text()}"
                notes.append(f"These records cannot show {kind.name}{below}: {kind.experiment}.")
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
    departures: list[Departure] = []
    for departure, lagging in () if remarks else refits.lag():
        departures.append(departure)
        refits, data, model = lagging, lagging.data, lagging.model
        centred = refits.centred()
    if centred is not None and (remarks or not refits.needs_offsets(centred)):
        # Diverging offsets imitate a wrong force law or sensor, and hide which.
        model = centred.model
    tests = tests_of(model, data, None)
    selected = _select(tests, model, data)
    if remarks and centred is not None:
        clearest = max((d.statistic for d, _ in selected if not d.kind.innocent), default=0.0)
        limit = max(clearest, float(min(tests.limits)))
        for departure, saturating in refits.saturation(centred, limit):
            departures.append(departure)
            model = saturating
            selected = _select(tests_of(model, data, None), model, data)
    known = [departure.kind for departure in departures]
    selected = [item for item in selected if item[0].kind not in known]
    departures += refined(sorted(selected, key=lambda item: item[0].record), model, data)
    return Structure(departures, remarks, True, _detectable(tests))


def _first(record: Record) -> Record:
    """Return the first samples of a record."""
    if len(record) <= LONGEST:
        return record
    signals = {name: record[name][:LONGEST] for name in record}
    return replace(record, t=record.t[:LONGEST], signals=signals)


def _detectable(tests: Tests) -> dict[str, float]:
    """Return the least size of each kind whose expected statistic reaches the limit."""
    _, _, precision = one_more(tests, [])
    sizes: dict[str, float] = {}
    factors: dict[str, float] = {}
    for one, factor in zip(tests.kinds, np.sqrt(tests.limits / precision).tolist(), strict=True):
        # Of lags and widths that show themselves the one of a factor near 1.
        name, size = one.kind.name, factor * one.scale
        by = abs(math.log(factor)) if one.scale != 1 else factor
        if by < factors.get(name, math.inf):
            factors[name], sizes[name] = by, size
    return sizes


def _select(tests: Tests, model: LoopModel, data: Data) -> list[tuple[Departure, Alternative]]:
    """Select the most significant structures one by one, while they are beyond chance."""
    result: list[tuple[Departure, Alternative]] = []
    taken: list[int] = []
    refused: list[int] = []
    value = top = data.log_likelihood(model)
    while len(result) < MOST:
        best, statistic = _best_candidate(tests, model, taken, refused)
        if best < 0:
            return result
        if not taken and not refused:
            top = maximise(data, model, named(usual(model))).value
            missed = top - value
        _, slope, precision = one_more(tests, taken)
        size, one = float(slope[best] / precision[best]), tests.kinds[best]
        limit = float(tests.limits[best])
        # The likelihood has to rise, unless the model is no optimum to compare with.
        gain = -math.inf if one.kind.innocent or 2 * missed > limit else 0.5 * limit
        optimum = _beside(tests, model, data, [*taken, best], top + gain)
        if optimum is None and gain > 0:
            refused.append(best)
            continue
        taken.append(best)
        top = top if optimum is None else max(top, optimum.value)
        size = size * one.scale
        error = abs(size) / math.sqrt(statistic)
        departure = Departure(
            one.kind, one.where, size, statistic, limit, error, one.record, one.begins
        )
        result.append((departure, one))
    return result


def _best_candidate(
    tests: Tests, model: LoopModel, taken: Sequence[int], refused: Sequence[int] = ()
) -> tuple[int, float]:
    """Return the most significant structure beside those taken and its statistic; -1 if none is."""
    names = np.array([one.kind.name for one in tests.kinds])
    signs = np.array([one.kind.sign for one in tests.kinds])
    # A change by more than the quantity itself is what a rotor at rest makes of its noise.
    # The coefficients of a force law's terms have no such limit.
    shares = np.array([one.kind.unit == "%" for one in tests.kinds]) & (names != "force law")
    limits = np.where(shares, FULL, math.inf)
    scales = np.array([one.scale for one in tests.kinds])
    left, slope, precision = one_more(tests, taken)
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


def _beside(
    tests: Tests, model: LoopModel, data: Data, taken: Sequence[int], least: float
) -> Optimum | None:
    """Return the most likely parameters beside structures, if the likelihood exceeds `least`."""
    # To second order it does as the score promises. Where records hardly determine the parameters
    # it need not: there the other parameters cannot adapt as far as the score lets them.
    sizes = sizes_of(tests, taken)
    for share in SHARES:
        optimum = optimum_beside(model, data, [tests.kinds[at] for at in taken], share * sizes)
        if optimum is not None and optimum.value > least:
            return optimum
    return None
