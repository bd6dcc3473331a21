/* The closed loop's PID. */
#ifndef AMBKIT_FMU_LOOP_PID_H
#define AMBKIT_FMU_LOOP_PID_H

#include "ambkit/controller.h"

/* Written by the export. */
extern const amb_pid amb_data_pid;
extern const bool amb_data_feedback_estimate; /* input: the estimator's, or the sensor's */

#endif
