/* Fault isolation: which fault explains the innovations of a filter.
 *
 * A fault of size theta adds forces on the rotor, readings, or both. It changes the filter's error
 * d and so its innovations e (linearised at the operating point):
 *
 *   d  <- A d + sum over forces f of b_f (rho_f theta)              between two samples
 *   e_r = H_r d + rho_r theta,   d <- d - K_r e_r                   sensors one after the other
 *
 * Each rho is a weighted sum of signals of the running filter: the force of a magnet for its
 * constant, the reading for the gain of a sensor, 1 for its offset. Faults are data: signals,
 * directions and weights. Without a fault innovations are white with variance S, so a fault that
 * begins at sample t has the log likelihood ratio (Willsky and Jones 1976; twice the textbook's)
 *
 *   l(t) = g(t)^2 / M(t),      g = sum of e s / S,  M = sum of s^2 / S,  s: innovation by theta = 1
 *
 * A sweep from the newest sample back computes g and M of all faults and all t at once, by the
 * information of (d, theta) in the samples from t on:
 *
 *   Z = sum of (de/dd)' (de/dd) / S,   Y = sum of (de/dd)' s / S,   z = sum of (de/dd)' e / S.
 *
 * A fault older than the window is tested beside an unknown d at the window's start.
 *
 * The faults and pairs that the sweep makes likely are replayed: d is stepped along the window with
 * the forces of the magnets at the rotor, which is where the estimate and d are, and sizes and
 * onset are fitted (Gauss-Newton). Pairs are ranked by their linearised signatures, those of the
 * likeliest fault by the signatures along the run with it.
 *
 * A filter that rejects readings and restarts forgets what tells faults apart. So after a restart
 * the innovations are those of a filter that goes on, with the gains from before, until the one
 * that flies is as certain again and both agree.
 *
 * All l are divided by the scale of the innovations: what the fault leaves of their variance, or
 * their roughness before the window if that is larger. So a filter with wrong noise, or with a load
 * rougher than it assumes, raises no alarm.
 *
 * The named fault excludes another one if it explains more than that: by the margin, by the share
 * that signatures may miss, and by the correlation that it leaves in the residuals; of a pair, by
 * that share of what each adds to the other. A pair is named if it explains more than any single
 * fault: by the limit, by twice that share, and by three times the correlation left. Where two
 * explain more than one by the margin, and by half that share, they are possible instead of it.
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

/* Signals, one after the other: 1; of each force: F less F_0, k_i i, a third of what a larger gap
 * takes from F over its relative change, F by a late i less F, half the sum of both coils; of each
 * sensor: predicted reading, the same with more lag less itself [m]; forms of the mean; cosine and
 * sine of each tone. */
#define AMB_OF_FORCE 5
#define AMB_OF_SENSOR 2
#define AMB_TONES 2 /* at most */
#define AMB_SIGNALS                                                                                \
  (1 + ((AMB_OF_FORCE + 2) * AMB_FORCES) + (AMB_OF_SENSOR * AMB_SENSORS) + (2 * AMB_TONES))

/* Blocks of a quarter of the window that are too recent for the roughness: those that a search
 * sees, and the one that is filled. */
#define AMB_ISOLATION_RECENT 5

/* Least number of samples that a fault is judged by. */
#define AMB_ISOLATION_LEAST 16

typedef struct amb_fault_term {
  unsigned short column;
  unsigned short direction; /* forces, sensors, then forces that act in the first sample only */
  unsigned short signal;
  unsigned short gradient; /* how it depends on the filter's error: 0: not; from 1 on: by the
                              displacement of a force, then rows of `gradient`, then readings with
                              more lag */
  amb_real weight;
} amb_fault_term;

typedef struct amb_fault {
  unsigned short column; /* the first of one or two: a tone has two */
  unsigned short columns;
  unsigned short load;  /* 1: a disturbance force, which is no fault */
  unsigned short group; /* faults of a group, such as lag and dead time, look alike; 0: none */
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
  amb_real like;        /* share of l that a linearised signature may miss [1], ... */
  amb_real fine;        /* ... that a replayed one may, ... */
  amb_real alike;       /* ... and by which faults of a group do not differ */
  amb_real margin;      /* by which l of a fault must exceed that of another to exclude it [1] */
  const amb_real *A;    /* states x states, with the stiffness of the magnets */
  const amb_real *b;    /* forces x states, by 1 N */
  const amb_real *H;    /* sensors x states */
  const amb_real *bias; /* [forces] bias currents [A] */
  const amb_real *F_0;  /* [forces]: of the magnet without control, in the centre [N] */
  const amb_real *unit; /* [states] those of the filter in one of these */
  const amb_real *K;    /* sensors x states, a constant gain; NULL: by the covariance */
  const amb_real *form; /* forms x states */
  const amb_real *h;    /* forces x states: displacement of a magnet by the filter's error */
  const amb_real *k_s;  /* [forces]: position stiffnesses in A [N/m] */
  const amb_real *gradient;   /* gradients x states: of a signal, by the filter's error */
  const amb_real *lag;        /* sensors x 2: shares of the last reading and of its change since by
                                 which the reading with more lag follows [1] */
  const amb_real *turn;       /* tones x 2: cosine and sine of the angle in a sample */
  const amb_fault *fault;     /* [faults] */
  const amb_fault_term *term; /* [terms] */
} amb_isolation;

/* The caller's memory: ring of (window + spare) x amb_isolation_row() numbers, and as many numbers
 * of work as amb_isolation_work() says. */
typedef struct amb_isolation_state {
  amb_real *ring;
  amb_real *work;
  amb_real mean[AMB_STATES];  /* after the last sample */
  amb_real read[AMB_SENSORS]; /* predicted reading */
  amb_real lagged[AMB_SENSORS];
  amb_real current[AMB_ISOLATION_LEAST + 1][AMB_FORCES];
  volatile int newest;         /* row of the ring */
  volatile int filled;         /* rows */
  volatile unsigned int count; /* samples put */
  volatile int contact;        /* samples since the rotor was on a stop, up to two windows */
  bool apart; /* the filter restarted, and the mean is that of a filter that did not, ... */
  int held;   /* ... with the gains of this row ... */
  int holds;  /* ... for so many samples more at most */
  int seen;   /* samples since the start, up to AMB_ISOLATION_LEAST */
  volatile amb_real roughness[AMB_SENSORS]; /* of the innovations before the window, at least 1 */
  amb_real recent[AMB_ISOLATION_RECENT][AMB_SENSORS]; /* sums of e / sqrt(S), the newest first */
  int block;                                          /* samples in the newest sum */
  int blocks;                                         /* that the roughness is of */
} amb_isolation_state;

/* Result of an evaluation for a fault. */
typedef struct amb_isolation_result {
  amb_real likelihood;  /* l over the scale of the innovations [1] */
  amb_real size[2];     /* of its columns, [unit of the fault] */
  amb_real variance[2]; /* of the sizes */
  int since;            /* samples since its onset; the window if it is older */
  bool before;          /* whether it is older than the window */
  int instead; /* the named fault that it could replace; its own index: it is named; -1: it is
                * excluded */
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
 * two; -1: none, as more than `spare` samples were put meanwhile. A named fault is certain if no
 * load could replace it. */
int amb_isolation_evaluate(const amb_isolation *isolation, const amb_isolation_state *state,
                           const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                           amb_isolation_result result[]);

/* Information of all columns [columns x columns] of faults that began `since` samples ago, at most
 * the window; `before`: beside any error of the filter at that time. */
void amb_isolation_information(const amb_isolation *isolation, const amb_isolation_state *state,
                               const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES], int since,
                               bool before, amb_real information[]);

AMB_EXTERN_C_END

#endif
