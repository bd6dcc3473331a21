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
  amb_loop_state state; /* at the sample reached last */
  amb_glimpse between;
} amb_unit;

/* The controller: a PID (loop_pid.c), or a complete controller (loop_flight.c). Sets the parameters
 * among the values; ... */
void amb_held_tune(amb_unit *model, const double value[]);
/* ... connects it to the loop, valid while `control` is not moved; ... */
void amb_held_by(const amb_unit *model, amb_control *control, amb_loop *loop);
/* ... starts it, at these displacements along the axes [m] and with the demanded currents; ... */
void amb_held_start(const amb_loop *loop, amb_unit *model, const amb_real place[],
                    const double value[]);
/* ... returns the command to levitate; ... */
bool amb_held_wanted(const double value[]);
/* ... and writes its outputs. */
void amb_held_show(const amb_unit *model, double value[]);

#endif
