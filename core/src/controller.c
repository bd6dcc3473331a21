#include "ambkit/controller.h"

/* Maximum derivative and section output, in current ranges; beyond, the value is invalid. */
#define FASTEST AMB_C(1000.0)

static void keep(amb_pid_state *state, amb_real integral)
{
  const amb_real held = amb_clamp(integral, -AMB_REAL_ROOT, AMB_REAL_ROOT);
  state->integral = held;
  state->copy[0] = held;
  state->copy[1] = held;
}

/* Majority of three copies. */
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
  state->flows = false;
}

/* Initialise the sections to the steady state for `demanded`. */
static amb_real settled(const amb_pid *pid, amb_pid_state *state, amb_real demanded)
{
  amb_real at = demanded;
  for (int k = 0; k < pid->sections; k++) {
    const amb_real *c = &pid->section[AMB_SECTION * k];
    const amb_real out = (at * (c[0] + c[1] + c[2])) / (AMB_C(1.0) + c[3] + c[4]);
    state->section[k][0] = out - (c[0] * at);
    state->section[k][1] = (c[2] * at) - (c[4] * out);
    at = out;
  }
  return at;
}

/* Output of the sections: direct form II, transposed. */
static amb_real filtered(const amb_pid *pid, amb_pid_state *state, amb_real demanded)
{
  amb_real at = demanded;
  if (!state->flows) {
    at = settled(pid, state, demanded);
  } else {
    for (int k = 0; k < pid->sections; k++) {
      const amb_real *c = &pid->section[AMB_SECTION * k];
      const amb_real out = (c[0] * at) + state->section[k][0];
      state->section[k][0] = ((c[1] * at) - (c[3] * out)) + state->section[k][1];
      state->section[k][1] = (c[2] * at) - (c[4] * out);
      at = out;
    }
    if (!AMB_WITHIN(at, FASTEST * (pid->iu_max - pid->iu_min))) {
      at = settled(pid, state, demanded); /* a bit in memory has flipped */
    }
  }
  state->flows = state->started;
  return at;
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
    } else { /* first sample */
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
  const amb_real own = pid->kp * weighted + integral - pid->kd * state->velocity;
  const amb_real demanded = (pid->sections > 0) ? filtered(pid, state, own) : own;
  *iu = amb_clamp(demanded, pid->iu_min, pid->iu_max);
  const bool saturated = (*iu < demanded) || (*iu > demanded);
  if (pid->T_t > AMB_C(0.0)) {
    keep(state, integral + (pid->T * (pid->ki * error + (*iu - demanded) / pid->T_t)));
  } else if (!saturated) {
    keep(state, integral + (pid->T * pid->ki * error));
  } else { /* at the limit the integrator stops */
    keep(state, integral);
  }
  return saturated ? (status | AMB_SATURATED) : status;
}
