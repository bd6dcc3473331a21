/* Filters along records side by side, compiled for each instruction set. */
#include "lanes_run.h"

#if defined(AMB_HAS_LANES)
#include "lanes_team.h"
#include "noise_block.h"

/* Samples `first` to `count` of the block. */
AMB_INLINE void steps(team *t, size_t first, size_t count, lanes_kind kind, lanes_magnet magnet)
{
  const lanes_of of = {kind, magnet, t->magnets};
  lanes_state s = t->s;
  for (size_t b = first; b < count; b++)
    step_at(t, b, of, &s);
  t->s = s;
}

static void advance(team *t, size_t first, size_t count)
{
  const lanes_of of = made_of(t);
#define STEPS(kind, magnet) steps(t, first, count, kind, magnet)
  FOR_MADE_OF(of, STEPS);
#undef STEPS
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

/* Adds the squared errors of samples `from` to `count` of the block. */
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

static void run(amb_batch_run *const runs[], size_t count, size_t n, size_t skip)
{
  team t;
  memset(&t, 0, sizeof t);
  t.count = count;
  t.judged = true;
  for (size_t i = 0; i < LANES; i++) {
    t.runs[i] = runs[(i < count) ? i : count - 1];
    t.judged = t.judged && (t.runs[i]->truth != NULL);
    t.magnets[i] = magnet_in_lanes(t.runs[i]->estimator->magnet);
    fill_parameters(&t.p, i, t.runs[i]->estimator);
  }
  for (size_t first = 0; first < n; first += BLOCK) {
    const size_t length = (n - first < BLOCK) ? n - first : BLOCK;
    fetch(&t, first, length);
    if (first == 0)
      begin(&t, &t.s);
    advance(&t, (first == 0) ? 1 : 0, length);
    write_out(&t, first, length);
    if (t.judged)
      judge(&t, first, (skip <= first) ? 0 : ((skip - first < length) ? skip - first : length),
            length);
    silence(&t);
  }
  for (size_t i = 0; (i < count) && (n > 0); i++)
    get(&t, &t.s, i);
}

static void noise(amb_noise_key key, uint32_t stream, size_t first, size_t n, double *to)
{
  amb_noise_normal(key, stream, first, n, to);
}

const amb_lanes AMB_LANES_NAME(amb_lanes) = {
    .run = run,
    .noise = noise,
#if !defined(AMB_FLOAT)
    .many = AMB_LANES_NAME(amb_lanes_many),
#endif
#if AMB_LANES_BYTES > 16
    .isolated = AMB_LANES_NAME(amb_kalman_run),
#endif
};

#endif
