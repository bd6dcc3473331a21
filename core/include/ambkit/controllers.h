/* The controllers of a machine: PIDs of combinations of positions, whose currents are spread
 * over its axes, and feedback of an estimator's states beside them.
 *
 *   e_j  = PID j of reference_j r, position_j x, and velocity_j x
 *   iu_f = sum over j of spread_fj e_j + (gain_0f + speed gain_1f + speed^2 gain_2f) x
 *
 * where x is an estimator's mean without the motion that is left to the rotor, if any is, and iu_f
 * has what balances that besides.
 *
 * One PID an axis is decentralised control; PIDs of translation and tilt decouple them; rows of
 * tilt velocities in gain_1 are cross feedback against gyroscopics; gain_0 alone is the feedback of
 * a linear-quadratic regulator, and all three that of one whose gains follow the speed.
 */
#ifndef AMBKIT_CONTROLLERS_H
#define AMBKIT_CONTROLLERS_H

#include "ambkit/controller.h"

AMB_EXTERN_C_BEGIN

/* Unbalance control: a synchronous motion that the controllers do not react to, with its currents:
 * from the `width` states of the unbalance u, starting at x[from], for the first `moved` states.
 * Both are tabulated at speeds `first`, `first` + `step` and so on, with linear interpolation;
 * below the first it is off, beyond the last it is constant. For backward rotation the step is
 * negative.
 *
 * If the estimated unbalance takes more than AMB_UNBALANCE_FULL of a clearance or of a current
 * limit, its share decreases continuously, to zero at AMB_UNBALANCE_NONE.
 */
typedef struct amb_unbalance_control {
  int nodes; /* >= 2 */
  int from;
  int width;      /* even: x and y of each plane */
  int moved;      /* even: positions, then their velocities */
  amb_real first; /* [rad/s] */
  amb_real step;
  const amb_real *motion;  /* nodes x moved x width [m] or [rad], [m/s] or [rad/s], for 1 kg m */
  const amb_real *current; /* nodes x axes x width [A] */
  const amb_real *reach;   /* axes x moved / 2: share of a clearance per unit of each position */
  const amb_real *ampere;  /* [axes]: share of the current limit per ampere */
} amb_unbalance_control;

#define AMB_UNBALANCE_FULL AMB_C(0.3)
#define AMB_UNBALANCE_NONE AMB_C(0.5)

/* Maximum numbers of states of a motion, states of the unbalance, and axes. */
#define AMB_UNBALANCE_STATES 64
#define AMB_UNBALANCE_WIDTH 16
#define AMB_UNBALANCE_AXES 16

/* Gains over the speed of rotation, independent of its sign: linear between the nodes, constant
 * outside. */
typedef struct amb_gain_schedule {
  int nodes;             /* >= 1 */
  const amb_real *speed; /* [nodes] [rad/s], at least 0 and rising */
  const amb_real *gain;  /* nodes x q x AMB_SCHEDULED: kp, ki, kd, T_f */
} amb_gain_schedule;

#define AMB_SCHEDULED 4

typedef struct amb_controllers {
  int axes;                  /* p */
  int states;                /* n of x */
  int pids;                  /* q */
  const amb_pid *pid;        /* [q] */
  const amb_real *reference; /* q x p, by the axes' references; NULL: one for each PID */
  const amb_real *position;  /* q x n [m] or [rad] */
  const amb_real *velocity;  /* q x n, or NULL: each PID's filtered derivative */
  const amb_real *spread;    /* p x q */
  const amb_real *gain[3];   /* p x n each, or NULL: [A], [A s], [A s^2] per unit of a state */
  const amb_real *iu_min;    /* [p]: limits of the currents [A] */
  const amb_real *iu_max;
  const amb_unbalance_control *unbalance_control; /* or NULL */
  const amb_gain_schedule *schedule;              /* in place of the gains of the PIDs; or NULL */
} amb_controllers;

/* One sample: references r of the axes (p) [m], or of the PIDs (q), states or readings x (n), speed
 * [rad/s]. Writes the commanded currents iu (p) [A] within their limits. Returns the flags of all
 * PIDs, and AMB_SATURATED if a current is at its limit; a gain on a state that is not finite
 * contributes nothing. */
amb_status amb_controllers_step(const amb_controllers *controllers, amb_pid_state pid[],
                                const amb_real r[], const amb_real x[], amb_real speed,
                                amb_real iu[]);

AMB_EXTERN_C_END

#endif
