/* The workbench's machine with one axis: what the page states of it, and what C makes of that. */
#ifndef WORKBENCH_AXIS_H
#define WORKBENCH_AXIS_H

#include "ambkit/fuzzy.h"
#include "ambkit/low_pass.h"
#include "ambkit/scaled.h"
#include "ambkit/ud.h"
#include "ambkit/unscented.h"
#include "noise_drawn.h"

#define WB_MOST 20001 /* samples of a flight */
#define WB_FILTERS 4  /* side by side */

/* What the page states, each a number in SI; the page asks for the names in this order. */
/* clang-format off */
#define WB_PARAMETERS(P)                                                       \
  P(T) P(mass) P(gravity) P(clearance) P(k) P(s0) P(i0) P(two_sided)           \
  P(gain) P(current_limit) P(noise_u) P(bandwidth) P(delay)                    \
  P(K_sen) P(lag) P(noise_y) P(step)                                           \
  P(kp) P(ki) P(kd) P(T_f) P(T_t) P(weight) P(feedback)                        \
  P(filter_k) P(filter_R) P(filter_Q)                                          \
  P(samples) P(seed) P(noisy) P(start) P(reference) P(load)
/* clang-format on */

typedef struct wb_parameters {
#define WB_FIELD(name) double name;
  WB_PARAMETERS(WB_FIELD)
#undef WB_FIELD
} wb_parameters;

/* Where a flight starts. */
enum { WB_LEVITATED, WB_LANDED, WB_RELEASED };

/* The kinds of estimators, as the page counts them. */
enum {
  WB_LINEAR,
  WB_CLOSED_LAW,
  WB_EXTENDED,
  WB_UNSCENTED,
  WB_UD,
  WB_LOW_PASS,
  WB_ADAPTIVE,
  WB_KINDS
};

/* The paper's expert of a machine, which the page writes; without rules there is none. */
typedef struct wb_expert {
  double rules, normalised, per_ampere, per_metre, iu_min, iu_max, x_min, x_max;
  double centre_iu[AMB_FUZZY_MAX_RULES], centre_x[AMB_FUZZY_MAX_RULES];
  double sharpness_k_i[AMB_FUZZY_MAX_RULES], weight_k_i[AMB_FUZZY_MAX_RULES];
  double sharpness_k_s[AMB_FUZZY_MAX_RULES], weight_k_s[AMB_FUZZY_MAX_RULES];
} wb_expert;

wb_expert *wb_known_expert(void);

/* A filter with all that it points to. */
typedef struct wb_filter {
  amb_kalman kf;
  amb_law law;
  amb_stiffness constant;
  amb_magnet magnet;
  amb_unscented unscented;
  amb_low_pass low_pass;
  amb_fuzzy fuzzy;
  amb_scaled scaled;
  amb_estimator estimator;
  union {
    amb_kalman_state base;
    amb_ud_state ud;
    amb_low_pass_state low_pass;
  } state;
  amb_real std[AMB_STATES]; /* at the start */
} wb_filter;

/* The closed loop with all that it points to. */
typedef struct wb_loop {
  amb_loop loop;
  amb_law law;
  amb_magnet magnet, coil;
  amb_parts amplifier, sensor, stop;
  amb_ring ring;
  amb_real mass, g, bias, farthest, gain, lag, k_ui, iu_min, iu_max;
  int current, second, shows;
  amb_real place, held, integral; /* of the start */
} wb_loop;

amb_law wb_law(const wb_parameters *p, double scale);
double wb_bias_force(const amb_law *law);
double wb_weight(const wb_parameters *p);
double wb_least_current(const wb_parameters *p);
double wb_lag(const wb_parameters *p);

/* The control current that holds the rotor at x [m] under this load [N], within the limits. */
double wb_levitation_current(const wb_parameters *p, double x, double load);

/* A filter of a kind; false where its settings are not possible. */
bool wb_make_filter(const wb_parameters *p, int kind, wb_filter *filter);

void wb_make_loop(const wb_parameters *p, const wb_filter *fed, wb_loop *loop);

#endif
