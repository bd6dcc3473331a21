/* Any model, by loops over its nonzero entries (ambkit/model.h). Sizes are known at run time; all
 * memory is the caller's. Columns are independent, so compilers vectorise over them. */
#ifndef AMBKIT_LOOPS_H
#define AMBKIT_LOOPS_H

#include "ambkit/magnet.h"
#include "ambkit/role.h"
#include "ambkit/sparse.h"

/* Maximum sizes of a model. An export has its own, exact ones. */
#ifndef AMB_STATES
#define AMB_STATES 64
#define AMB_FORCES 16
#define AMB_CONTROLS 16
#define AMB_SENSORS 16
#define AMB_NOISES 32
#endif
#define AMB_TRIANGLE ((AMB_STATES * (AMB_STATES + 1)) / 2)
#define AMB_WORK (AMB_STATES * ((2 * AMB_STATES) + (2 * AMB_FORCES) + (2 * AMB_CONTROLS)))

typedef struct amb_model {
  int states;
  int forces;
  int controls;
  int sensors;
  int noises;
  amb_sparse L;
  amb_sparse b;      /* states x forces */
  amb_sparse B_u;    /* states x controls */
  amb_sparse h;      /* forces x states: every state that a force depends on; the value of h, ... */
  const amb_real *e; /* ... of e ... */
  const amb_real *r; /* ... and of r, for each entry of h */
  amb_sparse d;      /* forces x controls */
  amb_sparse c;      /* sensors x states */
  amb_sparse N;      /* noises x triangle: covariance from a noise of variance 1 over a sample */
  amb_sparse rest;   /* states x states: equilibrium of AMB_SHOWN states; other rows are empty */
  const unsigned char *role; /* [states], amb_role */
} amb_model;

/* Displacement [m] and current [A] of magnet f, means over the sample, as linear forms. */
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

/* Role of each state. */
static inline amb_role amb_model_role(const amb_model *model, int i)
{
  return (amb_role)model->role[i];
}

#endif
