/* Controllers as a model: they read the output of a filter or the sensors at the start of a sample,
 * and hold their outputs until the next. */
#ifndef AMBKIT_FMU_REGULATOR_MODEL_H
#define AMBKIT_FMU_REGULATOR_MODEL_H

#include "ambkit/controllers.h"
#include "data.h"

typedef struct amb_unit {
  amb_pid_state pid[AMB_DATA_PIDS];
  amb_real u[AMB_DATA_AXES]; /* demanded control signals [V] */
} amb_unit;

/* Written by the export; data.h has AMB_DATA_AXES and AMB_DATA_PIDS, their numbers. */
extern const amb_controllers amb_data_law;
extern const amb_real amb_data_k_ui[AMB_DATA_AXES]; /* amplifier gains [A/V] */
extern const int amb_data_speed; /* index of the speed of rotation among the values; -1: none */

#endif
