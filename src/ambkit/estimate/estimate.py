"""Estimates of a record: states, innovations, status."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError
from ambkit.base.escaping import label, markdown
from ambkit.data import frames
from ambkit.data.record import Record
from ambkit.estimate.estimate_panels import innovation_panel, settled_samples, with_limits
from ambkit.estimate.status import Status as Status
from ambkit.models.model import Descriptor
from ambkit.result.card import SPAN, Card, spread
from ambkit.result.report import Axis, Band, Figure, Item, Line, Panel
from ambkit.result.showing import Shown
from ambkit.result.signal_styles import CURRENT, DISTURBANCE, POSITION, TIME, VELOCITY

UNITS = {"k_i": "N/A", "k_s": "N/m", "innovation": "m", "innovation_variance": "m^2", "status": "1"}


def packed(i: int, j: int, n: int) -> int:
    """Return the index of entry (i, j), i <= j, in an upper triangle of n rows, row by row."""
    return i * n - i * (i + 1) // 2 + j


def _covariances(states: Sequence[Descriptor]) -> dict[str, str]:
    """Return name and unit of each entry of the upper triangle, row by row."""
    return {
        f"cov_{a.name}_{b.name}": f"({a.unit}) ({b.unit})"
        for i, a in enumerate(states)
        for b in states[i:]
    }


@dataclass(frozen=True, eq=False)
class Estimate(Shown, frames.Framed):
    """Estimates of one estimator along a record, n samples.

    A DataFrame has a column for each state, then ``k_i``, ``k_s``, ``innovation``,
    ``innovation_variance``, ``status``, and if available ``scale``, ``scale_variance`` and the
    covariances, ``cov_x_v``; a Dataset has the same variables.

    Attributes
    ----------
    t : ndarray (n,)
        Time [s].
    mean : ndarray (n, states)
        Displacement x [m], velocity v [m/s], disturbance force f_d [N], lagged position x_m [m],
        and further states of the model.
    innovation, innovation_variance : ndarray (n,) or (n, readings)
        Measurement minus prediction [m], and its expected variance S [m^2]. The innovation is zero
        if the measurement was not used, except for outliers. The variance is zero if the estimator
        does not compute it.
    k_i, k_s : ndarray (n,) or (n, axes)
        Stiffnesses used by the prediction [N/A], [N/m].
    status : ndarray of uint16 (n,)
        Flags of :class:`Status`.
    covariance : ndarray (n, states (states + 1) / 2) or None
        Upper triangle of the covariance, row by row [products of the states' units]. That of a
        disturbance force includes the error of the filter's force law at the operating point.
    estimator : str
        Name of the estimator.
    states : tuple of Descriptor
        Descriptors of the columns of the mean: name, unit, typical size, role.
    scale, scale_variance : ndarray (n,) or None
        Estimated magnet constant relative to the known one, and its variance [1]; None if not
        estimated.
    axes, readings : tuple of str
        Names of axes and readings; empty with one axis.
    """

    t: Array
    mean: Array
    innovation: Array
    innovation_variance: Array
    k_i: Array
    k_s: Array
    status: NDArray[np.uint16]
    covariance: Array | None
    estimator: str
    states: tuple[Descriptor, ...]
    scale: Array | None = None
    scale_variance: Array | None = None
    axes: tuple[str, ...] = ()
    readings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        columns = ", ".join(f"{state.name} [{state.unit}]" for state in self.states)
        span = f"{self.t[0]:g} to {self.t[-1]:g} s, {len(self.t)} samples"
        return f"<Estimate of the {self.estimator}, {span}: {columns}>"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states, in their order."""
        return tuple(state.name for state in self.states)

    def __getitem__(self, name: str) -> Array:
        """Return a state by its symbol: ``estimate["f_d"]``; also k_i, k_s, innovation."""
        if name in self.names:
            return self.mean[:, self.names.index(name)]
        if name in ("k_i", "k_s", "innovation", "innovation_variance"):
            return np.asarray(getattr(self, name))
        raise KeyError(f"{name!r}; known: {', '.join((*self.names, 'k_i', 'k_s', 'innovation'))}")

    @property
    def x(self) -> Array:
        """Displacement [m], (n,)."""
        return self["x"]

    @property
    def v(self) -> Array:
        """Velocity [m/s], (n,)."""
        return self["v"]

    @property
    def f_d(self) -> Array:
        """Disturbance force f_d [N], (n,)."""
        return self["f_d"]

    @property
    def x_m(self) -> Array:
        """Lagged position [m], (n,)."""
        return self["x_m"]

    def states_with_role(self, role: str) -> tuple[str, ...]:
        """Return the names of the states of a role.

        Parameters
        ----------
        role : str
            Such as ``"current"`` or ``"noise"``, see `Descriptor`.
        """
        return tuple(state.name for state in self.states if state.role == role)

    @property
    def sensor_noise(self) -> Array | None:
        """Estimated coloured noise and line noise of the measurement [m], (n,).

        None if they are not states.
        """
        names = self.states_with_role("noise")
        return np.asarray(sum(self[name] for name in names)) if names else None

    @property
    def nis(self) -> Array:
        """Normalised innovation squared, (n,) [1]; its mean is 1 if model and noise are correct.

        The mean over several readings. NaN if the estimator has no variance.
        """
        with np.errstate(divide="ignore", invalid="ignore"):  # undefined without variance
            nis = self.innovation**2 / self.innovation_variance
        parts = np.where(self.innovation_variance > 0, nis, np.nan)
        return np.asarray(parts.mean(axis=1) if parts.ndim > 1 else parts)

    @property
    def units(self) -> dict[str, str]:
        """SI units of the states, by their names."""
        return {state.name: state.unit for state in self.states}

    def _numbers(self) -> dict[str, tuple[NDArray[Any], str]]:
        """Return stiffnesses, innovations and status by column name, with units."""
        results: dict[str, tuple[NDArray[Any], str]] = {}
        for name, unit in UNITS.items():
            values = getattr(self, name)
            if values.ndim == 1:
                results[name] = values, unit
                continue
            of = self.axes if name in ("k_i", "k_s") else self.readings
            results |= {f"{name}_{item}": (values[:, k], unit) for k, item in enumerate(of)}
        return results

    @property
    def used(self) -> NDArray[np.bool_]:
        """Whether the measurement was used, (n,)."""
        unused = Status.MISSING | Status.FROZEN | Status.BAD_VARIANCE | Status.OUTLIER
        return np.asarray((self.status & np.uint16(unused)) == 0)

    def std(self, name: str) -> Array:
        """Standard deviation of a state, (n,) [unit of the state].

        Parameters
        ----------
        name : str
            Name of the state.

        Raises
        ------
        ValueError
            The covariances were not stored.
        """
        if self.covariance is None:
            raise ValueError("run(record, covariance=True) keeps the covariances that std needs")
        i = self.names.index(name)
        variance = self.covariance[:, packed(i, i, len(self.states))]
        return np.asarray(np.sqrt(variance), dtype=float)

    def to_record(self) -> Record:
        """Return the estimates as a :class:`Record`, ready to be saved or plotted."""
        signals = {name: self[name] for name in self.names}
        units = self.units
        for name, (values, unit) in self._numbers().items():
            signals[name], units[name] = values.astype(float), unit
        return Record(self.t, signals, units, meta={"estimator": self.estimator})

    def _series(self) -> frames.Series:
        columns: dict[str, NDArray[Any]] = {name: self[name] for name in self.names}
        units = self.units
        for name, (values, unit) in self._numbers().items():
            columns[name], units[name] = values, unit
        if self.scale is not None and self.scale_variance is not None:
            columns |= {"scale": self.scale, "scale_variance": self.scale_variance}
            units |= {"scale": "1", "scale_variance": "1"}
        if self.covariance is not None:
            for place, (name, unit) in enumerate(_covariances(self.states).items()):
                columns[name], units[name] = self.covariance[:, place], unit
        states = [list(asdict(state).values()) for state in self.states]
        about: dict[str, Any] = {"estimator": self.estimator, "states": states}
        if self.axes:
            about |= {"axes": list(self.axes), "readings": list(self.readings)}
        return frames.Series(self.t, columns, units, about)

    @classmethod
    def _of_series(cls, series: frames.Series, units: Mapping[str, str] | None) -> Estimate:
        series = frames.in_si(series, units) if units else series
        columns, about = dict(series.columns), series.about
        try:
            states = tuple(Descriptor(*state) for state in about["states"])
            mean = np.column_stack([columns[state.name] for state in states])
            axes, readings = (tuple(about.get(of, ())) for of in ("axes", "readings"))
            several = {"k_i": axes, "k_s": axes}
            several |= dict.fromkeys(("innovation", "innovation_variance"), readings)
            of_core = {
                name: np.column_stack([columns[f"{name}_{item}"] for item in several[name]])
                if several.get(name)
                else columns[name]
                for name in UNITS
            }
            entries = _covariances(states)
            pairs = [columns[name] for name in entries if name in columns]
            if len(pairs) not in (0, len(entries)):
                raise KeyError("a covariance")
            return cls(
                t=series.t,
                mean=mean,
                **of_core | {"status": of_core["status"].astype(np.uint16)},
                covariance=np.column_stack(pairs) if pairs else None,
                estimator=str(about["estimator"]),
                states=states,
                scale=columns.get("scale"),
                scale_variance=columns.get("scale_variance"),
                axes=axes,
                readings=readings,
            )
        except (KeyError, TypeError, ValueError) as error:
            raise RecordError(f"is not a complete estimate of ambkit: {error} is missing") from None

    def save(self, path: str | Path) -> None:
        """Write the estimates to a file.

        Parameters
        ----------
        path : path
            Ends with ``.csv`` or ``.parquet``.
        """
        self.to_record().save(path)

    def _card(self) -> Card:

        return estimate_card(self)


AXES = {
    "position": POSITION,
    "velocity": VELOCITY,
    "disturbance force": DISTURBANCE,
    "current": CURRENT,
}
"""Plotted states, by role."""


def estimate_figure(estimate: Any) -> Figure:
    """Plot the states with their 95 % bands, and the innovations."""
    t = estimate.t
    time = replace(TIME, limits=(float(t[0]), float(t[-1])))
    settled = settled_samples(t, [estimate])
    panels = []
    for role, axis in AXES.items():
        items: list[Item] = []
        names = estimate.states_with_role(role)
        for place, name in enumerate(names):
            style = f"series {1 + place % 4}" if len(names) > 1 else "estimate"
            if estimate.covariance is not None:
                half = 2 * estimate.std(name)
                mean = estimate[name]
                items.append(Band(t, mean - half, mean + half, signal=style, label="±2σ"))
            text = label(name) if len(names) > 1 else None
            items.append(Line(t, estimate[name], signal=style, label=text))
        if items:
            panels.append(Panel(time, with_limits(axis, items, settled), items))
    if estimate.scale is not None:
        scale: list[Item] = [Line(t, estimate.scale, signal="identified", label="")]
        panels.append(Panel(time, Axis("magnet constant over the known"), scale))
    return Figure(
        id="estimate",
        title=markdown(estimate.estimator),
        caption="Errors at the start may exceed the axes.",
        panels=[*panels, innovation_panel("", estimate, time, [])],
    )


def estimate_card(of: Any) -> Card:
    """Describe an estimate by its states and their consistency."""
    rows = [[state.name, *spread(of[state.name], state.unit)] for state in of.states]
    rows.append(["innovation", *spread(of["innovation"], "m")])
    nis = of.nis[1:]  # the first sample's belongs to the start
    known = nis[np.isfinite(nis)]
    consistent = f"Mean NIS {known.mean():.3f} (1: consistent). " if known.size else ""
    flags = ", ".join(
        f"{flag.name} {count}"
        for flag in Status
        if flag and (count := int(((of.status & np.uint16(flag)) != 0).sum()))
    )
    title = f"{of.estimator}: {len(of.t)} samples"
    notes = [f"{consistent}Samples with a status: {flags or 'none'}."]
    return Card(title, rows, estimate_figure(of), ["", *SPAN], notes)
