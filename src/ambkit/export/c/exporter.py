"""Export of a filter, or a controller with its filter, as a folder of C."""

import hashlib
import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ambkit.base import files
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import QuantityLike, in_si, of_type
from ambkit.base.units import engineering
from ambkit.control.control import Control, LiftOff
from ambkit.control.controller_states import Controller
from ambkit.estimate.estimator import Estimator
from ambkit.export.c import calibration, control, cost, exported, render
from ambkit.export.c.c_literals import CPrecision, called, precision_of
from ambkit.export.c.cost import CLOCK, CYCLES_PER_INSTRUCTION, Cost
from ambkit.export.c.exported import Export
from ambkit.export.stiffness_table import MOST_NODES, TabulatedExpert
from ambkit.fuzzy.expert import Expert
from ambkit.judge.adequacy import require_adequate
from ambkit.judge.isolation.diagnosis import Distinction
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put
from ambkit.simulation.scenario import Scenario, check_for, settled_scenario

MOST_COUNTED = 65535  #: Maximum of an unsigned int with 16 bits, as on a TI C2000.


@dataclass(frozen=True, repr=False)
class CExport(Result):
    """Result of an export to C."""

    folder: Path  #: The folder.
    name: str  #: Prefix of all names.
    precision: CPrecision  #: Precision of the numbers.
    files: tuple[str, ...]  #: Files, relative to the folder, in alphabetical order.
    sources: tuple[str, ...]  #: Files that a controller compiles.
    configuration: str  #: Hash of everything that determines the estimator.
    table: TabulatedExpert | None  #: The table of an expert in tabulated form.
    cost: Cost | None  #: Cost on a Cortex-M4F, if measured; float only.

    TITLE = "{0.name} as C"

    @property
    def finding(self) -> str:
        return f"{self.title}: {self.folder}, {len(self.files) + 1} files."

    @property
    def rows(self) -> list[Row]:
        if self.table is None:
            return []
        rows, columns = self.table.k_i.shape
        return put([
            Row("rows", "rows", rows),
            Row("columns", "columns", columns),
            Row("force_bound", "bound on the deviation from the rules", self.table.bound, "N"),
            Row("force_error", "  maximum observed", self.table.error, "N"),
        ], section=("table",))  # fmt: skip

    SECTIONS = {("table",): Section("Table of the expert")}

    @property
    def series(self) -> dict[str, Any]:
        fields = ("name", "precision", "configuration", "sources", "files")
        return {"folder": str(self.folder)} | {name: getattr(self, name) for name in fields}


def export_c(
    machine: Machine,
    filter: Estimator,
    out: str | os.PathLike[str],
    *,
    prefix: str | None = None,
    loops: bool | None = None,
    editable: bool = False,
    scenario: Scenario | None = None,
    calibrated: bool = False,
    telemetry: bool = False,
    distinction: Distinction | None = None,
    force: bool = False,
) -> CExport:
    """Write a self-contained folder of C99: a filter for a machine."""
    of_type(Machine, machine=machine)
    of_type(Estimator, filter=filter)
    name = checked(prefix, filter.machine.name)
    _check_counts(filter)
    wrong = require_adequate(filter, machine, scenario, force=force)
    precision, magnet = precision_of(filter), filter.magnet
    built_in = filter.engine.built_in
    counted = precision == "float" and not editable and scenario is None
    spent = cost.of(filter) if counted else None
    controller: Controller | None = None
    if scenario is not None:
        controller, scenario = _controller(filter, scenario, editable=editable)
    if calibrated:
        if controller is None or scenario is None:
            raise AmbkitError("calibration needs a controller (a scenario)")
        calibration.check(controller, scenario)
    if distinction is not None and (editable or calibrated):
        raise AmbkitError("fault isolation needs constant parameters: no editable, no calibration")
    facts = _facts(magnet, precision) | _cost_facts(spent)
    if wrong:
        facts = {"MUST NOT FLY": "; ".join(wrong)} | facts
    if filter.description:
        facts = {"for": filter.description} | facts
    content = render.render(
        Export(
            filter, name, facts, loops, editable and built_in, controller, scenario, calibrated,
            framed=telemetry, rebuilt=editable and not built_in, distinction=distinction,
        )
    )  # fmt: skip
    if wrong and calibrated:  # input of a later A2L file
        calibration_data = json.loads(content.files["calibration.json"]) | {"must_not_fly": wrong}
        content.files["calibration.json"] = json.dumps(calibration_data, indent=2) + "\n"
    written = write_folder(Path(out), content.files)
    return CExport(
        written, name, precision, tuple(content.files), content.sources, content.configuration,
        magnet if isinstance(magnet, TabulatedExpert) else None, spent,
    )  # fmt: skip


@dataclass(frozen=True, repr=False)
class FilterCost(Result):
    """Cost of a filter on a Cortex-M4F."""

    filter: str  #: Name of the filter.
    machine: str  #: Name of the machine.
    cost: Cost
    clock: float  #: Clock of the processor [Hz].

    TITLE = "{0.filter} of {0.machine}"

    @property
    def finding(self) -> str:
        rate = engineering(self.cost.highest_rate(self.clock), "Hz", 3)
        clock = engineering(self.clock, "Hz", 4)
        return (
            f"{self.title}: {self.cost.instructions} instructions per step, sampling up to {rate} "
            f"at a clock of {clock}."
        )

    @property
    def rows(self) -> list[Row]:
        return self.cost.rows(self.clock)

    SECTIONS = {("cost",): Section("Cost on a Cortex-M4F, measured in qemu")}


def filter_cost(filter: Estimator, clock: QuantityLike) -> FilterCost:
    """Return the measured cost of a filter in float."""
    frequency = in_si("clock", clock, "Hz")
    if not frequency > 0:
        raise AmbkitError(f"clock must be greater than 0 Hz, is {frequency:g} Hz")
    spent = cost.of(filter)
    if spent is None:
        raise AmbkitError(
            f"the cost of the {filter.name} for {filter.machine.name} is not known: its states are "
            "not those of the paper's axis; 'ambkit pil' measures it"
        )
    return FilterCost(filter.name, filter.machine.name, spent, frequency)


def _controller(
    filter: Estimator, scenario: Scenario, *, editable: bool
) -> tuple[Controller, Scenario]:
    """Return the controller, and the scenario of its self-test."""
    machine, sequence = filter.machine, scenario.sequence or LiftOff()
    check_for(scenario, machine)
    if editable:
        raise AmbkitError("editable applies to filters only, not to controllers")
    controller = control.controller_of(filter, scenario.model_copy(update={"sequence": sequence}))
    if not machine.single:
        tested = settled_scenario(machine, scenario)
        return controller, tested.model_copy(update={"sequence": sequence})
    law = Control(type=controller.pid.type, feedback=controller.pid.feedback)
    return controller, Scenario(controller=law, sequence=sequence, seed=scenario.seed)


def _facts(magnet: MagnetModel, precision: CPrecision) -> dict[str, str]:
    """Return the README's facts on the filter, line by line."""
    facts: dict[str, str] = {"numbers": precision}
    if isinstance(magnet, Expert):
        facts["expert"] = f"{len(magnet.rules)} rules, from {magnet.source}"
    elif isinstance(magnet, TabulatedExpert):
        rows, columns = magnet.k_i.shape
        facts |= {
            "table": f"{rows} x {columns} nodes, displacement x current",
            "bound on its force error": engineering(magnet.bound, "N"),
            "largest error found": engineering(magnet.error, "N", digits=3),
        }
    return facts


def _check_counts(filter: Estimator) -> None:
    """Reject unsupported counts: of the core, and of an int with 16 bits."""
    called(filter)
    for limit in ("frozen_limit", "outlier_limit"):
        count = filter.core.parameters["set"][limit]
        if count > MOST_COUNTED:
            raise AmbkitError(
                f"{limit} must be at most {MOST_COUNTED}, what an unsigned int holds everywhere; "
                f"is {count}"
            )
    for magnet in exported.magnets_of(filter):
        rows, columns = (magnet.parameters.get(key, 0) for key in ("rows", "columns"))
        if rows * columns > MOST_NODES:
            raise AmbkitError(
                f"the table has {rows} x {columns} nodes, and an int of 16 bits counts at most "
                f"{MOST_NODES}; take a coarser one"
            )


def _cost_facts(spent: Cost | None) -> dict[str, str]:
    """Return the README's facts on the cost."""
    if spent is None:
        return {}
    facts = {
        "instructions a step (Cortex-M4F, in qemu)": (
            f"{spent.instructions}, the most seen {spent.most}; on no path more than {spent.bound}"
        )
    }
    if spent.trusted is not None:
        facts["without checks of the input"] = f"{spent.trusted}"
    if spent.selftest is not None:
        time = 1e3 * spent.selftest * CYCLES_PER_INSTRUCTION / CLOCK
        facts["self-test (Cortex-M4F, in qemu)"] = (
            f"about {spent.selftest / 1e6:.1f} million instructions: at 168 MHz, without wait "
            f"states, {time:.0f} ms"
        )
    return facts | {
        "flash": (
            f"{spent.code} bytes of code, {spent.constants} bytes of constants, by {spent.compiler}"
        ),
        "memory": f"{spent.state} bytes an instance, {spent.stack} bytes of stack seen",
    }


MANIFEST = "ambkit.sha256"  #: Hashes of an export's files, which identify an older export.


def write_folder(folder: Path, texts: dict[str, str]) -> Path:
    """Write all files, and remove obsolete ones of an older export."""
    # Beside an older export the user may have put other files; any other folder must be empty
    # except for hidden files, such as ``.git``.
    if not (folder / MANIFEST).exists() and any(folder.glob("[!.]*")):
        raise AmbkitError(
            f"{folder}: holds other files, and the {len(texts) + 1} of an export would lie among "
            "them; take a new folder or an empty one"
        )
    older = _earlier_files(folder / MANIFEST)
    for name, text in texts.items():
        path = folder / name
        same = path.is_file() and path.read_bytes() == text.encode()
        if name not in older and path.exists() and not same:
            raise AmbkitError(f"{path} is there already, and not from an export")
    lines = [f"{hashlib.sha256(text.encode()).hexdigest()}  {name}" for name, text in texts.items()]
    with files.replacing_in(folder, first=MANIFEST) as temporary:
        files.write_text(temporary / MANIFEST, "\n".join(lines) + "\n")
        for name, text in texts.items():
            files.make_folder((temporary / name).parent)
            files.write_text(temporary / name, text)
    for name in older - set(texts):
        (folder / name).unlink(missing_ok=True)
    return folder


def _earlier_files(manifest: Path) -> set[str]:
    """Return the files of an older export, except outside its folder."""
    if not manifest.exists():
        return set()
    names = {line.partition("  ")[2] for line in files.read_text(manifest).splitlines()}
    folder = manifest.parent.resolve()  # a link in it may lead anywhere
    return {name for name in names if name and (folder / name).resolve().is_relative_to(folder)}


LONGEST = 16  #: Maximum length, so that names differ within C99's 31 significant characters.

_WORDS = {
    "a header of C": (
        *("assert", "complex", "ctype", "errno", "fenv", "float", "inttypes", "iso646", "limits"),
        *("locale", "math", "setjmp", "signal", "stdarg", "stdbool", "stddef", "stdint", "stdio"),
        *("stdlib", "string", "tgmath", "time", "wchar", "wctype"),
    ),
    "a target of the build": (
        *("all", "all_build", "clean", "edit_cache", "help", "install", "package", "run_tests"),
        *("package_source", "rebuild_cache", "selftest", "test", "zero_check", "main"),
    ),
    "a word of C or C++": (
        *("auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else"),
        *("enum", "extern", "for", "goto", "if", "inline", "int", "long", "register", "restrict"),
        *("return", "short", "signed", "sizeof", "static", "struct", "switch", "typedef", "union"),
        *("unsigned", "void", "volatile", "while", "and", "asm", "bool", "catch", "class", "true"),
        *("delete", "explicit", "export", "false", "friend", "mutable", "namespace", "new", "not"),
        *("operator", "or", "private", "protected", "public", "template", "this", "throw", "try"),
        *("typeid", "typename", "using", "virtual", "xor", "nullptr", "noexcept", "constexpr"),
    ),
    "a device, and no file, on Windows": (
        *("aux", "con", "nul", "prn"),
        *(f"{port}{n}" for port in ("com", "lpt") for n in range(1, 10)),
    ),
}


def checked(prefix: str | None, name: str) -> str:
    """Return the prefix of an export."""
    if prefix is None:
        made = re.sub(r"\W", "_", name, flags=re.ASCII)[:LONGEST]
        return made if _wrong(made) is None else f"axis_{made}"[:LONGEST]
    if (wrong := _wrong(prefix)) is not None:
        raise AmbkitError(f"prefix {wrong}")
    return prefix


def _wrong(prefix: str) -> str | None:
    """Return its error, or None."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", prefix):
        return f'must be a C identifier, a letter first, is "{prefix}"'
    if len(prefix) > LONGEST:
        return f'must have at most {LONGEST} characters, "{prefix}" has {len(prefix)}'
    lower = prefix.lower()
    if lower == "amb" or lower.startswith(("amb_", "ambkit")):
        return f'must not be "{prefix}": the names of the core start with "amb_"; give another'
    for what, words in _WORDS.items():
        if lower in words:
            return f'must not be "{prefix}", which is {what}; give another'
    return None
