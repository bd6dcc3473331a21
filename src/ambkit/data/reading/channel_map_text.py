"""The lines of a channel map that is proposed, with comments that say why."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ambkit.base.arrays import Array, interpolated
from ambkit.base.escaping import toml_string
from ambkit.base.units import factor
from ambkit.data.files.log import FIRST, Log
from ambkit.data.reading.ambiguity import ambiguities
from ambkit.data.reading.candidates import Candidate
from ambkit.data.reading.channel_statistics import correlation, seen, slow
from ambkit.data.reading.choice import ProposedMap
from ambkit.data.reading.clock import examine, stated_step
from ambkit.data.reading.derived_channels import is_filtered
from ambkit.data.reading.faults import noise
from ambkit.data.reading.first_machine import WeightScale, weight_scale
from ambkit.data.reading.plausibility import has_no_noise
from ambkit.data.reading.position_search import in_steps
from ambkit.data.reading.signal_roles import in_one_unit
from ambkit.data.signals import si_unit

_OF_Y = {
    "r": "of which it is the reference",
    "x_logged": "of which it is an estimate",
    "v_logged": "whose rate it is",
}
"""Signals that have the direction of y, and why."""

_SCALES = {
    ("u", "1"): 'V"  # volts at full duty',
    ("y", "V"): 'mm/V"  # of the sensor: fill in',
    ("r", "V"): 'mm/V"  # of the sensor: fill in',
}
"""What a unit of a duty, or a volt of a sensor, stands for."""

SLOW = 0.1  #: Pole times sampling time from which on a log is too slow for identification.


def toml_lines(
    name: str, log: Log, assignment: ProposedMap, chosen: Mapping[str, Candidate],
    others: Sequence[ProposedMap],
) -> Iterator[str]:  # fmt: skip
    """Write the map."""
    yield f"# Proposed by 'ambkit read guess' for {name}. Review each line."
    yield "# Of each number in the log: value = sign * scale * number * unit + offset."
    for remark in log.remarks:
        yield f"# {remark[:1].upper()}{remark[1:]}."
    yield from _Map(log, assignment, chosen, others).lines()


class _Map:
    """A map while it is written."""

    def __init__(
        self, log: Log, assignment: ProposedMap, chosen: Mapping[str, Candidate],
        others: Sequence[ProposedMap],
    ) -> None:  # fmt: skip
        self.log, self.chosen, self.others = log, chosen, others
        self.channels, self.moves = assignment.channels, assignment.moves
        self.everything = [*self.channels, *(c for group in others for c in group.channels)]
        arrays = {c.where.get("array") if len(c.where) > 1 else None for c in self.chosen.values()}
        self.array = str(arrays.pop() or "") if len(arrays) == 1 else ""
        self.y, self.u, self.t = chosen["y"], chosen.get("u"), chosen.get("t")
        self.of_rotor = (  # whether y and u are the channels that move as a rotor does
            self.moves is not None
            and self.y is self.channels[self.moves.position]
            and self.u is self.channels[self.moves.control]
        )
        self.y_inverted, self.u_inverted, self.why_inverted = self._inverted()
        self.weight = self._weight_scale()
        own = (c.clock for role, c in self.chosen.items() if role != "t" and c.clock)
        self.clock = next(own, self.t.label if self.t else None)
        #: Signals of the map by the names of the clocks.
        self.clocks = {self.clock: "t"}

    def lines(self) -> Iterator[str]:
        """Yield time, signals, and what is not used."""
        for role, rivals, why in ambiguities(self.chosen, self.channels, self.moves):
            yield f"# ? {role}: {' or '.join(c.label for c in rivals)}: {why}."
        if self.array:
            yield f"array = {toml_string(self.array)}"
        if self.clock is None:
            yield ""
            yield from stated_step(self.log.head_text)
        else:
            yield from self._time(self.clock)
        for role, candidate in self.chosen.items():
            if role != "t":
                yield from self._signal(role, candidate)
        if self.u is None:
            yield "# Nothing looks like a control signal; a filter needs u."
        yield from self._rest()
        if self.weight is not None and self.u is not None:
            yield ""
            yield "# A first machine file, by gravity, for a rotor below one magnet:"
            most = float(abs(seen(self.u.values)).max()) * (self._amperes(self.u) or 1.0)
            hiss = noise(self.y.values)
            yield from (f"#   {line}" for line in self.weight.machine(hiss, most, self._step()))

    def _time(self, clock: str) -> Iterator[str]:
        yield ""
        if self.t is None or clock in self.log.clocks.values():
            yield f"# The clock of the channel group: {_rate(self.log.arrays[clock])}."
            yield from ("[signals.t]", f"column = {toml_string(clock)}", 'unit = "s"')
            return
        unit, seconds = self._unit_of_time(self.t)
        times = (-1 if self.t.turned else 1) * self.t.values * seconds
        yield f"# {self.t.label}: {', '.join(self.t.why)}; {_rate(times)}."
        yield "[signals.t]"
        yield from _where(self.t, self.array)
        why = "" if self.t.unit else "  # guessed from its size and steps"
        yield f"unit = {toml_string(unit)}{why}"
        yield from () if self.t.scale == "1" else (f"scale = {self.t.scale}",)
        if self.t.turned:
            yield "sign = -1  # it falls"

    def _unit_of_time(self, t: Candidate) -> tuple[str, float]:
        """Return in what a time counts, by its name, or as is likely, and that in seconds."""
        unit = t.unit or _likely_unit_of_time(self.log, t)
        return unit, float(t.scale) * factor(unit, "s")

    def _step(self) -> float:
        """Return the usual time between two samples [s]; 0 without a time."""
        if self.t is None:
            return 0.0
        return abs(float(np.nanmedian(np.diff(self.t.values)))) * self._unit_of_time(self.t)[1]

    def _inverted(self) -> tuple[bool, bool, str]:
        """Return whether y and u count the other way, and why: u is to push towards positive y."""
        y, u = self.y, self.u
        if u is None or y.values.shape != u.values.shape:
            return False, False, ""
        falls = not u.unit and bool(np.mean(seen(u.values) < 0) > 0.99)  # a coil's is not below 0
        if self.of_rotor and self.moves is not None:
            is_inverted, why = self.moves.turned, "a greater u moves it towards smaller values"
        else:
            is_inverted = correlation(slow(u.values), slow(y.values)) > 0.3
            why = "u grows with it; of an unstable plant it must fall (or turn u)"
        return is_inverted != falls, falls, why

    def _weight_scale(self) -> WeightScale | None:
        """Say where the magnet is, of a rotor that hangs below one of current never below 0."""
        y, u = self.y, self.u
        if self.moves is None or not self.of_rotor or u is None or self.t is None:
            return None
        control = (-1 if self.u_inverted else 1) * interpolated(u.values)
        position, amperes = interpolated(y.values), self._amperes(u)
        if amperes is None:
            return None
        return weight_scale(self.moves, position, control, self._step(), amperes)

    def _amperes(self, u: Candidate) -> float | None:
        """Return the amperes of a unit of the control; 0 of a voltage, None where not known."""
        unit = self._unit("u", u)[0]
        if si_unit(unit) == "A":  # counts of a converter would be guessed as mA
            return factor(unit, "A") if u.unit or unit == "A" else None
        return 0.0

    def _signal(self, role: str, candidate: Candidate) -> Iterator[str]:
        clock, there = candidate.clock, seen(candidate.values)
        in_unit = f" {candidate.unit}" if candidate.unit else ""
        yield ""
        yield (
            f"# {candidate.label}: {', '.join(candidate.why) or 'by elimination'}; "
            f"{there.min():.4g} to {there.max():.4g}{in_unit}, "
            f"noise {noise(candidate.values):.2g}{in_unit}."
        )
        if role == "y" and not in_steps(there) and has_no_noise(there):
            yield "# It has no noise: is it an estimate, or simulated? A filter needs the reading."
        elif role == "y" and is_filtered(interpolated(candidate.values)):
            yield (
                "# Its noise falls towards high frequencies: is it an estimate, or filtered? A "
                "filter needs the reading."
            )
        if role == "y" and self.moves is not None:
            pole, step = self.moves.fit.pole, self._step()
            per = f"{pole / step:.3g} rad/s" if step > 0 else f"{pole:.3g} per sample"
            yield f"# Unstable, as a rotor in a magnetic bearing is: its pole is near {per}."
            if pole > SLOW:
                yield f"# {pole:.2g} per sample: sampled too slowly to identify a machine from it."
        apart = _own_time(candidate, self.t, self.everything)
        if apart is not None:
            clock = apart.label
            where, (unit, _) = [*_where(apart, self.array)], self._unit_of_time(apart)
            yield from self._own_clock(clock, role, where, unit)
        elif clock and clock != self.clock:
            yield from self._own_clock(clock, role, [f"column = {toml_string(clock)}"], "s")
        yield f"[signals.{role}]"
        yield from _where(candidate, self.array)
        yield from self._meaning(role, candidate)
        if clock and clock != self.clock:
            yield f"time = {toml_string(self.clocks[clock])}"

    def _unit(self, role: str, candidate: Candidate) -> tuple[str, str, str]:
        """Return the unit of a channel, its scale, and a comment where the unit is guessed."""
        if candidate.unit:
            return candidate.unit, candidate.scale, ""
        same, current = candidate, self.chosen.get("current")
        if role == "u" and current is not None and in_one_unit(candidate, current):
            same = current
        elif role in ("r", "x_logged"):
            same = self.y
        if same is self.y and self.weight is not None:
            return self.weight.unit, same.scale, "  # by the weight of the rotor"
        if role == "v_logged" and (unit := self._unit_of_velocity(candidate)):
            return unit, same.scale, f"  # as {self.y.label} changes"
        return same.unit or _likely_unit(same), same.scale, "  # guessed from its size"

    def _unit_of_velocity(self, v: Candidate) -> str:
        """Return the unit that makes a velocity the rate of y; empty where nothing tells."""
        y, step = self.y, self._step()
        if y.values.shape != v.values.shape or not step > 0:
            return ""
        unit, n, _ = self._unit("y", y)
        if si_unit(unit) != "m":
            return ""
        rate = np.gradient(y.slow) * (y.slow.size / y.values.size / step)
        size = float(n) * factor(unit, "m") * float(np.nanstd(rate))
        least = max(float(np.nanstd(v.slow)), 1e-300)
        units = {"m/s": 1.0, "mm/s": 1e-3, "µm/s": 1e-6}
        return min(units, key=lambda name: abs(np.log(max(size, 1e-300) / least / units[name])))

    def _meaning(self, role: str, candidate: Candidate) -> Iterator[str]:
        """Write unit, scale, sign and, as a hint, the offset of a channel."""
        (unit, n, comment), y, weight = self._unit(role, candidate), self.y, self.weight
        yield f"unit = {toml_string(unit)}{comment}"
        of_current = role == "u" and si_unit(unit) == "A"
        if of_current:
            why = "the current stands for the control signal: amplifier gain 1 A/V"
            yield f'scale = "{n} V/A"  # {why}'
            hint = "a sensor showed it: it is not held between samples"
            if "control" in self.chosen:
                yield f"measured = true  # {hint}"
            elif "current" not in self.chosen:
                yield f"# measured = true  # if {hint}"
        elif scale := _SCALES.get((role, si_unit(unit))):
            yield f'scale = "{n} {scale}'
        elif n != "1":
            yield f"scale = {n}"
        is_inverted = self.u_inverted if role in ("u", "current") else self.y_inverted
        falls = role in _OF_Y and y is not None and _likeness(role, candidate, y) < -0.3
        if role in ("y", *_OF_Y) and y is not None and is_inverted != falls:
            why = self.why_inverted if role == "y" else f"as {y.label}, {_OF_Y[role]}"
            yield f"sign = -1  # {f'it falls where {y.label} grows' if falls else why}"
        elif falls and y is not None:
            yield f"# sign = 1, for it falls where {y.label} grows, which is turned"
        elif role in ("u", "current") and is_inverted:
            yield "sign = -1  # it is below 0 all the time, as no coil's current is"
        elif candidate.role == "k" and candidate.turned:
            yield "sign = -1  # a mark lowers it"
        middle = float(n) * float(np.median(seen(candidate.values)))
        if role in ("y", "r", "x_logged") and y is not None:
            middle = middle if falls else float(y.scale) * float(np.median(seen(y.values)))
            away = middle if is_inverted != falls else -middle
            if si_unit(unit) == "V":  # with the scale above
                away, unit = away * factor(unit, "V"), "mm"
            yield f'# offset = "{away:.4g} {unit}"  # if x = 0 is at its median'
        elif of_current:
            away = (middle if is_inverted else -middle) * factor(unit, "A")
            yield f'# offset = "{away:.4g} V"  # if its median is the bias current'
        if role == "y" and weight is not None:
            yield from (
                f"# {line}" for line in weight.describe(y.label if y else role, candidate.unit)
            )
        if role in ("y", "u"):
            yield '# delay = "0 ms"  # how late the logger wrote it'

    def _own_clock(self, clock: str, role: str, where: list[str], unit: str) -> Iterator[str]:
        if clock not in self.clocks:
            self.clocks[clock] = f"t_{role}"
            yield "# It has a clock of its own: 'ambkit read --resample' puts all on one grid."
            yield f"[signals.{self.clocks[clock]}]"
            yield from where
            yield f"unit = {toml_string(unit)}"
            yield ""

    def _rest(self) -> Iterator[str]:
        chosen = [id(candidate) for candidate in self.chosen.values()]
        rest = [c for c in self.everything if id(c) not in chosen and c.label not in self.clocks]
        if rest:
            yield ""
            yield "# Not used:"
        for group in self.others:
            if group.moves is not None:
                yield (
                    f"# Other channels, of {group.channels[0].values.size} samples, move as a "
                    f"levitated rotor too: {group.channels[group.moves.position].label} with "
                    f"{group.channels[group.moves.control].label}. Is it another run?"
                )
        for candidate in rest:
            low, high = seen(candidate.values).min(), seen(candidate.values).max()
            unit = f" {candidate.unit}" if candidate.unit else ""
            why = f"; {', '.join(candidate.why)}" if candidate.why else ""
            yield f"# {candidate.label}: {low:.4g} to {high:.4g}{unit}{why}"


def _own_time(
    candidate: Candidate, t: Candidate | None, everything: Sequence[Candidate]
) -> Candidate | None:
    """Return the time of a channel that is not that of the others: of its structure, or length."""
    if t is None or candidate.clock:
        return None
    times = [c for c in everything if c.role == "t" and c.values.shape == candidate.values.shape]
    inside = [c for c in times if _structure(c) == _structure(candidate) != ""]
    if candidate.values.shape != t.values.shape:
        return next(iter(inside or times), None)
    same = _structure(t) == _structure(candidate)
    apart = [c for c in inside if not same and not np.array_equal(c.values, t.values)]
    return next(iter(apart), None)


def _structure(candidate: Candidate) -> str:
    """Return the name of the structure that a channel is in; empty where it is in none."""
    struct_name, dot, _ = str(candidate.where.get("array", "")).partition(".")
    return struct_name if dot else ""


def _likely_unit_of_time(log: Log, candidate: Candidate) -> str:
    """Guess in what a time counts: since 1970, by its size; otherwise by its steps."""
    times = seen(candidate.values)
    matches = filter(None, (FIRST.match(remark) for remark in log.remarks))
    first = next((float(m[2]) for m in matches if m[1] == candidate.label), float(times[0]))
    for unit, scale in (("s", 1.0), ("ms", 1e3), ("µs", 1e6), ("ns", 1e9)):
        if 5e8 < first / scale < 4.2e9:  # from 1985 to 2103
            return unit
    step = float(np.median(np.diff(times))) if times.size > 1 else 0.0
    # A machine is sampled at 50 Hz to 50 kHz.
    return "s" if step < 0.02 else "ms" if step < 20 else "µs" if step < 2e4 else "ns"


def _rate(times: Array) -> str:
    there = times[np.isfinite(times)]
    return examine("t", there).describe() if there.size > 1 else "one sample"


def _where(candidate: Candidate, array: str) -> Iterator[str]:
    for key, value in candidate.where.items():
        if key == "array" and value == array:
            continue
        yield f"{key} = {value if isinstance(value, int) else toml_string(value)}"


def _likeness(role: str, candidate: Candidate, y: Candidate) -> float:
    """Correlation of a reference or an estimate with y, of a velocity with the rate of y."""
    if candidate.values.shape != y.values.shape or y.values.size < 3:
        return 0.0
    place = slow(y.values)
    return correlation(
        slow(candidate.values), np.gradient(place) if role.startswith("v") else place
    )


def _likely_unit(candidate: Candidate) -> str:
    size = float(np.percentile(np.abs(seen(candidate.values)), 90))
    match candidate.role:
        case "y" | "r":
            # A sensor of millimetres has less noise than 40 µm.
            hiss = noise(candidate.values)
            return "m" if size < 0.05 else "mm" if size < 50 and hiss < 0.04 else "µm"
        case "v":
            return "m/s" if size < 5 else "mm/s"
        case "u" if candidate.called != "i":
            ends = seen(candidate.values).min(), seen(candidate.values).max()
            is_share = 0.0 in ends or 1.0 in ends or candidate.drives  # a duty saturates there
            return "1" if ends[0] >= 0 and size <= 1.0 and is_share else "V"
        case "i" | "u":
            return "A" if size < 100 else "mA"
    return "1"
