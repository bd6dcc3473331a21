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

/* Columns that are added up side by side: their sums stay in registers. */
#define BLOCK 8

/* BLOCK columns of the sum, from `at` on, one row after the other in each. Written out, for
 * compilers make vectors across the columns of this, but along the rows of a loop. */
static void add_block(const sum_of_rows *sum, int at, amb_real *to)
{
  amb_real a = sum->value[0];
  const amb_real *p = &sum->row[0][at];
  amb_real s0 = a * p[0];
  amb_real s1 = a * p[1];
  amb_real s2 = a * p[2];
  amb_real s3 = a * p[3];
  amb_real s4 = a * p[4];
  amb_real s5 = a * p[5];
  amb_real s6 = a * p[6];
  amb_real s7 = a * p[7];
  for (int k = 1; k < sum->count; k++) {
    a = sum->value[k];
    p = &sum->row[k][at];
    s0 += a * p[0];
    s1 += a * p[1];
    s2 += a * p[2];
    s3 += a * p[3];
    s4 += a * p[4];
    s5 += a * p[5];
    s6 += a * p[6];
    s7 += a * p[7];
  }
  to[0] = s0;
  to[1] = s1;
  to[2] = s2;
  to[3] = s3;
  to[4] = s4;
  to[5] = s5;
  to[6] = s6;
  to[7] = s7;
}

/* The first `wanted` of n columns of the sum. The last block is moved back such that it ends with
 * the rows: what it shares with the one before is added up twice, to the same. Columns past
 * `wanted` may be written too. */
static void add_up(const sum_of_rows *sum, int n, int wanted, amb_real *to)
{
  if (sum->count == 0) {
    amb_clear(wanted, to);
  } else if (n >= BLOCK) {
    for (int at = 0; at < wanted; at += BLOCK) {
      const int from = (at + BLOCK <= n) ? at : (n - BLOCK);
      add_block(sum, from, &to[from]);
    }
  } else {
    for (int j = 0; j < wanted; j++) {
      amb_real total = sum->value[0] * sum->row[0][j];
      for (int k = 1; k < sum->count; k++) {
        total += sum->value[k] * sum->row[k][j];
      }
      to[j] = total;
    }
  }
}

/* The rows of X, n wide, that row i of A asks for. */
static void add_rows_of(const amb_sparse *A, int i, const amb_real *X, int n, sum_of_rows *sum)
{
  for (int k = A->start[i]; k < (int)A->start[i + 1]; k++) {
    add_row(sum, A->value[k], &X[(int)A->column[k] * n]);
  }
}

void amb_model_predict_mean(const amb_model *model, const amb_real F[], const amb_real iu[],
                            amb_real mean[])
{
  const int n = model->states;
  amb_real force[AMB_FORCES];
  amb_real before[AMB_STATES];
  force[0] = AMB_C(0.0); /* compilers do not know that there is one */
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
    amb_clear(controls, noise->gain[f]);
    for (int j = model->d.start[f]; j < (int)model->d.start[f + 1]; j++) {
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
  amb_real *M; /* n x n, of the next state with the state; later the growth */
  amb_real *w; /* p x n, of the forces with the state; later what they push */
  amb_real *z; /* p x n, of the forces with the next state */
  amb_real *v; /* controls x n, of the controls' noise with the next state */
  amb_real *u; /* controls x n, what they push past the forces */
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
  room.u = &room.v[model->controls * n];
  return room;
}

/* Up to four rows, from entry `first` to before `end`, as columns side by side: entry j of row r is
 * number r of a line j. Lines are `step` apart, and each `less` nearer to the next than the last.
 */
static void turn(int rows, const amb_real *const row[], int first, int end, int step, int less,
                 amb_real *to)
{
  amb_real *line = to;
  int apart = step;
  if (rows == 4) { /* without a loop, for it is what costs */
    const amb_real *p = row[0];
    const amb_real *q = row[1];
    const amb_real *r = row[2];
    const amb_real *s = row[3];
    for (int j = first; j < end; j++) {
      const amb_real a = p[j];
      const amb_real b = q[j];
      const amb_real c = r[j];
      const amb_real d = s[j];
      line[0] = a;
      line[1] = b;
      line[2] = c;
      line[3] = d;
      line = &line[apart];
      apart -= less;
    }
  } else {
    for (int j = first; j < end; j++) {
      for (int r = 0; r < rows; r++) {
        line[r] = row[r][j];
      }
      line = &line[apart];
      apart -= less;
    }
  }
}

static int smaller(int a, int b)
{
  return (a < b) ? a : b;
}

/* The upper triangle `cov`, mirrored: as the lower triangle of the matrix P. */
static void mirror(int n, const amb_real cov[], amb_real *P)
{
  for (int i = 0; i < n; i += 4) {
    const int end = smaller(i + 4, n);
    const amb_real *row[4];
    for (int r = i; r < end; r++) {
      row[r - i] = &cov[amb_entry(n, r, 0)];
      for (int j = r; j < end; j++) {
        P[j * n + r] = row[r - i][j];
      }
    }
    turn(end - i, row, end, n, n, 0, &P[end * n + i]);
  }
}

/* ... and as the whole of it. */
static void unfold(int n, const amb_real cov[], amb_real *P)
{
  mirror(n, cov, P);
  for (int i = 0; i < n; i++) {
    const amb_real *row = &cov[amb_entry(n, i, 0)];
    for (int j = i; j < n; j++) {
      P[i * n + j] = row[j];
    }
  }
}

static void transpose(int n, const amb_real *from, amb_real *to)
{
  for (int i = 0; i < n; i += 4) {
    const int end = smaller(i + 4, n);
    const amb_real *row[4];
    for (int r = i; r < end; r++) {
      row[r - i] = &from[r * n];
    }
    turn(end - i, row, 0, n, n, 0, &to[i]);
  }
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
      add_row(&sum, row[a], &room->P[(int)h->column[a] * n]);
    }
    add_up(&sum, n, n, &room->w[f * n]);
  }
}

/* What forces and controls push, a row for each: b, and B_u k_ui of so many controls. */
static void pushes(const amb_model *model, const amb_real k_ui[], int direct, const rooms *room)
{
  const int n = model->states;
  amb_clear(model->forces * n, room->w);
  amb_clear(direct * n, room->u);
  for (int i = 0; i < n; i++) {
    for (int a = model->b.start[i]; a < (int)model->b.start[i + 1]; a++) {
      room->w[((int)model->b.column[a] * n) + i] = model->b.value[a];
    }
    for (int a = model->B_u.start[i]; a < (int)model->B_u.start[i + 1]; a++) {
      const int c = model->B_u.column[a];
      room->u[(c * n) + i] = model->B_u.value[a] * k_ui[c];
    }
  }
}

/* v: what of the next state the noise of control c is; and u, times the variance from here on. */
static void with_control(const amb_model *model, int c, amb_real var_u, const control_noise *noise,
                         const rooms *room)
{
  const int n = model->states;
  amb_real *v = &room->v[c * n];
  amb_real *u = &room->u[c * n];
  sum_of_rows sum;
  sum.count = 0;
  add_row(&sum, AMB_C(1.0), u);
  for (int f = 0; f < model->forces; f++) {
    add_row(&sum, noise->gain[f][c], &room->w[f * n]);
  }
  add_up(&sum, n, n, v);
  for (int i = 0; i < n; i++) {
    v[i] *= var_u;
    u[i] *= var_u;
  }
}

/* z, of which P is the transpose of M now: the noise of the controls in force f, then row_f M. */
static void with_next_state(const amb_model *model, int f, const control_noise *noise,
                            const amb_real row[], int direct, const rooms *room)
{
  const int n = model->states;
  const amb_sparse *h = &model->h;
  sum_of_rows sum;
  sum.count = 0;
  for (int g = 0; g < model->forces; g++) {
    add_row(&sum, noise->variance[g][f], &room->w[g * n]);
  }
  for (int a = model->d.start[f]; (direct > 0) && (a < (int)model->d.start[f + 1]); a++) {
    const int c = model->d.column[a];
    add_row(&sum, noise->gain[f][c], &room->u[c * n]);
  }
  for (int a = (int)h->start[f + 1] - 1; a >= (int)h->start[f]; a--) {
    add_row(&sum, row[a], &room->P[(int)h->column[a] * n]);
  }
  add_up(&sum, n, n, &room->z[f * n]);
}

/* Column j of the covariance one sample on, down to its diagonal. */
static void next_column(const amb_model *model, int j, const amb_real k_ui[], const rooms *room,
                        amb_real column[])
{
  const int n = model->states;
  sum_of_rows sum;
  sum.count = 0;
  add_rows_of(&model->L, j, room->P, n, &sum);
  add_row(&sum, AMB_C(1.0), &room->M[j * n]);
  for (int a = model->B_u.start[j]; a < (int)model->B_u.start[j + 1]; a++) {
    const int c = model->B_u.column[a];
    add_row(&sum, model->B_u.value[a] * k_ui[c], &room->v[c * n]);
  }
  add_rows_of(&model->b, j, room->z, n, &sum);
  add_up(&sum, n, j + 1, column);
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
  unfold(n, cov, room.P);
  of_forces(model, k, &room, row);
  for (int i = 0; i < n; i++) {
    sum_of_rows sum;
    sum.count = 0;
    add_rows_of(&model->L, i, room.P, n, &sum);
    add_rows_of(&model->b, i, room.w, n, &sum);
    add_up(&sum, n, n, &room.M[i * n]);
  }
  transpose(n, room.M, room.P);
  const int direct = (model->B_u.start[n] > 0U) ? model->controls : 0; /* that push past forces */
  pushes(model, k_ui, direct, &room);
  for (int c = 0; c < direct; c++) {
    with_control(model, c, var_u[c], &noise, &room);
  }
  for (int f = 0; f < model->forces; f++) {
    with_next_state(model, f, &noise, row, direct, &room);
  }
  mirror(n, growth, room.M);
  for (int j = 0; j < n; j += 4) {
    const int end = smaller(j + 4, n);
    amb_real column[4][AMB_STATES];
    const amb_real *const columns[] = {column[0], column[1], column[2], column[3]};
    for (int c = j; c < end; c++) {
      next_column(model, c, k_ui, &room, column[c - j]);
      for (int i = j; i <= c; i++) {
        cov[amb_entry(n, i, c)] = column[c - j][i];
      }
    }
    turn(end - j, columns, 0, j, n - 1, 1, &cov[j]);
  }
}

amb_real amb_model_shown(const amb_model *model, int r, const amb_real mean[])
{
  return amb_sparse_times(&model->c, model->c.value, r, mean);
}

/* to += value times row k of the symmetric matrix of which `cov` is the upper triangle. */
static void add_row_of(int n, int k, const amb_real cov[], amb_real value, amb_real *to)
{
  const amb_real *row = &cov[amb_entry(n, k, k)];
  int entry = k; /* down the column the rows get shorter */
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

/* Two rows of the covariance, of which the first has one entry more, at the front. */
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
