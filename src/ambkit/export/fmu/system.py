"""Plant, estimator and controller as three FMUs in one system: an SSP file."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

from ambkit.base.escaping import one_line
from ambkit.export.fmu import archive
from ambkit.export.fmu.exporter import FmuExport, export_fmu
from ambkit.export.fmu.xml import Fmi, written
from ambkit.simulation.scenario import PID

if TYPE_CHECKING:
    from ambkit.machine.bearing import Bearing
    from ambkit.machine.magnets import MagnetModel

_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"

_INPUTS = {
    "r": ("controller", "r"), "f_d": ("plant", "f_d"), "noise_u": ("plant", "noise_u"),
    "noise_y": ("plant", "noise_y"),
}  # fmt: skip
_OUTPUTS = {
    "x": ("plant", "x"), "y": ("plant", "y"), "u": ("controller", "u"),
    "estimate_x": ("estimator", "x"), "estimate_f_d": ("estimator", "f_d"),
}  # fmt: skip


def export_ssp(
    bearing: Bearing,
    magnet: MagnetModel | None,
    out: str | Path,
    *,
    fmi: Fmi = 2,
    controller: PID | None = None,
    **options: Any,
) -> tuple[FmuExport, ...]:
    """Write plant, estimator and controller, wired, as a system for importers of SSP 1.0.

    An importer hands values on from step to step: with a step of the sampling time the estimate
    reaches the controller one sample late and its demand the plant another, which the closed loop
    of :func:`export_fmu` does not have.

    Parameters
    ----------
    bearing, magnet
        As of :func:`export_fmu`.
    out : path
        The file, ``.ssp``.
    fmi : {2, 3}
        Of the three.
    controller : PID, optional
        By default tuned to the bearing, and fed by the estimator.
    **options
        Of :func:`export_fmu`: estimator, filter_file.

    Raises
    ------
    AmbkitError
        There is no C compiler, or the file cannot be written.
    """
    pid = (controller or PID()).completed(bearing)
    kinds: tuple[Any, ...] = ("plant", "estimator", "controller")
    with tempfile.TemporaryDirectory() as place:
        made = tuple(
            export_fmu(
                bearing,
                magnet,
                Path(place) / f"{kind}.fmu",
                kind=kind,
                fmi=fmi,
                controller=pid,
                **options,
            )
            for kind in kinds
        )
        content = {f"resources/{one.path.name}": one.path.read_bytes() for one in made}
    described = description(bearing.name, estimate=pid.feedback == "estimate")
    archive.write(Path(out), content | {"SystemStructure.ssd": described.encode()})
    return made


def description(name: str, *, estimate: bool) -> str:
    """Write ``SystemStructure.ssd``; `estimate`: the estimator feeds the controller."""
    fed = [("estimator", "x", "controller", "x"), ("estimator", "v", "controller", "v")]
    wires = [
        ("plant", "y", "estimator", "y"),
        ("controller", "u", "plant", "u"),
        ("controller", "u", "estimator", "u"),
        *(fed if estimate else [("plant", "y", "controller", "x")]),
    ]
    outside = [("", name, *inner) for name, inner in _INPUTS.items()]
    outside += [(*inner, "", name) for name, inner in _OUTPUTS.items()]
    for prefix, uri in (("ssd", _SSD), ("ssc", _SSC)):
        ElementTree.register_namespace(prefix, uri)
    root = ElementTree.Element(
        f"{{{_SSD}}}SystemStructureDescription", {"version": "1.0", "name": one_line(name)}
    )
    system = _under(root, "System", name="system")
    _connectors(system, {name: "input" for name in _INPUTS} | {n: "output" for n in _OUTPUTS})
    elements = _under(system, "Elements")
    for kind in ("plant", "controller", "estimator"):
        ends = {wire[1]: "output" for wire in [*wires, *outside] if wire[0] == kind}
        ends |= {wire[3]: "input" for wire in [*wires, *outside] if wire[2] == kind}
        component = _under(
            elements, "Component", name=kind, type="application/x-fmu-sharedlibrary",
            source=f"resources/{kind}.fmu",
        )  # fmt: skip
        _connectors(component, ends)
    connections = _under(system, "Connections")
    for start, output, end, given in [*wires, *outside]:
        words = {"startConnector": output, "endConnector": given}
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
