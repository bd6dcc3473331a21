/* A closed-loop run in one call: plant, amplifiers, sensors, controllers, estimator. */
#ifndef AMBKIT_SIM_LOOP_H
#define AMBKIT_SIM_LOOP_H

#include "ambkit/control.h"
#include "ambkit/estimator_run.h"
#include "plant.h"

/* A controller and a plant provided by the caller, in place of the built-in ones; NULL: built in.
 * */
typedef struct amb_own {
  /* From readings y (sensors) [m], references r (axes) [m] and the estimator's states, or NULL, to
   * the demanded control currents iu (axes) [A]. */
  void (*control)(void *self, const amb_real y[], const amb_real r[], const amb_real mean[],
                  amb_real iu[]);
  void *controller;
  /* From control currents iu (axes) [A] and disturbance forces (axes) [N], held over a sample, to
   * the plant's states X at the next: displacements, velocities and sensor outputs [m]. Returns
   * true if a stop was touched. */
  bool (*move)(void *self, const amb_real iu[], const amb_real load[], amb_real X[]);
  void *plant;
} amb_own;

/* Information on the rotation at a sample: the fields of amb_rotation for the previous interval
 * (ambkit/turning.h), and the speed at its end. */
#define AMB_ROTATION_FIELDS 11

typedef struct amb_loop {
  amb_plant plant;
  amb_real T;             /* sampling time [s] */
  const amb_real *k_ui;   /* [axes]: amplifier gains [A/V] */
  const amb_real *iu_min; /* [axes]: limits of the control currents [A] */
  const amb_real *iu_max;
  const amb_estimator *estimator; /* or NULL */
  bool feedback_estimate; /* the estimate feeds the controllers: a PID by position and velocity,
                             which the model must have; else the measurement does */
  amb_pid pid;            /* PID of one axis ... */
  const amb_controllers *controllers; /* ... or controllers in its place; or NULL */
  const amb_control *control; /* complete controller with this estimator, in place of both; or NULL.
                                 While it is off, magnets have no current, not even the bias. */
  void (*turn)(void *model, amb_real before, amb_real after); /* sets the speeds of two samples in
                                                                 the estimator's model, or NULL */
  amb_real (*turn_by)(void *model, void *estimator,
                      const amb_real rotation[]); /* updates the estimator's state
                                                  from the information on the
                                                  rotation, and returns the
                                                  known speed; or NULL */
  void *model;
  amb_own own;
} amb_loop;

/* State of the loop. Start with `sampled` false. */
typedef struct amb_loop_state {
  amb_plant_state plant;
  amb_pid_state pid[AMB_CONTROLS];
  amb_kalman_result result;        /* last result of the estimator, if there is one */
  amb_status status;               /* flags of estimator and controllers */
  amb_real y[AMB_SENSORS];         /* last measurements [m] */
  amb_real u[AMB_CONTROLS];        /* control signals from that sample to the next [V] */
  amb_real demanded[AMB_CONTROLS]; /* demanded control currents, with noise, limited [A] */
  amb_acting acting[AMB_CONTROLS]; /* effect just after the sample */
  amb_control_state control;
  amb_control_output control_output; /* last output of `control` */
  amb_real speed;                    /* speed of rotation known to the estimator [rad/s] */
  bool sampled;                      /* whether there was a sample */
} amb_loop_state;

/* External inputs at a sample, held to the next. */
typedef struct amb_loop_sample {
  const amb_real *r;       /* [axes]: references [m] */
  const amb_real *load;    /* [axes]: disturbance forces [N] */
  const amb_real *noise_u; /* [axes]: on the control signals [V] */
  const amb_real *noise_y; /* [sensors]: on the measurements [m] */
  const amb_real *base;    /* [3]: accelerations of the foundation [m/s^2]; NULL: none */
  const amb_real *speed;   /* [2]: speed of rotation, here and at the next sample [rad/s]; NULL: the
                              axis's own */
  const amb_real *rotation; /* [AMB_ROTATION_FIELDS]: information on it for estimator and
                            controllers; NULL: exact */
  amb_real scale;           /* factor of the magnet forces, with the bias [1] */
  bool off;                 /* magnets have no current, not even the bias */
  bool fly;                 /* command to levitate, for `control` */
} amb_loop_sample;

/* One sample, then the plant to the next; `estimator` is the state of the loop's estimator. Returns
 * true if a stop was touched. */
bool amb_loop_step(const amb_loop *loop, amb_loop_state *state, void *estimator,
                   const amb_loop_sample *sample);

/* Faults between plant, controllers and estimator, n samples row by row, all arrays required. A
 * measurement y for controllers and estimator is y_times y' + y_plus, with y' the true one `late`
 * samples earlier, interpolated linearly; before the first sample it is the first one. The
 * estimator alone receives u_times u + u_plus for a control signal u. Any value is allowed, NaN and
 * infinity too. */
typedef struct amb_loop_faults {
  bool beside;          /* controllers get the true measurements, only the estimator the faulty ones
                         */
  const amb_real *late; /* n x sensors [samples], >= 0 */
  const amb_real *y_times; /* n x sensors [1] */
  const amb_real *y_plus;  /* n x sensors [m] */
  const amb_real *u_times; /* n x axes [1] */
  const amb_real *u_plus;  /* n x axes [V] */
  const amb_real *current; /* n x axes: share of the amplifier's range that remains [1], 0 to 1 */
} amb_loop_faults;

/* External inputs, n samples each, row by row. The caller generates the noise (many.h), so that a
 * run can be repeated with recorded noise. */
typedef struct amb_loop_input {
  size_t n;
  const amb_real *r;             /* n x axes: references [m] */
  const amb_real *load;          /* n x axes: disturbance forces [N] */
  const amb_real *noise_u;       /* n x axes: on the control signals [V] */
  const amb_real *noise_y;       /* n x sensors: on the measurements [m] */
  const amb_real *scale;         /* n: factor of the magnet forces, with the bias [1]; NULL: 1 */
  const amb_loop_faults *faults; /* NULL: none */
  const amb_real *fly;           /* n: command to levitate, 1 or 0, for `control`; NULL: 1 */
  const amb_real *speed;         /* n + 1: speed of rotation [rad/s]; NULL: the axis's own */
  const amb_real *rotation;      /* n x AMB_ROTATION_FIELDS: information on it for estimator and
                                 controllers; NULL: exact */
  const amb_real *base;          /* n x 3: accelerations of the foundation [m/s^2]; NULL: none */
  const amb_real *on; /* n: 0 while magnets have no current, not even the bias, else 1; NULL: 1 */
} amb_loop_input;

/* Destinations of the results, n samples each; with several axes or sensors row by row. */
typedef struct amb_loop_output {
  amb_real *const *X; /* [columns]: the first states of the plant, each in a separate array */
  int columns;
  amb_real *iu; /* control currents just after the sample [A]; constant to the next unless the plant
                   has amplifier dynamics or a dead time */
  amb_real *force;             /* of the magnets, relative to their bias forces [N] */
  amb_real *y;                 /* measurements received by the estimator [m] */
  amb_real *u;                 /* control signals from this sample to the next, as known to the
                                  estimator [V] */
  amb_kalman_history estimate; /* used if there is an estimator */
  amb_real *voltage[2];   /* of each coil of one axis just after the sample [V]; NULL: not needed */
  unsigned char *at_stop; /* 1 if a stop was touched, else 0 */
  unsigned char *mode;    /* of `control` (amb_flight_mode) ... */
  unsigned char *usable;  /* ... and whether its input was usable; NULL: not needed */
  unsigned short *status; /* flags of estimator and controllers; NULL: not needed */
} amb_loop_output;

/* Runs n samples from the given state, which is at the end of the run afterwards, so that another
 * run can continue from there, with another estimator if needed. Returns the flags of the
 * estimator. */
amb_status amb_loop_run(const amb_loop *loop, const amb_loop_input *in, amb_loop_state *state,
                        void *estimator, amb_loop_output *out);

#endif
