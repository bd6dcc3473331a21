#include "linear_forces.h"

#if defined(AMB_MODEL_LOOPS)

/* A weighted sum of rows: one row of a matrix product. */
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

/* Number of columns that are summed together, with the sums in registers. */
#define BLOCK 8

/* Columns `at` to `at` + BLOCK of the sum. Unrolled by hand: compilers vectorise this across
 * columns, but a loop along rows. */
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

/* The first `columns` of n columns of the sum. The last block is aligned with the end of the rows;
 * its overlap with the previous block is computed twice, with the same result. Columns beyond
 * `columns` may be written as well. */
static void add_up(const sum_of_rows *sum, int n, int columns, amb_real *to)
{
  if (sum->count == 0) {
    amb_clear(columns, to);
  } else if (n >= BLOCK) {
    for (int at = 0; at < columns; at += BLOCK) {
      const int from = (at + BLOCK <= n) ? at : (n - BLOCK);
      add_block(sum, from, &to[from]);
    }
  } else {
    for (int j = 0; j < columns; j++) {
      amb_real total = sum->value[0] * sum->row[0][j];
      for (int k = 1; k < sum->count; k++) {
        total += sum->value[k] * sum->row[k][j];
      }
      to[j] = total;
    }
  }
}

/* Adds the rows of X, n wide, with the coefficients of row i of A. */
static void add_rows_of(const amb_sparse *A, int i, const amb_real *X, int n, sum_of_rows *sum)
{
  for (int k = A->start[i]; k < (int)A->start[i + 1]; k++) {
    add_row(sum, A->value[k], &X[(int)A->column[k] * n]);
  }
}

/* Effect of the control noise on forces and states over a sample. */
typedef struct control_noise {
  amb_real gain[AMB_FORCES][AMB_CONTROLS];   /* g = k_i d k_ui [N/V] */
  amb_real variance[AMB_FORCES][AMB_FORCES]; /* q = g var g' [N^2] */
} control_noise;

static void noise_of_controls(const amb_model *model, const amb_stiffness k[],
                              const amb_real k_ui[], const amb_real var_u[], control_noise *noise)
{
  const int p = model->forces;
  const int controls = model->controls;
  noise->gain[0][0] = AMB_C(0.0); /* compilers do not know that there is at least one */
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

/* Parts of the workspace of a prediction. */
typedef struct workspace {
  amb_real *P; /* n x n, complete; later the transpose of M */
  amb_real *M; /* n x n, covariance of the next state with the state; later the process noise */
  amb_real *w; /* p x n, covariance of the forces with the state; later input rows of the forces */
  amb_real *z; /* p x n, covariance of the forces with the next state */
  amb_real *v; /* controls x n, covariance of the control noise with the next state */
  amb_real *u; /* controls x n, direct input rows of the controls */
} workspace;

static workspace parts_of(const amb_model *model, amb_real work[])
{
  const int n = model->states;
  workspace room;
  room.P = work;
  room.M = &room.P[n * n];
  room.w = &room.M[n * n];
  room.z = &room.w[model->forces * n];
  room.v = &room.z[model->forces * n];
  room.u = &room.v[model->controls * n];
  return room;
}

/* Transposes up to four rows, from entry `first` to before `end`: entry j of row r becomes element
 * r of line j. Lines are `step` apart, and this distance decreases by `less` from line to line. */
static void transpose_rows(int rows, const amb_real *const row[], int first, int end, int step,
                           int less, amb_real *to)
{
  amb_real *line = to;
  int apart = step;
  if (rows == 4) { /* without an inner loop: this dominates the time */
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

/* The upper triangle `cov`, mirrored into the lower triangle of the matrix P. */
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
    transpose_rows(end - i, row, end, n, n, 0, &P[end * n + i]);
  }
}

/* The complete symmetric matrix P. */
static void fill_symmetric(int n, const amb_real cov[], amb_real *P)
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
    transpose_rows(end - i, row, 0, n, n, 0, &to[i]);
  }
}

/* Gradients of the forces by the states, row by row. */
typedef struct force_rows {
  const unsigned short *start;
  const unsigned short *column;
  amb_real value[AMB_FORCES * AMB_STATES];
} force_rows;

/* Entry `at` of h, of magnet f and collocated states. */
static amb_real of_magnet(const amb_model *model, const amb_stiffness k[], int f, int at)
{
  return k[f].k_s * model->h.value[at] + k[f].k_i * model->e[at] + model->r[at];
}

/* w = row_f P, summed from last to first. */
static void set_force_covariance(const amb_model *model, const force_rows *rows,
                                 const workspace *room)
{
  const int n = model->states;
  for (int f = 0; f < model->forces; f++) {
    sum_of_rows sum;
    sum.count = 0;
    for (int a = (int)rows->start[f + 1] - 1; a >= (int)rows->start[f]; a--) {
      add_row(&sum, rows->value[a], &room->P[(int)rows->column[a] * n]);
    }
    add_up(&sum, n, n, &room->w[f * n]);
  }
}

/* Input rows of forces and controls: b, and B_u k_ui of the first `direct` controls. */
static void set_input_rows(const amb_model *model, const amb_real k_ui[], int direct,
                           const workspace *room)
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

/* v: covariance of the noise of control c with the next state; u is then scaled by the variance. */
static void set_control_covariance(const amb_model *model, int c, amb_real var_u,
                                   const control_noise *noise, const workspace *room)
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

/* z, where P now holds the transpose of M: the control noise in force f, then row_f M. */
static void set_next_force_covariance(const amb_model *model, int f, const control_noise *noise,
                                      const force_rows *rows, int direct, const workspace *room)
{
  const int n = model->states;
  sum_of_rows sum;
  sum.count = 0;
  for (int g = 0; g < model->forces; g++) {
    add_row(&sum, noise->variance[g][f], &room->w[g * n]);
  }
  for (int a = model->d.start[f]; (direct > 0) && (a < (int)model->d.start[f + 1]); a++) {
    const int c = model->d.column[a];
    add_row(&sum, noise->gain[f][c], &room->u[c * n]);
  }
  for (int a = (int)rows->start[f + 1] - 1; a >= (int)rows->start[f]; a--) {
    add_row(&sum, rows->value[a], &room->P[(int)rows->column[a] * n]);
  }
  add_up(&sum, n, n, &room->z[f * n]);
}

/* Column j of the predicted covariance, down to its diagonal. */
static void next_column(const amb_model *model, int j, const amb_real k_ui[], const workspace *room,
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

static void propagate(const amb_model *model, const force_rows *rows, const control_noise *noise,
                      const amb_real k_ui[], const amb_real var_u[], const amb_real growth[],
                      amb_real cov[], amb_real work[])
{
  const int n = model->states;
  const workspace room = parts_of(model, work);
  fill_symmetric(n, cov, room.P);
  set_force_covariance(model, rows, &room);
  for (int i = 0; i < n; i++) {
    sum_of_rows sum;
    sum.count = 0;
    add_rows_of(&model->L, i, room.P, n, &sum);
    add_rows_of(&model->b, i, room.w, n, &sum);
    add_up(&sum, n, n, &room.M[i * n]);
  }
  transpose(n, room.M, room.P);
  const int direct = (model->B_u.start[n] > 0U) ? model->controls : 0; /* controls that act directly
                                                                          on states */
  set_input_rows(model, k_ui, direct, &room);
  for (int c = 0; c < direct; c++) {
    set_control_covariance(model, c, var_u[c], noise, &room);
  }
  for (int f = 0; f < model->forces; f++) {
    set_next_force_covariance(model, f, noise, rows, direct, &room);
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
    transpose_rows(end - j, columns, 0, j, n - 1, 1, &cov[j]);
  }
}

void amb_model_predict_covariance(const amb_model *model, const amb_stiffness k[],
                                  const amb_real k_ui[], const amb_real var_u[],
                                  const amb_real growth[], amb_real cov[], amb_real work[])
{
  control_noise noise;
  force_rows rows;
  noise_of_controls(model, k, k_ui, var_u, &noise);
  rows.start = model->h.start;
  rows.column = model->h.column;
  for (int f = 0; f < model->forces; f++) {
    for (int a = rows.start[f]; a < (int)rows.start[f + 1]; a++) {
      rows.value[a] = of_magnet(model, k, f, a);
    }
  }
  propagate(model, &rows, &noise, k_ui, var_u, growth, cov, work);
}

/* Gradient of force f by all states, without zeros; returns how many entries there are then. */
static int add_gradient(const amb_model *model, const amb_stiffness k[], int f,
                        const amb_real gradient[], int count, unsigned short column[],
                        amb_real value[])
{
  const amb_sparse *h = &model->h;
  int next = h->start[f];
  int now = count;
  for (int j = 0; j < model->states; j++) {
    amb_real sum = gradient[j];
    if ((next < (int)h->start[f + 1]) && ((int)h->column[next] == j)) {
      sum = of_magnet(model, k, f, next) + gradient[j];
      next++;
    }
    if ((sum > AMB_C(0.0)) || (sum < AMB_C(0.0))) {
      column[now] = (unsigned short)j;
      value[now] = sum;
      now++;
    }
  }
  return now;
}

void amb_model_predict_with_forces(const amb_model *model, const amb_stiffness k[],
                                   const amb_real row[], const amb_real variance[],
                                   const amb_real k_ui[], const amb_real var_u[],
                                   const amb_real growth[], amb_real cov[], amb_real work[])
{
  const int p = model->forces;
  control_noise noise;
  force_rows rows;
  unsigned short start[AMB_FORCES + 1];
  unsigned short column[AMB_FORCES * AMB_STATES];
  noise_of_controls(model, k, k_ui, var_u, &noise);
  start[0] = 0U;
  for (int f = 0; f < p; f++) {
    const int count =
        add_gradient(model, k, f, &row[f * model->states], (int)start[f], column, rows.value);
    start[f + 1] = (unsigned short)count;
    for (int g = 0; g < p; g++) {
      noise.variance[g][f] += variance[g * p + f];
    }
  }
  rows.start = start;
  rows.column = column;
  propagate(model, &rows, &noise, k_ui, var_u, growth, cov, work);
}

#endif
