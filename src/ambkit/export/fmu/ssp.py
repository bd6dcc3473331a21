"""Plant, estimator and controller as three connected FMUs: an SSP file."""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from ambkit.base.escaping import one_line
from ambkit.estimate.estimator import Estimator
from ambkit.export.fmu.exporter import FmuExport, export_fmu, write_archive
from ambkit.export.fmu.variables import Kind
from ambkit.export.fmu.xml import Fmi, written
from ambkit.machine.machine import Machine
from ambkit.simulation.scenario import Scenario

_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"

Wire = tuple[str, str, str, str]
"""From an element and its output to an element and its input; an empty element is the system."""


def export_ssp(
    machine: Machine,
    filter: Estimator,
    out: str | os.PathLike[str],
    *,
    fmi: Fmi = 2,
    scenario: Scenario | None = None,
    **options: Any,
) -> tuple[FmuExport, ...]:
    """Write plant, estimator and controller, connected, as a system for importers of SSP 1.0."""
    # An importer passes values from step to step: with a step of the sampling time the estimate
    # reaches the controller one sample late and its command the plant another, unlike the closed
    # loop of :func:`export_fmu`. With lift-off and landing, estimator and controller are one FMU,
    # the complete controller, which also switches the plant's currents.
    what = scenario or Scenario()
    has_sequence = what.sequence is not None
    kinds: dict[str, Kind] = {"plant": "plant", "controller": "controller"}
    kinds |= {"controller": "whole-controller"} if has_sequence else {"estimator": "estimator"}
    options |= {"fmi": fmi, "scenario": what}
    with tempfile.TemporaryDirectory() as place:
        made = {
            name: export_fmu(machine, filter, Path(place, f"{name}.fmu"), kind=kind, **options)
            for name, kind in kinds.items()
        }
        content = {f"resources/{one.path.name}": one.path.read_bytes() for one in made.values()}
    wires = _wires(made, estimate=what.feedback != "measurement" and not has_sequence)
    content["SystemStructure.ssd"] = description(machine.name, wires).encode()
    write_archive(Path(out), content)
    return tuple(made.values())


def _wires(made: dict[str, FmuExport], *, estimate: bool) -> list[Wire]:
    """Return the connections between elements, and to outside; `estimate`: the feedback."""
    sources = {
        "plant": ("controller",),
        "estimator": ("plant", "controller"),
        "controller": ("estimator",) if estimate else ("plant",),
    }
    plant, wires = made["plant"], list[Wire]()
    for element, one in made.items():
        for name in one.inputs:
            output = name
            if element == "controller" and not estimate and name in ("x", "v"):
                if name == "v":  # not an input of a PID with measurement feedback
                    continue
                output = "y"
            source = next((s for s in sources[element] if output in made[s].outputs), None)
            if source is not None:
                wires.append((source, output, element, name))
            elif not name.startswith("fault_") and name != "on":
                wires.append(("", name, element, name))
    displayed = [
        name for name in plant.outputs if name == "x" or name.startswith(("q_", "s_", "y"))
    ]
    wires += [("plant", name, "", name) for name in displayed]
    of_controller = [n for n in made["controller"].outputs if re.match(r"(u|mode)(_|$)", n)]
    wires += [("controller", name, "", name) for name in of_controller]
    element, before = list(made)[-1], "" if len(made) > 2 else "estimate."
    for output in made[element].outputs:
        name = output.removeprefix(before)
        if output.startswith(before) and (
            name == "x" or name.startswith("f_d") or f"q_{name}" in plant.outputs
        ):
            wires.append((element, output, "", f"estimate_{name}"))
    return wires


def description(name: str, wires: list[Wire]) -> str:
    """Write ``SystemStructure.ssd``."""
    for prefix, uri in (("ssd", _SSD), ("ssc", _SSC)):
        ElementTree.register_namespace(prefix, uri)
    root = ElementTree.Element(
        f"{{{_SSD}}}SystemStructureDescription", {"version": "1.0", "name": one_line(name)}
    )
    system = _under(root, "System", name="system")
    own = {wire[1]: "input" for wire in wires if not wire[0]}
    _connectors(system, own | {wire[3]: "output" for wire in wires if not wire[2]})
    elements = _under(system, "Elements")
    for element in dict.fromkeys(wire[0] for wire in wires if wire[0]):
        ends = {wire[1]: "output" for wire in wires if wire[0] == element}
        ends |= {wire[3]: "input" for wire in wires if wire[2] == element}
        component = _under(
            elements, "Component", name=element, type="application/x-fmu-sharedlibrary",
            source=f"resources/{element}.fmu",
        )  # fmt: skip
        _connectors(component, ends)
    connections = _under(system, "Connections")
    for start, output, end, input_name in wires:
        words = {"startConnector": output, "endConnector": input_name}
        words |= {"startElement": start} if start else {}
        words |= {"endElement": end} if end else {}
        _under(connections, "Connection", **words)
    return written(root)


def _connectors(of: ElementTree.Element, kinds: dict[str, str]) -> None:
    connectors = _under(of, "Connectors")
    for name, kind in kinds.items():
        connector = _under(connectors, "Connector", name=name, kind=kind)
        ElementTree.SubElement(connector, f"{{{_SSC}}}Real")


def _under(parent: ElementTree.Element, what: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, f"{{{_SSD}}}{what}", attributes)
