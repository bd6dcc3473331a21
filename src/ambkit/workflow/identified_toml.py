"""An identified machine as TOML, with the standard error of each value."""

from __future__ import annotations

import os

from ambkit.base.units import engineering
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.result import MaximumLikelihood
from ambkit.machine.machine import Machine


def annotated_toml(
    result: MaximumLikelihood,
    folder: str | os.PathLike[str] | None = None,
    machine: Machine | None = None,
) -> str:
    """Return the machine as TOML, each identified value with its standard error."""
    # Values of the log rather than the machine (offsets, load, an insignificant delay) are in
    # comments at the top, with the lines of a channel map that correct them. Paths are relative to
    # `folder`, the destination.
    several = None if machine is None or machine.single else machine
    in_bearing = {"current_lag": ("amplifier", "bandwidth")}
    if result.delay_counts:
        in_bearing["delay"] = ("", "delay")
    places = {in_bearing.get(p.name, tuple(p.place.split("__"))): p for p in result.parameters}
    lines = [f"# Identified by maximum likelihood from {result.samples} measurements."]
    for p in result.parameters:
        of_log = "__" not in p.place and p.name not in in_bearing
        if of_log or several:
            of = "log" if of_log else f"axis {result.isolated.name}"
            value = engineering(result[p.name], p.unit, 4)
            error = result.error_text(p)
            lines.append(f"# Of the {of}: {p.name} = {value} (standard error {error}).")
    lines += [f"# Not found: {name}: {why}." for name, why in result.held.items()]
    carried = carried_over(
        result.model, delay=not result.delay_counts, offsets=result.offsets_count
    )
    lines += [f"# {line}".rstrip() for line in carried]
    table = ""
    if several:
        return "\n".join(lines) + "\n" + several.to_toml(folder)
    for line in result.isolated.to_toml(folder).splitlines():
        if line.startswith("["):
            table = line.strip("[]")
        place = table, line.partition(" = ")[0]
        if place in places:
            p = places[place]
            line += f"  # found, standard error {result.error_text(p)}"
            if p.name == "current_lag":
                line += f" of its lag, {engineering(result[p.name], p.unit, 4)}"
        lines.append(line)
    return "\n".join(lines) + "\n"


def carried_over(model: LoopModel, *, delay: bool = True, offsets: bool = True) -> list[str]:
    """Explain how values of the log enter a channel map and ``ambkit filter``."""
    # With these lines a record is read as `LoopModel.corrected` returns it, except for the current
    # lag, which belongs to the machine.
    volts = model.current_offset / model.isolated.amplifier.gain
    of_y = [f'offset = "{engineering(-model.position_offset, "m", 6)}"']
    of_u = [f'offset = "{engineering(volts, "V", 6)}"']
    if not (model.position_offset and offsets):
        of_y = []
    if not (volts and offsets):
        of_u = []
    if model.delay and delay:
        # Delay y is not an option: y would be interpolated, while the held u is averaged over the
        # sample.
        of_u.append(f'delay = "{engineering(-model.delay, "s", 6)}"  # it acts later than logged')
    lines = []
    for name, those in zip(model.signals, (of_y, of_u), strict=True):
        if those:
            lines += [f"[signals.{name}]", *those]
    if lines:
        lines = [
            "To filter this log, add to its channel map (to existing offsets and delays):",
            *(f"  {line}" for line in lines),
        ]
    known = _known_to_filters(model.delayed_machine(delay=not delay))
    if known:
        lines.append(f"{known} A map needs none.")
    intensity_text = f"{model.disturbance_noise:.4g} N^2/s"
    return [
        *lines,
        "Process noise of the disturbance force: ambkit filter ... --disturbance-noise "
        f'"{intensity_text}"',
    ]


def _known_to_filters(machine: Machine) -> str:
    """Return a sentence on loop parameters of the machine; empty if there are none."""
    known = [
        f"{what} of {engineering(value, unit, 4)}"
        for what, value, unit in (
            ("a delay", machine.delay, "s"),
            ("an amplifier", machine.amplifier.bandwidth, "Hz"),
        )
        if value is not None
    ]
    return f"The bearing has {' and '.join(known)}, which its filters know." if known else ""
