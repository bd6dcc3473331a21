/* One axial bearing, four states (paper, eq. 15-21). Written by `python -m models`; do not edit. */
#ifndef AMBKIT_GENERATED_AXIAL_H
#define AMBKIT_GENERATED_AXIAL_H

#include "ambkit/magnet.h"
#include "ambkit/phi.h"

#define AMB_STATES 4
#define AMB_FORCES 1
#define AMB_CONTROLS 1
#define AMB_SENSORS 1
#define AMB_NOISES 1
#define AMB_TRIANGLE 10
#define AMB_WORK 1 /* nothing is needed */

#define AMB_FIRST_POSITION 0
#define AMB_FIRST_VELOCITY 1
#define AMB_FIRST_LOAD 2

/* What the equations ask of the physical parameters, computed once. */
typedef struct amb_model {
  amb_real T;
  amb_real T_2;
  amb_real T_m;
  amb_real T2_2m;
  amb_real a_sen;
  amb_real b_sen;
  amb_real c_sen;
  amb_real d_sen;
  amb_real K_sen;
  amb_real N00;
  amb_real N01;
  amb_real N02;
  amb_real N03;
  amb_real N11;
  amb_real N12;
  amb_real N13;
  amb_real N23;
  amb_real N33;
} amb_model;

#ifndef AMB_SIDE_BY_SIDE /* vectors of filters take theirs from the scalars' */
/* Constants from the physical parameters, SI. */
AMB_INLINE void amb_model_init(amb_model *model, amb_real T, amb_real m, amb_real K_sen,
                               amb_real T_sen)
{
  const amb_real T_m = T / m;
  const amb_real T2_2m = (AMB_C(0.5)) * (T * T) / m;
  const amb_real T3_m = K_sen * (T * T * T) / (T_sen * m);
  const amb_real t0 = AMB_C(1.0) / (T_sen);
  const amb_real t1 = T * t0;
  const amb_real t2 = amb_phi3(AMB_C(0.06943184420297371) * t1);
  const amb_real t3 = amb_phi3(AMB_C(0.33000947820757187) * t1);
  const amb_real t4 = amb_phi3(AMB_C(0.6699905217924281) * t1);
  const amb_real t5 = amb_phi3(AMB_C(0.9305681557970263) * t1);
  model->T = T;
  model->K_sen = K_sen;
  model->T_2 = (AMB_C(0.5)) * T;
  model->T_m = T_m;
  model->T2_2m = T2_2m;
  model->a_sen = amb_exp_negative(t1);
  model->b_sen = K_sen * t1 * amb_phi1(t1);
  model->c_sen = K_sen * (T * T) * t0 * amb_phi2(t1);
  model->d_sen = T3_m * amb_phi3(t1);
  model->N00 = AMB_C(0.2) * (T2_2m * T2_2m);
  model->N01 = AMB_C(0.25) * T2_2m * T_m;
  model->N02 = AMB_C(0.3333333333333333) * T2_2m;
  model->N03 = T2_2m * T3_m *
               (AMB_C(2.8064775045652054e-07) * t2 + AMB_C(0.0012762811163550146) * t3 +
                AMB_C(0.044020763501341785) * t4 + AMB_C(0.12136934140121941) * t5);
  model->N11 = AMB_C(0.3333333333333333) * (T_m * T_m);
  model->N12 = AMB_C(0.5) * T_m;
  model->N13 = T3_m * T_m *
               (AMB_C(4.042061012178913e-06) * t2 + AMB_C(0.00386740745534663) * t3 +
                AMB_C(0.06570356157214415) * t4 + AMB_C(0.13042498891149704) * t5);
  model->N23 = T3_m * (AMB_C(5.82162415326683e-05) * t2 + AMB_C(0.011719079937801297) * t3 +
                       AMB_C(0.0980664045759441) * t4 + AMB_C(0.14015629924472195) * t5);
  model->N33 =
      (T3_m * T3_m) *
      (AMB_C(1.948589088561218e-08) * (t2 * t2) + AMB_C(0.0004211848652544957) * (t3 * t3) +
       AMB_C(0.02949349430796506) * (t4 * t4) + AMB_C(0.11294244419803241) * (t5 * t5));
}

/* What the equations as printed leave out: the force and the speed within the sample. */
AMB_INLINE void amb_model_as_printed(amb_model *model)
{
  model->T_2 = AMB_C(0.0);
  model->c_sen = AMB_C(0.0);
  model->d_sen = AMB_C(0.0);
  model->N00 = AMB_C(0.0);
  model->N01 = AMB_C(0.0);
  model->N02 = AMB_C(0.0);
  model->N03 = AMB_C(0.0);
  model->N11 = AMB_C(0.0);
  model->N12 = AMB_C(0.0);
  model->N13 = AMB_C(0.0);
  model->N23 = AMB_C(0.0);
  model->N33 = AMB_C(0.0);
}

/* Covariance that growths of these variances leave in a sample: f_d. */
AMB_INLINE void amb_model_growth(const amb_model *model, const amb_real var[AMB_NOISES],
                                 amb_real growth[AMB_TRIANGLE])
{
  growth[0] = model->N00 * var[0];
  growth[1] = model->N01 * var[0];
  growth[2] = model->N02 * var[0];
  growth[3] = model->N03 * var[0];
  growth[4] = model->N11 * var[0];
  growth[5] = model->N12 * var[0];
  growth[6] = model->N13 * var[0];
  growth[7] = var[0];
  growth[8] = model->N23 * var[0];
  growth[9] = model->N33 * var[0];
}

/* Whether noise k drives state i within a sample. */
AMB_INLINE bool amb_model_drives(const amb_model *model, int k, int i)
{
  (void)model;
  static const bool drives[AMB_NOISES][AMB_STATES] = {{true, true, true, true}};
  return drives[k][i];
}

/* How a force of 1 N moves the states within a sample. */
AMB_INLINE void amb_model_pushed(const amb_model *model, int f, amb_real moved[AMB_STATES])
{
  (void)f;
  moved[0] = model->T2_2m;
  moved[1] = model->T_m;
  moved[2] = AMB_C(0.0);
  moved[3] = model->d_sen;
}

/* What each state is. */
AMB_INLINE amb_role amb_model_role(const amb_model *model, int i)
{
  (void)model;
  static const amb_role role[AMB_STATES] = {AMB_POSITION, AMB_VELOCITY, AMB_LOAD, AMB_SHOWN};
  return role[i];
}

/* Whether they are such; what a sensor shows is looked after by who takes it in. */
AMB_INLINE bool amb_model_sound(const amb_model *model, const amb_real cov[AMB_TRIANGLE])
{
  (void)model;
  return (cov[0] >= AMB_C(0.0)) && (cov[4] >= AMB_C(0.0)) && (cov[7] >= AMB_C(0.0));
}

/* Whether all positions are known better than this. */
AMB_INLINE bool amb_model_known(const amb_model *model, const amb_real cov[AMB_TRIANGLE],
                                const amb_real widest[AMB_STATES])
{
  (void)model;
  return (cov[0] <= widest[0]);
}

/* A covariance of these variances, and nothing else. */
AMB_INLINE void amb_model_uncorrelated(const amb_model *model, const amb_real variances[AMB_STATES],
                                       amb_real cov[AMB_TRIANGLE])
{
  (void)model;
  cov[0] = amb_magnitude(variances[0]);
  cov[1] = AMB_C(0.0);
  cov[2] = AMB_C(0.0);
  cov[3] = AMB_C(0.0);
  cov[4] = amb_magnitude(variances[1]);
  cov[5] = AMB_C(0.0);
  cov[6] = AMB_C(0.0);
  cov[7] = amb_magnitude(variances[2]);
  cov[8] = AMB_C(0.0);
  cov[9] = amb_magnitude(variances[3]);
}
#endif

/* Displacement at which the magnet pulls, the mean over the sample [m]. */
AMB_INLINE amb_real amb_model_displacement(const amb_model *model, int f,
                                           const amb_real mean[AMB_STATES])
{
  (void)f;
  return mean[0] + mean[1] * model->T_2;
}

/* Its current, the mean over the sample [A]. */
AMB_INLINE amb_real amb_model_current(const amb_model *model, int f,
                                      const amb_real mean[AMB_STATES],
                                      const amb_real iu[AMB_CONTROLS])
{
  (void)model;
  (void)f;
  (void)mean;
  return iu[0];
}

/* What the sensor shows (eq. 21). */
AMB_INLINE amb_real amb_model_shown(const amb_model *model, int r, const amb_real mean[AMB_STATES])
{
  (void)model;
  (void)r;
  return mean[3];
}

/* The variance of that. */
AMB_INLINE amb_real amb_model_shown_variance(const amb_model *model, int r,
                                             const amb_real cov[AMB_TRIANGLE])
{
  (void)model;
  (void)r;
  return cov[9];
}

/* The variances of all states. */
AMB_INLINE void amb_model_variances(const amb_model *model, const amb_real cov[AMB_TRIANGLE],
                                    amb_real variances[AMB_STATES])
{
  (void)model;
  variances[0] = cov[0];
  variances[1] = cov[4];
  variances[2] = cov[7];
  variances[3] = cov[9];
}

/* And its covariance with the states. */
AMB_INLINE void amb_model_shown_with(const amb_model *model, int r,
                                     const amb_real cov[AMB_TRIANGLE], amb_real with_y[AMB_STATES])
{
  (void)model;
  (void)r;
  with_y[0] = cov[3];
  with_y[1] = cov[6];
  with_y[2] = cov[8];
  with_y[3] = cov[9];
}

/* What follows from the positions when all is at rest. */
AMB_INLINE void amb_model_equilibrium(const amb_model *model, amb_real mean[AMB_STATES])
{
  mean[3] = mean[0] * model->K_sen;
}

/* Eq. 9, the mean one sample on; F: force on the rotor without f_d [N]. */
AMB_INLINE void amb_model_predict_mean(const amb_model *model, const amb_real F[AMB_FORCES],
                                       const amb_real iu[AMB_CONTROLS], amb_real mean[AMB_STATES])
{
  (void)iu;
  const amb_real T = model->T;
  const amb_real T_m = model->T_m;
  const amb_real T2_2m = model->T2_2m;
  const amb_real a_sen = model->a_sen;
  const amb_real b_sen = model->b_sen;
  const amb_real c_sen = model->c_sen;
  const amb_real d_sen = model->d_sen;
  const amb_real x = mean[0];
  const amb_real v = mean[1];
  const amb_real f_d = mean[2];
  const amb_real x_m = mean[3];
  const amb_real f_all = F[0] + f_d;
  mean[0] = x + T * v + T2_2m * f_all;
  mean[1] = v + T_m * f_all;
  mean[3] = b_sen * x + c_sen * v + a_sen * x_m + d_sen * f_all;
}

/* Eq. 10, A P A' + Q on the upper triangle, row by row. */
AMB_INLINE void amb_model_predict_covariance(const amb_model *model,
                                             const amb_stiffness k[AMB_FORCES],
                                             const amb_real k_ui[AMB_CONTROLS],
                                             const amb_real var_u[AMB_CONTROLS],
                                             const amb_real growth[AMB_TRIANGLE],
                                             amb_real cov[AMB_TRIANGLE], amb_real work[AMB_WORK])
{
  (void)work;
  const amb_real T = model->T;
  const amb_real T_2 = model->T_2;
  const amb_real T_m = model->T_m;
  const amb_real T2_2m = model->T2_2m;
  const amb_real a_sen = model->a_sen;
  const amb_real b_sen = model->b_sen;
  const amb_real c_sen = model->c_sen;
  const amb_real d_sen = model->d_sen;
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
  const amb_real k_i = k[0].k_i;
  const amb_real k_s = k[0].k_s;
  const amb_real h1 = T_2 * k_s;
  const amb_real g0 = k_i * k_ui[0];
  const amb_real q0 = (g0 * g0) * var_u[0];
  const amb_real w0 = P02 + P01 * h1 + P00 * k_s;
  const amb_real w1 = P12 + P11 * h1 + P01 * k_s;
  const amb_real w2 = P22 + P12 * h1 + P02 * k_s;
  const amb_real w3 = P23 + P13 * h1 + P03 * k_s;
  const amb_real M00 = P00 + P01 * T + T2_2m * w0;
  const amb_real M01 = P01 + P11 * T + T2_2m * w1;
  const amb_real M02 = P02 + P12 * T + T2_2m * w2;
  const amb_real M03 = P03 + P13 * T + T2_2m * w3;
  const amb_real M10 = P01 + T_m * w0;
  const amb_real M11 = P11 + T_m * w1;
  const amb_real M12 = P12 + T_m * w2;
  const amb_real M13 = P13 + T_m * w3;
  const amb_real M30 = P00 * b_sen + P01 * c_sen + P03 * a_sen + d_sen * w0;
  const amb_real M31 = P01 * b_sen + P11 * c_sen + P13 * a_sen + d_sen * w1;
  const amb_real M32 = P02 * b_sen + P12 * c_sen + P23 * a_sen + d_sen * w2;
  const amb_real M33 = P03 * b_sen + P13 * c_sen + P33 * a_sen + d_sen * w3;
  const amb_real z0 = T2_2m * q0 + M02 + M01 * h1 + M00 * k_s;
  const amb_real z1 = T_m * q0 + M12 + M11 * h1 + M10 * k_s;
  const amb_real z2 = P22 + P12 * h1 + P02 * k_s;
  const amb_real z3 = d_sen * q0 + M32 + M31 * h1 + M30 * k_s;
  cov[0] = M00 + M01 * T + growth[0] + T2_2m * z0;
  cov[1] = M01 + growth[1] + T_m * z0;
  cov[2] = M02 + growth[2];
  cov[3] = M00 * b_sen + M01 * c_sen + M03 * a_sen + growth[3] + d_sen * z0;
  cov[4] = M11 + growth[4] + T_m * z1;
  cov[5] = M12 + growth[5];
  cov[6] = M10 * b_sen + M11 * c_sen + M13 * a_sen + growth[6] + d_sen * z1;
  cov[7] = P22 + growth[7];
  cov[8] = P02 * b_sen + P12 * c_sen + P23 * a_sen + growth[8] + d_sen * z2;
  cov[9] = M30 * b_sen + M31 * c_sen + M33 * a_sen + growth[9] + d_sen * z3;
}

/* Eq. 11-13 for the scalar measurement of eq. 21; S must be positive. */
AMB_INLINE void amb_model_update(const amb_model *model, int r, amb_real y, amb_real S,
                                 amb_real mean[AMB_STATES], amb_real cov[AMB_TRIANGLE],
                                 amb_real *innovation)
{
  (void)model;
  (void)r;
  *innovation = y - mean[3];
  const amb_real inverse = AMB_C(1.0) / S;
  const amb_real e = *innovation;
  const amb_real P03 = cov[3];
  const amb_real P13 = cov[6];
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
  cov[0] -= K0 * P03;
  cov[1] -= K0 * P13;
  cov[2] -= K0 * P23;
  cov[3] -= K0 * P33;
  cov[4] -= K1 * P13;
  cov[5] -= K1 * P23;
  cov[6] -= K1 * P33;
  cov[7] -= K2 * P23;
  cov[8] -= K2 * P33;
  cov[9] -= K3 * P33;
}

#endif
