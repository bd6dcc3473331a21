/* What goes to and from a controller in the loop, a sample at a time (processor.py). Who includes
 * this says how many SENSORS, AXES and STATES there are. */
#ifndef FIRMWARE_SAMPLES_H
#define FIRMWARE_SAMPLES_H

#include "ambkit/real.h"
#include <stdint.h>

typedef struct sample {
  amb_real y[SENSORS]; /* as the rig has them */
  amb_real r[AXES];    /* [m] */
  amb_real speed;      /* [rad/s] */
  uint32_t fly;
  uint32_t counted; /* whether the instructions of this step are wanted; 2: the end */
} sample;

typedef struct answer {
  amb_real coil[AXES][2], iu[AXES], u[AXES], mean[STATES];
  uint32_t status, mode, on, usable;
  uint32_t instructions; /* of this step, where they were wanted */
  uint32_t stack;        /* bytes that a step has needed below its caller until now, likewise */
} answer;

typedef struct greeting {
  uint32_t unequal, wrong_status, wrong; /* of the self-test */
  uint32_t selftest;                     /* its instructions, in units of 40 */
  uint32_t state;                        /* bytes of an instance */
} greeting;

#endif
