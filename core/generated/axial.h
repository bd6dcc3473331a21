/* One axial bearing, four states (paper, eq. 15-21). Written by `python -m derivation`; do not
 * edit. */
#ifndef AMBKIT_GENERATED_AXIAL_H
#define AMBKIT_GENERATED_AXIAL_H

#include "ambkit/exponential.h"
#include "ambkit/real.h"

#define AMB_AXIAL_STATES 4
#define AMB_AXIAL_TRIANGLE 10

/* What the equations ask of the physical parameters, computed once. */
typedef struct amb_axial_model {
  amb_real T;
  amb_real T_m;
  amb_real T2_2m;
  amb_real a_sen;
  amb_real b_sen;
} amb_axial_model;

/* Constants from the physical parameters, SI. */
AMB_INLINE void amb_axial_model_init(amb_axial_model *model, amb_real T, amb_real m, amb_real K_sen,
                                     amb_real T_sen)
{
  const amb_real t0 = AMB_C(1.0) / (m);
  const amb_real t1 = amb_exp_negative(T / T_sen);
  model->T = T;
  model->T_m = T * t0;
  model->T2_2m = (AMB_C(0.5)) * T * T * t0;
  model->a_sen = t1;
  model->b_sen = K_sen * (AMB_C(1.0) - t1);
}

/* Eq. 9, the mean one sample on; f: force on the rotor without f_d [N]. */
AMB_INLINE void amb_axial_predict_mean(const amb_axial_model *model, amb_real f, amb_real mean[4])
{
  const amb_real T = model->T;
  const amb_real T_m = model->T_m;
  const amb_real T2_2m = model->T2_2m;
  const amb_real a_sen = model->a_sen;
  const amb_real b_sen = model->b_sen;
  const amb_real x = mean[0];
  const amb_real v = mean[1];
  const amb_real f_d = mean[2];
  const amb_real x_m = mean[3];
  const amb_real t0 = f + f_d;
  mean[0] = x + T * v + T2_2m * t0;
  mean[1] = v + T_m * t0;
  mean[3] = a_sen * x_m + b_sen * x;
}

/* Eq. 10, A P A' + Q on the upper triangle, row by row. */
AMB_INLINE void amb_axial_predict_covariance(const amb_axial_model *model, amb_real k_i,
                                             amb_real k_s, amb_real k_ui, amb_real var_u,
                                             amb_real var_d, amb_real cov[10])
{
  const amb_real T = model->T;
  const amb_real T_m = model->T_m;
  const amb_real T2_2m = model->T2_2m;
  const amb_real a_sen = model->a_sen;
  const amb_real b_sen = model->b_sen;
  const amb_real P00 = cov[0];
  const amb_real P01 = cov[1];
  const amb_real P02 = cov[2];
  const amb_real P03 = cov[3];
  const amb_real P11 = cov[4];
  const amb_real P12 = cov[5];
  const amb_real P13 = cov[6];
  const amb_real P22 = cov[7];
  const amb_real P23 = cov[8];
  const amb_real P33 = cov[9];
  const amb_real g0 = k_i * k_ui;
  const amb_real q0 = g0 * g0 * var_u;
  const amb_real w0 = P02 + P00 * k_s;
  const amb_real w1 = P12 + P01 * k_s;
  const amb_real w2 = P22 + P02 * k_s;
  const amb_real w3 = P23 + P03 * k_s;
  const amb_real M00 = P00 + P01 * T + T2_2m * w0;
  const amb_real M01 = P01 + P11 * T + T2_2m * w1;
  const amb_real M02 = P02 + P12 * T + T2_2m * w2;
  const amb_real M03 = P03 + P13 * T + T2_2m * w3;
  const amb_real M10 = P01 + T_m * w0;
  const amb_real M11 = P11 + T_m * w1;
  const amb_real M12 = P12 + T_m * w2;
  const amb_real M13 = P13 + T_m * w3;
  const amb_real M30 = P00 * b_sen + P03 * a_sen;
  const amb_real M33 = P03 * b_sen + P33 * a_sen;
  const amb_real z0 = M02 + M00 * k_s + T2_2m * q0;
  const amb_real z1 = M12 + M10 * k_s + T_m * q0;
  cov[0] = M00 + M01 * T + T2_2m * z0;
  cov[1] = M01 + T_m * z0;
  cov[2] = M02;
  cov[3] = M00 * b_sen + M03 * a_sen;
  cov[4] = M11 + T_m * z1;
  cov[5] = M12;
  cov[6] = M10 * b_sen + M13 * a_sen;
  cov[7] = P22 + var_d;
  cov[8] = P02 * b_sen + P23 * a_sen;
  cov[9] = M30 * b_sen + M33 * a_sen;
}

/* Eq. 11-13 for the scalar measurement of eq. 21; S must be positive. */
AMB_INLINE void amb_axial_update(amb_real y, amb_real var_y, amb_real mean[4], amb_real cov[10],
                                 amb_real *innovation, amb_real *variance)
{
  *variance = cov[9] + var_y;
  *innovation = y - mean[3];
  const amb_real inverse = AMB_C(1.0) / (*variance);
  const amb_real e = *innovation;
  const amb_real P00 = cov[0];
  const amb_real P01 = cov[1];
  const amb_real P02 = cov[2];
  const amb_real P03 = cov[3];
  const amb_real P11 = cov[4];
  const amb_real P12 = cov[5];
  const amb_real P13 = cov[6];
  const amb_real P22 = cov[7];
  const amb_real P23 = cov[8];
  const amb_real P33 = cov[9];
  const amb_real K0 = P03 * inverse;
  const amb_real K1 = P13 * inverse;
  const amb_real K2 = P23 * inverse;
  const amb_real K3 = P33 * inverse;
  mean[0] += K0 * e;
  mean[1] += K1 * e;
  mean[2] += K2 * e;
  mean[3] += K3 * e;
  cov[0] = P00 - K0 * P03;
  cov[1] = P01 - K0 * P13;
  cov[2] = P02 - K0 * P23;
  cov[3] = P03 - K0 * P33;
  cov[4] = P11 - K1 * P13;
  cov[5] = P12 - K1 * P23;
  cov[6] = P13 - K1 * P33;
  cov[7] = P22 - K2 * P23;
  cov[8] = P23 - K2 * P33;
  cov[9] = P33 - K3 * P33;
}

#endif
