#include "exchange.h"
#include <string.h>

amb_follow *const amb_exchange = amb_unit_follow;

static amb_answer wrong(const amb_instance *self, const char *what)
{
  return amb_refuse(self, AMB_ERROR, "%s is not possible now", what);
}

static bool is_running(const amb_instance *self)
{
  return (self->now.mode == AMB_EVENTS) || (self->now.mode == AMB_CONTINUOUS);
}

static amb_answer counted(const amb_instance *self, size_t n, size_t expected)
{
  if (n == expected)
    return AMB_DONE;
  return amb_refuse(self, AMB_ERROR, "there are %lu, not %lu", (unsigned long)expected,
                    (unsigned long)n);
}

/* With the present inputs, parameters and time. */
static amb_answer follow(amb_instance *self, size_t n, size_t expected)
{
  if (!is_running(self) && (self->now.mode != AMB_INITIALIZING))
    return wrong(self, "that");
  const amb_answer answer = counted(self, n, expected);
  if (answer == AMB_DONE)
    amb_catch_up(self);
  return answer;
}

amb_answer amb_to_events(amb_instance *self)
{
  if (!is_running(self))
    return wrong(self, "event mode");
  self->now.mode = AMB_EVENTS;
  return AMB_DONE;
}

amb_answer amb_update(amb_instance *self, bool *jumped)
{
  if (self->now.mode != AMB_EVENTS)
    return wrong(self, "an update of what is discrete");
  amb_catch_up(self);
  *jumped = amb_unit_event(&self->now.model, self->now.value);
  return AMB_DONE;
}

amb_answer amb_to_continuous(amb_instance *self)
{
  if (self->now.mode != AMB_EVENTS)
    return wrong(self, "continuous-time mode");
  self->now.mode = AMB_CONTINUOUS;
  return AMB_DONE;
}

amb_answer amb_step_completed(const amb_instance *self)
{
  return self->now.mode == AMB_CONTINUOUS ? AMB_DONE : wrong(self, "the end of a step");
}

amb_answer amb_set_time(amb_instance *self, double time)
{
  if (!is_running(self))
    return wrong(self, "setting the time");
  if (!((time - time) == 0)) /* finite numbers only */
    return amb_refuse(self, AMB_ERROR, "the time must be finite, is %g s", time);
  self->now.time = time;
  return AMB_DONE;
}

amb_answer amb_set_states(amb_instance *self, const double *states, size_t n)
{
  if (self->now.mode != AMB_CONTINUOUS)
    return wrong(self, "setting states");
  const amb_answer answer = counted(self, n, AMB_CONTINUOUS_STATES);
  for (size_t i = 0; (answer == AMB_DONE) && (i < n); i++) {
    if (!((states[i] - states[i]) == 0))
      return amb_refuse(self, AMB_DISCARD, "state %lu must be finite, is %g", (unsigned long)i,
                        states[i]);
  }
  if (answer == AMB_DONE)
    amb_unit_set_states(&self->now.model, states);
  return answer;
}

amb_answer amb_get_states(amb_instance *self, double *states, size_t n)
{
  const amb_answer answer = follow(self, n, AMB_CONTINUOUS_STATES);
  if (answer == AMB_DONE)
    amb_unit_states(&self->now.model, states);
  return answer;
}

amb_answer amb_get_slopes(amb_instance *self, double *slopes, size_t n)
{
  const amb_answer answer = follow(self, n, AMB_CONTINUOUS_STATES);
  if (answer == AMB_DONE)
    amb_unit_slopes(&self->now.model, self->now.value, slopes);
  return answer;
}

amb_answer amb_get_indicators(amb_instance *self, double *indicators, size_t n)
{
  const amb_answer answer = follow(self, n, AMB_EVENT_INDICATORS);
  if (answer == AMB_DONE)
    amb_unit_indicators(&self->now.model, self->now.value, indicators);
  return answer;
}

amb_answer amb_get_nominals(const amb_instance *self, double *nominals, size_t n)
{
  const amb_answer answer = counted(self, n, AMB_CONTINUOUS_STATES);
  if (answer == AMB_DONE)
    memcpy(nominals, amb_nominals, n * sizeof nominals[0]);
  return answer;
}
