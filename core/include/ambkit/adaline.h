/* Two adaptive linear elements (ADALINE), learning by the normalised Widrow-Hoff rule.
 *
 * The first (paper, eq. 24) finds the force of the magnet from the motion: in
 *     x(k+1) = 1 x(k) + T v(k) + T^2/2m (F_St + F_0) + T^2/2m F_Magnet
 * the weight F_Magnet is adapted; or rather, for the reason that stands in adaline.c, in the other
 * row of the same motion, v(k+1) = v(k) + T/m (F_St + F_0) + T/m F_Magnet. The second (eq. 25)
 * finds the magnet constant in F_Magnet = k phi,   phi = ((i0+iu)/(s0-x))^2 - ((i0-iu)/(s0+x))^2.
 * The rule is  w += rate * input * error / input^2,  stable for 0 < rate < 2; a step of rate r
 * averages over about 2/r samples: the error of k settles as (1 - r)^n and the noise that is left
 * has the variance r/(2 - r) of one sample's.
 *
 * Twice differentiating a measured position would drown the force in noise (2m/T^2 = 1e8 N/m on
 * the paper's rig), so position and phi first pass the same second-order low-pass, and phi the lag
 * that the first element's own learning has: both sides of eq. 25 are delayed alike, and k comes
 * out without bias. The regressor passes the sensor's lag as well, so that it belongs to the same
 * instant as the measured position.
 *
 * Without force there is nothing to learn k from: while the excitation (root mean square of phi
 * over the learning time, relative to phi at iu = i0, x = 0) is below its limit, k is held.
 */
#ifndef AMBKIT_ADALINE_H
#define AMBKIT_ADALINE_H

#include "ambkit/closed.h"
#include "ambkit/status.h"

AMB_EXTERN_C_BEGIN

typedef struct amb_adaline {
  amb_law law;             /* s0, i0, two_sided; its k is not used */
  amb_real T;              /* sampling time [s] */
  amb_real m;              /* mass of the rotor [kg] */
  amb_real K_sen;          /* sensor gain [1] */
  amb_real a_sen;          /* exp(-T / T_sen): transition of the sensor over a sample [1] */
  amb_real k_ui;           /* amplifier gain [A/V] */
  amb_real iu_min, iu_max; /* limits of the control current [A] */
  amb_real f_0;            /* known force besides the magnet's: the weight [N] */
  amb_real bandwidth;      /* of the low-pass [rad/s] */
  amb_real rate_force;     /* learning rates [1], in (0, 2) */
  amb_real rate_k;
  amb_real least_excitation; /* k is held below this [1] */
} amb_adaline;

typedef struct amb_adaline_state {
  amb_real x, v;                  /* low-passed position [m] and its derivative [m/s] */
  amb_real phi, phi_dot;          /* low-passed regressor [A^2/m^2] and its derivative */
  amb_real phi_late;              /* phi with the same delay as the identified force */
  amb_real load, load_dot;        /* low-passed known disturbance [N] and its derivative */
  amb_real phi_shown, load_shown; /* regressor and disturbance with the sensor's lag */
  amb_real force;                 /* identified force of the magnet, low-passed [N] */
  amb_real k;                     /* identified magnet constant [N m^2/A^2] */
  amb_real excitation;            /* mean square of phi over that of the reference [1] */
  amb_real last_y;                /* last good measurement [m] */
  bool started;
} amb_adaline_state;

void amb_adaline_reset(amb_adaline_state *state, amb_real k);

/* One sample: measurement y [m], control signal u [V] that acted since the last one, known
 * disturbance force f_d [N]. Returns AMB_OK, AMB_UNEXCITED (k held), AMB_MISSING (y is not finite,
 * or outside the air gap) or AMB_BAD_CONTROL (u or f_d is not finite), without learning. */
amb_status amb_adaline_step(const amb_adaline *a, amb_adaline_state *state, amb_real y, amb_real u,
                            amb_real f_d);

AMB_EXTERN_C_END

#endif
