/* Fault isolation: which fault explains the innovations of a filter.
 *
 * A fault of size theta acts on the rotor along forces, on the measurements along sensors, or on
 * both. It moves the filter's error, and so its innovations e (linearised at the operating point):
 *
 *   d  <- A d + sum over forces f of b_f (rho_f theta)              between two samples
 *   e_r = H_r d + rho_r theta,   d <- d - K_r e_r                   sensors one after the other
 *
 * Each rho is a sum of signals of the running filter with fixed weights: the force of a magnet for
 * its constant, the reading for the gain of a sensor, 1 for its offset. Faults are data: signals,
 * directions and weights. Innovations are white with variance S where nothing is wrong, so a fault
 * that begins at sample t has the log likelihood ratio (Willsky and Jones 1976)
 *
 *   l(t) = g(t)^2 / M(t),      g = sum of e s / S,  M = sum of s^2 / S,  s: innovation by theta = 1
 *
 * (twice that of the textbook). A sweep from the newest sample back has g and M of all faults and
 * all t at once: with the information of (d, theta) in the samples from t on,
 *
 *   Z = sum of (de/dd)' (de/dd) / S,   Y = sum of (de/dd)' s / S,   z = sum of (de/dd)' e / S.
 *
 * A fault that was there before the window is tested too, with any d at its start. What l leaves of
 * the innovations gives their scale, so that a filter with the wrong noise does not accuse.
 *
 * The sweep is linear in the sizes. The faults and pairs that it makes likely are replayed: the
 * error d that they make is stepped through the window with the signals of the rotor, which are
 * those of the estimate and their gradient by d, and sizes and begin are fitted (Gauss and Newton).
 *
 * A fault is excluded where the named one explains more: by the margin, by the share that
 * signatures may miss, and by what the named one leaves that is correlated; of two, by that share
 * of what each adds to the other. Two are named where they explain more than any one: by the limit,
 * by twice that share, and by three times what they leave.
 *
 * Where a reading shows the rotor on a stop, whose force is unknown, the state's `contact` is 0,
 * and no fault is named until two windows are free of it.
 *
 * Put each sample in as it comes; evaluate in the background, as it takes some hundred times as
 * long. In between at most `spare` samples may be put.
 */
#ifndef AMBKIT_ISOLATION_H
#define AMBKIT_ISOLATION_H

#include "ambkit/kalman.h"

AMB_EXTERN_C_BEGIN

/* Signals, one after the other: 1; of each force AMB_OF_FORCE, of each sensor AMB_OF_SENSOR; forms
 * of the mean; cosine and sine of each tone. */
#define AMB_OF_FORCE 5  /* F; k_i i; k_s s; F by a late i, less F; half the sum of both coils */
#define AMB_OF_SENSOR 2 /* predicted reading; the same with more lag, less itself [m] */

/* Least number of samples that a fault is judged by. */
#define AMB_ISOLATION_LEAST 16

typedef struct amb_fault_term {
  unsigned short column;
  unsigned short direction; /* forces, then sensors */
  unsigned short signal;
  unsigned short gradient; /* row of its gradient, from 1 on; 0: not by the filter's error; beyond
                              the last: the reading with more lag of a sensor */
  amb_real weight;
} amb_fault_term;

typedef struct amb_fault {
  unsigned short column; /* the first of one or two: a tone has two */
  unsigned short columns;
  unsigned short load;  /* 1: no fault, but a disturbance force */
  unsigned short group; /* those of a group, such as lag and dead time, look alike; 0: no group */
} amb_fault;

typedef struct amb_isolation {
  int states; /* of the filter, its error in units in which they are alike */
  int forces;
  int sensors;
  int columns;
  int faults;
  int terms; /* in the order of their columns */
  int gradients;
  int forms;
  int tones;
  int window;           /* samples that are searched */
  int spare;            /* samples that may be put while they are searched */
  int late;             /* samples of the late control, at most AMB_ISOLATION_LEAST */
  amb_real limit;       /* l of an alarm [1] */
  amb_real like;        /* share of what is observed that a linearised signature may miss [1] ... */
  amb_real fine;        /* ... one that was replayed ... */
  amb_real alike;       /* ... by which those of a group do not differ */
  amb_real margin;      /* by which l of a fault must exceed that of another to exclude it [1] */
  const amb_real *A;    /* states x states, with the stiffness of the magnets */
  const amb_real *b;    /* forces x states, by 1 N */
  const amb_real *H;    /* sensors x states */
  const amb_real *bias; /* [forces] bias currents [A] */
  const amb_real *unit; /* [states] those of the filter in one of these */
  const amb_real *K;    /* sensors x states, a constant gain; NULL: by the covariance */
  const amb_real *form; /* forms x states */
  const amb_real *gradient;   /* gradients x states: of a signal, by the error of the filter */
  const amb_real *lag;        /* [sensors]: share by which the reading with more lag follows [1] */
  const amb_real *turn;       /* tones x 2: cosine and sine of the angle in a sample */
  const amb_fault *fault;     /* [faults] */
  const amb_fault_term *term; /* [terms] */
} amb_isolation;

/* The caller's memory: ring of (window + spare) x amb_isolation_row() numbers, and as many numbers
 * of work as amb_isolation_work() says. */
typedef struct amb_isolation_state {
  amb_real *ring;
  amb_real *work;
  amb_real mean[AMB_STATES]; /* after the last sample */
  amb_real lagged[AMB_SENSORS];
  amb_real current[AMB_ISOLATION_LEAST + 1][AMB_FORCES];
  volatile int newest;         /* row of the ring */
  volatile int filled;         /* rows */
  volatile unsigned int count; /* samples put */
  volatile int contact;        /* samples since the rotor was on a stop, up to two windows */
  int seen;                    /* samples since the start, up to AMB_ISOLATION_LEAST */
} amb_isolation_state;

/* What an evaluation says of a fault. */
typedef struct amb_isolation_result {
  amb_real likelihood;  /* l over the scale of the innovations [1] */
  amb_real size[2];     /* of its columns, [unit of the fault] */
  amb_real variance[2]; /* of that */
  int since;            /* samples; the window where it was there before */
  bool before;          /* whether it was there before the window */
  int instead; /* the named fault in whose place it explains as much; its own place: it is named;
                * -1: it is excluded */
} amb_isolation_result;

int amb_isolation_row(const amb_isolation *isolation);
int amb_isolation_work(const amb_isolation *isolation);

/* Forget all samples. */
void amb_isolation_reset(const amb_isolation *isolation, amb_isolation_state *state);

/* After a step of the filter: the state that it left, and its result. `faster`: the angle by which
 * the last tone, that of the rotation, turned farther than usual in the sample [rad]. */
void amb_isolation_put(const amb_isolation *isolation, amb_isolation_state *state,
                       const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                       const amb_kalman_state *filter, const amb_kalman_result *result,
                       amb_real faster);

/* Search the window. Writes a result for each fault, and returns how many are named: none, one or
 * two; -1: none, as more than `spare` samples were put meanwhile. They are faults for sure where no
 * load is possible in their place. */
int amb_isolation_evaluate(const amb_isolation *isolation, const amb_isolation_state *state,
                           amb_isolation_result result[]);

/* Information of all columns [columns x columns] of faults that began `since` samples ago, at most
 * the window; `before`: beside any error of the filter at that time. */
void amb_isolation_information(const amb_isolation *isolation, const amb_isolation_state *state,
                               int since, bool before, amb_real information[]);

AMB_EXTERN_C_END

#endif
