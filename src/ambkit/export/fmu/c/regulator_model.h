/* Controllers as a model: they look at what a filter or the sensors say when a sample begins,
 * and hold their demands until the next. */
#ifndef AMBKIT_FMU_REGULATOR_MODEL_H
#define AMBKIT_FMU_REGULATOR_MODEL_H

#include "ambkit/controllers.h"
#include "data.h"

typedef struct amb_unit {
  amb_pid_state pid[AMB_DATA_PIDS];
  amb_real u[AMB_DATA_AXES]; /* control signals that are demanded [V] */
} amb_unit;

/* Written by the export; data.h has AMB_DATA_AXES and AMB_DATA_PIDS, how many there are. */
extern const amb_controllers amb_data_law;
extern const amb_real amb_data_k_ui[AMB_DATA_AXES]; /* amplifier gains [A/V] */
extern const int amb_data_speed; /* where among the values the speed of rotation is; -1: it rests */

#endif
