/* A bearing for the tests of single estimators, and the faults that each must bear. */
#ifndef AMBKIT_TESTS_FAMILY_H
#define AMBKIT_TESTS_FAMILY_H

#include "ambkit/estimator.h"
#include "check.h"
#include <string.h>

static const amb_stiffness family_centre = {AMB_C(10.05), AMB_C(7537.5)};
static const amb_magnet family_linear = {&amb_constant_magnet, &family_centre};
static const amb_law family_closed = {AMB_C(6.7e-6), AMB_C(2e-3), AMB_C(1.5), true, 1, AMB_C(1e-3)};
static const amb_magnet family_law = {&amb_law_magnet, &family_closed};
static const amb_real family_rest[4] = {0, 0, 0, 0};
static const amb_real family_std[4] = {AMB_C(3e-5), AMB_C(1e-2), 5, AMB_C(3e-5)};

static inline amb_kalman family_filter(void)
{
  const amb_kalman_settings paper = {
      .T = AMB_C(1e-4),
      .m = AMB_C(0.518),
      .K_sen = 1,
      .T_sen = AMB_C(2e-4),
      .k_ui = 1,
      .f_0 = AMB_C(-5.08158),
      .iu_min = AMB_C(-1.5),
      .iu_max = AMB_C(1.5),
      .x_max = AMB_C(1e-3),
      .var_u = AMB_C(8e-5),
      .var_d = AMB_C(1e-2),
      .var_y = AMB_C(8.3e-11),
      .gate = 8,
      .frozen_limit = 10,
      .outlier_limit = 3,
  };
  amb_kalman kf;
  CHECK(amb_kalman_init(&kf, &paper) == AMB_OK);
  return kf;
}

/* A rotor that hangs in the middle, but for what shakes it. */
static inline amb_real family_position(int k)
{
  return (k % 2 == 0 ? AMB_C(1e-6) : AMB_C(-1e-6)) * (amb_real)(1 + k % 7);
}

static inline amb_real family_control(int k)
{
  return AMB_C(0.5056) + AMB_C(0.01) * (amb_real)(k % 5 - 2);
}

/* Starts that are none, and each thing that can come from a sensor or an amplifier. */
static inline void family_faults(const amb_estimator_methods *methods, const void *own)
{
  const amb_kalman kf = family_filter();
  const amb_estimator e = {methods, &kf, &family_law, own};
  union {
    amb_kalman_state base;
    amb_real room[400];
  } state;
  CHECK(methods->state_size <= sizeof state);
  amb_real bad[4] = {0, 0, NOT_A_NUMBER, 0};
  CHECK(methods->reset(&e, &state, bad, family_std) == AMB_BAD_PARAMETER);
  CHECK(methods->reset(&e, &state, family_rest, family_rest) == AMB_BAD_PARAMETER);
  CHECK(methods->reset(&e, &state, family_rest, family_std) == AMB_OK);

  amb_kalman_result r;
  const amb_kalman_state *s = &state.base;
  CHECK((amb_estimator_start(&e, &state, 0, &r) & ~AMB_UNEXCITED) == AMB_OK);
  for (int k = 0; k < 6000; k++) {
    amb_real y = family_position(k), u = family_control(k);
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
    const amb_status status = amb_estimator_step(&e, &state, y, u, &r);
    CHECK((status & told) == told);
    CHECK(all_finite(s->mean, 4) && all_finite(s->cov, 10));
    CHECK(s->cov[0] > 0 && s->cov[4] > 0 && s->cov[7] > 0 && s->cov[9] > 0);
    if (failures > 0)
      return;
  }
  CHECK(amb_magnitude(s->mean[0]) < AMB_C(1e-4));

  amb_real mean[4] = {AMB_C(1e-4), 0, 0, AMB_C(1e-4)};
  methods->advance(&e, 1, AMB_C(0.5), mean);
  CHECK(all_finite(mean, 4));
  if (methods->scale != NULL) {
    amb_real scale, variance;
    methods->scale(&e, &state, &scale, &variance);
    CHECK(amb_is_positive(scale) && amb_is_positive(variance));
  }
}

#endif
