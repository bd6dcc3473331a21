/* Low-pass filters with numerical derivatives, the usual approach without a noise model: `own` is
 * an amb_low_pass.
 *
 * Position: first-order low-pass of the measurement. Velocity: its difference quotient, low-passed
 * again. Disturbance force: the unexplained acceleration force, m dv/dt minus the magnet force,
 * low-passed a third time. Currents that lag the controls follow the model. No covariance, no
 * variance of the innovation: both are 0.
 */
#ifndef AMBKIT_LOW_PASS_H
#define AMBKIT_LOW_PASS_H

#include "ambkit/estimator.h"

AMB_EXTERN_C_BEGIN

/* For one force, one control and one sensor. A reset returns AMB_BAD_PARAMETER for a model without
 * position, velocity or disturbance force. */
typedef struct amb_low_pass {
  amb_real m; /* mass of the rotor [kg], > 0 */
  /* 1 - exp(-2 pi corner T) each, in (0, 1]: weight of the new value. */
  amb_real position;
  amb_real velocity;
  amb_real force;
} amb_low_pass;

typedef struct amb_low_pass_state {
  amb_kalman_state base;
  amb_real force; /* known force since the last sample [N] */
} amb_low_pass_state;

extern const amb_estimator_methods amb_low_pass_methods;

AMB_EXTERN_C_END

#endif
