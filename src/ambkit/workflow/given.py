"""What a caller gives to be assessed, as it is needed: loads in SI, estimators by their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ambkit.base.asked import in_si, names_in, of_type
from ambkit.base.errors import AmbkitError
from ambkit.estimate.named import factories
from ambkit.estimate.own import OwnEstimator, is_own
from ambkit.machine.machine import Machine

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator


def given_load(bearing: Machine, load: Any) -> dict[str, float]:
    """Return constant loads by the names of axes [N]; a number is of the first axis."""
    if load is None or isinstance(load, Mapping):
        return {name: in_si(f"load of {name}", each, "N") for name, each in (load or {}).items()}
    return {bearing.long.axes[0].name: in_si("load", load, "N")}


def given_estimators(given: Any, bearing: Machine) -> dict[str, Estimator]:
    """Return the estimators that were given or named, by their names."""
    from ambkit.estimate.base import Estimator

    if given is None:
        return {}
    if is_own(given):
        given = {given.__name__: given}
    found: dict[str, Estimator] = {
        name: OwnEstimator(bearing, each, name) if is_own(each) else each
        for name, each in (given.items() if isinstance(given, Mapping) else ())
    }
    for each in found.values():
        of_type(Estimator, filter=each)
    for each in () if isinstance(given, Mapping) else names_in(Estimator, filter=given):
        if isinstance(each, Estimator):
            if each.name in found:
                raise AmbkitError(f"two filters are called {each.name}: give them as a mapping")
            found[each.name] = each
        else:
            found |= {name: make() for name, make in factories([each], bearing).items()}
    for name, each in found.items():
        T = each.bearing.sampling_time
        if abs(T - bearing.sampling_time) > 1e-9 * T:
            raise AmbkitError(
                f"{name}: its sampling_time is {T:g} s, that of {bearing.name} "
                f"{bearing.sampling_time:g} s"
            )
    return found


def of_machine(
    name: str, machine: Machine, *, synchronous: Sequence[str] = (), noise: Any = None
) -> Estimator:
    """Return an estimator for a machine, of a kind or in a file."""
    return factories([name], machine, synchronous=synchronous)[name](noise)
