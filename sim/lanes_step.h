/* The steps of the estimators for several filters side by side, for the usual case of
 * kalman_step.h, estimator.c, observer.c and low_pass.c; with a mask of the lanes in which nothing
 * unusual occurred. The results of the other lanes are invalid. */
#ifndef AMBKIT_SIM_LANES_STEP_H
#define AMBKIT_SIM_LANES_STEP_H

#include "lanes.h"

/* As amb_low_pass. */
typedef struct lanes_low_pass {
  lanes m, position, velocity, force;
} lanes_low_pass;

/* Parameters and states as in the core's structs, a vector for each number. */
typedef struct lanes_parameters {
  lanes_model model;
  lanes k_ui, f_0, iu_min, iu_max, x_max, var_u, var_y, rounding, rise, reach, gate_squared;
  lanes fine;   /* 1 if the quantisation step is below the noise, else 0 */
  lanes widest; /* of the position */
  lanes growth[AMB_TRIANGLE];
  lanes k_i, k_s; /* of a constant magnet */
  lanes_law law;
  lanes gain[AMB_STATES], far[AMB_STATES], variance; /* of an observer */
  lanes K_sen;
  lanes_low_pass low_pass;
} lanes_parameters;

typedef struct lanes_state {
  lanes mean[AMB_STATES];
  lanes cov[AMB_TRIANGLE];
  lanes last_u, last_y, residual, surprise, least_change;
  lanes force; /* of low-pass filters */
} lanes_state;

typedef struct lanes_result {
  lanes innovation, variance;
} lanes_result;

/* Kinds available in lanes, numbered as by amb_batch_group. */
typedef enum lanes_kind { LANES_KALMAN, LANES_EXTENDED, LANES_OBSERVER, LANES_LOW_PASS } lanes_kind;
typedef enum lanes_magnet { LANES_CONSTANT, LANES_LAW, LANES_EACH } lanes_magnet;

/* Parts of a step. */
typedef struct lanes_of {
  lanes_kind kind;
  lanes_magnet magnet;
  const amb_magnet *each; /* [LANES], for magnets that are evaluated lane by lane */
} lanes_of;

/* As in magnet.c, for two sides. */
AMB_INLINE void lanes_law_through_origin(const lanes_law *law, lanes iu, lanes x, lanes *k_i,
                                         lanes *k_s)
{
  lanes_law_tangent(law, lanes_all_equal(AMB_C(1.0)), iu, x, k_i, k_s);
  lanes turned_i = *k_i;
  lanes turned_s = *k_s;
  const lanes square = lanes_turn_square(law->ampere, law->metre, iu, x);
  const lanes_mask away = square >= AMB_TURN_LEAST;
  lanes_turn(law->ampere, law->metre, lanes_law_force(law, iu, x), square, iu, x, &turned_i,
             &turned_s);
  *k_i = lanes_choose(away, turned_i, *k_i);
  *k_s = lanes_choose(away, turned_s, *k_s);
}

/* Stiffnesses in the through-origin form, between the stops; amb_step_stiffness. */
AMB_INLINE void lanes_ask(const lanes_parameters *p, lanes_of of, lanes iu, lanes x, lanes *k_i,
                          lanes *k_s)
{
  if (of.magnet == LANES_CONSTANT) {
    *k_i = p->k_i;
    *k_s = p->k_s;
    return;
  }
  const lanes near = lanes_clamp(x, -p->x_max, p->x_max);
  if (of.magnet == LANES_LAW) {
    lanes_law_through_origin(&p->law, iu, near, k_i, k_s);
    return;
  }
  *k_i = near; /* initialised before the lanes are set one by one */
  *k_s = near;
  for (size_t i = 0; i < LANES; i++) {
    const amb_stiffness k = of.each[i].methods->through_origin(of.each[i].self, iu[i], near[i]);
    (*k_i)[i] = k.k_i;
    (*k_s)[i] = k.k_s;
  }
}

/* Force of the magnet and its tangents, extrapolated beyond the stops; amb_step_force. */
AMB_INLINE lanes lanes_force(const lanes_parameters *p, lanes_of of, lanes iu, lanes x, lanes *k_i,
                             lanes *k_s)
{
  const lanes near = lanes_clamp(x, -p->x_max, p->x_max);
  lanes f = near; /* initialised before the lanes are set one by one */
  *k_i = near;
  *k_s = near;
  if (of.magnet == LANES_CONSTANT) {
    *k_i = p->k_i;
    *k_s = p->k_s;
    f = p->k_i * iu + p->k_s * near;
  } else if (of.magnet == LANES_LAW) {
    lanes_law_tangent(&p->law, lanes_all_equal(AMB_C(1.0)), iu, near, k_i, k_s);
    f = lanes_law_force(&p->law, iu, near);
  } else {
    for (size_t i = 0; i < LANES; i++) {
      const amb_magnet *magnet = &of.each[i];
      const amb_stiffness k = magnet->methods->tangent(magnet->self, iu[i], near[i]);
      f[i] = magnet->methods->force(magnet->self, iu[i], near[i]);
      (*k_i)[i] = k.k_i;
      (*k_s)[i] = k.k_s;
    }
  }
  return f + *k_s * (x - near);
}

/* Whether a measurement is a possible position. */
AMB_INLINE lanes_mask lanes_possible(const lanes_parameters *p, lanes y)
{
  return (y <= p->reach) & (y >= -p->reach);
}

/* Whether it also differs from the last one. */
AMB_INLINE lanes_mask lanes_measured(const lanes_parameters *p, lanes_state *s, lanes y)
{
  const lanes_mask usual = lanes_possible(p, y) & (y != s->last_y) & (p->fine > AMB_C(0.0));
  const lanes change = y - s->last_y;
  const lanes square = change * change;
  const lanes grown = s->least_change * (AMB_C(1.0) + AMB_C(2.0) / AMB_MEMORY);
  const lanes finest = AMB_FINEST * p->var_y;
  const lanes smaller = lanes_choose(square < grown, square, grown);
  s->least_change = lanes_choose(smaller > finest, smaller, finest);
  s->last_y = y;
  return usual;
}

/* Whether the innovation e of variance S is expected; counts larger ones. */
AMB_INLINE lanes_mask lanes_expected(const lanes_parameters *p, lanes_state *s, lanes e, lanes S)
{
  const lanes_mask beyond = (e * e) > (AMB_C(4.0) * S);
  s->surprise = s->surprise * (AMB_C(1.0) - AMB_C(1.0) / AMB_MEMORY) +
                lanes_where(beyond, lanes_all_equal(AMB_C(1.0) / AMB_MEMORY));
  return ~((e * e) > (p->gate_squared * S));
}

AMB_INLINE lanes_mask lanes_step_kalman(const lanes_parameters *p, lanes_of of, lanes_state *s,
                                        lanes iu, lanes y, bool missing, lanes_result *r)
{
  lanes k_i;
  lanes k_s;
  lanes f;
  const lanes at = lanes_model_displacement(&p->model, 0, s->mean);
  if (of.kind == LANES_EXTENDED) {
    f = lanes_force(p, of, iu, at, &k_i, &k_s) + p->f_0;
  } else {
    lanes_ask(p, of, iu, at, &k_i, &k_s);
    f = k_i * iu + k_s * at + p->f_0;
  }
  lanes_mask usual = (f <= AMB_REAL_ROOT) & (f >= -AMB_REAL_ROOT);
  const lanes_stiffness k = {k_i, k_s};
  lanes_model_predict_mean(&p->model, &f, &iu, s->mean);
  lanes_model_predict_covariance(&p->model, &k, &p->k_ui, &p->var_u, p->growth, s->cov, NULL);

  const lanes shown = lanes_model_shown_variance(&p->model, 0, s->cov);
  lanes variances[AMB_STATES];
  lanes_model_variances(&p->model, s->cov, variances);
  usual &= variances[AMB_FIRST_POSITION] <= p->widest;
  const lanes there = lanes_model_shown(&p->model, 0, s->mean);
  const lanes share = lanes_clamp(AMB_C(1.0) + p->rise * there, lanes_all_equal(AMB_C(0.125)),
                                  lanes_all_equal(AMB_C(8.0)));
  const lanes noise = (p->var_y * share) * share + p->rounding;
  r->variance = shown + noise;
  if (missing) {
    r->innovation = lanes_all_equal(AMB_C(0.0));
    return usual;
  }
  usual &= lanes_measured(p, s, y) & (shown > AMB_C(0.0));
  usual &= (AMB_ROOT_EPSILON * shown) <= noise;
  usual &= lanes_expected(p, s, y - there, r->variance);
  lanes_model_update(&p->model, 0, y, r->variance, s->mean, s->cov, &r->innovation);
  s->residual = y - lanes_model_shown(&p->model, 0, s->mean);
  lanes_model_variances(&p->model, s->cov, variances);
  for (int i = 0; i < AMB_STATES; i++) {
    usual &= variances[i] >= AMB_C(0.0);
  }
  return usual;
}

AMB_INLINE lanes_mask lanes_step_observer(const lanes_parameters *p, lanes_of of, lanes_state *s,
                                          lanes iu, lanes y, lanes_result *r)
{
  lanes k_i;
  lanes k_s;
  const lanes at = lanes_model_displacement(&p->model, 0, s->mean);
  lanes_ask(p, of, iu, at, &k_i, &k_s);
  /* The scale of the magnet is 1 here, and multiplication by 1 changes nothing. */
  const lanes f = (k_i * iu + k_s * at) + p->f_0;
  lanes_model_predict_mean(&p->model, &f, &iu, s->mean);
  const lanes e = y - lanes_model_shown(&p->model, 0, s->mean);
  lanes_mask usual = lanes_measured(p, s, y) & lanes_expected(p, s, e, p->variance);
  for (int i = 0; i < AMB_STATES; i++) {
    s->mean[i] += p->gain[i] * e;
    usual &= (s->mean[i] <= p->far[i]) & (s->mean[i] >= -p->far[i]);
  }
  s->residual = y - lanes_model_shown(&p->model, 0, s->mean);
  r->innovation = e;
  r->variance = p->variance;
  return usual;
}

AMB_INLINE lanes_mask lanes_step_low_pass(const lanes_parameters *p, lanes_of of, lanes_state *s,
                                          lanes iu, lanes y, lanes_result *r)
{
  lanes k_i;
  lanes k_s;
  lanes *mean = s->mean;
  lanes_ask(p, of, iu, mean[AMB_FIRST_POSITION], &k_i, &k_s);
  s->force = k_i * iu + k_s * mean[AMB_FIRST_POSITION] + p->f_0;
  const lanes T = p->model.T;
  r->innovation = y - lanes_model_shown(&p->model, 0, mean);
  r->variance = lanes_all_equal(AMB_C(0.0));
  const lanes dx = p->low_pass.position * (y / p->K_sen - mean[AMB_FIRST_POSITION]);
  const lanes dv = p->low_pass.velocity * (dx / T - mean[AMB_FIRST_VELOCITY]);
  const lanes f_d = p->low_pass.m * (dv / T) - s->force;
  mean[AMB_FIRST_POSITION] += dx;
  mean[AMB_FIRST_VELOCITY] += dv;
  mean[AMB_FIRST_LOAD] += p->low_pass.force * (f_d - mean[AMB_FIRST_LOAD]);
  lanes_model_equilibrium(&p->model, mean);
  return lanes_measured(p, s, y);
}

/* Whether the measurements y [m] of all lanes are missing, for a kind that continues without them.
 * */
AMB_INLINE bool lanes_missing(const lanes_parameters *p, lanes_of of, lanes y)
{
  return (of.kind <= LANES_EXTENDED) && !lanes_any(lanes_possible(p, y));
}

/* One sample with the control signal u [V] that acted, then the measurement y [m] or `missing`. */
AMB_INLINE lanes_mask lanes_step(const lanes_parameters *p, lanes_of of, lanes_state *s, lanes y,
                                 lanes u, bool missing, lanes_result *r)
{
  const lanes iu = p->k_ui * u;
  const lanes_mask usual = (iu >= p->iu_min) & (iu <= p->iu_max);
  s->last_u = u;
  if (of.kind == LANES_OBSERVER) {
    return usual & lanes_step_observer(p, of, s, iu, y, r);
  }
  if (of.kind == LANES_LOW_PASS) {
    return usual & lanes_step_low_pass(p, of, s, iu, y, r);
  }
  return usual & lanes_step_kalman(p, of, s, iu, y, missing, r);
}

#endif
