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

/* A motion that goes round with the rotor and is left to it, with the currents that it needs: by
 * the `width` states of the unbalance u, from x[from] on, of the first `moved` states. Both are
 * known at speeds `first`, `first` + `step` and so on, linear in between; before the first there is
 * none, past the last it is that of the last. A rotor that turns backwards has a step below 0.
 *
 * Where the estimated unbalance takes more than AMB_UNBALANCE_FULL of a travel or of a current,
 * less of the motion is left to the rotor, continuously, and from AMB_UNBALANCE_NONE on none. */
typedef struct amb_unbalance_control {
  int nodes; /* >= 2 */
  int from;
  int width;      /* even: x and y of each plane */
  int moved;      /* even: positions, then their velocities */
  amb_real first; /* [rad/s] */
  amb_real step;
  const amb_real *motion;  /* nodes x moved x width [m] or [rad], [m/s] or [rad/s], for 1 kg m */
  const amb_real *current; /* nodes x axes x width [A] */
  const amb_real *reach;   /* axes x moved / 2: share of a travel that each position takes */
  const amb_real *ampere;  /* [axes]: share of the greatest current that 1 A takes */
} amb_unbalance_control;

#define AMB_UNBALANCE_FULL AMB_C(0.3)
#define AMB_UNBALANCE_NONE AMB_C(0.5)

/* The most states of which a motion can be left out, states of the unbalance, and axes. */
#define AMB_UNBALANCE_STATES 64
#define AMB_UNBALANCE_WIDTH 16
#define AMB_UNBALANCE_AXES 16

/* Gains over the speed of rotation, whichever way it turns: linear between the nodes, constant
 * before the first and past the last. */
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
  const amb_real *reference; /* q x p, of the axes' references; NULL: one for each PID */
  const amb_real *position;  /* q x n [m] or [rad] */
  const amb_real *velocity;  /* q x n, or NULL: each PID's filtered derivative */
  const amb_real *spread;    /* p x q */
  const amb_real *gain[3];   /* p x n each, or NULL: [A], [A s], [A s^2] for each unit of a state */
  const amb_real *iu_min;    /* [p]: limits of the currents [A] */
  const amb_real *iu_max;
  const amb_unbalance_control *unbalance_control; /* or NULL */
  const amb_gain_schedule *schedule;              /* in place of the gains of the PIDs; or NULL */
} amb_controllers;

/* One sample: references r of the axes (p) [m], or of the PIDs (q), states or readings x (n), speed
 * [rad/s]. Gives the currents demanded, iu (p) [A], held to their limits. Returns the flags of all
 * PIDs, and AMB_SATURATED where a current is at its limit; a gain that sees a state that is no
 * number gives nothing. */
amb_status amb_controllers_step(const amb_controllers *controllers, amb_pid_state pid[],
                                const amb_real r[], const amb_real x[], amb_real speed,
                                amb_real iu[]);

AMB_EXTERN_C_END

#endif
