/* The complete controller as a model: it reads the measurements at the start of a sample, and holds
 * the coil currents until the next. */
#ifndef AMBKIT_FMU_FLIGHT_MODEL_H
#define AMBKIT_FMU_FLIGHT_MODEL_H

#include "flight.h"

typedef struct amb_unit {
  amb_kalman filter;
  amb_data_state estimate;
  amb_control_state state;
  amb_control_output output;
  amb_status status; /* of the last step */
} amb_unit;

#endif
