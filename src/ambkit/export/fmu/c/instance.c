#include "instance.h"
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const modes[] = {"before initialization", "during initialization",
                                    "between steps",         "after termination",
                                    "at an event",           "in continuous time"};

const char *amb_category(amb_answer answer)
{
  return answer == AMB_DISCARD ? "logStatusDiscard" : "logStatusError";
}

amb_answer amb_refuse(const amb_instance *self, amb_answer answer, const char *format, ...)
{
  char text[256];
  va_list arguments;
  va_start(arguments, format);
  (void)vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  self->tell(self, answer, text);
  return answer;
}

bool amb_same_token(const amb_instance *self, const char *token)
{
  if ((token != NULL) && (strcmp(token, amb_token) == 0))
    return true;
  (void)amb_refuse(self, AMB_ERROR, "the token %s is not that of this model, %s",
                   token == NULL ? "(none)" : token, amb_token);
  return false;
}

double amb_time(const amb_instance *self)
{
  if (self->follow != NULL)
    return self->now.time;
  return self->now.start + (self->now.samples + self->now.part) * amb_sampling_time;
}

/* Values of the importer, in any precision of the model. */
static bool is_finite(double a)
{
  return (a >= -DBL_MAX) && (a <= DBL_MAX);
}

/* ---- Changes of the mode ---- */

void amb_reset(amb_instance *self)
{
  memset(&self->now, 0, sizeof self->now);
  for (size_t i = 0; i < AMB_VARIABLES; i++)
    self->now.value[i] = amb_variables[i].start;
}

static amb_answer wrong_mode(const amb_instance *self, const char *what)
{
  return amb_refuse(self, AMB_ERROR, "%s is not possible %s", what, modes[self->now.mode]);
}

static amb_answer start(amb_instance *self)
{
  if (amb_unit_start(&self->now.model, self->now.value) != AMB_OK)
    return amb_refuse(self, AMB_ERROR, "the parameters are not usable together");
  return AMB_DONE;
}

amb_answer amb_enter_initialization(amb_instance *self, double start_time)
{
  if (self->now.mode != AMB_INSTANTIATED)
    return wrong_mode(self, "initialization");
  if (!is_finite(start_time))
    return amb_refuse(self, AMB_ERROR, "the start time must be finite, is %g s", start_time);
  self->now.start = start_time;
  self->now.time = start_time;
  self->now.mode = AMB_INITIALIZING;
  return AMB_DONE;
}

amb_answer amb_exit_initialization(amb_instance *self)
{
  if (self->now.mode != AMB_INITIALIZING)
    return wrong_mode(self, "the end of initialization");
  const amb_answer answer = start(self);
  if (answer == AMB_DONE)
    self->now.mode = (self->follow != NULL) ? AMB_EVENTS : AMB_STEPPING;
  return answer;
}

static bool is_running(amb_mode mode)
{
  return (mode == AMB_STEPPING) || (mode == AMB_EVENTS) || (mode == AMB_CONTINUOUS);
}

amb_answer amb_terminate(amb_instance *self)
{
  if (!is_running(self->now.mode))
    return wrong_mode(self, "termination");
  self->now.mode = AMB_TERMINATED;
  return AMB_DONE;
}

/* ---- Variables ---- */

static amb_answer check(const amb_instance *self, const uint32_t *vr, size_t n, bool integer)
{
  for (size_t i = 0; i < n; i++) {
    if (vr[i] >= AMB_VARIABLES)
      return amb_refuse(self, AMB_ERROR, "there is no variable with the value reference %lu",
                        (unsigned long)vr[i]);
    const amb_variable *variable = &amb_variables[vr[i]];
    if (variable->integer != integer)
      return amb_refuse(self, AMB_ERROR, "%s is %s variable", variable->name,
                        variable->integer ? "an integer" : "a floating-point");
  }
  return AMB_DONE;
}

void amb_catch_up(amb_instance *self)
{
  if (self->follow != NULL)
    self->follow(&self->now.model, self->now.time - self->now.start, self->now.value);
}

/* During initialization the outputs follow the values set so far. */
static amb_answer show(amb_instance *self)
{
  if (self->now.mode == AMB_INSTANTIATED)
    return AMB_DONE;
  const amb_answer answer = self->now.mode == AMB_INITIALIZING ? start(self) : AMB_DONE;
  if (answer == AMB_DONE) {
    amb_catch_up(self);
    amb_unit_show(&self->now.model, self->now.value);
  }
  self->now.value[VR_time] = amb_time(self);
  return answer;
}

amb_answer amb_get_reals(amb_instance *self, const uint32_t *vr, size_t n, double *values)
{
  amb_answer answer = check(self, vr, n, false);
  if (answer == AMB_DONE)
    answer = show(self);
  for (size_t i = 0; (answer == AMB_DONE) && (i < n); i++)
    values[i] = self->now.value[vr[i]];
  return answer;
}

amb_answer amb_get_integers(amb_instance *self, const uint32_t *vr, size_t n, int32_t *values)
{
  amb_answer answer = check(self, vr, n, true);
  if (answer == AMB_DONE)
    answer = show(self);
  for (size_t i = 0; (answer == AMB_DONE) && (i < n); i++)
    values[i] = (int32_t)self->now.value[vr[i]];
  return answer;
}

static bool settable(amb_causality role, amb_mode mode)
{
  if (mode == AMB_TERMINATED)
    return false;
  return (role == AMB_INPUT) || (role == AMB_TUNABLE) || ((role == AMB_FIXED) && !is_running(mode));
}

static amb_answer check_value(const amb_instance *self, const amb_variable *variable, double value)
{
  static const char *const limits[] = {"finite", "0 or greater", "greater than 0", "a number"};
  const bool good = (variable->limit == AMB_LOSABLE) ||
                    (is_finite(value) && ((variable->limit == AMB_ANY) || (value > 0) ||
                                          ((variable->limit == AMB_NOT_NEGATIVE) && !(value < 0))));
  if (!settable(variable->role, self->now.mode))
    return amb_refuse(self, AMB_ERROR, "%s cannot be set %s", variable->name,
                      modes[self->now.mode]);
  if (!good)
    return amb_refuse(self, AMB_DISCARD, "%s must be %s, is %g %s; it stays %g %s", variable->name,
                      limits[variable->limit], value, variable->unit,
                      self->now.value[variable - amb_variables], variable->unit);
  return AMB_DONE;
}

amb_answer amb_set_reals(amb_instance *self, const uint32_t *vr, size_t n, const double *values)
{
  amb_answer answer = check(self, vr, n, false);
  for (size_t i = 0; (answer == AMB_DONE) && (i < n); i++)
    answer = check_value(self, &amb_variables[vr[i]], values[i]);
  if (answer != AMB_DONE)
    return answer;
  double changed[AMB_VARIABLES];
  memcpy(changed, self->now.value, sizeof changed);
  bool tuned = false;
  for (size_t i = 0; i < n; i++) {
    changed[vr[i]] = values[i];
    tuned |= amb_variables[vr[i]].role == AMB_TUNABLE;
  }
  if (tuned && is_running(self->now.mode) && (amb_unit_tune(&self->now.model, changed) != AMB_OK))
    return amb_refuse(self, AMB_DISCARD, "the parameters are not usable together");
  memcpy(self->now.value, changed, sizeof changed);
  return AMB_DONE;
}

/* ---- Time ---- */

/* Advances by so many sampling times. Steps are split at samples. */
static void go_on(amb_point *now, double samples)
{
  double left = samples;
  if (now->part > 0) {
    const double to = (now->part + left < 1) ? now->part + left : 1;
    amb_unit_part(&now->model, now->part, to, now->value);
    left -= to - now->part;
    now->part = to;
    if (to >= 1) {
      now->part = 0;
      now->samples++;
    }
  }
  for (; left >= 1; left--) {
    amb_unit_sample(&now->model, now->value);
    now->samples++;
  }
  if (left > 0) {
    amb_unit_part(&now->model, 0, left, now->value);
    now->part = left;
  }
}

amb_answer amb_do_step(amb_instance *self, double time, double step)
{
  const double T = amb_sampling_time, now = amb_time(self), part = self->now.part;
  if (self->now.mode != AMB_STEPPING)
    return wrong_mode(self, "a step");
  if (!is_finite(time) || !(step > 0) || !(step / T < 9e15))
    return amb_refuse(self, AMB_DISCARD, "a step of %g s from %g s is not possible", step, time);
  /* Tolerance for the rounding of a difference of two times. */
  const double tolerance = 1e-6 * T + 4 * DBL_EPSILON * ((now < 0 ? -now : now) + step);
  if ((time - now > tolerance) || (now - time > tolerance))
    return amb_refuse(self, AMB_DISCARD,
                      "a step must begin at %.12g s, where the last one ended, "
                      "not at %.12g s",
                      now, time);
  /* A step that ends within it of a sample ends at the sample. */
  const double end = part + step / T, nearest = (double)(int64_t)(end + 0.5);
  const bool at_sample = ((end - nearest) * T <= tolerance) && ((nearest - end) * T <= tolerance);
  go_on(&self->now, (at_sample && (nearest > part) ? nearest : end) - part);
  return AMB_DONE;
}

/* ---- State ---- */

static amb_answer allocate(const amb_instance *self, amb_point **point)
{
  if (*point == NULL)
    *point = (amb_point *)calloc(1, sizeof **point);
  return *point == NULL ? amb_refuse(self, AMB_ERROR, "there is no memory for a state") : AMB_DONE;
}

amb_answer amb_save(const amb_instance *self, amb_point **point)
{
  const amb_answer answer = allocate(self, point);
  if (answer == AMB_DONE)
    memcpy(*point, &self->now, sizeof self->now);
  return answer;
}

amb_answer amb_restore(amb_instance *self, const amb_point *point)
{
  if (point == NULL)
    return amb_refuse(self, AMB_ERROR, "there is no state to go back to");
  memcpy(&self->now, point, sizeof self->now);
  return AMB_DONE;
}

/* FNV hash (Fowler, Noll and Vo) of the token, then of the bytes. */
static uint64_t checksum(const unsigned char *bytes, size_t size)
{
  uint64_t hash = UINT64_C(14695981039346656037);
  for (const char *c = amb_token; *c != '\0'; c++)
    hash = (hash ^ (unsigned char)*c) * UINT64_C(1099511628211);
  for (size_t i = 0; i < size; i++)
    hash = (hash ^ bytes[i]) * UINT64_C(1099511628211);
  return hash;
}

size_t amb_serialized_size(void)
{
  return sizeof(uint64_t) + sizeof(amb_point);
}

amb_answer amb_serialize(const amb_instance *self, const amb_point *point, unsigned char *bytes,
                         size_t size)
{
  if ((point == NULL) || (size != amb_serialized_size()))
    return amb_refuse(self, AMB_ERROR, "a state takes %lu bytes, not %lu",
                      (unsigned long)amb_serialized_size(), (unsigned long)size);
  memcpy(bytes + sizeof(uint64_t), point, sizeof *point);
  const uint64_t sum = checksum(bytes + sizeof sum, sizeof *point);
  memcpy(bytes, &sum, sizeof sum);
  return AMB_DONE;
}

amb_answer amb_deserialize(const amb_instance *self, const unsigned char *bytes, size_t size,
                           amb_point **point)
{
  uint64_t sum = 0;
  if (size == amb_serialized_size())
    memcpy(&sum, bytes, sizeof sum);
  if ((size != amb_serialized_size()) || (sum != checksum(bytes + sizeof sum, sizeof **point)))
    return amb_refuse(self, AMB_ERROR, "these %lu bytes are not a state of this model",
                      (unsigned long)size);
  const amb_answer answer = allocate(self, point);
  if (answer == AMB_DONE)
    memcpy(*point, bytes + sizeof sum, sizeof **point);
  return answer;
}
