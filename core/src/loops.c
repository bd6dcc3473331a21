#include "ambkit/model.h"

#if defined(AMB_MODEL_LOOPS)

/* to = a x, or to += a x. */
static void set_scaled(int n, amb_real a, const amb_real *x, amb_real *to)
{
  for (int j = 0; j < n; j++) {
    to[j] = a * x[j];
  }
}

static void add_scaled(int n, amb_real a, const amb_real *x, amb_real *to)
{
  for (int j = 0; j < n; j++) {
    to[j] += a * x[j];
  }
}

/* to = sum of value[k] times row column[k] of the n x n matrix X, entries `from` to `end`. */
static void combine_rows(const amb_sparse *A, int row, int n, const amb_real *X, amb_real *to)
{
  const int from = A->start[row];
  const int end = A->start[row + 1];
  if (from == end) {
    set_scaled(n, AMB_C(0.0), X, to);
  }
  for (int k = from; k < end; k++) {
    const amb_real *x = &X[A->column[k] * n];
    if (k == from) {
      set_scaled(n, A->value[k], x, to);
    } else {
      add_scaled(n, A->value[k], x, to);
    }
  }
}

void amb_model_predict_mean(const amb_model *model, const amb_real F[], const amb_real iu[],
                            amb_real mean[])
{
  const int n = model->states;
  amb_real all[AMB_FORCES];
  amb_real before[AMB_STATES];
  all[0] = AMB_C(0.0); /* compilers do not know that there is one */
  for (int f = 0; f < model->forces; f++) {
    all[f] = F[f];
    for (int k = model->h.start[f]; k < model->h.start[f + 1]; k++) {
      all[f] += model->r[k] * mean[model->h.column[k]];
    }
  }
  for (int i = 0; i < n; i++) {
    before[i] = mean[i];
  }
  for (int i = 0; i < n; i++) {
    amb_real sum = amb_sparse_times(&model->L, model->L.value, i, before);
    for (int k = model->B_u.start[i]; k < model->B_u.start[i + 1]; k++) {
      sum += model->B_u.value[k] * iu[model->B_u.column[k]];
    }
    for (int k = model->b.start[i]; k < model->b.start[i + 1]; k++) {
      sum += model->b.value[k] * all[model->b.column[k]];
    }
    mean[i] = sum;
  }
}

/* What the control's noise does to forces and states in a sample. */
typedef struct control_noise {
  amb_real gain[AMB_FORCES][AMB_CONTROLS];   /* g = k_i d k_ui [N/V] */
  amb_real variance[AMB_FORCES][AMB_FORCES]; /* q = g var g' [N^2] */
} control_noise;

static void noise_of_controls(const amb_model *model, const amb_stiffness k[],
                              const amb_real k_ui[], const amb_real var_u[], control_noise *noise)
{
  const int p = model->forces;
  const int controls = model->controls;
  noise->gain[0][0] = AMB_C(0.0); /* compilers do not know that there is one */
  for (int f = 0; f < p; f++) {
    for (int c = 0; c < controls; c++) {
      noise->gain[f][c] = AMB_C(0.0);
    }
    for (int j = model->d.start[f]; j < model->d.start[f + 1]; j++) {
      const int c = model->d.column[j];
      noise->gain[f][c] = (k[f].k_i * model->d.value[j]) * k_ui[c];
    }
  }
  for (int f = 0; f < p; f++) {
    for (int g = 0; g < p; g++) {
      amb_real sum = AMB_C(0.0);
      for (int c = 0; c < controls; c++) {
        sum += (noise->gain[g][c] * noise->gain[f][c]) * var_u[c];
      }
      noise->variance[g][f] = sum;
    }
  }
}

void amb_model_predict_covariance(const amb_model *model, const amb_stiffness k[],
                                  const amb_real k_ui[], const amb_real var_u[],
                                  const amb_real growth[], amb_real cov[], amb_real work[])
{
  const int n = model->states;
  const int p = model->forces;
  const amb_sparse *h = &model->h;
  amb_real *P = work;      /* n x n, unfolded */
  amb_real *w = &P[n * n]; /* p x n */
  amb_real *M = &w[p * n]; /* a row */
  control_noise noise;
  noise_of_controls(model, k, k_ui, var_u, &noise);
  int entry = 0;
  for (int i = 0; i < n; i++) {
    for (int j = i; j < n; j++) {
      P[i * n + j] = cov[entry];
      P[j * n + i] = cov[entry];
      entry++;
    }
  }
  amb_real row[AMB_FORCES * AMB_STATES]; /* of each entry of h */
  for (int f = 0; f < p; f++) {
    const int last = h->start[f + 1] - 1;
    if (last < (int)h->start[f]) { /* a force that nothing moves */
      set_scaled(n, AMB_C(0.0), P, &w[f * n]);
    }
    for (int a = last; a >= (int)h->start[f]; a--) {
      const amb_real *x = &P[h->column[a] * n];
      row[a] = k[f].k_s * h->value[a] + k[f].k_i * model->e[a] + model->r[a];
      if (a == last) {
        set_scaled(n, row[a], x, &w[f * n]);
      } else {
        add_scaled(n, row[a], x, &w[f * n]);
      }
    }
  }
  entry = 0;
  for (int i = 0; i < n; i++) {
    amb_real z[AMB_FORCES];
    amb_real moved[AMB_CONTROLS]; /* how the noise of each control moves state i, times var_u */
    const int first_b = model->b.start[i];
    const int end_b = model->b.start[i + 1];
    const int first_u = model->B_u.start[i];
    const int end_u = model->B_u.start[i + 1];
    z[0] = AMB_C(0.0); /* see above */
    combine_rows(&model->L, i, n, P, M);
    for (int a = first_b; a < end_b; a++) {
      add_scaled(n, model->b.value[a], &w[model->b.column[a] * n], M);
    }
    for (int c = 0; c < model->controls; c++) {
      moved[c] = AMB_C(0.0);
    }
    for (int a = first_u; a < end_u; a++) {
      const int c = model->B_u.column[a];
      moved[c] = model->B_u.value[a] * k_ui[c];
    }
    for (int f = 0; f < p; f++) {
      amb_real sum = AMB_C(0.0);
      for (int a = first_b; a < end_b; a++) {
        sum += model->b.value[a] * noise.variance[model->b.column[a]][f];
      }
      for (int a = first_u; a < end_u; a++) {
        const int c = model->B_u.column[a];
        sum += (moved[c] * var_u[c]) * noise.gain[f][c];
      }
      for (int a = (int)h->start[f + 1] - 1; a >= (int)h->start[f]; a--) {
        sum += M[h->column[a]] * row[a];
      }
      z[f] = sum;
    }
    for (int c = 0; c < model->controls; c++) {
      for (int a = first_b; a < end_b; a++) {
        moved[c] += model->b.value[a] * noise.gain[model->b.column[a]][c];
      }
      moved[c] *= var_u[c];
    }
    for (int j = i; j < n; j++) {
      amb_real sum = AMB_C(0.0);
      for (int a = model->L.start[j]; a < model->L.start[j + 1]; a++) {
        sum += M[model->L.column[a]] * model->L.value[a];
      }
      sum += growth[entry];
      for (int a = model->B_u.start[j]; a < model->B_u.start[j + 1]; a++) {
        const int c = model->B_u.column[a];
        sum += (model->B_u.value[a] * k_ui[c]) * moved[c];
      }
      for (int a = model->b.start[j]; a < model->b.start[j + 1]; a++) {
        sum += model->b.value[a] * z[model->b.column[a]];
      }
      cov[entry] = sum;
      entry++;
    }
  }
}

amb_real amb_model_shown(const amb_model *model, int r, const amb_real mean[])
{
  return amb_sparse_times(&model->c, model->c.value, r, mean);
}

/* Where entry (i, j) of a symmetric matrix stands in its upper triangle. */
static int place(int n, int i, int j)
{
  return (i <= j) ? amb_entry(n, i, j) : amb_entry(n, j, i);
}

void amb_model_shown_with(const amb_model *model, int r, const amb_real cov[], amb_real with_y[])
{
  const int n = model->states;
  for (int j = 0; j < n; j++) {
    amb_real sum = AMB_C(0.0);
    for (int a = model->c.start[r]; a < model->c.start[r + 1]; a++) {
      sum += cov[place(n, model->c.column[a], j)] * model->c.value[a];
    }
    with_y[j] = sum;
  }
}

amb_real amb_model_shown_variance(const amb_model *model, int r, const amb_real cov[])
{
  const int n = model->states;
  amb_real sum = AMB_C(0.0);
  for (int b = model->c.start[r]; b < model->c.start[r + 1]; b++) {
    amb_real with = AMB_C(0.0);
    for (int a = model->c.start[r]; a < model->c.start[r + 1]; a++) {
      with += cov[place(n, model->c.column[a], model->c.column[b])] * model->c.value[a];
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

bool amb_model_sound(const amb_model *model, const amb_real cov[])
{
  bool sound = true;
  for (int i = 0; i < model->states; i++) {
    sound = sound && (cov[amb_entry(model->states, i, i)] >= AMB_C(0.0));
  }
  return sound;
}

bool amb_model_known(const amb_model *model, const amb_real cov[], const amb_real widest[])
{
  bool known = true;
  for (int i = 0; i < model->states; i++) {
    if (amb_model_role(model, i) == AMB_POSITION) {
      known = known && (cov[amb_entry(model->states, i, i)] <= widest[i]);
    }
  }
  return known;
}

void amb_model_uncorrelated(const amb_model *model, const amb_real variances[], amb_real cov[])
{
  for (int i = 0; i < model->states; i++) {
    for (int j = i; j < model->states; j++) {
      const amb_real variance = amb_magnitude(variances[i]);
      cov[amb_entry(model->states, i, j)] = (i == j) ? variance : AMB_C(0.0);
    }
  }
}

void amb_model_update(const amb_model *model, int r, amb_real y, amb_real var_y, amb_real mean[],
                      amb_real cov[], amb_real *innovation, amb_real *variance)
{
  const int n = model->states;
  amb_real with_y[AMB_STATES];
  amb_model_shown_with(model, r, cov, with_y);
  *variance = amb_model_shown_variance(model, r, cov) + var_y;
  *innovation = y - amb_model_shown(model, r, mean);
  const amb_real inverse = AMB_C(1.0) / (*variance);
  int entry = 0;
  for (int i = 0; i < n; i++) {
    const amb_real K = with_y[i] * inverse;
    mean[i] += K * (*innovation);
    for (int j = i; j < n; j++) {
      cov[entry] -= K * with_y[j];
      entry++;
    }
  }
}

void amb_model_pushed(const amb_model *model, int f, amb_real moved[])
{
  for (int i = 0; i < model->states; i++) {
    moved[i] = AMB_C(0.0);
    for (int a = model->b.start[i]; a < model->b.start[i + 1]; a++) {
      if ((int)model->b.column[a] == f) {
        moved[i] = model->b.value[a];
      }
    }
  }
}

void amb_model_growth(const amb_model *model, const amb_real var[], amb_real growth[])
{
  const int entries = (model->states * (model->states + 1)) / 2;
  for (int i = 0; i < entries; i++) {
    growth[i] = AMB_C(0.0);
  }
  for (int k = 0; k < model->noises; k++) {
    for (int a = model->N.start[k]; a < model->N.start[k + 1]; a++) {
      growth[model->N.column[a]] += model->N.value[a] * var[k];
    }
  }
}

void amb_model_at_rest(const amb_model *model, amb_real mean[])
{
  for (int i = 0; i < model->states; i++) {
    if (model->rest.start[i] < model->rest.start[i + 1]) {
      mean[i] = amb_sparse_times(&model->rest, model->rest.value, i, mean);
    }
  }
}

#endif
