/* Shared declarations of the workbench: a machine's filters, its loop, and a run of both. */
#ifndef WORKBENCH_BENCH_H
#define WORKBENCH_BENCH_H

#include "ambkit/fuzzy.h"
#include "ambkit/low_pass.h"
#include "ambkit/rebuild.h"
#include "ambkit/scaled.h"
#include "ambkit/ud.h"
#include "ambkit/unscented.h"
#include "loop.h"
#include "noise_block.h"
#include "settings.h"

#define EXPORT(name) __attribute__((export_name(#name)))
#define MOST 20001    /* maximum samples of a run with one axis ... */
#define FEWER 10001   /* ... and of a rotor */
#define WIDE 10       /* maximum axes, sensors and rigid positions */
#define MEANS 480048  /* memory for the states of all samples of a run ... */
#define PAIRS 6000000 /* ... and for the covariances of the first filter */
#define FILTERS 4     /* side by side */

/* Estimator kinds, numbered as in the page. */
enum { LINEAR, CLOSED_LAW, EXTENDED, UNSCENTED, UD, LOW_PASS, ADAPTIVE, KINDS };

/* The paper's expert system of a machine, written by the page; absent without rules. */
typedef struct bench_expert {
  double rules, normalised, per_ampere, per_metre, iu_min, iu_max, x_min, x_max;
  double centre_iu[AMB_FUZZY_MAX_RULES], centre_x[AMB_FUZZY_MAX_RULES];
  double sharpness_k_i[AMB_FUZZY_MAX_RULES], weight_k_i[AMB_FUZZY_MAX_RULES];
  double sharpness_k_s[AMB_FUZZY_MAX_RULES], weight_k_s[AMB_FUZZY_MAX_RULES];
} bench_expert;

/* A filter's model of its machine. */
typedef struct bench_known {
  amb_view view;
  amb_law law[WIDE];
  double scale; /* factor of the expert's force [1] */
  double lag[WIDE], iu_min[WIDE], iu_max[WIDE], f_0[WIDE];
  double R, Q;             /* settings [m^2], [N^2/s]; 0: derived from the machine, ... */
  double R_times, Q_times; /* ... multiplied by these [1] */
} bench_known;

/* A filter with all data that it points to. */
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
  amb_real std[AMB_STATES]; /* initial */
} bench_filter;

/* A model written by the page. */
typedef struct bench_model {
  amb_model model;
  amb_view_states states;
  const double *others; /* growth per sample of its noises except the loads', ... */
  int loads;            /* ... and the number of loads */
  double gate;
  unsigned int frozen_limit, outlier_limit;
} bench_model;

/* The model with these parameters, in the order of its plan; NULL: invalid. */
const bench_model *bench_model_of(double T, const double parameters[]);

/* A filter of a kind; false if its settings are invalid. */
bool bench_filter_of(const bench_known *known, const bench_model *model, int kind,
                     bench_filter *filter);

/* Start a filter from a mean. */
void bench_start(bench_filter *filter, const amb_real mean[]);

/* A control current [A] within the limits that holds a rotor at x [m] against a force [N]. */
double bench_levitation(const amb_magnet *magnet, double x, double force, double low, double high);

/* Samples of white noise with a variance, `stride` apart. */
void bench_draw(double seed, uint32_t stream, size_t first, size_t n, size_t stride,
                double variance, double *to);

/* Destination of the history of filter number j. */
amb_kalman_history bench_history(int j, const amb_model *model, size_t n);

/* Sensitivity of a loop, from its response to a small pulse on its readings. */
typedef struct bench_pulse {
  const double *added;        /* [sensors] pulse added to each reading [m] */
  const double *shown;        /* [sensors] weights of the readings in the response [1] */
  const bench_filter *filter; /* in the loop */
} bench_pulse;

/* The response of a rotor at rest with references r [m], at a speed [rad/s], from which `gains`
 * computes abs(S). Returns whether it decays. */
bool bench_sensitivity(const amb_loop *loop, const amb_loop_state *start, const double r[],
                       double speed, const bench_pulse *pulse);

#endif
