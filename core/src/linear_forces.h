/* Prediction with forces beside those of the magnets that depend on the states. */
#ifndef AMBKIT_LINEAR_FORCES_H
#define AMBKIT_LINEAR_FORCES_H

#include "ambkit/kalman.h"

/* Forces along several axes: gradients by the states, and covariances besides [N^2]. */
typedef struct linear_forces linear_forces;
#if AMB_FORCES > 1
struct linear_forces {
  amb_real row[AMB_FORCES * AMB_STATES];
  amb_real variance[AMB_FORCES * AMB_FORCES];
};
#endif

#if defined(AMB_MODEL_LOOPS)
/* As amb_model_predict_covariance, of forces that have in addition these gradients by the states
 * (forces x states) and covariances [N^2] (forces x forces). A straight-line model of several
 * forces has it inline; there a gradient counts where h has entries and at collocated states. */
void amb_model_predict_with_forces(const amb_model *model, const amb_stiffness k[],
                                   const amb_real row[], const amb_real variance[],
                                   const amb_real k_ui[], const amb_real var_u[],
                                   const amb_real process_noise[], amb_real cov[], amb_real work[]);
#endif

/* As amb_step_predict_with, with `forces` of several axes in the covariance; NULL: none. Not
 * inline: beside other variables, straight-line code has a fifth more instructions. */
amb_status amb_linear_forces_predict(const amb_kalman *kf, amb_kalman_state *state,
                                     const amb_real F[AMB_FORCES],
                                     const amb_stiffness k[AMB_FORCES],
                                     const amb_real iu[AMB_CONTROLS], const linear_forces *forces);

#endif
