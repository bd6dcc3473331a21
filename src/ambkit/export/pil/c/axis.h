/* The controller of one axis, as the loop calls it. */
#ifndef FIRMWARE_AXIS_H
#define FIRMWARE_AXIS_H

#include "rig_selftest.h"
#include "rig_telemetry.h"

#define SENSORS 1
#define AXES 1
#define STATES 4
#include "samples.h"

#define controller_state rig_state
#define controller_output rig_output
#define controller_init rig_init
#define controller_step rig_step

#define PARAMETERS rig_state *state, amb_real y, amb_real r, bool fly, rig_output *out
#define ARGUMENTS(state, s, out) (state), (s)->y[0], (s)->r[0], ((s)->fly != 0U), (out)
#define ESTIMATES(out) (out)

static void self_test(greeting *hello)
{
  rig_selftest_result found;
  rig_selftest(&found);
  hello->unequal = found.unequal;
  hello->wrong_status = found.wrong_status;
  hello->wrong = found.wrong;
}

static void tell_currents(const rig_output *out, answer *said)
{
  for (int k = 0; k < RIG_COILS; k++)
    said->coil[0][k] = out->coil[k];
  said->iu[0] = out->iu;
  said->u[0] = out->u;
}

#endif
