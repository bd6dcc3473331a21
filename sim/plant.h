/* The nonlinear plant between two samples: force law, gravity, disturbance, sensor lag, stops. */
#ifndef AMBKIT_SIM_PLANT_H
#define AMBKIT_SIM_PLANT_H

#include "ambkit/magnet.h"

typedef struct amb_plant {
  amb_magnet magnet; /* force relative to the bias force */
  amb_real m;        /* mass of the rotor [kg] */
  amb_real f_0;      /* weight and bias force [N] */
  amb_real K_sen;    /* sensor gain [1] */
  amb_real T_sen;    /* sensor lag [s], > 0 */
  amb_real travel;   /* mechanical stop at +-travel [m] */
  int substeps;      /* Runge-Kutta steps in a sample, >= 1 */
} amb_plant;

typedef struct amb_plant_state {
  amb_real x, v; /* [m], [m/s] */
  amb_real x_m;  /* lagged position, times sensor gain [m] */
} amb_plant_state;

/* Force on the rotor without the disturbance [N]. */
amb_real amb_plant_force(const amb_plant *plant, amb_real iu, amb_real x);

/* Advance by T [s] with the control current iu [A] and the disturbance f_d [N] held: classical
 * Runge-Kutta of order 4 with fixed substeps (Kutta 1901). At a stop the rotor stays, without
 * bouncing, until the force pulls it off. Returns true where a stop was touched. */
bool amb_plant_advance(const amb_plant *plant, amb_plant_state *state, amb_real T, amb_real iu,
                       amb_real f_d);

#endif
