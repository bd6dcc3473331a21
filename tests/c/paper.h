/* The paper's rig, with a sensor and an amplifier whose gains are not one; starts of a filter. */
#ifndef AMBKIT_TESTS_PAPER_H
#define AMBKIT_TESTS_PAPER_H

#include "ambkit/closed.h"
#include "axis.h"

#define PAPER_T AMB_C(1e-4)
#define PAPER_M AMB_C(0.518)
#define PAPER_K_SEN AMB_C(0.8)
#define PAPER_T_SEN AMB_C(2e-4)
#define PAPER_X_MAX AMB_C(1e-3)
/* What a rotor between its stops can do (ambkit/envelope.h). */
#define PAPER_V_MAX (AMB_C(0.1) * PAPER_X_MAX / PAPER_T)
#define PAPER_F_MAX (PAPER_M * PAPER_V_MAX / PAPER_T)

static const amb_kalman_settings paper = {
    .T = PAPER_T,
    .K_sen = {PAPER_K_SEN},
    .lag = {PAPER_T_SEN},
    .travel = {PAPER_X_MAX},
    .k_ui = {AMB_C(1.25)},
    .iu_min = {AMB_C(-1.5)},
    .iu_max = {AMB_C(1.5)},
    .f_0 = {AMB_C(-5.08158)},
    .x_max = {PAPER_X_MAX},
    .cap = {PAPER_X_MAX, PAPER_V_MAX, PAPER_F_MAX, 3 * PAPER_K_SEN * PAPER_X_MAX},
    .var_u = {AMB_C(8e-5)},
    .var_d = {AMB_C(1e-2)},
    .var_y = {AMB_C(8.3e-11)},
    .gate = 8,
    .frozen_limit = 10,
    .outlier_limit = 3,
};
static const amb_stiffness centre = {AMB_C(10.05), AMB_C(7537.5)};
static const amb_magnet linear = {&amb_constant_magnet, &centre};
static const amb_law law = {AMB_C(6.7e-6), AMB_C(2e-3), AMB_C(1.5), true, 1, AMB_C(1e-3)};
static const amb_magnet closed = {&amb_law_magnet, &law};
static const amb_real at_rest[AMB_STATES] = {0};
static const amb_real some[AMB_STATES] = {AMB_C(3e-5), AMB_C(1e-2), 5, AMB_C(3e-5)};

static inline amb_model paper_model(void)
{
  return axis_model(PAPER_T, PAPER_M, PAPER_K_SEN, PAPER_T_SEN, AXIS_EXACT);
}

/* Checks settings, other than the paper's, for the paper's axis. */
static inline amb_status paper_init(amb_kalman *kf, const amb_kalman_settings *settings)
{
  const amb_model model = paper_model();
  return amb_kalman_init(kf, &model, settings);
}

static inline amb_kalman paper_filter(void)
{
  amb_kalman kf;
  CHECK(paper_init(&kf, &paper) == AMB_OK);
  return kf;
}

#endif
