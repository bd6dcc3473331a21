/* Filters side by side in the baseline's lanes: the same bits as one by one, faults and all, for
 * any number of runs and of samples. */
#include "ambkit/observer.h"
#include "family.h"
#include "lanes_run.h"

#define MOST 9
#define SAMPLES 90

typedef struct one {
  amb_kalman kf;
  amb_estimator estimator;
  amb_low_pass_state alone;
  amb_low_pass_state beside;
  amb_real mean[2][SAMPLES * AXIS_STATES];
  amb_real innovation[2][SAMPLES];
  amb_real variance[2][SAMPLES];
  unsigned short status[2][SAMPLES];
} one;

static one all[MOST];
static amb_real y[MOST][SAMPLES];
static amb_real u[MOST][SAMPLES];
static amb_real truth[SAMPLES * AMB_BATCH_JUDGED];

static void signals(void)
{
  for (int i = 0; i < MOST; i++) {
    for (int k = 0; k < SAMPLES; k++) {
      y[i][k] = AMB_C(1e-7) * (amb_real)((k * (37 + i)) % 101 - 50);
      u[i][k] = AMB_C(0.4) + AMB_C(1e-3) * (amb_real)((k * 53) % 17);
    }
    for (int k = 20 + i; k < 40; k++) {
      if (i % 4 == 0)
        y[i][k] = NOT_A_NUMBER;
      if (i % 4 == 1)
        y[i][k] = y[i][20];
      if (i % 4 == 2)
        u[i][k] = AMB_C(9.0);
      if (i % 4 == 3)
        y[i][k] = AMB_C(8e-4);
    }
  }
}

static amb_batch_run run_of(one *o, int i, int which)
{
  amb_batch_run run;
  memset(&run, 0, sizeof run);
  run.estimator = &o->estimator;
  run.state = (which == 0) ? &o->alone : &o->beside;
  run.y = y[i];
  run.u = u[i];
  run.truth = truth;
  run.mean = o->mean[which];
  run.innovation = o->innovation[which];
  run.variance = o->variance[which];
  run.status = o->status[which];
  return run;
}

/* FNV-1a over all bytes that came out: builds with vectors and without must print the same. */
static unsigned long long digest = 14695981039346656037ULL;

static void add(const void *bytes, size_t size)
{
  const unsigned char *at = (const unsigned char *)bytes;
  for (size_t i = 0; i < size; i++)
    digest = (digest ^ at[i]) * 1099511628211ULL;
}

static void compare(const amb_estimator_methods *methods, const amb_magnet *magnet, const void *own,
                    size_t runs, size_t n)
{
  const amb_real std[AMB_STATES] = {AMB_C(3e-5), AMB_C(0.012), 5, AMB_C(3e-5)};
  const amb_kalman_settings settings = family_settings();
  amb_batch_run alone[MOST];
  amb_batch_run beside[MOST];
  amb_batch_run *to[MOST];
  for (size_t i = 0; i < runs; i++) {
    one *o = &all[i];
    memset(o, 0, sizeof *o);
    /* A filter of each sort side by side. */
    const amb_model model = axis_model(PAPER_T, PAPER_M + AMB_C(0.01) * (amb_real)i, 1, PAPER_T_SEN,
                                       (i % 3 == 2) ? AXIS_AS_PRINTED : AXIS_EXACT);
    CHECK(amb_kalman_init(&o->kf, &model, &settings) == AMB_OK);
    const amb_estimator e = {methods, &o->kf, magnet, own};
    o->estimator = e;
    CHECK(methods->reset(&e, &o->alone, at_rest, std) == AMB_OK);
    CHECK(methods->reset(&e, &o->beside, at_rest, std) == AMB_OK);
    alone[i] = run_of(o, (int)i, 0);
    beside[i] = run_of(o, (int)i, 1);
    to[i] = &alone[i];
    amb_batch_advance(AMB_SCALAR, &to[i], 1, n, 5);
  }
  const size_t lanes = amb_batch_lanes(AMB_BASELINE);
  for (size_t i = 0; i < runs; i++)
    to[i] = &beside[i];
  for (size_t i = 0; i < runs; i += lanes)
    amb_batch_advance(AMB_BASELINE, &to[i], (runs - i < lanes) ? runs - i : lanes, n, 5);
  for (size_t i = 0; i < runs; i++) {
    const one *o = &all[i];
    CHECK(memcmp(o->mean[0], o->mean[1], sizeof o->mean[0]) == 0);
    CHECK(memcmp(o->innovation[0], o->innovation[1], sizeof o->innovation[0]) == 0);
    CHECK(memcmp(o->variance[0], o->variance[1], sizeof o->variance[0]) == 0);
    CHECK(memcmp(o->status[0], o->status[1], sizeof o->status[0]) == 0);
    CHECK(memcmp(alone[i].squares, beside[i].squares, sizeof alone[i].squares) == 0);
    CHECK(alone[i].all == beside[i].all);
    CHECK(memcmp(&o->alone, &o->beside, methods->state_size) == 0);
    add(o->mean[1], sizeof o->mean[1]);
    add(o->innovation[1], sizeof o->innovation[1]);
    add(o->variance[1], sizeof o->variance[1]);
    add(o->status[1], sizeof o->status[1]);
    add(beside[i].squares, sizeof beside[i].squares);
  }
}

int main(void)
{
  const amb_low_pass low = {PAPER_M, AMB_C(0.2), AMB_C(0.1), AMB_C(0.05)};
  const amb_observer observer = {{{AMB_C(0.1), 10, 100, AMB_C(0.2)}},
                                 {AMB_C(1e-12)},
                                 {AMB_C(1e-10)},
                                 {AMB_C(1e-2), 10, AMB_C(1e4), AMB_C(1e-2)}};
  signals();
  for (size_t runs = 1; runs <= MOST; runs += 2) {
    compare(&amb_kalman_methods, &linear, NULL, runs, SAMPLES);
    compare(&amb_kalman_methods, &closed, NULL, runs, SAMPLES);
    compare(&amb_extended_methods, &closed, NULL, runs, 70);
    compare(&amb_observer_methods, &linear, &observer, runs, 64);
    compare(&amb_low_pass_methods, &closed, &low, runs, 1);
    compare(&amb_low_pass_methods, &linear, &low, runs, SAMPLES);
  }
  amb_batch_advance(AMB_BASELINE, NULL, 0, SAMPLES, 0);
  const amb_estimator unknown = {NULL, NULL, &linear, NULL};
  CHECK(amb_batch_group(&unknown) == 0U);
  CHECK(amb_batch_has(AMB_SCALAR));
#if defined(AMB_HAS_LANES)
  CHECK(amb_batch_has(AMB_BASELINE) && (amb_batch_group(&all[0].estimator) != 0U));
#else
  CHECK(!amb_batch_has(AMB_BASELINE) && (amb_batch_group(&all[0].estimator) == 0U));
#endif
  (void)printf("%s %016llx\n", amb_batch_has(AMB_BASELINE) ? "vectors" : "alone", digest);
  return failures;
}
