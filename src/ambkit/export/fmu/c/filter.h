/* The filter of a model, its data, and how it is tuned and started. */
#ifndef AMBKIT_FMU_FILTER_H
#define AMBKIT_FMU_FILTER_H

#include "data.h"

/* Written by the export; data.h has AMB_DATA_METHODS, the kind, and its state amb_data_state. */
extern const amb_kalman_settings amb_data_settings;
extern const amb_model amb_data_model;
extern const amb_real amb_data_std[AMB_STATES]; /* at the start */
extern const amb_real amb_data_hover[2]; /* current that holds the rotor [A], and per metre */
extern const amb_magnet amb_data_magnet; /* what the filter knows of its magnet */
extern const void *const amb_data_own;   /* what only its kind has, or NULL */

/* Other variances: of the measurement [m^2], of the control signal [V^2], and the growth of the
 * disturbance force's variance [N^2/s]. Returns as amb_kalman_init does. */
amb_status amb_filter_tune(amb_kalman *filter, amb_real measurement, amb_real control,
                           amb_real growth);

/* The estimator that a filter is, for as long as the filter stays where it is. */
amb_estimator amb_filter_estimator(const amb_kalman *filter);

/* At rest at x [m], where the sensor shows x_m [m] and a current [A] holds the rotor; the result is
 * that of no sample yet. */
void amb_filter_start(const amb_kalman *filter, amb_data_state *state, amb_kalman_result *result,
                      amb_real x, amb_real x_m, amb_real current);

/* Write the standard deviations of the states, one after the other. */
void amb_filter_show_std(const amb_kalman *filter, const amb_data_state *state, double *std);

#endif
