/* The closed loop as a model: plant, controller, and the estimator that feeds it. */
#ifndef AMBKIT_FMU_LOOP_MODEL_H
#define AMBKIT_FMU_LOOP_MODEL_H

#include "filter.h"
#include "rig.h"
#include "sim/loop.h"

typedef struct amb_unit {
  amb_rig rig;
  amb_pid pid;
  amb_kalman filter;
  amb_data_state estimate;
  amb_loop_state state; /* at the sample that the last one went on to */
  amb_glimpse between;
} amb_unit;

/* Written by the export. */
extern const amb_pid amb_data_pid;
extern const bool amb_data_feedback_estimate; /* what feeds it: the estimator, or the sensor */

#endif
