/* The steps of the family for several filters side by side: what kalman_step.h, estimator.c,
 * observer.c and low_pass.c do when nothing is out of the ordinary, and a mask of the lanes in
 * which nothing was. Only these may be believed.
 */
#ifndef AMBKIT_SIM_LANES_STEP_H
#define AMBKIT_SIM_LANES_STEP_H

#include "lanes.h"

/* Parameters and states as the core's structs, a vector for each number. */
typedef struct lanes_parameters {
  lanes_axial_model model;
  lanes k_ui, f_0, iu_min, iu_max, x_max, var_u, var_y, far_squared, gate_squared, widest;
  lanes growth[AMB_AXIAL_TRIANGLE];
  lanes k_i, k_s; /* of a constant magnet */
  lanes_law law;
  lanes gain[AMB_AXIAL_STATES], far[AMB_AXIAL_STATES], variance; /* of an observer */
  lanes m, K_sen, position, velocity, force;                     /* of low-pass filters */
} lanes_parameters;

typedef struct lanes_state {
  lanes mean[AMB_AXIAL_STATES];
  lanes cov[AMB_AXIAL_TRIANGLE];
  lanes last_u, last_y, residual, surprise;
  lanes force; /* of low-pass filters */
} lanes_state;

typedef struct lanes_result {
  lanes innovation, variance;
} lanes_result;

/* What kinds there are in lanes. */
typedef enum lanes_kind { LANES_KALMAN, LANES_EXTENDED, LANES_OBSERVER, LANES_LOW_PASS } lanes_kind;
typedef enum lanes_magnet { LANES_CONSTANT, LANES_LAW, LANES_EACH } lanes_magnet;

/* What a step is made of. */
typedef struct lanes_of {
  lanes_kind kind;
  lanes_magnet magnet;
  const amb_magnet *each; /* [LANES], for those that are asked lane by lane */
} lanes_of;

/* As magnet.c has it, for two sides. */
AMB_INLINE void lanes_law_through_origin(const lanes_law *law, lanes iu, lanes x, lanes *k_i,
                                         lanes *k_s)
{
  lanes_law_tangent(law, lanes_all_equal(AMB_C(1.0)), iu, x, k_i, k_s);
  lanes turned_i = *k_i;
  lanes turned_s = *k_s;
  const lanes square = lanes_turn_square(law->ampere, law->metre, iu, x);
  const lanes_mask away = square >= AMB_REAL_MIN;
  lanes_turn(law->ampere, law->metre, lanes_law_force(law, iu, x), square, iu, x, &turned_i,
             &turned_s);
  *k_i = lanes_choose(away, turned_i, *k_i);
  *k_s = lanes_choose(away, turned_s, *k_s);
}

/* Stiffnesses in the through-origin form, between the stops; amb_step_ask. */
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
  *k_i = near; /* something, before the lanes are set one by one */
  *k_s = near;
  for (size_t i = 0; i < LANES; i++) {
    const amb_stiffness k = of.each[i].methods->through_origin(of.each[i].self, iu[i], near[i]);
    (*k_i)[i] = k.k_i;
    (*k_s)[i] = k.k_s;
  }
}

/* Force of the magnet and its tangents, continued beyond the stops; amb_step_force. */
AMB_INLINE lanes lanes_force(const lanes_parameters *p, lanes_of of, lanes iu, lanes x, lanes *k_i,
                             lanes *k_s)
{
  const lanes near = lanes_clamp(x, -p->x_max, p->x_max);
  lanes f = near; /* something, before the lanes are set one by one */
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

/* A measurement within reach that moves. */
AMB_INLINE lanes_mask lanes_measured(const lanes_parameters *p, lanes_state *s, lanes y)
{
  const lanes_mask usual = ((y * y) <= p->far_squared) & (y != s->last_y);
  s->last_y = y;
  return usual;
}

/* The innovation e of variance S is expected; counts the larger ones. */
AMB_INLINE lanes_mask lanes_expected(const lanes_parameters *p, lanes_state *s, lanes e, lanes S)
{
  const lanes_mask beyond = (e * e) > (AMB_C(4.0) * S);
  s->surprise = s->surprise * (AMB_C(1.0) - AMB_C(1.0) / AMB_MEMORY) +
                lanes_where(beyond, lanes_all_equal(AMB_C(1.0) / AMB_MEMORY));
  return ~((e * e) > (p->gate_squared * S));
}

AMB_INLINE lanes_mask lanes_step_kalman(const lanes_parameters *p, lanes_of of, lanes_state *s,
                                        lanes iu, lanes y, lanes_result *r)
{
  lanes k_i;
  lanes k_s;
  lanes f;
  const lanes at = lanes_axial_displacement(&p->model, s->mean);
  if (of.kind == LANES_EXTENDED) {
    f = lanes_force(p, of, iu, at, &k_i, &k_s) + p->f_0;
  } else {
    lanes_ask(p, of, iu, at, &k_i, &k_s);
    f = k_i * iu + k_s * at + p->f_0;
  }
  lanes_mask usual = (f * f) <= AMB_REAL_MAX;
  lanes_axial_predict_mean(&p->model, f, s->mean);
  lanes_axial_predict_covariance(&p->model, k_i, k_s, p->k_ui, p->var_u, p->growth, s->cov);

  const lanes *P = s->cov;
  usual &= P[0] <= p->widest;
  usual &= lanes_measured(p, s, y) & (P[9] > AMB_C(0.0)) & ((AMB_ROOT_EPSILON * P[9]) <= p->var_y);
  usual &= lanes_expected(p, s, y - s->mean[3], P[9] + p->var_y);
  lanes_axial_update(y, p->var_y, s->mean, s->cov, &r->innovation, &r->variance);
  s->residual = y - s->mean[3];
  return usual & (P[0] > AMB_C(0.0)) & (P[4] > AMB_C(0.0)) & (P[7] > AMB_C(0.0));
}

AMB_INLINE lanes_mask lanes_step_observer(const lanes_parameters *p, lanes_of of, lanes_state *s,
                                          lanes iu, lanes y, lanes_result *r)
{
  lanes k_i;
  lanes k_s;
  const lanes at = lanes_axial_displacement(&p->model, s->mean);
  lanes_ask(p, of, iu, at, &k_i, &k_s);
  /* The scale of the magnet is 1 here, and a product with 1 changes nothing. */
  const lanes f = (k_i * iu + k_s * at) + p->f_0;
  lanes_axial_predict_mean(&p->model, f, s->mean);
  const lanes e = y - s->mean[3];
  lanes_mask usual = lanes_measured(p, s, y) & lanes_expected(p, s, e, p->variance);
  for (int i = 0; i < AMB_AXIAL_STATES; i++) {
    s->mean[i] += p->gain[i] * e;
    usual &= (s->mean[i] <= p->far[i]) & (s->mean[i] >= -p->far[i]);
  }
  s->residual = y - s->mean[3];
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
  lanes_ask(p, of, iu, mean[0], &k_i, &k_s);
  s->force = k_i * iu + k_s * mean[0] + p->f_0;
  const lanes T = p->model.T;
  r->innovation = y - mean[3];
  r->variance = lanes_all_equal(AMB_C(0.0));
  const lanes dx = p->position * (y / p->K_sen - mean[0]);
  const lanes dv = p->velocity * (dx / T - mean[1]);
  const lanes f_d = p->m * (dv / T) - s->force;
  mean[0] += dx;
  mean[1] += dv;
  mean[2] += p->force * (f_d - mean[2]);
  mean[3] = p->K_sen * mean[0];
  return lanes_measured(p, s, y);
}

/* One sample on with the control signal u [V] that acted, then measurement y [m]. */
AMB_INLINE lanes_mask lanes_step(const lanes_parameters *p, lanes_of of, lanes_state *s, lanes y,
                                 lanes u, lanes_result *r)
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
  return usual & lanes_step_kalman(p, of, s, iu, y, r);
}

#endif
