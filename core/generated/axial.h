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
static inline void amb_axial_model_init(amb_axial_model *model, amb_real T, amb_real m,
                                        amb_real K_sen, amb_real T_sen)
{
  const amb_real t0 = 1 / ((m));
  const amb_real t1 = amb_exp_negative(T / T_sen);
  model->T = T;
  model->T_m = T * t0;
  model->T2_2m = (AMB_C(0.5)) * (T) * (T)*t0;
  model->a_sen = t1;
  model->b_sen = K_sen * (1 - t1);
}

/* Eq. 9, the mean one sample on; f: force on the rotor without f_d [N]. */
static inline void amb_axial_predict_mean(const amb_axial_model *model, amb_real f,
                                          amb_real mean[4])
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
  mean[0] = T * v + T2_2m * t0 + x;
  mean[1] = T_m * t0 + v;
  mean[3] = a_sen * x_m + b_sen * x;
}

/* Eq. 10, A P A' + Q on the upper triangle, row by row. */
static inline void amb_axial_predict_covariance(const amb_axial_model *model, amb_real k_i,
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
  const amb_real t0 = (k_i) * (k_i) * (k_ui) * (k_ui)*var_u;
  const amb_real t1 = T2_2m * k_s + 1;
  const amb_real t2 = P01 * t1 + P11 * T + P12 * T2_2m;
  const amb_real t3 = P02 * t1 + P12 * T + P22 * T2_2m;
  const amb_real t4 = P00 * t1 + P01 * T + P02 * T2_2m;
  const amb_real t5 = T_m * k_s;
  const amb_real t6 = P02 * T_m;
  const amb_real t7 = P12 + P22 * T_m + k_s * t6;
  const amb_real t8 = P00 * t5 + P01 + t6;
  cov[0] = T * t2 + (T2_2m) * (T2_2m)*t0 + T2_2m * t3 + t1 * t4;
  cov[1] = T2_2m * T_m * t0 + T_m * t3 + t2 + t4 * t5;
  cov[2] = t3;
  cov[3] = a_sen * (P03 * t1 + P13 * T + P23 * T2_2m) + b_sen * t4;
  cov[4] = P01 * t5 + P11 + P12 * T_m + (T_m) * (T_m)*t0 + T_m * t7 + t5 * t8;
  cov[5] = t7;
  cov[6] = a_sen * (P03 * t5 + P13 + P23 * T_m) + b_sen * t8;
  cov[7] = P22 + var_d;
  cov[8] = P02 * b_sen + P23 * a_sen;
  cov[9] = a_sen * (P03 * b_sen + P33 * a_sen) + b_sen * (P00 * b_sen + P03 * a_sen);
}

/* Eq. 11-13 for the scalar measurement of eq. 21; S must be positive. */
static inline void amb_axial_update(amb_real y, amb_real var_y, amb_real mean[4], amb_real cov[10],
                                    amb_real *innovation, amb_real *variance)
{
  *variance = cov[9] + var_y;
  *innovation = y - mean[3];
  const amb_real inverse = 1 / (*variance);
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
  cov[0] = -K0 * P03 + P00;
  cov[1] = -K0 * P13 + P01;
  cov[2] = -K0 * P23 + P02;
  cov[3] = -K0 * P33 + P03;
  cov[4] = -K1 * P13 + P11;
  cov[5] = -K1 * P23 + P12;
  cov[6] = -K1 * P33 + P13;
  cov[7] = -K2 * P23 + P22;
  cov[8] = -K2 * P33 + P23;
  cov[9] = -K3 * P33 + P33;
}

#endif
