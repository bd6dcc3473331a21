"""C sources of an FMU: core, model, FMI layer and data; and their compilation."""

import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from importlib.metadata import distribution, version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from ambkit.base import escaping, files
from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.control.controllers import gains_of
from ambkit.control.pid import PID
from ambkit.estimate.estimator import Estimator
from ambkit.export import core_sources
from ambkit.export.c import c_literals, control, exported
from ambkit.export.c.c_literals import CPrecision, Kind
from ambkit.export.c.model import LOOPS, CModel, c_model
from ambkit.export.fmu.xml import COMPILER_OPTIONS, Fmi, Model
from ambkit.machine.machine import Machine
from ambkit.models.plant import Plant

_PRECISION = "include/ambkit/precision.h"
_HERE = Path(__file__).parent
_IN_LOOP = ("loop_model", "estimates", "filter", "rig")
_MODELS: dict[str, tuple[str, ...]] = {
    "estimator": ("estimator_model", "estimates", "filter"),
    "plant": ("plant_model", "rig", "plant_exchange", "exchange"),
    "late-plant": ("plant_model", "rig", "plant_alone"),
    "loop-pid": (*_IN_LOOP, "loop_pid"),
    "loop-flight": (*_IN_LOOP, "loop_flight", "flight"),
    "pid": ("controller_model",),
    "regulator": ("regulator_model",),
    "flight": ("flight_model", "estimates", "filter", "flight"),
}
"""C files of each kind, the one with the model's struct first."""
_STANDARD: dict[Fmi, tuple[str, ...]] = {
    2: ("fmi2FunctionTypes.h", "fmi2Functions.h", "fmi2TypesPlatform.h"),
    3: ("fmi3FunctionTypes.h", "fmi3Functions.h", "fmi3PlatformTypes.h"),
}


def library_files(
    texts: dict[str, str], filter: Estimator | None, of_model: CModel | None
) -> dict[str, str]:
    """Return the library's own C, core and simulation, that C files include."""
    # For each header the C file of the same name is added. All files are placed in ``sources/``, so
    # that it is the only include folder.
    instead = {LOOPS: None} if of_model is None else of_model.instead
    room = {} if of_model is None else of_model.room
    if room or c_literals.precision_of(filter) == "float":
        known = {"version": version("ambkit"), "room": room}
        values = known | {"float": c_literals.precision_of(filter) == "float"}
        instead = instead | {_PRECISION: rendered("precision.h.j2", values)}
    simulation, sim = core_sources.folder().parent / "sim", {}
    stems = _included("sim", texts)
    while more := _beside(simulation, stems) - stems:
        stems |= more
    for stem in stems:
        for name in (f"{stem}.h", f"{stem}.c"):
            if (simulation / name).is_file():
                sim[f"sim/{name}"] = (simulation / name).read_text(encoding="utf-8")
    headers = {f"include/ambkit/{stem}.h" for stem in _included("ambkit", texts | sim)}
    result = core_sources.closure(headers, instead=instead)
    sources: set[str] = set() if of_model is None else set(of_model.sources)
    while more := (_sources_of(result) | sources) - result.keys():
        result = core_sources.closure(headers := headers | more, instead=instead)
    laid = {name.removeprefix("include/").replace("src/", "core/"): t for name, t in result.items()}
    return laid | sim


def _included(folder: str, texts: dict[str, str]) -> set[str]:
    """Return the headers of a folder that texts include, without suffixes."""
    include = re.compile(rf'^#include "{folder}/(\w+)\.h"', re.MULTILINE)
    return {stem for text in texts.values() for stem in include.findall(text)}


def _beside(folder: Path, stems: set[str]) -> set[str]:
    """Return the headers of a folder that its own files of these names include."""
    files = [folder / f"{stem}{ending}" for stem in stems for ending in (".h", ".c")]
    text = "\n".join(file.read_text(encoding="utf-8") for file in files if file.is_file())
    named = set(re.findall(r'^#include "(\w+)\.h"', text, re.MULTILINE))
    return {stem for stem in named if (folder / f"{stem}.h").is_file()}


def _sources_of(names: Iterable[str]) -> set[str]:
    """Return the core's C files with the names of headers."""
    files = {f"src/{Path(name).stem}.c" for name in names if name.endswith(".h")}
    return {file for file in files if (core_sources.folder() / file).is_file()}


def model_files(model: str, fmi: Fmi) -> dict[str, str]:
    """Return the hand-written C around the core, and the standard's headers."""
    stems = ["model", "instance", f"fmi{fmi}", *_MODELS[model]]
    if "exchange" in stems:
        stems.append(f"fmi{fmi}_exchange")
    else:
        stems += ["no_exchange", f"fmi{fmi}_no_exchange"]
    own = [f"{stem}{ending}" for stem in stems for ending in (".h", ".c")]
    there = [_HERE / "c" / file for file in own if (_HERE / "c" / file).is_file()]
    texts = {file.name: file.read_text(encoding="utf-8") for file in there}
    for file in _STANDARD[fmi]:
        texts[file] = (_HERE / "standard" / file).read_text(encoding="utf-8")
    return texts


def licences() -> dict[str, str]:
    """Return the licences of the files in ``sources/``."""
    own = distribution("ambkit").read_text("licenses/LICENSE")
    texts = {"fmi-standard.txt": (_HERE / "standard" / "LICENSE.txt").read_text(encoding="utf-8")}
    return texts if own is None else texts | {"license.txt": own}


_DATA = ("filter", "rig", "nominals", "pid", "law", "controller", "k_ui", "K_sen")


def data_files(model: str, **context: Any) -> dict[str, str]:
    """Return the files that define the data declared by this model's headers."""
    values: dict[str, Any] = dict.fromkeys(_DATA) | context
    headers = [f"{stem}.h" for stem in _MODELS[model] if (_HERE / "c" / f"{stem}.h").is_file()]
    rig = values["rig"] or {"magnets": [], "coils": []}
    magnets = [
        *(values["filter"] or {}).get("magnets", ()), *rig["magnets"], *filter(None, rig["coils"]),
    ]  # fmt: skip
    headers += dict.fromkeys(magnet["magnet_header"] for magnet in magnets)
    known = {"version": version("ambkit"), "headers": headers}
    files = {"data.c": rendered("data.c.j2", known | values)}
    if values["filter"] or values["law"]:
        in_core = values["filter"] and values["filter"]["in_core"]
        header_values = {"in_core": in_core} | {k: values[k] for k in ("controller", "law", "k_ui")}
        files["data.h"] = rendered("data.h.j2", known | header_values)
    return files


def description_files(kind: str, model: Model) -> dict[str, str]:
    """Return the table of the variables, in C."""
    context = {
        "kind_header": f"{_MODELS[kind][0]}.h",
        "variables": model.variables,
        "blocks": [variable for variable in model.variables if variable.first],
        "version": model.version,
        "token": model.token,
        "sampling_time": c_literals.number(model.sampling_time, "double"),
        "continuous_states": len(model.rates),
    }
    return {
        "description.h": rendered("description.h.j2", context),
        "description.c": rendered("description.c.j2", context),
    }


def filter_data(filter: Estimator) -> dict[str, Any]:
    """Return the data file of an estimator."""
    precision, of_model = c_literals.precision_of(filter), c_model(filter)
    gain = np.ravel(getattr(filter, "gain", ()))  # where it is constant
    magnets = [
        magnet_data(held, f"magnet_{k}", precision)
        for k, held in enumerate(exported.magnets_of(filter))
    ]
    return {
        "magnets": magnets,
        "settings": c_literals.struct_with_arrays(filter.core.parameters["set"], precision),
        "arrays": c_literals.declared(of_model.arrays, precision),
        "model": c_literals.struct(of_model.numbers, precision),
        "in_core": c_literals.called(filter),
        "own": c_literals.own(filter, precision),
        "std": c_literals.array(np.asarray(filter.default_std()), precision),
        "law_error": filter.law_error.size and c_literals.array(filter.law_error, precision),
        "gain": gain.size and c_literals.array(gain, precision),
        **{name: c_literals.array(start, precision) for name, start in _starts(filter).items()},
    }


def _starts(filter: Estimator) -> dict[str, Array]:
    """Return the initial states of an estimator, by positions, currents and readings."""
    view, states = filter.view, filter.states
    nothing, values = np.zeros(len(view.isolated)), np.eye(len(view.isolated))

    def at(q: Array, currents: Array) -> Array:
        return view.equilibrium_state(states, filter.levitation_current, q, None, currents).ravel()

    middle = np.zeros(view.H.shape[1])
    levitation = Plant(filter.machine).equilibrium(nothing, nothing)[0]
    results = {
        "rest": at(levitation, nothing),
        "by_place": np.column_stack([at(q, nothing) for q in view.placed.T]).ravel(),
        "by_current": np.column_stack([at(middle, column) for column in values]).ravel(),
    }
    if view.single:
        return results | {"start_by": np.zeros(0), "hover": np.asarray(filter.levitation_current)}
    start, start_by = view.start_form(states, filter.levitation_current)
    return results | {"start": start, "start_by": start_by.ravel(), "hover": np.zeros(2)}


def magnet_data(held: Any, name: str, precision: CPrecision = "double") -> dict[str, Any]:
    """Return the data file of a magnet of the core, called `name`."""
    kind, fields = Kind(*held.in_c), held.parameters
    arrays = c_literals.arrays_of(fields)
    names = {path: f"{name}_{path.replace('.', '_')}" for path in arrays}
    return {
        "magnet_name": name,
        "magnet": c_literals.struct(fields, precision, names),
        "magnet_type": kind.type,
        "magnet_methods": kind.methods,
        "magnet_header": f"ambkit/{kind.source}.h",
        "arrays": c_literals.declared(
            {names[path]: array for path, array in arrays.items()}, precision
        ),
    }


def pid_data(machine: Machine, controller: PID) -> str:
    """Return a PID as an initialiser."""
    T = machine.sampling_time
    gains = gains_of(controller, T, machine.current_min, machine.current_max)
    return c_literals.struct(control.pid_fields(T, gains), "double")


def rendered(template: str, context: dict[str, Any]) -> str:
    """Render a template of this package."""
    templates = escaping.templates(_HERE / "templates", autoescape=template.endswith(".html.j2"))
    number = partial(c_literals.number, precision="double")
    return str(templates.get_template(template).render(context, number=number))


_NAMES = ("cc", "gcc", "clang")
_FLAGS = ("-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-s")  # -s: no names of this machine
_STRICT = ("-Wl,-z,defs",)  # missing symbols are reported here, not when the FMU is loaded


class _Platform(NamedTuple):
    """FMI's name of a platform, and the suffix of its libraries."""

    fmi_2: str
    fmi_3: str
    ending: str


_PLATFORMS = {
    ("linux", "x86_64"): _Platform("linux64", "x86_64-linux", ".so"),
    ("linux", "aarch64"): _Platform("aarch64-linux", "aarch64-linux", ".so"),
    ("darwin", "x86_64"): _Platform("darwin64", "x86_64-darwin", ".dylib"),
    ("darwin", "arm64"): _Platform("aarch64-darwin", "aarch64-darwin", ".dylib"),
}


_CROSS = {
    "x86_64-linux-gnu-gcc": _PLATFORMS["linux", "x86_64"],
    "aarch64-linux-gnu-gcc": _PLATFORMS["linux", "aarch64"],
    "x86_64-w64-mingw32-gcc": _Platform("win64", "x86_64-windows", ".dll"),
}
"""Cross compilers by their names in distributions."""


def binaries(
    texts: Mapping[str, str], sources: Sequence[str], identifier: str, fmi: Fmi, *, everywhere: bool
) -> dict[str, bytes]:
    """Compile for this platform, or also for each with a cross compiler."""
    made = {place(identifier, fmi): compiled(texts, sources)}
    for name, target in _CROSS.items() if everywhere else ():
        there = _place(target, identifier, fmi)
        if there not in made and shutil.which(name):
            made[there] = compiled(texts, sources, cross=name)
    return made


def _place(target: _Platform, identifier: str, fmi: Fmi) -> str:
    return f"binaries/{target.fmi_2 if fmi == 2 else target.fmi_3}/{identifier}{target.ending}"


def place(identifier: str, fmi: Fmi) -> str:
    """Return the path of the binary in an FMU."""
    here = _PLATFORMS.get((sys.platform, platform.machine()))
    if here is None:
        raise AmbkitError(
            f"an FMU is compiled on Linux and macOS only, this is {sys.platform} on "
            f"{platform.machine()}"
        )
    return _place(here, identifier, fmi)


def compiled(
    texts: Mapping[str, str], sources: Sequence[str], *, cross: str | None = None
) -> bytes:
    """Compile a shared library, reproducibly."""
    compiler = _compiler() if cross is None else [cross]
    linux = sys.platform == "linux" if cross is None else "linux" in cross
    with TemporaryDirectory() as made:
        for name, text in texts.items():
            files.make_folder(Path(made, name).parent)
            files.write_text(Path(made, name), text)
        flags = [*COMPILER_OPTIONS.split(), *_FLAGS, *(_STRICT if linux else ())]
        # With an explicit suffix: gcc for Windows adds .exe to a name without one.
        command = [*compiler, *flags, "-I.", *sources, "-o", "binary.library"]
        done = subprocess.run(
            command, cwd=made, capture_output=True, text=True, errors="replace", check=False
        )
        if done.returncode != 0:
            raise AmbkitError(f"{shlex.join(compiler)} cannot compile the FMU:\n{done.stderr}")
        return Path(made, "binary.library").read_bytes()


def _compiler() -> list[str]:
    """Return the command in the variable CC, or else the first available compiler."""
    command = os.environ.get("CC", "")
    try:
        chosen = shlex.split(command)
    except ValueError as error:
        raise AmbkitError(
            f"the environment variable CC, {command}, is no command: {error}"
        ) from None
    names = [chosen[0]] if chosen else list(_NAMES)
    for name in names:
        if shutil.which(name):
            return chosen or [name]
    raise AmbkitError(
        f"there is no C compiler ({', '.join(names)}), which an FMU needs; install one, or name it "
        "in the environment variable CC"
    )
