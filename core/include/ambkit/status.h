/* Status of a step: zero, or a sum of these flags. The state remains valid in any case. */
#ifndef AMBKIT_STATUS_H
#define AMBKIT_STATUS_H

typedef unsigned int amb_status;

#define AMB_OK 0U
#define AMB_MISSING 1U        /* measurement not finite, or far beyond the clearance: not used */
#define AMB_FROZEN 2U         /* measurement has repeated too often: not used */
#define AMB_SATURATED 4U      /* control current beyond its limit: the limit was used */
#define AMB_BAD_CONTROL 8U    /* control signal is NaN or infinite: the last valid one was used */
#define AMB_BAD_VARIANCE 16U  /* covariance indefinite by rounding: correlations removed */
#define AMB_HELD 32U          /* position uncertain by the clearance: limited to it */
#define AMB_BAD_PARAMETER 64U /* a parameter is not finite or out of range: nothing was done */
#define AMB_UNEXCITED 128U    /* insufficient excitation: the identified value is held */
#define AMB_OUTLIER 256U      /* measurement too far from its prediction: not used */
#define AMB_INCONSISTENT                                                                           \
  512U /* too many innovations are larger than expected: model or noise is wrong */
#define AMB_NOISE_LIMIT 1024U /* the noise estimated online is at the end of its range */
#define AMB_RESTARTED                                                                              \
  2048U /* restarted from this measurement after many outliers, or without information */
#define AMB_CONTACT 4096U  /* the rotor was predicted in contact with a touch-down bearing */
#define AMB_MIRRORED 8192U /* the rotor spins against the direction in which pulses were read */
#define AMB_OUTSIDE 16384U /* the magnet constant is beyond those of all models */

/* Of a measurement: it was rejected; or nothing can be learned from its innovation. */
#define AMB_UNUSED (AMB_MISSING | AMB_FROZEN | AMB_OUTLIER)
#define AMB_UNINFORMATIVE (AMB_UNUSED | AMB_RESTARTED | AMB_BAD_VARIANCE)

#endif
