#include "ambkit/envelope.h"

/* Of a standard deviation, at each start from a measurement. */
#define LESS_SURE AMB_C(10.0)

bool amb_envelope_within(const amb_kalman *kf, amb_real caps, const amb_real mean[AMB_STATES])
{
  bool within = true;
  for (int i = 0; i < amb_states(&kf->model); i++) {
    within = within && (amb_magnitude(mean[i]) <= (caps * kf->set.cap[i]));
  }
  return within;
}

bool amb_envelope_clamp(const amb_kalman *kf, amb_real mean[AMB_STATES])
{
  const bool within = amb_envelope_within(kf, AMB_C(1.0), mean);
  for (int i = 0; i < amb_states(&kf->model); i++) {
    mean[i] = amb_clamp(mean[i], -kf->set.cap[i], kf->set.cap[i]);
  }
  return !within;
}

/* All states of a rotor at rest that is off by 1 m in position i, or what else state i is. */
static void off_by_one(const amb_model *model, int i, amb_real states[AMB_STATES])
{
  for (int j = 0; j < amb_states(model); j++) {
    states[j] = (i == j) ? AMB_C(1.0) : AMB_C(0.0);
  }
  if (amb_model_role(model, i) == AMB_POSITION) {
    amb_model_at_rest(model, states);
  }
}

/* All states of a rotor at rest where sensor r shows 1 m. */
static void where_shown(const amb_model *model, int r, amb_real states[AMB_STATES])
{
  const int n = amb_states(model);
  amb_real sum = AMB_C(0.0);
  amb_real one[AMB_STATES];
  for (int j = 0; j < n; j++) {
    states[j] = AMB_C(0.0);
  }
  for (int i = 0; i < n; i++) {
    if (amb_model_role(model, i) == AMB_POSITION) {
      off_by_one(model, i, one);
      const amb_real shown = amb_model_shown(model, r, one);
      sum += shown * shown;
      for (int j = 0; j < n; j++) {
        states[j] += shown * one[j];
      }
    }
  }
  for (int j = 0; j < n; j++) {
    states[j] = (sum > AMB_C(0.0)) ? (states[j] / sum) : AMB_C(0.0);
  }
}

void amb_envelope_place(const amb_kalman *kf, int r, amb_real y, amb_real mean[AMB_STATES])
{
  const amb_model *model = &kf->model;
  amb_real shown[AMB_STATES];
  where_shown(model, r, shown);
  for (int i = 0; i < amb_states(model); i++) {
    const amb_role role = amb_model_role(model, i);
    if (role != AMB_KNOWN) {
      mean[i] = shown[i] * y;
    }
    if (role == AMB_POSITION) {
      mean[i] = amb_clamp(mean[i], -kf->set.cap[i], kf->set.cap[i]);
    }
  }
}

static amb_real at_most(amb_real variance, amb_real most)
{
  return (variance <= most) ? variance : most;
}

/* P += variance a a'. */
static void add_square(int n, amb_real variance, const amb_real a[AMB_STATES],
                       amb_real P[AMB_TRIANGLE])
{
  for (int i = 0; i < n; i++) {
    for (int j = i; j < n; j++) {
      P[amb_entry(n, i, j)] += a[i] * (a[j] * variance);
    }
  }
}

static void clear(int n, amb_real P[AMB_TRIANGLE])
{
  for (int i = 0; i < amb_entry(n, n - 1, n); i++) {
    P[i] = AMB_C(0.0);
  }
}

/* Of these variances, positions anywhere between the stops, and sensors that show them to a tenth.
 */
static void fill_anywhere(const amb_kalman *kf, const amb_real variance[AMB_STATES],
                          amb_real P[AMB_TRIANGLE])
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  amb_real one[AMB_STATES];
  clear(n, P);
  for (int i = 0; i < n; i++) {
    const amb_role role = amb_model_role(model, i);
    off_by_one(model, i, one);
    if (role != AMB_SHOWN) {
      add_square(n, (role == AMB_POSITION) ? kf->widest[i] : variance[i], one, P);
    }
  }
  for (int i = 0; i < n; i++) {
    if (amb_model_role(model, i) == AMB_SHOWN) {
      P[amb_entry(n, i, i)] *= AMB_C(1.01);
    }
  }
}

void amb_envelope_open(const amb_kalman *kf, amb_real P[AMB_TRIANGLE])
{
  fill_anywhere(kf, kf->widest, P);
}

amb_status amb_envelope_hold(const amb_kalman *kf, amb_kalman_state *state)
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  bool sound = amb_envelope_within(kf, AMB_ASTRAY, state->mean);
  amb_real share = AMB_C(1.0); /* of the variances, with which positions are between the stops */
  amb_real variance[AMB_STATES];
  for (int i = 0; i < n; i++) {
    const amb_role role = amb_model_role(model, i);
    variance[i] = state->cov[amb_entry(n, i, i)];
    sound = sound && ((role == AMB_SHOWN) || amb_is_finite(variance[i]));
    if (role == AMB_POSITION) {
      share = at_most(kf->widest[i] / variance[i], share);
    }
  }
  for (int i = 0; i < n; i++) {
    const amb_role role = amb_model_role(model, i);
    const bool goes_on = sound && ((role == AMB_LOAD) || (role == AMB_KNOWN));
    const amb_real cap = kf->set.cap[i];
    state->mean[i] = goes_on ? amb_clamp(state->mean[i], -cap, cap) : AMB_C(0.0);
    if (role == AMB_VELOCITY) {
      variance[i] *= share;
    }
    variance[i] = at_most(variance[i], kf->widest[i]);
  }
  for (int r = 0; r < amb_sensors(model); r++) {
    state->sensor[r].residual = AMB_C(0.0);
  }
  fill_anywhere(kf, sound ? variance : kf->widest, state->cov);
  return sound ? AMB_HELD : (AMB_HELD | AMB_RESTARTED);
}

/* The only sensor: the rotor is where it shows it. */
static void restart_there(const amb_kalman *kf, amb_kalman_state *state, int r, amb_real y)
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  const amb_real lag = kf->set.T + kf->set.lag[r];
  amb_real variance[AMB_STATES];
  amb_real shown[AMB_STATES];
  amb_real fastest = AMB_C(0.0); /* variance of a velocity */
  for (int i = 0; i < n; i++) {
    const amb_role role = amb_model_role(model, i);
    variance[i] = state->cov[amb_entry(n, i, i)];
    if (role != AMB_KNOWN) {
      variance[i] = at_most((LESS_SURE * LESS_SURE) * variance[i], kf->widest[i]);
    }
    if ((role == AMB_VELOCITY) && (variance[i] > fastest)) {
      fastest = variance[i];
    }
  }
  where_shown(model, r, shown);
  clear(n, state->cov);
  for (int i = 0; i < n; i++) {
    const amb_role role = amb_model_role(model, i);
    if (role == AMB_POSITION) { /* at this speed it goes away from what the sensor shows */
      variance[i] = at_most(variance[i] + (lag * lag) * fastest, kf->widest[i]);
    }
    if (role != AMB_SHOWN) {
      state->cov[amb_entry(n, i, i)] = variance[i];
    }
  }
  add_square(n, kf->set.var_y[r], shown, state->cov);
  amb_envelope_place(kf, r, y, state->mean);
  state->sensor[r].residual = AMB_C(0.0);
}

#if AMB_SENSORS > 1
/* One of several: all is less sure, and then it is believed. */
static void restart_towards(const amb_kalman *kf, amb_kalman_state *state, int r, amb_real y)
{
  const int n = amb_states(&kf->model);
  amb_real less[AMB_STATES];
  amb_real e;
  amb_real S;
  for (int i = 0; i < n; i++) {
    const amb_real variance = (LESS_SURE * LESS_SURE) * state->cov[amb_entry(n, i, i)];
    less[i] = (variance <= kf->widest[i]) ? LESS_SURE : AMB_C(1.0);
  }
  for (int i = 0; i < n; i++) {
    for (int j = i; j < n; j++) {
      state->cov[amb_entry(n, i, j)] *= less[i] * less[j];
    }
  }
  const amb_real least = AMB_ROOT_EPSILON * amb_model_shown_variance(&kf->model, r, state->cov);
  const amb_real var_y = (least > kf->set.var_y[r]) ? least : kf->set.var_y[r];
  amb_model_update(&kf->model, r, y, var_y, state->mean, state->cov, &e, &S);
  (void)amb_envelope_clamp(kf, state->mean); /* no variance here could lead it back from beyond */
  state->sensor[r].residual = AMB_C(0.0);
}
#endif

void amb_envelope_restart(const amb_kalman *kf, amb_kalman_state *state, int r, amb_real y)
{
#if AMB_SENSORS > 1
  if (amb_sensors(&kf->model) > 1) {
    restart_towards(kf, state, r, y);
    return;
  }
#endif
  restart_there(kf, state, r, y);
}
