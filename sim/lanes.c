/* Filters side by side, compiled once for each set of instructions.
 *
 * A step computes what is usual for all lanes at once. Where something is not, a measurement that
 * is missing, frozen or too far, a current at its limit, a variance that is lost, these lanes take
 * their step again from where they stood, by the core's own function. So what is rare costs nothing
 * where it does not happen, and each lane is its own run to the last bit.
 */
#include "lanes_run.h"

#if defined(AMB_HAS_LANES)
#include "ambkit/low_pass.h"
#include "ambkit/observer.h"
#include "generated/axial_fields.h"
#include "lanes_step.h"
#include <string.h>

#define BLOCK AMB_BATCH_BLOCK

/* What goes in and out, sample by sample, a vector for each number. */
typedef struct block {
  lanes y[BLOCK];
  lanes u[BLOCK]; /* that acted since the sample before */
  lanes mean[BLOCK][AMB_STATES];
  lanes_result result[BLOCK];
  unsigned short status[BLOCK][LANES];
  bool told; /* some of these are not 0 */
} block;

typedef struct team {
  lanes_parameters p;
  lanes_state s;
  unsigned int unchanged[LANES];
  unsigned int outliers[LANES];
  bool counting; /* some of these are not 0 */
  block b;
  amb_batch_run *runs[LANES]; /* the last one again where there are fewer */
  amb_magnet magnets[LANES];
  size_t count;
  bool judged; /* all have their truth */
} team;

/* The fuzzy network is asked lane by lane, and computes its rules side by side itself: with these
 * instructions. */
static amb_magnet asked(const amb_magnet *magnet)
{
  amb_magnet own = *magnet;
#if AMB_LANES_BYTES > 16
  if (own.methods == &amb_fuzzy_magnet)
    own.methods = &AMB_LANES_NAME(amb_fuzzy_magnet);
#endif
  return own;
}

/* ---- From the core's structs into lanes, and back. ---- */

static void fill_parameters(lanes_parameters *p, size_t i, const amb_estimator *e)
{
  const amb_kalman *kf = e->kf;
#define FILL(field) p->model.field[i] = kf->model.field
  AMB_MODEL_FIELDS(FILL);
#undef FILL
  p->k_ui[i] = kf->set.k_ui[0];
  p->f_0[i] = kf->set.f_0[0];
  p->iu_min[i] = kf->set.iu_min[0];
  p->iu_max[i] = kf->set.iu_max[0];
  p->x_max[i] = kf->set.x_max[0];
  p->var_u[i] = kf->set.var_u[0];
  for (int j = 0; j < AMB_TRIANGLE; j++)
    p->growth[j][i] = kf->growth[j];
  p->var_y[i] = kf->set.var_y[0];
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
    p->law.k[i] = law->k;
    p->law.s0[i] = law->s0;
    p->law.i0[i] = law->i0;
    p->law.ampere[i] = law->ampere;
    p->law.metre[i] = law->metre;
  }
  if (e->methods == &amb_observer_methods) {
    const amb_observer *own = (const amb_observer *)e->own;
    for (int j = 0; j < AMB_STATES; j++) {
      p->gain[j][i] = own->gain[0][j];
      p->far[j][i] = own->far[j];
    }
    p->variance[i] = own->variance[0];
  } else if (e->methods == &amb_low_pass_methods) {
    const amb_low_pass *own = (const amb_low_pass *)e->own;
    p->m[i] = own->m;
    p->position[i] = own->position;
    p->velocity[i] = own->velocity;
    p->force[i] = own->force;
  }
}

static void put(team *t, lanes_state *s, size_t i)
{
  const amb_kalman_state *from = (const amb_kalman_state *)t->runs[i]->state;
  for (int j = 0; j < AMB_STATES; j++)
    s->mean[j][i] = from->mean[j];
  for (int j = 0; j < AMB_TRIANGLE; j++)
    s->cov[j][i] = from->cov[j];
  const amb_sensor_state *sensor = &from->sensor[0];
  s->last_u[i] = from->last_u[0];
  s->last_y[i] = sensor->last_y;
  s->residual[i] = sensor->residual;
  s->surprise[i] = sensor->surprise;
  t->unchanged[i] = sensor->unchanged;
  t->outliers[i] = sensor->outliers;
  t->counting = t->counting || (sensor->unchanged > 0U) || (sensor->outliers > 0U);
  if (t->runs[i]->estimator->methods == &amb_low_pass_methods)
    s->force[i] = ((const amb_low_pass_state *)t->runs[i]->state)->force;
}

static void get(const team *t, const lanes_state *s, size_t i)
{
  amb_kalman_state *to = (amb_kalman_state *)t->runs[i]->state;
  for (int j = 0; j < AMB_STATES; j++)
    to->mean[j] = s->mean[j][i];
  for (int j = 0; j < AMB_TRIANGLE; j++)
    to->cov[j] = s->cov[j][i];
  amb_sensor_state *sensor = &to->sensor[0];
  to->last_u[0] = s->last_u[i];
  sensor->last_y = s->last_y[i];
  sensor->residual = s->residual[i];
  sensor->surprise = s->surprise[i];
  sensor->unchanged = t->unchanged[i];
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
    t->b.told = true;
  }
}

/* What was not usual, once more, lane by lane; and what there is to say. */
static __attribute__((noinline)) void mend(team *t, size_t b, lanes_mask usual,
                                           lanes_mask surprised, const lanes_state *before,
                                           lanes_state *after)
{
  t->counting = false;
  for (size_t i = 0; i < LANES; i++) {
    amb_status status = (surprised[i] != 0) ? AMB_SURPRISED : AMB_OK;
    if (usual[i] != 0) {
      t->unchanged[i] = 0U;
      t->outliers[i] = 0U;
    } else {
      if (i < t->count) { /* beyond, the lanes repeat the last run, which has just been mended */
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

/* Samples `first` to `count` of the block. What is copied is named, or compilers move the whole
 * through memory. */
AMB_INLINE void steps(team *t, size_t first, size_t count, lanes_kind kind, lanes_magnet magnet)
{
  const lanes_of of = {kind, magnet, t->magnets};
  lanes_state s = t->s;
  for (size_t b = first; b < count; b++) {
    lanes_state next = s;
    lanes_result r;
    const lanes_mask usual = lanes_step(&t->p, of, &next, t->b.y[b], t->b.u[b], &r);
    const lanes_mask surprised = next.surprise > AMB_SURPRISING;
    t->b.result[b].innovation = r.innovation;
    t->b.result[b].variance = r.variance;
    if (__builtin_expect(t->counting || lanes_any(~usual | surprised), 0)) {
      const lanes_state before = s;
      lanes_state after = next;
      mend(t, b, usual, surprised, &before, &after);
      next = after;
    }
    s = next;
    for (int j = 0; j < AMB_STATES; j++)
      t->b.mean[b][j] = s.mean[j];
  }
  t->s = s;
}

static void advance(team *t, size_t first, size_t count)
{
  const amb_estimator *e = t->runs[0]->estimator;
  const bool constant = e->magnet->methods == &amb_constant_magnet;
  const bool law = !constant && (e->magnet->methods == &amb_law_magnet) &&
                   ((const amb_law *)e->magnet->self)->two_sided;
  if (e->methods == &amb_observer_methods) {
    if (constant)
      steps(t, first, count, LANES_OBSERVER, LANES_CONSTANT);
    else
      steps(t, first, count, LANES_OBSERVER, LANES_EACH);
  } else if (e->methods == &amb_low_pass_methods) {
    if (constant)
      steps(t, first, count, LANES_LOW_PASS, LANES_CONSTANT);
    else
      steps(t, first, count, LANES_LOW_PASS, LANES_EACH);
  } else if (e->methods == &amb_extended_methods) {
    if (law)
      steps(t, first, count, LANES_EXTENDED, LANES_LAW);
    else
      steps(t, first, count, LANES_EXTENDED, LANES_EACH);
  } else if (constant) {
    steps(t, first, count, LANES_KALMAN, LANES_CONSTANT);
  } else if (law) {
    steps(t, first, count, LANES_KALMAN, LANES_LAW);
  } else {
    steps(t, first, count, LANES_KALMAN, LANES_EACH);
  }
}

/* ---- The record, block by block. ---- */

static void fetch(team *t, size_t first, size_t count)
{
  for (size_t i = 0; i < LANES; i++) {
    const amb_real *y = t->runs[i]->y + first;
    const amb_real *u = t->runs[i]->u + first;
    for (size_t b = 0; b < count; b++)
      t->b.y[b][i] = y[b];
    for (size_t b = (first == 0) ? 1 : 0; b < count; b++)
      t->b.u[b][i] = *(u + b - 1);
  }
}

static void write_out(team *t, size_t first, size_t count)
{
  for (size_t i = 0; i < t->count; i++) {
    amb_batch_run *run = t->runs[i];
    const block *b = &t->b;
    if (run->mean != NULL) {
      amb_real *to = run->mean + AMB_STATES * first;
      for (size_t k = 0; k < count; k++)
        for (size_t j = 0; j < AMB_STATES; j++)
          to[AMB_STATES * k + j] = b->mean[k][j][i];
    }
    if (run->innovation != NULL)
      for (size_t k = 0; k < count; k++)
        run->innovation[first + k] = b->result[k].innovation[i];
    if (run->variance != NULL)
      for (size_t k = 0; k < count; k++)
        run->variance[first + k] = b->result[k].variance[i];
    if (run->status != NULL)
      for (size_t k = 0; k < count; k++)
        run->status[first + k] = b->status[k][i];
  }
}

/* Adds up the squared errors of samples `from` to `count` of the block. */
static void judge(team *t, size_t first, size_t from, size_t count)
{
  lanes sum[AMB_BATCH_JUDGED] = {{AMB_C(0.0)}, {AMB_C(0.0)}, {AMB_C(0.0)}};
  lanes truth[BLOCK][AMB_BATCH_JUDGED];
  for (size_t i = 0; i < LANES; i++) {
    const amb_real *true_ones = t->runs[i]->truth + AMB_BATCH_JUDGED * first;
    for (size_t k = from; k < count; k++)
      for (size_t j = 0; j < AMB_BATCH_JUDGED; j++)
        truth[k][j][i] = true_ones[AMB_BATCH_JUDGED * k + j];
  }
  for (size_t k = from; k < count; k++)
    for (size_t j = 0; j < AMB_BATCH_JUDGED; j++) {
      const lanes d = t->b.mean[k][j] - truth[k][j];
      sum[j] += d * d;
    }
  for (size_t i = 0; i < t->count; i++)
    for (size_t j = 0; j < AMB_BATCH_JUDGED; j++)
      t->runs[i]->squares[j] += (double)sum[j][i];
}

/* The first measurement is only taken in, by the core's own function. */
static void start(team *t)
{
  for (size_t i = 0; i < t->count; i++) {
    amb_batch_run *run = t->runs[i];
    const amb_kalman_state *state = (const amb_kalman_state *)run->state;
    amb_kalman_result r;
    tell(t, 0, i, amb_estimator_start(run->estimator, run->state, run->y, &r));
    t->b.result[0].innovation[i] = r.innovation[0];
    t->b.result[0].variance[i] = r.variance[0];
    for (size_t j = 0; j < AMB_STATES; j++)
      t->b.mean[0][j][i] = state->mean[j];
  }
}

void AMB_LANES_NAME(amb_lanes_run)(amb_batch_run *const runs[], size_t count, size_t n, size_t skip)
{
  team t;
  memset(&t, 0, sizeof t);
  t.count = count;
  t.judged = true;
  for (size_t i = 0; i < LANES; i++) {
    t.runs[i] = runs[(i < count) ? i : count - 1];
    t.judged = t.judged && (t.runs[i]->truth != NULL);
    t.magnets[i] = asked(t.runs[i]->estimator->magnet);
    fill_parameters(&t.p, i, t.runs[i]->estimator);
  }
  if (n > 0)
    start(&t);
  for (size_t i = 0; i < LANES; i++)
    put(&t, &t.s, i);
  for (size_t first = 0; first < n; first += BLOCK) {
    const size_t length = (n - first < BLOCK) ? n - first : BLOCK;
    fetch(&t, first, length);
    advance(&t, (first == 0) ? 1 : 0, length);
    write_out(&t, first, length);
    if (t.judged)
      judge(&t, first, (skip <= first) ? 0 : ((skip - first < length) ? skip - first : length),
            length);
    if (t.b.told)
      memset(t.b.status, 0, sizeof t.b.status);
    t.b.told = false;
  }
  for (size_t i = 0; i < count; i++)
    get(&t, &t.s, i);
}

#endif
