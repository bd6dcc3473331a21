"""From a record to a bearing whose magnet constant was identified."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from ambkit.errors import AmbkitError
from ambkit.identification.adaline import Adaline, AdalineResult

if TYPE_CHECKING:
    from ambkit.bearing import Bearing
    from ambkit.record import Record


@dataclass(frozen=True, eq=False)
class Identification:
    """What a record says about a bearing.

    Attributes
    ----------
    bearing : Bearing
        The one that was given, with the identified magnet constant.
    magnet_constant, spread : float
        Mean and standard deviation of k over the last quarter of the record [N m^2/A^2].
    history : AdalineResult
        How force and k were learned.
    """

    bearing: Bearing
    magnet_constant: float
    spread: float
    history: AdalineResult


def identify(
    record: Record, bearing: Bearing, *, disturbance: ArrayLike | None = None, **options: Any
) -> Identification:
    """Identify the magnet constant along a record (paper, eq. 22-25, Fig. 6).

    What can be told from one record is the ratio of k to the mass: a mass that is 10 % wrong, or a
    constant load that is not known, moves k by its share of the force.

    Parameters
    ----------
    record : Record
        With ``y`` [m] and ``u`` [V].
    bearing : Bearing
        Mass, gap, bias current, sensor and amplifier; its magnet constant is the start.
    disturbance : array_like (n,), optional
        Disturbance force as far as it is known [N].
    **options
        As for :class:`ambkit.Adaline`: start, bandwidth, learning rates.

    Raises
    ------
    AmbkitError
        Where the record never excited the magnet enough to learn from, or what was learned is no
        magnet constant.
    """
    history = Adaline(bearing, **options).run(record, disturbance=disturbance)
    if history.held.all():
        raise AmbkitError(
            f"excitation stayed at {history.excitation.max():.2g}, below the least at which the "
            "magnet constant is learned: let the rotor move, or the magnet carry a known load"
        )
    k = history.magnet_constant
    if not k > 0:
        raise AmbkitError(
            f"the identified magnet constant is {k:.3g} N m^2/A^2, which no magnet has: is the "
            "sign of y or u turned round, or a large disturbance force left out?"
        )
    # A constant from turns and pole area would contradict the one that was found.
    found = bearing.replace(magnet__magnet_constant=k, magnet__turns=None, magnet__pole_area=None)
    return Identification(found, k, history.spread, history)
