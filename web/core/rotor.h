/* A rotor on several bearings as it was read, and a filter on it. */
#ifndef WORKBENCH_ROTOR_H
#define WORKBENCH_ROTOR_H

#include "bench.h"

#define BENDS 24 /* positions at most, rigid and bending */

typedef struct bench_rotor {
  amb_loop loop;
  bench_known known;
  double seed;
  bool noisy;
  double place[BENDS], held[WIDE], integral[WIDE], bias[WIDE], var_u[WIDE], var_y[WIDE];
  double along_axes[WIDE * WIDE], added[WIDE * WIDE];
  double rest[AMB_STATES], by_reading[AMB_STATES * WIDE], parameters[64];
} bench_rotor;

extern bench_rotor rotor;

/* Start the loop from the middle, or where the rotor lies. */
void rotor_settle(amb_loop_state *state);

/* Start a filter at rest where the first readings are these [m]; or in the middle, where the
 * currents are these [A]. */
void rotor_start_filter(bench_filter *filter, const double readings[], const double currents[]);

/* The loop with a filter in it, or without: then nothing is fed by it. */
amb_loop rotor_with_filter(bench_filter *filter, int kind);

#endif
