"""Figures of merit of a run, against its truth, and counts of status flags."""

from typing import NamedTuple

from ambkit.estimate.estimate import Status


class Figure(NamedTuple):
    """A figure of merit of a run."""

    unit: str  #: SI.
    about: str
    """Description, in a sentence; with several axes it is of the worst, if it is of an axis."""


FIGURES: dict[str, Figure] = {
    "x_rms": Figure("m", "RMS error of the estimated position."),
    "v_rms": Figure("m/s", "RMS error of the estimated velocity."),
    "f_d_rms": Figure("N", "RMS error of the estimated disturbance force."),
    "x_peak": Figure("m", "Greatest magnitude of the position's error."),
    "v_peak": Figure("m/s", "Greatest magnitude of the velocity's error."),
    "f_d_peak": Figure("N", "Greatest magnitude of the disturbance force's error."),
    "nis": Figure("1", "Mean normalised innovation squared of the measurements used."),
    "tracking_rms": Figure("m", "RMS control error, reference less position."),
    "tracking_peak": Figure("m", "Greatest magnitude of the control error."),
    "effort": Figure("A", "RMS change of the demanded current from sample to sample."),
    "displacement_peak": Figure("m", "Maximum distance of the rotor from the centre."),
    "current_peak": Figure("A", "Greatest magnitude of the control current just after a sample."),
    "overshoot": Figure("1", "Overshoot of the last step of the reference, before a load."),
    "settling": Figure("s", "Time after that step until the rotor stays within 5 % of it; "
                       "infinity if it does not."),
    "recovery": Figure("s", "Time after the last change of the load until the rotor stays within "
                       "the band around the reference; infinity where it does not."),
    "load_kept": Figure("N", "Maximum total disturbance force before the first contact with a "
                        "stop."),
    "touched": Figure("1", "Number of samples with contact."),
    "landed": Figure("1", "1 with contact in the last sample, else 0."),
    "orbit_peak": Figure("m", "Farthest that the rotor was from the middle of a bearing at a "
                         "sample, both axes together, after the settling."),
    "orbit_share": Figure("1", "The same relative to the clearance, of the worst bearing."),
}  # fmt: skip
"""All figures by name, in the order of the arrays; NaN if one does not apply to a run."""

FLAGS = tuple(str(flag.name).lower() for flag in Status if flag)  #: Names of the status flags.


def first_of(settling: float, T: float, n: int) -> int:
    """Return the first evaluated sample."""
    first = max(1, round(settling / T))
    if first >= n:
        raise ValueError(
            f"settling must be less than the {(n - 1) * T:g} s of a run, is {settling:g} s"
        )
    return first
