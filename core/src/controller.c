#include "ambkit/controller.h"

void amb_pid_reset(amb_pid_state *state, amb_real integral)
{
  state->integral = integral;
  state->last_x = 0;
  state->velocity = 0;
  state->started = false;
}

amb_real amb_pid_step(const amb_pid *pid, amb_pid_state *state, amb_real r, amb_real x,
                      const amb_real *velocity)
{
  if (velocity != NULL)
    state->velocity = *velocity;
  else if (state->started)
    state->velocity += ((x - state->last_x) - pid->T * state->velocity) / (pid->T_f + pid->T);
  state->last_x = x;
  state->started = true;

  const amb_real error = r - x;
  const amb_real demanded = pid->kp * error + state->integral - pid->kd * state->velocity;
  const amb_real held = amb_clamp(demanded, pid->iu_min, pid->iu_max);
  if (pid->T_t > 0)
    state->integral += pid->T * (pid->ki * error + (held - demanded) / pid->T_t);
  else if (!((held < demanded) || (held > demanded)))
    state->integral += pid->T * pid->ki * error;
  return held;
}
