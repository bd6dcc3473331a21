/* The filter of a model, its data, and how it is tuned and started. */
#ifndef AMBKIT_FMU_FILTER_H
#define AMBKIT_FMU_FILTER_H

#include "ambkit/law_error.h"
#include "data.h"

/* Written by the export; data.h has AMB_DATA_METHODS, the kind, and its state amb_data_state. */
extern const amb_kalman_settings amb_data_settings;
extern const amb_model amb_data_model;
extern const amb_real amb_data_std[AMB_STATES];  /* at the start */
extern const amb_real *const amb_data_law_error; /* of the force law, or NULL: none */
extern const amb_real *const amb_data_gain;      /* sensors x states; NULL: not constant */
/* At the start: the rotor in the middle without current, and what each metre along an axis and each
 * ampere adds. Where the first readings show it: of several axes the middle, and what each metre of
 * a reading adds; of one, NULL, the current that holds it there [A], and per metre. */
extern const amb_real amb_data_rest[AMB_STATES];
extern const amb_real amb_data_by_place[AMB_STATES * AMB_CONTROLS];
extern const amb_real amb_data_by_current[AMB_STATES * AMB_CONTROLS];
extern const amb_real *const amb_data_start;
extern const amb_real *const amb_data_start_by;
extern const amb_real amb_data_levitation[2];
extern const amb_magnet amb_data_magnet[AMB_FORCES]; /* what the filter knows of its magnets */
extern const void *const amb_data_own;               /* what only its kind has, or NULL */

/* With the variances among the values. Returns as amb_kalman_init does. */
amb_status amb_filter_tune(amb_kalman *filter, const double value[]);

/* The estimator that a filter is, for as long as the filter stays where it is; its model is anew
 * that of this process, as a state may come from another. */
amb_estimator amb_filter_estimator(amb_kalman *filter);

/* The states of a rotor at rest at these places along the axes [m], with these currents [A] ... */
void amb_filter_at(const amb_real place[], const amb_real current[], amb_real mean[AMB_STATES]);

/* ... and where the readings y [m] show it, or in the middle where one is beyond the stops. */
void amb_filter_shown(const amb_kalman *filter, const amb_real y[], amb_real mean[AMB_STATES]);

/* At these states; the result is that of no sample yet. */
void amb_filter_start(amb_kalman *filter, amb_data_state *state, amb_kalman_result *result,
                      const amb_real mean[AMB_STATES]);

/* After a sample, the bias of the states by the error of the force law (ambkit/law_error.h). */
void amb_filter_carry(const amb_kalman *filter, const amb_data_state *state,
                      const amb_kalman_result *result, bool first, amb_real bias[AMB_STATES]);

/* Write the standard deviations of the states, with the carried bias; NULL: that at rest. */
void amb_filter_show_std(const amb_data_state *state, const amb_real carried[], double *std);

#endif
