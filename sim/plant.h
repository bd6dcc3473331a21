/* The nonlinear plant between two samples: force law, gravity, disturbance, sensor lag, stops. */
#ifndef AMBKIT_SIM_PLANT_H
#define AMBKIT_SIM_PLANT_H

#include "ambkit/magnet.h"
#include "parts.h"

typedef struct amb_plant {
  amb_magnet magnet;      /* force relative to the bias force */
  amb_real m;             /* mass of the rotor [kg] */
  amb_real f_0;           /* weight and bias force [N] */
  amb_real K_sen;         /* sensor gain [1] */
  amb_real T_sen;         /* sensor lag [s], > 0 */
  amb_real travel;        /* mechanical stop at +-travel [m] */
  int substeps;           /* Runge-Kutta steps in a sample, >= 1 */
  const amb_parts *parts; /* or NULL: none */
  amb_magnet coil;        /* pull of one coil of a pair over that of its bias current at x = 0, for
                           * currents that differ; without methods it is not known, and the magnet
                           * gets the mean of both control currents */
} amb_plant;

typedef struct amb_plant_state {
  amb_real x, v; /* [m], [m/s] */
  amb_real x_m;  /* lagged position, times sensor gain [m] */
  /* Of the parts. */
  amb_real i[2];                         /* the coils carry i0 + i[0] and i0 - i[1] [A] */
  amb_real cosine, sine;                 /* of the angle of rotation */
  amb_real demanded[AMB_DELAY_MOST + 2]; /* control currents, the last one first [A] */
} amb_plant_state;

/* What acts on the rotor at a moment. */
typedef struct amb_acting {
  amb_real iu;         /* control current, of a pair the mean of both [A] */
  amb_real force;      /* magnet, weight and bias force [N] */
  amb_real voltage[2]; /* of each coil [V]; 0 where it is not modelled */
} amb_acting;

/* Force on the rotor without the disturbance, the control current iu in all coils [N]. */
amb_real amb_plant_force(const amb_plant *plant, amb_real iu, amb_real x);

/* At rest at x [m], where the control current iu [A] has long been: the sensor has settled. */
void amb_plant_settle(const amb_plant *plant, amb_plant_state *state, amb_real x, amb_real iu);

/* What acts just after a sample at which iu [A] is demanded, before amb_plant_advance ... */
amb_acting amb_plant_from_now(const amb_plant *plant, const amb_plant_state *state, amb_real iu);

/* ... and just before a sample, iu demanded at the one before it. */
amb_acting amb_plant_until_now(const amb_plant *plant, const amb_plant_state *state, amb_real iu);

/* What a sensor with x_m [m] behind its lag and with this noise shows, a multiple of its step [m].
 */
amb_real amb_parts_reading(const amb_parts *parts, amb_real x_m, amb_real noise);

/* Measurement that the sensor gives with this noise [m]. */
static inline amb_real amb_plant_measure(const amb_plant *plant, amb_real x_m, amb_real noise)
{
  return plant->parts != NULL ? amb_parts_reading(plant->parts, x_m, noise) : x_m + noise;
}

/* Advance by the sampling time T [s] with the control current iu [A] demanded at its start and the
 * disturbance f_d [N] held: classical Runge-Kutta of order 4 with fixed substeps (Kutta 1901), with
 * a dead time in pieces between the moments at which the demand changes, in contact with a stop in
 * as many smaller ones as it takes. At a hard stop the rotor stays, without bouncing, until the
 * force pulls it off. Returns true where a stop was touched. */
bool amb_plant_advance(const amb_plant *plant, amb_plant_state *state, amb_real T, amb_real iu,
                       amb_real f_d);

/* How fast the state changes while iu [A] is demanded, with the disturbance f_d [N], at the angle
 * of rotation that the state has: x, v, x_m and i of `rates`, each in its unit over s. Of a rotor
 * that no hard stop holds, and without the dead time. */
void amb_plant_rates(const amb_plant *plant, const amb_plant_state *state, amb_real iu,
                     amb_real f_d, amb_plant_state *rates);

#endif
