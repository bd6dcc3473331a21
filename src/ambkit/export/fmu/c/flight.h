/* A whole controller: estimator, controllers, lift-off and landing; its data, and how it starts. */
#ifndef AMBKIT_FMU_FLIGHT_H
#define AMBKIT_FMU_FLIGHT_H

#include "ambkit/control.h"
#include "filter.h"

/* Written by the export; data.h has AMB_DATA_PIDS, how many there are, AMB_DATA_SEQUENCED where
 * there is lift-off and landing, and AMB_DATA_TURNING where the speed of rotation is an input. */
extern const amb_control amb_data_control; /* but for its estimator */
extern const bool amb_data_levitated;      /* whether it starts in flight, or at power-on */
/* The integrals that hold the rotor in flight at the start: in the middle with these currents [A],
 * and what each ampere more along an axis adds [1], and each metre [A/m]. */
extern const amb_real amb_data_integral[AMB_DATA_PIDS];
extern const amb_real amb_data_integral_by_current[AMB_DATA_PIDS * AMB_CONTROLS];
extern const amb_real amb_data_integral_by_place[AMB_DATA_PIDS * AMB_CONTROLS];
extern const amb_real amb_data_current[AMB_CONTROLS]; /* [A] */
extern const amb_real amb_data_bias[AMB_CONTROLS];    /* of each coil in flight [A] */
extern const int amb_data_coils[AMB_CONTROLS];        /* how many an axis has, 1 or 2 */

amb_control amb_flight_control(const amb_estimator *estimator);

/* At these places [m], where currents [A] hold the rotor; the estimator knows it already. */
void amb_flight_start(const amb_control *control, amb_control_state *state, void *filter,
                      amb_control_output *flown, const amb_real place[], const amb_real current[]);

/* Whether the inputs say that it is to fly, and the speed of rotation [rad/s]. */
bool amb_flight_wanted(const double value[]);
amb_real amb_flight_speed(const double value[]);

/* Write what it is doing. */
void amb_flight_show(const amb_control_output *flown, double value[]);

#endif
