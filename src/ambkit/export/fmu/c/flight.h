/* A complete controller (estimator, controllers, lift-off and landing), its data and its start. */
#ifndef AMBKIT_FMU_FLIGHT_H
#define AMBKIT_FMU_FLIGHT_H

#include "ambkit/control.h"
#include "filter.h"

/* Written by the export; data.h has AMB_DATA_PIDS, their number, AMB_DATA_SEQUENCED with lift-off
 * and landing, and AMB_DATA_TURNING with the speed of rotation as an input. */
extern const amb_control amb_data_control; /* without its estimator */
extern const bool amb_data_levitated;      /* whether it starts levitated, or at power-on */
/* The integrals that hold the levitated rotor at the start: at the centre with these currents [A],
 * plus a term per ampere along each axis [1] and per metre [A/m]. */
extern const amb_real amb_data_integral[AMB_DATA_PIDS];
extern const amb_real amb_data_integral_by_current[AMB_DATA_PIDS * AMB_CONTROLS];
extern const amb_real amb_data_integral_by_place[AMB_DATA_PIDS * AMB_CONTROLS];
extern const amb_real amb_data_current[AMB_CONTROLS]; /* [A] */
extern const amb_real amb_data_bias[AMB_CONTROLS];    /* of each coil of a levitated rotor [A] */
extern const int amb_data_coils[AMB_CONTROLS];        /* coils per axis, 1 or 2 */

amb_control amb_flight_control(const amb_estimator *estimator);

/* At these displacements [m], where the currents [A] hold the rotor; the estimator is already set.
 * */
void amb_flight_start(const amb_control *control, amb_control_state *state, void *filter,
                      amb_control_output *output, const amb_real place[], const amb_real current[]);

/* The command to levitate and the speed of rotation [rad/s], from the inputs. */
bool amb_flight_wanted(const double value[]);
amb_real amb_flight_speed(const double value[]);

/* Write its mode. */
void amb_flight_show(const amb_control_output *output, double value[]);

#endif
