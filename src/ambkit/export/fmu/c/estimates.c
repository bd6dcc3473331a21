#include "estimates.h"
#include "model.h"

void amb_estimates_show(const amb_data_state *state, const amb_kalman_result *result,
                        const amb_real carried[], double value[])
{
  const amb_real *mean = ((const amb_kalman_state *)state)->mean;
  for (int i = 0; i < AMB_STATES; i++)
    value[FIRST_mean + i] = mean[i];
  amb_filter_show_std(state, carried, &value[FIRST_std]);
  for (int f = 0; f < AMB_FORCES; f++) {
    value[FIRST_k_i + f] = result->stiffness[f].k_i;
    value[FIRST_k_s + f] = result->stiffness[f].k_s;
  }
  for (int r = 0; r < AMB_SENSORS; r++) {
    value[FIRST_innovation + r] = result->innovation[r];
    value[FIRST_variance + r] = result->variance[r];
  }
  value[FIRST_status] = (double)result->status;
}
