/* The estimator as a model: it samples y and u, and holds its estimates until the next sample. */
#ifndef AMBKIT_FMU_ESTIMATOR_MODEL_H
#define AMBKIT_FMU_ESTIMATOR_MODEL_H

#include "filter.h"

typedef struct amb_unit {
  amb_kalman filter;
  amb_data_state state;
  amb_kalman_result result;
  amb_real last_u[AMB_CONTROLS]; /* control signals since the last sample [V] */
  amb_real bias[AMB_STATES];     /* of the states, by the error of the force law */
  bool sampled;                  /* whether there was one */
} amb_unit;

#endif
