#include "ambkit/controller.h"

/* Beyond so many ranges of the current the derivative is no rotor's. */
#define FASTEST AMB_C(1000.0)

static void keep(amb_pid_state *state, amb_real integral)
{
  const amb_real held = amb_clamp(integral, -AMB_REAL_ROOT, AMB_REAL_ROOT);
  state->integral = held;
  state->copy[0] = held;
  state->copy[1] = held;
}

/* The one of three of which two are equal. */
static amb_real kept(const amb_pid_state *state)
{
  return (state->integral == state->copy[0]) ? state->integral : state->copy[1];
}

void amb_pid_reset(amb_pid_state *state, amb_real integral)
{
  keep(state, integral);
  state->last_r = AMB_C(0.0);
  state->last_x = AMB_C(0.0);
  state->velocity = AMB_C(0.0);
  state->started = false;
}

amb_status amb_pid_step(const amb_pid *pid, amb_pid_state *state, amb_real r, amb_real x,
                        const amb_real *velocity, amb_real *iu)
{
  amb_status status = AMB_OK;
  if (!AMB_WITHIN(x, AMB_REAL_ROOT) ||
      ((velocity != NULL) && !AMB_WITHIN(*velocity, AMB_REAL_ROOT))) {
    status |= AMB_MISSING;
  } else {
    if (velocity != NULL) {
      state->velocity = *velocity;
    } else if (state->started) {
      state->velocity += ((x - state->last_x) - pid->T * state->velocity) / (pid->T_f + pid->T);
      if (!AMB_WITHIN(pid->kd * state->velocity, FASTEST * (pid->iu_max - pid->iu_min))) {
        state->velocity = AMB_C(0.0); /* a bit in memory has flipped */
      }
      state->velocity = amb_clamp(state->velocity, -AMB_REAL_ROOT, AMB_REAL_ROOT);
    } else { /* nothing to compare it with */
    }
    state->last_x = x;
    state->started = true;
  }
  if (AMB_WITHIN(r, AMB_REAL_ROOT)) {
    state->last_r = r;
  } else {
    status |= AMB_BAD_CONTROL;
  }

  const amb_real error = state->last_r - state->last_x;
  const amb_real weighted = pid->weight * state->last_r - state->last_x;
  const amb_real integral = kept(state);
  const amb_real demanded = pid->kp * weighted + integral - pid->kd * state->velocity;
  *iu = amb_clamp(demanded, pid->iu_min, pid->iu_max);
  const bool saturated = (*iu < demanded) || (*iu > demanded);
  if (pid->T_t > AMB_C(0.0)) {
    keep(state, integral + (pid->T * (pid->ki * error + (*iu - demanded) / pid->T_t)));
  } else if (!saturated) {
    keep(state, integral + (pid->T * pid->ki * error));
  } else { /* at the limit it stands */
    keep(state, integral);
  }
  return saturated ? (status | AMB_SATURATED) : status;
}
