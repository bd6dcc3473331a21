"""Adaptive Kalman filters for active magnetic bearings.

From a bearing's description, or a recording of the rig, to a tuned adaptive Kalman filter. All
quantities are SI. Names are imported when they are first used.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # as type checkers know it, without importing typing before a command starts
if TYPE_CHECKING:
    from typing import Any

    from ambkit.bearing import Bearing as Bearing
    from ambkit.comparison import compare as compare
    from ambkit.errors import AmbkitError as AmbkitError
    from ambkit.errors import ConfigError as ConfigError
    from ambkit.errors import RecordError as RecordError
    from ambkit.estimate import Estimate as Estimate
    from ambkit.estimate import Status as Status
    from ambkit.estimators import AdaptiveKalmanFilter as AdaptiveKalmanFilter
    from ambkit.estimators import AdaptiveNoise as AdaptiveNoise
    from ambkit.estimators import ExtendedKalmanFilter as ExtendedKalmanFilter
    from ambkit.estimators import ExtendedStateObserver as ExtendedStateObserver
    from ambkit.estimators import FilterNoise as FilterNoise
    from ambkit.estimators import FiveStateKalmanFilter as FiveStateKalmanFilter
    from ambkit.estimators import KalmanFilter as KalmanFilter
    from ambkit.estimators import LowPass as LowPass
    from ambkit.estimators import MultipleModelFilter as MultipleModelFilter
    from ambkit.estimators import SquareRootKalmanFilter as SquareRootKalmanFilter
    from ambkit.estimators import SteadyStateKalmanFilter as SteadyStateKalmanFilter
    from ambkit.estimators import UnscentedKalmanFilter as UnscentedKalmanFilter
    from ambkit.estimators.batch import run_many as run_many
    from ambkit.faults import torture as torture
    from ambkit.fuzzy import Expert as Expert
    from ambkit.fuzzy.training import train as train
    from ambkit.identification import identify as identify
    from ambkit.identification.online.adaline import Adaline as Adaline
    from ambkit.identification.online.rls import RecursiveLeastSquares as RecursiveLeastSquares
    from ambkit.identification.stiffness import StiffnessMap as StiffnessMap
    from ambkit.identification.stiffness import stiffness_map as stiffness_map
    from ambkit.magnets import ClosedLaw as ClosedLaw
    from ambkit.magnets import ConstantStiffness as ConstantStiffness
    from ambkit.magnets import SaturatingLaw as SaturatingLaw
    from ambkit.magnets import magnet_of as magnet_of
    from ambkit.record import Record as Record
    from ambkit.scenario import PID as PID
    from ambkit.scenario import Scenario as Scenario
    from ambkit.simulation import simulate as simulate
    from ambkit.simulation import simulate_run as simulate_run
    from ambkit.waveforms import Constant as Constant
    from ambkit.waveforms import Impulse as Impulse
    from ambkit.waveforms import Ramp as Ramp
    from ambkit.waveforms import Recorded as Recorded
    from ambkit.waveforms import Sequence as Sequence
    from ambkit.waveforms import Sine as Sine
    from ambkit.waveforms import Step as Step

_HOME = {
    "bearing": ["Bearing"],
    "comparison": ["compare"],
    "errors": ["AmbkitError", "ConfigError", "RecordError"],
    "estimate": ["Estimate", "Status"],
    "estimators": [
        "AdaptiveKalmanFilter",
        "AdaptiveNoise",
        "ExtendedKalmanFilter",
        "ExtendedStateObserver",
        "FilterNoise",
        "FiveStateKalmanFilter",
        "KalmanFilter",
        "LowPass",
        "MultipleModelFilter",
        "SquareRootKalmanFilter",
        "SteadyStateKalmanFilter",
        "UnscentedKalmanFilter",
    ],
    "faults": ["torture"],
    "fuzzy": ["Expert"],
    "identification": ["identify"],
    "identification.online.adaline": ["Adaline"],
    "identification.online.rls": ["RecursiveLeastSquares"],
    "identification.stiffness": ["StiffnessMap", "stiffness_map"],
    "magnets": ["ClosedLaw", "ConstantStiffness", "SaturatingLaw", "magnet_of"],
    "record": ["Record"],
    "estimators.batch": ["run_many"],
    "scenario": ["PID", "Scenario"],
    "simulation": ["simulate", "simulate_run"],
    "fuzzy.training": ["train"],
    "waveforms": ["Constant", "Impulse", "Ramp", "Recorded", "Sequence", "Sine", "Step"],
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = ["__version__", *sorted(_MODULE_OF)]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("ambkit")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'ambkit' has no attribute {name!r}")
    return getattr(import_module(f"ambkit.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return __all__
