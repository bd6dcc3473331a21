/* A whole machine between samples, and in closed loop: the continuous model that the composition
 * gives, the magnets' own force laws, backup bearings, unbalance. Only beside ambkit/loops.h.
 *
 *   dX/dt = (A + speed spin) X + b F + g + unbalance
 *   F_f   = magnet f at its current and its displacement s_f = h_f X, and the load there
 *
 * X: rotor, lagged readings, and currents where amplifiers lag. A sensor that has parts of its own
 * sees more than A tells: the difference is added.
 */
#ifndef AMBKIT_SIM_MACHINE_H
#define AMBKIT_SIM_MACHINE_H

#include "ambkit/control.h"
#include "ambkit/estimator_run.h"
#include "parts.h"

/* A backup bearing: a ring about two axes, or along one axis where the second is -1. */
typedef struct amb_ring {
  int first, second; /* axes */
  amb_real travel;   /* what it leaves [m] */
  amb_parts stop;    /* its stiffness and damping */
} amb_ring;

typedef struct amb_machine {
  int states, axes, sensors;
  amb_sparse A;                  /* states x states, at rest */
  const amb_real *spin;          /* what each entry of A gains by 1 rad/s of rotation */
  amb_sparse b;                  /* states x axes, per newton */
  amb_sparse B_u;                /* states x axes, per ampere demanded */
  amb_sparse h;                  /* axes x states: displacements [m] ... */
  amb_sparse v;                  /* ... and their velocities [m/s] */
  const int *current;            /* [axes]: its state, or -1: the demanded one at once */
  const int *second;             /* [axes]: state of the other coil's control current, or -1 */
  const amb_parts *amplifier;    /* [axes]: corner, and voltage where it is limited */
  const amb_magnet *magnet;      /* [axes] */
  const amb_magnet *coil;        /* [axes]: one coil alone where both differ, or methods NULL */
  const amb_real *none;          /* [axes]: what is told of a magnet without any current [N] */
  const amb_real *farthest;      /* [axes]: no magnet finds the rotor farther away [m] */
  const amb_real *g;             /* [states]: by forces that are always there */
  const amb_real *cosine, *sine; /* [states]: unbalance, by its force ahead and across */
  amb_sparse seen;               /* sensors x states: displacement where it looks [m] */
  const int *base;               /* [3]: states of the velocities along x, y, z, or -1 */
  const int *shows;              /* [sensors]: state of the reading */
  const amb_real *gain, *lag;    /* [sensors]: [1], [s] */
  const amb_parts *sensor;       /* [sensors]: runout, non-linearity, rounding */
  int rings;
  const amb_ring *ring;
  int delay; /* as in parts.h, of all axes */
  amb_real delay_rest;
  int substeps; /* Runge-Kutta steps in a sample, >= 1 */
} amb_machine;

typedef struct amb_machine_state {
  amb_real X[AMB_STATES];
  amb_real cosine, sine;                               /* of the angle of rotation */
  amb_real demanded[AMB_DELAY_MOST + 2][AMB_CONTROLS]; /* the last one first [A] */
  bool off;                                            /* no magnet has any current */
} amb_machine_state;

/* On by a sample of T [s], the speed growing from one to the other [rad/s], with the demanded
 * currents [A], the loads at the axes [N] and the accelerations of the foundation along x, y, z
 * [m/s^2] held. Returns whether a ring was touched. */
bool amb_machine_advance(const amb_machine *machine, amb_machine_state *state, amb_real T,
                         amb_real speed, amb_real next_speed, const amb_real demanded[],
                         const amb_real load[], const amb_real base[3]);

/* Displacement [m] of axis f, its control current [A], the mean of both coils, and the force of its
 * magnet there [N] while iu [A] is demanded. */
amb_real amb_machine_displacement(const amb_machine *machine, const amb_real X[], int f);
amb_real amb_machine_current(const amb_machine *machine, const amb_real X[], int f, amb_real iu);
amb_real amb_machine_force(const amb_machine *machine, const amb_real X[], int f, amb_real iu);

/* The closed loop. */
typedef struct amb_machine_loop {
  amb_machine machine;
  amb_controllers controllers;
  bool feedback_estimate;         /* fed by the estimator's states, else by the readings */
  amb_real T;                     /* sampling time [s] */
  const amb_real *k_ui;           /* [axes]: amplifier gain [A/V] */
  const amb_estimator *estimator; /* or NULL */
  const amb_control *control;     /* NULL; or all of what flies, with lift-off and landing */
  void (*turn)(void *model, amb_real before, amb_real after); /* tells the estimator's model the
                                                                 speeds of two samples, or NULL */
  void *model;
} amb_machine_loop;

/* n samples, row by row; noise is drawn by the caller. */
typedef struct amb_machine_input {
  size_t n, off;           /* samples; and from which on the magnets are off, the bias too */
  const amb_real *r;       /* n x axes: reference [m] */
  const amb_real *load;    /* n x axes: disturbance forces [N] */
  const amb_real *base;    /* n x 3: accelerations of the foundation [m/s^2] */
  const amb_real *speed;   /* n + 1: of rotation [rad/s] */
  const amb_real *noise_u; /* n x axes: on the control signals [V] */
  const amb_real *noise_y; /* n x sensors: on the readings [m] */
  const amb_real *fly;     /* n: whether it is told to fly, 1 or 0; NULL: always */
  const amb_real *hover; /* [axes]: `control` takes over a rotor that these hold [A]; NULL: it is at
                          * power-on */
} amb_machine_input;

typedef struct amb_machine_output {
  amb_real *X;            /* n x states: truth at the sample */
  amb_real *iu;           /* n x axes: currents that act just after it [A] */
  amb_real *force;        /* n x axes: of the magnets then [N] */
  amb_real *y;            /* n x sensors [m] */
  amb_real *u;            /* n x axes: control signals from this sample to the next [V] */
  unsigned short *status; /* n: flags of estimator and controllers */
  unsigned char *mode;    /* n: amb_flight_mode of `control`, or NULL ... */
  unsigned char *usable;  /* ... and whether what feeds the controllers could be used */
  amb_kalman_history estimate;
  size_t touched; /* samples in which a backup bearing was touched */
  size_t first;   /* of these the first; n: none */
} amb_machine_output;

/* From the state given, with the PIDs' integrals at these currents [A]. */
void amb_machine_run(const amb_machine_loop *loop, const amb_machine_input *in,
                     amb_machine_state *state, const amb_real integral[], void *estimator,
                     amb_machine_output *out);

#endif
