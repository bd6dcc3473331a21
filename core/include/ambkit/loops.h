/* Any model, by loops over the entries that are not zero (ambkit/model.h). Sizes are known when it
 * runs; all memory is the caller's. Columns do not mix, so compilers make vectors of them.
 */
#ifndef AMBKIT_LOOPS_H
#define AMBKIT_LOOPS_H

#include "ambkit/magnet.h"
#include "ambkit/role.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The most that a state has room for. An export has its own, just enough. */
#ifndef AMB_STATES
#define AMB_STATES 64
#define AMB_FORCES 16
#define AMB_CONTROLS 16
#define AMB_SENSORS 16
#define AMB_NOISES 32
#endif
#define AMB_TRIANGLE ((AMB_STATES * (AMB_STATES + 1)) / 2)
#define AMB_WORK (AMB_STATES * ((2 * AMB_STATES) + (2 * AMB_FORCES) + (2 * AMB_CONTROLS)))

/* The entries of a matrix, row by row, columns ascending: those of row i are start[i] to
 * start[i + 1]. */
typedef struct amb_sparse {
  const unsigned short *start;
  const unsigned short *column;
  const amb_real *value;
} amb_sparse;

typedef struct amb_model {
  int states;
  int forces;
  int controls;
  int sensors;
  int noises;
  amb_sparse L;
  amb_sparse b;      /* states x forces */
  amb_sparse B_u;    /* states x controls */
  amb_sparse h;      /* forces x states: all that a force depends on; the value of h, ... */
  const amb_real *e; /* ... of e ... */
  const amb_real *r; /* ... and of r, for each entry of h */
  amb_sparse d;      /* forces x controls */
  amb_sparse c;      /* sensors x states */
  amb_sparse N;      /* noises x triangle: covariance that one of variance 1 leaves in a sample */
  amb_sparse rest;   /* states x states: AMB_SHOWN ones at rest; other rows are empty */
  const unsigned char *role; /* [states], amb_role */
} amb_model;

static inline int amb_states(const amb_model *model)
{
  return model->states;
}

static inline int amb_forces(const amb_model *model)
{
  return model->forces;
}

static inline int amb_controls(const amb_model *model)
{
  return model->controls;
}

static inline int amb_sensors(const amb_model *model)
{
  return model->sensors;
}

static inline int amb_noises(const amb_model *model)
{
  return model->noises;
}

/* A row times a vector, from its first entry on. */
static inline amb_real amb_sparse_times(const amb_sparse *A, const amb_real *value, int row,
                                        const amb_real x[])
{
  amb_real sum = AMB_C(0.0);
  for (int k = A->start[row]; k < (int)A->start[row + 1]; k++) {
    sum += value[k] * x[A->column[k]];
  }
  return sum;
}

static inline amb_real amb_model_displacement(const amb_model *model, int f, const amb_real mean[])
{
  return amb_sparse_times(&model->h, model->h.value, f, mean);
}

static inline amb_real amb_model_current(const amb_model *model, int f, const amb_real mean[],
                                         const amb_real iu[])
{
  amb_real sum = amb_sparse_times(&model->h, model->e, f, mean);
  for (int k = model->d.start[f]; k < (int)model->d.start[f + 1]; k++) {
    sum += model->d.value[k] * iu[model->d.column[k]];
  }
  return sum;
}

static inline amb_role amb_model_role(const amb_model *model, int i)
{
  return (amb_role)model->role[i];
}

void amb_model_predict_mean(const amb_model *model, const amb_real F[], const amb_real iu[],
                            amb_real mean[]);
void amb_model_predict_covariance(const amb_model *model, const amb_stiffness k[],
                                  const amb_real k_ui[], const amb_real var_u[],
                                  const amb_real growth[], amb_real cov[], amb_real work[]);
amb_real amb_model_shown(const amb_model *model, int r, const amb_real mean[]);
amb_real amb_model_shown_variance(const amb_model *model, int r, const amb_real cov[]);
void amb_model_shown_with(const amb_model *model, int r, const amb_real cov[], amb_real with_y[]);
void amb_model_variances(const amb_model *model, const amb_real cov[], amb_real variances[]);
bool amb_model_sound(const amb_model *model, const amb_real cov[]);
bool amb_model_known(const amb_model *model, const amb_real cov[], const amb_real widest[]);
void amb_model_uncorrelated(const amb_model *model, const amb_real variances[], amb_real cov[]);
void amb_model_update(const amb_model *model, int r, amb_real y, amb_real S, amb_real mean[],
                      amb_real cov[], amb_real *innovation);
void amb_model_pushed(const amb_model *model, int f, amb_real moved[]);
void amb_model_growth(const amb_model *model, const amb_real var[], amb_real growth[]);
bool amb_model_drives(const amb_model *model, int k, int i);
void amb_model_equilibrium(const amb_model *model, amb_real mean[]);

#ifdef __cplusplus
}
#endif

#endif
