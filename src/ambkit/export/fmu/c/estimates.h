/* The estimates of a model, among its variables. */
#ifndef AMBKIT_FMU_ESTIMATES_H
#define AMBKIT_FMU_ESTIMATES_H

#include "filter.h"

/* Write all estimates of a filter in this state, whose last word was that. */
void amb_estimates_show(const amb_data_state *state, const amb_kalman_result *result,
                        double value[]);

#endif
