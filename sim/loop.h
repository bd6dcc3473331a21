/* A whole closed-loop run in one call: plant, amplifier, sensor, controller, estimator. */
#ifndef AMBKIT_SIM_LOOP_H
#define AMBKIT_SIM_LOOP_H

#include "ambkit/control.h"
#include "ambkit/estimator_run.h"
#include "plant.h"

/* A whole controller that is elsewhere, such as in a processor in the loop: it is given a sample
 * and says what it demands (`iu`, `on`, `mode`); returns its control signal [V]. */
typedef amb_real amb_elsewhere(void *where, amb_real y, amb_real r, bool fly,
                               amb_control_output *flown);

typedef struct amb_loop {
  amb_plant plant;
  amb_pid pid;
  amb_real T;                     /* sampling time [s] */
  amb_real k_ui;                  /* amplifier gain [A/V] */
  amb_real iu_min, iu_max;        /* its limits [A] */
  const amb_estimator *estimator; /* or NULL; of one sensor and one control */
  bool feedback_estimate;     /* controller fed by the estimated position and velocity, which its
                               * model must have; else by the measurement */
  const amb_control *control; /* the whole controller of this estimator, in the place of the PID; or
                               * NULL. Where it is off, the magnet does not pull, with its bias
                               * neither. */
  amb_elsewhere *elsewhere;   /* in its place; or NULL */
  void *where;
} amb_loop;

/* What changes in the loop from sample to sample. Start with `sampled` false. */
typedef struct amb_loop_state {
  amb_plant_state plant;
  amb_pid_state pid;
  amb_kalman_result result; /* the estimator's last word, where there is one */
  amb_real y;               /* last measurement [m] */
  amb_real u;               /* control signal from that sample to the next [V] */
  amb_real demanded;        /* control current that it asks for, with noise, limited [A] */
  amb_acting acting; /* what acts just after the sample; iu is what is demanded, without parts */
  amb_control_state control;
  amb_control_output flown; /* the controller's last word, where it is whole */
  bool sampled;             /* whether there was a sample */
} amb_loop_state;

/* What comes from outside at a sample, and is held to the next. */
typedef struct amb_loop_sample {
  amb_real r;       /* reference [m] */
  amb_real f_d;     /* disturbance force [N] */
  amb_real noise_u; /* on the control signal [V] */
  amb_real noise_y; /* on the measurement [m] */
  bool fly;         /* what a whole controller is told */
} amb_loop_sample;

/* One sample, and the plant on to the next; `estimator` is the state of the loop's estimator.
 * Returns true where a stop was touched meanwhile. */
bool amb_loop_step(const amb_loop *loop, amb_loop_state *state, void *estimator,
                   const amb_loop_sample *sample);

/* What is wrong between plant, controller and estimator, n samples each, all wanted. The
 * measurement y that both get is y_times y' + y_plus, with y' the true one of `late` samples ago,
 * between two of them on the line through both; before the first sample there is the first. The
 * estimator alone is told u_times u + u_plus of the control signal u. Anything goes, NaN and
 * infinity too. */
typedef struct amb_loop_faults {
  bool beside; /* the controller gets the true measurement, the estimator alone the other */
  const amb_real *late;    /* [samples], >= 0 */
  const amb_real *y_times; /* [1] */
  const amb_real *y_plus;  /* [m] */
  const amb_real *u_times; /* [1] */
  const amb_real *u_plus;  /* [V] */
  const amb_real *current; /* share of the amplifier's range that is left [1], 0 to 1 */
} amb_loop_faults;

/* What comes from outside, n samples each. Noise is drawn by the caller (noise.h), so that a run
 * can be repeated with recorded noise. */
typedef struct amb_loop_input {
  size_t n;
  const amb_real *r;       /* reference [m] */
  const amb_real *f_d;     /* disturbance force [N] */
  const amb_real *noise_u; /* on the control signal [V] */
  const amb_real *noise_y; /* on the measurement [m] */
  const amb_real *scale;   /* of the magnet's force, bias force and all [1]; NULL: 1 throughout */
  const amb_loop_faults *faults; /* NULL: none */
  const amb_real *fly; /* whether it is to fly, 1 or 0, for a whole controller; NULL: it is */
} amb_loop_input;

/* Where the run goes; n samples each, all wanted. */
typedef struct amb_loop_output {
  amb_real *x, *v, *x_m; /* truth at the sample: [m], [m/s], [m] */
  amb_real *iu;          /* control current just after the sample, with noise, limited [A]; held to
                          * the next but for an amplifier or a dead time that the plant may have */
  amb_real *force;       /* magnet, weight and bias force at the sample, with that current [N] */
  amb_real *y;           /* measurement, as the estimator gets it [m] */
  amb_real *u;           /* control signal from this sample to the next, as it is told [V] */
  amb_kalman_history estimate; /* used where there is an estimator */
  size_t touched;              /* samples in which a stop was touched */
  amb_real *voltage[2];        /* of each coil just after the sample [V]; NULL: not wanted */
  unsigned char *at_stop;      /* 1 where one was, else 0; NULL: not wanted */
  unsigned char *mode;         /* of a whole controller (amb_flight_mode); NULL: not wanted */
} amb_loop_output;

/* Runs n samples from the state given, which is left at the end of the run, so that another run
 * goes on from there, with another estimator if need be. Returns the flags that the estimator
 * raised. */
amb_status amb_loop_run(const amb_loop *loop, const amb_loop_input *in, amb_loop_state *state,
                        void *estimator, amb_loop_output *out);

#endif
