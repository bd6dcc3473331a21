/* The filter of a model, its data, its parameters and its start. */
#ifndef AMBKIT_FMU_FILTER_H
#define AMBKIT_FMU_FILTER_H

#include "ambkit/law_error.h"
#include "data.h"

/* Written by the export; data.h has AMB_DATA_METHODS, the kind, and its state amb_data_state. */
extern const amb_kalman_settings amb_data_settings;
extern const amb_model amb_data_model;
extern const amb_real amb_data_std[AMB_STATES];  /* at the start */
extern const amb_real *const amb_data_law_error; /* of the force law, or NULL */
extern const amb_real *const amb_data_gain;      /* sensors x states; NULL: not constant */
/* Start: the rotor at the centre without current, plus a term per metre along each axis and per
 * ampere. Or at the first readings: for several axes from the centre, plus a term per metre of each
 * reading; for one axis (NULL) the current that holds it there [A], and its slope. */
extern const amb_real amb_data_rest[AMB_STATES];
extern const amb_real amb_data_by_place[AMB_STATES * AMB_CONTROLS];
extern const amb_real amb_data_by_current[AMB_STATES * AMB_CONTROLS];
extern const amb_real *const amb_data_start;
extern const amb_real *const amb_data_start_by;
extern const amb_real amb_data_levitation[2];
extern const amb_magnet amb_data_magnet[AMB_FORCES]; /* the filter's models of its magnets */
extern const void *const amb_data_own;               /* data of its kind, or NULL */

/* With the variances among the values. Returns as amb_kalman_init. */
amb_status amb_filter_tune(amb_kalman *filter, const double value[]);

/* The estimator of a filter, valid while the filter is not moved. Its model is set again in each
 * process, because a state may come from another one. */
amb_estimator amb_filter_estimator(amb_kalman *filter);

/* The states of a rotor in equilibrium at these displacements along the axes [m], with these
 * currents [A] ... */
void amb_filter_at(const amb_real place[], const amb_real current[], amb_real mean[AMB_STATES]);

/* ... or at the readings y [m]; at the centre if one is beyond the stops. */
void amb_filter_shown(const amb_kalman *filter, const amb_real y[], amb_real mean[AMB_STATES]);

/* Start at these states, without a result. */
void amb_filter_start(amb_kalman *filter, amb_data_state *state, amb_kalman_result *result,
                      const amb_real mean[AMB_STATES]);

/* After a sample: the bias of the states by the error of the force law (ambkit/law_error.h). */
void amb_filter_carry(const amb_kalman *filter, const amb_data_state *state,
                      const amb_kalman_result *result, bool first, amb_real bias[AMB_STATES]);

/* Write the standard deviations of the states with the carried bias; NULL: that in equilibrium. */
void amb_filter_show_std(const amb_data_state *state, const amb_real carried[], double *std);

#endif
