#include "ambkit/model.h"

#if defined(AMB_MODEL_LOOPS)

void amb_model_predict_mean(const amb_model *model, const amb_real F[], const amb_real iu[],
                            amb_real mean[])
{
  const int n = model->states;
  amb_real force[AMB_FORCES];
  amb_real before[AMB_STATES];
  force[0] = AMB_C(0.0); /* compilers do not know that there is at least one */
  for (int f = 0; f < model->forces; f++) {
    force[f] = F[f];
    for (int k = model->h.start[f]; k < (int)model->h.start[f + 1]; k++) {
      force[f] += model->r[k] * mean[model->h.column[k]];
    }
  }
  amb_copy(n, mean, before);
  for (int i = 0; i < n; i++) {
    amb_real sum = amb_sparse_times(&model->L, model->L.value, i, before);
    for (int k = model->B_u.start[i]; k < (int)model->B_u.start[i + 1]; k++) {
      sum += model->B_u.value[k] * iu[model->B_u.column[k]];
    }
    for (int k = model->b.start[i]; k < (int)model->b.start[i + 1]; k++) {
      sum += model->b.value[k] * force[model->b.column[k]];
    }
    mean[i] = sum;
  }
}

amb_real amb_model_shown(const amb_model *model, int r, const amb_real mean[])
{
  return amb_sparse_times(&model->c, model->c.value, r, mean);
}

/* to += value times row k of the symmetric matrix with upper triangle `cov`. */
static void add_row_of(int n, int k, const amb_real cov[], amb_real value, amb_real *to)
{
  const amb_real *row = &cov[amb_entry(n, k, k)];
  int entry = k; /* down a column the rows get shorter */
  for (int j = 0; j < k; j++) {
    to[j] += cov[entry] * value;
    entry += n - j - 1;
  }
  for (int j = k; j < n; j++) {
    to[j] += row[j - k] * value;
  }
}

void amb_model_shown_with(const amb_model *model, int r, const amb_real cov[], amb_real with_y[])
{
  const int n = model->states;
  amb_clear(n, with_y);
  for (int a = model->c.start[r]; a < (int)model->c.start[r + 1]; a++) {
    add_row_of(n, model->c.column[a], cov, model->c.value[a], with_y);
  }
}

amb_real amb_model_shown_variance(const amb_model *model, int r, const amb_real cov[])
{
  const int n = model->states;
  amb_real sum = AMB_C(0.0);
  for (int b = model->c.start[r]; b < (int)model->c.start[r + 1]; b++) {
    amb_real with = AMB_C(0.0);
    for (int a = model->c.start[r]; a < (int)model->c.start[r + 1]; a++) {
      with += cov[amb_place(n, model->c.column[a], model->c.column[b])] * model->c.value[a];
    }
    sum += model->c.value[b] * with;
  }
  return sum;
}

void amb_model_variances(const amb_model *model, const amb_real cov[], amb_real variances[])
{
  for (int i = 0; i < model->states; i++) {
    variances[i] = cov[amb_entry(model->states, i, i)];
  }
}

/* Subtracts the gain times with_y from two consecutive rows of the covariance; the first is one
 * entry longer, at its front. */
static void take_two(int count, const amb_real K[2], const amb_real *with_y, amb_real *row,
                     amb_real *next)
{
  row[0] -= K[0] * with_y[0];
  for (int j = 0; j < count; j++) {
    const amb_real with = with_y[j + 1];
    row[j + 1] -= K[0] * with;
    next[j] -= K[1] * with;
  }
}

void amb_model_update(const amb_model *model, int r, amb_real y, amb_real S, amb_real mean[],
                      amb_real cov[], amb_real *innovation)
{
  const int n = model->states;
  amb_real with_y[AMB_STATES];
  amb_model_shown_with(model, r, cov, with_y);
  const amb_real e = y - amb_model_shown(model, r, mean);
  const amb_real inverse = AMB_C(1.0) / S;
  for (int i = 0; i < n; i++) {
    mean[i] += (with_y[i] * inverse) * e;
  }
  for (int i = 0; (i + 1) < n; i += 2) {
    const amb_real K[2] = {with_y[i] * inverse, with_y[i + 1] * inverse};
    take_two(n - i - 1, K, &with_y[i], &cov[amb_entry(n, i, i)], &cov[amb_entry(n, i + 1, i + 1)]);
  }
  if ((n % 2) != 0) {
    cov[amb_entry(n, n - 1, n - 1)] -= (with_y[n - 1] * inverse) * with_y[n - 1];
  }
  *innovation = e;
}

void amb_model_pushed(const amb_model *model, int f, amb_real moved[])
{
  for (int i = 0; i < model->states; i++) {
    moved[i] = AMB_C(0.0);
    for (int a = model->b.start[i]; a < (int)model->b.start[i + 1]; a++) {
      if ((int)model->b.column[a] == f) {
        moved[i] = model->b.value[a];
      }
    }
  }
}

void amb_model_growth(const amb_model *model, const amb_real var[], amb_real growth[])
{
  amb_clear((model->states * (model->states + 1)) / 2, growth);
  for (int k = 0; k < model->noises; k++) {
    for (int a = model->N.start[k]; a < (int)model->N.start[k + 1]; a++) {
      growth[model->N.column[a]] += model->N.value[a] * var[k];
    }
  }
}

bool amb_model_drives(const amb_model *model, int k, int i)
{
  const int diagonal = amb_entry(model->states, i, i);
  bool driven = false;
  for (int a = model->N.start[k]; a < (int)model->N.start[k + 1]; a++) {
    driven = driven || ((int)model->N.column[a] == diagonal);
  }
  return driven;
}

void amb_model_equilibrium(const amb_model *model, amb_real mean[])
{
  for (int i = 0; i < model->states; i++) {
    if (model->rest.start[i] < model->rest.start[i + 1]) {
      mean[i] = amb_sparse_times(&model->rest, model->rest.value, i, mean);
    }
  }
}

#endif
