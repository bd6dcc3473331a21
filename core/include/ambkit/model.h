/* The model of a machine between two samples, and what an estimator asks of it.
 *
 * With the magnets' forces held over a sample everything else is linear:
 *
 *   X+  = L X + B_u iu + sum over f of b_f (F_f + r_f X) + noise
 *   F_f = magnet f at the current i_f = e_f X + d_f iu and the displacement s_f = h_f X, both means
 *         over the sample, and what is known besides: weight and bias force
 *   y_r = c_r X + noise
 *
 * X: n states; iu: control currents [A]; r_f: states that pull where the magnet does. The matrices
 * have a pattern, which depends on the kind of machine only, and numbers.
 *
 * Two builds of one text: a machine's own model as straight-line C, written by
 * `python -m models` or by an export (for the paper's axis generated/axial.h), and loops over
 * the entries of any model (ambkit/loops.h). Both add up in the same order, and give the same bits:
 *
 *   row_f = k_s h_f + k_i e_f + r_f        w_f = row_f P         entries from last to first
 *   M_i   = L_i P + b_i w                  z_i = b_i q + row M_i     and again last to first
 *   P+_ij = L_j M_i + growth + b_j z_i     i <= j; q: variance of the force, by the control's
 *
 * AMB_STATES, AMB_FORCES, AMB_CONTROLS, AMB_SENSORS, AMB_NOISES: how many there are, or can be;
 * AMB_TRIANGLE: entries of a covariance's upper triangle, row by row. How many of them a model has
 * say amb_states(model), amb_forces(model) and so on. AMB_WORK: numbers of room for a prediction.
 */
#ifndef AMBKIT_MODEL_H
#define AMBKIT_MODEL_H

#include "ambkit/magnet.h"
#include "ambkit/role.h"

#if defined(AMB_MODEL_LOOPS)
#include "ambkit/loops.h"
#else
#include "generated/model.h"
#endif

/* Sizes; constants if they are known. */
#if defined(AMB_MODEL_LOOPS)
#define AMB_COUNT(some, known) (some)
#else
#define AMB_COUNT(some, known) (known)
#endif

AMB_INLINE int amb_states(const amb_model *model)
{
  (void)model;
  return AMB_COUNT(model->states, AMB_STATES);
}

AMB_INLINE int amb_forces(const amb_model *model)
{
  (void)model;
  return AMB_COUNT(model->forces, AMB_FORCES);
}

AMB_INLINE int amb_controls(const amb_model *model)
{
  (void)model;
  return AMB_COUNT(model->controls, AMB_CONTROLS);
}

AMB_INLINE int amb_sensors(const amb_model *model)
{
  (void)model;
  return AMB_COUNT(model->sensors, AMB_SENSORS);
}

AMB_INLINE int amb_noises(const amb_model *model)
{
  (void)model;
  return AMB_COUNT(model->noises, AMB_NOISES);
}

/* Loop over force f, control c and sensor r. With only one there is no loop: compilers would keep
 * its operands in memory, while a filter should be in registers. */
#if !defined(AMB_MODEL_LOOPS) && (AMB_FORCES == 1)
#define AMB_EACH_FORCE(model) const int f = 0;
#else
#define AMB_EACH_FORCE(model) for (int f = 0; f < amb_forces(model); f++)
#endif
#if !defined(AMB_MODEL_LOOPS) && (AMB_CONTROLS == 1)
#define AMB_EACH_CONTROL(model) const int c = 0;
#else
#define AMB_EACH_CONTROL(model) for (int c = 0; c < amb_controls(model); c++)
#endif
#if !defined(AMB_MODEL_LOOPS) && (AMB_SENSORS == 1)
#define AMB_EACH_SENSOR(model) const int r = 0;
#else
#define AMB_EACH_SENSOR(model) for (int r = 0; r < amb_sensors(model); r++)
#endif

/* Entry (i, j), i <= j, of the upper triangle of n rows. */
AMB_INLINE int amb_entry(int n, int i, int j)
{
  return i * n - (i * (i + 1)) / 2 + j;
}

/* Index of entry (i, j) of a symmetric matrix of n rows in its upper triangle. */
AMB_INLINE int amb_place(int n, int i, int j)
{
  return (i <= j) ? amb_entry(n, i, j) : amb_entry(n, j, i);
}

/* A symmetric matrix from its upper triangle; its rows are `stride` apart. */
AMB_INLINE void amb_unfold(int n, const amb_real triangle[], int stride, amb_real *P)
{
  int entry = 0;
  for (int i = 0; i < n; i++) {
    for (int j = i; j < n; j++) {
      P[i * stride + j] = triangle[entry];
      P[j * stride + i] = triangle[entry];
      entry++;
    }
  }
}

/* First state of a role; -1 if there is none. */
AMB_INLINE int amb_first(const amb_model *model, amb_role role)
{
  int first = -1;
  for (int i = amb_states(model) - 1; i >= 0; i--) {
    first = (amb_model_role(model, i) == role) ? i : first;
  }
  return first;
}

/* ---- Every model provides these, ambkit/loops.h also others; a built-in model inline
 * (generated/axial.h). ---- */
#if defined(AMB_MODEL_LOOPS)
AMB_EXTERN_C_BEGIN

/* Time update of the mean (eq. 9); F: forces except collocated disturbance forces [N]. */
void amb_model_predict_mean(const amb_model *model, const amb_real F[], const amb_real iu[],
                            amb_real mean[]);

/* Time update of the covariance (eq. 10); k: stiffnesses; k_ui [A/V] and var_u [V^2] of the
 * controls. */
void amb_model_predict_covariance(const amb_model *model, const amb_stiffness k[],
                                  const amb_real k_ui[], const amb_real var_u[],
                                  const amb_real process_noise[], amb_real cov[], amb_real work[]);

/* Reading of sensor r at a mean; its variance, and its covariance with all states. */
amb_real amb_model_shown(const amb_model *model, int r, const amb_real mean[]);
amb_real amb_model_shown_variance(const amb_model *model, int r, const amb_real cov[]);
void amb_model_shown_with(const amb_model *model, int r, const amb_real cov[], amb_real with_y[]);

/* The variances of all states. */
void amb_model_variances(const amb_model *model, const amb_real cov[], amb_real variances[]);

/* Measurement update of sensor r (eq. 11-13); S: variance of the innovation, the sum of those of
 * the reading and the measurement noise, which must be positive. */
void amb_model_update(const amb_model *model, int r, amb_real y, amb_real S, amb_real mean[],
                      amb_real cov[], amb_real *innovation);

/* Effect of a force of 1 N at magnet f on the states over a sample. */
void amb_model_pushed(const amb_model *model, int f, amb_real moved[]);

/* Covariance from noises with these variances over a sample, upper triangle. */
void amb_model_growth(const amb_model *model, const amb_real var[], amb_real process_noise[]);

/* Whether noise k drives state i within a sample. */
bool amb_model_drives(const amb_model *model, int k, int i);

/* Set AMB_SHOWN states to their equilibrium. */
void amb_model_equilibrium(const amb_model *model, amb_real mean[]);

AMB_EXTERN_C_END

/* Whether variances are valid, neither negative nor NaN; that of a reading is checked by the
 * update. */
AMB_INLINE bool amb_model_sound(const amb_model *model, const amb_real cov[])
{
  bool sound = true;
  for (int i = 0; i < amb_states(model); i++) {
    const bool shown = amb_model_role(model, i) == AMB_SHOWN;
    sound = sound && (shown || (cov[amb_entry(amb_states(model), i, i)] >= AMB_C(0.0)));
  }
  return sound;
}

/* Whether the standard deviations of all positions are below this. */
AMB_INLINE bool amb_model_known(const amb_model *model, const amb_real cov[],
                                const amb_real widest[])
{
  bool known = true;
  for (int i = 0; i < amb_states(model); i++) {
    const bool position = amb_model_role(model, i) == AMB_POSITION;
    known = known && (!position || (cov[amb_entry(amb_states(model), i, i)] <= widest[i]));
  }
  return known;
}

/* A diagonal covariance with these variances, made positive. */
AMB_INLINE void amb_model_uncorrelated(const amb_model *model, const amb_real variances[],
                                       amb_real cov[])
{
  for (int i = 0; i < amb_states(model); i++) {
    for (int j = i; j < amb_states(model); j++) {
      const amb_real variance = amb_magnitude(variances[i]);
      cov[amb_entry(amb_states(model), i, j)] = (i == j) ? variance : AMB_C(0.0);
    }
  }
}
#endif

#endif
