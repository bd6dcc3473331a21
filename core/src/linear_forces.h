/* Time update of the covariance with forces beside those of the magnets (ambkit/model.h). */
#ifndef AMBKIT_LINEAR_FORCES_H
#define AMBKIT_LINEAR_FORCES_H

#include "ambkit/model.h"

#if defined(AMB_MODEL_LOOPS)
/* As amb_model_predict_covariance, of forces that have in addition these gradients by the states
 * (forces x states) and covariances [N^2] (forces x forces). A straight-line model of several
 * forces has it inline; there a gradient counts where h has entries and at collocated states. */
void amb_model_predict_with_forces(const amb_model *model, const amb_stiffness k[],
                                   const amb_real row[], const amb_real variance[],
                                   const amb_real k_ui[], const amb_real var_u[],
                                   const amb_real process_noise[], amb_real cov[], amb_real work[]);
#endif

#endif
