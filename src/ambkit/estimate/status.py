"""Status flags of an estimator's step."""

from enum import IntFlag


class Status(IntFlag):
    """Status of a step: zero, or a sum of flags (``core/include/ambkit/status.h``)."""

    OK = 0
    MISSING = 1  #: the measurement was not finite, or far beyond the clearance: prediction only
    FROZEN = 2  #: the measurement had repeated too often: prediction only
    SATURATED = 4  #: control current beyond its limit: the limit was used
    BAD_CONTROL = 8  #: the control signal was NaN or infinite: the last valid one was used
    #: the covariance lost definiteness by rounding: its correlations were removed
    BAD_VARIANCE = 16
    #: the position uncertainty exceeds the clearance: mean and covariance are limited to it
    HELD = 32
    BAD_PARAMETER = 64  #: a stiffness was not finite: no prediction
    UNEXCITED = 128  #: insufficient excitation: the identified value was held
    OUTLIER = 256  #: the measurement was too far from its prediction: prediction only
    INCONSISTENT = 512  #: too many innovations are larger than expected: model or noise is wrong
    NOISE_LIMIT = 1024  #: the noise estimated online is at the end of its range
    RESTARTED = 2048  #: restarted: from this measurement, or without information
    CONTACT = 4096  #: the rotor was predicted in contact with a touch-down bearing
    MIRRORED = 8192  #: the rotor spins against the direction in which its pulses were read
    OUTSIDE = 16384  #: the magnet constant is beyond those of all models
