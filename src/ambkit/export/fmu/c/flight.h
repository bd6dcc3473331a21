/* A whole controller: estimator, controllers, lift-off and landing; its data, and how it starts. */
#ifndef AMBKIT_FMU_FLIGHT_H
#define AMBKIT_FMU_FLIGHT_H

#include "ambkit/control.h"
#include "filter.h"

/* Written by the export; data.h has AMB_DATA_COILS, how many there are, and AMB_DATA_SEQUENCED
 * where there is lift-off and landing. */
extern const amb_control amb_data_control; /* but for its estimator */
extern const bool amb_data_hovering;       /* whether it starts in flight, or at power-on */
/* The integral that holds the rotor in flight at the start: at x = 0 with this current [A], and
 * what each ampere more adds to it [1], and each metre [A/m]. */
extern const amb_real amb_data_integral[3];
extern const amb_real amb_data_current; /* [A] */
extern const amb_real amb_data_bias;    /* current of each coil in flight [A] */

amb_control amb_flight_control(const amb_estimator *estimator);

/* At x [m], where a current [A] holds the rotor; the estimator knows it already. */
void amb_flight_start(const amb_control *control, amb_control_state *state, void *filter,
                      amb_control_output *flown, amb_real x, amb_real current);

/* Whether the inputs say that it is to fly. */
bool amb_flight_wanted(const double value[]);

/* Write what it is doing. */
void amb_flight_show(const amb_control_output *flown, double value[]);

#endif
