/* A bearing for the tests of single estimators, and the faults that each must bear. */
#ifndef AMBKIT_TESTS_FAMILY_H
#define AMBKIT_TESTS_FAMILY_H

#include "ambkit/adaptive_noise.h"
#include "ambkit/low_pass.h"
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
