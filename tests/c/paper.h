/* The paper's rig, with a sensor and an amplifier whose gains are not one; starts of a filter. */
#ifndef AMBKIT_TESTS_PAPER_H
#define AMBKIT_TESTS_PAPER_H

#include "ambkit/kalman.h"

static const amb_kalman_settings paper = {
    .T = AMB_C(1e-4),
    .m = AMB_C(0.518),
    .K_sen = AMB_C(0.8),
    .T_sen = AMB_C(2e-4),
    .k_ui = AMB_C(1.25),
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
static const amb_stiffness centre = {AMB_C(10.05), AMB_C(7537.5)};
static const amb_magnet linear = {&amb_constant_magnet, &centre};
static const amb_real at_rest[4] = {0, 0, 0, 0};
static const amb_real some[4] = {AMB_C(3e-5), AMB_C(1e-2), 5, AMB_C(3e-5)};

#endif
