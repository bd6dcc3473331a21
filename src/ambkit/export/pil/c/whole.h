/* The controllers of a whole machine, as the loop calls them. */
#ifndef FIRMWARE_WHOLE_H
#define FIRMWARE_WHOLE_H

#include "rig_control.h"
#include "rig_selftest.h"
#include "rig_telemetry.h"
#include <string.h>

#define SENSORS AMB_SENSORS
#define AXES AMB_CONTROLS
#define STATES AMB_STATES
#include "samples.h"

#define controller_state rig_control_state
#define controller_output rig_command
#define controller_init rig_control_init
#define controller_step rig_control_step

#define PARAMETERS                                                                                 \
  rig_control_state *state, const amb_real y[SENSORS], const amb_real r[AXES], amb_real speed,     \
      bool fly, rig_command *out
#define ARGUMENTS(state, s, out) (state), (s)->y, (s)->r, (s)->speed, ((s)->fly != 0U), (out)
#define ESTIMATES(out) (&(out)->estimates)

static void self_test(greeting *hello)
{
  rig_selftest_result found;
  amb_real largest;
  rig_selftest(&found);
  hello->unequal = found.unequal + rig_control_selftest(&largest);
  hello->wrong_status = found.wrong_status;
  hello->wrong = found.wrong;
}

static void tell_currents(const rig_command *out, answer *said)
{
  (void)memcpy(said->coil, out->coil, sizeof said->coil);
  (void)memcpy(said->iu, out->iu, sizeof said->iu);
  (void)memcpy(said->u, out->u, sizeof said->u);
}

#endif
