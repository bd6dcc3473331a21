"""Adaptive Kalman filters for active magnetic bearings.

From a bearing's description, or a recording of the rig, to a tuned adaptive Kalman filter. All
quantities are SI. Names are imported when they are first used.
"""

from __future__ import annotations

from importlib import import_module

from ambkit.base import late_binding

TYPE_CHECKING = False  # as type checkers know it, without importing typing before a command starts
if TYPE_CHECKING:
    from ambkit.assessment.injection_experiment import design_injection as design_injection
    from ambkit.base.errors import AmbkitError as AmbkitError
    from ambkit.base.errors import ConfigError as ConfigError
    from ambkit.base.errors import RecordError as RecordError
    from ambkit.campaigns.campaign import Campaign as Campaign
    from ambkit.campaigns.study import Study as Study
    from ambkit.control.control import Control as Control
    from ambkit.control.pid import PID as PID
    from ambkit.control.user_controller import ControllerProtocol as ControllerProtocol
    from ambkit.data.reading.reader import load as load
    from ambkit.data.record import Record as Record
    from ambkit.data.telemetry import read_telemetry as read_telemetry
    from ambkit.estimate.adaptive_noise import AdaptiveNoise as AdaptiveNoise
    from ambkit.estimate.augmented import AugmentedKalmanFilter as AugmentedKalmanFilter
    from ambkit.estimate.augmented import MultipleModelFilter as MultipleModelFilter
    from ambkit.estimate.batch import run_many as run_many
    from ambkit.estimate.constant_velocity import ConstantVelocity as ConstantVelocity
    from ambkit.estimate.estimate import Estimate as Estimate
    from ambkit.estimate.estimate import Status as Status
    from ambkit.estimate.estimator import Estimator as Estimator
    from ambkit.estimate.filter_file import FilterFile as FilterFile
    from ambkit.estimate.kalman import AdaptiveKalmanFilter as AdaptiveKalmanFilter
    from ambkit.estimate.kalman import ExtendedKalmanFilter as ExtendedKalmanFilter
    from ambkit.estimate.kalman import KalmanFilter as KalmanFilter
    from ambkit.estimate.kalman import UDKalmanFilter as UDKalmanFilter
    from ambkit.estimate.low_pass import LowPass as LowPass
    from ambkit.estimate.noise_model import FilterNoise as FilterNoise
    from ambkit.estimate.observer import ExtendedStateObserver as ExtendedStateObserver
    from ambkit.estimate.observer import SteadyStateKalmanFilter as SteadyStateKalmanFilter
    from ambkit.estimate.unscented import UnscentedKalmanFilter as UnscentedKalmanFilter
    from ambkit.estimate.user_filter import EstimatorProtocol as EstimatorProtocol
    from ambkit.export.statespace import to_control as to_control
    from ambkit.fuzzy.expert import Expert as Expert
    from ambkit.identification.online.adaline import Adaline as Adaline
    from ambkit.identification.online.magnet_constant import identify_online as identify_online
    from ambkit.identification.online.rls import RecursiveLeastSquares as RecursiveLeastSquares
    from ambkit.judge.comparison.states import Judgement as Judgement
    from ambkit.judge.comparison.states import judge_states as judge_states
    from ambkit.machine.loading import preset as preset
    from ambkit.machine.machine import Bearing as Bearing
    from ambkit.machine.machine import Machine as Machine
    from ambkit.machine.magnets import ClosedLaw as ClosedLaw
    from ambkit.machine.magnets import ConstantStiffness as ConstantStiffness
    from ambkit.machine.magnets import SaturatingLaw as SaturatingLaw
    from ambkit.machine.magnets import magnet_of as magnet_of
    from ambkit.machine.stiffness import StiffnessMap as StiffnessMap
    from ambkit.machine.stiffness import stiffness_map as stiffness_map
    from ambkit.result.result import Result as Result
    from ambkit.rotordynamics.harmonics import harmonics as harmonics
    from ambkit.simulation.many import Planned as Planned
    from ambkit.simulation.many import simulate_many as simulate_many
    from ambkit.simulation.scenario import Scenario as Scenario
    from ambkit.simulation.user_plant import PlantProtocol as PlantProtocol
    from ambkit.simulation.waveforms import Constant as Constant
    from ambkit.simulation.waveforms import HalfSine as HalfSine
    from ambkit.simulation.waveforms import Impulse as Impulse
    from ambkit.simulation.waveforms import Ramp as Ramp
    from ambkit.simulation.waveforms import Recorded as Recorded
    from ambkit.simulation.waveforms import Sequence as Sequence
    from ambkit.simulation.waveforms import Sine as Sine
    from ambkit.simulation.waveforms import Step as Step
    from ambkit.verbs.assess import assess as assess
    from ambkit.verbs.assess import assess_log as assess_log
    from ambkit.verbs.assess import assess_speed as assess_speed
    from ambkit.verbs.assess import assess_sweep as assess_sweep
    from ambkit.verbs.campaign import campaign as campaign
    from ambkit.verbs.campaign import campaign_problem as campaign_problem
    from ambkit.verbs.campaign import campaign_rare as campaign_rare
    from ambkit.verbs.campaign import campaign_replay as campaign_replay
    from ambkit.verbs.campaign import campaign_report as campaign_report
    from ambkit.verbs.campaign import campaign_status as campaign_status
    from ambkit.verbs.check import check as check
    from ambkit.verbs.check import schema as schema
    from ambkit.verbs.compare import compare as compare
    from ambkit.verbs.compare import compare_steps as compare_steps
    from ambkit.verbs.design import design as design
    from ambkit.verbs.excite import excite as excite
    from ambkit.verbs.excite import excite_sensitivity as excite_sensitivity
    from ambkit.verbs.export import export_a2l as export_a2l
    from ambkit.verbs.export import export_c as export_c
    from ambkit.verbs.export import export_cost as export_cost
    from ambkit.verbs.export import export_fmu as export_fmu
    from ambkit.verbs.export import export_mat as export_mat
    from ambkit.verbs.export import export_ssp as export_ssp
    from ambkit.verbs.faults import inject_faults as inject_faults
    from ambkit.verbs.filter import filter as filter
    from ambkit.verbs.identify import identify as identify
    from ambkit.verbs.identify import identify_coil as identify_coil
    from ambkit.verbs.identify import identify_corpus as identify_corpus
    from ambkit.verbs.identify import identify_lift_off as identify_lift_off
    from ambkit.verbs.pil import pil as pil
    from ambkit.verbs.presets import presets as presets
    from ambkit.verbs.read import guess_channels as guess_channels
    from ambkit.verbs.read import read as read
    from ambkit.verbs.reproduce import reproduce as reproduce
    from ambkit.verbs.rotor import campbell as campbell
    from ambkit.verbs.rotor import mode_shapes as mode_shapes
    from ambkit.verbs.rotor import unbalance_response as unbalance_response
    from ambkit.verbs.rotor import waterfall as waterfall
    from ambkit.verbs.simulate import simulate as simulate
    from ambkit.verbs.train import train as train
    from ambkit.verbs.train import train_map as train_map
    from ambkit.verbs.tune import tune as tune
    from ambkit.verbs.tune import tune_robust as tune_robust
    from ambkit.verbs.tune import tune_trade_off as tune_trade_off
    from ambkit.workflow.simulate import scenario_for as scenario_for

    __version__: str

_HOME = {
    "base.errors": ["AmbkitError", "ConfigError", "RecordError"],
    "control.control": ["Control"],
    "control.pid": ["PID"],
    "control.user_controller": ["ControllerProtocol"],
    "data.reading.reader": ["load"],
    "data.record": ["Record"],
    "data.telemetry": ["read_telemetry"],
    "estimate.adaptive_noise": ["AdaptiveNoise"],
    "estimate.estimator": ["Estimator"],
    "estimate.batch": ["run_many"],
    "estimate.constant_velocity": ["ConstantVelocity"],
    "estimate.estimate": ["Estimate", "Status"],
    "estimate.filter_file": ["FilterFile"],
    "estimate.kalman": [
        "AdaptiveKalmanFilter",
        "ExtendedKalmanFilter",
        "KalmanFilter",
        "UDKalmanFilter",
    ],
    "estimate.low_pass": ["LowPass"],
    "estimate.augmented": ["AugmentedKalmanFilter", "MultipleModelFilter"],
    "estimate.noise_model": ["FilterNoise"],
    "estimate.observer": ["ExtendedStateObserver", "SteadyStateKalmanFilter"],
    "estimate.user_filter": ["EstimatorProtocol"],
    "estimate.unscented": ["UnscentedKalmanFilter"],
    "export.statespace": ["to_control"],
    "fuzzy.expert": ["Expert"],
    "identification.online.adaline": ["Adaline"],
    "identification.online.magnet_constant": ["identify_online"],
    "identification.online.rls": ["RecursiveLeastSquares"],
    "judge.comparison.states": ["Judgement", "judge_states"],
    "machine.loading": ["preset"],
    "machine.machine": ["Bearing", "Machine"],
    "machine.magnets": ["ClosedLaw", "ConstantStiffness", "SaturatingLaw", "magnet_of"],
    "machine.stiffness": ["StiffnessMap", "stiffness_map"],
    "result.result": ["Result"],
    "simulation.many": ["Planned", "simulate_many"],
    "simulation.scenario": ["Scenario"],
    "simulation.user_plant": ["PlantProtocol"],
    "simulation.waveforms": [
        "Constant",
        "HalfSine",
        "Impulse",
        "Ramp",
        "Recorded",
        "Sequence",
        "Sine",
        "Step",
    ],
    "verbs.campaign": [
        "campaign",
        "campaign_problem",
        "campaign_rare",
        "campaign_replay",
        "campaign_report",
        "campaign_status",
    ],
    "verbs.check": ["check", "schema"],
    "verbs.compare": ["compare", "compare_steps"],
    "verbs.design": ["design"],
    "verbs.export": [
        "export_a2l",
        "export_c",
        "export_cost",
        "export_fmu",
        "export_mat",
        "export_ssp",
    ],
    "verbs.filter": ["filter"],
    "verbs.identify": ["identify", "identify_coil", "identify_corpus", "identify_lift_off"],
    "verbs.presets": ["presets"],
    "verbs.read": ["guess_channels", "read"],
    "verbs.reproduce": ["reproduce"],
    "verbs.simulate": ["simulate"],
    "verbs.train": ["train", "train_map"],
    "verbs.assess": ["assess", "assess_log", "assess_speed", "assess_sweep"],
    "verbs.excite": ["excite", "excite_sensitivity"],
    "verbs.faults": ["inject_faults"],
    "verbs.rotor": ["campbell", "mode_shapes", "unbalance_response", "waterfall"],
    "verbs.pil": ["pil"],
    "verbs.tune": ["tune", "tune_robust", "tune_trade_off"],
    "campaigns.campaign": ["Campaign"],
    "campaigns.study": ["Study"],
    "rotordynamics.harmonics": ["harmonics"],
    "assessment.injection_experiment": ["design_injection"],
    "workflow.simulate": ["scenario_for"],
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

# Files of estimators, behind methods of the estimators.
_BEHIND = {"estimate.filter_saving": {"load": "load_estimator", "save": "save_estimator"}}
late_binding.bind(_BEHIND)

__all__ = ["__version__", *sorted(_MODULE_OF)]


if not TYPE_CHECKING:  # for which any name would do

    def __getattr__(name):
        if name == "__version__":
            from importlib.metadata import version

            return version("ambkit")
        if name not in _MODULE_OF:
            raise AttributeError(f"module 'ambkit' has no attribute {name!r}")
        return getattr(import_module(f"ambkit.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return __all__
