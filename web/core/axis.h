/* The workbench's machine with one axis: its settings, and its closed loop. */
#ifndef WORKBENCH_AXIS_H
#define WORKBENCH_AXIS_H

#include "bench.h"

/* Settings in SI units; the page queries their names in this order. */
/* clang-format off */
#define AXIS_PARAMETERS(P)                                                     \
  P(T) P(mass) P(gravity) P(clearance) P(k) P(s0) P(i0) P(two_sided)           \
  P(gain) P(current_limit) P(noise_u) P(bandwidth) P(delay)                    \
  P(K_sen) P(lag) P(noise_y) P(step)                                           \
  P(kp) P(ki) P(kd) P(T_f) P(T_t) P(weight) P(feedback)                        \
  P(filter_k) P(filter_R) P(filter_Q)                                          \
  P(samples) P(seed) P(noisy) P(start) P(reference) P(load)
/* clang-format on */

typedef struct axis_parameters {
#define AXIS_FIELD(name) double name;
  AXIS_PARAMETERS(AXIS_FIELD)
#undef AXIS_FIELD
} axis_parameters;

/* Initial values of a run. */
enum { LEVITATED, LANDED, RELEASED };

/* The closed loop with all data that it points to. */
typedef struct axis_loop {
  amb_loop loop;
  amb_law law;
  amb_magnet magnet, coil;
  amb_parts amplifier, sensor, stop;
  amb_ring ring;
  amb_real mass, g, bias, farthest, gain, lag, k_ui, iu_min, iu_max;
  int current, second, shows;
  amb_real place, held, integral; /* of the start */
} axis_loop;

amb_law axis_law(const axis_parameters *p, double scale);
double axis_bias_force(const amb_law *law);
double axis_weight(const axis_parameters *p);
double axis_least_current(const axis_parameters *p);
double axis_lag(const axis_parameters *p);

/* The control current that holds the rotor at x [m] under this load [N], within the limits. */
double axis_levitation_current(const axis_parameters *p, double x, double load);

void axis_make_loop(const axis_parameters *p, const bench_filter *fed, axis_loop *loop);

#endif
