#include "linear_forces.h"
#include "kalman_prediction.h"

amb_status amb_linear_forces_predict(const amb_kalman *kf, amb_kalman_state *state,
                                     const amb_real F[AMB_FORCES],
                                     const amb_stiffness k[AMB_FORCES],
                                     const amb_real iu[AMB_CONTROLS], const linear_forces *forces)
{
#if AMB_FORCES > 1
  if (forces != NULL) {
    for (int f = 0; f < amb_forces(&kf->model); f++) {
      if (!AMB_WITHIN(F[f], AMB_REAL_ROOT)) { /* as in amb_step_predict_with */
        return AMB_BAD_PARAMETER;
      }
    }
    amb_model_predict_mean(&kf->model, F, iu, state->mean);
    amb_model_predict_with_forces(&kf->model, k, forces->row, forces->variance, kf->set.k_ui,
                                  kf->set.var_u, kf->growth, state->cov, AMB_ROOM(state));
    return AMB_OK;
  }
#else
  (void)forces;
#endif
  return amb_step_predict_with(kf, state, F, k, iu);
}
