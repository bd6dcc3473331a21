/* Many closed loops, each judged while it runs, none of its samples kept; for the host.
 *
 * The numbers are those of amb_loop_run with the noise that is drawn here, run by run and to the
 * last bit, whatever the instructions and whoever is beside a run. The noise is normal and a
 * function of four numbers: seed, run, stream and sample. Who draws it, where, when and beside whom
 * changes nothing, so that runs can be computed in any order.
 *
 * Philox 4x32-10 (Salmon, Moraes, Dror and Shaw 2011) with the seed as its key; the counter is made
 * of run, stream and half of the sample's number. What it gives becomes normal by the inverse of
 * the distribution (Wichura 1988, AS 241), to some 1e-16; no libm beyond the root.
 */
#ifndef AMBKIT_SIM_MANY_H
#define AMBKIT_SIM_MANY_H

#include "batch.h"
#include "loop.h"
#include <stdint.h>

/* Whose noise it is. */
typedef struct amb_noise_key {
  uint64_t seed, run;
} amb_noise_key;

/* The streams of an axis and its sensor; those of others are the caller's. */
#define AMB_NOISE_CONTROL 0U  /* on the control signal */
#define AMB_NOISE_SENSOR 1U   /* white, on the measurement */
#define AMB_NOISE_STREAMS 64U /* from those of an axis to those of the next */

#define AMB_NOISE_DRAWN 64U /* samples that are drawn together */

/* What a run is judged by, where it is of an axis by the worst; NaN where it does not apply. */
typedef enum amb_figure {
  AMB_X_RMS,        /* errors of the estimates, from sample `first` on [m] */
  AMB_V_RMS,        /* [m/s] */
  AMB_F_D_RMS,      /* [N] */
  AMB_X_PEAK,       /* [m] */
  AMB_V_PEAK,       /* [m/s] */
  AMB_F_D_PEAK,     /* [N] */
  AMB_NIS,          /* mean normalised innovation squared of what was taken in [1] */
  AMB_CONTROL_RMS,  /* reference less position [m] */
  AMB_CONTROL_PEAK, /* [m] */
  AMB_EFFORT,       /* RMS change of the current asked for [A] */
  AMB_FARTHEST,     /* |x| along an axis, of all samples [m] */
  AMB_CURRENT_PEAK, /* |iu|, of all samples [A] */
  AMB_OVERSHOOT,    /* of the step [1] */
  AMB_SETTLING,     /* until within 5 % of it [s]; infinity: not within the window */
  AMB_RECOVERY,     /* after the load, until within the band [s]; infinity: not within the run */
  AMB_LOAD_KEPT,    /* of all loads together before a stop was first touched [N] */
  AMB_TOUCHED,      /* samples in which one was */
  AMB_LANDED,       /* 1 where one was in the last sample */
  AMB_ORBIT_PEAK,   /* from the middle of a bearing, both axes together, from `first` on [m] ... */
  AMB_ORBIT_SHARE,  /* ... as a share of the travel there [1] */
  AMB_FIGURES
} amb_figure;

#define AMB_FLAGS 13 /* of ambkit/status.h */

/* The samples over which figures of an axis are taken, by their numbers. */
typedef struct amb_windows {
  double first;              /* errors count from there */
  double step_from, step_to; /* the last step of the reference, and what comes next; equal: none */
  double height, there;      /* of that step [m], not 0, and the reference after it [m] */
  double load_from;          /* the last change of the load; n: none */
  double band;               /* the rotor has recovered within it [m] */
  double travel;             /* in its bearing [m] */
} amb_windows;

/* One run of n samples. */
typedef struct amb_many_run {
  const amb_loop *loop;            /* the estimator among it, or NULL */
  amb_loop_state state;            /* settled and reset; left at the end of the run */
  void *estimator;                 /* its state after a reset; left at the end of the run */
  amb_loop_input in;               /* but for its noise, ... */
  amb_noise_key key;               /* ... which is of this key */
  const double *std_u, *std_y;     /* of the white noise: axes [V], sensors [m]; 0: none */
  const double *noise_u, *noise_y; /* n x axes, n x sensors, in place of it; or NULL */
  amb_sparse along[3]; /* displacements, velocities and loads of the axes by the estimator's states;
                        * without `start`: unknown */
  const amb_windows *windows;  /* [axes] */
  double figures[AMB_FIGURES]; /* out */
  size_t flags[AMB_FLAGS];     /* out: samples in which the estimator said so */
} amb_many_run;

/* Runs with the same number here, of the same length, can go side by side; 0: alone only. */
unsigned int amb_many_group(const amb_many_run *run);

/* One run by itself, its samples left in `to`, which must have room for all; noise goes to the two
 * arrays (n x axes, n x sensors), `touched` gets 1 where a stop was (n,). */
void amb_many_alone(amb_many_run *run, amb_real *noise_u, amb_real *noise_y, unsigned char *touched,
                    amb_loop_output *to);

/* `count` runs of the same group, which is not 0, at most as many as there are lanes
 * (amb_batch_lanes). */
void amb_many_advance(amb_instructions instructions, amb_many_run *const runs[], size_t count,
                      size_t n);

/* Ten rounds: four words of a counter and two of a key make four that look random. */
void amb_philox(const uint32_t counter[4], const uint32_t key[2], uint32_t random[4]);

/* Standard normal noise of samples `first` to `first + n` of a stream, with the fastest
 * instructions that there are. */
void amb_many_noise(amb_noise_key key, uint32_t stream, size_t first, size_t n, double *to);

#endif
