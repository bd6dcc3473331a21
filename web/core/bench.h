/* What the parts of the workbench share: a machine's filters, its loop, and a flight of both. */
#ifndef WORKBENCH_BENCH_H
#define WORKBENCH_BENCH_H

#include "ambkit/fuzzy.h"
#include "ambkit/low_pass.h"
#include "ambkit/rebuild.h"
#include "ambkit/scaled.h"
#include "ambkit/ud.h"
#include "ambkit/unscented.h"
#include "loop.h"
#include "noise_drawn.h"
#include "settings.h"

#define EXPORT(name) __attribute__((export_name(#name)))
#define MOST 20001    /* samples of a flight of an axis ... */
#define FEWER 10001   /* ... and of a rotor */
#define WIDE 10       /* axes, sensors and rigid positions at most */
#define MEANS 480048  /* what the states of all samples of a flight have room for, ... */
#define PAIRS 6000000 /* ... and the covariances of the first filter */
#define FILTERS 4     /* side by side */

/* The kinds of estimators, as the page counts them. */
enum { LINEAR, CLOSED_LAW, EXTENDED, UNSCENTED, UD, LOW_PASS, ADAPTIVE, KINDS };

/* The paper's expert of a machine, which the page writes; without rules there is none. */
typedef struct bench_expert {
  double rules, normalised, per_ampere, per_metre, iu_min, iu_max, x_min, x_max;
  double centre_iu[AMB_FUZZY_MAX_RULES], centre_x[AMB_FUZZY_MAX_RULES];
  double sharpness_k_i[AMB_FUZZY_MAX_RULES], weight_k_i[AMB_FUZZY_MAX_RULES];
  double sharpness_k_s[AMB_FUZZY_MAX_RULES], weight_k_s[AMB_FUZZY_MAX_RULES];
} bench_expert;

/* What the filters of a machine know of it. */
typedef struct bench_known {
  amb_view view;
  amb_law law[WIDE];
  double scale; /* by which the expert's force is taken [1] */
  double lag[WIDE], iu_min[WIDE], iu_max[WIDE], f_0[WIDE];
  double R, Q;             /* assumed [m^2], [N^2/s]; 0: what follows from the machine, ... */
  double R_times, Q_times; /* ... times these [1] */
} bench_known;

/* A filter with all that it points to. */
typedef struct bench_filter {
  amb_kalman kf;
  amb_law law[WIDE];
  amb_stiffness constant[WIDE];
  amb_magnet magnet[WIDE];
  amb_unscented unscented;
  amb_low_pass low_pass;
  amb_fuzzy fuzzy;
  amb_scaled scaled;
  amb_estimator estimator;
  amb_view_states states;
  union {
    amb_kalman_state base;
    amb_ud_state ud;
    amb_low_pass_state low_pass;
  } state;
  amb_real std[AMB_STATES]; /* at the start */
} bench_filter;

/* A model that the page has written. */
typedef struct bench_model {
  amb_model model;
  amb_view_states states;
  const double *others; /* what its noises but the loads grow by in a sample, ... */
  int loads;            /* ... which are so many */
  double gate;
  unsigned int frozen_limit, outlier_limit;
} bench_model;

/* With these parameters, in the order of its plan; NULL: it cannot be. */
const bench_model *bench_model_of(double T, const double parameters[]);

/* A filter of a kind; false where its settings are not possible. */
bool bench_filter_of(const bench_known *known, const bench_model *model, int kind,
                     bench_filter *filter);

/* Start a filter from a mean. */
void bench_start(bench_filter *filter, const amb_real mean[]);

/* A control current [A] within limits that holds a rotor at x [m] against a force [N]. */
double bench_levitation(const amb_magnet *magnet, double x, double force, double low, double high);

/* Samples of white noise of a variance, each `stride` after the other. */
void bench_draw(double seed, uint32_t stream, size_t first, size_t n, size_t stride,
                double variance, double *to);

/* Where filter number j leaves its history. */
amb_kalman_history bench_history(int j, const amb_model *model, size_t n);

/* The sensitivity of a loop: how it answers a small pulse on its readings. */
typedef struct bench_pulse {
  const double *added;        /* [sensors] what the pulse adds to each reading [m] */
  const double *shown;        /* [sensors] what of the readings is looked at [1] */
  const bench_filter *filter; /* the loop's */
} bench_pulse;

/* Its answer from a rotor at rest with references r [m], at a speed [rad/s], which `gains` makes
 * abs(S) of. Returns whether it dies away. */
bool bench_sensitivity(const amb_loop *loop, const amb_loop_state *start, const double r[],
                       double speed, const bench_pulse *pulse);

#endif
