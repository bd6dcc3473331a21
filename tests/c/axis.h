/* The paper's axis for the tests, whichever build: built in, or as arrays that loops run over. */
#ifndef AMBKIT_TESTS_AXIS_H
#define AMBKIT_TESTS_AXIS_H

#include "ambkit/estimator.h"
#include "check.h"
#include "src/kalman_step.h"
#include <string.h>

#define AXIS_STATES 4
#define AXIS_ENTRIES 10 /* of the upper triangle of its covariance */

/* The axis as the paper prints its equations, or sampled exactly. */
typedef enum axis_form { AXIS_EXACT, AXIS_AS_PRINTED } axis_form;

#if defined(AMB_MODEL_LOOPS)
#include "axis_numbers.h"

/* What a model points to. */
typedef struct axis_values {
  axis_numbers of;
  amb_real L[7], b[3], h[3], N[AXIS_ENTRIES], rest[1];
} axis_values;

/* Kept for as long as the program runs; equal models share theirs. */
static inline const axis_values *axis_keep(const axis_numbers *n)
{
  static axis_values kept[32];
  static size_t count = 0;
  for (size_t i = 0; i < count; i++)
    if (memcmp(&kept[i].of, n, sizeof *n) == 0)
      return &kept[i];
  if (!check_at(count < sizeof kept / sizeof *kept, "room for one more model", __FILE__, __LINE__))
    return &kept[0];
  const axis_values values = {
      *n,
      {1, n->T, 1, 1, n->b_sen, n->c_sen, n->a_sen},
      {n->T2_2m, n->T_m, n->d_sen},
      {1, n->T_2, 0},
      {n->N00, n->N01, n->N02, n->N03, n->N11, n->N12, n->N13, 1, n->N23, n->N33},
      {n->K_sen},
  };
  kept[count] = values;
  return &kept[count++];
}

static inline amb_model axis_model(amb_real T, amb_real m, amb_real K_sen, amb_real T_sen,
                                   axis_form form)
{
  static const unsigned short L_start[] = {0, 2, 3, 4, 7}, L_column[] = {0, 1, 1, 2, 0, 1, 3};
  static const unsigned short b_start[] = {0, 1, 2, 2, 3}, first[] = {0, 0, 0};
  static const unsigned short none[] = {0, 0, 0, 0, 0}, h_start[] = {0, 3}, h_column[] = {0, 1, 2};
  static const unsigned short one[] = {0, 1}, c_column[] = {3}, rest_start[] = {0, 0, 0, 0, 1};
  static const unsigned short N_start[] = {0, 10}, N_column[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9};
  static const amb_real e[] = {0, 0, 0}, r[] = {0, 0, 1}, unity[] = {1};
  static const unsigned char role[] = {AMB_POSITION, AMB_VELOCITY, AMB_LOAD, AMB_SHOWN};
  axis_numbers numbers;
  axis_compute(T, m, K_sen, T_sen, form == AXIS_AS_PRINTED, &numbers);
  const axis_values *v = axis_keep(&numbers);
  const amb_model model = {
      .states = AXIS_STATES,
      .forces = 1,
      .controls = 1,
      .sensors = 1,
      .noises = 1,
      .L = {L_start, L_column, v->L},
      .b = {b_start, first, v->b},
      .B_u = {none, first, unity},
      .h = {h_start, h_column, v->h},
      .e = e,
      .r = r,
      .d = {one, first, unity},
      .c = {one, c_column, unity},
      .N = {N_start, N_column, v->N},
      .rest = {rest_start, first, v->rest},
      .role = role,
  };
  return model;
}
#else
static inline amb_model axis_model(amb_real T, amb_real m, amb_real K_sen, amb_real T_sen,
                                   axis_form form)
{
  amb_model model;
  amb_model_init(&model, T, m, K_sen, T_sen);
  if (form == AXIS_AS_PRINTED)
    amb_model_as_printed(&model);
  return model;
}
#endif

/* ---- One sensor, one magnet, one amplifier: numbers instead of arrays of one. ---- */

static inline amb_status axis_step(const amb_estimator *e, void *state, amb_real y, amb_real u,
                                   amb_kalman_result *r)
{
  const amb_real measured[AMB_SENSORS] = {y}, acted[AMB_CONTROLS] = {u};
  return amb_estimator_step(e, state, measured, acted, r);
}

static inline amb_status axis_start(const amb_estimator *e, void *state, amb_real y,
                                    amb_kalman_result *r)
{
  const amb_real measured[AMB_SENSORS] = {y};
  return amb_estimator_step(e, state, measured, NULL, r);
}

static inline amb_status axis_predict(const amb_kalman *kf, amb_kalman_state *s, amb_stiffness k,
                                      amb_real iu)
{
  const amb_stiffness stiffness[AMB_FORCES] = {k};
  const amb_real current[AMB_CONTROLS] = {iu};
  return amb_kalman_predict(kf, s, stiffness, current);
}

static inline amb_status axis_update(const amb_kalman *kf, amb_kalman_state *s, amb_real y,
                                     amb_kalman_result *r)
{
  const amb_real measured[AMB_SENSORS] = {y};
  return amb_kalman_update(kf, s, measured, r);
}

/* The control current, and what there was to say of the signal. */
static inline amb_real axis_current(const amb_kalman *kf, amb_kalman_state *s, amb_real u,
                                    amb_status *status)
{
  const amb_real signal[AMB_CONTROLS] = {u};
  amb_real iu[AMB_CONTROLS];
  *status = amb_step_currents(kf, s, signal, iu);
  return iu[0];
}

static inline amb_stiffness axis_stiffness(const amb_kalman *kf, const amb_magnet *magnet,
                                           amb_real iu, const amb_real mean[AMB_STATES])
{
  const amb_real current[AMB_CONTROLS] = {iu};
  const amb_magnet magnets[AMB_FORCES] = {*magnet};
  amb_stiffness k[AMB_FORCES];
  amb_step_stiffnesses(kf, magnets, current, mean, k);
  return k[0];
}

static inline void axis_advance(const amb_estimator *e, amb_real scale, amb_real iu,
                                amb_real mean[AMB_STATES])
{
  const amb_real current[AMB_CONTROLS] = {iu};
  e->methods->advance(e, scale, current, mean);
}

static inline amb_status axis_predict_by(const amb_estimator *e, void *state, amb_real u,
                                         amb_kalman_result *r)
{
  const amb_real acted[AMB_CONTROLS] = {u};
  return e->methods->predict(e, state, acted, r);
}

static inline bool axis_finite(const amb_kalman_state *s)
{
  return all_finite(s->mean, AXIS_STATES) && all_finite(s->cov, AXIS_ENTRIES);
}

/* Finite, with variances that are such. */
static inline bool axis_sound(const amb_kalman_state *s)
{
  return axis_finite(s) && s->cov[0] > 0 && s->cov[4] > 0 && s->cov[7] > 0 && s->cov[9] > 0;
}

/* A measurement that moves, so that it is not frozen. */
static inline amb_real axis_wobble(int k)
{
  return (k % 2 == 0 ? AMB_C(1e-6) : AMB_C(-1e-6)) * (amb_real)(1 + k % 7);
}

#endif
