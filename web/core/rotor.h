/* A rotor on several bearings from its description, and a filter for it. */
#ifndef WORKBENCH_ROTOR_H
#define WORKBENCH_ROTOR_H

#include "bench.h"

#define BENDS 24 /* maximum positions, rigid and bending */

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

/* Start the loop at the centre, or in contact. */
void rotor_settle(amb_loop_state *state);

/* Start a filter in equilibrium at these first readings [m]; or at the centre with these currents
 * [A]. */
void rotor_start_filter(bench_filter *filter, const double readings[], const double currents[]);

/* The loop with or without a filter; without one, the readings feed the controllers. */
amb_loop rotor_with_filter(bench_filter *filter, int kind);

#endif
