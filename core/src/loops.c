#include "ambkit/model.h"

#if defined(AMB_MODEL_LOOPS)

/* Rows that are to be added up, each times a number: what a row of a product is made of. */
typedef struct sum_of_rows {
  int count;
  amb_real value[AMB_STATES + AMB_FORCES + AMB_CONTROLS + 1];
  const amb_real *row[AMB_STATES + AMB_FORCES + AMB_CONTROLS + 1];
} sum_of_rows;

static void add_row(sum_of_rows *sum, amb_real value, const amb_real *row)
{
  sum->value[sum->count] = value;
  sum->row[sum->count] = row;
  sum->count++;
}

/* Four of them, from number k on, to what is there already; or with `fresh` to nothing. */
static void add_four(const sum_of_rows *sum, int k, int n, bool fresh, amb_real *to)
{
  const amb_real a = sum->value[k];
  const amb_real b = sum->value[k + 1];
  const amb_real c = sum->value[k + 2];
  const amb_real d = sum->value[k + 3];
  const amb_real *restrict p = sum->row[k];
  const amb_real *restrict q = sum->row[k + 1];
  const amb_real *restrict r = sum->row[k + 2];
  const amb_real *restrict s = sum->row[k + 3];
  if (fresh) {
    for (int j = 0; j < n; j++) {
      to[j] = ((a * p[j] + b * q[j]) + c * r[j]) + d * s[j];
    }
  } else {
    for (int j = 0; j < n; j++) {
      to[j] = (((to[j] + a * p[j]) + b * q[j]) + c * r[j]) + d * s[j];
    }
  }
}

/* `n` columns of the sum, one row after the other in each; four at a time, as then the sum is
 * fetched and stored less often. */
static void add_up(const sum_of_rows *sum, int n, amb_real *to)
{
  int k = 0;
  if (sum->count >= 4) {
    add_four(sum, 0, n, true, to);
    k = 4;
  } else {
    for (int j = 0; j < n; j++) {
      to[j] = (sum->count > 0) ? (sum->value[0] * sum->row[0][j]) : AMB_C(0.0);
    }
    k = 1;
  }
  for (; (k + 4) <= sum->count; k += 4) {
    add_four(sum, k, n, false, to);
  }
  for (; k < sum->count; k++) {
    const amb_real a = sum->value[k];
    const amb_real *restrict p = sum->row[k];
    for (int j = 0; j < n; j++) {
      to[j] += a * p[j];
    }
  }
}

/* The rows of X, n wide, that row i of A asks for. */
static void add_rows_of(const amb_sparse *A, int i, const amb_real *X, int n, sum_of_rows *sum)
{
  for (int k = A->start[i]; k < A->start[i + 1]; k++) {
    add_row(sum, A->value[k], &X[A->column[k] * n]);
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
  noise->variance[0][0] = AMB_C(0.0);
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

/* Where the parts of the room for a prediction begin. */
typedef struct rooms {
  amb_real *P; /* n x n, unfolded; later the transpose of M */
  amb_real *M; /* n x n, of the next state with the state */
  amb_real *w; /* p x n, of the forces with the state */
  amb_real *z; /* p x n, of the forces with the next state */
  amb_real *v; /* controls x n, of the controls' noise with the next state */
} rooms;

static rooms laid_out(const amb_model *model, amb_real work[])
{
  const int n = model->states;
  rooms room;
  room.P = work;
  room.M = &room.P[n * n];
  room.w = &room.M[n * n];
  room.z = &room.w[model->forces * n];
  room.v = &room.z[model->forces * n];
  return room;
}

/* w = row_f P, and the coefficients `row` of each entry of h; from last to first. */
static void of_forces(const amb_model *model, const amb_stiffness k[], const rooms *room,
                      amb_real row[])
{
  const int n = model->states;
  const amb_sparse *h = &model->h;
  for (int f = 0; f < model->forces; f++) {
    sum_of_rows sum;
    sum.count = 0;
    for (int a = (int)h->start[f + 1] - 1; a >= (int)h->start[f]; a--) {
      row[a] = k[f].k_s * h->value[a] + k[f].k_i * model->e[a] + model->r[a];
      add_row(&sum, row[a], &room->P[h->column[a] * n]);
    }
    add_up(&sum, n, &room->w[f * n]);
  }
}

static void transpose(int n, const amb_real *from, amb_real *to)
{
  for (int i = 0; i < n; i++) {
    for (int j = 0; j < n; j++) {
      to[j * n + i] = from[i * n + j];
    }
  }
}

/* z, of which P is the transpose of M now: the noise of the controls in force f, then row_f M. */
static void with_next_state(const amb_model *model, int f, const amb_real k_ui[],
                            const amb_real var_u[], const control_noise *noise,
                            const amb_real row[], const rooms *room)
{
  const int n = model->states;
  const amb_sparse *h = &model->h;
  amb_real of_noise[AMB_STATES];
  sum_of_rows sum;
  for (int i = 0; i < n; i++) {
    of_noise[i] = AMB_C(0.0);
    for (int a = model->b.start[i]; a < model->b.start[i + 1]; a++) {
      of_noise[i] += model->b.value[a] * noise->variance[model->b.column[a]][f];
    }
    for (int a = model->B_u.start[i]; a < model->B_u.start[i + 1]; a++) {
      const int c = model->B_u.column[a];
      of_noise[i] += ((model->B_u.value[a] * k_ui[c]) * var_u[c]) * noise->gain[f][c];
    }
  }
  sum.count = 0;
  add_row(&sum, AMB_C(1.0), of_noise);
  for (int a = (int)h->start[f + 1] - 1; a >= (int)h->start[f]; a--) {
    add_row(&sum, row[a], &room->P[h->column[a] * n]);
  }
  add_up(&sum, n, &room->z[f * n]);
}

/* v: what of the next state the noise of control c is. */
static void with_control(const amb_model *model, int c, const amb_real k_ui[],
                         const amb_real var_u[], const control_noise *noise, const rooms *room)
{
  amb_real *v = &room->v[c * model->states];
  for (int i = 0; i < model->states; i++) {
    v[i] = AMB_C(0.0);
    for (int a = model->B_u.start[i]; a < model->B_u.start[i + 1]; a++) {
      if ((int)model->B_u.column[a] == c) {
        v[i] = model->B_u.value[a] * k_ui[c];
      }
    }
    for (int a = model->b.start[i]; a < model->b.start[i + 1]; a++) {
      v[i] += model->b.value[a] * noise->gain[model->b.column[a]][c];
    }
    v[i] *= var_u[c];
  }
}

/* Column j of the covariance one sample on, down to its diagonal; `grown`: of the growth. */
static void next_column(const amb_model *model, int j, const amb_real k_ui[],
                        const amb_real grown[], const rooms *room, amb_real column[])
{
  const int n = model->states;
  sum_of_rows sum;
  sum.count = 0;
  add_rows_of(&model->L, j, room->P, n, &sum);
  add_row(&sum, AMB_C(1.0), grown);
  for (int a = model->B_u.start[j]; a < model->B_u.start[j + 1]; a++) {
    const int c = model->B_u.column[a];
    add_row(&sum, model->B_u.value[a] * k_ui[c], &room->v[c * n]);
  }
  add_rows_of(&model->b, j, room->z, n, &sum);
  add_up(&sum, j + 1, column);
}

void amb_model_predict_covariance(const amb_model *model, const amb_stiffness k[],
                                  const amb_real k_ui[], const amb_real var_u[],
                                  const amb_real growth[], amb_real cov[], amb_real work[])
{
  const int n = model->states;
  const rooms room = laid_out(model, work);
  control_noise noise;
  amb_real row[AMB_FORCES * AMB_STATES];
  noise_of_controls(model, k, k_ui, var_u, &noise);
  amb_unfold(n, cov, n, room.P);
  of_forces(model, k, &room, row);
  for (int i = 0; i < n; i++) {
    sum_of_rows sum;
    sum.count = 0;
    add_rows_of(&model->L, i, room.P, n, &sum);
    add_rows_of(&model->b, i, room.w, n, &sum);
    add_up(&sum, n, &room.M[i * n]);
  }
  transpose(n, room.M, room.P);
  for (int f = 0; f < model->forces; f++) {
    with_next_state(model, f, k_ui, var_u, &noise, row, &room);
  }
  if (model->B_u.start[n] > 0U) { /* else it moves nothing past the forces */
    for (int c = 0; c < model->controls; c++) {
      with_control(model, c, k_ui, var_u, &noise, &room);
    }
  }
  for (int j = 0; j < n; j++) {
    amb_real grown[AMB_STATES];
    amb_real column[AMB_STATES];
    for (int i = 0; i <= j; i++) {
      grown[i] = growth[amb_entry(n, i, j)];
    }
    next_column(model, j, k_ui, grown, &room, column);
    for (int i = 0; i <= j; i++) {
      cov[amb_entry(n, i, j)] = column[i];
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
    if (amb_model_role(model, i) != AMB_SHOWN) {
      sound = sound && (cov[amb_entry(model->states, i, i)] >= AMB_C(0.0));
    }
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
  const amb_real S = amb_model_shown_variance(model, r, cov) + var_y;
  const amb_real e = y - amb_model_shown(model, r, mean);
  const amb_real inverse = AMB_C(1.0) / S;
  amb_real *row = cov; /* from its diagonal on */
  for (int i = 0; i < n; i++) {
    const amb_real K = with_y[i] * inverse;
    const amb_real *restrict after = &with_y[i];
    const int count = n - i;
    mean[i] += K * e;
    for (int j = 0; j < count; j++) {
      row[j] -= K * after[j];
    }
    row = &row[count];
  }
  *innovation = e;
  *variance = S;
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

bool amb_model_drives(const amb_model *model, int k, int i)
{
  const int diagonal = amb_entry(model->states, i, i);
  bool driven = false;
  for (int a = model->N.start[k]; a < model->N.start[k + 1]; a++) {
    driven = driven || ((int)model->N.column[a] == diagonal);
  }
  return driven;
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
