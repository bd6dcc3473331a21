"""From a record to a bearing whose magnet constant was identified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from ambkit.errors import AmbkitError
from ambkit.identification.adaline import Adaline, AdalineResult
from ambkit.identification.rls import RecursiveLeastSquares

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
        How force and k were learned; by least squares a
        :class:`~ambkit.identification.rls.LeastSquaresResult`.
    """

    bearing: Bearing
    magnet_constant: float
    spread: float
    history: AdalineResult


ONLINE: Mapping[str, type[Adaline] | type[RecursiveLeastSquares]] = {
    "adaline": Adaline,
    "rls": RecursiveLeastSquares,
}
"""What learns a magnet constant sample by sample, by the names that users call it."""


def identify(
    record: Record,
    bearing: Bearing,
    *,
    method: str = "adaline",
    disturbance: ArrayLike | None = None,
    **options: Any,
) -> Identification:
    """Identify the magnet constant along a record (paper, eq. 22-25, Fig. 6).

    What can be told from one record is the ratio of k to the mass: a mass that is 10 % wrong moves
    k by as much. A constant load that is not known moves ADALINE's k by its share of the force,
    and does nothing to that of least squares, which need motion in return.

    Parameters
    ----------
    record : Record
        With ``y`` [m] and ``u`` [V].
    bearing : Bearing
        Mass, gap, bias current, sensor and amplifier; its magnet constant is the start.
    method : {"adaline", "rls"}
        Who learns: ADALINE, or recursive least squares.
    disturbance : array_like (n,), optional
        Disturbance force as far as it is known [N].
    **options
        As for :class:`ambkit.Adaline` or :class:`ambkit.RecursiveLeastSquares`: start, bandwidth,
        learning rates, forgetting.

    Raises
    ------
    AmbkitError
        An unknown method; or where the record never excited the magnet enough to learn from, or
        what was learned is no magnet constant.
    """
    if method not in ONLINE:
        raise AmbkitError(f'there is no method "{method}"; known: {", ".join(ONLINE)}')
    history: AdalineResult = ONLINE[method](bearing, **options).run(record, disturbance=disturbance)
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
