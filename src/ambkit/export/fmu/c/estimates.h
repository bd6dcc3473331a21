/* The estimates of a model, among its variables. */
#ifndef AMBKIT_FMU_ESTIMATES_H
#define AMBKIT_FMU_ESTIMATES_H

#include "filter.h"

/* Write all estimates of a filter with this state and result; `carried` as in amb_filter_show_std.
 * */
void amb_estimates_show(const amb_data_state *state, const amb_kalman_result *result,
                        const amb_real carried[], double value[]);

#endif
