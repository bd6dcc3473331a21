/* A whole machine in closed loop. Only beside ambkit/loops.h. */
#ifndef AMBKIT_SIM_MACHINE_H
#define AMBKIT_SIM_MACHINE_H

#include "ambkit/control.h"
#include "ambkit/estimator_run.h"
#include "plant.h"

/* The closed loop. */
typedef struct amb_machine_loop {
  amb_plant plant;
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
                     amb_plant_state *state, const amb_real integral[], void *estimator,
                     amb_machine_output *out);

#endif
