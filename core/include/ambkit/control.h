/* Controller of an axis or a machine: one step from readings to control currents, with estimator,
 * supervision, controllers, lift-off and landing. The same source is simulated and exported.
 *
 *   x   = readings, or estimates, whose disturbance forces are used from half of the lift on
 *   iu  = controllers of the reference and x (ambkit/controllers.h), while the currents are on
 *
 * The estimator starts at the first readings between the stops, and restarts if it is implausible.
 * It is usable once it has settled and unless readings have been missing for too long. Its use and
 * currents that stay at their limits control lift-off, landing and trip (ambkit/sequence.h).
 * Integrals start, at lift-off, at the currents that hold the rotor at its contact position.
 */
#ifndef AMBKIT_CONTROL_H
#define AMBKIT_CONTROL_H

#include "ambkit/controllers.h"
#include "ambkit/estimator.h"
#include "ambkit/sequence.h"

AMB_EXTERN_C_BEGIN

/* Sizes: n states, m readings, p axes, q PIDs. */
typedef struct amb_control {
  const amb_estimator *estimator;
  const amb_controllers *law;
  const amb_sequence *sequence; /* NULL: levitated from the start, without monitoring */
  bool feedback_estimate;       /* the controllers use the estimate, else the readings */
  unsigned int settling;        /* samples until an estimate is settled; also the longest outage for
                                   which it is used */
  amb_real bound;               /* a mean beyond this many caps (ambkit/envelope.h) is invalid */
  const amb_real *std;          /* [n]: initial standard deviations of the states */
  const amb_real *start;        /* [n]: states of a rotor in equilibrium at the centre ... */
  const amb_real *start_by;     /* n x m: ... and their change per metre of each reading */
  const amb_real *place;        /* p x n: displacements along the axes, to which the references
                                   apply */
  const amb_real *down;         /* [p]: position of the rotor in contact, after landing [m] */
  const amb_real *hold;         /* [q]: integrals in equilibrium at the centre [A] ... */
  const amb_real *hold_by;      /* q x p: ... and their change per metre of displacement [A/m] */
  amb_real excess; /* relative mass error of the estimator's model, in whose terms its disturbance
                      forces are [1] */
} amb_control;

/* The constants of a controller. The pointer exists three times, to detect a bit flip in memory. */
typedef struct amb_works_by {
  const amb_control *control;
  const amb_control *copy[2];
} amb_works_by;

/* Switch to these constants, between two steps: permitted for a slower task, which the sampling
 * interrupts. */
void amb_work_by(amb_works_by *works_by, const amb_control *control);

/* Constants in use: the pointer of which two copies agree, or `otherwise` if none do; all copies
 * are repaired. */
const amb_control *amb_working_by(amb_works_by *works_by, const amb_control *otherwise);

typedef struct amb_control_state {
  amb_pid_state pid[AMB_CONTROLS];
  amb_real u[AMB_CONTROLS];    /* control signals that have acted since the last sample [V] */
  amb_real from[AMB_CONTROLS]; /* contact position along the axes [m] */
  amb_sequence_state sequence;
  unsigned int doubted; /* samples until the estimate has settled again */
  unsigned int missed;  /* consecutive samples without a used reading */
  bool started;         /* whether the estimator was started */
  bool sampled;         /* and whether there was a sample since */
  bool limited;         /* whether a current was at its limit */
} amb_control_state;

/* Results of a step besides the states. */
typedef struct amb_control_output {
  amb_real iu[AMB_CONTROLS]; /* commanded control currents [A]; 0 while off */
  bool on;                   /* whether there are currents: otherwise the bias is off too */
  bool usable;               /* whether the controllers' input is usable */
  amb_flight_mode mode;
  amb_kalman_result estimator; /* results of the estimator */
} amb_control_output;

/* At power-on: off, with the estimator (`filter`: its state) at the centre until there are
 * readings. */
void amb_control_init(const amb_control *control, amb_control_state *state, void *filter);

/* Levitated, transferred from another controller: the caller sets the estimator's state, and passes
 * the acting control currents iu (p) [A] and the integrals (q) [A]. */
void amb_control_levitate(const amb_control *control, amb_control_state *state, const amb_real iu[],
                          const amb_real integral[]);

/* The same with an initial estimate: the estimator starts at the readings y (m) [m], as in
 * equilibrium, with the corresponding integrals. */
void amb_control_transfer(const amb_control *control, amb_control_state *state, void *filter,
                          const amb_real y[AMB_SENSORS], const amb_real iu[]);

/* One sample: readings y (m) [m], references r (p) [m], speed of rotation [rad/s], and the command
 * to levitate. Returns the sum of all flags. */
amb_status amb_control_step(const amb_control *control, amb_control_state *state, void *filter,
                            const amb_real y[AMB_SENSORS], const amb_real r[], amb_real speed,
                            bool fly, amb_control_output *out);

/* Before a step: the magnets carried no current since the last sample, as in a power failure. The
 * estimator predicts without magnet forces (amb_deenergise), and with a sequence the rotor trips.
 */
void amb_control_deenergise(const amb_control *control, amb_control_state *state, void *filter);

AMB_EXTERN_C_END

#endif
