/* A team of filters side by side: conversion between the core's structs and lanes, and one sample.
 *
 * A step computes the usual case for all lanes at once, including a measurement that all lanes
 * lack. Lanes with an unusual event (a measurement missing in some lanes, frozen or an outlier, a
 * current at its limit, an invalid variance) repeat their step from its start by the core's
 * function. Rare events cost nothing where they do not occur, and each lane has the bits of a
 * single run.
 */
#ifndef AMBKIT_SIM_LANES_TEAM_H
#define AMBKIT_SIM_LANES_TEAM_H

#include "ambkit/low_pass.h"
#include "ambkit/observer.h"
#include "lanes_step.h"
#include <string.h>

#define BLOCK AMB_BATCH_BLOCK

/* Inputs and outputs of each sample, a vector for each number. */
typedef struct block {
  lanes y[BLOCK];
  lanes u[BLOCK]; /* since the previous sample */
  lanes mean[BLOCK][AMB_STATES];
  lanes_result result[BLOCK];
  unsigned short status[BLOCK][LANES];
  bool nonzero; /* some of these are not 0 */
} block;

typedef struct team {
  lanes_parameters p;
  lanes_state s;
  unsigned int unchanged[LANES];
  amb_real chance[LANES];
  unsigned int outliers[LANES];
  bool counting; /* some of these are not 0 */
  block b;
  amb_batch_run *runs[LANES]; /* the last one is repeated if there are fewer */
  amb_magnet magnets[LANES];
  size_t count;
  bool judged; /* all have a truth */
} team;

/* The fuzzy network is evaluated lane by lane; it computes its rules side by side, with these
 * instructions. */
static amb_magnet magnet_in_lanes(const amb_magnet *magnet)
{
  amb_magnet own = *magnet;
#if AMB_LANES_BYTES > 16
  if (own.methods == &amb_fuzzy_magnet)
    own.methods = &AMB_LANES_NAME(amb_fuzzy_magnet);
#endif
  return own;
}

/* ---- From the core's structs into lanes, and back. ---- */

/* Lane i of as many vectors as there are numbers in `size` bytes: an array, or a struct of numbers.
 * */
static void fill(lanes to[], size_t i, const amb_real from[], size_t size)
{
  for (size_t j = 0; j < size / sizeof *from; j++)
    to[j][i] = from[j];
}

/* The inverse. */
static void lane(const lanes from[], size_t i, amb_real to[], size_t size)
{
  for (size_t j = 0; j < size / sizeof *to; j++)
    to[j] = from[j][i];
}

static void fill_parameters(lanes_parameters *p, size_t i, const amb_estimator *e)
{
  const amb_kalman *kf = e->kf;
  fill((lanes *)&p->model, i, (const amb_real *)&kf->model, sizeof kf->model);
  p->k_ui[i] = kf->set.k_ui[0];
  p->f_0[i] = kf->set.f_0[0];
  p->iu_min[i] = kf->set.iu_min[0];
  p->iu_max[i] = kf->set.iu_max[0];
  p->x_max[i] = kf->set.x_max[0];
  p->var_u[i] = kf->set.var_u[0];
  fill(p->growth, i, kf->growth, sizeof kf->growth);
  p->var_y[i] = kf->set.var_y[0];
  p->rounding[i] = kf->rounding[0];
  p->fine[i] = amb_step_coarse(kf, 0, AMB_COARSE) ? AMB_C(0.0) : AMB_C(1.0);
  p->rise[i] = kf->set.rise[0];
  p->reach[i] = kf->far[0];
  p->gate_squared[i] = kf->gate_squared;
  p->widest[i] = kf->widest[AMB_FIRST_POSITION];
  p->K_sen[i] = kf->set.K_sen[0];
  if (e->magnet->methods == &amb_constant_magnet) {
    const amb_stiffness *k = (const amb_stiffness *)e->magnet->self;
    p->k_i[i] = k->k_i;
    p->k_s[i] = k->k_s;
  } else if (e->magnet->methods == &amb_law_magnet) {
    const amb_law *law = (const amb_law *)e->magnet->self;
    fill((lanes *)&p->law, i, &law->k, 3 * sizeof law->k);
    p->law.ampere[i] = law->ampere;
    p->law.metre[i] = law->metre;
  }
  if (e->methods == &amb_observer_methods) {
    const amb_observer *own = (const amb_observer *)e->own;
    fill(p->gain, i, own->gain[0], sizeof own->gain[0]);
    fill(p->far, i, own->far, sizeof own->far);
    p->variance[i] = own->variance[0];
  } else if (e->methods == &amb_low_pass_methods) {
    const amb_low_pass *own = (const amb_low_pass *)e->own;
    fill((lanes *)&p->low_pass, i, (const amb_real *)own, sizeof *own);
  }
}

static void put(team *t, lanes_state *s, size_t i)
{
  const amb_kalman_state *from = (const amb_kalman_state *)t->runs[i]->state;
  fill(s->mean, i, from->mean, sizeof from->mean);
  fill(s->cov, i, from->cov, sizeof from->cov);
  const amb_sensor_state *sensor = &from->sensor[0];
  s->last_u[i] = from->last_u[0];
  s->last_y[i] = sensor->last_y;
  s->residual[i] = sensor->residual;
  s->surprise[i] = sensor->surprise;
  s->least_change[i] = sensor->least_change;
  t->unchanged[i] = sensor->unchanged;
  t->chance[i] = sensor->chance;
  t->outliers[i] = sensor->outliers;
  t->counting = t->counting || (sensor->unchanged > 0U) || (sensor->outliers > 0U);
  if (t->runs[i]->estimator->methods == &amb_low_pass_methods)
    s->force[i] = ((const amb_low_pass_state *)t->runs[i]->state)->force;
}

static void get(const team *t, const lanes_state *s, size_t i)
{
  amb_kalman_state *to = (amb_kalman_state *)t->runs[i]->state;
  lane(s->mean, i, to->mean, sizeof to->mean);
  lane(s->cov, i, to->cov, sizeof to->cov);
  amb_sensor_state *sensor = &to->sensor[0];
  to->last_u[0] = s->last_u[i];
  sensor->last_y = s->last_y[i];
  sensor->residual = s->residual[i];
  sensor->surprise = s->surprise[i];
  sensor->least_change = s->least_change[i];
  sensor->unchanged = t->unchanged[i];
  sensor->chance = t->chance[i];
  sensor->outliers = t->outliers[i];
  if (t->runs[i]->estimator->methods == &amb_low_pass_methods)
    ((amb_low_pass_state *)t->runs[i]->state)->force = s->force[i];
}

/* ---- Steps. ---- */

static void tell(team *t, size_t b, size_t i, amb_status status)
{
  if ((i < t->count) && (status != AMB_OK)) {
    t->runs[i]->all |= status;
    t->b.status[b][i] = (unsigned short)status;
    t->b.nonzero = true;
  }
}

/* Repeats the unusual lanes one by one, and stores their flags. */
static __attribute__((noinline)) void mend(team *t, size_t b, lanes_mask usual,
                                           lanes_mask inconsistent, const lanes_state *before,
                                           lanes_state *after)
{
  t->counting = false;
  for (size_t i = 0; i < LANES; i++) {
    amb_status status = (inconsistent[i] != 0) ? AMB_INCONSISTENT : AMB_OK;
    if (usual[i] != 0) {
      t->unchanged[i] = 0U;
      t->chance[i] = AMB_C(1.0);
      t->outliers[i] = 0U;
    } else {
      if (i < t->count) { /* the other lanes repeat the last run, which has just been corrected */
        amb_kalman_result r;
        get(t, before, i);
        const amb_real y = t->b.y[b][i], u = t->b.u[b][i];
        status = amb_estimator_step(t->runs[i]->estimator, t->runs[i]->state, &y, &u, &r);
        t->b.result[b].innovation[i] = r.innovation[0];
        t->b.result[b].variance[i] = r.variance[0];
      }
      put(t, after, i);
    }
    tell(t, b, i, status);
  }
}

/* Sample b of the block, from the state `s`. Copies name their members, or compilers move the
 * complete struct through memory. */
AMB_INLINE void step_at(team *t, size_t b, lanes_of of, lanes_state *s)
{
  lanes_state next = *s;
  lanes_result r;
  const bool missing = lanes_missing(&t->p, of, t->b.y[b]);
  const lanes_mask usual = lanes_step(&t->p, of, &next, t->b.y[b], t->b.u[b], missing, &r);
  const lanes_mask inconsistent = next.surprise > AMB_INCONSISTENT_SHARE;
  t->b.result[b].innovation = r.innovation;
  t->b.result[b].variance = r.variance;
  if (missing && !lanes_any(~usual)) { /* no counters and no consistency check */
    for (size_t i = 0; i < t->count; i++)
      tell(t, b, i, AMB_MISSING);
  } else if (__builtin_expect(t->counting || lanes_any(~usual | inconsistent), 0)) {
    const lanes_mask none = {0};
    const lanes_state before = *s;
    lanes_state after = next;
    mend(t, b, missing ? none : usual, inconsistent, &before, &after);
    next = after;
  }
  *s = next;
  for (int j = 0; j < AMB_STATES; j++)
    t->b.mean[b][j] = s->mean[j];
}

/* The first sample has only measurement updates, by the core's function. */
static void begin(team *t, lanes_state *s)
{
  for (size_t i = 0; i < t->count; i++) {
    const amb_batch_run *run = t->runs[i];
    const amb_kalman_state *state = (const amb_kalman_state *)run->state;
    const amb_real y = t->b.y[0][i];
    amb_kalman_result r;
    tell(t, 0, i, amb_estimator_step(run->estimator, run->state, &y, NULL, &r));
    t->b.result[0].innovation[i] = r.innovation[0];
    t->b.result[0].variance[i] = r.variance[0];
    for (size_t j = 0; j < AMB_STATES; j++)
      t->b.mean[0][j][i] = state->mean[j];
  }
  for (size_t i = 0; i < LANES; i++)
    put(t, s, i);
}

/* Writes the statuses of a block. */
static void silence(team *t)
{
  if (t->b.nonzero)
    memset(t->b.status, 0, sizeof t->b.status);
  t->b.nonzero = false;
}

/* Configuration of a team, from its first filter; all are alike. */
static lanes_of made_of(const team *t)
{
  const unsigned int group = amb_batch_group(t->runs[0]->estimator) - 1U;
  const lanes_of of = {(lanes_kind)(group / 3U), (lanes_magnet)(group % 3U), t->magnets};
  return of;
}

/* Calls `each` with kind and magnet as constants, so that branches within a step are compiled away.
 * Only some magnets of a kind have a specialised step. */
#define FOR_MADE_OF(of, each)                                                                      \
  do {                                                                                             \
    if ((of).kind == LANES_OBSERVER)                                                               \
      FOR_MAGNET(of, LANES_OBSERVER, LANES_CONSTANT, each);                                        \
    else if ((of).kind == LANES_LOW_PASS)                                                          \
      FOR_MAGNET(of, LANES_LOW_PASS, LANES_CONSTANT, each);                                        \
    else if ((of).kind == LANES_EXTENDED)                                                          \
      FOR_MAGNET(of, LANES_EXTENDED, LANES_LAW, each);                                             \
    else if ((of).magnet == LANES_CONSTANT)                                                        \
      each(LANES_KALMAN, LANES_CONSTANT);                                                          \
    else                                                                                           \
      FOR_MAGNET(of, LANES_KALMAN, LANES_LAW, each);                                               \
  } while (0)
#define FOR_MAGNET(of, kind, own, each)                                                            \
  ((of).magnet == (own)) ? each(kind, own) : each(kind, LANES_EACH)

#endif
