/* A bearing for the tests of single estimators, and the faults that each must bear. */
#ifndef AMBKIT_TESTS_FAMILY_H
#define AMBKIT_TESTS_FAMILY_H

#include "ambkit/adaptive_noise.h"
#include "ambkit/low_pass.h"
#include "ambkit/observer.h"
#include "ambkit/unscented.h"
#include "paper.h"

/* The paper's rig with gains of one. */
static inline amb_kalman_settings family_settings(void)
{
  amb_kalman_settings s = paper;
  s.K_sen[0] = 1;
  s.k_ui[0] = 1;
  s.cap[3] = 3 * PAPER_X_MAX;
  return s;
}

static inline amb_kalman family_filter(void)
{
  const amb_model model = axis_model(PAPER_T, PAPER_M, 1, PAPER_T_SEN, AXIS_EXACT);
  const amb_kalman_settings settings = family_settings();
  amb_kalman kf;
  CHECK(amb_kalman_init(&kf, &model, &settings) == AMB_OK);
  return kf;
}

/* Each kind, with what only it has. */
#define FAMILY_KINDS 9
static const amb_augmented family_augmented = {
    {AMB_C(0.75375)}, AMB_C(0.2), AMB_C(1e-6), AMB_C(0.2), 5, {AMB_C(0.012), AMB_C(0.1)}};
static const amb_multiple_model family_models = {
    .n = 3,
    .theta = {AMB_C(0.8), 1, AMB_C(1.2)},
    .leave = AMB_C(1e-4),
    .bias = {AMB_C(0.75375)},
    .learn = {AMB_C(0.012), AMB_C(0.1)},
};
static const amb_unscented family_points = {AMB_C(1.7320508), AMB_C(2.0)};
static const amb_low_pass family_low = {PAPER_M, AMB_C(0.2), AMB_C(0.1), AMB_C(0.03)};
/* The paper's rig with all poles at eight times the unstable one. */
static const amb_observer family_observer = {
    {{AMB_C(1.174982e-01), AMB_C(7.660125e+01), AMB_C(9.428160e+03), AMB_C(-1.207407e-01)}},
    {AMB_C(1.348377e-11), AMB_C(8.289901e-09), AMB_C(1.151406e-06), AMB_C(1.163403e-11),
     AMB_C(7.082104e-06), AMB_C(1.310412e-03), AMB_C(6.122142e-09), AMB_C(3.771677e-01),
     AMB_C(8.755423e-07), AMB_C(2.079904e-11)},
    {AMB_C(9.859563e-11)},
    {AMB_C(3.777285e-02), AMB_C(5.778186e+01), AMB_C(2.097882e+04), AMB_C(5.554633e-02)}};
static const amb_adaptive_noise family_noises = {
    {&amb_extended_methods, NULL, NULL, NULL}, true, true, AMB_C(1e-3), AMB_C(2e-2), 100, 10};

typedef struct family_kind {
  const amb_estimator_methods *methods;
  const void *own;
  bool certain; /* has a covariance of its own */
} family_kind;

static const family_kind family_kinds[FAMILY_KINDS] = {
    {&amb_kalman_methods, NULL, true},
    {&amb_extended_methods, NULL, true},
    {&amb_ud_methods, NULL, true},
    {&amb_unscented_methods, &family_points, true},
    {&amb_augmented_methods, &family_augmented, true},
    {&amb_multiple_model_methods, &family_models, true},
    {&amb_adaptive_noise_methods, &family_noises, true},
    {&amb_observer_methods, &family_observer, false},
    {&amb_low_pass_methods, &family_low, false}};

/* Room for the state of any kind. */
typedef union family_state {
  amb_kalman_state base;
  amb_low_pass_state low_pass;
  amb_adaptive_noise_state adaptive_noise; /* with that of all others inside */
} family_state;

static inline amb_real family_control(int k)
{
  return AMB_C(0.5056) + AMB_C(0.01) * (amb_real)(k % 5 - 2);
}

/* xorshift (Marsaglia 2003). */
static inline unsigned long family_draw(void)
{
  static unsigned long s = 2463534242UL;
  s ^= (s << 13) & 0xFFFFFFFFUL;
  s ^= s >> 17;
  s ^= (s << 5) & 0xFFFFFFFFUL;
  return s;
}

static inline amb_real family_uniform(void)
{
  return (amb_real)(family_draw() % 100000UL) / AMB_C(50000.0) - 1;
}

/* 10^n for whole n, of either sign. */
static inline amb_real family_decades(int most)
{
  const int n = (int)(family_draw() % (unsigned long)(2 * most + 1)) - most;
  amb_real a = 1;
  for (int i = 0; i < n; i++)
    a *= 10;
  for (int i = 0; i > n; i--)
    a /= 10;
  return a;
}

/* What a sensor or an amplifier may give, one fault for a while, then another. */
static inline amb_real family_faulty(unsigned long fault, int k, amb_real good, amb_real *stuck)
{
  switch (fault) {
  case 0:
    return NOT_A_NUMBER;
  case 1:
    return (k % 2 == 0) ? TOO_MUCH : -AMB_REAL_MAX;
  case 2:
    return *stuck;
  case 3:
    return *stuck + good; /* stuck, with noise: at a stop, or beyond */
  case 4:
    return (family_draw() % 4UL == 0UL) ? (family_uniform() * AMB_C(9e-3)) : good;
  case 5:
    return family_uniform() * AMB_C(1e-2);
  case 6:
    return good * AMB_REAL_MIN; /* denormal */
  case 7:
    return (family_draw() % 2UL == 0UL) ? NOT_A_NUMBER : (family_uniform() * family_decades(30));
  default:
    *stuck = family_uniform() * AMB_C(1.5e-3);
    return good;
  }
}

/* Starts that are none, and each thing that can come from a sensor or an amplifier. */
static inline void family_faults(const amb_estimator_methods *methods, const void *own)
{
  const amb_kalman kf = family_filter();
  const amb_estimator e = {methods, &kf, &closed, own};
  family_state state;
  CHECK(methods->state_size <= sizeof state);
  const amb_real bad[AMB_STATES] = {0, 0, NOT_A_NUMBER, 0};
  CHECK(methods->reset(&e, &state, bad, some) == AMB_BAD_PARAMETER);
  CHECK(methods->reset(&e, &state, at_rest, at_rest) == AMB_BAD_PARAMETER);
  CHECK(methods->reset(&e, &state, at_rest, some) == AMB_OK);

  amb_kalman_result r;
  const amb_kalman_state *s = &state.base;
  CHECK((axis_start(&e, &state, 0, &r) & ~AMB_UNEXCITED) == AMB_OK);
  for (int k = 0; k < 6000; k++) {
    amb_real y = axis_wobble(k), u = family_control(k);
    amb_status told = AMB_OK;
    if (k >= 1000 && k < 3000) {
      y = NOT_A_NUMBER;
      told = AMB_MISSING;
    } else if (k >= 3500 && k < 3600) {
      u = (k % 2 == 0) ? NOT_A_NUMBER : -TOO_MUCH;
      told = AMB_BAD_CONTROL;
    } else if (k >= 4000 && k < 4100) {
      y = AMB_C(2e-6);
      told = (k > 4020) ? AMB_FROZEN : AMB_OK;
    } else if (k == 4500 || k == 4501) {
      y = AMB_C(9e-4);
      told = AMB_OUTLIER;
    } else if (k >= 5000 && k < 5100) {
      y = (k % 2 == 0) ? TOO_MUCH : AMB_REAL_MAX;
      told = AMB_MISSING;
    } else if (k >= 5500 && k < 5503) {
      u = 5;
      told = AMB_SATURATED;
    }
    const amb_status status = axis_step(&e, &state, y, u, &r);
    CHECK((status & told) == told);
    CHECK(axis_sound(s));
    if (failures > 0)
      return;
  }
  CHECK(amb_magnitude(s->mean[0]) < AMB_C(1e-4));

  amb_real mean[AMB_STATES] = {AMB_C(1e-4), 0, 0, AMB_C(1e-4)};
  axis_advance(&e, 1, AMB_C(0.5), mean);
  CHECK(all_finite(mean, AXIS_STATES));
  if (methods->scale != NULL) {
    amb_real scale, variance;
    methods->scale(&e, &state, &scale, &variance);
    CHECK(amb_is_positive(scale) && amb_is_positive(variance));
  }
}

#endif
