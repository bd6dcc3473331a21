/* Interface of the exported controller to the loop: for SEVERAL axes with arrays and the rotation.
 */
#ifndef FIRMWARE_CONTROLLER_H
#define FIRMWARE_CONTROLLER_H

#if SEVERAL
#include "rig_control_selftest.h"
#else
#include "rig_selftest.h"
#endif
#include "rig_telemetry.h"
#include <string.h>

#define SENSORS AMB_SENSORS
#define AXES AMB_CONTROLS
#include "samples.h"

#if SEVERAL
#define controller_state rig_control_state
#define controller_output rig_command
#define controller_init rig_control_init
#define controller_step rig_control_step
#define controller_deenergise rig_control_deenergise
#define PARAMETERS                                                                                 \
  rig_control_state *state, const amb_real y[SENSORS], const amb_real r[AXES], amb_real rotation,  \
      bool fly, rig_command *out
#define ARGUMENTS(state, s, out) (state), (s)->y, (s)->r, (s)->rotation, ((s)->fly != 0U), (out)
#define ESTIMATES(out) (&(out)->estimates)
#else
#define controller_state rig_state
#define controller_output rig_output
#define controller_init rig_init
#define controller_step rig_step
#define controller_deenergise rig_deenergise
#define PARAMETERS rig_state *state, amb_real y, amb_real r, bool fly, rig_output *out
#define ARGUMENTS(state, s, out) (state), (s)->y[0], (s)->r[0], ((s)->fly != 0U), (out)
#define ESTIMATES(out) (out)
#endif

static void self_test(greeting *hello)
{
  rig_selftest_result result;
  rig_selftest(&result);
  hello->unequal = result.unequal;
  hello->wrong_status = result.wrong_status;
  hello->wrong = result.wrong;
#if SEVERAL
  rig_control_selftest(&result);
  hello->unequal += result.unequal;
  hello->wrong_status += result.wrong_status;
  hello->wrong |= result.wrong;
#endif
}

static void tell_currents(const controller_output *out, answer *reply)
{
  (void)memcpy(reply->coil, &out->coil, sizeof out->coil);
  (void)memcpy(reply->iu, &out->iu, sizeof reply->iu);
  (void)memcpy(reply->u, &out->u, sizeof reply->u);
}

#endif
