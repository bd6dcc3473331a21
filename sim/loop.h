/* A closed-loop run in one call: plant, amplifiers, sensors, controllers, estimator. */
#ifndef AMBKIT_SIM_LOOP_H
#define AMBKIT_SIM_LOOP_H

#include "ambkit/control.h"
#include "ambkit/estimator_run.h"
#include "plant.h"

/* A controller or a plant of the caller's, each in place of ours; NULL: ours. */
typedef struct amb_own {
  /* From readings y (sensors) [m], references r (axes) [m] and the estimator's states, or NULL, to
   * the control currents iu (axes) that are demanded [A]. */
  void (*control)(void *self, const amb_real y[], const amb_real r[], const amb_real mean[],
                  amb_real iu[]);
  void *controller;
  /* From control currents iu (axes) [A] and disturbance forces (axes) [N], held over a sample, to
   * the plant's states X at the next: displacements, velocities, and what the sensors show [m].
   * Returns true where a stop was touched meanwhile. */
  bool (*move)(void *self, const amb_real iu[], const amb_real load[], amb_real X[]);
  void *plant;
} amb_own;

/* What is heard of the rotation at a sample: the fields of amb_rotation within the sample before
 * (ambkit/turning.h), and last the speed there. */
#define AMB_HEARD 8

typedef struct amb_loop {
  amb_plant plant;
  amb_real T;             /* sampling time [s] */
  const amb_real *k_ui;   /* [axes]: amplifier gains [A/V] */
  const amb_real *iu_min; /* [axes]: their limits [A] */
  const amb_real *iu_max;
  const amb_estimator *estimator; /* or NULL */
  bool feedback_estimate; /* controllers are fed by the estimate: a PID by position and velocity,
                           * which its model must have; else by the measurement */
  amb_pid pid;            /* of one axis ... */
  const amb_controllers *controllers; /* ... or, in its place, these; or NULL */
  const amb_control *control; /* all that flies, with this estimator, instead of both; or NULL.
                               * Where it is off, magnets have no current, not even the bias. */
  void (*turn)(void *model, amb_real before, amb_real after); /* tells the estimator's model the
                                                                 speeds of two samples, or NULL */
  amb_real (*turn_by)(void *model, void *estimator, const amb_real heard[]); /* or what is heard,
                                               to its state; returns the speed that is known */
  void *model;
  amb_own own;
} amb_loop;

/* What changes in the loop from sample to sample. Start with `sampled` false. */
typedef struct amb_loop_state {
  amb_plant_state plant;
  amb_pid_state pid[AMB_CONTROLS];
  amb_kalman_result result;        /* the estimator's last word, where there is one */
  amb_status status;               /* flags of estimator and controllers */
  amb_real y[AMB_SENSORS];         /* last measurements [m] */
  amb_real u[AMB_CONTROLS];        /* control signals from that sample to the next [V] */
  amb_real demanded[AMB_CONTROLS]; /* control currents that they ask for, with noise, limited [A] */
  amb_acting acting[AMB_CONTROLS]; /* what acts just after the sample */
  amb_control_state control;
  amb_control_output flown; /* the last word of `control` */
  amb_real speed;           /* of rotation, as the estimator knows it by what is heard [rad/s] */
  bool sampled;             /* whether there was a sample */
} amb_loop_state;

/* What comes from outside at a sample, and is held to the next. */
typedef struct amb_loop_sample {
  const amb_real *r;       /* [axes]: references [m] */
  const amb_real *load;    /* [axes]: disturbance forces [N] */
  const amb_real *noise_u; /* [axes]: on the control signals [V] */
  const amb_real *noise_y; /* [sensors]: on the measurements [m] */
  const amb_real *base;    /* [3]: accelerations of the foundation [m/s^2]; NULL: it stands still */
  const amb_real *speed;   /* [2]: of rotation, here and at the next [rad/s]; NULL: an axis's */
  const amb_real *heard;   /* [AMB_HEARD]: what estimator and controllers know of it; NULL: all */
  amb_real scale;          /* of the magnets' forces, bias and all [1] */
  bool off;                /* magnets have no current, the bias neither */
  bool fly;                /* what `control` is told */
} amb_loop_sample;

/* One sample, and the plant on to the next; `estimator` is the state of the loop's estimator.
 * Returns true where a stop was touched meanwhile. */
bool amb_loop_step(const amb_loop *loop, amb_loop_state *state, void *estimator,
                   const amb_loop_sample *sample);

/* What is wrong between plant, controllers and estimator, n samples row by row, all wanted. A
 * measurement y that both get is y_times y' + y_plus, with y' the true one of `late` samples ago,
 * between two of them on the line through both; before the first sample there is the first. The
 * estimator alone is told u_times u + u_plus of a control signal u. Anything goes, NaN and infinity
 * too. */
typedef struct amb_loop_faults {
  bool beside;          /* controllers get the true measurements, the estimator alone the others */
  const amb_real *late; /* n x sensors [samples], >= 0 */
  const amb_real *y_times; /* n x sensors [1] */
  const amb_real *y_plus;  /* n x sensors [m] */
  const amb_real *u_times; /* n x axes [1] */
  const amb_real *u_plus;  /* n x axes [V] */
  const amb_real *current; /* n x axes: share of the amplifier's range that is left [1], 0 to 1 */
} amb_loop_faults;

/* What comes from outside, n samples each, row by row. Noise is drawn by the caller (many.h), so
 * that a run can be repeated with recorded noise. */
typedef struct amb_loop_input {
  size_t n;
  const amb_real *r;       /* n x axes: references [m] */
  const amb_real *load;    /* n x axes: disturbance forces [N] */
  const amb_real *noise_u; /* n x axes: on the control signals [V] */
  const amb_real *noise_y; /* n x sensors: on the measurements [m] */
  const amb_real *scale;   /* n: of the magnets' forces, bias and all [1]; NULL: 1 throughout */
  const amb_loop_faults *faults; /* NULL: none */
  const amb_real *fly;           /* n: whether it is to fly, 1 or 0, for `control`; NULL: it is */
  const amb_real *speed;         /* n + 1: of rotation [rad/s]; NULL: an axis's */
  const amb_real *heard; /* n x AMB_HEARD: what estimator and controllers know of it; NULL: all */
  const amb_real *base;  /* n x 3: accelerations of the foundation [m/s^2]; NULL: it stands still */
  size_t off; /* the magnets have no current from this sample on; n: they have throughout */
} amb_loop_input;

/* Where the run goes; n samples each. Of several axes or sensors row by row. */
typedef struct amb_loop_output {
  amb_real *const *X; /* [columns]: the first states of the plant, as columns of their own */
  int columns;
  amb_real *iu; /* control currents just after the sample [A]; held to the next but for an amplifier
                 * or a dead time that the plant may have */
  amb_real *force;             /* of the magnets with them, relative to their bias forces [N] */
  amb_real *y;                 /* measurements, as the estimator gets them [m] */
  amb_real *u;                 /* control signals from this sample to the next, as it is told [V] */
  amb_kalman_history estimate; /* used where there is an estimator */
  amb_real *voltage[2];   /* of each coil of one axis just after the sample [V]; NULL: not wanted */
  unsigned char *at_stop; /* 1 where a stop was touched, else 0 */
  unsigned char *mode;    /* of `control` (amb_flight_mode) ... */
  unsigned char *usable;  /* ... and whether what feeds it could be used; NULL: not wanted */
  unsigned short *status; /* flags of estimator and controllers; NULL: not wanted */
} amb_loop_output;

/* Runs n samples from the state given, which is left at the end of the run, so that another run
 * goes on from there, with another estimator if need be. Returns the flags that the estimator
 * raised. */
amb_status amb_loop_run(const amb_loop *loop, const amb_loop_input *in, amb_loop_state *state,
                        void *estimator, amb_loop_output *out);

#endif
