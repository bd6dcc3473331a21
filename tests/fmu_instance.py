"""An instance of an FMU as FMPy drives it, alike for FMI 2.0 and 3.0."""

from __future__ import annotations

import functools
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import lark
import numpy as np
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

# FMPy makes one and the same grammar of names for each FMU that it reads, a twentieth of a second.
lark.Lark = functools.cache(lark.Lark)  # type: ignore[misc]


class Instance:
    """From instantiation to stepping; `token` replaces the right one."""

    def __init__(self, folder: Path, name: str = "one", token: str | None = None) -> None:
        self.described = read_model_description(folder)
        self.two = self.described.fmiVersion == "2.0"
        self.vr = {v.name: v.valueReference for v in self.described.modelVariables}
        self.integers = {
            v.name for v in self.described.modelVariables if v.type in ("Integer", "Int32")
        }
        self.T = float(self.described.defaultExperiment.stepSize)
        self.at = 0  # samples
        self.fmu: Any = (FMU2Slave if self.two else FMU3Slave)(
            guid=token or self.described.guid,
            unzipDirectory=str(folder),
            modelIdentifier=self.described.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.fmu.instantiate()

    def start(self, time: float = 0.0, **values: float) -> Instance:
        if self.two:
            self.fmu.setupExperiment(startTime=time)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=time)
        self.set(**values)
        self.fmu.exitInitializationMode()
        return self

    def set(self, **values: float) -> None:
        setter = self.fmu.setReal if self.two else self.fmu.setFloat64
        setter([self.vr[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        reals = [self.vr[name] for name in names if name not in self.integers]
        whole = [self.vr[name] for name in names if name in self.integers]
        found = list((self.fmu.getReal if self.two else self.fmu.getFloat64)(reals))
        return found + list((self.fmu.getInteger if self.two else self.fmu.getInt32)(whole))

    def step(self, samples: int = 1, **inputs: float) -> None:
        self.set(**inputs)
        self.fmu.doStep(self.at * self.T, samples * self.T)
        self.at += samples

    def run(self, inputs: Mapping[str, Any], names: tuple[str, ...]) -> list[list[float]]:
        """Sample by sample; one row of outputs after each."""
        rows = []
        for k in range(len(next(iter(inputs.values())))):
            self.step(**{name: values[k] for name, values in inputs.items()})
            rows.append(self.get(*names))
        return rows


def unpacked(path: Path, folder: Path) -> Path:
    """Return the folder, with the FMU in it."""
    extract(str(path), str(folder))
    return folder


def simulated(path: Path, T: float, start: dict[str, float] | None = None, **inputs: Any) -> Any:
    """What FMPy makes of it, one row more than samples: what is read after each."""
    n = len(next(iter(inputs.values())))
    signals = np.zeros(n, dtype=[("time", float), *((name, float) for name in inputs)])
    signals["time"] = T * np.arange(n)
    for name, values in inputs.items():
        signals[name] = values
    return simulate_fmu(
        str(path), stop_time=n * T, output_interval=T, input=signals, start_values=start or {}
    )


def check_sources(path: Path, folder: Path, compiler: str, *more: str) -> None:
    """Compile the sources in an FMU as the product does, with all warnings and some more."""
    sources = unpacked(path, folder) / "sources"
    warnings = "-Wall -Wextra -Wpedantic -Wconversion -Wno-unused-parameter"
    files = [str(file.relative_to(sources)) for file in sources.rglob("*.c")]
    command = [
        compiler,
        "-std=c99",
        "-fsyntax-only",
        "-Werror",
        *warnings.split(),
        *more,
        "-I.",
        *files,
    ]
    subprocess.run(command, cwd=sources, check=True)
