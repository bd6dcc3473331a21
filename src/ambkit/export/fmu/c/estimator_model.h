/* The estimator as a model: it samples y and u, and holds its estimates until the next sample. */
#ifndef AMBKIT_FMU_ESTIMATOR_MODEL_H
#define AMBKIT_FMU_ESTIMATOR_MODEL_H

#include "ambkit/kalman.h"

typedef struct amb_model {
  amb_kalman filter;
  amb_kalman_state state;
  amb_kalman_result result;
  amb_real last_u; /* control signal that has acted since the last sample [V] */
  bool sampled;    /* whether there was one */
} amb_model;

/* Written by the export. */
extern const amb_kalman_settings amb_data_settings;
extern const amb_real amb_data_std[AMB_AXIAL_STATES]; /* at the start */
extern const amb_magnet amb_data_magnet;              /* what the filter knows of its magnet */

#endif
