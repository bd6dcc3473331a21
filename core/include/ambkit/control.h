/* The whole controller of an axis or a machine, in one step from readings to control currents:
 * estimator, what looks after it, controllers, lift-off and landing. The same text is simulated and
 * flies.
 *
 *   x   = estimates, of which loads count from half of the way up on; or readings
 *   iu  = controllers of the reference and x (ambkit/controllers.h), where the currents are on
 *
 * The estimator starts at the first readings between the stops, starts anew where it is no rotor,
 * and can be used where it is settled and not too long without a reading. With that, and with
 * currents that do not stay at their limits, the rotor lifts, flies and lands (ambkit/sequence.h).
 * As it lifts, integrals start at what holds a rotor where this one lies.
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
  const amb_sequence *sequence; /* NULL: it flies from the start, and nobody looks after it */
  bool feedback_estimate;       /* the controllers see the estimate, else the readings */
  unsigned int settling;        /* samples until an estimate is settled; it is used as long without
                                 * a reading */
  amb_real bound;               /* a mean beyond so many caps (ambkit/envelope.h) is none */
  const amb_real *std;          /* [n]: of the states at the start */
  const amb_real *start;        /* [n]: states of a rotor at rest in the middle ... */
  const amb_real *start_by;     /* n x m: and what 1 m of each reading adds */
  const amb_real *place;        /* p x n: what the references are of, places along the axes */
  const amb_real *down;         /* [p]: where the rotor lies when it has landed [m] */
  const amb_real *hold;         /* [q]: integrals that hold a rotor at place 0 [A] ... */
  const amb_real *hold_by;      /* q x p: and what 1 m of each place adds [A/m] */
  amb_real excess; /* by which share the rotor is heavier than in the estimator's model, whose loads
                    * are in parts of that [1] */
} amb_control;

/* What a controller works by. The pointer stands three times: nothing else tells that a bit of it
 * has flipped in memory. */
typedef struct amb_works_by {
  const amb_control *control;
  const amb_control *copy[2];
} amb_works_by;

/* Let it work by this, between two steps: a slower task may, which the sampling interrupts. */
void amb_work_by(amb_works_by *works_by, const amb_control *control);

/* What it works by, the one of three of which two are equal, or `otherwise` where no two are; all
 * are then that one. */
const amb_control *amb_working_by(amb_works_by *works_by, const amb_control *otherwise);

typedef struct amb_control_state {
  amb_pid_state pid[AMB_CONTROLS];
  amb_real u[AMB_CONTROLS];    /* control signals that act since the last sample [V] */
  amb_real from[AMB_CONTROLS]; /* where the rotor lay along the axes [m] */
  amb_sequence_state sequence;
  unsigned int doubted; /* samples until the estimate is settled again */
  unsigned int missed;  /* samples in a row without a reading that was used */
  bool started;         /* whether the estimator was started */
  bool sampled;         /* and whether there was a sample since */
  bool limited;         /* whether a current was at its limit */
} amb_control_state;

/* What one step leaves behind besides the states. */
typedef struct amb_control_output {
  amb_real iu[AMB_CONTROLS]; /* control currents demanded [A]; 0 where they are off */
  bool on;                   /* whether there are currents: else the bias is off too */
  bool usable;               /* whether what feeds the controllers can be used */
  amb_flight_mode mode;
  amb_kalman_result estimator; /* what the estimator said */
} amb_control_output;

/* At power-on: off, and the estimator (`filter`: its state) in the middle until there are readings.
 */
void amb_control_init(const amb_control *control, amb_control_state *state, void *filter);

/* In flight, taken over from another controller: the estimator's state is set by the caller, and
 * these are the control currents that act, iu (p) [A], and the integrals (q) [A]. */
void amb_control_levitate(const amb_control *control, amb_control_state *state, const amb_real iu[],
                          const amb_real integral[]);

/* The same, the estimator too: it starts at the readings y (m) [m], as if the rotor were at rest,
 * and integrals at what holds it there. */
void amb_control_transfer(const amb_control *control, amb_control_state *state, void *filter,
                          const amb_real y[AMB_SENSORS], const amb_real iu[]);

/* One sample: readings y (m) [m], references r (p) [m], speed of rotation [rad/s], and whether it
 * is to fly. Returns the sum of all flags. */
amb_status amb_control_step(const amb_control *control, amb_control_state *state, void *filter,
                            const amb_real y[AMB_SENSORS], const amb_real r[], amb_real speed,
                            bool fly, amb_control_output *out);

AMB_EXTERN_C_END

#endif
