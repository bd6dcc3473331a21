#include "ambkit/control.h"
#include "ambkit/envelope.h"

void amb_work_by(amb_works_by *works_by, const amb_control *control)
{
  works_by->control = control;
  works_by->copy[0] = control;
  works_by->copy[1] = control;
}

const amb_control *amb_working_by(amb_works_by *works_by, const amb_control *otherwise)
{
  const amb_control *control = otherwise;
  if ((works_by->control == works_by->copy[0]) || (works_by->control == works_by->copy[1])) {
    control = works_by->control;
  } else if (works_by->copy[0] == works_by->copy[1]) {
    control = works_by->copy[0];
  } else { /* no two are equal */
  }
  amb_work_by(works_by, control);
  return control;
}

/* A number limited to a range; `none` if it is not finite. Comparisons of `a` itself show its
 * bounds to the proof. */
static amb_real held(amb_real a, amb_real most, amb_real none)
{
  const amb_real beyond = (a > most) ? most : -most;
  return AMB_WITHIN(a, most) ? a : (amb_is_finite(a) ? beyond : none);
}

static void start_at(const amb_control *c, amb_control_state *s, void *filter,
                     const amb_real y[AMB_SENSORS])
{
  const amb_model *model = &c->estimator->kf->model;
  const int m = amb_sensors(model);
  amb_real mean[AMB_STATES];
  for (int i = 0; i < amb_states(model); i++) {
    amb_real sum = c->start[i];
    for (int r = 0; r < m; r++) {
      sum += c->start_by[(i * m) + r] * held(y[r], c->estimator->kf->far[r], AMB_C(0.0));
    }
    mean[i] = sum;
  }
  (void)c->estimator->methods->reset(c->estimator, filter, mean, c->std);
  s->doubted = c->settling;
  s->missed = 0U;
  s->sampled = false;
}

/* No information before the first reading. */
static void forget(const amb_control *c, amb_control_state *s, void *filter)
{
  const amb_real nothing[AMB_SENSORS] = {0};
  start_at(c, s, filter, nothing);
  s->started = false;
}

void amb_control_init(const amb_control *control, amb_control_state *state, void *filter)
{
  const amb_real none[AMB_CONTROLS] = {0};
  amb_control_levitate(control, state, none, none);
  amb_sequence_init(&state->sequence);
  forget(control, state, filter);
}

void amb_control_levitate(const amb_control *control, amb_control_state *state, const amb_real iu[],
                          const amb_real integral[])
{
  const amb_kalman *kf = control->estimator->kf;
  for (int f = 0; f < control->law->axes; f++) {
    state->u[f] = held(iu[f], AMB_REAL_ROOT, AMB_C(0.0)) / kf->set.k_ui[f];
    state->from[f] = control->down[f];
  }
  for (int j = 0; j < control->law->pids; j++) {
    amb_pid_reset(&state->pid[j], integral[j]);
  }
  amb_sequence_levitate(&state->sequence);
  state->limited = false;
  state->doubted = 0U;
  state->missed = 0U;
  state->started = true;
  state->sampled = false;
}

/* Initial integrals: those that hold the rotor where it lies. */
static void lift(const amb_control *c, amb_control_state *s, const amb_real mean[])
{
  const int n = amb_states(&c->estimator->kf->model);
  const int p = c->law->axes;
  for (int f = 0; f < p; f++) {
    amb_real at = AMB_C(0.0);
    for (int i = 0; i < n; i++) {
      at += c->place[(f * n) + i] * mean[i];
    }
    s->from[f] = at;
  }
  for (int j = 0; j < c->law->pids; j++) {
    amb_real integral = c->hold[j];
    for (int f = 0; f < p; f++) {
      integral += c->hold_by[(j * p) + f] * s->from[f];
    }
    amb_pid_reset(&s->pid[j], integral);
  }
}

/* Bumpless transfer from another controller, whose currents are known. */
void amb_control_transfer(const amb_control *control, amb_control_state *state, void *filter,
                          const amb_real y[AMB_SENSORS], const amb_real iu[])
{
  amb_real integral[AMB_CONTROLS];
  start_at(control, state, filter, y);
  lift(control, state, ((const amb_kalman_state *)filter)->mean);
  for (int j = 0; j < control->law->pids; j++) {
    integral[j] = state->pid[j].integral;
  }
  amb_control_levitate(control, state, iu, integral);
}

/* Range of readings of a rotor that is not known yet: between the stops, plus four standard
 * deviations of noise for a rotor in contact. */
static bool is_between_the_stops(const amb_kalman *kf, const amb_real y[AMB_SENSORS])
{
  bool between = true;
  for (int r = 0; r < amb_sensors(&kf->model); r++) {
    const amb_real shown = amb_magnitude(kf->set.K_sen[r]) * kf->set.travel[r];
    const amb_real beyond = amb_magnitude(y[r]) - shown;
    const amb_real var_y = kf->set.var_y[r] + kf->rounding[r];
    const bool near = (beyond <= kf->far[r]) && ((beyond * beyond) <= (AMB_C(16.0) * var_y));
    between = between && ((beyond <= AMB_C(0.0)) || near);
  }
  return between;
}

/* Restarts an estimate that is physically impossible, or has an invalid covariance (a bit in memory
 * has flipped). Returns whether the estimate is usable. */
static amb_status supervise(const amb_control *c, amb_control_state *s, void *filter,
                            amb_status status, amb_control_output *out)
{
  const amb_status unsure = AMB_HELD | AMB_RESTARTED | AMB_BAD_PARAMETER;
  const amb_kalman *kf = c->estimator->kf;
  amb_status flags = status;
  bool used = false; /* at least one reading; states without information are held by the envelope */
  const amb_kalman_state *base = (const amb_kalman_state *)filter;
  bool sound = amb_envelope_bounds(kf, c->bound, base->mean, base->cov);
  for (int r = 0; r < amb_sensors(&kf->model); r++) {
    used = used || ((out->estimator.health[r] & AMB_UNUSED) == 0U);
    sound = sound && amb_is_finite(out->estimator.variance[r]);
  }
  if (!sound) {
    forget(c, s, filter);
    flags |= AMB_RESTARTED;
  }
  if (used) {
    s->missed = 0U;
  } else if (s->missed < c->settling) {
    s->missed++;
  } else { /* count of samples, limited */
  }
  if (((flags & unsure) != 0U) || (s->doubted > c->settling)) { /* or a bit has flipped */
    s->doubted = c->settling;
  } else if (used && (s->doubted > 0U)) {
    s->doubted--;
  } else { /* unchanged */
  }
  const bool settled = (s->doubted == 0U) || !c->feedback_estimate;
  out->usable = s->started && settled && (s->missed < c->settling);
  return flags;
}

static amb_status estimate(const amb_control *c, amb_control_state *s, void *filter,
                           const amb_real y[AMB_SENSORS], amb_control_output *out)
{
  if (!s->started && is_between_the_stops(c->estimator->kf, y)) {
    start_at(c, s, filter, y);
    s->started = true;
  }
  const amb_real *acted = (s->started && !s->sampled) ? NULL : s->u;
  const amb_status status = amb_estimator_step(c->estimator, filter, y, acted, &out->estimator);
  s->sampled = s->started;
  out->usable = true;
  return (c->sequence != NULL) ? supervise(c, s, filter, status, out) : status;
}

/* The input of the controllers. In contact the estimated load is the force of the bearing;
 * compensating it would prevent lift-off, so loads count from half of the way on. */
static void see(const amb_control *c, const amb_real mean[], const amb_real y[], amb_real way,
                amb_real x[])
{
  const amb_model *model = &c->estimator->kf->model;
  const amb_real counts = amb_at_least((AMB_C(2.0) * way) - AMB_C(1.0), AMB_C(0.0));
  const amb_real share = counts * (AMB_C(1.0) + c->excess);
  if (c->feedback_estimate) {
    for (int i = 0; i < amb_states(model); i++) {
      x[i] = (amb_model_role(model, i) == AMB_LOAD) ? (share * mean[i]) : mean[i];
    }
  } else {
    for (int r = 0; r < amb_sensors(model); r++) {
      x[r] = held(y[r], AMB_REAL_ROOT, y[r]);
    }
  }
}

static amb_status act(const amb_control *c, amb_control_state *s, const amb_real mean[],
                      const amb_real y[AMB_SENSORS], const amb_real r[], amb_real speed,
                      amb_real iu[])
{
  const amb_real way = amb_sequence_way(&s->sequence);
  amb_real x[(AMB_STATES > AMB_SENSORS) ? AMB_STATES : AMB_SENSORS];
  amb_real to[AMB_CONTROLS];
  see(c, mean, y, way, x);
  for (int f = 0; f < c->law->axes; f++) {
    const bool on_the_way = (way < AMB_C(1.0)) && AMB_WITHIN(r[f], AMB_REAL_ROOT);
    to[f] = on_the_way ? (s->from[f] + (way * (r[f] - s->from[f]))) : r[f];
  }
  const amb_status status = amb_controllers_step(c->law, s->pid, to, x, speed, iu);
  for (int f = 0; f < c->law->axes; f++) {
    s->u[f] = iu[f] / c->estimator->kf->set.k_ui[f];
  }
  return status;
}

amb_status amb_control_step(const amb_control *control, amb_control_state *state, void *filter,
                            const amb_real y[AMB_SENSORS], const amb_real r[], amb_real speed,
                            bool fly, amb_control_output *out)
{
  const amb_real *mean = ((const amb_kalman_state *)filter)->mean;
  amb_status status = estimate(control, state, filter, y, out);
  if (control->sequence != NULL) {
    const amb_flight_mode before = state->sequence.mode;
    const amb_flight_mode now =
        amb_sequence_step(control->sequence, &state->sequence, fly, out->usable, state->limited);
    if ((before == AMB_WAITING) && (now == AMB_LIFTING)) {
      lift(control, state, mean);
    }
  }
  out->mode = state->sequence.mode;
  out->on = amb_sequence_on(&state->sequence);
  amb_clear(control->law->axes, out->iu);
  amb_clear(control->law->axes, state->u);
  if (out->on) {
    const amb_status acted = act(control, state, mean, y, r, speed, out->iu);
    state->limited = (acted & AMB_SATURATED) != 0U;
    status |= acted;
  } else {
    amb_deenergise(control->estimator, filter);
  }
  return status;
}

void amb_control_deenergise(const amb_control *control, amb_control_state *state, void *filter)
{
  amb_deenergise(control->estimator, filter);
  if (control->sequence != NULL) {
    amb_sequence_trip(&state->sequence);
  }
}
