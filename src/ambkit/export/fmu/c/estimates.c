#include "estimates.h"
#include "model.h"

void amb_estimates_show(const amb_kalman *filter, const amb_data_state *state,
                        const amb_kalman_result *result, double value[])
{
  const amb_real *mean = ((const amb_kalman_state *)state)->mean;
  for (int i = 0; i < AMB_STATES; i++) /* they stand together, in their order */
    value[VR_estimate_x + i] = mean[i];
  amb_filter_show_std(filter, state, &value[VR_estimate_std_x]);
  value[VR_estimate_k_i] = result->stiffness[0].k_i;
  value[VR_estimate_k_s] = result->stiffness[0].k_s;
  value[VR_estimate_innovation] = result->innovation[0];
  value[VR_estimate_variance] = result->variance[0];
  value[VR_estimate_status] = (double)result->status;
}
