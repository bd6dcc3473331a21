/* A controller of all states as a model: it looks at what an estimator says when a sample begins,
 * and holds its demand until the next. */
#ifndef AMBKIT_FMU_REGULATOR_MODEL_H
#define AMBKIT_FMU_REGULATOR_MODEL_H

#include "ambkit/controllers.h"

typedef struct amb_unit {
  amb_pid_state pid;
  amb_real u; /* control signal that is demanded [V] */
} amb_unit;

/* Written by the export. */
extern const amb_controllers amb_data_law; /* of one axis, with one PID */
extern const amb_real amb_data_k_ui;       /* amplifier gain [A/V] */

#endif
