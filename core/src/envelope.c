#include "ambkit/envelope.h"

#define N AMB_AXIAL_STATES

/* Of a variance, at each start from a measurement. */
#define LESS_SURE AMB_C(100.0)

void amb_envelope_caps(const amb_kalman_settings *settings, amb_real cap[N])
{
  const amb_real in_a_sample = AMB_C(0.1) * (settings->x_max / settings->T);
  cap[0] = settings->x_max;
  cap[1] = in_a_sample;
  cap[2] = settings->m * (in_a_sample / settings->T);
  cap[3] = AMB_C(3.0) * amb_magnitude(settings->K_sen) * settings->x_max;
}

bool amb_envelope_within(const amb_kalman *kf, amb_real caps, const amb_real mean[N])
{
  bool within = true;
  for (int i = 0; i < N; i++) {
    within = within && (amb_magnitude(mean[i]) <= (caps * kf->cap[i]));
  }
  return within;
}

bool amb_envelope_clamp(const amb_kalman *kf, amb_real mean[N])
{
  const bool within = amb_envelope_within(kf, AMB_C(1.0), mean);
  for (int i = 0; i < N; i++) {
    mean[i] = amb_clamp(mean[i], -kf->cap[i], kf->cap[i]);
  }
  return !within;
}

void amb_envelope_place(const amb_kalman *kf, amb_real y, amb_real mean[N])
{
  mean[0] = amb_clamp(y / kf->set.K_sen, -kf->set.x_max, kf->set.x_max);
  mean[1] = AMB_C(0.0);
  mean[2] = AMB_C(0.0);
  mean[3] = y;
}

/* The smaller one of a variance and a cap squared; the cap for what is not a number. */
static amb_real at_most(amb_real variance, amb_real cap)
{
  const amb_real most = cap * cap;
  return (variance <= most) ? variance : most;
}

/* P of these variances of x less x_m / K_sen, of v, f_d and x_m. */
static void fill(const amb_kalman *kf, amb_real apart, amb_real v, amb_real f_d, amb_real x_m,
                 amb_real P[AMB_AXIAL_TRIANGLE])
{
  const amb_real K = kf->set.K_sen;
  for (int i = 0; i < AMB_AXIAL_TRIANGLE; i++) {
    P[i] = AMB_C(0.0);
  }
  P[0] = (x_m / K) / K + apart;
  P[3] = x_m / K;
  P[4] = v;
  P[7] = f_d;
  P[9] = x_m;
}

/* Anywhere between the stops, and the sensor shows it to a tenth. */
static void fill_anywhere(const amb_kalman *kf, amb_real v, amb_real f_d,
                          amb_real P[AMB_AXIAL_TRIANGLE])
{
  const amb_real P00 = kf->cap[0] * kf->cap[0];
  const amb_real K = kf->set.K_sen;
  fill(kf, AMB_C(0.0), v, f_d, AMB_C(0.0), P);
  P[0] = P00;
  P[3] = K * P00;
  P[9] = AMB_C(1.01) * (K * (K * P00));
}

void amb_envelope_open(const amb_kalman *kf, amb_real P[AMB_AXIAL_TRIANGLE])
{
  fill_anywhere(kf, kf->cap[1] * kf->cap[1], kf->cap[2] * kf->cap[2], P);
}

amb_status amb_envelope_hold(const amb_kalman *kf, amb_kalman_state *state)
{
  amb_real *P = state->cov;
  const bool sound = amb_is_finite(P[0]) && amb_is_finite(P[4]) && amb_is_finite(P[7]) &&
                     amb_envelope_within(kf, AMB_ASTRAY, state->mean);
  state->mean[0] = AMB_C(0.0);
  state->mean[1] = AMB_C(0.0);
  state->mean[3] = AMB_C(0.0);
  state->residual = AMB_C(0.0);
  if (!sound) {
    state->mean[2] = AMB_C(0.0);
    amb_envelope_open(kf, P);
    return AMB_HELD | AMB_RESTARTED;
  }
  const amb_real with_x = P[4] * (kf->widest / P[0]);
  state->mean[2] = amb_clamp(state->mean[2], -kf->cap[2], kf->cap[2]);
  fill_anywhere(kf, at_most(with_x, kf->cap[1]), at_most(P[7], kf->cap[2]), P);
  return AMB_HELD;
}

void amb_envelope_restart(const amb_kalman *kf, amb_kalman_state *state, amb_real y)
{
  amb_real *P = state->cov;
  const amb_real v = at_most(LESS_SURE * P[4], kf->cap[1]);
  const amb_real f_d = at_most(LESS_SURE * P[7], kf->cap[2]);
  /* At this speed x goes away from what the sensor shows. */
  const amb_real lag = kf->set.T + kf->set.T_sen;
  const amb_real apart = at_most(LESS_SURE * P[0] + (lag * lag) * v, kf->cap[0]);
  fill(kf, apart, v, f_d, kf->set.var_y, P);
  amb_envelope_place(kf, y, state->mean);
  state->residual = AMB_C(0.0);
}
