"""Alternative explanations of an identified model, each with its maximum likelihood.

Opposite offsets imitate a nonlinear force law or sensor, and a lag of the current resembles one of
the sensor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from ambkit.base.errors import ConfigError
from ambkit.base.units import engineering
from ambkit.identification.maximum_likelihood.alternatives import KINDS, Kind
from ambkit.identification.maximum_likelihood.likelihood import Data
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import OFFSETS, Parameter, named
from ambkit.identification.maximum_likelihood.search import Optimum, maximise
from ambkit.machine.force_law import MU_0
from ambkit.machine.laws import SaturatingLaw
from ambkit.machine.magnets import own_time
from ambkit.result.row import Row

FAR_OFFSET = 0.5  #: Share of the clearance above which an offset of the position is implausible.
USUAL_OFFSET = 0.1  #: Share of the clearance: standard deviation of such offsets.
FAR_CURRENT = 4.0  #: The same for the current, in standard deviations of its prior.
FAR_LAG = 2.0  #: Ratio to a described sensor lag above which a lag is implausible.
FAR_DELAY = 3.0  #: Samples of dead time beyond the described one that may be a lag.
FORGOTTEN = 6.0  #: Time constants of the plant until the current before a record has no effect.
LIKELY = 4.0  #: Twice a loss of log likelihood between about equally likely models.

SOFT, FULL = 0.05, 0.5
"""Where the search of a saturation begins: the iron as part of the gap, and the bias flux as part
of the saturated one."""


TURNS, PERMEABILITY = 100, 1000  #: Any will do: what counts is the magnet constant, and the iron.


@dataclass(frozen=True)
class Departure:
    """A structure in the records that the model lacks."""

    kind: Kind
    where: str
    size: float  #: In the unit of the kind.
    statistic: float  #: Twice the gain of log likelihood.
    limit: float  #: Limit for chance.
    error: float = 0.0  #: Standard error of the size; 0: unknown.
    record: int = 0  #: Number of its record, and sample at which it begins, if at any.
    begins: int = 0

    @property
    def text(self) -> str:
        """Description and advice, in a sentence."""
        size = self.rows()[0].text()
        sentence = self.kind.statement.format(size=size, where=self.where)
        return f"{sentence}: {self.kind.advice}." if self.kind.advice else f"{sentence}."

    def rows(self) -> list[Row]:
        """Return the figures as rows."""
        return [
            Row("size", "size", self.size, self.kind.unit, 2, error=self.error or None),
            Row("statistic", "score statistic", self.statistic, digits=2),
            Row("limit", "limit of chance", self.limit, digits=2),
        ]


def implausible(model: LoopModel, clearance: float) -> Iterator[str]:
    """Yield implausible offsets of a log, in sentences."""
    b = model.isolated
    if abs(model.position_offset) > FAR_OFFSET * clearance:
        offset, room = (engineering(v, "m", 2) for v in (model.position_offset, clearance))
        yield (
            f"The position offset of {offset} is implausible at a clearance of {room}: the force "
            "law is not that of the machine, or the zero of y is elsewhere."
        )
    value, std = model.known.get("current_offset", (model.current_offset, math.inf))
    if abs(model.current_offset - value) > FAR_CURRENT * std:
        offset, bias = (
            engineering(v, "A", 2) for v in (model.current_offset, b.magnet.bias_current)
        )
        yield (
            f"The current offset of {offset} is implausible at a bias current of {bias}: the force "
            "law is not that of the machine, or u has another zero or gain."
        )


@dataclass(frozen=True, eq=False)
class Refits:
    """An identified model, and the search of others beside it."""

    data: Data
    start: LoopModel  #: Where its search began.
    model: LoopModel  #: With the clearance of the search.
    parameters: Sequence[Parameter]

    @property
    def value(self) -> float:
        """Its log likelihood."""
        return self.data.log_likelihood(self.model)

    def centred(self) -> Optimum | None:
        """Return the most likely model without offsets; None where they were not looked for."""
        usual = {name: getattr(self.start, name) for name in OFFSETS}
        rest = [p for p in self.parameters if p.name not in OFFSETS]
        if not 0 < len(rest) < len(self.parameters):
            return None
        return maximise(self.data, self.model.replace(**usual), rest)

    def gain_of_offsets(self, centred: Optimum) -> float:
        """Return twice the gain of log likelihood by offsets, less their cost (BIC)."""
        count = len(self.parameters) - len(centred.likelihood.coordinates.parameters)
        return 2 * (self.value - centred.value) - count * math.log(max(centred.samples, 1))

    def needs_offsets(self, centred: Optimum) -> bool:
        """Whether offsets gain more than they cost, and than they are unusual."""
        usual = USUAL_OFFSET * self.start.isolated.clearance
        unusual = (self.model.position_offset - self.start.position_offset) / usual
        return self.gain_of_offsets(centred) > unusual**2

    def lag(self) -> Iterator[tuple[Departure, Refits]]:
        """Yield a current lag that was attributed to sensor or dead time, and the model with it."""
        # In the loop all are alike, but for the disturbance force, which acts after the current and
        # before the sensor, and for the gain over the frequency, which a dead time leaves as it is.
        # A sensor's lag is known to a factor of two.
        T, model, start = self.start.isolated.sampling_time, self.model, self.start
        identified, described = (one.isolated.sensor.lag for one in (model, start))
        longer, later = identified - described, model.delay - start.delay
        slow = longer > max(FAR_LAG * described, T)
        late = later > max(FAR_LAG * described, FAR_DELAY * T)
        if model.current_lag > 0 or not (slow or late):
            return
        swapped = [p for p in self.parameters if p.name != "sensor_lag"] + named(["current_lag"])
        begin = model.replace(
            sensor__lag=described,
            current_lag=longer if slow else later,
            delay=model.delay if slow else start.delay,
        )
        # The current before a record is unknown, which counts against a lag of the current.
        forgotten = FORGOTTEN * own_time(start.isolated)
        data = replace(self.data, settling=max(self.data.settling, forgotten))
        same, other = (
            maximise(data, at, free)
            for at, free in ((model, list(self.parameters)), (begin, swapped))
        )
        gain = 2 * (other.value - same.value) + math.log2(identified / described) ** 2
        limit = -LIKELY if slow else math.log(max(same.samples, 1))
        if gain > limit:
            lag, refits = other.model.current_lag, Refits(data, start, other.model, swapped)
            yield Departure(KINDS["lag"], engineering(lag, "s", 2), lag, gain, limit), refits

    def saturation(self, centred: Optimum, limit: float) -> Iterator[tuple[Departure, LoopModel]]:
        """Yield a magnet that saturates, and the model with it."""
        if centred.model.magnet is not None or centred.model.isolated.magnet.force_map is not None:
            return
        with suppress(ConfigError):
            more = centred.likelihood.coordinates.parameters + named(["saturation"])
            other = maximise(self.data, self._saturating(centred.model), more)
            gain = 2 * (other.value - centred.value)
            if gain > limit:
                lost = _lost(other.model)
                yield Departure(KINDS["saturation"], "", lost, gain, limit), other.model

    def _saturating(self, model: LoopModel) -> LoopModel:
        """Return a model whose magnet is as described at the operating point, and saturates."""
        # The search without offsets ends far off, where no current carries the rotor.
        m, wider = self.start.isolated.magnet, _wider(SOFT, FULL)
        if m.saturation is not None:
            return model
        gap, root = m.air_gap / wider, 2 * wider - (1 + SOFT + FULL)
        constant = m.magnet_constant * root / (wider - FULL)
        return model.replace(magnet__air_gap=gap, magnet__magnet_constant=constant).replace(
            magnet__turns=TURNS,
            magnet__pole_area=4 * constant / (MU_0 * TURNS**2),
            magnet__iron_length=2 * PERMEABILITY * SOFT * gap,
            magnet__relative_permeability=PERMEABILITY,
            magnet__saturation=MU_0 * TURNS * m.bias_current / (2 * gap) / FULL,
        )


def _wider(iron: float, flux: float) -> float:
    """Return the effective gap of iron that saturates, in gaps (models/laws/saturating.py)."""
    return (1 + iron + flux + math.sqrt((1 + iron - flux) ** 2 + 4 * iron * flux)) / 2


def _lost(model: LoopModel) -> float:
    """Return the share of the force that saturation takes at the bias flux."""
    of = SaturatingLaw.parameters_of(model.isolated.magnet)
    iron = of["iron"] / of["s0"]
    return 1 - ((1 + iron) / _wider(iron, of["knee"] * of["i0"] / of["s0"])) ** 2
