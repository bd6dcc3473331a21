/* Data to and from a controller in the loop, per sample (processor.py). The including file defines
 * SENSORS, AXES and STATES. */
#ifndef FIRMWARE_SAMPLES_H
#define FIRMWARE_SAMPLES_H

#include "ambkit/real.h"
#include <stdint.h>

typedef struct sample {
  amb_real y[SENSORS]; /* from the rig */
  amb_real r[AXES];    /* [m] */
  amb_real rotation;   /* reading of the angle's sensor, or the speed [rad/s] */
  uint32_t fly;
  uint32_t failed;  /* whether the magnets had no current since the last sample */
  uint32_t counted; /* whether the instructions of this step are requested; 2: the end */
} sample;

typedef struct answer {
  amb_real coil[AXES][2], iu[AXES], u[AXES], mean[STATES];
  uint32_t status, mode, on, usable;
  uint32_t instructions; /* of this step, if requested */
  uint32_t stack;        /* maximum bytes of stack of a step so far, if requested */
} answer;

typedef struct greeting {
  uint32_t unequal, wrong_status, wrong; /* of the self-test */
  uint32_t selftest;                     /* its instructions, in units of 40 */
  uint32_t state;                        /* bytes of an instance */
} greeting;

#endif
