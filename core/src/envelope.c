#include "ambkit/envelope.h"
#include "equilibrium.h"

/* Factor of the standard deviations at each restart. */
#define LESS_SURE AMB_C(10.0)

bool amb_envelope_within(const amb_kalman *kf, amb_real caps, const amb_real mean[AMB_STATES])
{
  return amb_all_within(amb_states(&kf->model), mean, caps, kf->set.cap);
}

bool amb_envelope_clamp(const amb_kalman *kf, amb_real mean[AMB_STATES])
{
  const bool within = amb_envelope_within(kf, AMB_C(1.0), mean);
  for (int i = 0; i < amb_states(&kf->model); i++) {
    mean[i] = amb_clamp(mean[i], -kf->set.cap[i], kf->set.cap[i]);
  }
  return !within;
}

bool amb_envelope_bounds(const amb_kalman *kf, amb_real caps, const amb_real mean[AMB_STATES],
                         const amb_real cov[AMB_TRIANGLE])
{
  const int n = amb_states(&kf->model);
  for (int i = 0; i < n; i++) {
    const amb_real most = caps * kf->set.cap[i];
    if (!AMB_WITHIN(mean[i], most)) {
      return false;
    }
  }
  for (int i = 0; i < amb_entry(n, n - 1, n); i++) {
    if (!AMB_WITHIN(cov[i], kf->most[i])) {
      return false;
    }
  }
  return true;
}

/* One sensor: the rotor at rest at its reading. */
static void place_at_reading(const amb_kalman *kf, int r, amb_real y, amb_real mean[AMB_STATES])
{
  const amb_model *model = &kf->model;
  amb_real shown[AMB_STATES];
  amb_rest_where_shown(model, r, shown);
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

#if AMB_SENSORS > 1
/* Several sensors: the coordinate that this one measures is at rest, at the nearest position to the
 * previous one with that reading. */
static void place_nearest(const amb_kalman *kf, int r, amb_real y, amb_real mean[AMB_STATES])
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  bool seen[AMB_STATES];
  amb_real shown[AMB_STATES];
  amb_real rest[AMB_STATES];
  (void)amb_envelope_clamp(kf, mean);
  amb_rest_where_shown(model, r, shown);
  for (int i = 0; i < n; i++) {
    const bool position = amb_model_role(model, i) == AMB_POSITION;
    seen[i] = position && (amb_magnitude(shown[i]) > AMB_C(0.0));
    rest[i] = position ? mean[i] : AMB_C(0.0);
  }
  amb_rest_add_followers(model, seen);
  amb_model_equilibrium(model, rest);
  const amb_real off = y - amb_model_shown(model, r, rest);
  for (int i = 0; i < n; i++) {
    const amb_real at = rest[i] + shown[i] * off;
    mean[i] = seen[i] ? amb_clamp(at, -kf->set.cap[i], kf->set.cap[i]) : mean[i];
  }
}
#endif

void amb_envelope_place(const amb_kalman *kf, int r, amb_real y, amb_real mean[AMB_STATES])
{
#if AMB_SENSORS > 1
  if (amb_sensors(&kf->model) > 1) {
    place_nearest(kf, r, y, mean);
    return;
  }
#endif
  place_at_reading(kf, r, y, mean);
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

/* Row `s` of P, a reading in equilibrium, from the rows of the positions; its variance is one
 * percent larger, for definiteness. */
static void set_reading(const amb_model *model, int s, amb_real P[AMB_TRIANGLE])
{
  const int n = amb_states(model);
  amb_real one[AMB_STATES];
  for (int j = 0; j < n; j++) {
    if (j != s) {
      P[amb_place(n, s, j)] = AMB_C(0.0);
    }
  }
  amb_real variance = AMB_C(0.0);
  for (int i = 0; i < n; i++) {
    if (amb_model_role(model, i) == AMB_POSITION) {
      amb_rest_off_by_one(model, i, one);
      for (int j = 0; j < n; j++) {
        if (j != s) {
          P[amb_place(n, s, j)] += one[s] * P[amb_place(n, i, j)];
        }
      }
    }
  }
  for (int i = 0; i < n; i++) {
    if (amb_model_role(model, i) == AMB_POSITION) {
      amb_rest_off_by_one(model, i, one);
      variance += one[s] * P[amb_place(n, s, i)];
    }
  }
  P[amb_entry(n, s, s)] = variance * AMB_C(1.01);
}

/* Resets the lost states: positions uniform between the stops, the others with these variances,
 * readings consistent with the positions. The other states keep their covariance. */
static void reset_lost(const amb_kalman *kf, const bool lost[AMB_STATES],
                       const amb_real variance[AMB_STATES], amb_real P[AMB_TRIANGLE])
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  for (int i = 0; i < n; i++) {
    const amb_real most = (amb_model_role(model, i) == AMB_POSITION) ? kf->widest[i] : variance[i];
    for (int j = i; j < n; j++) {
      if (lost[i] || lost[j]) {
        P[amb_entry(n, i, j)] = (i == j) ? most : AMB_C(0.0);
      }
    }
  }
  for (int i = 0; i < n; i++) {
    if (lost[i] && (amb_model_role(model, i) == AMB_SHOWN)) {
      set_reading(model, i, P);
    }
  }
}

void amb_envelope_open(const amb_kalman *kf, amb_real P[AMB_TRIANGLE])
{
  bool each[AMB_STATES];
  for (int i = 0; i < amb_states(&kf->model); i++) {
    each[i] = true;
  }
  reset_lost(kf, each, kf->widest, P);
}

bool amb_envelope_lost(const amb_kalman *kf, const amb_real P[AMB_TRIANGLE], bool lost[AMB_STATES])
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  bool some = false;
  for (int i = 0; i < n; i++) {
    lost[i] = !(P[amb_entry(n, i, i)] <= kf->widest[i]);
    some = some || ((amb_model_role(model, i) == AMB_POSITION) && !lost[i]);
  }
  amb_rest_add_followers(model, lost);
  return some;
}

/* Means of lost states: at rest at the centre, given the others. */
static void rest_at_centre(const amb_kalman *kf, const bool lost[AMB_STATES],
                           amb_real mean[AMB_STATES])
{
  const amb_model *model = &kf->model;
  amb_real rest[AMB_STATES];
  for (int i = 0; i < amb_states(model); i++) {
    const amb_role role = amb_model_role(model, i);
    const bool moves = (role == AMB_POSITION) || (role == AMB_VELOCITY);
    mean[i] = (moves && lost[i]) ? AMB_C(0.0) : amb_clamp(mean[i], -kf->set.cap[i], kf->set.cap[i]);
    rest[i] = mean[i];
  }
  amb_model_equilibrium(model, rest);
  for (int i = 0; i < amb_states(model); i++) {
    const bool shows = lost[i] && (amb_model_role(model, i) == AMB_SHOWN);
    mean[i] = shows ? rest[i] : mean[i];
  }
}

amb_status amb_envelope_hold(const amb_kalman *kf, amb_kalman_state *state)
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  bool sound = amb_envelope_within(kf, AMB_ASTRAY, state->mean);
  bool lost[AMB_STATES];
  amb_real share = AMB_C(1.0); /* factor that brings the position variances back between the stops
                                */
  amb_real variance[AMB_STATES];
  (void)amb_envelope_lost(kf, state->cov, lost);
  for (int i = 0; i < n; i++) {
    const amb_role role = amb_model_role(model, i);
    variance[i] = state->cov[amb_entry(n, i, i)];
    sound = sound && ((role == AMB_SHOWN) || amb_is_finite(variance[i]));
    if ((role == AMB_POSITION) && (variance[i] > kf->widest[i])) {
      share = amb_at_most(kf->widest[i] / variance[i], share);
    }
  }
  for (int i = 0; i < n; i++) {
    if (amb_model_role(model, i) == AMB_VELOCITY) {
      variance[i] *= share;
    }
    variance[i] = amb_at_most(variance[i], kf->widest[i]);
  }
  for (int r = 0; r < amb_sensors(model); r++) {
    if (amb_rest_sees(model, r, lost)) {
      state->sensor[r].residual = AMB_C(0.0);
    }
  }
  if (sound) {
    rest_at_centre(kf, lost, state->mean);
    reset_lost(kf, lost, variance, state->cov);
  } else {
    amb_clear(n, state->mean);
    amb_envelope_open(kf, state->cov);
  }
  return sound ? AMB_HELD : (AMB_HELD | AMB_RESTARTED);
}

/* One sensor: the rotor is at its reading. */
static void restart_one_sensor(const amb_kalman *kf, amb_kalman_state *state, int r, amb_real y)
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  const amb_real lag = kf->set.T + kf->set.lag[r];
  amb_real variance[AMB_STATES];
  amb_real shown[AMB_STATES];
  amb_real fastest = AMB_C(0.0); /* largest variance of a velocity */
  for (int i = 0; i < n; i++) {
    const amb_role role = amb_model_role(model, i);
    variance[i] = state->cov[amb_entry(n, i, i)];
    if (role != AMB_KNOWN) {
      variance[i] = amb_at_most((LESS_SURE * LESS_SURE) * variance[i], kf->widest[i]);
    }
    if ((role == AMB_VELOCITY) && (variance[i] > fastest)) {
      fastest = variance[i];
    }
  }
  amb_rest_where_shown(model, r, shown);
  amb_clear(amb_entry(n, n - 1, n), state->cov);
  for (int i = 0; i < n; i++) {
    const amb_role role = amb_model_role(model, i);
    if (role == AMB_POSITION) { /* it moves at this speed during the sensor's lag */
      variance[i] = amb_at_most(variance[i] + (lag * lag) * fastest, kf->widest[i]);
    }
    if (role != AMB_SHOWN) {
      state->cov[amb_entry(n, i, i)] = variance[i];
    }
  }
  add_square(n, kf->set.var_y[r] + kf->rounding[r], shown, state->cov);
  amb_envelope_place(kf, r, y, state->mean);
  state->sensor[r].residual = AMB_C(0.0);
}

#if AMB_SENSORS > 1
/* Update with y of sensor r, of this variance or more; half of the digits must remain, as in
 * amb_step_update. */
static void update_with(const amb_kalman *kf, amb_kalman_state *state, int r, amb_real y,
                        amb_real variance)
{
  amb_real e;
  const amb_real shown = amb_model_shown_variance(&kf->model, r, state->cov);
  const amb_real least = AMB_ROOT_EPSILON * shown;
  const amb_real own = kf->set.var_y[r] + kf->rounding[r];
  const amb_real var_y = amb_at_least(least, amb_at_least(variance, own));
  amb_model_update(&kf->model, r, y, shown + var_y, state->mean, state->cov, &e);
}

/* Repeats the estimated reading of sensor r as a measurement, until its variance is again `was`. */
static void repeat_reading(const amb_kalman *kf, amb_kalman_state *state, int r, amb_real was)
{
  const amb_real now = amb_model_shown_variance(&kf->model, r, state->cov);
  if (now > was) {
    const amb_real y = amb_model_shown(&kf->model, r, state->mean);
    update_with(kf, state, r, y, now * (was / (now - was)));
  }
}

/* Several sensors: states correlated with this one become less certain, are corrected by the
 * readings of the other sensors, and then by this one. */
static void restart_several(const amb_kalman *kf, amb_kalman_state *state, int r, amb_real y)
{
  const amb_model *model = &kf->model;
  const int n = amb_states(model);
  amb_real less[AMB_STATES];
  amb_real with_y[AMB_STATES];
  amb_real was[AMB_SENSORS];
  amb_model_shown_with(model, r, state->cov, with_y);
  for (int other = 0; other < amb_sensors(model); other++) {
    was[other] = amb_model_shown_variance(model, other, state->cov);
  }
  for (int i = 0; i < n; i++) {
    const amb_real variance = (LESS_SURE * LESS_SURE) * state->cov[amb_entry(n, i, i)];
    const bool room = (variance <= kf->widest[i]) && (amb_magnitude(with_y[i]) > AMB_C(0.0));
    less[i] = room ? LESS_SURE : AMB_C(1.0);
  }
  for (int i = 0; i < n; i++) {
    for (int j = i; j < n; j++) {
      state->cov[amb_entry(n, i, j)] *= less[i] * less[j];
    }
  }
  for (int other = 0; other < amb_sensors(model); other++) {
    if ((other != r) && (state->sensor[other].outliers == 0U)) {
      repeat_reading(kf, state, other, was[other]);
    }
  }
  update_with(kf, state, r, y, kf->set.var_y[r]);
  (void)amb_envelope_clamp(kf, state->mean); /* the variances are too small to correct a mean beyond
                                                the caps */
  state->sensor[r].residual = AMB_C(0.0);
}
#endif

void amb_envelope_restart(const amb_kalman *kf, amb_kalman_state *state, int r, amb_real y)
{
#if AMB_SENSORS > 1
  if (amb_sensors(&kf->model) > 1) {
    restart_several(kf, state, r, y);
    return;
  }
#endif
  restart_one_sensor(kf, state, r, y);
}
