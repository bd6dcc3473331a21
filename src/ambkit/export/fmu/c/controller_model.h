/* The PID controller as a model: it reads its inputs at the start of a sample, and holds its output
 * until the next. */
#ifndef AMBKIT_FMU_CONTROLLER_MODEL_H
#define AMBKIT_FMU_CONTROLLER_MODEL_H

#include "ambkit/controller.h"

typedef struct amb_unit {
  amb_pid pid;
  amb_pid_state state;
  amb_real u; /* demanded control signal [V] */
} amb_unit;

/* Written by the export. */
extern const amb_pid amb_data_pid;
extern const amb_real amb_data_k_ui[];        /* amplifier gain [A/V] */
extern const amb_real amb_data_K_sen;         /* sensor gain [1]; 1 if an estimator feeds it */
extern const bool amb_data_feedback_estimate; /* whether a velocity is supplied with the position */

#endif
