/* Many closed loops, each evaluated while it runs, without storing samples; for the host.
 *
 * The results have the bits of amb_loop_run with the noise generated here, for all instruction sets
 * and neighbours. The noise is normal and a function of seed, run, stream and sample only, so that
 * runs can be computed in any order.
 *
 * Philox 4x32-10 (Salmon, Moraes, Dror and Shaw 2011) with the seed as its key; the counter
 * consists of run, stream and half of the sample number. The inverse normal distribution (Wichura
 * 1988, AS 241) follows, accurate to some 1e-16; of libm only the root is used.
 */
#ifndef AMBKIT_SIM_MANY_H
#define AMBKIT_SIM_MANY_H

#include "batch.h"
#include "loop.h"
#include <stdint.h>

/* Key of a noise sequence. */
typedef struct amb_noise_key {
  uint64_t seed, run;
} amb_noise_key;

/* The streams of an axis and its sensor; higher ones are free for the caller. */
#define AMB_NOISE_CONTROL 0U  /* on the control signal */
#define AMB_NOISE_SENSOR 1U   /* white, on the measurement */
#define AMB_NOISE_STREAMS 64U /* distance from the streams of an axis to those of the next */

#define AMB_NOISE_BLOCK 64U /* samples generated together */

/* Figures of a run, of the worst axis where they concern an axis; NaN if not applicable. */
typedef enum amb_figure {
  AMB_X_RMS,        /* errors of the estimates, from sample `first` on [m] */
  AMB_V_RMS,        /* [m/s] */
  AMB_F_D_RMS,      /* [N] */
  AMB_X_PEAK,       /* [m] */
  AMB_V_PEAK,       /* [m/s] */
  AMB_F_D_PEAK,     /* [N] */
  AMB_NIS,          /* mean normalised innovation squared of the measurements used [1] */
  AMB_CONTROL_RMS,  /* reference minus position [m] */
  AMB_CONTROL_PEAK, /* [m] */
  AMB_EFFORT,       /* RMS change of the demanded current [A] */
  AMB_FARTHEST,     /* |x| along an axis, over all samples [m] */
  AMB_CURRENT_PEAK, /* |iu|, over all samples [A] */
  AMB_OVERSHOOT,    /* of the step response [1] */
  AMB_SETTLING,     /* until within 5 % of the step [s]; infinity: not within the window */
  AMB_RECOVERY,     /* after the load, until within the band [s]; infinity: not within the run */
  AMB_LOAD_KEPT,    /* sum of all loads before the first contact with a stop [N] */
  AMB_TOUCHED,      /* samples with contact */
  AMB_LANDED,       /* 1 if there was contact in the last sample */
  AMB_ORBIT_PEAK,   /* radius of the orbit in a bearing, from `first` on [m] ... */
  AMB_ORBIT_SHARE,  /* ... as a share of the clearance there [1] */
  AMB_FIGURES
} amb_figure;

#define AMB_FLAGS 15 /* of ambkit/status.h */

/* Samples over which the figures of an axis are computed, by their numbers. */
typedef struct amb_windows {
  double first;              /* start of the errors */
  double step_from, step_to; /* the last step of the reference, and the next change; equal: none */
  double height, there;      /* height of that step [m], not 0, and the reference after it [m] */
  double load_from;          /* the last change of the load; n: none */
  double band;               /* recovery is within this distance [m] */
  double travel;             /* clearance in the bearing [m] */
} amb_windows;

/* One run of n samples. */
typedef struct amb_many_run {
  const amb_loop *loop;            /* with the estimator, or NULL */
  amb_loop_state state;            /* at rest and reset; at the end of the run afterwards */
  void *estimator;                 /* its state after a reset; at the end of the run afterwards */
  amb_loop_input in;               /* without noise */
  amb_noise_key key;               /* of the noise */
  const double *std_u, *std_y;     /* of the white noise: axes [V], sensors [m]; 0: none */
  const double *noise_u, *noise_y; /* n x axes, n x sensors, in place of it; or NULL */
  amb_sparse along[3];        /* displacements, velocities and loads of the axes as functions of the
                                 estimator's states; without `start`: unknown */
  const amb_windows *windows; /* [axes] */
  double figures[AMB_FIGURES]; /* out */
  size_t flags[AMB_FLAGS];     /* out: number of samples with each flag of the estimator */
} amb_many_run;

/* Runs with the same number here and the same length can go side by side; 0: single runs only. */
unsigned int amb_many_group(const amb_many_run *run);

/* A single run with all its samples in `to`, which must have all arrays; noise is written to the
 * two arrays (n x axes, n x sensors), and contact to `touched` (n,). */
void amb_many_one(amb_many_run *run, amb_real *noise_u, amb_real *noise_y, unsigned char *touched,
                  amb_loop_output *to);

/* `count` runs of the same nonzero group, at most one per lane (amb_batch_lanes). */
void amb_many_advance(amb_instructions instructions, amb_many_run *const runs[], size_t count,
                      size_t n);

/* Philox: ten rounds turn a counter of four words and a key of two into four random words. */
void amb_philox(const uint32_t counter[4], const uint32_t key[2], uint32_t random[4]);

/* Standard normal noise of samples `first` to `first + n` of a stream, with the widest instructions
 * available. */
void amb_many_noise(amb_noise_key key, uint32_t stream, size_t first, size_t n, double *to);

#endif
