"""What happened in a step of an estimator, as flags."""

from enum import IntFlag


class Status(IntFlag):
    """What a step had to say; zero, or a sum of flags (``core/include/ambkit/status.h``)."""

    OK = 0
    MISSING = 1  #: the measurement was not finite, or far beyond the travel: predicted only
    FROZEN = 2  #: the measurement had not moved for too many samples: predicted only
    SATURATED = 4  #: control current beyond its limit: the limit was used
    BAD_CONTROL = 8  #: the control signal was NaN or infinite: the last good one was used
    BAD_VARIANCE = 16  #: rounding has eaten the covariance: correlations dropped
    HELD = 32  #: the position is known no better than the travel: mean and doubt held within it
    BAD_PARAMETER = 64  #: a stiffness was not finite: not predicted
    UNEXCITED = 128  #: too little excitation: the identified value was held
    OUTLIER = 256  #: the measurement was too far from its prediction: predicted only
    INCONSISTENT = 512  #: too many innovations larger than expected: model or noise is wrong
    NOISE_LIMIT = 1024  #: the noise found online is at the end of its range
    RESTARTED = 2048  #: started afresh: from this measurement, or with nothing known
    CONTACT = 4096  #: the rotor was predicted in contact with a touch-down bearing
