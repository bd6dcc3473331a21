/* What a step has to say: zero, or a sum of these flags. The state stays usable whatever they say.
 */
#ifndef AMBKIT_STATUS_H
#define AMBKIT_STATUS_H

typedef unsigned int amb_status;

#define AMB_OK 0U
#define AMB_MISSING 1U     /* measurement is not finite, or far beyond the travel: predicted only */
#define AMB_FROZEN 2U      /* measurement has not moved for too many samples: predicted only */
#define AMB_SATURATED 4U   /* control current beyond its limit: the limit was used */
#define AMB_BAD_CONTROL 8U /* control signal is NaN or infinite: the last good one was used */
#define AMB_BAD_VARIANCE 16U /* rounding has eaten the covariance: its correlations are dropped */
#define AMB_HELD 32U /* position known no better than the travel: mean and doubt held within it */
#define AMB_BAD_PARAMETER 64U /* a parameter is not finite or out of range: nothing was done */
#define AMB_UNEXCITED 128U    /* too little excitation: the identified value is held */
#define AMB_OUTLIER 256U      /* measurement too far from its prediction: predicted only */
#define AMB_INCONSISTENT                                                                           \
  512U /* too many innovations are larger than expected: model or noise is wrong */
#define AMB_NOISE_LIMIT 1024U /* the noise found online is at the end of its range */
#define AMB_RESTARTED                                                                              \
  2048U /* started afresh: from this measurement after too many outliers, or from nothing */
#define AMB_CONTACT 4096U /* the rotor was predicted in contact with a touch-down bearing */

/* Of a measurement: it was left out; or nothing can be learned from its innovation. */
#define AMB_UNUSED (AMB_MISSING | AMB_FROZEN | AMB_OUTLIER)
#define AMB_UNTOLD (AMB_UNUSED | AMB_RESTARTED | AMB_BAD_VARIANCE)

#endif
