"""Estimated unbalance and runout at the end of a record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.quantity_arguments import of_type
from ambkit.data.record import Record
from ambkit.estimate.estimator import Estimator
from ambkit.result.row import Row, put

UNCHANGED = 0.5  #: Remaining share of the initial standard deviation that means no information.
CLEAR = 3.0  #: Minimum amplitude, in standard deviations, with a defined angle.


@dataclass(frozen=True, eq=False)
class Harmonic:
    """A vector that rotates with the rotor, at its angle at the start of the record."""

    name: str  #: ``U1``: unbalance of the first plane; ``r1_La``: runout of a sensor, order 1.
    role: str  #: Role of the states.
    unit: str  #: Of cosine and sine: kg m of unbalance, m of runout.
    cosine: float  #: Of the vector, in `unit`.
    sine: float
    covariance: Array  #: (2, 2) Covariance of these, in `unit` squared.
    start: float  #: Initial standard deviation of each, in `unit`.
    start_share: float  #: Share of the variance on which the record has no information [1].
    order: int = 1  #: Turns per turn of the rotor.

    @property
    def std(self) -> float:
        """Standard deviation in the least known direction, in `unit`."""
        return math.sqrt(max(float(np.linalg.eigvalsh(self.covariance)[-1]), 0.0))

    @property
    def by_start(self) -> bool:
        """Whether most of the uncertainty is that at the start."""
        # That is the case at constant speed, at which unbalance and runout cannot be separated.
        return self.start_share > 0.5

    @property
    def amplitude(self) -> tuple[float, float] | None:
        """Amplitude and its standard deviation, in `unit`."""
        # None if the initial variance dominates, or the amplitude is not significant: then only
        # cosine, sine and their covariance are meaningful.
        size = math.hypot(self.cosine, self.sine)
        if self.by_start or size <= CLEAR * self.std:
            return None
        along = np.array([self.cosine, self.sine]) / size
        return size, math.sqrt(float(along @ self.covariance @ along))

    @property
    def angle(self) -> tuple[float, float] | None:
        """Angle and its standard deviation [rad]; None without an amplitude."""
        size = self.amplitude
        if size is None:
            return None
        across = np.array([-self.sine, self.cosine]) / size[0]
        std = math.sqrt(float(across @ self.covariance @ across)) / size[0]
        return math.atan2(self.sine, self.cosine), std

    def rows(self, of: tuple[str, ...]) -> list[Row]:
        """Return its figures; cosine and sine are shown without an amplitude."""
        unit, known = "g mm" if self.role == "unbalance" else "m", self.amplitude is not None
        (cc, cs), (_, ss) = self.covariance
        both = math.sqrt(cc * ss)
        why = (
            "the machine file carries more information than the record"
            if self.by_start
            else "it is not significant"
        )
        note = f"{self.name}: {why}; correlation {cs / both if both > 0 else 0.0:z.2f} with sine"
        results = [
            Row("role", "role", self.role),
            Row("order", "order", self.order, detail=True),
            Row("cosine", "cosine", self.cosine, unit, 3, detail=known,
                note="" if known else note),
            Row("cosine_std", "std of cosine", math.sqrt(max(cc, 0.0)), unit, 2, detail=known),
            Row("sine", "sine", self.sine, unit, 3, detail=known),
            Row("sine_std", "std of sine", math.sqrt(max(ss, 0.0)), unit, 2, detail=known),
            Row("start_std", "initial std", self.start, unit, detail=True),
            Row("start_share", "share of the initial value", self.start_share, "%", detail=True),
            Row("start_dominates", "initial value dominates", self.by_start, detail=True),
        ]  # fmt: skip
        if self.amplitude is not None and self.angle is not None:
            (size, size_std), (angle, off) = self.amplitude, self.angle
            results += [
                Row("amplitude", "amplitude", size, unit),
                Row("amplitude_std", "std of amplitude", size_std, unit, 2),
                Row("angle", "angle", angle, "deg"),
                Row("angle_std", "std of angle", off, "deg"),
            ]
        return put(results, section=(*of, "synchronous"), of=self.name)


def harmonics(estimator: Estimator, record: Record) -> list[Harmonic]:
    """Return the synchronous quantities of an estimator after a record.

    Parameters
    ----------
    estimator : Estimator
        Estimator of a machine, at the end of the record.
    record : Record
        With the ``speed`` of rotation [rad/s], unless it is the machine's.

    Returns
    -------
    list of Harmonic
        One for each pair of synchronous states, in order; empty without such states.
    """
    of_type(Estimator, estimator=estimator)
    mean, covariance, start = estimator.mean, estimator.covariance, estimator.default_std()
    places = [k for k, s in enumerate(estimator.states) if s.role in ("unbalance", "runout")]
    if not places:
        return []
    angle, shares = _turned(estimator, record), _start_shares(covariance, start, places)
    results = []
    for first, second in zip(places[::2], places[1::2], strict=True):
        state = estimator.states[first]
        name = state.name.rsplit("_", 1)[0]
        order = 1 if state.role == "unbalance" else int(name.split("_", 1)[0].removeprefix("r"))
        c, s = math.cos(order * angle), math.sin(order * angle)
        back = np.array([[c, s], [-s, c]])
        pair = [first, second]
        cosine, sine = back @ mean[pair]
        spread = back @ covariance[np.ix_(pair, pair)] @ back.T
        results.append(
            Harmonic(name, state.role, state.unit, float(cosine), float(sine), spread,
                     float(start[first]), shares[first], order)
        )  # fmt: skip
    return results


def _start_shares(covariance: Array, start: Sequence[float], places: list[int]) -> dict[int, float]:
    """Return `Harmonic.start_share` of the first of each pair."""
    scale = 1 / np.array(start)[places]
    values, ways = np.linalg.eigh(scale[:, None] * covariance[np.ix_(places, places)] * scale)
    unobserved = np.where(values > UNCHANGED**2, values, 0.0)
    share = (ways**2 @ unobserved).reshape(-1, 2).sum(axis=1)
    total = (ways**2 @ np.maximum(values, 0.0)).reshape(-1, 2).sum(axis=1)
    result = np.divide(share, total, out=np.zeros_like(share), where=total > 0)
    return dict(zip(places[::2], result.tolist(), strict=True))


def _turned(estimator: Estimator, record: Record) -> float:
    """Return the rotor's angle at the end of a record [rad]."""
    speed = record.signals.get("speed", np.full(len(record.t), estimator.machine.speed))
    return float(np.sum((speed[1:] + speed[:-1]) / 2 * np.diff(record.t)))
